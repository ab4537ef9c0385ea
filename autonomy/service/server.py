"""The web side's own thread: its own event loop and socket, never in the control loop's way."""

import errno
import ipaddress
import os
import re
import socket
import threading
from collections.abc import Mapping
from pathlib import Path
from types import TracebackType
from typing import Self

import uvicorn
from starlette.types import ASGIApp

from autonomy.config import ServiceConfig
from autonomy.errors import AutonomyError, BadInput, NotNow
from autonomy.service.gate import Access
from hal.errors import PortInUse

TOKEN_CHARACTERS_MIN = 20
_TOKEN = re.compile(r"[A-Za-z0-9._~-]+")
"""What a header and a WebSocket's subprotocol both carry as it is (RFC 3986's unreserved)."""
_MAKE_ONE = "make one with: python3 -c 'import secrets; print(secrets.token_urlsafe(32))'"
_START_S = 10.0
_STOP_S = 3
_LOOPBACK_NAMES = frozenset({"localhost", "127.0.0.1", "[::1]"})


class PortTaken(NotNow, PortInUse):
    """Another process listens there."""


def is_loopback(host: str) -> bool:
    """True when only this machine can reach `host`."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def access_of(config: ServiceConfig, environ: Mapping[str, str]) -> Access:
    """Who may ask a service of this configuration.

    Raises BadInput when it would be reachable from elsewhere without a token worth the name, and
    for a token that a browser cannot send.
    """
    token = _token(config, environ)
    if token is not None and len(token) < TOKEN_CHARACTERS_MIN:
        raise BadInput(
            f"the service's token is shorter than {TOKEN_CHARACTERS_MIN} characters; {_MAKE_ONE}"
        )
    if token is not None and not _TOKEN.fullmatch(token):
        raise BadInput(
            "the service's token may hold letters, digits and . _ ~ - only: a browser can send "
            f"no other; {_MAKE_ONE}"
        )
    if token is not None:
        return Access(token, None)
    if not is_loopback(config.host):
        raise BadInput(
            f"service.host {config.host} can be reached from elsewhere, which needs a token: set "
            "service.token_file or AUTONOMY_TOKEN, or listen on 127.0.0.1"
        )
    return Access(None, _LOOPBACK_NAMES | {name.lower() for name in config.allowed_hosts})


def _token(config: ServiceConfig, environ: Mapping[str, str]) -> str | None:
    path = config.token_file
    given = environ.get("AUTONOMY_TOKEN")
    credentials = environ.get("CREDENTIALS_DIRECTORY")
    if path is None and given:
        return given
    if path is None and credentials is not None and not is_loopback(config.host):
        # The unit hands over the installed token; loopback does not need it.
        path = str(Path(credentials) / "token")
    if path is None:
        return None
    try:
        token = Path(path).read_text(encoding="utf-8").strip()
    except (OSError, UnicodeDecodeError) as error:
        raise BadInput(f"{path}: the token cannot be read ({error})") from None
    if not token:
        raise BadInput(f"{path}: holds no token; remove it or put one in")
    return token


def listening_socket(host: str, port: int) -> socket.socket:
    """A socket that listens; raises PortTaken, NotNow for an address that this machine
    does not have (yet), BadInput for one that it must not use.
    """
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    try:
        return socket.create_server((host, port), family=family, reuse_port=False)
    except OSError as error:
        if error.errno == errno.EADDRINUSE:
            raise PortTaken(
                f"port {port} on {host} is taken by another process; choose one with --port"
            ) from None
        unknown = isinstance(error, socket.gaierror)
        why = error.strerror if unknown else os.strerror(error.errno or 0)
        # At a computer's start its network comes after this service.
        later = unknown or error.errno == errno.EADDRNOTAVAIL
        raise (NotNow if later else BadInput)(f"cannot listen on {host}:{port} ({why})") from None


def url_of(listening: socket.socket) -> str:
    """Where a browser on this machine finds it."""
    host, port = listening.getsockname()[:2]
    if host in ("0.0.0.0", "::"):  # noqa: S104 - compared, not bound
        host = "127.0.0.1"
    return f"http://[{host}]:{port}" if ":" in host else f"http://{host}:{port}"


class WebServer:
    """A context: inside it the application is served on the socket, from a thread of its own."""

    def __init__(self, application: ASGIApp, listening: socket.socket) -> None:
        self._socket = listening
        self._server = uvicorn.Server(
            uvicorn.Config(
                application,
                lifespan="off",
                log_config=None,
                access_log=False,
                server_header=False,
                date_header=False,
                proxy_headers=False,
                ws="websockets-sansio",
                # A message is 2 KB and the page is near: packing costs a sixth of the stream.
                ws_per_message_deflate=False,
                ws_max_size=4096,
                timeout_keep_alive=10,
                timeout_graceful_shutdown=_STOP_S,
                h11_max_incomplete_event_size=16 * 1024,
            )
        )
        self._up = threading.Event()
        self._thread = threading.Thread(target=self._run, name="web", daemon=True)

    def __enter__(self) -> Self:
        """Return when requests are answered; raises AutonomyError when that does not happen."""
        self._thread.start()
        for _ in range(int(_START_S / 0.01)):
            if self._server.started:
                return self
            self._up.wait(0.01)
        raise AutonomyError("the web server did not start")

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Close connections, end the thread."""
        self._server.should_exit = True
        self._thread.join(_STOP_S + 2.0)
        self._socket.close()

    def _run(self) -> None:
        self._server.run(sockets=[self._socket])
