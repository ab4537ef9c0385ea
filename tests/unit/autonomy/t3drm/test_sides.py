"""Sides are homotopy: which obstacles lie between two paths, and what the chosen side costs."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from autonomy.config import PlannerConfig
from autonomy.geometry import Point
from autonomy.model import Environment, NoPlan, Plan
from autonomy.t3drm import kernels
from autonomy.t3drm.kernels import Floats
from autonomy.t3drm.planner import SPHERE_MAX_RATIO, Planner
from autonomy.t3drm.sides import SideChanges, barred, on_the_same_side, still_there, switched
from hal.config import Fence
from tests.support.ideal_vehicle import row

PLANNER = Planner(PlannerConfig(), 0.15, Fence.rectangle((-3.0, 8.0), (-6.0, 6.0)))
START, GOAL = (0.0, 0.0), (5.0, 0.0)
EAST: tuple[Point, ...] = (START, (2.5, 2.0), GOAL)
WEST: tuple[Point, ...] = (START, (2.5, -2.0), GOAL)
LEVELS_MAX_RATIO = 1.03**2
WALL = row((2.0, -1.0), (2.0, 1.1))
"""Its western end is 10 cm nearer."""


def plan(start: Point, hits: Floats, goal: Point = GOAL) -> Plan:
    found = PLANNER.plan(start, goal, hits)
    assert isinstance(found, Plan)
    return found


def east_most(path: tuple[Point, ...]) -> float:
    return max(path, key=lambda point: abs(point[1]))[1]


# ---------------------------------------------------------------- sides


def test_what_lies_between_two_paths_was_passed_on_the_other_side() -> None:
    between, beyond = np.array(((2.5, 0.0), (2.0, 0.3))), np.array(((2.5, 3.0), (6.0, 0.0)))
    known = np.concatenate((between, beyond))
    assert np.array_equal(switched(EAST, WEST, known), between)
    assert np.array_equal(switched(WEST, EAST, known), between)


def test_paths_on_one_side_are_the_same_however_far_apart() -> None:
    farther: tuple[Point, ...] = (START, (0.0, 5.0), (5.0, 5.0), GOAL)
    assert switched(EAST, farther, np.array(((2.5, 0.0), (2.5, -1.0)))).shape == (0, 2)
    assert switched(EAST, EAST, WALL).shape == (0, 2)
    assert switched(EAST, WEST, np.empty((0, 2))).shape == (0, 2)


def test_a_path_that_goes_once_round_an_obstacle_more_passes_it_otherwise() -> None:
    round_it: tuple[Point, ...] = (
        START, (2.5, 2.0), (4.0, 0.0), (2.5, -2.0), (1.0, 0.0), (2.5, 1.5), GOAL
    )  # fmt: skip
    hit = np.array(((2.5, 0.0),))
    assert np.array_equal(switched(EAST, round_it, hit), hit)


@settings(deadline=None, max_examples=200)
@given(
    st.lists(st.tuples(st.floats(-3, 3), st.floats(-3, 3)), min_size=3, max_size=9),
    st.tuples(st.floats(-3, 3), st.floats(-3, 3)),
)
def test_windings_are_the_sum_of_the_angles(loop: list[Point], point: Point) -> None:
    corners = np.array(loop)
    away = kernels.path_clearance(np.concatenate((corners, corners[:1])), np.array((point,)))
    if away < 1e-6:
        return
    bearings = [math.atan2(e - point[1], n - point[0]) for n, e in loop]
    total = sum(
        math.remainder(b - a, math.tau)
        for a, b in zip(bearings, bearings[1:] + bearings[:1], strict=True)
    )
    turns = int(kernels.windings(corners, np.array((point,)))[0])
    assert turns == round(total / math.tau)


def test_a_hit_that_is_gone_is_no_obstacle_any_more() -> None:
    hits = np.array(((1.0, 1.0), (2.0, 2.0)))
    assert np.array_equal(still_there(hits, np.array(((2.0, 2.04),))), hits[1:])
    assert still_there(hits, np.empty((0, 2))).shape == (0, 2)


# ---------------------------------------------------------------- keeping a side


def test_the_chosen_side_is_planned_past_the_same_obstacle_and_its_bar_is_not_shown() -> None:
    best = plan(START, WALL)
    assert east_most(best.points) < 0.0
    kept = on_the_same_side(PLANNER, best, EAST, WALL, WALL, 0.0)
    assert kept is not None
    assert east_most(kept.points) > 0.0
    assert best.length_m < kept.length_m < best.length_m + 0.15
    assert kept.obstacles == best.obstacles
    assert kept.environment is Environment.CONTINUOUS
    assert best.points in kept.rejected


def test_the_other_way_about_it_is_the_same() -> None:
    mirrored = WALL * (1.0, -1.0)
    best = plan(START, mirrored)
    assert east_most(best.points) > 0.0
    kept = on_the_same_side(PLANNER, best, WEST, mirrored, mirrored, 0.0)
    assert kept is not None
    assert east_most(kept.points) < 0.0


@settings(deadline=None, max_examples=60)
@given(st.floats(-1.6, 1.6), st.floats(0.3, 1.8), st.floats(0.6, 3.8), st.floats(0.0, math.pi))
def test_what_is_kept_is_on_the_side_of_the_course_free_and_no_better_than_the_best(
    east: float, half: float, north: float, turn: float
) -> None:
    dn, de = half * math.cos(turn), half * math.sin(turn)
    wall = row((north - dn, east - de), (north + dn, east + de))
    clear_m = min(kernels.clearance2(wall, *end) for end in (START, GOAL)) ** 0.5
    if clear_m < 0.3 or kernels.path_clearance(np.array((START, GOAL)), wall) > 0.2:
        return
    best = PLANNER.plan(START, GOAL, wall)
    assert isinstance(best, Plan)
    for course in ((START, (2.5, 5.5), GOAL), (START, (2.5, -5.5), GOAL)):
        passed = switched(course, best.points, wall)
        if passed.shape[0] == 0 or kernels.path_clearance(np.array(course), wall) < 0.25:
            continue
        kept = on_the_same_side(PLANNER, best, course, passed, wall, 0.0)
        assert kept is not None
        assert switched(course, kept.points, passed).shape[0] == 0
        # Beside the bar a pillar is no sphere; a sphere may cost this much (planner).
        assert SPHERE_MAX_RATIO * kept.length_m > best.length_m / LEVELS_MAX_RATIO
        path = np.array(kept.points)
        assert kernels.path_clearance(path, wall) > kept.keep_out_m - 2e-3


def test_the_side_of_a_single_hit_can_be_kept_too() -> None:
    hit = np.array(((2.5, 0.05),))
    best = plan(START, hit)
    assert east_most(best.points) < 0.0
    beside = plan(START, hit * (1.0, -1.0))
    course = tuple((n, e + 0.101) for n, e in beside.points)
    kept = on_the_same_side(PLANNER, best, course, hit, hit, 0.0)
    assert kept is not None
    assert east_most(kept.points) > 0.0


def test_a_side_that_is_closed_cannot_be_kept() -> None:
    closed = np.concatenate((WALL, row((2.0, 1.1), (2.0, 6.0))))
    best = plan(START, closed)
    assert on_the_same_side(PLANNER, best, EAST, WALL, closed, 0.0) is None


def test_a_course_that_no_path_would_fly_cannot_be_kept() -> None:
    hit = np.array(((2.5, 0.1),))
    best = plan(START, hit)
    round_it: tuple[Point, ...] = (
        START, (2.5, 2.0), (4.0, 0.0), (2.5, -2.0), (1.0, 0.0), (2.5, 2.5), GOAL
    )  # fmt: skip
    assert np.array_equal(switched(round_it, best.points, hit), hit)
    assert on_the_same_side(PLANNER, best, round_it, hit, hit, 0.0) is None


def test_a_bar_reaches_from_what_is_passed_across_the_path_to_the_fence() -> None:
    best = plan(START, WALL)
    bar = barred(best.points, EAST, WALL, PLANNER)
    assert bar is not None
    assert still_there(bar[:1], WALL).shape == (1, 2)
    assert PLANNER.fence.inside_distance_m(*bar[-1]) < 0.0
    assert all(PLANNER.fence.inside_distance_m(*point) >= 0.0 for point in bar[:-1])
    assert kernels.path_clearance(np.array(best.points), bar) < PLANNER.keep_outs_m[-1]
    gaps = np.hypot(*np.diff(bar, axis=0).T)
    assert gaps.max() < 2.0 * PLANNER.keep_outs_m[-1]


def test_where_a_path_keeps_far_from_what_it_passes_there_is_no_place_for_a_bar() -> None:
    assert barred(WEST, EAST, np.array(((2.5, 0.0),)), PLANNER) is None
    assert barred(EAST, EAST, WALL, PLANNER) is None


# ---------------------------------------------------------------- counting


def test_side_changes_are_counted_once_each_and_only_past_known_obstacles() -> None:
    sides = SideChanges()
    west, longer = plan(START, WALL), np.concatenate((row((2.0, -2.5), (2.0, -1.0)), WALL))
    east = plan(START, longer)
    assert east_most(east.points) > 0.0
    for result, expected in ((west, 0), (west, 0), (east, 1), (east, 1), (west, 2)):
        sides.planned(START, result)
        assert sides.count == expected


def test_after_no_way_and_with_a_new_goal_any_side_is_new() -> None:
    sides = SideChanges()
    west, east = plan(START, WALL), plan(START, WALL * (1.0, -1.0))
    nothing = NoPlan("no way", (), Environment.FREE, ())
    for result in (west, nothing, east, plan(START, WALL, (5.0, 1.0))):
        sides.planned(START, result)
    assert sides.count == 0


def test_replanning_on_the_way_past_an_obstacle_changes_no_side() -> None:
    sides = SideChanges()
    path = plan(START, WALL)
    for point in path.points[:-1]:
        sides.planned(point, plan(point, WALL))
    assert sides.count == 0


def test_a_side_change_counts_though_the_obstacle_was_first_seen_whole_later() -> None:
    sides = SideChanges()
    sides.planned(START, plan(START, WALL[:-12]))
    sides.planned(START, plan(START, WALL))
    assert sides.count == 1


@pytest.mark.parametrize("hits", [np.empty((0, 2)), np.array(((2.0, 3.0),))])
def test_a_free_way_has_no_sides(hits: Floats) -> None:
    sides = SideChanges()
    for _ in range(2):
        sides.planned(START, plan(START, hits))
    assert sides.count == 0
