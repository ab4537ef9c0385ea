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


class WireTap:
    """Passes datagrams on in both directions and keeps the setpoints among them.

    The vehicle sends to `port`; the client listens on `client_port`. Frames of the client whose
    message ids are in `keep` are kept as they were.
    """

    def __init__(self, port: int, client_port: int, keep: Collection[int] = ()) -> None:
        self._keep = frozenset(keep)
        self.kept: list[bytes] = []
        self._from_vehicle = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._from_vehicle.bind(("127.0.0.1", port))
        self._from_client = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._from_client.bind(("127.0.0.1", 0))
        self._client = ("127.0.0.1", client_port)
        self._vehicle: tuple[str, int] | None = None
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._run, name="wire tap")
        self.targets: list[SentTarget] = []

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
        self._from_vehicle.close()
        self._from_client.close()

    def _run(self) -> None:
        while not self._closing.is_set():
            readable, _, _ = select.select([self._from_vehicle, self._from_client], [], [], 0.05)
            if self._from_vehicle in readable:
                data, self._vehicle = self._from_vehicle.recvfrom(2048)
                self._from_client.sendto(data, self._client)
            if self._from_client in readable:
                try:
                    data, _ = self._from_client.recvfrom(2048)
                except ConnectionRefusedError:
                    continue  # the client is not there yet, or not any more
                self._note(data)
                if self._vehicle is not None:
                    self._from_vehicle.sendto(data, self._vehicle)

    def _note(self, data: bytes) -> None:
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
