"""Others on the UDP wire between the mock PX4 and a client: noise, lies and echoes, from the very
address that the vehicle speaks from."""

import math
import threading
from collections import Counter, deque
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import development as mavlink

from tests.support.wire import Relay

_STALE_FRAMES = 400
"""A frame is said again after so many others: seconds later."""
_TIMED = ("ATTITUDE", "LOCAL_POSITION_NED", "ODOMETRY", "DISTANCE_SENSOR", "GPS_RAW_INT")
_NUMBERS = {
    "ATTITUDE": ("roll", "pitch", "yaw", "yawspeed"),
    "LOCAL_POSITION_NED": ("x", "y", "z", "vx", "vy", "vz"),
    "ODOMETRY": ("x", "y", "z", "vx", "vy", "vz"),
}
_ABSURD = (math.nan, math.inf, -math.inf, 1e38, -1e38)
_TIMES = {"time_boot_ms": (0, 2**32 - 1), "time_usec": (0, 2**63)}


class Heckler(Relay):
    """Between `begin` and `end` puts one of its own after each frame; `put_in` counts by kind."""

    KINDS = (
        *("noise", "torn", "wrong checksum", "another system", "another component"),
        *("said again", "absurd numbers", "absurd times"),
    )

    def __init__(self, port: int, client_port: int, seed: int = 0) -> None:
        super().__init__(port, client_port)
        self._rng = np.random.default_rng(seed)
        self._ear = mavlink.MAVLink(None)
        self._ear.robust_parsing = True
        self._heard: deque[bytes] = deque(maxlen=_STALE_FRAMES)
        self._loud = threading.Event()
        self.put_in: Counter[str] = Counter()

    def begin(self) -> None:
        """Be loud from now on."""
        self._loud.set()

    def end(self) -> None:
        """Only listen."""
        self._loud.clear()

    def from_vehicle(self, data: bytes) -> None:
        """Put something in after each of its frames."""
        for message in self._ear.parse_buffer(data) or ():
            if not isinstance(message, mavlink.MAVLink_unknown | mavlink.MAVLink_bad_data):
                self._heckle(message)

    def _heckle(self, message: Any) -> None:
        name, frame = message.get_type(), bytes(message.get_msgbuf())
        if name in _TIMED:
            self._heard.append(frame)
        if not self._loud.is_set():
            return
        kind = self.KINDS[int(self._rng.integers(len(self.KINDS)))]
        data = self._words(kind, name, message, frame)
        if data:
            self.put_in[kind] += 1
            self.say_to_client(data)

    def _words(self, kind: str, name: str, message: Any, frame: bytes) -> bytes:
        rng = self._rng
        match kind:
            case "noise":
                return rng.bytes(int(rng.integers(1, 300)))
            case "torn":
                return frame[: int(rng.integers(1, len(frame)))]
            case "wrong checksum":
                at = int(rng.integers(10, len(frame)))
                return frame[:at] + bytes((frame[at] ^ 0x55,)) + frame[at + 1 :]
            case "another system":
                return _spoken(message, int(rng.choice([2, 7, 250])), 1)
            case "another component" if name not in ("DISTANCE_SENSOR", "HEARTBEAT"):
                return _spoken(message, 1, int(rng.choice([2, 100, 158])))
            case "said again" if len(self._heard) == _STALE_FRAMES:
                return self._heard[0]
            case "absurd numbers" if name in _NUMBERS:
                keys = _NUMBERS[name]
                setattr(message, keys[int(rng.integers(len(keys)))], float(rng.choice(_ABSURD)))
                return _spoken(message, 1, 1)
            case "absurd times" if name in _NUMBERS:
                key = "time_usec" if name == "ODOMETRY" else "time_boot_ms"
                setattr(message, key, _TIMES[key][int(rng.integers(2))])
                return _spoken(message, 1, 1)
        return b""


def _spoken(message: Any, system: int, component: int) -> bytes:
    """The message as a frame of that sender, with a correct checksum."""
    mouth = mavlink.MAVLink(None, srcSystem=system, srcComponent=component)
    return bytes(message.pack(mouth))
