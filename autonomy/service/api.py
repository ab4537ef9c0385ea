"""The service's HTTP and WebSocket interface, version 1. README.md lists the paths.

Handlers only read the station and queue orders; none of them can reach a vehicle. What does not
fit the contract is refused before it is looked at any closer.
"""

import asyncio
import contextlib
import time
from collections.abc import Awaitable, Callable
from pathlib import Path

import msgspec
from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import FileResponse, Response, StreamingResponse
from starlette.routing import Route, WebSocketRoute
from starlette.types import ASGIApp
from starlette.websockets import WebSocket, WebSocketDisconnect

from autonomy import __version__
from autonomy.errors import AutonomyError, BadInput
from autonomy.model import OperatorCommand
from autonomy.service import logs, sightings, view
from autonomy.service.contract import MissionOrder, MissionRecord, Phase, Problem
from autonomy.service.follow import frames
from autonomy.service.gate import Access, Bucket, Gate, answered
from autonomy.service.metrics import CONTENT_TYPE, Metrics
from autonomy.service.openapi import document
from autonomy.service.station import Refused, Station
from autonomy.service.stream import Cursor
from autonomy.service.workshop import Busy, Workshop
from hal.errors import HalError

ORDERS_PER_S, ORDERS_BURST = 5.0, 20
STREAMS_MAX = 16
SUBPROTOCOL = "autonomy.v1"
_SEND_S, _FAREWELL_S = 5.0, 1.0
_LOOK_S = 0.25
"""Between two looks whether the service is ending."""
_GZIP = {"content-encoding": "gzip"}
_REPORT = {
    # A report has its style and its drawings in itself, and nothing to run.
    "content-security-policy": "default-src 'none'; style-src 'unsafe-inline'; img-src data:; "
    "sandbox; frame-ancestors 'none'; base-uri 'none'"
}
_PAGE_TYPES = {
    ".html": "text/html; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".svg": "image/svg+xml",
}


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
        workshop: Workshop | None = None,
        clock_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self._clock_s = clock_s
        self._workshop = workshop or Workshop()
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
            Route("/v1/faults", self._faults, methods=get),
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
            Route("/v1/reading", self._reading, methods=get),
            Route("/v1/logs/{name}", self._log, methods=get),
            Route("/v1/logs/{name}/reel", self._reel, methods=get),
            Route("/v1/logs/{name}/report", self._report, methods=get),
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
        return Gate(application, self._access, self._clock_s)

    # ------------------------------------------------------------ reading

    async def _health(self, _: Request) -> Response:
        station = self._station
        return answered(
            {
                "version": __version__,
                "phase": station.phase,
                "why": station.why,
                "vehicle": station.instant is not None,
            }
        )

    async def _openapi(self, _: Request) -> Response:
        return answered(document())

    async def _state(self, _: Request) -> Response:
        return answered(view.state(self._station))

    async def _read_room(self, _: Request) -> Response:
        return answered(self._room)

    async def _plan(self, _: Request) -> Response:
        drawn = self._station.drawn
        plan = view.plan(drawn) if drawn is not None else None
        if plan is None:
            raise HTTPException(404, "nothing was planned yet; start a mission")
        return answered(plan)

    async def _events(self, _: Request) -> Response:
        return answered(self._station.events)

    async def _faults(self, _: Request) -> Response:
        drawn = self._station.drawn
        seen = drawn.faults if drawn is not None else None
        return answered(sightings.faults(self._station.config, seen))

    async def _config(self, _: Request) -> Response:
        return answered(self._station.config.model_dump(mode="json"))

    async def _read_metrics(self, _: Request) -> Response:
        return Response(self._metrics.text(), media_type=CONTENT_TYPE)

    async def _logs(self, _: Request) -> Response:
        return answered(await asyncio.to_thread(logs.listed, self._log_folder))

    async def _reading(self, _: Request) -> Response:
        return answered(self._workshop.reading)

    async def _log(self, request: Request) -> Response:
        path = await self._found(request)
        return FileResponse(path, filename=path.name, media_type="application/octet-stream")

    async def _reel(self, request: Request) -> Response:
        made = await self._made("reel", request)
        return Response(made, headers=_GZIP, media_type="application/json")

    async def _report(self, request: Request) -> Response:
        made = await self._made("report", request)
        return Response(made, headers=_GZIP | _REPORT, media_type="text/html")

    async def _made(self, what: str, request: Request) -> bytes:
        """What the workshop makes of the log that the path names, for as long as somebody waits.

        The server lets a handler run on whose client has left; the workshop would stay taken.
        """
        log = await self._found(request)
        async with asyncio.TaskGroup() as group:
            making = group.create_task(self._attempt(what, log))
            left = group.create_task(_until_left(request))
            while self._station.phase is not Phase.STOPPING:
                await asyncio.wait(
                    (making, left), timeout=_LOOK_S, return_when=asyncio.FIRST_COMPLETED
                )
                if making.done() or left.done():
                    break
            made = making.result() if making.done() else None
            making.cancel()
            left.cancel()
        if made is None:
            raise HTTPException(503, "the service is ending; ask again when it is back")
        if isinstance(made, BadInput):
            raise made
        return made

    async def _attempt(self, what: str, log: Path) -> bytes | BadInput:
        """What the workshop made of `log`, or why it could not: no error for a group of tasks."""
        try:
            return await self._workshop.make(what, log)
        except BadInput as error:
            return error

    async def _found(self, request: Request) -> Path:
        """The log that the path names; raises HTTPException."""
        path = await asyncio.to_thread(logs.found, self._log_folder, request.path_params["name"])
        if path is None:
            raise HTTPException(404, "there is no such flight log; GET /v1/logs lists them")
        return path

    async def _file(self, request: Request) -> Response:
        name = request.path_params.get("name", "index.html")
        content = self._page.get(name)
        if content is None:
            raise HTTPException(404, "there is no such page")
        return Response(content, media_type=_PAGE_TYPES[Path(name).suffix])

    # ------------------------------------------------------------ asking

    async def _missions(self, _: Request) -> Response:
        return answered(self._station.missions())

    async def _mission(self, request: Request) -> Response:
        return answered(self._known(request))

    async def _create(self, request: Request) -> Response:
        if not self._bucket.take(self._clock_s()):
            raise HTTPException(429, "too many missions at once; wait a second")
        try:
            order = msgspec.json.decode(await request.body(), type=MissionOrder)
        except (msgspec.DecodeError, UnicodeDecodeError) as error:
            raise HTTPException(422, f"this is not a mission: {error}") from None
        # The check loads a scenario's world: not in the loop that streams.
        record = await asyncio.to_thread(self._station.submit, order)
        return answered(record, 201)

    async def _abort(self, request: Request) -> Response:
        record = self._station.abort(self._known(request).id)
        return answered(record, 202)

    async def _follow(self, request: Request) -> Response:
        self._known(request)
        stream = frames(self._station, request.path_params["id"])
        return StreamingResponse(stream, media_type="application/octet-stream")

    def _command(self, command: OperatorCommand) -> Callable[[Request], Awaitable[Response]]:
        """The handler that queues `command`. Never limited in rate: stopping is always allowed."""

        async def handler(_: Request) -> Response:
            self._station.command(command)
            return answered({"queued": command}, 202)

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
                reader = group.create_task(_until_closed(socket))
                await asyncio.wait((sender, reader), return_when=asyncio.FIRST_COMPLETED)
                sender.cancel()
                reader.cancel()
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
        except TimeoutError:
            # Too slow to be shown anything: its place is free, and it may come back. The farewell
            # waits in the same line, and is not waited for: the connection ends with or without.
            with contextlib.suppress(WebSocketDisconnect, RuntimeError, TimeoutError):
                async with asyncio.timeout(_FAREWELL_S):
                    await socket.close(1013, "too slow")
        except (WebSocketDisconnect, RuntimeError):
            return


async def _until_left(request: Request) -> None:
    while True:
        message = await request.receive()
        if message["type"] == "http.disconnect":
            return


async def _until_closed(socket: WebSocket) -> None:
    while True:
        message = await socket.receive()
        if message["type"] == "websocket.disconnect":
            return


# ---------------------------------------------------------------- answers


async def _http_problem(_: Request, error: Exception) -> Response:
    assert isinstance(error, HTTPException)  # noqa: S101 - registered for nothing else
    response = answered(Problem(error.detail), error.status_code)
    response.headers.update(error.headers or {})
    return response


async def _refused(_: Request, error: Exception) -> Response:
    code = 409 if isinstance(error, Refused) else 429 if isinstance(error, Busy) else 422
    return answered(Problem(str(error)), code)


async def _defect(_: Request, error: Exception) -> Response:
    return answered(Problem(f"a defect of this program: {type(error).__name__}"), 500)


def _page() -> dict[str, bytes]:
    """The page's files by name, read once: nothing else can ever be served."""
    folder = Path(__file__).parent / "web"
    return {
        path.name: path.read_bytes()
        for path in sorted(folder.iterdir())
        if path.suffix in _PAGE_TYPES
    }
