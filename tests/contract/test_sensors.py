"""What every `hal.interfaces.RangeSensor` and `GnssReceiver` promises."""

from collections import defaultdict
from collections.abc import AsyncIterator

import pytest

from hal.config import six_beams
from hal.errors import ConnectionFailed
from hal.interfaces import GnssReceiver, RangeSensor
from hal.readings import RangeStatus
from tests.contract.rigs import ON_A_BUS, Rig, build, parameters


@pytest.fixture(params=parameters("spoken", "virtual", *ON_A_BUS))
async def rig(request: pytest.FixtureRequest) -> AsyncIterator[Rig]:
    """With range sensors."""
    async with build(request) as built:
        await built.vehicle.open(15.0)
        yield built


@pytest.fixture(params=parameters("spoken", "serial"))
async def receiving(request: pytest.FixtureRequest) -> AsyncIterator[Rig]:
    """With a receiver."""
    async with build(request) as built:
        await built.vehicle.open(15.0)
        yield built


def beams_of(rig: Rig) -> RangeSensor:
    assert rig.range_sensor is not None
    return rig.range_sensor


def gnss_of(rig: Rig) -> GnssReceiver:
    assert rig.gnss is not None
    return rig.gnss


async def test_every_beam_is_read_in_order_and_told_once(rig: Rig) -> None:
    sensor = beams_of(rig)
    await sensor.open(5.0)
    await rig.pass_time(1.0)
    readings = sensor.take()
    stamps: defaultdict[str, list[float]] = defaultdict(list)
    for reading in readings:
        stamps[reading.beam].append(reading.stamp_s)
        assert rig.clock.now_s() - reading.stamp_s < 2.5
        assert reading.stamp_s <= rig.clock.now_s()
        assert reading.variance_m2 > 0.0
        if reading.status is RangeStatus.VALID:
            assert reading.min_m < reading.range_m < reading.max_m
    assert set(stamps) == {mount.name for mount in six_beams()}
    for beam, times in stamps.items():
        assert times == sorted(set(times)), beam
        assert len(times) >= 10, beam
    assert len(sensor.take()) <= 12


async def test_a_silent_sensor_fails_to_open_and_opens_when_it_speaks(rig: Rig) -> None:
    sensor = beams_of(rig)
    rig.fall_silent()
    await rig.pass_time(0.3)
    with pytest.raises(ConnectionFailed, match="front"):
        await sensor.open(0.3)
    assert sensor.take() == ()
    rig.speak_again()
    await sensor.open(5.0)


async def test_a_closed_sensor_is_quiet_and_closes_again(rig: Rig) -> None:
    sensor = beams_of(rig)
    await sensor.open(5.0)
    await sensor.close()
    await sensor.close()
    await rig.pass_time(0.3)
    assert sensor.take() == ()


async def test_a_receiver_tells_a_fix_on_earth(receiving: Rig) -> None:
    receiver = gnss_of(receiving)
    assert receiver.fix() is None
    await receiver.open(5.0)
    first = receiver.fix()
    assert first is not None
    assert first.fix_type.has_position
    assert 47.0 < first.latitude_deg < 48.0
    assert first.stamp_s <= receiving.clock.now_s()
    await receiving.pass_time(1.0)
    later = receiver.fix()
    assert later is not None
    assert later.stamp_s > first.stamp_s
    await receiver.close()
    await receiver.close()


async def test_a_silent_receiver_fails_to_open(receiving: Rig) -> None:
    receiving.fall_silent()
    await receiving.pass_time(0.3)
    with pytest.raises(ConnectionFailed):
        await gnss_of(receiving).open(0.3)
