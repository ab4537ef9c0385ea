"""One beam of a ring of sectors: nearest return, honest freedom, all of MAVLink's fields."""

import math

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from hal.config import BeamMount, BeamsConfig
from hal.errors import ReadingRefused
from hal.ranging.obstacle_distance import UNKNOWN_CM, ObstacleMessage
from hal.readings import RangeReading, RangeStatus

FREE = 101


def ring(
    distances: dict[int, int],
    *,
    step: float = 5.0,
    offset: float = 0.0,
    count: int = 72,
    background: int = UNKNOWN_CM,
) -> ObstacleMessage:
    """A ring with these sectors set."""
    told = tuple(distances.get(index, background) for index in range(count))
    return ObstacleMessage(0, told, 0, 2, 100, step, offset, 12)


def seen(
    message: ObstacleMessage, yaw_deg: float = 0.0, half_deg: float = 12.5, **mount: float
) -> RangeReading | None:
    beam = BeamMount(name="b", yaw_deg=yaw_deg, half_angle_deg=half_deg, **mount)
    return message.checked().reading(1.0, beam, BeamsConfig(mounts=(beam,)))


def status(message: ObstacleMessage, yaw_deg: float = 0.0) -> RangeStatus | None:
    reading = seen(message, yaw_deg)
    return None if reading is None else reading.status


def test_the_nearest_return_within_the_half_angle_counts() -> None:
    message = ring({0: 80, 2: 40, 3: 20, 70: 35, 69: 10})
    for half_deg, range_m in ((0.0, 0.8), (7.6, 0.35), (12.5, 0.35), (12.6, 0.1)):
        reading = seen(message, half_deg=half_deg)
        assert reading is not None
        assert reading.range_m == pytest.approx(range_m)


def test_a_return_beside_counts_more_than_freedom_ahead() -> None:
    reading = seen(ring({1: 60}, background=FREE))
    assert reading is not None
    assert (reading.status, reading.range_m) == (RangeStatus.VALID, 0.6)


def test_a_return_in_a_cone_that_is_known_in_part_frees_nothing() -> None:
    for known in ({0: FREE, 1: 60}, {1: 60}, {0: 60}):
        reading = seen(ring(known))
        assert reading is not None
        assert (reading.status, reading.range_m) == (RangeStatus.SUSPECT, 0.6)
    thin = seen(ring({0: 60}), half_deg=0.0)
    assert thin is not None
    assert thin.status is RangeStatus.VALID


def test_a_cone_is_free_only_where_each_of_its_sectors_is() -> None:
    assert status(ring({}, background=FREE)) is RangeStatus.OUT_OF_RANGE
    assert status(ring({0: 100}, background=FREE)) is RangeStatus.OUT_OF_RANGE
    for unknown in (0, 1, 2, 70):
        assert status(ring({unknown: UNKNOWN_CM}, background=FREE)) is None
    assert status(ring({4: UNKNOWN_CM}, background=FREE)) is RangeStatus.OUT_OF_RANGE
    thin = seen(ring({0: FREE}), half_deg=0.0)
    assert thin is not None
    assert thin.status is RangeStatus.OUT_OF_RANGE
    assert status(ring({1: FREE, 71: FREE})) is None
    assert status(ring({1: 100})) is None
    assert status(ring({})) is None


def test_zero_is_touching_and_more_than_the_maximum_is_nothing() -> None:
    assert status(ring({0: 0})) is RangeStatus.TOO_NEAR
    assert status(ring({0: 2})) is RangeStatus.TOO_NEAR
    assert status(ring({}, background=65534)) is RangeStatus.OUT_OF_RANGE


@pytest.mark.parametrize(
    ("step", "offset", "count", "index", "yaw_deg"),
    [
        (5.0, 0.0, 72, 18, 90.0),
        (5.0, -180.0, 72, 36, 0.0),
        (2.5, -30.0, 24, 12, 0.0),
        (10.0, 5.0, 36, 8, 85.0),
        (1.0, -36.0, 72, 36, 360.0),
        (90.0, 0.0, 4, 3, 270.0),
        (360.0, 0.0, 1, 0, 123.0),
    ],
)
def test_offset_and_increment_place_the_sectors(
    step: float, offset: float, count: int, index: int, yaw_deg: float
) -> None:
    message = ring({index: 50}, step=step, offset=offset, count=count)
    reading = seen(message, yaw_deg, half_deg=0.0)
    assert reading is not None
    assert reading.range_m == pytest.approx(0.5)
    if count > 2:
        assert seen(message, yaw_deg + 2.0 * step, half_deg=0.0) is None


def test_sectors_after_a_full_circle_do_not_count() -> None:
    message = ring({0: 80, 36: 20}, step=10.0)
    reading = seen(message)
    assert reading is not None
    assert reading.range_m == pytest.approx(0.8)


def test_whole_degrees_count_where_no_fraction_is_sent() -> None:
    message = ObstacleMessage(0, (UNKNOWN_CM, 50), 45, 2, 100, 0.0, 0.0, 12)
    assert seen(message, 45.0) is not None


def test_offset_of_the_beam_and_limits_count() -> None:
    reading = seen(ring({0: 50}), offset_m=0.03, sigma_m=0.1)
    assert reading is not None
    assert reading.range_m == pytest.approx(0.47)
    assert reading.variance_m2 == pytest.approx(0.01)
    assert reading.min_m == 0.02
    assert reading.max_m == pytest.approx(0.97)


@pytest.mark.parametrize(
    "changes",
    [
        {"frame": 0},
        {"frame": 8},
        {"distances": ()},
        {"distances": (50,) * 73},
        {"increment_f": -5.0},
        {"increment_f": 1e38},
        {"angle_offset": 1e38},
        {"min_distance": 100},
    ],
)
def test_a_ring_that_cannot_be_laid_around_the_body_is_refused(changes: dict[str, object]) -> None:
    fields: dict[str, object] = {
        "time_usec": 0,
        "distances": (50,) * 72,
        "increment": 5,
        "min_distance": 2,
        "max_distance": 100,
        "frame": 12,
    }
    ObstacleMessage(**fields).checked()  # type: ignore[arg-type]  # one dict for both
    with pytest.raises(ReadingRefused):
        ObstacleMessage(**fields | changes).checked()  # type: ignore[arg-type]  # the same


@settings(max_examples=60, deadline=None)
@example([100, UNKNOWN_CM], 240.0, 0.0, 0.0, 0.0)
@given(
    distances=st.lists(st.integers(0, 65535), min_size=1, max_size=72),
    step=st.floats(0.5, 360.0),
    offset=st.floats(-360.0, 360.0),
    yaw=st.floats(-720.0, 720.0),
    half=st.floats(0.0, 30.0),
)
def test_no_beam_reads_farther_than_any_return_ahead(
    distances: list[int], step: float, offset: float, yaw: float, half: float
) -> None:
    message = ObstacleMessage(0, tuple(distances), 0, 2, 100, step, offset, 12)
    reading = seen(message, yaw, half)
    off_deg = [
        abs(math.remainder(yaw - offset - index * step, 360.0))
        for index in range(min(len(distances), math.ceil(360.0 / step - 1e-6)))
    ]
    ahead = [
        cm
        for cm, off in zip(distances, off_deg, strict=False)
        if off < step / 2.0 - 1e-3 and cm != UNKNOWN_CM
    ]
    # Sectors may overlap where they do not fill the ring evenly: one that touches may be unknown.
    whole = not any(
        off < step / 2.0 + half + 1e-3 and cm == UNKNOWN_CM
        for cm, off in zip(distances, off_deg, strict=False)
    )
    if ahead and reading is None:
        assert not whole
        assert min(ahead) >= 100
    elif ahead and reading is not None:
        assert reading.range_m <= max(min(ahead) * 0.01, 0.02) + 1e-9
    if reading is not None and reading.status is RangeStatus.VALID:
        assert round(reading.range_m * 100.0) in distances
