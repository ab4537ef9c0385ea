"""The yardstick: the exact shortest path, over the whole tangent graph.

Every common tangent of every pair of discs, every free arc between touching points, A* over all of
it. Complete and simple where autonomy.t3drm is lazy; written apart from it (tangents from angles,
arcs cut where circles meet) so that the two can only agree by being right. A convex rectangle has
no corner that a shortest path bends round, so it only takes tangents and arcs away.
"""

import math

import numpy as np
from numpy.typing import NDArray

from tools.bench.baselines import kernels
from tools.bench.baselines.interface import Answer, Floats, box_of, discs_of, timed
from tools.bench.maps import Map

Ints = NDArray[np.int64]
STEP_RAD = 2e-3
"""Arcs are handed on as circumscribed polylines: longer by 1e-6 of their length or less."""


class ExactOptimum:
    """The shortest path, to a micrometre. O(n^3) in the worst case."""

    name = "exact optimum"

    def plan(self, problem: Map) -> Answer:
        """None when start and goal are parted."""
        discs, box = discs_of(problem), box_of(problem)
        return timed(lambda: shortest(problem, discs, box))


def shortest(problem: Map, discs: Floats, box: Floats) -> tuple[bool, Floats]:
    """(found, path) of the exact shortest path; discs: rows (north, east, reach)."""
    ends = np.array(((*problem.start, 0.0), (*problem.goal, 0.0)))
    circles = np.concatenate((ends, _without_contained(discs)))
    near = kernels.neighbours(circles)
    tangents = kernels.free_tangents(circles, near, box)
    touching = tangents.reshape(-1, 2)
    # Start and goal are nodes 0 and 1, whatever the angle at which a tangent leaves them.
    places = np.concatenate((((0.0, 0.0), (1.0, 0.0)), touching, kernels.cuts(circles, near, box)))
    number = np.arange(2, touching.shape[0] + 2)
    on_end = touching[:, 0] < 2
    number[on_end] = touching[on_end, 0].astype(np.int64)
    pairs = number.reshape(-1, 2)
    points = circles[places[:, 0].astype(np.int64)]
    points = points[:, :2] + points[:, 2:] * np.column_stack(
        (np.cos(places[:, 1]), np.sin(places[:, 1]))
    )
    order = np.lexsort((places[:, 1], places[:, 0]))
    arcs = kernels.free_arcs(places, order, circles, near, box)
    radii = circles[places[:, 0].astype(np.int64), 2]
    arc_ends = arcs[:, :2].astype(np.int64)
    origin = np.concatenate((pairs[:, 0], pairs[:, 1], arc_ends[:, 0], arc_ends[:, 1]))
    to = np.concatenate((pairs[:, 1], pairs[:, 0], arc_ends[:, 1], arc_ends[:, 0]))
    straight = np.hypot(*(points[pairs[:, 0]] - points[pairs[:, 1]]).T)
    around = radii[arc_ends[:, 0]] * arcs[:, 2]
    cost = np.concatenate((straight, straight, around, around))
    none = np.zeros(2 * pairs.shape[0])
    sweep = np.concatenate((none, arcs[:, 2], -arcs[:, 2]))
    by_origin = np.argsort(origin, kind="stable")
    first = np.searchsorted(origin[by_origin], np.arange(places.shape[0] + 1))
    bound = np.hypot(*(points - points[1]).T)
    found, taken = kernels.cheapest(first, to[by_origin], cost[by_origin], bound, 0, 1)
    if not found:
        return False, np.empty((0, 2))
    edges = by_origin[taken]
    return True, _polyline(circles, places, points, origin[edges], to[edges], sweep[edges])


def _without_contained(discs: Floats) -> Floats:
    """Discs that lie in a larger one bar nothing that it does not; of equal ones one is kept."""
    largest_first = discs[np.argsort(-discs[:, 2], kind="stable")]
    kept = np.ones(largest_first.shape[0], dtype=bool)
    for k in range(largest_first.shape[0]):
        away = np.hypot(*(largest_first[:k, :2] - largest_first[k, :2]).T)
        inside = away + largest_first[k, 2] <= largest_first[:k, 2] + 1e-9
        kept[k] = not bool((inside & kept[:k]).any())
    return largest_first[kept]


def _polyline(
    circles: Floats, places: Floats, points: Floats, origin: Ints, to: Ints, sweep: Floats
) -> Floats:
    """The edges' corners; arcs circumscribed, so that no chord enters a disc."""
    corners: list[tuple[float, float]] = [tuple(points[0].tolist())]
    for a, b, turn in zip(origin.tolist(), to.tolist(), sweep.tolist(), strict=True):
        if turn != 0.0:
            n, e, radius = circles[int(places[a, 0])].tolist()
            steps = max(1, math.ceil(abs(turn) / STEP_RAD))
            outer = radius / math.cos(0.5 * turn / steps)
            angles = places[a, 1] + (np.arange(steps) + 0.5) * (turn / steps)
            corners.extend(
                zip((n + outer * np.cos(angles)), (e + outer * np.sin(angles)), strict=True)
            )
        corners.append(tuple(points[b].tolist()))
    return np.array(corners)
