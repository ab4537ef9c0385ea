from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from autonomy.geometry import Point, polyline_length
from autonomy.t3drm import kernels
from autonomy.t3drm.geodesic import Closed, GeodesicPath, closing_hits, geodesic
from autonomy.t3drm.spherical import Route, shortest_path

Floats = NDArray[np.float64]
KEEP_OUT_M = 0.2
SQUARE = np.array(((-1.0, -1.0), (5.0, -1.0), (5.0, 5.0), (-1.0, 5.0)))


def wall(a: Point, b: Point, step_m: float = 0.05) -> Floats:
    count = int(np.hypot(b[0] - a[0], b[1] - a[1]) / step_m) + 1
    return np.stack((np.linspace(a[0], b[0], count), np.linspace(a[1], b[1], count)), axis=1)


def solve(
    start: Point, goal: Point, hits: Floats, polygon: Floats = SQUARE, *, convex: bool = True
) -> GeodesicPath | Closed:
    return geodesic(start, goal, hits, KEEP_OUT_M, polygon, 0.05, convex=convex)


@settings(deadline=None, max_examples=40)
@given(st.integers(0, 2**32 - 1), st.integers(0, 60))
def test_the_geodesic_keeps_out_and_is_hardly_longer_than_the_exact_path(
    seed: int, count: int
) -> None:
    hits = np.random.default_rng(seed).uniform(0.0, 4.0, (count, 2))
    start, goal = (-0.5, -0.5), (4.5, 4.5)
    found = solve(start, goal, hits)
    exact = shortest_path(start, goal, hits, np.full(count, KEEP_OUT_M))
    assert isinstance(exact, Route)
    assert isinstance(found, GeodesicPath)
    assert found.points[0] == start
    assert found.points[-1] == goal
    assert kernels.path_clearance(np.array(found.points), hits) >= KEEP_OUT_M - 1e-12
    length = polyline_length(found.points)
    assert exact.length_m - 1e-6 <= length <= 1.25 * exact.length_m


def test_in_sight_the_geodesic_is_the_straight_line() -> None:
    found = solve((0.0, 0.0), (4.0, 4.0), np.array([(0.0, 4.0)]))
    assert found == GeodesicPath(((0.0, 0.0), (4.0, 4.0)))


def test_a_wall_across_the_fence_closes_the_way_and_is_the_evidence() -> None:
    across = wall((2.0, -1.0), (2.0, 5.0))
    island = np.array([(0.8, 3.0)])
    hits = np.concatenate((across, island))
    found = solve((0.0, 0.0), (4.0, 0.0), hits)
    assert isinstance(found, Closed)
    assert set(found.evidence) == set(range(len(across)))
    assert set(closing_hits((0.0, 0.0), (4.0, 0.0), hits, KEEP_OUT_M, SQUARE, 0.05)) == set(
        found.evidence
    )


def test_the_evidence_is_the_ring_around_the_goal_not_the_room_around_everything() -> None:
    turn = np.linspace(0.0, 2.0 * np.pi, 60, endpoint=False)
    ring = np.stack((3.0 + 0.7 * np.cos(turn), 3.0 + 0.7 * np.sin(turn)), axis=1)
    room = np.concatenate((wall((-0.8, -0.8), (4.8, -0.8)), wall((-0.8, 4.8), (4.8, 4.8))))
    found = solve((0.0, 0.0), (3.0, 3.0), np.concatenate((ring, room)))
    assert isinstance(found, Closed)
    assert set(found.evidence) == set(range(60))


def test_a_fence_that_is_not_convex_is_not_cut_across() -> None:
    notch = np.array(((0.0, 0.0), (4.0, 0.0), (4.0, 4.0), (2.0, 0.5), (0.0, 4.0)))
    found = solve((0.3, 3.0), (3.7, 3.0), np.empty((0, 2)), notch, convex=False)
    assert isinstance(found, GeodesicPath)
    for a, b in pairwise(found.points):
        assert kernels.path_is_inside(np.array((a, b)), notch, notch)
    assert min(e for _, e in found.points) < 0.5


def test_a_door_of_the_promised_width_is_passed() -> None:
    # 2 r_min + 0.06 m
    hits = np.concatenate((wall((2.0, -1.0), (2.0, 1.77)), wall((2.0, 2.23), (2.0, 5.0))))
    found = solve((0.0, 0.0), (4.0, 4.0), hits)
    assert isinstance(found, GeodesicPath)


def test_start_and_goal_need_not_lie_in_free_cells() -> None:
    hits = np.array([(0.0, 0.2001), (1.0, 0.0), (2.0, 0.2001)])
    found = solve((0.0, 0.0), (2.0, 0.0), hits)
    assert isinstance(found, GeodesicPath)
    assert kernels.path_clearance(np.array(found.points), hits) >= KEEP_OUT_M - 1e-12


def test_without_hits_nothing_bars_the_way() -> None:
    assert closing_hits((0.0, 0.0), (1.0, 0.0), np.empty((0, 2)), 0.2, SQUARE, 0.05) == ()


@pytest.mark.parametrize("cell_m", [0.1, 0.025])
def test_the_cell_does_not_change_what_is_kept_out(cell_m: float) -> None:
    hits = np.random.default_rng(7).uniform(0.0, 4.0, (40, 2))
    found = geodesic((-0.5, -0.5), (4.5, 4.5), hits, KEEP_OUT_M, SQUARE, cell_m)
    assert isinstance(found, GeodesicPath)
    assert kernels.path_clearance(np.array(found.points), hits) >= KEEP_OUT_M - 1e-12
