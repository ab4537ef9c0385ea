"""Talks to a running service, with the standard library alone: quick to import, quick to fail."""

import http.client
from collections.abc import Iterator
from typing import TYPE_CHECKING, TypeVar
from urllib.parse import urlsplit

import msgspec

from autonomy.errors import AutonomyError, BadInput, ExitCode
from autonomy.service.contract import MissionOrder, MissionRecord, Problem, State

if TYPE_CHECKING:
    from autonomy.service.follow import Frame

_TIMEOUT_S = 5.0
_FOLLOW_TIMEOUT_S = 15.0
"""Frames come ten times a second; a service that sends none for this long is gone."""

T = TypeVar("T")


class NoService(AutonomyError):
    """Nobody answers at the service's address."""

    exit_code = ExitCode.NO_VEHICLE


class Client:
    """One service. Every call raises NoService when it is not there, BadInput when it refuses."""

    def __init__(self, url: str, token: str | None = None) -> None:
        """`url` as http://host:port."""
        parts = urlsplit(url)
        try:
            port = parts.port
        except ValueError:
            port = None
        if parts.scheme != "http" or not parts.hostname or port is None:
            raise BadInput(f"{url} is not a service's address; write http://127.0.0.1:8042")
        self.url = url
        self._host, self._port = parts.hostname, port
        self._headers = {"Authorization": f"Bearer {token}"} if token else {}

    def state(self) -> State:
        """What is true now."""
        return self._ask("GET", "/v1/state", State)

    def create(self, order: MissionOrder) -> MissionRecord:
        """Hand over a mission."""
        return self._ask("POST", "/v1/missions", MissionRecord, msgspec.json.encode(order))

    def command(self, name: str) -> None:
        """Queue `stop`, `hold`, `resume` or `land`."""
        self._ask("POST", f"/v1/{name}", dict)

    def follow(self, mission_id: str) -> "Iterator[Frame]":
        """Frames of a mission until it is over; raises NoService when they break off before."""
        # A status needs none of what a flight's records are made of.
        from autonomy.service.follow import read_frames

        connection = http.client.HTTPConnection(self._host, self._port, timeout=_FOLLOW_TIMEOUT_S)
        over = False
        try:
            connection.request("GET", f"/v1/missions/{mission_id}/follow", headers=self._headers)
            response = connection.getresponse()
            if response.status != 200:
                raise BadInput(self._refusal(response.read(), response.status))
            for frame in read_frames(response.read):
                over = frame.record is not None
                yield frame
        except (OSError, http.client.HTTPException) as error:
            raise self._gone(error) from None
        finally:
            connection.close()
        if not over:
            raise NoService(f"the service at {self.url} ended before the mission did")

    def _ask(self, method: str, path: str, kind: type[T], body: bytes | None = None) -> T:
        connection = http.client.HTTPConnection(self._host, self._port, timeout=_TIMEOUT_S)
        headers = dict(self._headers)
        if body is not None:
            headers["Content-Type"] = "application/json"
        try:
            connection.request(method, path, body, headers)
            response = connection.getresponse()
            answer = response.read()
        except (OSError, http.client.HTTPException) as error:
            raise self._gone(error) from None
        finally:
            connection.close()
        if response.status >= 400:
            raise BadInput(self._refusal(answer, response.status))
        try:
            return msgspec.json.decode(answer, type=kind)
        except msgspec.DecodeError as error:
            raise BadInput(f"{self.url} does not answer like this service ({error})") from None

    def _refusal(self, answer: bytes, status: int) -> str:
        if status != 401:
            return _problem(answer, status)
        said = "does not take this token" if self._headers else "wants a token"
        return (
            f"the service at {self.url} {said}: set AUTONOMY_TOKEN to its token (an installed "
            "one's: sudo cat /etc/autonomy/token)"
        )

    def _gone(self, error: Exception) -> NoService:
        return NoService(
            f"no service answers at {self.url} ({error}); start it with: autonomy serve"
        )


def _problem(answer: bytes, status: int) -> str:
    try:
        return msgspec.json.decode(answer, type=Problem).error
    except msgspec.DecodeError:
        return f"the service answered {status}"
