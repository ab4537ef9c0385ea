"""TangentBug's bound on path length: what it counts, that it holds, and what it catches."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from autonomy.config import PlannerConfig
from autonomy.geometry import Point
from autonomy.model import Environment, NoPlan, Plan
from autonomy.t3drm.bound import (
    MET_WITHIN_M,
    SETTLING_M,
    TRACKING,
    BoundTally,
    PathBound,
    exposed_m,
)
from autonomy.t3drm.kernels import Floats
from autonomy.t3drm.planner import Planner
from hal.config import Fence
from tests.support.ideal_vehicle import fly_ideally, row

WIDE = Fence.rectangle((-6.0, 10.0), (-8.0, 8.0))
R0 = 0.15 + PlannerConfig().comfortable_clearance_m
PLANNER = Planner(PlannerConfig(), 0.15, WIDE)
NOTHING = np.empty((0, 2))
NO_WAY = NoPlan("no way", (), Environment.FREE, ())


def plan(start: Point, goal: Point, hits: Floats) -> Plan:
    found = PLANNER.plan(start, goal, hits)
    assert isinstance(found, Plan)
    return found


def bound_of(*results: tuple[float, Plan | NoPlan], fence: Fence = WIDE) -> PathBound:
    tally = BoundTally()
    for to_go_m, result in results:
        tally.planned(to_go_m, result)
    return tally.bound(R0, fence)


# ---------------------------------------------------------------- perimeters


def test_the_perimeter_of_one_hit_is_its_circle() -> None:
    assert exposed_m(np.zeros((1, 2)), R0, WIDE).sum() == pytest.approx(2.0 * math.pi * R0)


@pytest.mark.parametrize("apart_m", [0.05, 0.2, 0.4, 0.46, 1.0])
def test_two_overlapping_circles_lose_the_arcs_inside_each_other(apart_m: float) -> None:
    hidden = 4.0 * R0 * math.acos(min(1.0, apart_m / (2.0 * R0)))
    centres = np.array(((1.0, 1.0), (1.0, 1.0 + apart_m)))
    assert exposed_m(centres, R0, WIDE).sum() == pytest.approx(
        4.0 * math.pi * R0 - hidden, abs=0.03
    )


def test_a_wall_is_as_long_as_both_its_sides_and_its_ends() -> None:
    wall = row((0.0, -1.5), (0.0, 1.5), 0.025)
    perimeter_m = float(exposed_m(wall, R0, WIDE).sum())
    assert perimeter_m == pytest.approx(2.0 * 3.0 + 2.0 * math.pi * R0, rel=0.005)


def test_a_ring_has_an_inner_side_as_well() -> None:
    turn = np.linspace(0.0, 2.0 * math.pi, 200, endpoint=False)
    ring = np.stack((np.cos(turn), np.sin(turn)), axis=1)
    assert exposed_m(ring, R0, WIDE).sum() == pytest.approx(4.0 * math.pi, rel=0.005)


def test_what_lies_outside_the_fence_cannot_be_flown_along() -> None:
    wall = row((0.0, -1.0), (0.0, 1.0), 0.025)
    half = Fence.rectangle((0.0, 5.0), (-5.0, 5.0))
    whole_m, half_m = exposed_m(wall, R0, WIDE).sum(), exposed_m(wall, R0, half).sum()
    assert half_m == pytest.approx(0.5 * whole_m, rel=0.005)


# ---------------------------------------------------------------- what is counted


def test_without_obstacles_only_the_straight_way_is_allowed() -> None:
    bound = bound_of((5.0, plan((0.0, 0.0), (5.0, 0.0), NOTHING)))
    assert bound == PathBound(TRACKING * 5.0 + SETTLING_M, 5.0, 0.0, 1)
    assert bound.holds(bound.bound_m)
    assert not bound.holds(math.nextafter(bound.bound_m, math.inf))


def test_before_any_plan_there_is_nothing_to_allow() -> None:
    assert bound_of() == PathBound(SETTLING_M, 0.0, 0.0, 0)
    assert bound_of((5.0, NO_WAY)).stretches == 0


def test_an_obstacle_counts_when_a_path_comes_to_it_and_only_then() -> None:
    met = bound_of((5.0, plan((0.0, 0.0), (5.0, 0.0), np.array(((2.5, 0.1),)))))
    assert met.perimeter_m == pytest.approx(2.0 * math.pi * R0)
    away = bound_of((5.0, plan((0.0, 0.0), (5.0, 0.0), np.array(((2.5, 0.5),)))))
    assert away.perimeter_m == 0.0


def test_a_sphere_that_a_path_goes_round_is_met_though_its_hits_are_far_from_the_path() -> None:
    # A short row end on: its enclosing circle reaches out to its sides, where no hit is.
    plank = row((0.5, 0.0), (1.0, 0.0))
    found = plan((0.0, 0.0), (5.0, 0.0), plank)
    assert min(math.dist(a, b) for a in found.points for b in plank.tolist()) > R0 + MET_WITHIN_M
    assert bound_of((5.0, found)).perimeter_m == pytest.approx(1.0 + 2.0 * math.pi * R0, rel=0.005)


def test_an_obstacle_counts_whole_and_once_however_often_it_is_met() -> None:
    wall = row((2.0, -1.0), (2.0, 1.0))
    replans = [
        (5.0 - x, plan((x, 0.0), (5.0, 0.0), wall[: 11 + 10 * k]))
        for k, x in enumerate((0.0, 0.5, 1.0, 1.5))
    ]
    bound = bound_of(*replans)
    assert bound.stretches == 1
    assert bound.straight_m == 5.0
    assert bound.perimeter_m == pytest.approx(4.0 + 2.0 * math.pi * R0, rel=0.005)


def test_what_an_earlier_path_ran_into_counts_even_if_the_last_one_stays_away() -> None:
    wall = row((2.0, -1.0), (2.0, 1.0))
    into = plan((0.0, 0.0), (4.0, 0.0), NOTHING)
    aside = plan((0.0, 4.0), (4.0, 0.1), wall)
    assert bound_of((4.0, into), (5.6, aside)).perimeter_m > 4.0


def test_a_plan_after_none_begins_anew_and_pays_again() -> None:
    one = plan((0.0, 0.0), (5.0, 0.0), np.array(((2.5, 0.1),)))
    once, twice = (
        bound_of((5.0, one)),
        bound_of((5.0, one), (4.0, NO_WAY), (4.0, NO_WAY), (4.0, one)),
    )
    assert twice.stretches == 2
    assert twice.straight_m == 9.0
    assert twice.perimeter_m == pytest.approx(2.0 * once.perimeter_m)


def test_the_next_goal_of_a_route_begins_anew_but_a_goal_moved_by_noise_does_not() -> None:
    first, moved = (plan((0.0, 0.0), (5.0, e), NOTHING) for e in (0.0, 0.09))
    assert bound_of((5.0, first), (3.0, moved)).straight_m == 5.0
    assert bound_of((5.0, first), (3.0, plan((2.0, 0.0), (2.0, 3.0), NOTHING))).straight_m == 8.0


# ---------------------------------------------------------------- that it holds, what it catches

obstacles = st.lists(
    st.tuples(
        st.floats(1.0, 4.0), st.floats(-2.5, 2.5), st.floats(0.0, 1.2), st.floats(0.0, math.pi)
    ),
    min_size=1,
    max_size=4,
)


@settings(deadline=None, max_examples=60)
@given(obstacles)
def test_an_ideal_vehicle_keeps_the_bound_among_any_walls(
    walls: list[tuple[float, float, float, float]],
) -> None:
    hits = np.concatenate(
        [
            row(
                (n - half * math.cos(turn), e - half * math.sin(turn)),
                (n + half * math.cos(turn), e + half * math.sin(turn)),
            )
            for n, e, half, turn in walls
        ]
    )
    ends = np.array(((0.0, 0.0), (5.0, 0.0)))
    clear = np.hypot(*(hits[:, None, :] - ends[None, :, :]).transpose(2, 0, 1)).min(axis=1) > 0.3
    flight = fly_ideally(PLANNER, hits[clear], (0.0, 0.0), (5.0, 0.0))
    assert flight.reached
    assert flight.length_m <= flight.bound.straight_m + flight.bound.perimeter_m + 0.1


WALL = row((2.0, -1.5), (2.0, 1.5))
ROUND_WALL_M = 2.0 * 3.0 + 2.0 * math.pi * R0


def test_the_bound_leaves_little_where_the_end_of_a_wall_cannot_be_seen() -> None:
    # A wall whose near end is just out of sight to the left, the far one six metres to the right.
    wall = row((2.0, -1.35), (2.0, 6.0))
    plain = fly_ideally(PLANNER, wall, (0.0, 0.05), (2.4, 0.05))
    assert plain.reached
    assert plain.bound.holds(plain.length_m)


def test_a_vehicle_that_dithers_breaks_the_bound() -> None:
    turn = [1.0]

    def other_end(point: Point, hits: Floats) -> Floats:
        # Half-way to an end of the wall it begins to believe in the other one.
        if point[0] < 1.9 and turn[0] * point[1] > 1.2:
            turn[0] = -turn[0]
        phantom = row((2.0, 0.0), (2.0, -turn[0] * 7.9), 0.2)
        return phantom if hits.shape[0] else NOTHING

    honest = fly_ideally(PLANNER, WALL, (0.0, 0.0), (5.0, 0.0))
    assert honest.reached
    assert honest.bound.holds(honest.length_m)
    dithering = fly_ideally(PLANNER, WALL, (0.0, 0.0), (5.0, 0.0), misled=other_end, limit_m=40.0)
    assert dithering.side_changes > 3
    assert dithering.bound.perimeter_m == pytest.approx(ROUND_WALL_M, rel=0.05)
    assert not dithering.bound.holds(dithering.length_m)


def test_a_vehicle_that_always_keeps_left_and_never_lets_go_breaks_the_bound() -> None:
    kept = bound_of((5.0, plan((0.0, 0.0), (5.0, 0.0), WALL)))
    # Keeping left costs at most one way round, which the bound allows; circling does not end there.
    assert kept.holds(5.0 + ROUND_WALL_M)
    assert not kept.holds(5.0 + 2.0 * ROUND_WALL_M)
