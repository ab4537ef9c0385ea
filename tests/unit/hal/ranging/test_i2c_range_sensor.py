"""The driver's shell: its thread, what opening says, and the configuration that wires it."""

from typing import Any

import pytest
from pydantic import ValidationError

from hal import registry
from hal.clock import MonotonicClock, SimClock
from hal.config import BeamMount, BeamsConfig, I2cDriver, six_beams
from hal.errors import ConnectionFailed
from hal.ranging.i2c_range_sensor import I2cRangeSensor
from hal.ranging.mavlink_beams import MavlinkBeams
from hal.ranging.ranger import Limits, Measured
from hal.ranging.waiter import ThreadWaiter
from hal.readings import RangeStatus
from tests.support import i2c_rig
from tests.support.fake_adc import FakeSharp
from tests.support.link import SpokenLink
from tests.support.lockstep import LockstepTime
from tests.unit.hal.ranging.served import Served

MUX = {"chip": "vl53l0x", "mux_address": 0x70}
LINE = {"chip": "vl53l0x", "xshut": "gpiochip0/4", "address": 0x30}


def beams(*sensors: dict[str, Any], mavlink: bool = True, **common: Any) -> BeamsConfig:
    drivers: list[dict[str, Any]] = [{"driver": "i2c", "sensors": sensors}]
    return BeamsConfig.model_validate(
        {"drivers": [*drivers, *([{"driver": "mavlink"}] if mavlink else [])], **common}
    )


def test_what_no_sensor_here_has_comes_over_mavlink() -> None:
    behind = {**LINE, "beam": "up", "mux_address": 0x70, "mux_channel": 1}
    config = beams({**MUX, "beam": "front", "mux_channel": 0}, behind)
    assert [m.name for m in config.over_mavlink()] == ["right", "back", "left", "down"]
    sensors = registry.range_sensors(config, SpokenLink(), MonotonicClock())
    assert [type(sensor) for sensor in sensors] == [I2cRangeSensor, MavlinkBeams]
    (only,) = registry.range_sensors(BeamsConfig(), SpokenLink(), MonotonicClock())
    assert isinstance(only, MavlinkBeams)


def test_when_all_beams_are_here_nobody_listens_to_the_link() -> None:
    names = [mount.name for mount in six_beams()]
    config = beams(*({**MUX, "beam": b, "mux_channel": n} for n, b in enumerate(names)))
    (only,) = registry.range_sensors(config, SpokenLink(), MonotonicClock())
    assert isinstance(only, I2cRangeSensor)


@pytest.mark.parametrize(
    ("sensors", "words"),
    [
        ([{"chip": "vl53l0x", "beam": "nose"}], "no mount called nose"),
        ([{"chip": "vl53l0x", "beam": "front", "address": 0x30}], "without xshut"),
        ([{"chip": "vl53l0x", "beam": "front", "mux_address": 0x70}], "belong together"),
        (
            [{"chip": "vl53l0x", "beam": "front"}, {"chip": "vl53l1x", "beam": "left"}],
            "front and left answer|left and front answer",
        ),
        (
            [
                {**MUX, "beam": "front", "mux_channel": 0},
                {**MUX, "beam": "left", "mux_channel": 0},
            ],
            "answer to the same address",
        ),
        (
            [{**LINE, "beam": "front"}, {"chip": "vl53l1x", "beam": "left"}],
            "answer to the same address",
        ),
        (
            [{**LINE, "beam": "front"}, {**MUX, "beam": "left", "mux_channel": 0}],
            "answer to the same address",
        ),
        ([{**LINE, "beam": "front"}, {**LINE, "beam": "left", "address": 0x31}], "same xshut line"),
        (
            [
                {**LINE, "beam": "front", "address": 0x70},
                {"chip": "gp2y0a21", "beam": "up", "mux_address": 0x70, "mux_channel": 1},
            ],
            "address of a multiplexer",
        ),
        ([{"chip": "gp2y0a21", "beam": b} for b in ("up", "down")], "answer to the same address"),
        ([{"chip": "vl53l1x", "beam": "up", "mode": "long", "budget_ms": 15}], "mode short only"),
        ([{"chip": "vl53l1x", "beam": "up", "roi_centre": 60}], "centred at 199"),
        ([{**LINE, "beam": "front", "xshut": "17"}], "pattern"),
        (
            [
                {**MUX, "beam": "front", "mux_channel": 0},
                {**MUX, "beam": "front", "mux_channel": 1},
            ],
            "has two sensors",
        ),
    ],
)
def test_a_wiring_that_cannot_work_is_refused(sensors: list[dict[str, Any]], words: str) -> None:
    with pytest.raises(ValidationError, match=words):
        beams(*sensors)


def test_wirings_that_work_are_taken() -> None:
    beams(
        {**MUX, "beam": "front", "mux_channel": 0},
        {**MUX, "beam": "left", "mux_channel": 1},
        {"chip": "gp2y0a21", "beam": "up", "input": 0},
        {"chip": "gp2y0a02", "beam": "down", "input": 1},
    )
    beams({**LINE, "beam": "front"}, {**LINE, "beam": "up", "xshut": "sysfs/5", "address": 0x31})


def test_beams_without_a_driver_are_refused() -> None:
    with pytest.raises(ValidationError, match="nobody reads back, down, left, right, up"):
        beams({**MUX, "beam": "front", "mux_channel": 0}, mavlink=False)


async def test_another_chip_ends_the_opening_early() -> None:
    time = LockstepTime()
    bench = i2c_rig.behind_a_multiplexer(time.clock)
    bench.tofs["left"].model = 0xBAD0
    bench.tofs["left"].reset()
    sensor = I2cRangeSensor(
        bench.config().drivers[0],  # type: ignore[arg-type]  # the bench has one driver, on I2C
        bench.config(),
        MonotonicClock(),
        open_bus=bench.open_bus,
        open_line=bench.open_line,
        new_waiter=lambda: Hasty(time.clock),
    )
    with pytest.raises(ConnectionFailed, match="beam left: the chip at 0x29 says bad0"):
        await sensor.open(60.0)
    assert bench.bus.closed
    assert sensor.take() == ()


class Hasty(ThreadWaiter):
    """Time runs as fast as the thread."""

    def __init__(self, clock: SimClock) -> None:
        super().__init__()
        self._clock = clock

    def wait(self, seconds: float) -> bool:
        self._clock.advance(max(seconds, 1e-3))
        return super().wait(0.0)


async def test_a_bus_that_cannot_be_opened_says_so_at_once() -> None:
    driver = I2cDriver.model_validate(
        {"driver": "i2c", "bus": "/dev/i2c-none", "sensors": [{"chip": "vl53l0x", "beam": "up"}]}
    )
    config = BeamsConfig(mounts=(BeamMount(name="up"),), drivers=(driver,))
    sensor = I2cRangeSensor(driver, config, MonotonicClock())
    with pytest.raises(ConnectionFailed, match="/dev/i2c-none does not exist"):
        await sensor.open(60.0)
    await sensor.close()


async def test_limits_that_have_nothing_in_common_are_told() -> None:
    time = LockstepTime()
    bench = i2c_rig.on_converters(time.clock)
    config = bench.config().model_copy(update={"max_m": 0.08})
    sensor = I2cRangeSensor(
        config.drivers[0],  # type: ignore[arg-type]  # the bench has one driver, on I2C
        config,
        time.clock,
        open_bus=bench.open_bus,
    )
    with pytest.raises(ConnectionFailed, match="nothing in common"):
        await sensor.open(60.0)
    assert bench.bus.closed


MEASURED = Measured(RangeStatus.VALID, 0.5, 1e-6, 0.02)
LIMITS = Limits(0.05, 1.0)


def test_offset_and_noise_of_a_beam_are_taken_from_its_mount() -> None:
    mount = BeamMount(name="up", offset_m=0.03, sigma_m=0.02)
    reading = MEASURED.reading(10.0, mount, LIMITS)
    assert reading.range_m == pytest.approx(0.47)
    assert reading.variance_m2 == pytest.approx(4e-4)
    assert reading.stamp_s == pytest.approx(9.98)


@pytest.mark.parametrize(
    ("offset_m", "status", "range_m"),
    [
        (0.45, RangeStatus.TOO_NEAR, 0.05),
        (0.60, RangeStatus.TOO_NEAR, 0.05),
        (-0.5, RangeStatus.OUT_OF_RANGE, 1.0),
        (-0.49, RangeStatus.VALID, 0.99),
    ],
)
def test_limits_hold_after_the_offset(offset_m: float, status: RangeStatus, range_m: float) -> None:
    reading = MEASURED.reading(10.0, BeamMount(name="up", offset_m=offset_m), LIMITS)
    assert reading.status is status
    assert reading.range_m == pytest.approx(range_m)


@pytest.mark.parametrize(
    ("offset_m", "target_m", "status", "range_m"),
    [
        (0.05, 0.81, RangeStatus.OUT_OF_RANGE, 0.75),
        (0.05, 0.79, RangeStatus.VALID, 0.74),
        (-0.05, 0.095, RangeStatus.TOO_NEAR, 0.15),
        (-0.05, 0.115, RangeStatus.VALID, 0.165),
    ],
)
def test_the_chips_limits_are_of_what_it_reads(
    offset_m: float, target_m: float, status: RangeStatus, range_m: float
) -> None:
    def wire(clock: SimClock) -> i2c_rig.Bench:
        bench = i2c_rig.Bench(clock)
        bench.add_sharp("up", 0)
        bench.adcs[0x48].inputs[0] = FakeSharp(lambda _now_s: target_m)
        return bench

    config = wire(SimClock(100.0)).config()
    mount = config.mounts[0].model_copy(update={"offset_m": offset_m})
    reading = Served(wire, config.model_copy(update={"mounts": (mount,)})).run(1.0)[-1]
    assert reading.status is status
    assert reading.range_m == pytest.approx(range_m, abs=0.005)
