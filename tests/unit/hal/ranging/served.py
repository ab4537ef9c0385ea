"""A bench of fake sensors served without a thread, in simulated time."""

from collections.abc import Callable

from hal.clock import SimClock
from hal.config import BeamsConfig
from hal.ranging.bus_server import BusServer, Station
from hal.ranging.i2c_range_sensor import I2cRangeSensor
from hal.readings import RangeReading
from tests.support.i2c_rig import Bench

_LEAST_S = 1e-4


class InlineWaiter:
    """Pauses move the clock."""

    def __init__(self, clock: SimClock) -> None:
        self._clock = clock

    def wait(self, seconds: float) -> bool:
        self._clock.advance(seconds)
        return False

    def pause(self, seconds: float) -> None:
        self._clock.advance(seconds)

    def stop(self) -> None:
        """Nothing waits."""


class Served:
    """What the driver wires up, stepped by the test."""

    def __init__(self, wire: Callable[[SimClock], Bench], beams: BeamsConfig | None = None) -> None:
        self.clock = SimClock(100.0)
        self.bench = wire(self.clock)
        config = beams or self.bench.config()
        (driver,) = config.drivers
        assert driver.driver == "i2c"
        self.sensor = I2cRangeSensor(
            driver,
            config,
            self.clock,
            open_bus=self.bench.open_bus,
            open_line=self.bench.open_line,
            new_waiter=lambda: InlineWaiter(self.clock),
        )
        self.server: BusServer = self.sensor.wire()
        self.readings: list[RangeReading] = []

    def run(self, seconds: float) -> list[RangeReading]:
        """The readings of the next `seconds`."""
        end_s = self.clock.now_s() + seconds
        new: list[RangeReading] = []
        while self.clock.now_s() < end_s:
            self.clock.advance(max(self.server.step(), _LEAST_S))
            new += self.sensor.take()
        self.readings += new
        return new

    def station(self, beam: str) -> Station:
        return {station.mount.name: station for station in self.sensor.stations}[beam]


def of(readings: list[RangeReading], beam: str) -> list[RangeReading]:
    return [reading for reading in readings if reading.beam == beam]
