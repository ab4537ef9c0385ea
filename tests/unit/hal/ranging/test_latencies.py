"""A vehicle with mixed drivers: each stamps what it measured with the time at which it was true."""

import asyncio
from statistics import mean

import pytest

from hal.config import BeamMount, BeamsConfig, I2cDriver, MavlinkDriver, six_beams
from hal.ranging.i2c_range_sensor import I2cRangeSensor
from hal.ranging.mavlink_beams import MavlinkBeams
from hal.ranging.ranger import Limits, Measured
from hal.readings import RangeReading, RangeStatus
from tests.support.fake_adc import FakeSharp
from tests.support.fake_tof import Target
from tests.support.i2c_rig import Bench
from tests.support.link import SpokenLink
from tests.support.lockstep import LockstepTime

NEARER_M_S = 0.8
UP_LATENCY_S = 0.05


def range_m(now_s: float) -> float:
    """Everything comes nearer at a steady speed: a wrong time is a wrong range."""
    return 0.9 - NEARER_M_S * (now_s - 100.0)


def mount(name: str, **changes: float) -> BeamMount:
    (found,) = (m for m in six_beams() if m.name == name)
    return found.model_copy(update=changes)


async def flown(up_latency_s: float) -> dict[str, list[RangeReading]]:
    """Half a second of a ToF, a Sharp and a MAVLink beam that look at the same thing."""
    time, link = LockstepTime(), SpokenLink()
    bench = Bench(time.clock)
    bench.add_behind_mux("front", "vl53l0x", 0)
    bench.add_behind_mux("left", "vl53l1x", 1)
    bench.add_sharp("right", 0)
    for tof in bench.tofs.values():
        tof.view = lambda now_s: Target(range_m(now_s))
    bench.adcs[0x48].inputs[0] = FakeSharp(range_m)
    (driver,) = bench.config().drivers
    assert isinstance(driver, I2cDriver)
    names = ("front", "left", "right")
    beams = BeamsConfig(
        mounts=(*(mount(name) for name in names), mount("up", latency_s=up_latency_s)),
        drivers=(driver, MavlinkDriver()),
    )
    wired = I2cRangeSensor(
        driver,
        beams,
        time.clock,
        open_bus=bench.open_bus,
        open_line=bench.open_line,
        new_waiter=time.new_waiter,
    )
    told = MavlinkBeams(link, beams.model_copy(update={"mounts": beams.over_mavlink()}))
    readings: list[RangeReading] = []

    def tick() -> None:
        time.advance(0.01)
        now_s = time.clock.now_s()
        cm = round(range_m(now_s - UP_LATENCY_S) * 100.0)
        fields = {"min_distance": 2, "max_distance": 100, "current_distance": cm, "id": 0}
        more = {"orientation": 24, "covariance": 1, "time_boot_ms": round(now_s * 1e3)}
        link.say("DISTANCE_SENSOR", now_s, **fields, **more)

    async def tick_on() -> None:
        while True:
            tick()
            await asyncio.sleep(0.001)

    async with asyncio.TaskGroup() as group:
        ticking = group.create_task(tick_on())
        await wired.open(5.0)
        await told.open(5.0)
        ticking.cancel()
    for _ in range(30):
        tick()
        readings += [r for sensor in (wired, told) for r in sensor.take()]
    await wired.close()
    return {name: [r for r in readings if r.beam == name] for name in (*names, "up")}


def error_m(readings: list[RangeReading]) -> float:
    """Mean of measured minus true at the stamp."""
    valid = [r for r in readings if r.status is RangeStatus.VALID]
    assert len(valid) > 5
    return mean(r.range_m - range_m(r.stamp_s) for r in valid)


async def test_every_driver_of_a_mixed_vehicle_stamps_when_the_range_was_true() -> None:
    readings = await flown(UP_LATENCY_S)
    for beam, own in readings.items():
        assert abs(error_m(own)) < 0.006, beam


async def test_a_wrong_latency_shows_in_its_own_beam_alone() -> None:
    readings = await flown(0.0)
    assert error_m(readings.pop("up")) == pytest.approx(NEARER_M_S * UP_LATENCY_S, abs=0.006)
    for beam, own in readings.items():
        assert abs(error_m(own)) < 0.006, beam


def test_the_latency_is_the_mounts_else_that_of_its_kind_of_driver() -> None:
    sensor = {"chip": "vl53l0x", "beam": "front"}
    beams = BeamsConfig.model_validate(
        {
            "mounts": [{"name": "front"}, {"name": "up"}, {"name": "left", "latency_s": 0.0}],
            "drivers": [{"driver": "i2c", "sensors": [sensor]}, {"driver": "mavlink"}],
            "latency_s": 0.03,
        }
    )
    told = {m.name: beams.latency_of(m) for m in beams.mounts}
    assert told == {"front": 0.0, "up": 0.03, "left": 0.0}
    room = BeamsConfig.model_validate({"drivers": [{"driver": "virtual", "scenario": "default"}]})
    assert {room.latency_of(m) for m in room.mounts} == {0.0}


def test_a_wired_beam_takes_off_what_its_mount_adds() -> None:
    measured = Measured(RangeStatus.VALID, 0.5, 1e-4, age_s=0.02)
    limits = Limits(0.02, 1.0)
    assert measured.reading(10.0, mount("front"), limits).stamp_s == pytest.approx(9.98)
    late = mount("front", latency_s=0.03)
    assert measured.reading(10.0, late, limits).stamp_s == pytest.approx(9.95)
