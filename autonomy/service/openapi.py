"""The description of the HTTP interface in OpenAPI 3.1, from the contract's own types."""

from typing import Any

import msgspec

from autonomy import __version__
from autonomy.service import contract

_TYPES = (
    contract.State,
    contract.Room,
    contract.PlanView,
    contract.EventView,
    contract.MissionOrder,
    contract.MissionRecord,
    contract.FaultView,
    contract.LogFile,
    contract.Reading,
    contract.Reel,
    contract.Problem,
)
_REF = "#/components/schemas/{name}"


def document() -> dict[str, Any]:
    """The whole description, ready for JSON."""
    _, components = msgspec.json.schema_components(_TYPES, ref_template=_REF)
    components |= {
        "Health": {
            "type": "object",
            "required": ["version", "phase", "why", "vehicle"],
            "properties": {
                "version": {"type": "string"},
                "phase": {"$ref": _REF.format(name="Phase")},
                "why": {"type": "string"},
                "vehicle": {"type": "boolean"},
            },
        },
        "Queued": {
            "type": "object",
            "required": ["queued"],
            "properties": {"queued": {"enum": ["stop", "hold", "resume", "land"]}},
        },
    }
    return {
        "openapi": "3.1.0",
        "info": {
            "title": "autonomy",
            "version": __version__,
            "description": (
                "The service on the drone. Orders are queued for the control loop's next tick. "
                "WebSocket /v1/stream (subprotocol autonomy.v1) sends State, Room, Hits, PlanView, "
                "Track and EventView, told apart by `type`."
            ),
        },
        "paths": _paths(),
        "components": {
            "schemas": components,
            "securitySchemes": {"token": {"type": "http", "scheme": "bearer"}},
        },
        "security": [{"token": []}, {}],
    }


def _paths() -> dict[str, Any]:
    mission_id = _parameter("id", "The mission's id.")
    log_name = _parameter("name", "The log's name.")
    nothing_there = _problem("There is none of that name.")
    made = {
        "404": nothing_there,
        "422": _problem("A log that cannot be flown again."),
        "503": _problem("The service is ending."),
    }
    refused = {"409": _problem("Not now; the sentence says why.")}
    return {
        "/v1/health": {"get": _reads("Is it there, what is it doing", "Health", token=False)},
        "/v1/openapi.json": {"get": _reads("This description", None, token=False)},
        "/v1/state": {"get": _reads("What is true now", "State")},
        "/v1/room": {"get": _reads("What does not change in a flight", "Room")},
        "/v1/plan": {"get": _with(_reads("The newest plan", "PlanView"), {"404": nothing_there})},
        "/v1/events": {"get": _reads("What happened, oldest first", "EventView", many=True)},
        "/v1/faults": {
            "get": _reads("The table of faults, and what this flight saw", "FaultView", many=True)
        },
        "/v1/config": {"get": _reads("The effective configuration", None)},
        "/v1/missions": {
            "get": _reads("All missions, newest first", "MissionRecord", many=True),
            "post": {
                "summary": "Fly a mission",
                "requestBody": {
                    "required": True,
                    "content": _content({"$ref": _REF.format(name="MissionOrder")}),
                },
                "responses": {
                    "201": _answer("Queued.", {"$ref": _REF.format(name="MissionRecord")}),
                    "413": _problem("Too long."),
                    "415": _problem("Not JSON."),
                    "422": _problem("Not a mission, or one that must not be flown."),
                    **refused,
                    **_DENIED,
                },
            },
        },
        "/v1/missions/{id}": {
            "parameters": [mission_id],
            "get": _with(_reads("One mission", "MissionRecord"), {"404": nothing_there}),
            "delete": {
                "summary": "Take it back, or stop it",
                "responses": {
                    "202": _answer("Asked for.", {"$ref": _REF.format(name="MissionRecord")}),
                    "404": nothing_there,
                    **_DENIED,
                },
            },
        },
        "/v1/missions/{id}/follow": {
            "parameters": [mission_id],
            "get": {
                "summary": "Frames of a mission until it is over (length, MessagePack)",
                "responses": {
                    "200": {
                        "description": "A stream.",
                        "content": {"application/octet-stream": {}},
                    },
                    "404": nothing_there,
                    **_DENIED,
                },
            },
        },
        "/v1/stop": {"post": _orders("Stop, hold, then land; again: land now", refused)},
        "/v1/hold": {"post": _orders("Hold here until told something else", refused)},
        "/v1/resume": {"post": _orders("Go on after hold", refused)},
        "/v1/land": {"post": _orders("Land here, now", refused)},
        "/v1/logs": {"get": _reads("Flight logs, newest first", "LogFile", many=True)},
        "/v1/reading": {
            "get": _reads("What is being made of which log, and how much of it is read", "Reading")
        },
        "/v1/logs/{name}": {
            "parameters": [log_name],
            "get": {
                "summary": "One flight log",
                "responses": {
                    "200": {
                        "description": "MCAP.",
                        "content": {"application/octet-stream": {}},
                    },
                    "404": nothing_there,
                    **_DENIED,
                },
            },
        },
        "/v1/logs/{name}/reel": {
            "parameters": [log_name],
            "get": _with(_reads("A flight to look back at", "Reel"), made),
        },
        "/v1/logs/{name}/report": {
            "parameters": [log_name],
            "get": {
                "summary": "A flight's report as a page",
                "responses": {
                    "200": {"description": "HTML.", "content": {"text/html": {}}},
                    **made,
                    **_DENIED,
                },
            },
        },
        "/metrics": {
            "get": {
                "summary": "Prometheus",
                "responses": {
                    "200": {"description": "Text.", "content": {"text/plain": {}}},
                    **_DENIED,
                },
            }
        },
    }


def _content(schema: dict[str, Any]) -> dict[str, Any]:
    return {"application/json": {"schema": schema}}


def _answer(description: str, schema: dict[str, Any]) -> dict[str, Any]:
    return {"description": description, "content": _content(schema)}


def _problem(description: str) -> dict[str, Any]:
    return _answer(description, {"$ref": _REF.format(name="Problem")})


_DENIED: dict[str, Any] = {
    "401": _problem("A token is needed."),
    "403": _problem("Another web page asked."),
    "421": _problem("Not under that name."),
    "429": _problem("Too much at once; wait a little."),
}


def _parameter(name: str, description: str) -> dict[str, Any]:
    return {
        "name": name,
        "in": "path",
        "required": True,
        "description": description,
        "schema": {"type": "string"},
    }


def _reads(
    summary: str, name: str | None, *, many: bool = False, token: bool = True
) -> dict[str, Any]:
    one: dict[str, Any] = {"$ref": _REF.format(name=name)} if name else {"type": "object"}
    schema = {"type": "array", "items": one} if many else one
    operation: dict[str, Any] = {
        "summary": summary,
        "responses": {"200": _answer("It.", schema), **_DENIED},
    }
    return operation if token else operation | {"security": [{}]}


def _with(operation: dict[str, Any], responses: dict[str, Any]) -> dict[str, Any]:
    return operation | {"responses": operation["responses"] | responses}


def _orders(summary: str, refused: dict[str, Any]) -> dict[str, Any]:
    queued = _answer("Queued for the next tick.", {"$ref": _REF.format(name="Queued")})
    return {"summary": summary, "responses": {"202": queued, **refused, **_DENIED}}
