"""Dynamic window approach: the best of the velocities that can be had, and stopped from.

Fox, Burgard and Thrun, "The dynamic window approach to collision avoidance" (IEEE Robotics and
Automation Magazine 4(1), 1997). Theirs steers a synchro-drive by (v, omega) on arcs; a multirotor
flies any way it likes, so the window is one of (north, east) velocities and the arcs are straight
(as Brock and Khatib, ICRA 1999, do for holonomic bases). Admissible is what stops before the next
hit. The objective is theirs: heading, clearance along the way, speed. No memory; never gives up.
"""

import msgspec

from autonomy.geometry import bearing, distance
from tools.bench.rivals import kernels
from tools.bench.rivals.interface import Answer, Craft, View, towards

AHEAD_S = 0.5
"""The window holds what can be reached within this."""


class Gains(msgspec.Struct, frozen=True):
    """Chosen by `tuning.py`: weights of heading, clearance and speed (each term is 0 to 1), and how
    far beyond the keep-out hits are kept.
    """

    heading: float = 0.8
    clearance: float = 0.5
    speed: float = 0.1
    margin_m: float = 0.0


class DynamicWindow:
    """No state but the vehicle's own velocity."""

    def __init__(self, craft: Craft, gains: Gains | None = None) -> None:
        self._craft, self._gains = craft, gains if gains is not None else Gains()

    def decide(self, view: View) -> Answer:
        """The best velocity; zero where none is admissible."""
        craft, gains, (n, e) = self._craft, self._gains, view.point
        free = kernels.profile(view.near, n, e, craft.keep_out_m + gains.margin_m, craft.range_m)
        bearing_rad, speed_m_s = kernels.window(
            free,
            bearing(view.point, view.goal),
            distance(view.point, view.goal),
            view.velocity[0],
            view.velocity[1],
            craft.speed_m_s,
            craft.range_m,
            craft.braking_m_s2,
            craft.braking_m_s2,
            AHEAD_S,
            gains.heading,
            gains.clearance,
            gains.speed,
        )
        return towards(bearing_rad, speed_m_s)
