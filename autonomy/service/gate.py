"""Before everything else: right host, right origin, right token, right size, not too often."""

import hmac
import time
from collections import OrderedDict
from collections.abc import Callable
from urllib.parse import urlsplit

import msgspec
from starlette.exceptions import HTTPException
from starlette.responses import Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from autonomy.service.contract import Problem

BODY_BYTES_MAX = 16 * 1024
REQUESTS_PER_S, REQUESTS_BURST = 50.0, 200
_ADDRESSES_MAX = 256
_LOOPBACK = frozenset({"localhost", "127.0.0.1", "[::1]"})
_CSP = b"content-security-policy"
_SECURITY = (
    (_CSP, b"default-src 'self'; frame-ancestors 'none'; base-uri 'none'"),
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"no-referrer"),
    (b"cache-control", b"no-store"),
)
_OPEN_PATHS = frozenset({"/", "/v1/health", "/v1/openapi.json"})
"""Answered without a token: they tell nothing of the room and move nothing."""
_ORDERS = frozenset({"/v1/stop", "/v1/hold", "/v1/resume", "/v1/land"})


class Access(msgspec.Struct, frozen=True):
    """Who may ask. `token` is None only where the service listens on loopback alone.

    `hosts` are names under which a browser may know the service; None: any (there is a token).
    """

    token: str | None
    hosts: frozenset[str] | None = _LOOPBACK

    def token_fits(self, given: str) -> bool:
        """Compares in constant time."""
        return self.token is None or hmac.compare_digest(given.encode(), self.token.encode())


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


class _Strangers:
    """A bucket for each address that asks without the token; the longest silent are forgotten."""

    def __init__(self) -> None:
        self._buckets: OrderedDict[str, Bucket] = OrderedDict()

    def of(self, address: str) -> Bucket:
        """The bucket of `address`, a full one when it is not known."""
        bucket = self._buckets.setdefault(address, Bucket(REQUESTS_PER_S, REQUESTS_BURST))
        self._buckets.move_to_end(address)
        if len(self._buckets) > _ADDRESSES_MAX:
            self._buckets.popitem(last=False)
        return bucket


class Gate:
    """Before everything else: right host, right origin, right token, right size.

    Who has the token is limited apart from those who have not, so that nobody else's flood keeps an
    operator out.
    """

    def __init__(
        self,
        application: ASGIApp,
        access: Access,
        clock_s: Callable[[], float] = time.monotonic,
    ) -> None:
        self._application = application
        self._access = access
        self._clock_s = clock_s
        self._bucket = Bucket(REQUESTS_PER_S, REQUESTS_BURST)
        self._strangers = _Strangers()

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
                await answered(Problem(refusal[1]), refusal[0])(scope, receive, _secured(send))
            return
        if scope["type"] == "websocket":
            await self._application(scope, receive, send)
            return
        await self._application(scope, _limited(receive), _secured(send))

    def _refusal(self, scope: Scope, headers: dict[str, str]) -> tuple[int, str] | None:
        """(status, sentence) for a request that must not pass."""
        refusal = self._foreign(scope, headers)
        if refusal is not None:
            return refusal
        known = self._access.token is None or self._access.token_fits(_token(headers))
        bucket = self._bucket if known else self._strangers.of((scope.get("client") or ("",))[0])
        if not (known and _is_stop(scope)) and not bucket.take(self._clock_s()):
            return 429, "too many requests at once; wait a second"
        if not known and scope["path"] not in _OPEN_PATHS and not scope["path"].startswith("/web/"):
            return 401, "a token is needed: Authorization: Bearer TOKEN"
        return self._body_refusal(scope, headers)

    def _foreign(self, scope: Scope, headers: dict[str, str]) -> tuple[int, str] | None:
        """The refusal of what another web page asks; it takes nothing from anybody's bucket."""
        host = headers.get("host", "")
        if self._access.hosts is not None and _name(host) not in self._access.hosts:
            # A name that somebody pointed at this machine is how web pages reach loopback.
            return 421, "this service does not answer under that name; use 127.0.0.1"
        origin = headers.get("origin")
        foreign = origin is not None and _authority(origin) != host.lower()
        if headers.get("sec-fetch-site") == "cross-site":
            # A link to the page may be followed from anywhere; it asks for nothing else.
            foreign |= scope["path"] != "/" or headers.get("sec-fetch-mode") != "navigate"
        return (403, "other web pages may not talk to this service") if foreign else None

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


def _is_stop(scope: Scope) -> bool:
    """Orders about a vehicle in the air pass however much else is asked."""
    path, method = scope["path"], scope.get("method")
    return (method == "POST" and path in _ORDERS) or (
        method == "DELETE" and path.startswith("/v1/missions/")
    )


def _authority(origin: str) -> str | None:
    """Name and port in an Origin header; None when it is no address."""
    try:
        return urlsplit(origin).netloc.lower()
    except ValueError:
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
            given = list(message.get("headers", ()))
            own = {name for name, _ in given}
            message["headers"] = [*given, *(each for each in _SECURITY if each[0] not in own)]
        await send(message)

    return secured


def answered(value: object, status: int = 200) -> Response:
    """`value` as JSON."""
    return Response(msgspec.json.encode(value), status, media_type="application/json")
