"""The parts of the tangent search, one by one, with numbers worked out by hand."""

import heapq
import math

import numpy as np
import pytest

from autonomy.t3drm import kernels
from autonomy.t3drm.kernels import TAU, Floats
from autonomy.t3drm.spherical import Discs

NO_PLANES = np.empty((0, 3))
RIGHT_ANGLE = 0.5 * math.pi


def circles(*rows: tuple[float, float, float]) -> Floats:
    return np.array(rows, dtype=np.float64).reshape(-1, 3)


def segment(an: float, ae: float, bn: float, be: float) -> Floats:
    return np.array((an, ae, bn, be))


# ---------------------------------------------------------------- distances


@pytest.mark.parametrize(
    ("place", "ends", "expected"),
    [
        ((3.0, 4.0), (0.0, 0.0, 10.0, 0.0), 16.0),
        ((3.0, -4.0), (10.0, 0.0, 0.0, 0.0), 16.0),
        ((-3.0, 4.0), (0.0, 0.0, 10.0, 0.0), 25.0),
        ((13.0, 4.0), (0.0, 0.0, 10.0, 0.0), 25.0),
        ((0.0, 2.0), (0.0, 0.0, 10.0, 0.0), 4.0),
        ((10.0, 2.0), (0.0, 0.0, 10.0, 0.0), 4.0),
        ((4.0, 3.0), (1.0, 1.0, 1.0, 1.0), 13.0),
        # Away from the line through (1, 2) along (3, 4): 2 to its side.
        ((1.0 + 3.0 + 1.6, 2.0 + 4.0 - 1.2), (1.0, 2.0, 7.0, 10.0), 4.0),
        # Just beyond and just before its beginning; a short one.
        ((0.05, 4.0), (0.0, 0.0, 10.0, 0.0), 16.0),
        ((-0.05, 4.0), (0.0, 0.0, 10.0, 0.0), 16.0025),
        ((0.2, 0.3), (0.0, 0.0, 0.5, 0.0), 0.09),
        ((0.9, 0.3), (0.0, 0.0, 0.5, 0.0), 0.25),
        # Beyond its far end by 5.
        ((10.0, 14.0), (1.0, 2.0, 7.0, 10.0), 25.0),
    ],
)
def test_the_distance_to_a_segment_is_that_to_its_nearest_place(
    place: tuple[float, float], ends: tuple[float, float, float, float], expected: float
) -> None:
    assert kernels.segment_distance2(*place, *ends) == pytest.approx(expected)


# ---------------------------------------------------------------- tangents


@pytest.mark.parametrize(
    ("first", "second", "length", "direction"),
    [
        # Equal circles, same sense: parallel to the line of the centres.
        ((0.0, 0.0, 1.0), (10.0, 0.0, 1.0), 10.0, (1.0, 0.0)),
        ((0.0, 0.0, -1.0), (0.0, 5.0, -1.0), 5.0, (0.0, 1.0)),
        # Crossed, radii 1 and 2, centres 5 apart: length 4, 3-4-5 turned to either side.
        ((0.0, 0.0, 1.0), (5.0, 0.0, -2.0), 4.0, (0.8, 0.6)),
        ((0.0, 0.0, -1.0), (5.0, 0.0, 2.0), 4.0, (0.8, -0.6)),
        # Outer, radii 5 and 2, centres 5 apart.
        ((1.0, 1.0, 5.0), (1.0, 6.0, 2.0), 4.0, (-0.6, 0.8)),
        ((1.0, 1.0, 2.0), (1.0, 6.0, 5.0), 4.0, (0.6, 0.8)),
        # From a point, to a point.
        ((0.0, 0.0, 0.0), (5.0, 0.0, 3.0), 4.0, (0.8, -0.6)),
        ((0.0, 0.0, 3.0), (5.0, 0.0, 0.0), 4.0, (0.8, 0.6)),
        ((2.0, 3.0, 0.0), (5.0, 7.0, 0.0), 5.0, (0.6, 0.8)),
    ],
)
def test_the_tangent_of_two_oriented_circles(
    first: tuple[float, float, float],
    second: tuple[float, float, float],
    length: float,
    direction: tuple[float, float],
) -> None:
    exists, found, north, east = kernels.tangent(*first, *second)
    assert exists
    assert found == pytest.approx(length)
    assert (north, east) == pytest.approx(direction)


@pytest.mark.parametrize(
    ("first", "second"),
    [
        ((0.0, 0.0, 3.0), (1.0, 0.0, 1.0)),  # one inside the other
        ((0.0, 0.0, 3.0), (5.0, 0.0, -3.0)),  # they overlap: no crossed one
        ((0.0, 0.0, 0.0), (1.0, 0.0, 2.0)),  # the point is inside
        ((1.0, 1.0, 1.0), (1.0, 1.0, 1.0)),  # the same circle
        ((1.0, 1.0, 0.0), (1.0, 1.0, 0.0)),
        ((0.0, 0.0, 1.0), (2.0 - 2e-7, 0.0, -1.0)),
        ((0.0, 0.0, 0.0), (3.0 - 2e-7, 0.0, 3.0)),
    ],
)
def test_circles_without_a_tangent(
    first: tuple[float, float, float], second: tuple[float, float, float]
) -> None:
    assert kernels.tangent(*first, *second) == (False, 0.0, 0.0, 0.0)


@pytest.mark.parametrize("overlap_m", [0.0, 5e-8])
@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_touching_circles_are_changed_over_on_a_tangent_of_no_length(
    sense: float, overlap_m: float
) -> None:
    found = kernels.tangent(0.0, 0.0, sense, 2.0 - overlap_m, 0.0, -sense)
    # Across the line of the centres, at the touching point.
    assert found == pytest.approx((True, 0.0, 0.0, sense))
    onto = kernels.tangent(0.0, 0.0, 0.0, 3.0 - overlap_m, 0.0, 3.0 * sense)
    assert onto == pytest.approx((True, 0.0, 0.0, -sense))


def test_circles_half_a_metre_wide_touch_too_and_a_tenth_of_a_micrometre_is_rounding() -> None:
    assert kernels.tangent(0.0, 0.0, 0.5, 1.0, 0.0, -0.5) == pytest.approx((True, 0.0, 0.0, 1.0))
    # 0.5 and 0.3 m apart by 1 m: 0.6 long; equal ones: 0.7.
    assert kernels.tangent(0.0, 0.0, 0.5, 1.0, 0.0, -0.3)[1] == pytest.approx(0.6)
    assert kernels.tangent(0.0, 0.0, 0.5, 0.7, 0.0, 0.5)[1] == pytest.approx(0.7)
    # As far as 1e-7 m inside, exactly.
    assert kernels.tangent(0.0, 0.0, 0.0, 1e-7, 0.0, 2e-7)[0]
    assert not kernels.tangent(0.0, 0.0, 0.0, 1e-7, 0.0, 2.01e-7)[0]


def test_directions_a_tenth_of_a_microradian_apart_are_two() -> None:
    assert kernels.ahead(1.0, 0.0, TAU - 1e-7) == TAU - 1e-7
    assert kernels.ahead(1.0, 0.0, TAU - 0.99e-7) == 0.0


@pytest.mark.parametrize(
    ("sense", "from_deg", "to_deg", "expected_deg"),
    [
        (1.0, 10.0, 40.0, 30.0),
        (-1.0, 10.0, 40.0, 330.0),
        (1.0, 40.0, 10.0, 330.0),
        (-1.0, 40.0, 10.0, 30.0),
        (1.0, 170.0, -170.0, 20.0),
        (1.0, -350.0, 350.0, 340.0),
        (1.0, 350.0, -350.0, 20.0),
        (1.0, 20.0, 20.0, 0.0),
        (1.0, 0.0, 360.0, 0.0),
        (1.0, 0.0, 720.0, 0.0),
        (-1.0, 0.0, 360.0, 0.0),
        (1.0, 0.0, -1e-6, 0.0),
        (1.0, 0.0, -1e-5, 360.0 - 1e-5),
        (1.0, 0.0, 180.0, 180.0),
    ],
)
def test_the_angle_ahead_in_a_sense(
    sense: float, from_deg: float, to_deg: float, expected_deg: float
) -> None:
    found = kernels.ahead(sense, math.radians(from_deg), math.radians(to_deg))
    assert found == pytest.approx(math.radians(expected_deg), abs=1e-12)
    assert 0.0 <= found < TAU


@pytest.mark.parametrize(
    ("ends", "crosses"),
    [
        ((1.0, -1.0, 1.0, 1.0), True),
        ((3.0, 2.0, 1.0, -2.0), True),
        ((2.0, -1.0, 1.0, 3.0), True),
        ((5.0, -1.0, 5.0, 1.0), False),  # beyond its end
        ((-1.0, -1.0, -1.0, 1.0), False),  # before its beginning
        ((1.0, 1.0, 3.0, 2.0), False),  # on one side
        ((1.0, -1.0, 3.0, -2.0), False),  # on the other
        ((0.0, 1.0, 4.0, 1.0), False),  # parallel
        ((0.5, 0.0, 3.0, 0.0), False),  # along it
        ((1.0, 0.0, 1.0, 2.0), False),  # begins on it
        ((1.0, 2.0, 1.0, 0.0), False),  # ends on it
        ((4.0, -1.0, 4.0, 1.0), False),  # through its end
        ((0.0, -1.0, 0.0, 1.0), False),  # through its beginning
        # Short ones: on one side and towards it, across it, beside its end on either side.
        ((1.0, 0.1, 1.05, 0.2), False),
        ((1.0, -0.1, 1.05, 0.1), True),
        ((4.05, -0.2, 4.05, 0.2), False),
        ((3.95, -0.2, 3.95, 0.2), True),
    ],
)
@pytest.mark.parametrize("turned_deg", [0.0, 90.0])
def test_segments_cross_when_each_has_its_ends_on_both_sides_of_the_other(
    ends: tuple[float, float, float, float], turned_deg: float, *, crosses: bool
) -> None:
    first = np.array((0.0, 0.0, 4.0, 0.0)) if turned_deg == 0.0 else np.array((0.0, 0.0, 0.0, 4.0))
    second = ends if turned_deg == 0.0 else (-ends[1], ends[0], -ends[3], ends[2])
    moved = first + np.array((7.0, -3.0, 7.0, -3.0))
    placed = (second[0] + 7.0, second[1] - 3.0, second[2] + 7.0, second[3] - 3.0)
    assert kernels._crosses(moved, *placed) is crosses
    back = moved[[2, 3, 0, 1]].copy()
    assert kernels._crosses(back, *placed) is crosses


# ---------------------------------------------------------------- what bars a tangent


@pytest.mark.parametrize(
    ("east", "free"),
    [
        (1.0, True),
        (1.0 - 5e-8, True),
        (1.0 - 1e-7, True),
        (1.0 - 1.1e-7, False),
        (1.0 - 3e-7, False),
        (0.0, False),
    ],
)
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_tangent_may_graze_a_circle_but_not_cut_it(
    east: float, sign: float, *, free: bool
) -> None:
    around = circles((0, 0, 0), (9, 0, 0), (4.0, sign * east, 1.0))
    way = segment(0.0, 0.0, 9.0, 0.0)
    assert kernels._edge_is_free(0, 1, way, around, NO_PLANES, 2) is free
    # Its own two circles do not bar it, nor do those that were checked before.
    assert kernels._edge_is_free(0, 2, way, around, NO_PLANES, 2)
    assert kernels._edge_is_free(2, 1, way, around, NO_PLANES, 2)
    assert kernels._edge_is_free(0, 1, way, around, NO_PLANES, 3)


def test_every_circle_is_looked_at() -> None:
    far = (4.0, 5.0, 1.0)
    aside = circles((0, 5, 0), (9, 5, 0), (4.0, 5.5, 1.0))
    assert not kernels._edge_is_free(0, 1, segment(0, 5, 9, 5), aside, NO_PLANES, 2)
    assert kernels._edge_is_free(0, 1, segment(0, 0, 9, 0), aside, NO_PLANES, 2)
    for rows in ([far, (4.0, 0.0, 1.0)], [(4.0, 0.0, 1.0), far]):
        around = circles((0, 0, 0), (9, 0, 0), *rows)
        assert not kernels._edge_is_free(0, 1, segment(0, 0, 9, 0), around, NO_PLANES, 2)


@pytest.mark.parametrize(
    ("ends", "free"),
    [
        ((0.0, 0.0, 9.0, 2.0), True),
        ((0.0, 0.0, 9.0, 2.0 + 5e-8), True),
        ((0.0, 0.0, 9.0, 2.0 + 1e-7), True),
        ((0.0, 0.0, 9.0, 2.0 + 1.1e-7), False),
        ((0.0, 0.0, 9.0, 2.0 + 3e-7), False),
        ((0.0, 2.5, 9.0, 0.0), False),
        ((0.0, -1.5, 9.0, 0.0), False),
        ((9.0, 0.0, 0.0, -1.5), False),
    ],
)
def test_a_tangent_stays_in_the_fence_with_both_its_ends(
    ends: tuple[float, float, float, float], *, free: bool
) -> None:
    # -1 <= east <= 2, as a n + b e >= c.
    planes = np.array(((0.0, 1.0, -1.0), (0.0, -1.0, -2.0)))
    around = circles((0, 0, 0), (9, 0, 0))
    assert kernels._edge_is_free(0, 1, segment(*ends), around, planes, 2) is free


def test_a_slanted_fence_counts_north_and_east() -> None:
    planes = np.array(((0.6, 0.8, 1.0),))
    around = circles((0, 0, 0), (9, 0, 0))
    assert kernels._edge_is_free(0, 1, segment(3, -1, -1, 2), around, planes, 2)
    assert not kernels._edge_is_free(0, 1, segment(3, -1, -1, 1.9), around, planes, 2)
    assert not kernels._edge_is_free(0, 1, segment(2.9, -1, -1, 2), around, planes, 2)


@pytest.mark.parametrize(
    ("away_m", "overlap"),
    [(0.9, False), (1.0, False), (1.1, True), (2.9, True), (3.0, False), (3.1, False)],
)
@pytest.mark.parametrize("direction", [(1.0, 0.0), (0.0, -1.0), (-0.6, 0.8)])
def test_circles_overlap_when_their_rims_cross(
    away_m: float, direction: tuple[float, float], *, overlap: bool
) -> None:
    both = circles((7, 8, 2), (7 + away_m * direction[0], 8 + away_m * direction[1], 1))
    assert kernels._overlap(both, 0, 1, 1e-7) is overlap
    assert kernels._overlap(both, 1, 0, 1e-7) is overlap


def test_circles_within_the_tolerance_of_touching_do_not_overlap() -> None:
    for away_m, tolerance_m, overlap in (
        (1.0, 0.0, False),
        (3.0, 0.0, False),
        (1.5, 0.5, False),
        (2.5, 0.5, False),
        (1.6, 0.5, True),
        (2.4, 0.5, True),
    ):
        both = circles((0, 0, 2), (away_m, 0, 1))
        assert kernels._overlap(both, 0, 1, tolerance_m) is overlap


def test_slanted_segments_cross_where_they_do() -> None:
    for towards, crosses in (((3.0, 0.0), False), ((0.0, 3.0), True), ((1.0, 2.5), True)):
        # From (2, 1.5), just beside the middle of (0, 0) to (4, 3.2).
        assert kernels._crosses(segment(0, 0, 4, 3.2), 2.0, 1.5, *towards) is crosses


def barred(around: Floats, planes: Floats = NO_PLANES) -> list[list[float]]:
    bars, counts = kernels._barred_bearings(around, planes)
    return [
        sorted(math.degrees(b) % 360.0 for b in row[:count])
        for row, count in zip(bars.tolist(), counts.tolist(), strict=True)
    ]


def test_an_overlapping_disc_bars_the_bearing_of_its_centre() -> None:
    # 2 overlaps 3 to its east and 4 to its south; 3 and 4 are apart. Start and goal bar nothing.
    around = circles((0, 0.5, 1), (0, 0, 1), (0, 0, 1), (0, 1.5, 1), (-1.5, 0, 1))
    expected: list[list[float]] = [[], [], [90.0, 180.0], [270.0], [0.0]]
    found = barred(around)
    assert [len(row) for row in found] == [0, 0, 2, 1, 1]
    for row, bearings in zip(found, expected, strict=True):
        assert row == pytest.approx(bearings)


@pytest.mark.parametrize("shift", [(3.0, -7.0, 0.0), (-20.0, 4.0, 0.0)])
def test_bars_do_not_depend_on_where_the_discs_stand(shift: tuple[float, float, float]) -> None:
    around = circles((0, 9, 0), (9, 0, 0), (0, 0, 1), (0.3, 1.5, 1), (-1.5, 0.4, 1), (1, 1, 1))
    near = np.array(((0.6, 0.8, -0.5), (-1.0, 0.0, -1.5), (0.0, 1.0, -1.2)))
    moved = near.copy()
    moved[:, 2] += near[:, 0] * shift[0] + near[:, 1] * shift[1]
    here, there = barred(around, near), barred(around + np.array(shift), moved)
    assert sum(map(len, here)) > 10
    for a, b in zip(here, there, strict=True):
        assert a == pytest.approx(b)
    # More sides than discs.
    assert len(barred(around[:3], np.repeat(near[:1], 5, axis=0))[2]) == 5


@pytest.mark.parametrize(
    ("side", "bearing_deg"),
    [
        ((0.0, -1.0, -1.5), 90.0),
        ((0.0, 1.0, -1.5), 270.0),
        ((-1.0, 0.0, -1.5), 0.0),
        ((0.6, 0.8, -1.5), math.degrees(math.atan2(-0.8, -0.6)) % 360.0),
    ],
)
def test_a_fence_that_cuts_a_disc_bars_the_bearing_of_its_outward_normal(
    side: tuple[float, float, float], bearing_deg: float
) -> None:
    assert barred(circles((0, 0, 0), (1, 0, 0), (0, 0, 2.0)), np.array((side,)))[2] == (
        pytest.approx([bearing_deg])
    )
    # A disc that just touches the fence, or is clear of it, may be rounded.
    for radius in (1.5, 1.0, 1.5 + 5e-8, 1.5 + 1e-7):
        assert barred(circles((0, 0, 0), (1, 0, 0), (0, 0, radius)), np.array((side,)))[2] == []
    assert barred(circles((0, 0, 0), (1, 0, 0), (0, 0, 1.5 + 3e-7)), np.array((side,)))[2] != []


def test_the_distance_to_a_fence_is_measured_from_the_discs_centre() -> None:
    planes = np.array(((0.6, 0.8, 1.0),))
    clear = circles((0, 0, 0), (1, 0, 0), (3.0, 2.0, 2.4))  # 1.8 + 1.6 - 1 = 2.4
    assert barred(clear, planes)[2] == []
    assert len(barred(circles((0, 0, 0), (1, 0, 0), (3.0, 2.0, 2.5)), planes)[2]) == 1


def test_an_arc_reaches_to_the_first_barred_bearing_ahead() -> None:
    bars = np.radians(np.array(((90.0, 200.0, 10.0), (0.0, 0.0, 0.0))))
    counts = np.array((2, 0))
    for sense, from_deg, expected_deg in (
        (1.0, 80.0, 10.0),
        (-1.0, 80.0, 240.0),
        (1.0, 100.0, 100.0),
        (-1.0, 100.0, 10.0),
        (1.0, 90.0, 0.0),
    ):
        found = kernels._reach(bars, counts, 0, sense, math.radians(from_deg))
        assert found == pytest.approx(math.radians(expected_deg))
    assert kernels._reach(bars, counts, 1, 1.0, 0.0) == TAU


# ---------------------------------------------------------------- queue


def test_the_queue_gives_back_what_a_heap_gives_back() -> None:
    rng = np.random.default_rng(7)
    queue = (np.empty(4), np.empty(4, dtype=np.int64), 0)
    expected: list[tuple[float, int]] = []
    for step in range(300):
        if step < 100 or (step % 3 == 0 and step < 200):
            key = float(rng.integers(0, 1000)) + step * 1e-6
            queue = kernels._push(*queue, key, step)
            heapq.heappush(expected, (key, step))
        elif expected:
            keys, items, size = queue
            assert (keys[0], items[0]) == heapq.heappop(expected)
            kernels._sift_down(keys, items, size - 1)
            queue = (keys, items, size - 1)
        assert queue[2] == len(expected)
    assert queue[0].shape[0] == 128


@pytest.mark.parametrize("keys", [(3.0, 1.0, 2.0), (1.0, 2.0, 3.0), (2.0, 2.0, 2.0)])
def test_every_node_of_the_queue_is_at_least_its_parent(keys: tuple[float, ...]) -> None:
    queue = (np.empty(8), np.empty(8, dtype=np.int64), 0)
    for item, key in enumerate(keys):
        queue = kernels._push(*queue, key, item)
    held = queue[0][:3]
    assert held[0] == min(keys)
    assert sorted(held.tolist()) == sorted(keys)
    # Equal keys stay where they are.
    if keys == (2.0, 2.0, 2.0):
        assert queue[1][:3].tolist() == [0, 1, 2]
        kernels._sift_down(queue[0], queue[1], 2)
        assert queue[1][:2].tolist() == [2, 1]


def test_of_equal_children_the_left_one_moves_up() -> None:
    keys, items = np.array((1.0, 2.0, 2.0, 3.0)), np.array((0, 1, 2, 3))
    kernels._sift_down(keys, items, 3)
    assert keys[:3].tolist() == [2.0, 3.0, 2.0]
    assert items[:3].tolist() == [1, 3, 2]


# ---------------------------------------------------------------- laying, remembering


LENGTH, DEPART, AN, AE, BN, BE = range(6)


@pytest.mark.parametrize(
    ("o1", "o2", "touches"),
    [
        # Radii 1 and 2, centres 5 apart; o = 2 * circle + (against north to east).
        (4, 6, (0.2, -math.sqrt(24) / 5, 5.4, -2 * math.sqrt(24) / 5)),
        (5, 7, (-0.2, math.sqrt(24) / 5, 4.6, 2 * math.sqrt(24) / 5)),
        (4, 7, (0.6, -0.8, 3.8, 1.6)),
        (5, 6, (0.6, 0.8, 3.8, -1.6)),
    ],
)
def test_a_tangent_touches_both_circles_in_their_senses(
    o1: int, o2: int, touches: tuple[float, float, float, float]
) -> None:
    around = circles((9, 9, 0), (-9, -9, 0), (0, 0, 1), (5, 0, 2))
    row = np.full(9, np.nan)
    assert kernels._lay_tangent(around, o1, o2, row)
    an, ae, bn, be = row[AN], row[AE], row[BN], row[BE]
    assert math.hypot(an, ae) == pytest.approx(1.0)
    assert math.hypot(bn - 5.0, be) == pytest.approx(2.0)
    if (o1 ^ o2) & 1:
        assert (an, ae, bn, be) == pytest.approx(touches)
        assert row[LENGTH] == pytest.approx(4.0)
    else:
        assert row[LENGTH] == pytest.approx(math.sqrt(24.0))
    assert math.dist((an, ae), (bn, be)) == pytest.approx(row[LENGTH])
    # Where it departs from the first circle, and arrives at the second, in that circle's terms.
    assert row[DEPART] == pytest.approx(math.atan2(ae, an))
    assert kernels._arrival(around, 3, row) == pytest.approx(math.atan2(be, bn - 5.0))
    # It leaves along the circle's own sense.
    sense = -1.0 if o1 & 1 else 1.0
    along = (sense * -ae * (bn - an) + sense * an * (be - ae)) / row[LENGTH]
    assert along == pytest.approx(1.0)


@pytest.mark.parametrize(("o1", "o2"), [(4, 6), (5, 7), (4, 7), (5, 6), (0, 4), (0, 7), (6, 2)])
def test_a_tangent_is_laid_wherever_the_circles_stand(o1: int, o2: int) -> None:
    shift = np.array((3.0, -7.0, 0.0))
    around = circles((-4, 2, 0), (9, 3, 0), (0, 0, 1), (5, 1, 2))
    here, there = np.zeros(9), np.zeros(9)
    assert kernels._lay_tangent(around, o1, o2, here)
    assert kernels._lay_tangent(around + shift, o1, o2, there)
    assert there[[AN, BN]] == pytest.approx(here[[AN, BN]] + 3.0)
    assert there[[AE, BE]] == pytest.approx(here[[AE, BE]] - 7.0)
    assert there[[LENGTH, DEPART]] == pytest.approx(here[[LENGTH, DEPART]])
    for i in (o1 >> 1, o2 >> 1):
        arrival = kernels._arrival(around, i, here)
        assert kernels._arrival(around + shift, i, there) == pytest.approx(arrival)


def test_where_there_is_no_tangent_none_is_laid() -> None:
    around = circles((9, 9, 0), (-9, -9, 0), (0, 0, 3), (1, 0, 1))
    assert not kernels._lay_tangent(around, 4, 6, np.zeros(9))


def test_an_arrival_behind_a_cheaper_one_on_the_same_way_round_is_dominated() -> None:
    arrivals = np.zeros((8, 8, 3))
    counts = np.zeros(8, dtype=np.int64)
    # Circle 2 (radius 2), sense north to east: at 0 for 10 m, free for 2 rad.
    kernels._remember(arrivals, counts, 4, 0.0, 10.0, 2.0)
    assert counts.tolist() == [0, 0, 0, 0, 1, 0, 0, 0]
    for at_rad, cost, dominated in (
        (1.0, 12.0, True),
        (1.0, 12.1, True),
        (1.0, 11.9, False),
        (2.0, 14.0, True),
        (2.1, 99.0, False),
        (0.0, 10.0, True),
        (0.0, 9.9, False),
        (-1.0, 99.0, False),
    ):
        assert kernels._dominated(arrivals, counts, 4, 2.0, at_rad, cost) is dominated
    assert not kernels._dominated(arrivals, counts, 5, 2.0, 1.0, 99.0)


def test_an_arrival_as_cheap_as_rounding_tells_is_dominated() -> None:
    arrivals = np.zeros((6, 8, 3))
    counts = np.zeros(6, dtype=np.int64)
    kernels._remember(arrivals, counts, 4, 0.0, 1e-12, 1.0)
    assert kernels._dominated(arrivals, counts, 4, 1.0, 0.0, 0.0)
    kernels._remember(arrivals, counts, 5, 0.0, 1.1e-12, 1.0)
    assert not kernels._dominated(arrivals, counts, 5, 1.0, 0.0, 0.0)


def test_in_the_other_sense_what_is_ahead_lies_on_the_other_side() -> None:
    arrivals = np.zeros((6, 8, 3))
    counts = np.zeros(6, dtype=np.int64)
    kernels._remember(arrivals, counts, 5, 0.5, 1.0, 3.0)
    assert kernels._dominated(arrivals, counts, 5, 1.0, -0.5, 2.0)
    assert not kernels._dominated(arrivals, counts, 5, 1.0, 1.5, 2.0)


def test_the_oldest_of_more_arrivals_than_there_is_room_for_is_forgotten() -> None:
    arrivals = np.zeros((6, 8, 3))
    counts = np.zeros(6, dtype=np.int64)
    for k in range(9):
        kernels._remember(arrivals, counts, 4, 0.1 * k, float(k), 0.01)
    assert counts[4] == 9
    assert arrivals[4, 0].tolist() == [0.8, 8.0, 0.01]
    assert not kernels._dominated(arrivals, counts, 4, 1.0, 0.0, 99.0)
    for k in range(1, 9):
        assert kernels._dominated(arrivals, counts, 4, 1.0, 0.1 * k, 99.0)


# ---------------------------------------------------------------- what cuts a route


def straight(an: float, ae: float, bn: float, be: float) -> Floats:
    return np.array((an, ae, bn, be, -1.0, 0.0))


def test_how_deep_a_straight_piece_cuts_a_disc() -> None:
    centres, radii = np.array(((4.0, 1.5), (-3.0, 4.0))), np.array((2.0, 1.0))
    row = straight(0.0, 0.0, 9.0, 0.0)
    assert kernels._depth(row, centres, radii, 0) == pytest.approx(0.5)
    assert kernels._depth(row, centres, radii, 1) == pytest.approx(-4.0)
    moved = kernels._depth(
        straight(3.0, -7.0, 12.0, -7.0), centres + np.array((3.0, -7.0)), radii, 0
    )
    assert moved == pytest.approx(0.5)
    upwards = kernels._depth(straight(3.0, -7.0, 3.0, 2.0), np.array(((1.0, 9.0),)), radii, 0)
    assert upwards == pytest.approx(2.0 - math.hypot(2.0, 7.0))


@pytest.mark.parametrize("sweep_deg", [40.0, -40.0])
def test_a_short_arc_of_the_first_disc_is_an_arc(sweep_deg: float) -> None:
    # Its middle is 2 from the disc's centre, its chord's middle is not; a disc of 0.1 beyond it.
    sweep = math.radians(sweep_deg)
    centres, radii = np.array(((0.0, 0.0), (2.05, 0.0))), np.array((2.0, 0.1))
    ends = [(2.0 * math.cos(0.5 * s), 2.0 * math.sin(0.5 * s)) for s in (-sweep, sweep)]
    row = np.array((*ends[0], *ends[1], 0.0, sweep))
    assert kernels._depth(row, centres, radii, 1) == pytest.approx(0.05)
    low_n, high_n, _, _ = kernels._box_of(row, radii, 0.0)
    bulge = 2.0 - 2.0 * math.cos(0.5 * abs(sweep))
    assert (low_n, high_n) == pytest.approx((2.0 - 2.0 * bulge, 2.0))


@pytest.mark.parametrize(
    ("place", "depth"),
    [
        # Quarter of a circle of radius 3 around (10, 20), from north to east; discs of radius 1.
        ((10.0 + 2.4, 20.0 + 3.2), 0.0),  # 4 from the centre, between the ends
        ((10.0 + 2.1, 20.0 + 2.8), 0.5),  # outside by 0.5
        ((10.0 + 1.5, 20.0 + 2.0), 0.5),  # inside by 0.5
        ((10.0, 20.0), -2.0),
        ((10.0 + 3.0, 20.0 - 4.0), -3.0),  # before its beginning: 4 from it
        ((10.0 - 4.0, 20.0 + 6.0), -4.0),  # beyond its end: 5 from it
        ((13.0, 20.0), 1.0),
        ((10.0, 23.0), 1.0),
        ((13.0, 19.5), 0.5),
        ((9.5, 23.0), 0.5),
        ((7.0, 20.0), 1.0 - math.hypot(3.0, 3.0)),
    ],
)
@pytest.mark.parametrize("backwards", [False, True])
def test_how_deep_an_arc_cuts_a_disc(
    place: tuple[float, float], depth: float, *, backwards: bool
) -> None:
    centres, radii = np.array(((0.0, 0.0), (10.0, 20.0), place)), np.array((9.0, 3.0, 1.0))
    row = np.array((13.0, 20.0, 10.0, 23.0, 1.0, RIGHT_ANGLE))
    if backwards:
        row = np.array((10.0, 23.0, 13.0, 20.0, 1.0, -RIGHT_ANGLE))
    assert kernels._depth(row, centres, radii, 2) == pytest.approx(depth)


@pytest.mark.parametrize("sweep_deg", [-350.0, -170.0, -20.0, 1.0, 90.0, 181.0, 300.0, 359.0])
@pytest.mark.parametrize("begin_deg", [0.0, 100.0, 230.0])
def test_the_box_of_an_arc_holds_all_of_it(begin_deg: float, sweep_deg: float) -> None:
    radii = np.array((9.0, 3.0))
    begin, sweep = math.radians(begin_deg), math.radians(sweep_deg)
    turns = begin + sweep * np.linspace(0.0, 1.0, 40)
    north, east = 10.0 + 3.0 * np.cos(turns), 20.0 + 3.0 * np.sin(turns)
    row = np.array((north[0], east[0], north[-1], east[-1], 1.0, sweep))
    low_n, high_n, low_e, high_e = kernels._box_of(row, radii, 0.25)
    assert low_n + 0.25 <= north.min() + 1e-9
    assert high_n - 0.25 >= north.max() - 1e-9
    assert low_e + 0.25 <= east.min() + 1e-9
    assert high_e - 0.25 >= east.max() - 1e-9


def test_the_box_of_a_straight_piece_is_its_own() -> None:
    box = kernels._box_of(straight(5.0, -2.0, 1.0, 7.0), np.array((9.0,)), 0.5)
    assert box.tolist() == [0.5, 5.5, -2.5, 7.5]
    for way, expected in (
        ((1.0, 7.0, 5.0, -2.0), [0.5, 5.5, -2.5, 7.5]),
        ((-9.0, 3.0, -8.0, 4.0), [-9.5, -7.5, 2.5, 4.5]),
        ((3.0, 20.0, 2.0, 10.0), [1.5, 3.5, 9.5, 20.5]),
        ((3.0, 10.0, 2.0, 20.0), [1.5, 3.5, 9.5, 20.5]),
        ((3.0, -20.0, 2.0, -10.0), [1.5, 3.5, -20.5, -9.5]),
    ):
        assert kernels._box_of(straight(*way), np.array((9.0,)), 0.5).tolist() == expected


def test_the_box_of_an_arc_is_wider_than_its_chord_by_its_sagitta() -> None:
    # 120 degrees of radius 2: the sagitta is 2 (1 - cos 60) = 1; over 360: both radii.
    chord = (0.0, math.sqrt(3.0))
    row = np.array((1.0, -chord[1], 1.0, chord[1], 0.0, math.radians(120.0)))
    box = kernels._box_of(row, np.array((2.0,)), 0.0)
    assert box.tolist() == pytest.approx([0.0, 2.0, -chord[1] - 1.0, chord[1] + 1.0])
    row[5] = -math.radians(500.0)
    assert kernels._box_of(row, np.array((2.0,)), 0.0)[:2] == pytest.approx((-3.0, 5.0))


def test_a_place_on_a_disc_is_not_inside_it() -> None:
    centres, radii = np.array(((5.0, 0.0), (0.0, 7.0))), np.array((1.0, 2.0))
    for north, east, disc in (
        (4.0, 0.0, -1),
        (4.0 + 5e-8, 0.0, -1),
        (4.0 + 3e-7, 0.0, 0),
        (5.5, 0.5, 0),
        (1.0, 7.5, 1),
        (0.0, 0.0, -1),
    ):
        assert kernels._inside_which(Discs.of(centres, radii).field, north, east) == disc
    both = Discs.of(centres[[0, 0]], radii)
    assert kernels._inside_which(both.field, 5.0, 0.0) == 0
