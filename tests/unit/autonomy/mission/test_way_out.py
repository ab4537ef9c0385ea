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
from autonomy.model import Crumb, NoPlan
from autonomy.t3drm.kernels import Floats
from autonomy.t3drm.planner import Planner, violated

CONFIG = Config()
GUARD_M = CONFIG.map.corridor_hit_m
KEEP_OUT_M = CONFIG.body.radius_m + CONFIG.planner.hard_clearance_m
INSIDE, OUTSIDE = (0.0, 0.0), (-1.5, 0.0)


def wall(north_m: float, gap_m: float, middle_m: float = 0.0) -> list[Point]:
    """A row of hits across everything, with one gap."""
    rows = np.arange(0.5 * gap_m, 12.0, 0.02)
    return [(north_m, middle_m + side * float(e)) for side in (-1.0, 1.0) for e in rows]


def pocket(gap_m: float) -> Floats:
    """Closed but for a gap to the south, 0.75 m from where the vehicle is."""
    back = [(0.6, float(e)) for e in np.arange(-0.6, 0.61, 0.02)]
    sides = [(float(n), side) for n in np.arange(-0.75, 0.61, 0.02) for side in (-0.6, 0.6)]
    return np.array([*wall(-0.75, gap_m), *back, *sides])


def flown(*points: Point) -> Trail:
    return Trail(tuple(Crumb(point, 1.0, is_open=False) for point in points))


def straight_in() -> Trail:
    return flown(*((-1.5 + 0.2 * k, 0.0) for k in range(8)), INSIDE)


def usual_plan(hits: Floats) -> object:
    planner = Planner(CONFIG.planner, CONFIG.body.radius_m, CONFIG.guard.fence)
    return planner.plan(INSIDE, OUTSIDE, hits, 0.05)


def test_a_gap_that_has_closed_by_a_little_is_left_by_the_way_in() -> None:
    hits = pocket(2.0 * KEEP_OUT_M - 0.02)
    assert isinstance(usual_plan(hits), NoPlan)
    out = WayOut(CONFIG, straight_in()).plan(INSIDE, OUTSIDE, 1.0, hits, 0.05)
    assert out is not None
    assert out.points[-1] == OUTSIDE
    assert GUARD_M < out.keep_out_m == pytest.approx(GUARD_M + SPARE_M)


@pytest.mark.parametrize("aside_m", [0.0, 0.7 * FLOWN_WITHIN_M, 1.3 * FLOWN_WITHIN_M, 0.4])
def test_no_other_gap_is_left_by(aside_m: float) -> None:
    way_in = flown((-1.5, aside_m), (-0.75, aside_m), (-0.4, aside_m), INSIDE)
    out = WayOut(CONFIG, way_in).plan(INSIDE, OUTSIDE, 1.0, pocket(2.0 * KEEP_OUT_M - 0.02), 0.05)
    assert (out is not None) is (aside_m < FLOWN_WITHIN_M)


def test_what_was_flown_at_another_height_is_no_way_out() -> None:
    out = WayOut(CONFIG, straight_in()).plan(INSIDE, OUTSIDE, 1.22, pocket(0.40), 0.05)
    assert out is None


def test_who_laid_no_crumbs_has_no_way_out() -> None:
    assert WayOut(CONFIG, Trail()).plan(INSIDE, OUTSIDE, 1.0, pocket(0.40), 0.05) is None


def test_where_there_is_room_the_way_out_may_cut_corners() -> None:
    around = flown((-1.5, 0.0), (-1.2, 1.0), (-0.9, 0.3), (-0.75, 0.0), INSIDE)
    assert WayOut(CONFIG, around).plan(INSIDE, OUTSIDE, 1.0, pocket(0.40), 0.05) is not None


@settings(deadline=None, max_examples=40)
@given(gap_m=st.floats(0.30, 0.60), aside_m=st.floats(-0.03, 0.03))
def test_a_way_out_never_comes_nearer_than_the_guard_lets_it(gap_m: float, aside_m: float) -> None:
    hits = pocket(gap_m) + np.array((0.0, aside_m))
    out = WayOut(CONFIG, straight_in()).plan(INSIDE, OUTSIDE, 1.0, hits, 0.05)
    if out is None:
        # Hits stand 2 cm apart: the gap is that much wider than it is said to be, at most.
        assert gap_m < 2.0 * (GUARD_M + SPARE_M) + 0.002
    else:
        assert violated(np.array(out.points), hits, GUARD_M) is None
        assert math.isclose(out.keep_out_m, GUARD_M + SPARE_M)
