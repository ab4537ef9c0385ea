"""Six beams on a fake bus, wired in the ways that the configuration knows."""

from collections.abc import Callable
from typing import Any

from hal.clock import Clock
from hal.config import BeamsConfig, I2cDriver, six_beams
from hal.ranging.gpio import OutputLine
from hal.ranging.i2c_range_sensor import I2cRangeSensor
from tests.support.fake_adc import FakeAds1115, FakeSharp
from tests.support.fake_i2c import FakeBus, FakeLine, FakeMux
from tests.support.fake_tof import FakeVl53l0x, FakeVl53l1x, still
from tests.support.lockstep import LockstepTime

NAMES = tuple(mount.name for mount in six_beams())
Tof = FakeVl53l0x | FakeVl53l1x


class Bench:
    """A bus, what sits on it, and its configuration."""

    def __init__(self, clock: Clock) -> None:
        self.clock = clock
        self.bus = FakeBus()
        self.lines: dict[str, Callable[[bool], None]] = {}
        self.tofs: dict[str, Tof] = {}
        self.adcs: dict[int, FakeAds1115] = {}
        self.mux = FakeMux()
        self.mux_reset: str | None = None
        self.sensors: list[dict[str, Any]] = []

    def tof(self, beam: str, chip: str) -> Tof:
        make = FakeVl53l0x if chip == "vl53l0x" else FakeVl53l1x
        self.tofs[beam] = make(self.clock, still(0.5))
        return self.tofs[beam]

    def add_behind_mux(self, beam: str, chip: str, channel: int) -> None:
        if self.mux not in self.bus.devices:
            self.bus.devices.append(self.mux)
        self.mux.channels[channel].append(self.tof(beam, chip))
        self.sensors.append(
            {"chip": chip, "beam": beam, "mux_address": 0x70, "mux_channel": channel}
        )

    def add_with_xshut(self, beam: str, chip: str, number: int, channel: int | None = None) -> None:
        device = self.tof(beam, chip)
        (self.bus.devices if channel is None else self.mux.channels[channel]).append(device)
        name = f"gpiochip0/{number}"
        self.lines[name] = device.xshut
        sensor = {"chip": chip, "beam": beam, "xshut": name, "address": 0x30 + number}
        if channel is not None:
            sensor |= {"mux_address": 0x70, "mux_channel": channel}
        self.sensors.append(sensor)

    def add_sharp(self, beam: str, number: int) -> None:
        address = 0x48 + number // 4
        if address not in self.adcs:
            self.adcs[address] = FakeAds1115(self.clock, address)
            self.bus.devices.append(self.adcs[address])
        self.adcs[address].inputs[number % 4] = FakeSharp(lambda _now_s: 0.5)
        curve = {"kind": "power", "scale_m": 0.25, "offset_m": 0.009}
        self.sensors.append(
            {
                "chip": "gp2y0a21",
                "beam": beam,
                "address": address,
                "input": number % 4,
                "curve": curve,
            }
        )

    def open_bus(self, _path: str) -> FakeBus:
        self.bus.closed = False
        return self.bus

    def open_line(self, name: str) -> OutputLine:
        return FakeLine(self.lines[name])

    def config(self) -> BeamsConfig:
        driver = I2cDriver.model_validate(
            {"driver": "i2c", "sensors": self.sensors, "mux_reset": self.mux_reset}
        )
        mounts = tuple(m for m in six_beams() if m.name in {s["beam"] for s in self.sensors})
        return BeamsConfig(mounts=mounts, drivers=(driver,))

    def sensor(self, time: LockstepTime) -> I2cRangeSensor:
        beams = self.config()
        (driver,) = beams.drivers
        assert isinstance(driver, I2cDriver)
        return I2cRangeSensor(
            driver,
            beams,
            self.clock,
            open_bus=self.open_bus,
            open_line=self.open_line,
            new_waiter=time.new_waiter,
        )


def behind_a_multiplexer(clock: Clock) -> Bench:
    bench = Bench(clock)
    for number, beam in enumerate(NAMES):
        bench.add_behind_mux(beam, "vl53l0x", number)
    return bench


def with_xshut_lines(clock: Clock) -> Bench:
    bench = Bench(clock)
    for number, beam in enumerate(NAMES):
        bench.add_with_xshut(beam, "vl53l1x", number)
    return bench


def on_converters(clock: Clock) -> Bench:
    bench = Bench(clock)
    for number, beam in enumerate(NAMES):
        bench.add_sharp(beam, number)
    return bench


def mixed(clock: Clock) -> Bench:
    bench = Bench(clock)
    bench.add_behind_mux("front", "vl53l1x", 0)
    bench.add_behind_mux("back", "vl53l0x", 7)
    bench.add_with_xshut("right", "vl53l0x", 1, channel=3)
    bench.add_with_xshut("left", "vl53l1x", 2, channel=3)
    bench.add_sharp("up", 0)
    bench.add_sharp("down", 3)
    return bench
