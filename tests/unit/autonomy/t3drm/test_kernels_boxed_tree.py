"""The spanning tree of many points: against Prim's algorithm and scipy, wherever the points lie."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse.csgraph import minimum_spanning_tree
from scipy.spatial.distance import pdist, squareform

from autonomy.t3drm import kernels
from autonomy.t3drm.kernels import Floats


def assert_is_a_shortest_tree(points: Floats) -> None:
    """A tree grown from the first point in Prim's order, with lengths as Prim's to the bit."""
    order, parent, gap = kernels.boxed_tree(points)
    if len(points) > 0:
        # Found by the boxes, not by falling back on Prim's algorithm.
        edges = kernels._edges_of_boxes(points[kernels._along_z(points)])
        assert edges.shape == (len(points) - 1, 2)
    assert sorted(order.tolist()) == list(range(len(points)))
    assert order[:1].tolist() == [0][: len(points)]
    place = {point: at for at, point in enumerate(order.tolist())}
    for point in order.tolist()[1:]:
        joined = int(parent[point])
        assert place[joined] < place[point]
        north, east = (points[point] - points[joined]).tolist()
        assert gap[point] == math.sqrt(north * north + east * east)
    for waiting in range(2, len(points)):
        joiner, later = order[waiting - 1], order[waiting:]
        adjacent = [place[int(parent[k])] < waiting - 1 for k in later]
        # Nobody who could have joined was nearer than the one that did.
        assert not np.any(gap[later[adjacent]] < gap[joiner])
    expected = kernels.prim_tree(points)
    assert np.sort(gap).tolist() == np.sort(expected[2]).tolist()
    pairs = np.sort(pdist(points)) if len(points) > 1 else np.ones(1)
    if np.all(np.diff(pairs) > 1e-9 * pairs[1:]):
        # No two pairs are equally far apart: there is one shortest tree only.
        assert order.tolist() == expected[0].tolist()
        assert parent.tolist() == expected[1].tolist()


def spread(seed: int, count: int) -> Floats:
    return np.random.default_rng(seed).uniform(-20.0, 30.0, (count, 2))


def walls(seed: int, count: int) -> Floats:
    rng = np.random.default_rng(seed)
    at, turn = np.arange(0.0, 2.0, 0.025), rng.uniform(0.0, math.tau, (count, 1))
    rows = [rng.uniform(0.0, 8.0, 2) + np.outer(at, (math.cos(t), math.sin(t))) for (t,) in turn]
    return np.concatenate(rows) + rng.normal(0.0, 0.004, (count * at.shape[0], 2))


def grid(rows: int, columns: int, side: float) -> Floats:
    return np.array([(side * r, side * c) for r in range(rows) for c in range(columns)])


def far_apart(seed: int, count: int, distance: float) -> Floats:
    points = np.random.default_rng(seed).normal(0.0, 1.0, (count, 2))
    points[count // 3 :] += distance
    return points


MAPS = {
    "nothing": np.empty((0, 2)),
    "one point": np.array(((3.0, 4.0),)),
    "two points": np.array(((3.0, 4.0), (0.0, 0.0))),
    "one place": np.full((40, 2), 2.5),
    "two places": np.repeat(np.array(((1.0, 2.0), (4.0, 6.0))), 30, axis=0),
    "few places": np.random.default_rng(1).integers(0, 5, (150, 2)).astype(np.float64),
    "spread": spread(2, 150),
    "walls": walls(3, 2),
    "grid": grid(9, 15, 0.05),
    "to the north": grid(90, 1, 0.1),
    "to the east": grid(1, 90, 0.1),
    "slanting": np.outer(np.arange(70.0), (0.03, 0.04)),
    "two far clusters": far_apart(4, 120, 1e4),
    "farther than squares tell": far_apart(5, 120, 1e9),
    "tiny": 1e-12 * spread(6, 80),
    "a ring round a point": np.array(
        [(0.0, 0.0), *((math.cos(0.1 * k), math.sin(0.1 * k)) for k in range(63))]
    ),
}


@pytest.mark.parametrize("name", MAPS)
def test_the_tree_of_boxes_is_as_short_as_prims(name: str) -> None:
    assert_is_a_shortest_tree(MAPS[name])


coordinate = st.one_of(st.integers(-4, 4).map(float), st.floats(-1e3, 1e3), st.floats(-1e-6, 1e-6))


@settings(deadline=None, max_examples=80)
@given(st.lists(st.tuples(coordinate, coordinate), max_size=60))
def test_the_tree_of_boxes_is_as_short_wherever_the_points_lie(
    rows: list[tuple[float, float]],
) -> None:
    assert_is_a_shortest_tree(np.array(rows, dtype=np.float64).reshape(-1, 2))


def test_scipy_finds_no_shorter_tree_of_many() -> None:
    points = np.concatenate((walls(7, 2), spread(8, 60)))
    _, _, gap = kernels.boxed_tree(points)
    expected = minimum_spanning_tree(squareform(pdist(points))).data
    assert np.sort(gap)[:-1] == pytest.approx(np.sort(expected), rel=1e-12)


def test_the_same_points_have_the_same_tree() -> None:
    points = grid(12, 11, 0.1)
    for first, again in zip(
        kernels.boxed_tree(points), kernels.boxed_tree(points.copy()), strict=True
    ):
        assert first.tolist() == again.tolist()
