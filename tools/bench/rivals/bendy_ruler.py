"""BendyRuler's rule: probe bearings off the goal's in two steps, take the first that is clear.

ArduPilot's AP_OABendyRuler (ardupilot.org/copter/docs/common-oa-bendyruler.html), horizontal: every
5 degrees to either side up to 170, each with a second step straight on to the destination and 45
degrees to either side; a way is clear with OA_MARGIN_MAX to everything. A change of bearing by
more than OA_BR_CONT_ANGLE is resisted unless the margin grows by OA_BR_CONT_RATIO. Where nothing is
clear the bearing with the most room is flown, at half speed. Its lookahead (5 to 15 m outdoors) is
scaled to what beams of 1 m see, and fixed here instead of growing and shrinking. It has no memory
beyond one bearing, and never gives up.
"""

import math

import msgspec

from autonomy.geometry import distance
from hal.frames import wrap_pi
from tools.bench.rivals import kernels
from tools.bench.rivals.interface import Answer, Craft, View, towards

CONTINUE_RAD = math.radians(75.0)
CONTINUE_RATIO = 1.5
"""ArduPilot's defaults of OA_BR_CONT_ANGLE and OA_BR_CONT_RATIO."""
PAST_GOAL_M = 0.1


class Gains(msgspec.Struct, frozen=True):
    """Chosen by `tuning.py`: the length of each step, and the margin beyond the keep-out."""

    lookahead_m: float = 0.2
    margin_m: float = 0.0


class BendyRuler:
    """One flight's last bearing."""

    def __init__(self, craft: Craft, gains: Gains | None = None) -> None:
        self._craft, self._gains = craft, gains if gains is not None else Gains()
        self._before_rad: float | None = None

    def decide(self, view: View) -> Answer:
        """Along the first clear bearing, or the one with the most room."""
        gains, (n, e) = self._gains, view.point
        clear_m = self._craft.keep_out_m + gains.margin_m
        step_m = min(gains.lookahead_m, distance(view.point, view.goal) + PAST_GOAL_M)
        found, bearing_rad, room_m = kernels.bend(
            view.near, n, e, view.goal[0], view.goal[1], step_m, gains.lookahead_m, clear_m
        )
        bearing_rad = self._resisted(view, bearing_rad, room_m, step_m)
        self._before_rad = bearing_rad
        speed_m_s = self._craft.speed_m_s if found else 0.5 * self._craft.speed_m_s
        return towards(bearing_rad, speed_m_s)

    def _resisted(self, view: View, bearing_rad: float, room_m: float, step_m: float) -> float:
        """The new bearing, or the old one where the change is large and gains little room."""
        before = self._before_rad
        if before is None or abs(wrap_pi(bearing_rad - before)) <= CONTINUE_RAD:
            return bearing_rad
        n, e = view.point
        on, oe = n + step_m * math.cos(before), e + step_m * math.sin(before)
        old_m = kernels.margin(view.near, n, e, on, oe)
        if old_m > self._craft.keep_out_m and room_m < CONTINUE_RATIO * old_m:
            return before
        return bearing_rad
