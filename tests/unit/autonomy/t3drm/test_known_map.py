"""What is kept, skipped or looked up to be quick changes no answer."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from autonomy.config import PlannerConfig
from autonomy.geometry import Point
from autonomy.model import NoPlan, Plan
from autonomy.t3drm import kernels
from autonomy.t3drm.kernels import Floats
from autonomy.t3drm.known_map import KnownMap
from autonomy.t3drm.planner import Planner
from autonomy.t3drm.spherical import (
    NO_PLANES,
    NO_SEEDS,
    Arc,
    Discs,
    NoRoute,
    NoRouteReason,
    Route,
    route_among,
)
from hal.config import Fence
from tests.support.tangent_graph import shortest_length

FENCE = Fence.rectangle((-1.0, 7.0), (-1.0, 7.0))
KEEP_OUT_M = 0.2
seeds = st.integers(0, 2**32 - 1)


def cluster(seed: int, count: int = 120) -> Floats:
    """Hits strewn so densely that they are one obstacle with bays, and a few besides."""
    rng = np.random.default_rng(seed)
    return rng.uniform((0.5, 0.5), (rng.uniform(1.5, 4.0), rng.uniform(1.5, 4.0)), (count, 2))


def walls(seed: int) -> Floats:
    rng = np.random.default_rng(seed)
    rows = []
    for _ in range(int(rng.integers(1, 7))):
        n, e, turn = rng.uniform(0.5, 5.5), rng.uniform(0.5, 5.5), rng.uniform(0.0, math.tau)
        at = np.arange(0.0, rng.uniform(0.1, 2.5), 0.03)
        rows.append(np.stack((n + at * math.cos(turn), e + at * math.sin(turn)), axis=1))
    hits = np.concatenate(rows)
    return hits + rng.normal(0.0, 0.008, hits.shape)


# ---------------------------------------------------------------- kept from plan to plan


@settings(deadline=None, max_examples=30)
@given(seeds, seeds)
def test_what_was_asked_before_changes_no_plan(first: int, second: int) -> None:
    planner = Planner(PlannerConfig(), 0.15, FENCE)
    maps = [walls(first), walls(second)]
    questions: list[tuple[Point, Point, int]] = [
        ((0.0, 0.0), (6.0, 6.0), 0),
        ((6.0, 0.0), (0.0, 6.0), 0),
        ((0.0, 0.0), (6.0, 6.0), 1),
        ((0.0, 0.0), (6.0, 6.0), 0),
        ((3.0, 3.0), (6.0, 6.0), 0),
    ]
    for start, goal, which in questions:
        alone = Planner(PlannerConfig(), 0.15, FENCE).plan(start, goal, maps[which], 0.1)
        assert planner.plan(start, goal, maps[which], 0.1) == alone


def test_hits_that_were_changed_in_place_are_seen() -> None:
    planner = Planner(PlannerConfig(), 0.15, FENCE)
    hits = np.array([(3.0, 5.0)])
    before = planner.plan((0.0, 0.0), (6.0, 0.0), hits)
    hits[0] = (3.0, 0.0)
    after = planner.plan((0.0, 0.0), (6.0, 0.0), hits)
    assert isinstance(before, Plan)
    assert isinstance(after, Plan)
    assert after.length_m > before.length_m


def test_the_same_map_is_described_once() -> None:
    planner = Planner(PlannerConfig(), 0.15, FENCE)
    hits = walls(1)
    hits.setflags(write=False)
    first, again = (planner.plan((0.0, 0.0), (6.0, 6.0), hits) for _ in range(2))
    equal = planner.plan((0.0, 0.0), (6.0, 6.0), hits.copy())
    assert again.obstacles is first.obstacles
    assert equal.obstacles is first.obstacles
    planner.forget()
    anew = planner.plan((0.0, 0.0), (6.0, 6.0), hits)
    assert anew.obstacles is not first.obstacles
    assert anew == first


def test_without_hits_a_known_map_is_empty() -> None:
    known = KnownMap(np.empty((0, 2)), PlannerConfig())
    assert known.is_clear((0.0, 0.0), 10.0)
    assert known.nearest_m((0.0, 0.0)) == math.inf
    assert known.obstacles(KEEP_OUT_M) == ()
    assert known.level(KEEP_OUT_M).outlines.environment.value == "free"


# ---------------------------------------------------------------- levels that cannot win


@settings(deadline=None, max_examples=40)
@given(seeds)
def test_the_cheapest_of_all_levels_wins_as_if_all_were_solved(seed: int) -> None:
    hits = walls(seed)
    config = PlannerConfig()
    together = Planner(config, 0.15, FENCE)
    plan = together.plan((0.0, 0.0), (6.0, 6.0), hits)
    costs = []
    for number, keep_out in enumerate(together.keep_outs_m):
        clearance = keep_out - 0.15
        one = PlannerConfig(
            levels=1,
            comfortable_clearance_m=clearance,
            hard_clearance_m=min(clearance, config.hard_clearance_m),
        )
        alone = Planner(one, 0.15, FENCE).plan((0.0, 0.0), (6.0, 6.0), hits)
        if isinstance(alone, Plan):
            costs.append((alone.length_m * config.level_penalty**number, keep_out))
    if isinstance(plan, NoPlan):
        assert not costs
        return
    cost, _ = min(costs)
    number = together.keep_outs_m.index(plan.keep_out_m)
    assert plan.length_m * config.level_penalty**number == pytest.approx(cost, abs=1e-9)


@settings(deadline=None, max_examples=40)
@given(seeds, st.floats(0.9, 1.1), st.integers(0, 40))
def test_seeds_and_limits_change_no_answer(seed: int, share: float, seeded: int) -> None:
    hits = walls(seed)
    discs = Discs.of(hits, np.full(len(hits), KEEP_OUT_M))
    start, goal = (-0.5, -0.5), (6.5, 6.5)
    free = route_among(start, goal, discs)
    assert isinstance(free, Route)
    rng = np.random.default_rng(seed)
    given_discs = rng.permutation(len(hits))[:seeded].astype(np.int64)
    helped = route_among(start, goal, discs, seeds=given_discs)
    assert isinstance(helped, Route)
    assert helped.length_m == pytest.approx(free.length_m, abs=1e-6)
    limit = share * free.length_m
    limited = route_among(start, goal, discs, NO_PLANES, 400, NO_SEEDS, limit)
    if len(free.pieces) == 1 or limit > free.length_m + 1e-9:
        assert limited == free
    elif limit < free.length_m - 1e-9:
        assert isinstance(limited, NoRoute)
        assert limited.reason is NoRouteReason.BEATEN


# ---------------------------------------------------------------- what free space does not meet


@settings(deadline=None, max_examples=25)
@given(seeds, st.integers(60, 160))
def test_among_dense_clusters_the_route_is_the_shortest(seed: int, count: int) -> None:
    hits = cluster(seed, count)
    radii = np.full(count, KEEP_OUT_M)
    start, goal = (0.0, 0.0), (5.0, 5.0)
    found = route_among(start, goal, Discs.of(hits, radii))
    assert isinstance(found, Route)
    # Brute force over the discs of the border alone: those wholly inside others bar nothing more.
    border = np.array(
        [
            k
            for k in range(count)
            if any(
                np.hypot(*(hits - hits[k] - KEEP_OUT_M * np.array((math.cos(a), math.sin(a)))).T)
                .min()
                .item()
                > KEEP_OUT_M - 1e-9
                for a in np.linspace(0.0, math.tau, 720)
            )
        ]
    )
    if border.shape[0] <= 45:
        expected = shortest_length(start, goal, hits[border], radii[border])
        assert found.length_m == pytest.approx(expected, abs=5e-4)
    for piece in found.pieces:
        ends = piece.polyline(1e-4) if isinstance(piece, Arc) else (piece.start, piece.end)
        assert kernels.path_clearance(np.array(ends), hits) > KEEP_OUT_M - 1e-5


@pytest.mark.parametrize("gap_m", [0.0, 0.42])
def test_a_dense_ring_is_closed_unless_it_has_a_door(gap_m: float) -> None:
    rng = np.random.default_rng(5)
    turn = np.arange(0.5 * gap_m / 1.5, math.tau - 0.5 * gap_m / 1.5, 0.012)
    ring = np.stack((3.0 + 1.5 * np.cos(turn), 3.0 + 1.5 * np.sin(turn)), axis=1)
    hits = np.concatenate((ring, rng.uniform(5.2, 6.0, (60, 2))))
    discs = Discs.of(hits, np.full(len(hits), KEEP_OUT_M))
    found = route_among((3.0, 3.0), (0.0, 0.0), discs)
    if gap_m:
        assert isinstance(found, Route)
        return
    assert isinstance(found, NoRoute)
    assert found.reason is NoRouteReason.CLOSED
    # The certificate closes the way by itself: its discs leave no gap round the start.
    closing = hits[list(found.certificate)]
    bearings = np.sort(np.arctan2(closing[:, 1] - 3.0, closing[:, 0] - 3.0))
    near = closing[np.hypot(*(closing - 3.0).T) < 1.6]
    assert len(near) > 10
    assert np.diff(bearings).max() < 0.4


# ---------------------------------------------------------------- the index


@settings(deadline=None, max_examples=60)
@given(seeds, st.integers(0, 80), st.floats(0.1, 40.0), st.floats(0.01, 3.0))
def test_the_index_finds_what_all_pairs_find(
    seed: int, count: int, side_m: float, within_m: float
) -> None:
    rng = np.random.default_rng(seed)
    points = rng.uniform(-side_m, side_m, (count, 2))
    squares = kernels.into_squares(points, 0.0)
    assert sorted(squares[2].tolist()) == list(range(count))
    for _ in range(8):
        at = rng.uniform(-1.5 * side_m, 1.5 * side_m, 2)
        to = rng.uniform(-1.5 * side_m, 1.5 * side_m, 2)
        away = np.hypot(*(points - at).T)
        near = kernels.points_near(points, squares, at[0], at[1], within_m)
        assert sorted(near.tolist()) == np.flatnonzero(away < within_m).tolist()
        for a, b in ((at, to), (at, at), (at, np.array((at[0], to[1]))), (at, (to[0], at[1]))):
            path = np.array((a, b))
            clear = kernels.path_clearance(path, points) >= within_m
            free = kernels.segment_is_free(points, squares, within_m, *path.ravel())
            assert free == clear or abs(kernels.path_clearance(path, points) - within_m) < 1e-9


@settings(deadline=None, max_examples=60)
@given(seeds, st.integers(1, 25))
def test_the_nearest_exit_is_the_nearest_of_a_fine_grid(seed: int, count: int) -> None:
    rng = np.random.default_rng(seed)
    points = rng.uniform(-0.35, 0.35, (count, 2))
    points[0] *= 0.4  # too near: there is something to leave
    squares = kernels.into_squares(points, 0.0)
    found, north, east = kernels.nearest_exit(points, squares, KEEP_OUT_M, 0.0, 0.0, 1.0, 0)
    grid = np.stack(np.meshgrid(*[np.linspace(-0.8, 0.8, 161)] * 2), axis=-1).reshape(-1, 2)
    free = np.ones(len(grid), dtype=bool)
    for point in points:
        free &= np.hypot(*(grid - point).T) >= KEEP_OUT_M + 1e-6
    best = np.hypot(*grid[free].T).min()
    assert found
    assert np.hypot(*(points - (north, east)).T).min() >= KEEP_OUT_M
    assert math.hypot(north, east) <= best + 1e-9
