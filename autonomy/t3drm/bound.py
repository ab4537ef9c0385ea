"""How long a flight may get: TangentBug's bound on path length, from the obstacles that were met.

Kamon, Rimon and Rivlin (TangentBug, 1998) bound the path of a robot with a range sensor by

    L <= d(S, G) + sum_i m_i p_i

over the obstacles i that it meets, with perimeters p_i and m_i >= 1 local minima of the distance to
the goal along each. Here the vehicle's centre moves outside keep-out discs around hits, so p_i is
the length of the boundary of component i's discs, inside the fence; and what is computed and
checked on every flight is the sharper

    L <= sum over stretches [ d(start, goal) + sum_i p_i ]                        (m_i = 1)

where a stretch is a part of the flight with one goal, at one height, on a map that only grew: a new
one begins at every goal, at every change of height (other obstacles), and at every plan found after
there was none (what was known was forgotten then).

Why it holds. T3DRM flies the shortest path c_k through what is known at replan k and takes the
unknown for free. Along a path its length is used up one for one, so that a stretch has

    L = c_0 + sum_k [c_k(x_k) - c_(k-1)(x_k)] - (what was left at the end)

with c_0 = d(start, goal) while nothing is known. Let an obstacle's end, believed to be at boundary
length b, turn out to be at b'. The path round it has farther to go to that end, by b' - b at most,
and farther back behind it, by b' - b at most: no bracket is larger than the boundary that became
known, on both sides, and the brackets of an obstacle sum to p_i at most. Taking another side for
being shorter only lowers a bracket; keeping one for a while (mission.replan.side_hysteresis_m) is
the same sum along that side. No bound can be smaller for all worlds: who cannot see the end of a
long wall, right before the goal, may have to go all along it and back.

Assumptions: static obstacles; hits that stay; an obstacle is known from where it was met outwards.
Where two obstacles turn out to be one and close a gap that a path was planned through (a dead end),
a bracket may be as large as half of the joined perimeter, once for each such gap: that is what m_i
is for, and 1 is not proven then. Noise adds what `TRACKING` and `SETTLING_M` allow for.
"""

import msgspec
import numpy as np

from autonomy.geometry import Point, distance
from autonomy.model import NoPlan, ObstacleKind, Plan
from autonomy.t3drm import kernels
from autonomy.t3drm.classification import Linkage
from autonomy.t3drm.kernels import Floats
from autonomy.t3drm.sides import SAME_GOAL_M, STILL_THERE_M, hits_of
from hal.config import Fence

TRACKING = 1.05
"""A path flown with noise is this much longer than the one that was planned, at most ..."""
SETTLING_M = 0.25
"""... and drifting while the vehicle climbs, looks round and lands adds no more than this."""
MET_WITHIN_M = 0.05
"""A path that comes nearer to a hit than the keep-out radius and this has met its obstacle; so has
one that comes as near to the sphere round a discrete one, which may lie well off its hits."""


class PathBound(msgspec.Struct, frozen=True):
    """The bound of one flight, and what it is made of. Lengths in metres.

    `bound_m` is TRACKING (straight_m + perimeter_m) + SETTLING_M: `straight_m` sums d(start, goal)
    over the stretches, `perimeter_m` the perimeters of the obstacles that each of them met.
    """

    bound_m: float
    straight_m: float
    perimeter_m: float
    stretches: int

    def holds(self, path_length_m: float) -> bool:
        """True when a path of this length keeps the bound."""
        return path_length_m <= self.bound_m


class BoundTally:
    """Fed with every result of planning of one flight, in order."""

    def __init__(self) -> None:
        self._stretches: list[_Stretch] = []
        self._open = False

    def planned(self, distance_to_go_m: float, result: Plan | NoPlan) -> None:
        """A planning step's result, that far (straight) from the goal."""
        if isinstance(result, NoPlan):
            self._open = False
            return
        if not self._open or not self._stretches[-1].goes_on_with(result):
            self._stretches.append(_Stretch(distance_to_go_m))
            self._open = True
        self._stretches[-1].add(result)

    def bound(self, keep_out_m: float, fence: Fence) -> PathBound:
        """The bound for what was planned so far; `keep_out_m` is the comfortable one, Eq. 2's r0.

        Inside the fence only; O(hits^2) with a small factor: for the end of a flight.
        """
        straight_m = sum(stretch.straight_m for stretch in self._stretches)
        perimeter_m = sum(s.perimeter_m(keep_out_m, fence) for s in self._stretches)
        bound_m = TRACKING * (straight_m + perimeter_m) + SETTLING_M
        return PathBound(bound_m, straight_m, perimeter_m, len(self._stretches))


class _Stretch:
    """The plans to one goal at one height on one growing map."""

    def __init__(self, straight_m: float) -> None:
        self.straight_m = straight_m
        self._paths: list[tuple[Point, ...]] = []
        self._hits: Floats = np.empty((0, 2))
        self._rounded: list[Point] = []
        self._height_m: float | None = None

    def goes_on_with(self, plan: Plan) -> bool:
        """True when the plan has the goal and the height of those before."""
        same_goal = distance(plan.points[-1], self._paths[-1][-1]) <= SAME_GOAL_M
        return same_goal and plan.height_m == self._height_m

    def add(self, plan: Plan) -> None:
        """One more plan; its hits are those before and more."""
        self._paths.append(plan.points)
        self._height_m = plan.height_m
        self._hits = hits_of(plan)
        path = np.array(plan.points)
        for obstacle in plan.obstacles:
            reach_m = obstacle.radius_m + plan.keep_out_m + MET_WITHIN_M
            discrete = obstacle.kind is ObstacleKind.DISCRETE
            if discrete and kernels.path_clearance(path, np.array((obstacle.centre,))) < reach_m:
                self._rounded.append(obstacle.hits[0])

    def perimeter_m(self, keep_out_m: float, fence: Fence) -> float:
        """The perimeters of the components that one of the paths came near."""
        hits = self._hits
        if hits.shape[0] == 0:
            return 0.0
        labels, count = Linkage.of(hits).labels(keep_out_m)
        near = np.zeros(hits.shape[0], dtype=np.uint8)
        for path in self._paths:
            kernels.mark_near(np.array(path), hits, keep_out_m + MET_WITHIN_M, near)
        for north, east in self._rounded:
            kernels.mark_near(np.array(((north, east),) * 2), hits, STILL_THERE_M, near)
        met = np.zeros(count, dtype=np.bool_)
        met[labels[near != 0]] = True
        return float(exposed_m(hits, keep_out_m, fence)[met[labels]].sum())


def exposed_m(centres: Floats, radius_m: float, fence: Fence) -> Floats:
    """(n,) how much of each circle's circumference lies in no other disc and inside the fence.

    All discs have the same radius. Summed over a component it is its perimeter, holes' too.
    """
    polygon = np.array(fence.outline_ne_m, dtype=np.float64)
    return np.asarray(radius_m * kernels.exposed_arcs(centres, radius_m, polygon))
