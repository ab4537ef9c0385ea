"""Every baseline keeps out of every disc, and the yardstick is the optimum."""

import math
from collections.abc import Callable

import numpy as np
import pytest

from autonomy.t3drm.spherical import Route, shortest_path
from tests.support.tangent_graph import shortest_length
from tools.bench.baselines import sampling
from tools.bench.baselines.ant_colony import AntColony
from tools.bench.baselines.astar import AStar
from tools.bench.baselines.bit_star import bit_star
from tools.bench.baselines.exact import ExactOptimum
from tools.bench.baselines.interface import Baseline
from tools.bench.baselines.potential_field import PotentialField
from tools.bench.baselines.rrt_star import rrt_star
from tools.bench.baselines.sampling import SamplingPlanner
from tools.bench.baselines.theta_star import ThetaStar
from tools.bench.maps import Map, random_map
from tools.bench.planners import PlanningStep, TangentRoute
from tools.bench.scoring import judge


def drawn(seed: int, discs: int = 8, walls: int = 1) -> Map:
    return random_map("test", 4.0, discs, walls, np.random.default_rng(seed))


def one_disc(radius_m: float = 0.5) -> Map:
    return Map(
        "one",
        (0.0, 0.0),
        (4.0, 0.0),
        np.array(((2.0, 0.0),)),
        np.array((radius_m,)),
        0.2,
        (-2.0, -3.0),
        (6.0, 3.0),
    )


def ring(gap: int) -> Map:
    turn = np.linspace(0.0, math.tau, 40, endpoint=False)[gap:]
    centres = np.stack((2.0 + np.cos(turn), np.sin(turn)), axis=1)
    return Map(
        "ring", (2.0, 0.0), (4.5, 0.0), centres, np.zeros(len(turn)), 0.2, (-2.0, -3.0), (6.0, 3.0)
    )


COMPLETE: tuple[Baseline, ...] = (ExactOptimum(), AStar(), ThetaStar(), TangentRoute())


@pytest.mark.parametrize("planner", COMPLETE, ids=lambda p: p.name)
@pytest.mark.parametrize("seed", range(4))
def test_complete_planners_find_a_free_path_on_random_maps(planner: Baseline, seed: int) -> None:
    problem = drawn(seed)
    score = judge(planner.plan(problem).path, problem)
    assert score is not None
    assert score.length_m >= math.dist(problem.start, problem.goal) - 1e-9


@pytest.mark.parametrize("seed", range(4))
def test_the_ants_find_a_free_path_on_random_maps(seed: int) -> None:
    problem = drawn(seed)
    assert judge(AntColony(np.random.default_rng(seed)).plan(problem).path, problem) is not None


@pytest.mark.parametrize("seed", range(6))
def test_a_potential_field_that_arrives_has_kept_out_of_every_disc(seed: int) -> None:
    problem = drawn(seed, discs=3, walls=0)
    path = PotentialField().plan(problem).path
    assert path is None or judge(path, problem) is not None


def test_a_potential_field_ends_in_front_of_a_wall_and_goes_round_a_disc() -> None:
    beside = Map("", (0.0, 0.02), (4.0, 0.0), *(one_disc().centres, one_disc().radii_m), 0.2,
                 (-2.0, -3.0), (6.0, 3.0))  # fmt: skip
    assert judge(PotentialField().plan(beside).path, beside) is not None
    row = np.stack((np.full(41, 2.0), np.linspace(-1.0, 1.0, 41)), axis=1)
    wall = Map("", (0.0, 0.0), (4.0, 0.0), row, np.zeros(41), 0.2, (-2.0, -3.0), (6.0, 3.0))
    assert PotentialField().plan(wall).path is None


@pytest.mark.parametrize("seed", range(12))
def test_the_yardstick_is_the_brute_force_optimum(seed: int) -> None:
    problem = drawn(seed, discs=12, walls=0)
    score = judge(ExactOptimum().plan(problem).path, problem)
    expected = shortest_length(problem.start, problem.goal, problem.centres, problem.reach_m)
    assert score is not None
    assert expected is not None
    assert score.length_m == pytest.approx(expected, rel=2e-6)


@pytest.mark.parametrize("seed", range(6))
def test_the_yardstick_and_the_planner_agree_where_walls_tie(seed: int) -> None:
    problem = drawn(seed, discs=4, walls=4)
    score = judge(ExactOptimum().plan(problem).path, problem)
    route = shortest_path(problem.start, problem.goal, problem.centres, problem.reach_m)
    assert score is not None
    assert isinstance(route, Route)
    assert score.length_m == pytest.approx(route.length_m, rel=2e-6)


def test_the_yardstick_round_one_disc_is_tangent_arc_tangent() -> None:
    reach = 0.7
    expected = 2.0 * math.sqrt(4.0 - reach**2) + reach * 2.0 * math.asin(reach / 2.0)
    score = judge(ExactOptimum().plan(one_disc()).path, one_disc())
    assert score is not None
    assert score.length_m == pytest.approx(expected, rel=1e-6)
    assert -1e-6 < score.spare_m < 1e-6


def test_the_rectangle_turns_the_yardstick_to_the_other_side() -> None:
    free = one_disc()
    off = np.array(((2.0, 0.1),))
    wide = Map("", free.start, free.goal, off, free.radii_m, 0.2, free.low, free.high)
    low = (-2.0, -0.5)
    tight = Map("", free.start, free.goal, off, free.radii_m, 0.2, low, free.high)
    over, under = ExactOptimum().plan(wide).path, ExactOptimum().plan(tight).path
    assert over is not None
    assert under is not None
    assert over[:, 1].min() < -0.5
    assert under[:, 1].max() > 0.7
    assert judge(under, tight) is not None


@pytest.mark.parametrize("planner", COMPLETE, ids=lambda p: p.name)
def test_a_closed_ring_has_no_way_out_and_an_open_one_has(planner: Baseline) -> None:
    assert planner.plan(ring(0)).path is None
    assert judge(planner.plan(ring(8)).path, ring(8)) is not None


def test_any_angle_is_no_longer_than_eight_directions_and_no_shorter_than_the_optimum() -> None:
    for seed in range(4):
        problem = drawn(seed)
        lengths = []
        for planner in (ExactOptimum(), ThetaStar(), AStar()):
            score = judge(planner.plan(problem).path, problem)
            assert score is not None
            lengths.append(score.length_m)
        assert lengths[0] <= lengths[1] + 1e-5
        assert lengths[1] <= lengths[2] + 1e-9


def test_the_ants_repeat_themselves_with_the_same_generator() -> None:
    problem = drawn(3)
    first, again = (AntColony(np.random.default_rng(5)).plan(problem).path for _ in range(2))
    assert first is not None
    assert again is not None
    assert np.array_equal(first, again)


@pytest.mark.parametrize("hyperbola", ["never", "prefer"])
def test_the_planning_step_keeps_the_maps_keep_out(hyperbola: str) -> None:
    step = PlanningStep(hyperbola, "step")
    problem = drawn(1, discs=0, walls=3)
    assert step.suits(problem)
    assert not step.suits(drawn(1))
    score = judge(step.plan(problem).path, problem)
    best = judge(ExactOptimum().plan(problem).path, problem)
    assert score is not None
    assert best is not None
    assert score.spare_m < 0.05
    assert score.length_m >= best.length_m - 1e-5


# The wheel is an extra: the suite is whole without it.
if sampling.available():

    @pytest.mark.parametrize("make", [rrt_star, bit_star])
    def test_sampling_planners_keep_out_and_stop_when_near_enough(
        make: Callable[[float], SamplingPlanner],
    ) -> None:
        problem = one_disc()
        best = judge(ExactOptimum().plan(problem).path, problem)
        assert best is not None
        answer = make(2.0).plan_until(problem, 1.05 * best.length_m)
        score = judge(answer.path, problem)
        assert score is not None
        assert score.length_m <= 1.05 * best.length_m
        assert answer.seconds < 1.9
