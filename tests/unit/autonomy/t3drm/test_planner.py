import math
from concurrent.futures import ProcessPoolExecutor
from itertools import pairwise
from multiprocessing import get_context

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from autonomy.config import PlannerConfig
from autonomy.geometry import Point, distance, polyline_length
from autonomy.model import LegKind, NoPlan, Plan
from autonomy.t3drm import kernels
from autonomy.t3drm.planner import Planner, violated, warm_up
from hal.config import Fence

Floats = NDArray[np.float64]
NO_HITS = np.empty((0, 2))
FENCE = Fence.rectangle((-1.0, 7.0), (-1.0, 7.0))
PLANNER = Planner(PlannerConfig(), 0.15, FENCE)


def wall(a: Point, b: Point, step_m: float = 0.025) -> Floats:
    count = int(np.hypot(b[0] - a[0], b[1] - a[1]) / step_m) + 1
    return np.stack((np.linspace(a[0], b[0], count), np.linspace(a[1], b[1], count)), axis=1)


def ring(centre: Point, radius_m: float, begin: float = 0.0, end: float = math.tau) -> Floats:
    turn = np.linspace(begin, end, int(abs(end - begin) * radius_m / 0.025) + 2)
    return np.stack((centre[0] + radius_m * np.cos(turn), centre[1] + radius_m * np.sin(turn)), 1)


def random_hits(seed: int) -> Floats:
    """Pillars, walls and single hits as a map would hold them."""
    rng = np.random.default_rng(seed)
    parts = [rng.uniform(0.5, 5.5, (int(rng.integers(1, 8)), 2))]
    for _ in range(int(rng.integers(0, 6))):
        n, e = rng.uniform(0.5, 5.5, 2).tolist()
        begin = rng.uniform(0.0, math.tau)
        parts.append(ring((n, e), rng.uniform(0.05, 0.5), begin, begin + rng.uniform(1.0, 6.28)))
    for _ in range(int(rng.integers(0, 4))):
        n, e = rng.uniform(0.5, 5.5, 2).tolist()
        turn, length = rng.uniform(0.0, math.tau), rng.uniform(0.5, 3.0)
        parts.append(wall((n, e), (n + length * math.cos(turn), e + length * math.sin(turn))))
    rows = np.concatenate(parts)
    return rows + rng.normal(0.0, 0.01, rows.shape)


def assert_sound(plan: Plan, start: Point, goal: Point, hits: Floats) -> None:
    assert plan.legs[0].points[0] == start
    assert distance(plan.legs[-1].points[-1], goal) < 1e-9
    for before, after in pairwise(plan.legs):
        assert distance(before.points[-1], after.points[0]) < 1e-6
    for leg in plan.legs:
        assert len(leg.points) >= 2
        assert leg.length_m == pytest.approx(polyline_length(leg.points))
        path = np.array(leg.points)
        assert kernels.path_clearance(path, hits) >= leg.keep_out_m - 1.001e-3
        assert all(FENCE.inside_distance_m(*p) >= 0.0 for p in leg.points)
    assert plan.length_m == pytest.approx(sum(leg.length_m for leg in plan.legs))


@settings(deadline=None, max_examples=80)
@given(st.integers(0, 2**32 - 1), st.sampled_from(["prefer", "cost", "never"]))
def test_every_plan_is_free_of_all_hits_and_inside_the_fence(seed: int, hyperbola: str) -> None:
    hits = random_hits(seed)
    planner = Planner(PlannerConfig.model_validate({"hyperbola": hyperbola}), 0.15, FENCE)
    start, goal = (0.0, 0.0), (6.0, 6.0)
    plan = planner.plan(start, goal, hits)
    if isinstance(plan, NoPlan):
        assert plan.evidence
        return
    if plan.legs[0].keep_out_m >= plan.keep_out_m:
        assert_sound(plan, start, goal, hits)
    assert sum(len(o.hits) for o in plan.obstacles) == len(hits)
    assert (hyperbola != "never") or all(leg.kind is not LegKind.HYPERBOLA for leg in plan.legs)


@settings(deadline=None, max_examples=15)
@given(st.integers(0, 2**32 - 1))
def test_the_same_arguments_give_the_same_plan(seed: int) -> None:
    hits = random_hits(seed)
    again = Planner(PlannerConfig(), 0.15, FENCE)
    assert PLANNER.plan((0.0, 0.0), (6.0, 6.0), hits) == again.plan(
        (0.0, 0.0), (6.0, 6.0), hits.copy()
    )


def test_a_narrow_door_is_passed_at_a_smaller_radius_of_the_flow() -> None:
    # 0.43 m: too narrow for 0.30, 0.27 and 0.24, wide enough for 0.21.
    hits = np.concatenate((wall((3.0, -1.0), (3.0, 2.785)), wall((3.0, 3.215), (3.0, 7.0))))
    plan = PLANNER.plan((0.0, 3.0), (6.0, 3.0), hits)
    assert isinstance(plan, Plan)
    assert plan.keep_out_m == pytest.approx(0.21)
    assert plan.length_m == pytest.approx(6.0)


def test_a_smaller_radius_must_pay_for_itself() -> None:
    # Through the 0.43 m door 6 m, round the short wall only a little more.
    hits = np.concatenate((wall((3.0, 2.6), (3.0, 2.785)), wall((3.0, 3.215), (3.0, 3.4))))
    assert isinstance(found := PLANNER.plan((0.0, 3.0), (6.0, 3.0), hits), Plan)
    assert found.keep_out_m == pytest.approx(0.30)
    free = Planner(PlannerConfig(level_penalty=1.0), 0.15, FENCE)
    assert isinstance(cheap := free.plan((0.0, 3.0), (6.0, 3.0), hits), Plan)
    assert cheap.keep_out_m == pytest.approx(0.21)
    assert cheap.length_m == pytest.approx(6.0)


def test_out_of_a_trap_the_way_leads_round_its_arms() -> None:
    trap = np.concatenate(
        (wall((1.0, 2.0), (3.0, 2.0)), wall((3.0, 2.0), (3.0, 4.0)), wall((1.0, 4.0), (3.0, 4.0)))
    )
    plan = PLANNER.plan((2.0, 3.0), (5.0, 3.0), trap)
    assert isinstance(plan, Plan)
    assert_sound(plan, (2.0, 3.0), (5.0, 3.0), trap)
    assert min(n for n, _ in plan.points) < 1.0
    assert all(leg.kind is not LegKind.HYPERBOLA for leg in plan.legs)


@pytest.mark.parametrize("centre", [(0.0, 0.0), (5.0, 5.0)])
def test_a_closed_ring_is_unreachable_with_the_ring_as_evidence(centre: Point) -> None:
    around = ring(centre, 0.8)
    hits = np.concatenate((around, [(3.0, 2.0)]))
    found = PLANNER.plan((0.0, 0.0), (5.0, 5.0), hits)
    assert isinstance(found, NoPlan)
    assert found.reason == "obstacles close every way to the goal"
    assert set(found.evidence) == {(n, e) for n, e in around.tolist()}


def test_a_wall_from_fence_to_fence_is_unreachable() -> None:
    across = wall((3.0, -1.0), (3.0, 7.0))
    found = PLANNER.plan((0.0, 3.0), (6.0, 3.0), across)
    assert isinstance(found, NoPlan)
    assert len(found.evidence) == len(across)


def test_a_goal_outside_the_fence_is_refused() -> None:
    found = PLANNER.plan((0.0, 0.0), (8.0, 0.0), NO_HITS)
    assert isinstance(found, NoPlan)
    assert found.reason == "the goal lies outside the fence"


def test_a_goal_beside_an_obstacle_is_moved_within_the_tolerance_only() -> None:
    hits = np.array([(5.0, 5.1)])
    blocked = PLANNER.plan((0.0, 0.0), (5.0, 5.0), hits)
    assert isinstance(blocked, NoPlan)
    assert blocked.evidence == ((5.0, 5.1),)
    moved = PLANNER.plan((0.0, 0.0), (5.0, 5.0), hits, tolerance_m=0.15)
    assert isinstance(moved, Plan)
    assert distance(moved.points[-1], (5.0, 5.0)) <= 0.15
    assert distance(moved.points[-1], (5.0, 5.1)) >= moved.keep_out_m


def test_a_start_inside_a_keep_out_is_left_on_the_shortest_way() -> None:
    hits = wall((0.15, -0.5), (0.15, 0.5))
    plan = PLANNER.plan((0.0, 0.0), (-0.8, 0.0), hits)
    assert isinstance(plan, Plan)
    out = plan.legs[0]
    assert out.kind is LegKind.STRAIGHT
    assert out.keep_out_m == pytest.approx(0.15)
    assert out.points[1][0] < 0.0
    assert plan.points[-1] == (-0.8, 0.0)


def test_a_start_between_two_walls_too_near_is_boxed_in() -> None:
    hits = np.concatenate((wall((-0.9, -0.15), (0.9, -0.15)), wall((-0.9, 0.15), (0.9, 0.15))))
    found = PLANNER.plan((0.0, 0.0), (5.0, 0.0), hits)
    assert isinstance(found, NoPlan)
    assert "start" in found.reason
    assert found.evidence


def test_the_way_out_never_leads_through_a_wall_but_a_goal_may_move_across_it() -> None:
    # Between two walls 0.15 m apart the nearest free place, 0.23 m off, lies behind one of them.
    hits = np.concatenate((wall((0.03, -0.9), (0.03, 0.9)), wall((-0.12, -0.9), (-0.12, 0.9))))
    inside, outside = (0.0, 0.0), (3.0, 0.0)
    assert isinstance(PLANNER.plan(inside, outside, hits), NoPlan)
    moved = PLANNER.plan(outside, inside, hits, tolerance_m=0.25)
    assert isinstance(moved, Plan)
    assert moved.points[-1][0] >= 0.03 + 0.2
    assert distance(moved.points[-1], inside) <= 0.25


def test_a_start_just_outside_the_fence_is_led_back_in() -> None:
    plan = PLANNER.plan((-1.03, 2.0), (5.0, 2.0), NO_HITS)
    assert isinstance(plan, Plan)
    assert plan.points[0] == (-1.03, 2.0)
    assert all(FENCE.inside_distance_m(*p) > 0.0 for p in plan.points[1:])


def test_inside_a_fence_that_is_not_convex_the_plan_stays_inside() -> None:
    fence = Fence(polygon_ne_m=((0, 0), (4, 0), (4, 4), (2, 0.5), (0, 4)))
    planner = Planner(PlannerConfig(), 0.15, fence)
    plan = planner.plan((0.3, 3.0), (3.7, 3.0), np.array([(1.0, 0.2)]))
    assert isinstance(plan, Plan)
    polygon = np.array(fence.outline_ne_m, dtype=np.float64)
    assert kernels.path_is_inside(np.array(plan.points), polygon, polygon)


def test_too_many_discs_are_left_to_the_geodesic() -> None:
    planner = Planner(PlannerConfig(tangent_discs_max=2), 0.15, FENCE)
    hits = random_hits(5)
    plan = planner.plan((0.0, 0.0), (6.0, 6.0), hits)
    assert isinstance(plan, Plan)
    assert {leg.kind for leg in plan.legs} == {LegKind.GEODESIC}
    assert_sound(plan, (0.0, 0.0), (6.0, 6.0), hits)


def test_a_pillar_is_one_sphere_and_not_many_hits() -> None:
    plan = PLANNER.plan((0.0, 3.0), (6.0, 3.0), ring((3.0, 3.05), 0.2, 2.0, 4.5))
    assert isinstance(plan, Plan)
    assert [leg.kind for leg in plan.legs] == [LegKind.TANGENT, LegKind.ARC, LegKind.TANGENT]


def test_a_plank_along_the_way_is_not_given_a_sphere() -> None:
    plan = PLANNER.plan((2.0, 3.0), (4.2, 3.0), wall((2.77, 3.0), (3.43, 3.0)))
    assert isinstance(plan, Plan)
    assert max(abs(e - 3.0) for _, e in plan.points) < 0.3


def test_from_inside_a_hull_no_conic_is_flown() -> None:
    corner = np.concatenate((wall((1.0, 3.0), (3.0, 3.0)), wall((3.0, 3.0), (3.0, 1.0))))
    plan = PLANNER.plan((2.5, 2.5), (5.0, 2.0), corner)
    assert isinstance(plan, Plan)
    assert {leg.kind for leg in plan.legs} == {LegKind.TANGENT, LegKind.ARC}
    outside = PLANNER.plan((1.0, 1.0), (5.0, 2.0), corner)
    assert isinstance(outside, Plan)
    assert any(leg.kind is LegKind.HYPERBOLA for leg in outside.legs)


def test_the_replaced_tangents_are_kept_for_people_to_look_at() -> None:
    plan = PLANNER.plan((0.0, 3.0), (6.0, 3.0), wall((3.0, 2.8), (3.0, 5.0)))
    assert isinstance(plan, Plan)
    assert any(leg.kind is LegKind.HYPERBOLA for leg in plan.legs)
    assert plan.rejected


def test_the_cost_setting_refuses_a_conic_that_is_too_long() -> None:
    strict = PlannerConfig(hyperbola="cost", hyperbola_max_ratio=1.0)
    plan = Planner(strict, 0.15, FENCE).plan((0.0, 3.0), (6.0, 3.0), wall((3.0, 2.8), (3.0, 5.0)))
    assert isinstance(plan, Plan)
    assert all(leg.kind is not LegKind.HYPERBOLA for leg in plan.legs)


# ---------------------------------------------------------------- violated


def test_a_path_without_hits_or_without_length_is_not_violated() -> None:
    path = np.array(((0.0, 0.0), (1.0, 0.0)))
    assert violated(path, NO_HITS, 0.2) is None
    assert violated(path[:1], np.array([(0.0, 0.0)]), 0.2) is None
    assert violated(path, np.array([(0.5, 0.2)]), 0.2) is None


def test_the_first_violation_is_where_the_path_enters_the_keep_out() -> None:
    path = np.array(((0.0, 0.0), (1.0, 0.0), (3.0, 0.0)))
    hits = np.array([(2.8, 0.0), (2.0, 0.12), (2.0, -0.19)])
    found = violated(path, hits, 0.2)
    assert found is not None
    assert found.segment == 1
    assert found.hit == (2.0, 0.12)
    assert found.distance_m == pytest.approx(2.0 - 0.16)


def test_leaving_a_keep_out_is_no_violation_and_going_deeper_is() -> None:
    hits = np.array([(0.1, 0.0)])
    away = np.array(((0.0, 0.0), (-1.0, 0.0)))
    assert violated(away, hits, 0.2) is None
    assert violated(-away, hits, 0.2) is not None


@settings(deadline=None, max_examples=60)
@given(st.integers(0, 2**32 - 1), st.floats(0.05, 0.3))
def test_violated_agrees_with_sampling_the_path(seed: int, keep_out: float) -> None:
    rng = np.random.default_rng(seed)
    path, hits = rng.uniform(0.0, 3.0, (5, 2)), rng.uniform(0.0, 3.0, (12, 2))
    hits = hits[np.hypot(*(hits - path[0]).T) > keep_out + 0.002]
    found = violated(path, hits, keep_out)
    travelled = 0.0
    for a, b in pairwise(path):
        length = float(np.hypot(*(b - a)))
        for at in np.linspace(0.0, length, 2000):
            p = a + (b - a) * at / length
            if len(hits) and np.hypot(*(hits - p).T).min() < keep_out:
                assert found is not None
                assert found.distance_m == pytest.approx(travelled + at, abs=0.01)
                return
        travelled += length
    # Sampling may miss a graze shorter than its step.
    assert found is None or kernels.path_clearance(path, hits) > keep_out - 1e-4


def test_warm_up_leaves_nothing_to_compile() -> None:
    # In a process of its own: here other tests have compiled what warming up may have left out.
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        assert pool.submit(_compiled_after_warm_up).result() == []


def _compiled_after_warm_up() -> list[str]:
    """Kernels that plans of many kinds compile or load although all should have been."""
    warm_up()
    before = _compiled()
    for seed in range(5):
        PLANNER.plan((0.0, 0.0), (6.0, 6.0), random_hits(seed))
    PLANNER.plan((0.0, 0.0), (5.0, 5.0), ring((5.0, 5.0), 0.8))
    PLANNER.plan((0.0, 0.0), (5.0, 5.0), np.array([(5.0, 5.1)]), tolerance_m=0.15)
    PLANNER.plan((0.0, 0.0), (5.0, 5.0), np.array([(2.5, 2.5), (2.55, 2.5)]))
    PLANNER.plan((0.0, 0.0), (6.0, 6.0), many_hits())
    after = _compiled()
    return [name for name in after if after[name] != before[name]]


def many_hits() -> Floats:
    """Some hits in the way, and so many behind the goal that their tree is one of boxes."""
    rng = np.random.default_rng(3)
    far = rng.uniform((7.0, 7.0), (60.0, 60.0), (kernels.MANY, 2))
    return np.concatenate((random_hits(1), far))


def _compiled() -> dict[str, int]:
    """Per kernel how many types it is compiled for."""
    found = vars(kernels).items()
    return {name: len(k.signatures) for name, k in found if hasattr(k, "signatures")}
