"""MAVLink to readings: honest statuses, one truth of several sources, nothing unbounded."""

import asyncio
import json
import math
from typing import Any

import pytest

from hal.config import BeamMount, BeamsConfig, MavlinkDriver
from hal.ranging.distance_sensor import DistanceMessage
from hal.ranging.mavlink_beams import MavlinkBeams
from hal.ranging.obstacle_distance import ObstacleMessage
from hal.ranging.orientations import orientation_of
from hal.readings import RangeReading, RangeStatus
from tests.support.link import SpokenLink

FRONT, RIGHT, BACK, LEFT, UP, DOWN, CUSTOM = 0, 2, 4, 6, 24, 25, 100
NO_LATENCY = BeamsConfig(latency_s=0.0)


def fields(cm: int, orientation: int = FRONT, **changes: object) -> dict[str, Any]:
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


def dropped(sensor: MavlinkBeams, reason: str, source: str = "DISTANCE_SENSOR") -> int:
    return sensor.dropped().get((source, reason), 0)


async def opened(
    link: SpokenLink, config: BeamsConfig | None = None, driver: MavlinkDriver | None = None
) -> MavlinkBeams:
    """A driver that has heard its first beam."""
    config = config or NO_LATENCY
    looks = orientation_of(config.mounts[-1])
    sensor = MavlinkBeams(link, config, driver)
    async with asyncio.TaskGroup() as group:
        group.create_task(sensor.open(1.0))
        await asyncio.sleep(0.0)
        link.say("DISTANCE_SENSOR", 0.0, **fields(50, looks))
    sensor.take()
    return sensor


async def reading(message: dict[str, Any], config: BeamsConfig | None = None) -> RangeReading:
    link = SpokenLink()
    sensor = await opened(link, config)
    link.say("DISTANCE_SENSOR", 2.0, **message)
    (only,) = sensor.take()
    return only


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
    link.say("DISTANCE_SENSOR", 1.0, **fields(50, 1))
    assert (sensor.take(), dropped(sensor, "no such direction")) == ((), 1)


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
    assert (sensor.take(), dropped(sensor, "unreadable")) == ((), 1)


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
    assert dropped(sensor, "echo") == 4


async def test_a_second_sensor_of_the_autopilot_in_one_direction_does_not_interleave() -> None:
    link = SpokenLink()
    sensor = await opened(link)
    for n in range(5):
        link.say("DISTANCE_SENSOR", 1.0 + 0.1 * n, **fields(50, DOWN, id=0))
        link.say("DISTANCE_SENSOR", 1.0 + 0.1 * n, **fields(70, DOWN, id=1))
    assert {round(r.range_m, 2) for r in sensor.take()} == {0.5}
    assert dropped(sensor, "overruled") == 5


async def test_another_source_takes_over_when_the_first_is_silent() -> None:
    link = SpokenLink()
    sensor = await opened(link)
    link.say("DISTANCE_SENSOR", 1.0, component_id=158, **fields(50))
    link.say("DISTANCE_SENSOR", 1.2, **fields(60))
    link.say("DISTANCE_SENSOR", 1.4, **fields(70))
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
    reading = message.reading(1.0, mount, config)
    assert reading.range_m == pytest.approx(0.47)
    assert reading.variance_m2 == pytest.approx(0.01)
    near = DistanceMessage(0, 2, 100, 4, 0, 0, 255).reading(1.0, mount, config)
    assert near.status is RangeStatus.TOO_NEAR


@pytest.mark.parametrize(
    ("offset_m", "cm", "status", "range_m"),
    [
        (0.05, 100, RangeStatus.OUT_OF_RANGE, 0.95),  # it looked no farther than that
        (0.05, 99, RangeStatus.VALID, 0.94),
        (-0.05, 10, RangeStatus.TOO_NEAR, 0.15),
        (-0.05, 11, RangeStatus.VALID, 0.16),
        (-0.05, 96, RangeStatus.OUT_OF_RANGE, 1.0),  # beams.max_m is of the true range
    ],
)
def test_the_messages_limits_are_of_what_was_read(
    offset_m: float, cm: int, status: RangeStatus, range_m: float
) -> None:
    mount = BeamMount(name="front", offset_m=offset_m)
    config = BeamsConfig(mounts=(mount,))
    single = DistanceMessage(0, 10, 100, cm, 0, 0, 255).reading(1.0, mount, config)
    ring = ObstacleMessage(0, (cm,) * 72, 5, 10, 100).reading(1.0, mount, config)
    assert ring is not None
    for reading in (single, ring):
        assert reading.status is status
        assert reading.range_m == pytest.approx(range_m)
        assert reading.min_m <= reading.range_m <= reading.max_m


async def test_a_stamp_is_the_senders_less_the_latency_of_the_beam() -> None:
    mounts = (BeamMount(name="front", latency_s=0.07), BeamMount(name="down", pitch_deg=-90.0))
    link = SpokenLink()
    sensor = await opened(link, BeamsConfig(mounts=mounts, latency_s=0.03))
    link.say("DISTANCE_SENSOR", 2.0, **fields(50, FRONT, time_boot_ms=1500))
    link.say("DISTANCE_SENSOR", 2.0, **fields(50, DOWN, time_boot_ms=1500))
    link.say("DISTANCE_SENSOR", 2.0, component_id=158, **fields(40, DOWN, time_boot_ms=7))
    assert [r.stamp_s for r in sensor.take()] == pytest.approx([1.43, 1.47, 1.97])


@pytest.mark.parametrize(
    ("quaternion", "beam"),
    [
        ((1.0, 0.0, 0.0, 0.0), "front"),
        ((math.cos(math.pi / 4), 0.0, 0.0, math.sin(math.pi / 4)), "right"),
        ((math.cos(math.pi / 4), 0.0, math.sin(math.pi / 4), 0.0), "up"),
        ((0.0, 1.0, 0.0, 0.0), "front"),
        ((-math.cos(math.radians(10)), 0.0, 0.0, -math.sin(math.radians(10))), "slanted"),
    ],
)
async def test_a_custom_orientation_is_told_by_its_quaternion(
    quaternion: tuple[float, ...], beam: str
) -> None:
    mounts = (BeamMount(name="slanted", yaw_deg=20.0), *NO_LATENCY.mounts)
    link = SpokenLink()
    sensor = await opened(link, BeamsConfig(mounts=mounts))
    link.say("DISTANCE_SENSOR", 2.0, **fields(40, CUSTOM, quaternion=quaternion))
    assert [r.beam for r in sensor.take()] == [beam]


@pytest.mark.parametrize(
    "quaternion", [[0.0] * 4, [None] * 4, [1.0], [], [1e38] * 4, [0.5, 0.0, 0.0, 0.0]]
)
async def test_a_custom_orientation_without_a_rotation_is_dropped(quaternion: list[float]) -> None:
    link = SpokenLink()
    sensor = await opened(link)
    link.say("DISTANCE_SENSOR", 2.0, **fields(40, CUSTOM, quaternion=quaternion))
    assert (sensor.take(), dropped(sensor, "unreadable")) == ((), 1)
    link.say("DISTANCE_SENSOR", 2.0, **fields(40, FRONT, quaternion=quaternion))
    assert len(sensor.take()) == 1


RING: dict[str, Any] = {
    "time_usec": 1_500_000,
    "sensor_type": 0,
    "distances": [30, 101, *[101] * 15, 65535, 80, *[65535] * 53],
    "increment": 5,
    "increment_f": 0.0,
    "angle_offset": 0.0,
    "min_distance": 2,
    "max_distance": 100,
    "frame": 12,
}


async def test_a_ring_of_obstacles_gives_every_horizontal_beam_its_reading() -> None:
    link = SpokenLink()
    sensor = await opened(link)
    link.say("OBSTACLE_DISTANCE", 2.0, **RING)
    seen = {r.beam: (r.status, round(r.range_m, 2)) for r in sensor.take()}
    assert seen == {"front": (RangeStatus.VALID, 0.3), "right": (RangeStatus.VALID, 0.8)}
    link.say("OBSTACLE_DISTANCE", 2.0, **RING | {"frame": 0})
    assert (sensor.take(), dropped(sensor, "unreadable", "OBSTACLE_DISTANCE")) == ((), 1)


async def test_a_ring_is_not_listened_to_where_it_is_not_wanted() -> None:
    link = SpokenLink()
    sensor = await opened(link, driver=MavlinkDriver(obstacle_distance=False))
    link.say("OBSTACLE_DISTANCE", 2.0, **RING)
    assert sensor.take() == ()
