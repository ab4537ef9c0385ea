"""DISTANCE_SENSOR to readings: honest statuses, one source per beam, nothing unbounded."""

import asyncio
import json
import math

import pytest

from hal.config import BeamMount, BeamsConfig
from hal.errors import ReadingRefused
from hal.ranging.distance_sensor import DistanceMessage, MavlinkDistanceSensor, orientation_of
from hal.readings import RangeReading, RangeStatus
from tests.support.link import SpokenLink

FRONT, RIGHT, BACK, LEFT, UP, DOWN = 0, 2, 4, 6, 24, 25


def fields(cm: int, orientation: int = FRONT, **changes: int) -> dict[str, int]:
    return {
        "time_boot_ms": 1000,
        "min_distance": 2,
        "max_distance": 100,
        "current_distance": cm,
        "id": 0,
        "orientation": orientation,
        "covariance": 255,
        "signal_quality": 0,
    } | changes


async def opened(link: SpokenLink, config: BeamsConfig | None = None) -> MavlinkDistanceSensor:
    """A driver that has heard its first beam."""
    sensor = MavlinkDistanceSensor(link, config or BeamsConfig())
    async with asyncio.TaskGroup() as group:
        group.create_task(sensor.open(1.0))
        await asyncio.sleep(0.0)
        link.say("DISTANCE_SENSOR", 0.0, **fields(50, DOWN))
    sensor.take()
    return sensor


async def reading(message: dict[str, int], config: BeamsConfig | None = None) -> RangeReading:
    link = SpokenLink()
    sensor = await opened(link, config)
    link.say("DISTANCE_SENSOR", 2.0, **message)
    (only,) = sensor.take()
    return only


@pytest.mark.parametrize(
    ("mount", "orientation"),
    [
        (BeamMount(name="a"), FRONT),
        (BeamMount(name="a", yaw_deg=90.0), RIGHT),
        (BeamMount(name="a", yaw_deg=-90.0), LEFT),
        (BeamMount(name="a", yaw_deg=180.0), BACK),
        (BeamMount(name="a", yaw_deg=352.0), FRONT),
        (BeamMount(name="a", yaw_deg=45.0), 1),
        (BeamMount(name="a", yaw_deg=12.0, pitch_deg=90.0), UP),
        (BeamMount(name="a", pitch_deg=-90.0), DOWN),
    ],
)
def test_mounts_have_mavlinks_orientations(mount: BeamMount, orientation: int) -> None:
    assert orientation_of(mount) == orientation


def test_a_direction_without_a_number_is_refused() -> None:
    with pytest.raises(ReadingRefused, match="multiple of 45"):
        orientation_of(BeamMount(name="slanted", yaw_deg=20.0))


def test_two_beams_in_one_direction_are_refused() -> None:
    mounts = (BeamMount(name="a"), BeamMount(name="b", yaw_deg=5.0))
    with pytest.raises(ReadingRefused, match="a and b"):
        MavlinkDistanceSensor(SpokenLink(), BeamsConfig(mounts=mounts))


@pytest.mark.parametrize(
    ("cm", "quality", "status", "range_m"),
    [
        (50, 0, RangeStatus.VALID, 0.5),
        (50, 100, RangeStatus.VALID, 0.5),
        (50, 1, RangeStatus.NO_SIGNAL, 0.0),
        (3, 0, RangeStatus.VALID, 0.03),
        (2, 0, RangeStatus.TOO_NEAR, 0.02),
        (0, 0, RangeStatus.TOO_NEAR, 0.02),
        (99, 0, RangeStatus.VALID, 0.99),
        (100, 0, RangeStatus.OUT_OF_RANGE, 1.0),
        (101, 100, RangeStatus.OUT_OF_RANGE, 1.0),
        (100, 1, RangeStatus.NO_SIGNAL, 0.0),
        (65532, 0, RangeStatus.NO_SIGNAL, 0.0),
        (65535, 100, RangeStatus.NO_SIGNAL, 0.0),
    ],
)
async def test_the_status_says_what_the_message_can_prove(
    cm: int, quality: int, status: RangeStatus, range_m: float
) -> None:
    seen = await reading(fields(cm, signal_quality=quality))
    assert (seen.beam, seen.status) == ("front", status)
    assert seen.range_m == pytest.approx(range_m)


@pytest.mark.parametrize(
    ("sensor_cm", "configured_m", "limits_m"),
    [((10, 80), (0.02, 1.0), (0.1, 0.8)), ((0, 10_000), (0.02, 1.0), (0.02, 1.0))],
)
async def test_the_narrower_limits_count(
    sensor_cm: tuple[int, int], configured_m: tuple[float, float], limits_m: tuple[float, float]
) -> None:
    seen = await reading(
        fields(90, min_distance=sensor_cm[0], max_distance=sensor_cm[1]),
        BeamsConfig(min_m=configured_m[0], max_m=configured_m[1]),
    )
    assert (seen.min_m, seen.max_m) == pytest.approx(limits_m)
    assert (seen.status is RangeStatus.OUT_OF_RANGE) == (limits_m[1] < 0.9)


async def test_a_sent_variance_counts_and_an_unknown_one_is_modelled() -> None:
    sent = await reading(fields(50, covariance=4))
    assert sent.variance_m2 == pytest.approx(4e-4 + 1e-4 / 12.0)
    for unknown in (0, 255):
        modelled = await reading(fields(50, covariance=unknown))
        assert math.sqrt(modelled.variance_m2) == pytest.approx(0.02, rel=0.02)


async def test_the_stamp_is_the_measurements_time() -> None:
    seen = await reading(fields(50, time_boot_ms=1500))
    assert seen.stamp_s == 1.5


async def test_an_unknown_direction_is_counted_and_dropped() -> None:
    link = SpokenLink()
    sensor = await opened(link)
    link.say("DISTANCE_SENSOR", 1.0, **fields(50, 12))
    assert (sensor.take(), sensor.unknown_orientations) == ((), 1)


@pytest.mark.parametrize(
    "text",
    [
        "{}",
        "nonsense",
        '{"current_distance": null}',
        json.dumps(fields(50, min_distance=90, max_distance=10)),
    ],
)
async def test_what_is_no_measurement_is_counted_and_dropped(text: str) -> None:
    link = SpokenLink()
    sensor = await opened(link)
    link.say_json("DISTANCE_SENSOR", 1.0, text)
    assert (sensor.take(), sensor.unreadable) == ((), 1)


async def test_the_autopilots_echo_of_a_companions_sensor_is_dropped() -> None:
    link = SpokenLink()
    sensor = await opened(link)
    for n in range(5):
        now_s = 1.0 + 0.1 * n
        link.say("DISTANCE_SENSOR", now_s, component_id=1, **fields(51, id=1))
        link.say("DISTANCE_SENSOR", now_s, component_id=158, **fields(50, id=7))
    ranges = [round(r.range_m, 2) for r in sensor.take()]
    # The first message came before its original was known.
    assert ranges == [0.51, 0.5, 0.5, 0.5, 0.5, 0.5]
    assert sensor.echoes == 4


async def test_a_second_sensor_of_the_autopilot_in_one_direction_does_not_interleave() -> None:
    link = SpokenLink()
    sensor = await opened(link)
    for n in range(5):
        link.say("DISTANCE_SENSOR", 1.0 + 0.1 * n, **fields(50, DOWN, id=0))
        link.say("DISTANCE_SENSOR", 1.0 + 0.1 * n, **fields(70, DOWN, id=1))
    assert {round(r.range_m, 2) for r in sensor.take()} == {0.5}
    assert sensor.echoes == 5


async def test_another_source_takes_over_when_the_first_is_silent() -> None:
    link = SpokenLink()
    sensor = await opened(link)
    link.say("DISTANCE_SENSOR", 1.0, component_id=158, **fields(50))
    link.say("DISTANCE_SENSOR", 1.9, **fields(60))
    link.say("DISTANCE_SENSOR", 2.1, **fields(70))
    assert [round(r.range_m, 2) for r in sensor.take()] == [0.5, 0.7]


async def test_a_reader_that_never_comes_costs_bounded_memory_and_loses_the_oldest() -> None:
    link = SpokenLink()
    sensor = await opened(link)
    for n in range(2000):
        link.say("DISTANCE_SENSOR", n * 0.01, **fields(50, time_boot_ms=n * 10))
    readings = sensor.take()
    assert len(readings) == 256
    assert readings[-1].stamp_s == pytest.approx(19.99)
    assert sensor.take() == ()


async def test_a_closed_sensor_takes_nothing() -> None:
    link = SpokenLink()
    sensor = await opened(link)
    await sensor.close()
    await sensor.close()
    link.say("DISTANCE_SENSOR", 1.0, **fields(50))
    assert sensor.take() == ()


def test_offset_and_noise_of_a_beam_are_taken_from_its_mount() -> None:
    mount = BeamMount(name="front", offset_m=0.03, sigma_m=0.1)
    config = BeamsConfig(mounts=(mount,))
    message = DistanceMessage(0, 2, 100, 50, 0, 0, 255)
    reading = message.reading(1.0, "front", config)
    assert reading.range_m == pytest.approx(0.47)
    assert reading.variance_m2 == pytest.approx(0.01)
    near = DistanceMessage(0, 2, 100, 4, 0, 0, 255).reading(1.0, "front", config)
    assert near.status is RangeStatus.TOO_NEAR
