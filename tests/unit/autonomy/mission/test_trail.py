"""The way that was flown, and how long the battery lasts on the way back."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from autonomy.geometry import Point, distance
from autonomy.mission.reserve import Reserve
from autonomy.mission.trail import JOINED_M, STEP_M, Trail
from autonomy.model import Crumb


def walked(points: list[Point], height_m: float = 1.0, crumbs_max: int = 2000) -> Trail:
    trail = Trail(crumbs_max=crumbs_max)
    for point in points:
        trail.count_way(point)
        if trail.is_due(point, height_m):
            trail.lay(Crumb(point, height_m, is_open=False))
    return trail


def straight(metres: float, step_m: float = 0.05) -> list[Point]:
    return [(step_m * i, 0.0) for i in range(round(metres / step_m) + 1)]


def test_a_straight_way_leads_straight_back() -> None:
    trail = walked(straight(3.0))
    back = trail.back(to_open=False)
    assert back[-1].point == (0.0, 0.0)
    assert back[0].point[0] == pytest.approx(3.0, abs=STEP_M)
    assert trail.length_m == pytest.approx(3.0, abs=STEP_M)
    assert trail.flown_m == pytest.approx(3.0, abs=0.05)


def test_a_loop_is_cut_off_and_still_counts_as_way() -> None:
    square = [(0.0, y / 20) for y in range(21)] + [(x / 20, 1.0) for x in range(21)]
    square += [(1.0, 1.0 - y / 20) for y in range(21)] + [(1.0 - x / 20, 0.0) for x in range(21)]
    trail = walked([*square, *((0.0, -y / 20) for y in range(21))])
    assert trail.length_m == pytest.approx(1.0, abs=2.0 * STEP_M)
    assert trail.flown_m == pytest.approx(5.0, abs=0.2)


def test_heights_are_apart_and_a_climb_in_place_is_a_crumb() -> None:
    trail = Trail()
    for height_m in (1.0, 1.22, 1.0):
        assert trail.is_due((0.0, 0.0), height_m)
        trail.lay(Crumb((0.0, 0.0), height_m, is_open=False))
    # Back at the first height, where it began: nothing is left to fly back.
    assert [crumb.height_m for crumb in trail.crumbs] == [1.0]


def test_the_last_open_place_ends_the_shorter_way_back() -> None:
    trail = Trail()
    for index, is_open in enumerate((True, True, False, False)):
        trail.lay(Crumb((float(index), 0.0), 1.0, is_open))
    assert [crumb.point[0] for crumb in trail.back(to_open=True)] == [3.0, 2.0, 1.0]
    assert len(trail.back(to_open=False)) == 4


def test_crumbs_that_were_passed_are_gone_but_never_the_first() -> None:
    trail = walked(straight(2.0))
    before = trail.crumbs
    trail.drop(3)
    assert trail.crumbs == before[:-3]
    trail.drop(1000)
    assert [crumb.point for crumb in trail.crumbs] == [(0.0, 0.0)]


@settings(deadline=None, max_examples=60)
@given(
    st.lists(st.tuples(st.floats(-0.4, 0.4), st.floats(-0.4, 0.4)), max_size=300),
    st.integers(8, 40),
)
def test_memory_is_bounded_and_the_way_begins_where_the_flight_did(
    steps: list[Point], crumbs_max: int
) -> None:
    points = [(0.0, 0.0)]
    for step in steps:
        points.append((points[-1][0] + step[0], points[-1][1] + step[1]))
    trail = walked(points, crumbs_max=crumbs_max)
    crumbs = trail.crumbs
    assert len(crumbs) <= crumbs_max
    assert crumbs[0].point == (0.0, 0.0)
    assert {crumb.point for crumb in crumbs} <= set(points)
    near = STEP_M + JOINED_M
    assert distance(crumbs[-1].point, points[-1]) <= near
    assert trail.length_m <= trail.flown_m + near * len(points)


def test_the_battery_lasts_as_long_as_it_went_down_so_far() -> None:
    reserve = Reserve()
    assert reserve.lasts_s(0.1) == math.inf
    for second in range(101):
        reserve.note(float(second), 0.9 - 0.004 * second)
        reserve.note(float(second), None)
    assert reserve.lasts_s(0.1) == pytest.approx(100.0)
    assert reserve.lasts_s(0.6) == 0.0


def test_a_battery_that_does_not_go_down_lasts_for_ever() -> None:
    reserve = Reserve()
    reserve.note(0.0, 0.5)
    reserve.note(50.0, 0.6)
    assert reserve.lasts_s(0.1) == math.inf


def test_stretches_are_of_one_height_and_not_longer_than_asked() -> None:
    heights_m = (1.0, 1.0, 1.02, 1.5, 1.5)
    points = [(0.0, 0.3 * k) for k in range(5)]
    crumbs = zip(points, heights_m, (False, True, True, True, False), strict=True)
    trail = Trail(tuple(Crumb(point, height_m, is_open=o) for point, height_m, o in crumbs))
    assert trail.stretches(1.0, 0.4) == ((points[0], points[1]), (points[1], points[2]))
    assert trail.stretches(1.5, 0.4) == ((points[3], points[4]),)
    assert trail.stretches(1.0, 0.2) == ()
    assert trail.open_places(1.0) == (points[2], points[1])
    assert trail.newest(1.5) == points[4]
    assert trail.newest(1.0) is None
    assert Trail().newest(1.0) is None
