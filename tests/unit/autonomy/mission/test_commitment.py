"""A side once chosen is kept until another is clearly shorter: no dithering before a wall."""

import numpy as np
import pytest

from autonomy.config import PlannerConfig
from autonomy.geometry import Point
from autonomy.guidance.path import FlownPath
from autonomy.mission.commitment import Commitment
from autonomy.model import NoPlan, Plan
from autonomy.t3drm.kernels import Floats
from autonomy.t3drm.planner import Planner
from autonomy.t3drm.sides import SideChanges
from hal.config import Fence
from tests.support.ideal_vehicle import row

FENCE = Fence.rectangle((-3.0, 8.0), (-6.0, 6.0))
PLANNER = Planner(PlannerConfig(), 0.15, FENCE)
START, GOAL = (0.0, 0.0), (5.0, 0.0)


def east_of(plan: Plan | NoPlan) -> float:
    """East of where the path is farthest from the straight line."""
    assert isinstance(plan, Plan)
    return max(plan.points, key=lambda point: abs(point[1]))[1]


def wall(west: float, east: float) -> Floats:
    return row((2.0, west), (2.0, east))


def replans(hysteresis_m: float, walls: list[Floats], goal: Point = GOAL) -> list[float]:
    commitment = Commitment(PLANNER, hysteresis_m)
    course: tuple[Point, ...] = (START,)
    sides = []
    for hits in walls:
        plan = commitment.plan(START, goal, hits, 0.0, course)
        assert isinstance(plan, Plan)
        course = plan.points
        sides.append(east_of(plan))
    return sides


NEARLY_EQUAL = [wall(-1.0, 1.1), wall(-1.2, 1.1), wall(-1.2, 1.3), wall(-1.35, 1.3)]


def test_nearly_equal_sides_are_not_taken_in_turn() -> None:
    assert all(side < 0.0 for side in replans(0.25, NEARLY_EQUAL))


def test_without_hysteresis_they_are() -> None:
    signs = [side < 0.0 for side in replans(0.0, NEARLY_EQUAL)]
    assert signs == [True, False, True, False]


def test_another_side_that_is_clearly_shorter_is_taken() -> None:
    assert [side < 0.0 for side in replans(0.25, [wall(-1.0, 1.1), wall(-2.0, 1.1)])] == [
        True,
        False,
    ]


@pytest.mark.parametrize(("longer_m", "kept"), [(0.2, True), (0.3, False)])
def test_the_hysteresis_is_a_length_of_path(longer_m: float, kept: bool) -> None:
    walls = [wall(-1.0, 1.1), wall(-1.6, 1.1)]
    west, east = (PLANNER.plan(START, GOAL, w) for w in (row((2.0, -1.6), (2.0, 6.0)), walls[1]))
    assert isinstance(west, Plan)
    assert isinstance(east, Plan)
    saved_m = west.length_m - east.length_m
    assert saved_m > 0.1
    margin_m = saved_m * (1.05 if kept else 0.95)
    assert longer_m > 0.0
    assert (replans(margin_m, walls)[1] < 0.0) is kept


def test_a_new_goal_and_a_plan_after_none_choose_freely() -> None:
    commitment = Commitment(PLANNER, 10.0)
    first = commitment.plan(START, GOAL, wall(-1.0, 1.1), 0.0, (START,))
    assert east_of(first) < 0.0
    assert isinstance(first, Plan)
    turned = wall(-1.2, 1.1)
    assert east_of(commitment.plan(START, GOAL, turned, 0.0, first.points)) < 0.0
    assert east_of(commitment.plan(START, (5.0, 0.01), turned, 0.0, first.points)) > 0.0

    assert isinstance(commitment.plan(START, GOAL, wall(-6.0, 6.0), 0.0, first.points), NoPlan)
    assert east_of(commitment.plan(START, GOAL, turned, 0.0, first.points)) > 0.0


def test_a_hit_that_was_noise_binds_nobody() -> None:
    ghost, real = np.array(((2.5, 0.1),)), np.array(((2.5, -0.1),))
    assert [side < 0.0 for side in replans(10.0, [ghost, real])] == [True, False]


def test_a_side_that_has_closed_is_left() -> None:
    closed = np.concatenate((wall(-1.0, 1.1), row((2.0, -6.0), (2.0, -1.0))))
    assert [side < 0.0 for side in replans(10.0, [wall(-1.0, 1.1), closed])] == [True, False]


def test_noise_on_a_symmetric_wall_does_not_change_sides_over_many_seeds() -> None:
    def changes(hysteresis_m: float, seed: int) -> int:
        rng = np.random.default_rng(seed)
        commitment, sides = Commitment(PLANNER, hysteresis_m), SideChanges()
        path = FlownPath((START,))
        point = START
        for _ in range(12):
            ends = 1.2 + rng.normal(0.0, 0.04, 2)
            plan = commitment.plan(point, GOAL, wall(-ends[0], ends[1]), 0.0, path.remaining())
            assert isinstance(plan, Plan)
            sides.planned(point, plan)
            path = FlownPath(plan.points)
            path.progress_m = 0.02
            point = path.point_at(0.02)
        return sides.count

    assert [changes(0.25, seed) for seed in range(20)] == [0] * 20
    assert sum(changes(0.0, seed) for seed in range(20)) > 20
