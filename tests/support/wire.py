"""A tap on the UDP wire between a client and the mock PX4: what was really sent, and when."""

import math
import select
import socket
import struct
import threading
import time
from collections.abc import Collection
from types import TracebackType
from typing import NamedTuple, Self

SET_POSITION_TARGET_LOCAL_NED = 84
_MAVLINK2 = 0xFD
_HEADER_BYTES = 10
_DATAGRAM_BYTES = 4096
_TARGET = struct.Struct("<I11fHBBB")  # time, x y z vx vy vz afx afy afz yaw yaw_rate, mask, ids


class SentTarget(NamedTuple):
    """One SET_POSITION_TARGET_LOCAL_NED, with the monotonic time at which it passed."""

    at_s: float
    position_ned_m: tuple[float, float, float]
    velocity_ned_m_s: tuple[float, float, float]
    yaw_rad: float
    type_mask: int
    frame: int

    @property
    def speed_m_s(self) -> float:
        """The commanded velocity's length."""
        return math.hypot(*self.velocity_ned_m_s)


class Relay:
    """Passes datagrams on in both directions while it is entered, on a thread of its own.

    The vehicle sends to `port`; the client listens on `client_port`. What passes is shown to
    `from_vehicle` after, and to `from_client` before, it is sent on.
    """

    def __init__(self, port: int, client_port: int) -> None:
        self._vehicle_side = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._vehicle_side.bind(("127.0.0.1", port))
        self._client_side = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._client_side.bind(("127.0.0.1", 0))
        self._client = ("127.0.0.1", client_port)
        self._vehicle: tuple[str, int] | None = None
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, name="relay")

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._closing.set()
        self._thread.join()
        self._vehicle_side.close()
        self._client_side.close()

    def from_vehicle(self, data: bytes) -> None:
        """What the vehicle said, and the client was just sent."""

    def from_client(self, data: bytes) -> None:
        """What the client said, and the vehicle is about to be sent."""

    def say_to_client(self, data: bytes) -> None:
        """A datagram from the address that the vehicle is heard from."""
        self._client_side.sendto(data, self._client)

    def _run(self) -> None:
        sides = [self._vehicle_side, self._client_side]
        while not self._closing.is_set():
            readable, _, _ = select.select(sides, [], [], 0.05)
            if self._vehicle_side in readable:
                data, self._vehicle = self._vehicle_side.recvfrom(_DATAGRAM_BYTES)
                self.say_to_client(data)
                self.from_vehicle(data)
            if self._client_side in readable:
                try:
                    data, _ = self._client_side.recvfrom(_DATAGRAM_BYTES)
                except ConnectionRefusedError:
                    continue  # the client is not there yet, or not any more
                self.from_client(data)
                if self._vehicle is not None:
                    self._vehicle_side.sendto(data, self._vehicle)


class WireTap(Relay):
    """Keeps the setpoints among what passes.

    Frames of the client whose message ids are in `keep` are kept as they were.
    """

    def __init__(self, port: int, client_port: int, keep: Collection[int] = ()) -> None:
        super().__init__(port, client_port)
        self._keep = frozenset(keep)
        self.kept: list[bytes] = []
        self.targets: list[SentTarget] = []

    def from_client(self, data: bytes) -> None:
        """Keep what is wanted of it."""
        now_s = time.monotonic()
        while len(data) > _HEADER_BYTES and data[0] == _MAVLINK2:
            length = data[1]
            payload = data[_HEADER_BYTES : _HEADER_BYTES + length].ljust(_TARGET.size, b"\0")
            message_id = int.from_bytes(data[7:10], "little")
            if message_id in self._keep:
                self.kept.append(data[: _HEADER_BYTES + length + 2])
            if message_id == SET_POSITION_TARGET_LOCAL_NED:
                _, x, y, z, vx, vy, vz, _, _, _, yaw, _, mask, _, _, frame = _TARGET.unpack(
                    payload[: _TARGET.size]
                )
                self.targets.append(SentTarget(now_s, (x, y, z), (vx, vy, vz), yaw, mask, frame))
            data = data[_HEADER_BYTES + length + 2 :]
