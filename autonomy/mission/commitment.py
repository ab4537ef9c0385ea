"""Planning with a memory: a side once chosen is kept until another one is clearly shorter."""

from autonomy.geometry import Point
from autonomy.model import NoPlan, Plan
from autonomy.t3drm.kernels import Floats
from autonomy.t3drm.planner import Planner
from autonomy.t3drm.sides import on_the_same_side, still_there, switched


class Commitment:
    """Algorithm 2's steps 4 to 7 and 10, replan after replan.

    Each replan alone takes the shortest path. Where two sides of an obstacle are nearly equal, the
    next hit, or noise, would change the choice, and the vehicle would fly to and fro before it.
    """

    def __init__(self, planner: Planner, hysteresis_m: float) -> None:
        """The other side of a known obstacle is taken when that saves more than `hysteresis_m`."""
        self._planner = planner
        self._hysteresis_m = hysteresis_m
        self._goal: Point | None = None
        self._known: Floats | None = None

    def forget(self) -> None:
        """The next plan is free in its choice, too: other obstacles, at another height."""
        self._known = None

    def plan(
        self,
        point: Point,
        goal: Point,
        hits: Floats,
        tolerance_m: float,
        course: tuple[Point, ...],
    ) -> Plan | NoPlan:
        """`Planner.plan`, with `course`, what is left of the path being flown, to be true to.

        The first plan to a goal, and the first after there was none, are free in their choice.
        hits: (n, 2) float64, writeable.
        """
        result = self._planner.plan(point, goal, hits, tolerance_m)
        known = self._known if goal == self._goal else None
        self._goal, self._known = goal, None
        if isinstance(result, NoPlan):
            return result
        self._known = hits
        if known is None or self._hysteresis_m == 0.0:
            return result
        lane = (point, *course)
        passed = still_there(switched(lane, result.points, known), hits)
        if passed.shape[0] == 0:
            return result
        kept = on_the_same_side(self._planner, result, lane, passed, hits, tolerance_m)
        if kept is None or kept.length_m > result.length_m + self._hysteresis_m:
            return result
        return kept
