"""A ground station, or anything else on the link, with pymavlink instead of MAVSDK."""

import math
import socket
import time
from collections.abc import Iterator
from typing import Any

from pymavlink.dialects.v20 import development as mavlink


class Station:
    """A UDP client with a pymavlink codec."""

    def __init__(
        self,
        port: int,
        to: tuple[str, int] | None = None,
        *,
        system: int = 245,
        component: int = 190,
    ) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind(("127.0.0.1", port))
        self._to = to
        self.codec = mavlink.MAVLink(None, srcSystem=system, srcComponent=component)
        self.codec.robust_parsing = True

    @property
    def port(self) -> int:
        """Where it listens."""
        port: int = self._socket.getsockname()[1]
        return port

    def __enter__(self) -> "Station":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        self._socket.close()

    def send(self, message: Any) -> None:
        assert self._to is not None, "nobody was heard yet"
        self._socket.sendto(message.pack(self.codec), self._to)
        self.codec.seq = (self.codec.seq + 1) % 256

    def send_raw(self, data: bytes) -> None:
        assert self._to is not None
        self._socket.sendto(data, self._to)

    def messages(self, seconds: float) -> Iterator[Any]:
        """Everything that arrives within `seconds`."""
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0.0:
            self._socket.settimeout(left)
            try:
                data, self._to = self._socket.recvfrom(2048)
            except TimeoutError:
                return
            yield from self.codec.parse_buffer(data) or []

    def wait(self, kind: str, seconds: float = 10.0, **fields: object) -> Any:
        """The next message of that kind with those fields."""
        for message in self.messages(seconds):
            if message.get_type() == kind and all(
                getattr(message, name) == value for name, value in fields.items()
            ):
                return message
        raise AssertionError(f"no {kind} {fields} within {seconds} s")

    def command(self, command: int, *parameters: float) -> int:
        padded = (*parameters, *(math.nan,) * (7 - len(parameters)))
        self.send(mavlink.MAVLink_command_long_message(1, 1, command, 0, *padded))
        return int(self.wait("COMMAND_ACK", command=command).result)

    def heartbeat(self, kind: int = mavlink.MAV_TYPE_GCS) -> None:
        self.send(mavlink.MAVLink_heartbeat_message(kind, 8, 0, 0, 0, 3))
