"""Out of a narrow place by the way that was flown into it, and by no other."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from autonomy.config import Config
from autonomy.geometry import Point
from autonomy.mission.trail import Trail
from autonomy.mission.way_out import FLOWN_WITHIN_M, SPARE_M, WayOut
from autonomy.model import Crumb, NoPlan, Plan
from autonomy.t3drm.kernels import Floats
from autonomy.t3drm.planner import Planner, violated

CONFIG = Config()
GUARD_M = CONFIG.map.corridor_hit_m
KEEP_OUT_M = CONFIG.body.radius_m + CONFIG.planner.hard_clearance_m
INSIDE, OUTSIDE, GOAL = (0.0, 0.0), (-2.0, 0.0), (-2.5, 1.0)


def wall(north_m: float, gap_m: float, middle_m: float = 0.0) -> list[Point]:
    """A row of hits across everything, with one gap."""
    rows = np.arange(0.5 * gap_m, 12.0, 0.02)
    return [(north_m, middle_m + side * float(e)) for side in (-1.0, 1.0) for e in rows]


def pocket(gap_m: float) -> Floats:
    """Closed but for a gap to the south, 0.75 m from where the vehicle is."""
    back = [(0.6, float(e)) for e in np.arange(-0.6, 0.61, 0.02)]
    sides = [(float(n), side) for n in np.arange(-0.75, 0.61, 0.02) for side in (-0.6, 0.6)]
    return np.array([*wall(-0.75, gap_m), *back, *sides])


def flown(*points: Point, height_m: float = 1.0) -> Trail:
    """Open outside the pocket."""
    return Trail(tuple(Crumb(point, height_m, is_open=point[0] <= -1.5) for point in points))


def straight_in(aside_m: float = 0.0, height_m: float = 1.0) -> Trail:
    crumbs = [(-1.6 + 0.2 * k, aside_m) for k in range(7)]
    return flown(*crumbs, (-0.2, 0.5 * aside_m), INSIDE, height_m=height_m)


def planner() -> Planner:
    return Planner(CONFIG.planner, CONFIG.body.radius_m, CONFIG.guard.fence)


def out_of(hits: Floats, trail: Trail, point: Point = INSIDE, goal: Point = GOAL) -> Plan | None:
    return WayOut(CONFIG, planner(), trail).plan(point, goal, 1.0, hits, 0.05)


CLOSED = pocket(2.0 * KEEP_OUT_M - 0.02)


def test_a_gap_that_has_closed_by_a_little_is_left_by_the_way_in() -> None:
    assert isinstance(planner().plan(INSIDE, GOAL, CLOSED), NoPlan)
    out = out_of(CLOSED, straight_in())
    assert out is not None
    assert out.points[0] == INSIDE
    assert out.points[-1] == pytest.approx((-1.6, 0.0))
    assert GUARD_M < out.keep_out_m == pytest.approx(GUARD_M + SPARE_M)
    assert out.height_m == 1.0


def test_a_wide_pocket_is_left_too() -> None:
    wide = np.array([*wall(-0.75, 2.0 * KEEP_OUT_M - 0.02), *wall(0.9, 0.0)])
    sides = [(float(n), side) for n in np.arange(-0.75, 0.91, 0.02) for side in (-1.5, 1.5)]
    assert out_of(np.concatenate((wide, np.array(sides))), straight_in(), goal=OUTSIDE) is not None


@pytest.mark.parametrize("aside_m", [0.0, 0.7 * FLOWN_WITHIN_M, 1.3 * FLOWN_WITHIN_M, 0.4])
def test_no_other_gap_is_left_by(aside_m: float) -> None:
    out = out_of(CLOSED, straight_in(aside_m))
    assert (out is not None) is (aside_m < FLOWN_WITHIN_M)


def test_what_was_flown_at_another_height_is_no_way_out() -> None:
    assert out_of(CLOSED, straight_in(height_m=1.22)) is None


def test_crumbs_too_far_apart_have_not_flown_what_is_between() -> None:
    assert out_of(CLOSED, flown((-1.6, 0.0), (-0.3, 0.0), INSIDE)) is None


@pytest.mark.parametrize("past_m", [0.12, 0.19])
def test_the_way_since_the_last_crumb_was_flown(past_m: float) -> None:
    point = (past_m, 0.0)
    beside = np.array([(past_m, 0.2), (past_m, -0.2)])
    assert out_of(np.concatenate((CLOSED, beside)), straight_in(), point) is not None


def test_who_laid_no_crumbs_has_no_way_out() -> None:
    assert out_of(CLOSED, Trail()) is None


def test_where_the_goal_cannot_be_reached_from_outside_either_nothing_is_flown() -> None:
    ring = np.arange(0.0, 6.3, 0.05)
    sealed = [(-3.0 + 0.4 * math.cos(a), 2.0 + 0.4 * math.sin(a)) for a in ring]
    hits = np.concatenate((CLOSED, np.array(sealed)))
    assert out_of(CLOSED, straight_in(), goal=(-3.0, 2.0)) is not None
    assert out_of(hits, straight_in(), goal=(-3.0, 2.0)) is None


@settings(deadline=None, max_examples=40)
@given(gap_m=st.floats(0.30, 0.60), aside_m=st.floats(-0.03, 0.03))
def test_a_way_out_never_comes_nearer_than_the_guard_lets_it(gap_m: float, aside_m: float) -> None:
    hits = pocket(gap_m) + np.array((0.0, aside_m))
    out = out_of(hits, straight_in())
    if out is None:
        assert gap_m < 2.0 * (GUARD_M + SPARE_M) + 0.002
    else:
        assert violated(np.array(out.points), hits, GUARD_M + SPARE_M - 1e-3) is None
        assert math.isclose(out.keep_out_m, GUARD_M + SPARE_M)
