"""TangentBug: by the local tangent graph while that leads nearer, else along the boundary.

Kamon, Rimon and Rivlin, "TangentBug: a range-sensor-based navigation algorithm" (IJRR 17(9), 1998).
It assumes a range finder that sees all round at once and exactly; here the range profile is that of
the map's hits within the beams' range, grown by the keep-out, so what no beam has swept yet counts
as free. The two distances that end boundary following (d_followed, d_reach) are measured at the
ends of the profile's rays, the second one at those alone that meet nothing. A round that closes
proves that there is no way.
"""

import math

import msgspec
import numpy as np

from autonomy.geometry import Point, along, bearing, distance
from hal.frames import wrap_pi
from tools.bench.rivals import kernels
from tools.bench.rivals.boundary import Boundary
from tools.bench.rivals.interface import Answer, Craft, Floats, GivesUp, View, towards

_JUMP_M = 0.2
"""Two neighbouring rays whose lengths differ by more have an obstacle's edge between them."""
_STEP = 2.0 * math.pi / kernels.BEARINGS
_THERE_M = 0.1


class Gains(msgspec.Struct, frozen=True):
    """Chosen by `tuning.py`: how far beyond the keep-out to fly, by how much the way may seem to
    grow before that counts as a local minimum, and how much nearer (m) a place must be to leave.
    """

    margin_m: float = 0.01
    grows_m: float = 0.15
    leave_m: float = 0.05


class Edge(msgspec.Struct, frozen=True):
    """A node of the local tangent graph: the bearing just past it, and the way by it."""

    bearing_rad: float
    cost_m: float
    side: int


class TangentBug:
    """One flight: to the goal, along a boundary, or from there to the place that was nearer."""

    def __init__(self, craft: Craft, gains: Gains | None = None) -> None:
        self._craft, self._gains = craft, gains if gains is not None else Gains()
        self._boundary: Boundary | None = None
        self._best_m = math.inf
        self._followed_m = math.inf
        self._leave_to: Point | None = None
        self._before_rad: float | None = None

    def decide(self, view: View) -> Answer:
        """Along the tangent graph or a boundary; gives up when a round closes."""
        n, e = view.point
        keep_out_m = self._craft.keep_out_m + self._gains.margin_m
        free = kernels.profile(view.near, n, e, keep_out_m, self._craft.range_m)
        if self._boundary is not None:
            return self._follow(view, free, self._boundary)
        if self._leave_to is not None:
            bearing_rad = self._leaving(view, free, self._leave_to)
            if bearing_rad is not None:
                return towards(bearing_rad, self._craft.speed_m_s)
        return self._to_goal(view, free)

    def _to_goal(self, view: View, free: Floats) -> Answer:
        goal, away_m = bearing(view.point, view.goal), distance(view.point, view.goal)
        if self._is_free(view, goal, min(away_m, self._craft.range_m)):
            self._best_m = min(self._best_m, away_m)
            self._before_rad = goal
            return towards(goal, self._craft.speed_m_s)
        nodes = edges(free, view, self._craft.range_m)
        best = min(nodes, key=self._dearness, default=None)
        if best is not None and best.cost_m <= self._best_m + self._gains.grows_m:
            self._best_m = min(self._best_m, best.cost_m)
            self._before_rad = best.bearing_rad
            return towards(best.bearing_rad, self._craft.speed_m_s)
        side = best.side if best is not None else 1
        self._boundary = Boundary(view.point, goal, side)
        self._followed_m = math.inf
        return self._follow(view, free, self._boundary)

    def _dearness(self, node: Edge) -> float:
        """Of two nodes as good as each other the one flown to before is kept."""
        before = self._before_rad
        turn = 0.0 if before is None else abs(wrap_pi(node.bearing_rad - before))
        return node.cost_m + 0.1 * turn

    def _follow(self, view: View, free: Floats, boundary: Boundary) -> Answer:
        ends = _ends(free, view.point)
        gaps = np.hypot(ends[:, 0] - view.goal[0], ends[:, 1] - view.goal[1])
        goal, away_m = bearing(view.point, view.goal), distance(view.point, view.goal)
        own = followed(free, boundary.wall_rad, self._craft.range_m)
        if own:
            self._followed_m = min(self._followed_m, float(gaps[own].min()))
        seen = away_m <= self._craft.range_m and self._is_free(view, goal, away_m)
        nearest = _nearest_open(free, gaps, self._craft.range_m)
        reach_m = 0.0 if seen else math.inf if nearest is None else float(gaps[nearest])
        if reach_m < self._followed_m - self._gains.leave_m:
            self._boundary = None
            self._leave_to = view.goal if seen or nearest is None else _point(ends[nearest])
            self._best_m = math.inf
            return towards(bearing(view.point, self._leave_to), self._craft.speed_m_s)
        bearing_rad = boundary.step(view, free)
        if boundary.closed:
            return GivesUp("the way round the obstacle came back to where it began", certain=True)
        if bearing_rad is None:
            return (0.0, 0.0)
        return towards(bearing_rad, self._craft.speed_m_s)

    def _leaving(self, view: View, free: Floats, place: Point) -> float | None:
        """On to the place that was nearer than the boundary; None once that has been used."""
        to = bearing(view.point, place)
        gap_m = distance(view.point, place)
        nearer = distance(view.point, view.goal) < self._followed_m - self._gains.leave_m
        if gap_m <= _THERE_M or nearer or free[round(to / _STEP) % kernels.BEARINGS] < _THERE_M:
            self._leave_to, self._best_m, self._before_rad = None, math.inf, None
            return None
        return to

    def _is_free(self, view: View, bearing_rad: float, length_m: float) -> bool:
        keep_out_m = self._craft.keep_out_m + self._gains.margin_m
        un, ue = math.cos(bearing_rad), math.sin(bearing_rad)
        n, e = view.point
        reached_m: float = kernels.way_free(view.near, n, e, un, ue, keep_out_m, length_m)
        return reached_m >= length_m


def edges(free: Floats, view: View, range_m: float) -> list[Edge]:
    """The nodes of the local tangent graph in a profile."""
    count = len(free)
    found = []
    jumps = np.nonzero(np.abs(free - np.roll(free, -1)) > _JUMP_M)[0]
    for k in jumps.tolist():
        j = (k + 1) % count
        # The ray that goes on is past the edge, the one that stops before it.
        onward, stopped, side = (j, k, 1) if free[j] > free[k] else (k, j, -1)
        length_m = min(range_m, max(float(free[stopped]), _THERE_M))
        node = along(view.point, onward * _STEP, length_m)
        found.append(Edge(onward * _STEP, length_m + distance(node, view.goal), side))
    return found


def followed(free: Floats, wall_rad: float, range_m: float) -> list[int]:
    """Rays that meet the obstacle that one at `wall_rad` meets: no edge lies in between."""
    count = len(free)
    first = round(wall_rad / _STEP) % count
    found = [first] if free[first] < range_m else []
    for way in (1, -1):
        k = first
        while found and len(found) < count:
            onward = (k + way) % count
            if free[onward] >= range_m or abs(free[onward] - free[k]) > _JUMP_M:
                break
            found.append(onward)
            k = onward
    return found


def _ends(free: Floats, point: Point) -> Floats:
    """(n, 2) where the profile's rays end."""
    angles = np.arange(len(free)) * _STEP
    return np.column_stack((point[0] + free * np.cos(angles), point[1] + free * np.sin(angles)))


def _nearest_open(free: Floats, gaps: Floats, range_m: float) -> int | None:
    """The ray that meets nothing and ends nearest to the goal (`gaps`); None without any.

    Rays that end on obstacles do not count: beside a wall many of them end on that wall, with
    jumps in between that are no edges.
    """
    open_rays = np.nonzero(free >= range_m)[0]
    if not len(open_rays):
        return None
    return int(open_rays[int(gaps[open_rays].argmin())])


def _point(row: Floats) -> Point:
    return (float(row[0]), float(row[1]))
