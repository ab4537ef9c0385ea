"""A MAVLink link to a vehicle, timed by the vehicle's own clock.

Everything heard is stamped with the autopilot's boot time (from the last ATTITUDE or position
before it), and everything periodic that is sent is due by it: a machine that stalls shifts nothing,
and a vehicle that runs faster than real time is no different from one that does not.
"""

import contextlib
import select
import socket
import struct
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable, Iterator
from typing import Any

import serial
from pymavlink.dialects.v20 import development as mavlink

from hal.config import BeamsConfig
from hal.sim.mock_px4 import MockPx4
from hal.sim.mock_px4_messages import LAYOUTS, unpack
from hal.sim.mock_px4_plant import Plant
from hal.sim.scenario import Scenario

Message = Any  # pymavlink is untyped

_MAVLINK2 = 0xFD
_HEADER_BYTES, _CHECKSUM_BYTES, _SIGNATURE_BYTES = 10, 2, 13
_SIGNED = 1
_STAMPED = frozenset((30, 31, 32, 33))
"""Messages whose first field is time_boot_ms, sent often."""
_BULK = frozenset((*range(29, 37), 74, 83, 85, 87, 105, 141, 230, 241, 290, 291, 331, 441, 514))
"""Messages that no test reads one by one: counted, and the last one remembered."""

STATION = (245, 190)
_AUTOPILOT = 1
COMPANION = (1, 158)
_HEARTBEAT_TYPES = {STATION: mavlink.MAV_TYPE_GCS, COMPANION: mavlink.MAV_TYPE_ONBOARD_CONTROLLER}
_HEARTBEAT_S = 1.0
_WAIT_S, _SILENCE_S = 0.01, 30.0
_MEET_STEPS = 20_000  # a real vehicle may still be starting


class Heard:
    """One message of the vehicle, and the vehicle's time when it came; decoded when looked at."""

    __slots__ = ("_decode", "_message", "at_s", "frame", "message_id")

    def __init__(self, at_s: float, frame: bytes, decode: Callable[[bytes], Message]) -> None:
        self.at_s = at_s
        self.frame = frame
        self.message_id = _message_id(frame)
        self._decode = decode
        self._message: Message = None

    @property
    def message(self) -> Message:
        """As pymavlink, or as `hal.sim.mock_px4_messages.ExtraMessage`."""
        if self._message is None:
            self._message = self._decode(self.frame)
        return self._message


_NAMES = {number: kind.msgname for number, kind in mavlink.mavlink_map.items()}
_NAMES |= {number: layout.name for number, layout in LAYOUTS.items()}


def _message_id(frame: bytes) -> int:
    return int.from_bytes(frame[7:10], "little")


def message_name(message_id: int) -> str:
    """A message's name."""
    return str(_NAMES.get(message_id, f"UNKNOWN_{message_id}"))


class Frames:
    """Cuts a stream of bytes into MAVLink 2 frames; what is none is dropped."""

    def __init__(self) -> None:
        self._held = b""

    def cut(self, data: bytes) -> Iterator[bytes]:
        """The frames that are complete now."""
        held = self._held + data
        while True:
            start = held.find(_MAVLINK2)
            if start < 0:
                held = b""
                break
            held = held[start:]
            if len(held) < _HEADER_BYTES:
                break
            size = _HEADER_BYTES + held[1] + _CHECKSUM_BYTES
            size += _SIGNATURE_BYTES if held[2] & _SIGNED else 0
            if len(held) < size:
                break
            yield held[:size]
            held = held[size:]
        self._held = held


class Repeated:
    """Something sent again and again, by the vehicle's clock."""

    def __init__(self, send: Callable[[], None], period_s: float) -> None:
        self._send = send
        self._period_s = period_s
        self._due_s = -1.0

    def run(self, now_s: float) -> None:
        """Send it if it is due."""
        if now_s < self._due_s:
            return
        self._send()
        late = now_s - self._due_s > self._period_s
        self._due_s = now_s + self._period_s if late else self._due_s + self._period_s


class Link(ABC):
    """What every link can do; subclasses move bytes and let time pass."""

    def __init__(self) -> None:
        self.now_s = 0.0
        self.system = 0
        """The vehicle's system id, from its first heartbeat."""
        self.heard: list[Heard] = []
        self.counts = Counter[int]()
        self._last_frame: dict[int, bytes] = {}
        self._frames = Frames()
        self._codecs = {who: mavlink.MAVLink(None, *who) for who in (STATION, COMPANION)}
        self._repeated: dict[str, Repeated] = {}

    @abstractmethod
    def write(self, data: bytes) -> None:
        """Send bytes to the vehicle."""

    @abstractmethod
    def wait(self) -> bytes:
        """Let about 10 ms of the vehicle's time pass; what has arrived."""

    @abstractmethod
    def close(self) -> None:
        """Let go of the link."""

    # ------------------------------------------------------------ sending

    def send(self, message: Message, who: tuple[int, int] = STATION) -> None:
        """Send one message as `who` (system, component)."""
        codec = self._codecs[who]
        self.write(bytes(message.pack(codec)))
        codec.seq = (codec.seq + 1) % 256

    def repeat(self, name: str, send: Callable[[], None], period_s: float) -> None:
        """Call `send` every `period_s` seconds of the vehicle's time, beginning now."""
        self._repeated[name] = Repeated(send, period_s)
        self._repeated[name].run(self.now_s)

    def cease(self, name: str) -> bool:
        """No more of that; False when it was not repeated."""
        return self._repeated.pop(name, None) is not None

    def beat(self, who: tuple[int, int]) -> None:
        """Send heartbeats of `who` from now on."""
        heartbeat = mavlink.MAVLink_heartbeat_message(_HEARTBEAT_TYPES[who], 8, 0, 0, 0, 3)
        self.repeat(f"heartbeat {who}", lambda: self.send(heartbeat, who), _HEARTBEAT_S)

    def hush(self, who: tuple[int, int]) -> bool:
        """No more heartbeats of `who`; False when there were none."""
        return self.cease(f"heartbeat {who}")

    # ------------------------------------------------------------ hearing

    def meet(self) -> None:
        """Wait until the vehicle's clock and heartbeat are known."""
        for _ in range(_MEET_STEPS):
            if self.now_s > 0.0 and 0 in self._last_frame:
                self._codecs[COMPANION].srcSystem = self.system  # it is part of the vehicle
                return
            self.step()
        raise AssertionError("no HEARTBEAT, or nothing with the vehicle's time, was heard")

    def step(self) -> None:
        """Let a little time pass: hear, then send what is due."""
        for frame in self._frames.cut(self.wait()):
            self._take(frame)
        for repeated in list(self._repeated.values()):
            repeated.run(self.now_s)

    def run(self, seconds: float) -> None:
        """Let `seconds` of the vehicle's time pass."""
        end_s = self.now_s + seconds
        while self.now_s < end_s:
            self.step()

    def until(self, condition: Callable[[], object], limit_s: float, what: str) -> None:
        """Let time pass until `condition` holds; AssertionError after `limit_s`."""
        while self.now_s == 0.0:  # a vehicle that has been up for a while has a clock to tell first
            self.step()
        end_s = self.now_s + limit_s
        while not condition():
            assert self.now_s < end_s, f"{what}: not within {limit_s} s"
            self.step()

    def last(self, message_id: int) -> Message | None:
        """The newest message with that id, however often it comes."""
        frame = self._last_frame.get(message_id)
        return None if frame is None else self._decode(frame)

    def since(self, at_s: float, kind: str) -> list[Heard]:
        """Messages of a kind heard at or after `at_s`, oldest first."""
        found = []
        for heard in reversed(self.heard):
            if heard.at_s < at_s:
                break
            if message_name(heard.message_id) == kind:
                found.append(heard)
        return found[::-1]

    def _take(self, frame: bytes) -> None:
        message_id = _message_id(frame)
        if self.system == 0 and message_id == 0 and frame[6] == _AUTOPILOT:
            self.system = frame[5]
        if frame[5] != self.system:
            return
        self.counts[message_id] += 1
        self._last_frame[message_id] = frame
        if message_id in _STAMPED:
            (boot_ms,) = struct.unpack("<I", frame[10:14])
            self.now_s = max(self.now_s, boot_ms * 1e-3)
        if message_id not in _BULK:
            self.heard.append(Heard(self.now_s, frame, self._decode))

    def _decode(self, frame: bytes) -> Message:
        extra = unpack(frame)
        if extra is not None:
            return extra
        try:
            return self._codecs[STATION].decode(bytearray(frame))
        except mavlink.MAVError:
            return mavlink.MAVLink_bad_data(bytearray(frame), "damaged")


class MockLink(Link):
    """The mock PX4 on a loopback socket, its time driven from here: as fast as the machine goes.

    `plant` and `server` are open to tests that look behind the wire.
    """

    def __init__(self, scenario: Scenario, *, seed: int = 1, boot_s: float = 0.0) -> None:
        super().__init__()
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 20)
        self._socket.bind(("127.0.0.1", 0))
        self._socket.setblocking(False)
        self.plant = Plant(scenario, BeamsConfig(mounts=()), seed, boot_s=boot_s)
        self.server = MockPx4(self.plant, port=self._socket.getsockname()[1])

    def write(self, data: bytes) -> None:
        self._socket.sendto(data, self.server.address)
        self.server.receive()

    def wait(self) -> bytes:
        self.server.tick()
        arrived = []
        with contextlib.suppress(BlockingIOError):
            while True:
                arrived.append(self._socket.recv(2048))
        return b"".join(arrived)

    def close(self) -> None:
        self.server.close()
        self._socket.close()


class WireLink(Link):
    """A vehicle that somebody else started, in its own time.

    `udpin://host:port` listens and answers who is heard, `udpout://host:port` speaks first,
    `serial://device:baud` is a port of this machine.
    """

    def __init__(self, url: str) -> None:
        super().__init__()
        self._wire: _Udp | _Serial = _wire(url)
        self._unheard_waits = 0

    def write(self, data: bytes) -> None:
        self._wire.write(data)

    def wait(self) -> bytes:
        select.select([self._wire], [], [], _WAIT_S)
        data = self._wire.read()
        self._unheard_waits = 0 if data else self._unheard_waits + 1
        assert self._unheard_waits * _WAIT_S < _SILENCE_S, f"no byte for {_SILENCE_S} s"
        return data

    def close(self) -> None:
        self._wire.close()


class _Udp:
    def __init__(self, host: str, port: int, *, listen: bool) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 20)
        self._socket.setblocking(False)
        self._to: tuple[str, int] | None = None
        if listen:
            self._socket.bind((host, port))
        else:
            self._to = (host, port)

    def fileno(self) -> int:
        return self._socket.fileno()

    def write(self, data: bytes) -> None:
        if self._to is not None:
            with contextlib.suppress(ConnectionError, BlockingIOError):
                self._socket.sendto(data, self._to)

    def read(self) -> bytes:
        arrived = []
        with contextlib.suppress(BlockingIOError, ConnectionError):
            while True:
                data, self._to = self._socket.recvfrom(2048)
                arrived.append(data)
        return b"".join(arrived)

    def close(self) -> None:
        self._socket.close()


class _Serial:
    def __init__(self, device: str, baud: int) -> None:
        self._port = serial.Serial(device, baud, timeout=0)

    def fileno(self) -> int:
        number: int = self._port.fileno()
        return number

    def write(self, data: bytes) -> None:
        self._port.write(data)

    def read(self) -> bytes:
        data: bytes = self._port.read(4096)
        return data

    def close(self) -> None:
        self._port.close()


def _wire(url: str) -> _Udp | _Serial:
    scheme, _, rest = url.partition("://")
    place, _, number = rest.rpartition(":")
    if scheme == "serial":
        return _Serial(place, int(number))
    if scheme not in ("udpin", "udpout"):
        raise ValueError(f"{url}: expected udpin://, udpout:// or serial://")
    return _Udp(place, int(number), listen=scheme == "udpin")
