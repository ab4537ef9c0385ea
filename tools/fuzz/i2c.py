"""I2C: a bus on which nobody obeys a data sheet; every byte that is read comes from the case."""

import math

import numpy as np

from hal.clock import SimClock
from hal.config import BeamsConfig, I2cDriver
from hal.ranging.i2c_bus import BusHeld, I2cError, NotAcknowledged
from hal.ranging.i2c_range_sensor import I2cRangeSensor
from hal.readings import RangeReading, RangeStatus
from tools.fuzz.cases import Tally, Target, pieces, require

_SENSORS = (
    {"chip": "vl53l0x", "beam": "front", "mux_address": 0x70, "mux_channel": 0},
    {"chip": "vl53l1x", "beam": "back", "mux_address": 0x70, "mux_channel": 1},
    {
        "chip": "vl53l0x",
        "beam": "left",
        "xshut": "gpiochip0/17",
        "address": 0x30,
        "mux_address": 0x70,
        "mux_channel": 2,
    },
    {"chip": "gp2y0a21", "beam": "right", "address": 0x48, "input": 0},
    {"chip": "gp2y0a02", "beam": "up", "address": 0x48, "input": 3},
)
_DRIVER = I2cDriver.model_validate({"driver": "i2c", "sensors": _SENSORS, "mux_reset": "sysfs/4"})
_BEAMS = BeamsConfig.model_validate(
    {"drivers": [_DRIVER.model_dump(), {"driver": "mavlink"}], "max_m": 1.3}
)
_STEPS = 4_000
_WORD_M = 65.536  # what two bytes of millimetres can say
_FAILS = 0xF8
"""Control bytes from here on are a failed transfer."""
_IDENTITIES = {0xC0: b"\xee\xaa\x10", 0x010F: b"\xea\xcc\x10"}
"""Registers that tell the model of the chips: told truly for most, or nothing would be tried."""


class HostileBus:
    """`hal.ranging.i2c_bus.I2cBus`: answers from a string of bytes, again and again."""

    def __init__(self, case: bytes) -> None:
        self._case = case or b"\0"
        self._at = 0

    def _next(self) -> int:
        self._at = (self._at + 1) % len(self._case)
        return self._case[self._at]

    def _transfer(self) -> None:
        control = self._next()
        if control >= _FAILS:
            raise (I2cError, NotAcknowledged, BusHeld)[control % 3]("the case says so")

    def write(self, _address: int, _data: bytes, /) -> None:
        """Swallowed, or failed."""
        self._transfer()

    def write_read(self, _address: int, data: bytes, count: int, /) -> bytes:
        """The next bytes."""
        self._transfer()
        told = bytes(self._next() for _ in range(count))
        known = _IDENTITIES.get(int.from_bytes(data, "big"))
        if known is not None and told[0] < 0xE0:
            return (known + told)[:count]
        return told

    def reopen(self) -> None:
        """Never helps."""

    def close(self) -> None:
        """Nothing to let go of."""


class _Line:
    def set(self, *, high: bool) -> None:
        """Connected to nothing."""

    def release(self) -> None:
        """Nothing to let go of."""


class _Waiter:
    """Time passes; nobody waits."""

    def __init__(self, clock: SimClock) -> None:
        self._clock = clock

    def wait(self, seconds: float) -> bool:
        """True when it should end: never."""
        self._clock.advance(seconds)
        return False

    def pause(self, seconds: float) -> None:
        """As `wait`."""
        self._clock.advance(seconds)

    def stop(self) -> None:
        """It ends by itself."""


def make(rng: np.random.Generator) -> bytes:
    """Noise, mostly of few values: ready bits have to come up for anything to go on."""
    size = int(rng.integers(1, 400))
    match int(rng.integers(4)):
        case 0:
            return rng.bytes(size)
        case 1:
            likely = rng.integers(0, 256, int(rng.integers(1, 5)))
            return bytes(int(rng.choice(likely)) for _ in range(size))
        case 2:
            return bytes(int(b) & 0x7F for b in rng.bytes(size))
        case _:
            values = (0x00, 0x01, 0x03, 0x07, 0x40, 0x55, 0x60, 0x7F, 0x80, 0xAA, 0xF0, 0xFF)
            return bytes(values[int(rng.integers(len(values)))] for _ in range(size))


def run(case: bytes) -> Tally:
    """Serve the bus for a few thousand steps; every reading has to be one."""
    clock = SimClock(1000.0)
    sensor = I2cRangeSensor(
        _DRIVER,
        _BEAMS,
        clock,
        open_bus=lambda _path: HostileBus(case),
        open_line=lambda _name: _Line(),
        new_waiter=lambda: _Waiter(clock),
    )
    server = sensor.wire()
    tally = Tally()
    for _ in range(_STEPS):
        pause_s = server.step()
        require(0.0 <= pause_s < math.inf, f"a pause of {pause_s} s")
        clock.advance(max(pause_s, 1e-4))
        for reading in sensor.take():
            _check(reading, clock.now_s())
            tally["read"] += 1
            tally[reading.status.value] += 1
    server.end()
    for (_, reason), count in sensor.dropped().items():
        tally[reason] += count
    return tally


def _check(reading: RangeReading, now_s: float) -> None:
    require(now_s - 1.0 < reading.stamp_s <= now_s, f"{reading} at {now_s}")
    believed = reading.status is not RangeStatus.SUSPECT
    limit_m = reading.max_m if believed else _WORD_M
    require(0.0 <= reading.range_m <= limit_m, f"{reading} is out of its limits")
    require(math.isfinite(reading.variance_m2), f"{reading} is not finite")


I2C = Target("i2c", make, run, pieces)
