"""HTTP: requests that are nearly right, put to the service's application without a socket.

A case is a few requests, one a line of JSON: method, raw path and query, headers, body (latin-1).
"""

import asyncio
import functools
import json
import math
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from starlette.types import ASGIApp, Message, Scope

from autonomy.config import Config
from autonomy.service.api import Api
from autonomy.service.contract import MissionOrder, Phase
from autonomy.service.gate import Access
from autonomy.service.metrics import Metrics
from autonomy.service.openapi import document
from autonomy.service.station import Instant, Station
from autonomy.serving.desk import Desk
from hal.readings import FlightMode, LandedState, VehicleStatus
from tools.fuzz.cases import Tally, Target, lines, require, spoilt

_ENDLESS_S = 0.3
_METHODS = ("GET", "POST", "DELETE", "PUT", "HEAD", "OPTIONS", "PATCH", "TRACE", "X" * 50, "get")
_IDS = ("1", "", "..", "%2e%2e%2f", "%00", "a" * 3_000, "é", "m-1", "../../etc/passwd", "-1")
_BODY = {"goals": [[1.0, 0.5]], "frame": "ned", "altitude_m": 1.0, "land": True}
_VALUES: tuple[Any, ...] = (
    *(None, True, -1, 0, 1e308, -1e308, 10**400, "", "x" * 2_000, [], {}, [[]], [[1, 2]]),
    *([[1.0]], [[1, 2, 3, 4]], [["1", 2]], [[0.1, 0.1]] * 50, "enu", "body", "rolling", 0.3),
    *([[1e9, 0]], [[None, 1]], {"a": [1] * 100}),
)
_HEADERS = (
    *(("host", "127.0.0.1:8042"), ("host", "evil.example"), ("host", ""), ("host", "[::1")),
    *(("content-type", "text/plain"), ("content-type", "application/json; charset=utf-16")),
    *(("content-length", "-1"), ("content-length", "99999999999"), ("content-length", "x")),
    *(("origin", "http://evil.example"), ("origin", "null"), ("authorization", "Bearer \xff")),
    *(("authorization", "Bearer"), ("range", "bytes=5-1"), ("range", "bytes=-999999")),
    *(("transfer-encoding", "chunked"), ("x" * 5_000, "1"), ("cookie", "\x00")),
)


def _paths() -> tuple[str, ...]:
    return tuple(document()["paths"])


def _path(rng: np.random.Generator) -> str:
    path = _paths()[int(rng.integers(len(_paths())))]
    for name in ("{id}", "{name}"):
        path = path.replace(name, _IDS[int(rng.integers(len(_IDS)))])
    if rng.random() < 0.2:
        path = spoilt(rng, path.encode()).decode("latin-1")
    if rng.random() < 0.2:
        path += f"?{rng.bytes(int(rng.integers(12))).decode('latin-1')}"
    return path


def _body(rng: np.random.Generator) -> bytes:
    match int(rng.integers(4)):
        case 0:
            return rng.bytes(int(rng.integers(60)))
        case 1:
            return spoilt(rng, json.dumps(_BODY).encode())
        case 2:
            depth = int(rng.integers(1, 6_000))
            return b'{"goals": ' + b"[" * depth
    changed = dict(_BODY)
    for _ in range(int(rng.integers(3))):
        keys = (*_BODY, "mode", "time_limit_s", "goal", "")
        key = keys[int(rng.integers(len(keys)))]
        changed[key] = _VALUES[int(rng.integers(len(_VALUES)))]
    return json.dumps(changed).encode()


def make(rng: np.random.Generator) -> bytes:
    """One to six requests; every other one posts to /v1/missions."""
    requests = []
    for _ in range(int(rng.integers(1, 7))):
        headers = {"host": "127.0.0.1:8042", "content-type": "application/json"}
        for _ in range(int(rng.integers(3)) if rng.random() < 0.4 else 0):
            name, value = _HEADERS[int(rng.integers(len(_HEADERS)))]
            headers[name] = value
        mission = rng.random() < 0.5
        method = "POST" if mission else _METHODS[int(rng.integers(len(_METHODS)))]
        path = "/v1/missions" if mission else _path(rng)
        pairs = list(headers.items())
        requests.append([method, path, pairs, _body(rng).decode("latin-1")])
    return b"".join(json.dumps(request).encode() + b"\n" for request in requests)


@functools.cache
def _config() -> Config:
    return Config()


def _station(folder: Path) -> tuple[Station, ASGIApp]:
    """A service whose vehicle stands on the ground and is ready."""
    desk = Desk(_config(), None)
    station = Station(_config(), desk.check)
    desk.station = station
    status = VehicleStatus(
        0.0, armed=False, mode=FlightMode.HOLD, landed=LandedState.ON_GROUND, link_age_s=0.0
    )
    station.at_rest(Instant(0.0, status, {}))
    station.enter(Phase.READY, "PX4 is ready for a mission")
    api = Api(station, Metrics(station), Access(None), log_folder=folder)
    return station, api.application()


async def _ask(application: ASGIApp, request: list[Any]) -> int:
    """The status of the answer; 0 when it goes on for ever, as streams do."""
    method, target, headers, body = request
    path, _, query = target.partition("?")
    scope: Scope = {
        "type": "http",
        "asgi": {"version": "3.0"},
        "http_version": "1.1",
        "method": method,
        "scheme": "http",
        "path": path,
        "raw_path": path.encode("latin-1", "replace"),
        "query_string": query.encode("latin-1", "replace"),
        "root_path": "",
        "headers": [(k.encode("latin-1"), v.encode("latin-1")) for k, v in headers],
        "client": ("127.0.0.1", 1),
        "server": ("127.0.0.1", 8042),
    }
    waiting: list[Message] = [
        {"type": "http.request", "body": body.encode("latin-1"), "more_body": False}
    ]
    statuses: list[int] = []

    async def receive() -> Message:
        if waiting:
            return waiting.pop()
        await asyncio.sleep(_ENDLESS_S / 3.0)
        return {"type": "http.disconnect"}

    async def send(message: Message) -> None:
        if message["type"] == "http.response.start":
            statuses.append(message["status"])

    try:
        async with asyncio.timeout(_ENDLESS_S):
            await application(scope, receive, send)
    except TimeoutError:
        return statuses[0] if statuses else 0
    return statuses[0] if statuses else 0


def run(case: bytes) -> Tally:
    """Answers are never the server's own failure, and only an accepted order is one."""
    tally = Tally()
    with tempfile.TemporaryDirectory() as folder:
        station, application = _station(Path(folder))
        for line in lines(case):
            request = json.loads(line)
            status = asyncio.run(_ask(application, request))
            require(100 <= status < 500, f"{request[0]} {request[1][:100]!r} is answered {status}")
            tally[f"{status}"] += 1
            commands, mission = station.take_commands(), station.take_mission()
            if mission is not None:
                require(status == 201, f"a mission was queued by an answer of {status}")
                _sound(mission.order)
            require(not commands or status == 202, f"{commands} by an answer of {status}")
    return tally


def _sound(order: MissionOrder) -> None:
    numbers = [number for goal in order.goals for number in goal]
    require(all(map(math.isfinite, numbers)), f"{order} is not finite")
    fence = _config().guard.fence
    for goal in order.goals:
        if order.frame == "ned":
            inside = fence.inside_distance_m(goal[0], goal[1]) > 0.0
            require(inside, f"{goal} is outside the fence")


API = Target("api", make, run, lines)
