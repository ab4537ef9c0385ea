"""The service's HTTP and WebSocket interface, version 1. README.md lists the paths.

Handlers only read the station and queue orders; none of them can reach a vehicle. What does not
fit the contract is refused before it is looked at any closer.
"""

import asyncio
import hmac
import time
from collections.abc import Awaitable, Callable
from pathlib import Path
from urllib.parse import urlsplit

import msgspec
from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import FileResponse, Response, StreamingResponse
from starlette.routing import Route, WebSocketRoute
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from starlette.websockets import WebSocket, WebSocketDisconnect

from autonomy import __version__
from autonomy.errors import AutonomyError
from autonomy.model import OperatorCommand
from autonomy.service import logs, view
from autonomy.service.contract import MissionOrder, MissionRecord, Phase, Problem
from autonomy.service.follow import frames
from autonomy.service.metrics import CONTENT_TYPE, Metrics
from autonomy.service.openapi import document
from autonomy.service.station import Refused, Station
from autonomy.service.stream import Cursor
from hal.errors import HalError

BODY_BYTES_MAX = 16 * 1024
ORDERS_PER_S, ORDERS_BURST = 5.0, 20
STREAMS_MAX = 16
SUBPROTOCOL = "autonomy.v1"
_SEND_S = 5.0
_LOOPBACK = frozenset({"localhost", "127.0.0.1", "[::1]"})
_SECURITY = (
    (b"content-security-policy", b"default-src 'self'; frame-ancestors 'none'; base-uri 'none'"),
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"no-referrer"),
    (b"cache-control", b"no-store"),
)
_PAGE_TYPES = {
    ".html": "text/html; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".svg": "image/svg+xml",
}
_OPEN_PATHS = frozenset({"/", "/v1/health", "/v1/openapi.json"})
"""Answered without a token: they tell nothing of the room and move nothing."""


class Access(msgspec.Struct, frozen=True):
    """Who may ask. `token` is None only where the service listens on loopback alone.

    `hosts` are names under which a browser may know the service; None: any (there is a token).
    """

    token: str | None
    hosts: frozenset[str] | None = _LOOPBACK

    def token_fits(self, given: str) -> bool:
        """Compares in constant time."""
        return self.token is None or hmac.compare_digest(given.encode(), self.token.encode())


class Api:
    """Builds the ASGI application around one station."""

    def __init__(
        self,
        station: Station,
        metrics: Metrics,
        access: Access,
        *,
        log_folder: Path,
        scenario: str | None = None,
    ) -> None:
        self._station = station
        self._metrics = metrics
        self._access = access
        self._log_folder = log_folder
        self._room = view.room(station.config, scenario, token_required=access.token is not None)
        self._page = _page()
        self._bucket = Bucket(ORDERS_PER_S, ORDERS_BURST)
        self._streams = 0

    def application(self) -> ASGIApp:
        """The application with its gates before it."""
        get, post = ["GET"], ["POST"]
        routes = [
            Route("/", self._file, methods=get),
            Route("/web/{name}", self._file, methods=get),
            Route("/metrics", self._read_metrics, methods=get),
            Route("/v1/health", self._health, methods=get),
            Route("/v1/openapi.json", self._openapi, methods=get),
            Route("/v1/state", self._state, methods=get),
            Route("/v1/room", self._read_room, methods=get),
            Route("/v1/plan", self._plan, methods=get),
            Route("/v1/events", self._events, methods=get),
            Route("/v1/config", self._config, methods=get),
            Route("/v1/missions", self._missions, methods=get),
            Route("/v1/missions", self._create, methods=post),
            Route("/v1/missions/{id}", self._mission, methods=get),
            Route("/v1/missions/{id}", self._abort, methods=["DELETE"]),
            Route("/v1/missions/{id}/follow", self._follow, methods=get),
            Route("/v1/stop", self._command(OperatorCommand.STOP), methods=post),
            Route("/v1/hold", self._command(OperatorCommand.HOLD), methods=post),
            Route("/v1/resume", self._command(OperatorCommand.RESUME), methods=post),
            Route("/v1/land", self._command(OperatorCommand.LAND), methods=post),
            Route("/v1/logs", self._logs, methods=get),
            Route("/v1/logs/{name}", self._log, methods=get),
            WebSocketRoute("/v1/stream", self._stream),
        ]
        application = Starlette(
            routes=routes,
            exception_handlers={
                HTTPException: _http_problem,
                AutonomyError: _refused,
                HalError: _refused,
                Exception: _defect,
            },
        )
        # Redirecting reads the query as text, which it need not be; paths are spelt as listed.
        application.router.redirect_slashes = False
        return Gate(application, self._access)

    # ------------------------------------------------------------ reading

    async def _health(self, _: Request) -> Response:
        station = self._station
        return _json(
            {
                "version": __version__,
                "phase": station.phase,
                "why": station.why,
                "vehicle": station.instant is not None,
            }
        )

    async def _openapi(self, _: Request) -> Response:
        return _json(document())

    async def _state(self, _: Request) -> Response:
        return _json(view.state(self._station))

    async def _read_room(self, _: Request) -> Response:
        return _json(self._room)

    async def _plan(self, _: Request) -> Response:
        drawn = self._station.drawn
        plan = view.plan(drawn) if drawn is not None else None
        if plan is None:
            raise HTTPException(404, "nothing was planned yet; start a mission")
        return _json(plan)

    async def _events(self, _: Request) -> Response:
        return _json(self._station.events)

    async def _config(self, _: Request) -> Response:
        return _json(self._station.config.model_dump(mode="json"))

    async def _read_metrics(self, _: Request) -> Response:
        return Response(self._metrics.text(), media_type=CONTENT_TYPE)

    async def _logs(self, _: Request) -> Response:
        return _json(await asyncio.to_thread(logs.listed, self._log_folder))

    async def _log(self, request: Request) -> Response:
        name = request.path_params["name"]
        path = await asyncio.to_thread(logs.found, self._log_folder, name)
        if path is None:
            raise HTTPException(404, "there is no such flight log; GET /v1/logs lists them")
        return FileResponse(path, filename=name, media_type="application/octet-stream")

    async def _file(self, request: Request) -> Response:
        name = request.path_params.get("name", "index.html")
        content = self._page.get(name)
        if content is None:
            raise HTTPException(404, "there is no such page")
        return Response(content, media_type=_PAGE_TYPES[Path(name).suffix])

    # ------------------------------------------------------------ asking

    async def _missions(self, _: Request) -> Response:
        return _json(self._station.missions())

    async def _mission(self, request: Request) -> Response:
        return _json(self._known(request))

    async def _create(self, request: Request) -> Response:
        if not self._bucket.take(time.monotonic()):
            raise HTTPException(429, "too many missions at once; wait a second")
        try:
            order = msgspec.json.decode(await request.body(), type=MissionOrder)
        except (msgspec.DecodeError, UnicodeDecodeError) as error:
            raise HTTPException(422, f"this is not a mission: {error}") from None
        # The check loads a scenario's world: not in the loop that streams.
        record = await asyncio.to_thread(self._station.submit, order)
        return _json(record, 201)

    async def _abort(self, request: Request) -> Response:
        record = self._station.abort(self._known(request).id)
        return _json(record, 202)

    async def _follow(self, request: Request) -> Response:
        self._known(request)
        stream = frames(self._station, request.path_params["id"])
        return StreamingResponse(stream, media_type="application/octet-stream")

    def _command(self, command: OperatorCommand) -> Callable[[Request], Awaitable[Response]]:
        """The handler that queues `command`. Never limited in rate: stopping is always allowed."""

        async def handler(_: Request) -> Response:
            self._station.command(command)
            return _json({"queued": command}, 202)

        return handler

    def _known(self, request: Request) -> MissionRecord:
        record = self._station.mission(request.path_params["id"])
        if record is None:
            raise HTTPException(404, "there is no such mission; GET /v1/missions lists them")
        return record

    # ------------------------------------------------------------ the stream

    async def _stream(self, socket: WebSocket) -> None:
        """Messages of `contract.Message` as JSON text; what the client sends is ignored."""
        offered = socket.scope.get("subprotocols", [])
        if self._streams >= STREAMS_MAX:
            await socket.close(1013, "too many streams")
            return
        await socket.accept(SUBPROTOCOL if SUBPROTOCOL in offered else None)
        self._streams += 1
        self._metrics.streams.set(self._streams)
        try:
            async with asyncio.TaskGroup() as group:
                sender = group.create_task(self._send(socket))
                await _until_closed(socket)
                sender.cancel()
        finally:
            self._streams -= 1
            self._metrics.streams.set(self._streams)

    async def _send(self, socket: WebSocket) -> None:
        """The newest, at the stream's rate or as fast as the client takes it; nothing is queued."""
        cursor = Cursor(self._station, self._room)
        period_s = 1.0 / self._station.config.service.stream_hz
        try:
            while self._station.phase is not Phase.STOPPING or self._station.instant is not None:
                for message in cursor.news():
                    async with asyncio.timeout(_SEND_S):
                        await socket.send_text(message)
                await asyncio.sleep(period_s)
            await socket.close(1001)
        except (WebSocketDisconnect, RuntimeError, TimeoutError):
            # Gone, or too slow to be shown anything: it may come back.
            return


async def _until_closed(socket: WebSocket) -> None:
    while True:
        message = await socket.receive()
        if message["type"] == "websocket.disconnect":
            return


class Bucket:
    """A token bucket: `burst` at once, `per_s` in the long run."""

    def __init__(self, per_s: float, burst: int) -> None:
        self._per_s, self._burst = per_s, float(burst)
        self._left, self._at_s = float(burst), 0.0

    def take(self, now_s: float) -> bool:
        """True when one more is allowed at `now_s`."""
        self._left = min(self._burst, self._left + (now_s - self._at_s) * self._per_s)
        self._at_s = now_s
        if self._left < 1.0:
            return False
        self._left -= 1.0
        return True


# ---------------------------------------------------------------- the gate


class Gate:
    """Before everything else: right host, right origin, right token, right size."""

    def __init__(self, application: ASGIApp, access: Access) -> None:
        self._application = application
        self._access = access

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """ASGI."""
        if scope["type"] not in ("http", "websocket"):
            await self._application(scope, receive, send)
            return
        headers = {name.decode("latin-1"): v.decode("latin-1") for name, v in scope["headers"]}
        refusal = self._refusal(scope, headers)
        if refusal is not None:
            if scope["type"] == "websocket":
                await send({"type": "websocket.close", "code": 1008, "reason": refusal[1][:100]})
            else:
                await _json(Problem(refusal[1]), refusal[0])(scope, receive, _secured(send))
            return
        if scope["type"] == "websocket":
            await self._application(scope, receive, send)
            return
        await self._application(scope, _limited(receive), _secured(send))

    def _refusal(self, scope: Scope, headers: dict[str, str]) -> tuple[int, str] | None:
        """(status, sentence) for a request that must not pass."""
        host = headers.get("host", "")
        if self._access.hosts is not None and _name(host) not in self._access.hosts:
            # A name that somebody pointed at this machine is how web pages reach loopback.
            return 421, "this service does not answer under that name; use 127.0.0.1"
        origin = headers.get("origin")
        if origin is not None and urlsplit(origin).netloc.lower() != host.lower():
            return 403, "other web pages may not talk to this service"
        if scope["path"] not in _OPEN_PATHS and not scope["path"].startswith("/web/"):
            given = _token(headers)
            if self._access.token is not None and not self._access.token_fits(given):
                return 401, "a token is needed: Authorization: Bearer TOKEN"
        return self._body_refusal(scope, headers)

    def _body_refusal(self, scope: Scope, headers: dict[str, str]) -> tuple[int, str] | None:
        if scope["type"] != "http" or scope["method"] in ("GET", "HEAD"):
            return None
        length = headers.get("content-length", "0")
        if not length.isdigit() or int(length) > BODY_BYTES_MAX:
            return 413, f"at most {BODY_BYTES_MAX} bytes are taken"
        kind = headers.get("content-type", "").partition(";")[0].strip().lower()
        has_body = length != "0" or "transfer-encoding" in headers
        if has_body and kind != "application/json":
            return 415, "send application/json"
        return None


def _name(host: str) -> str:
    """The name in a Host header, without its port."""
    return (host.rpartition(":")[0] if host.rpartition(":")[2].isdigit() else host).lower()


def _token(headers: dict[str, str]) -> str:
    """The token of a request; browsers can put one into a WebSocket's subprotocols only."""
    scheme, _, token = headers.get("authorization", "").partition(" ")
    if scheme.lower() == "bearer":
        return token.strip()
    for offered in headers.get("sec-websocket-protocol", "").split(","):
        if offered.strip().startswith("bearer."):
            return offered.strip().removeprefix("bearer.")
    return ""


def _limited(receive: Receive) -> Receive:
    """`receive`, refusing a body that grows beyond what its header promised."""
    taken = 0

    async def limited() -> Message:
        nonlocal taken
        message = await receive()
        taken += len(message.get("body", b""))
        if taken > BODY_BYTES_MAX:
            raise HTTPException(413, f"at most {BODY_BYTES_MAX} bytes are taken")
        return message

    return limited


def _secured(send: Send) -> Send:
    async def secured(message: Message) -> None:
        if message["type"] == "http.response.start":
            message["headers"] = [*message.get("headers", ()), *_SECURITY]
        await send(message)

    return secured


# ---------------------------------------------------------------- answers


def _json(value: object, status: int = 200) -> Response:
    return Response(msgspec.json.encode(value), status, media_type="application/json")


async def _http_problem(_: Request, error: Exception) -> Response:
    assert isinstance(error, HTTPException)  # noqa: S101 - registered for nothing else
    response = _json(Problem(error.detail), error.status_code)
    response.headers.update(error.headers or {})
    return response


async def _refused(_: Request, error: Exception) -> Response:
    return _json(Problem(str(error)), 409 if isinstance(error, Refused) else 422)


async def _defect(_: Request, error: Exception) -> Response:
    return _json(Problem(f"a defect of this program: {type(error).__name__}"), 500)


def _page() -> dict[str, bytes]:
    """The page's files by name, read once: nothing else can ever be served."""
    folder = Path(__file__).parent / "web"
    return {
        path.name: path.read_bytes()
        for path in sorted(folder.iterdir())
        if path.suffix in _PAGE_TYPES
    }
