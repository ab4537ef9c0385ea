"""Bug2: along the line from start to goal; round what is met, until nearer to the goal on the line.

Lumelsky and Stepanov, "Path-planning strategies for a point mobile automaton moving amidst unknown
obstacles of arbitrary shape" (Algorithmica 2, 1987). Its automaton feels obstacles by touch and
knows its place exactly; here an obstacle is "touched" at the keep-out plus the clearance below, as
seen from afar, and the line is met to within centimetres. Always turns the same way. A round that
closes proves that there is no way, as far as gaps that were taken for closed really are.
"""

import math

import msgspec

from autonomy.geometry import Point, bearing, distance
from tools.bench.rivals import kernels
from tools.bench.rivals.boundary import REACH_M, Boundary
from tools.bench.rivals.interface import Answer, Craft, GivesUp, View, towards

_NEARER_M = 0.05
"""By so much nearer to the goal than where it was met an obstacle is left."""
_LEAVES_M = 0.2
"""So much of the way to the goal must be free where an obstacle is left."""


class Gains(msgspec.Struct, frozen=True):
    """Chosen by `tuning.py`: how far beyond the keep-out to fly; which way to turn (1: right)."""

    margin_m: float = 0.01
    side: int = 1


class Bug2:
    """One flight: to the goal, or along a boundary."""

    def __init__(self, craft: Craft, gains: Gains | None = None) -> None:
        self._craft, self._gains = craft, gains if gains is not None else Gains()
        self._start: Point | None = None
        self._boundary: Boundary | None = None
        self._met_at_m = math.inf
        self._off_m = 0.0

    def decide(self, view: View) -> Answer:
        """Along the line or the boundary; gives up when a round closes."""
        if self._start is None:
            self._start = view.point
        keep_out_m = self._craft.keep_out_m + self._gains.margin_m
        n, e = view.point
        free = kernels.profile(view.near, n, e, keep_out_m, _LEAVES_M)
        goal, away_m = bearing(view.point, view.goal), distance(view.point, view.goal)
        ahead_m = kernels.way_free(
            view.near, n, e, math.cos(goal), math.sin(goal), keep_out_m, min(_LEAVES_M, away_m)
        )
        crossed = self._crosses_line(view)
        if self._boundary is None:
            if ahead_m >= min(REACH_M, away_m):
                return towards(goal, self._craft.speed_m_s)
            self._met_at_m = away_m
            self._boundary = Boundary(view.point, goal, self._gains.side)
        elif crossed and away_m < self._met_at_m - _NEARER_M and ahead_m >= min(_LEAVES_M, away_m):
            self._boundary = None
            return towards(goal, self._craft.speed_m_s)
        along = self._boundary.step(view, free)
        if self._boundary.closed:
            return GivesUp("the way round the obstacle came back to where it began", certain=True)
        if along is None:
            return (0.0, 0.0)
        return towards(along, self._craft.speed_m_s)

    def _crosses_line(self, view: View) -> bool:
        """True at the tick that the vehicle comes to the other side of the line, or on it."""
        start = self._start if self._start is not None else view.point
        line_n, line_e = view.goal[0] - start[0], view.goal[1] - start[1]
        length = max(math.hypot(line_n, line_e), 1e-6)
        before_m = self._off_m
        self._off_m = (
            line_n * (view.point[1] - start[1]) - line_e * (view.point[0] - start[0])
        ) / length
        return before_m * self._off_m <= 0.0 or abs(self._off_m) < 0.01
