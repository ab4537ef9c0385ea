"""AUTO.RTL: climb into a cone over home, fly home, come down there.

Measured on PX4 main bb59c637cd, SIH quadrotor, 2026-11.
"""

import math

from hal.frames import Vector3
from hal.sim import px4_events as events
from hal.sim.autopilot_situation import Situation
from hal.sim.autopilot_smoothing import Smoothing
from hal.sim.px4 import Severity
from hal.sim.quadrotor import FREE3, Command

# The height over home is this times the distance (measured twice), horizontally homing.
_CONE = math.sqrt(3.0)
_REACHED_M, _LEVEL_M = 0.5, 0.1
_CLIMB_RATE = 0.8  # m/s per root of the metres still to climb
_CLIMB_SLEW_M_S2 = 2.5
_CLIMB_S = 0.7  # at least, unless nothing is to be climbed
_HOMING_GAIN_PER_S, _HOMING_MAX_M_S = 0.45, 2.0


class Return:
    """One return after the other: `plan` when it begins, then `fly` at each step."""

    def __init__(self, situation: Situation, smoothing: Smoothing) -> None:
        self._situation = situation
        self._smoothing = smoothing
        self._height_m = 0.0
        self._phase = "climb"
        self._climbs_until_s = 0.0

    @property
    def landing(self) -> bool:
        """True when it has come home and comes down."""
        return self._phase == "land"

    def plan(self, here_ned_m: Vector3) -> None:
        """Climb so high that the cone over home is reached from here, where it will stand."""
        s, home = self._situation, self._situation.home_ned_m
        height = home[2] - here_ned_m[2]
        away = math.hypot(here_ned_m[0] - home[0], here_ned_m[1] - home[1])
        cone = min(_CONE * away, float(s.parameters["RTL_RETURN_ALT"]))
        self._height_m = max(height, cone)
        climbs = self._height_m - height > _LEVEL_M
        self._phase = "climb"
        self._climbs_until_s = s.now_s + (_CLIMB_S if climbs else 0.0)
        amsl = s.origin[2] - home[2] + self._height_m
        above_m = math.ceil(self._height_m)
        s.say(
            Severity.INFO,
            f"RTL: start return at {math.ceil(amsl)} m ({above_m} m above destination)",
            events.RETURN_AT,
            math.ceil(amsl),
            above_m,
        )

    def fly(self, dt_s: float) -> Command:
        """What to fly now."""
        s = self._situation
        home, here = s.home_ned_m, s.estimated_position_ned_m
        north, east = home[0] - here[0], home[1] - here[1]
        away = math.hypot(north, east)
        if self._phase == "climb":
            to_go = self._height_m - (home[2] - here[2])
            radius_m = 0.0 if s.now_s < self._climbs_until_s else _REACHED_M
            if to_go > radius_m and s.airborne:
                fastest = float(s.parameters["MPC_Z_V_AUTO_UP"])
                rate = -min(_CLIMB_RATE * math.sqrt(to_go), fastest)
                return self._smoothing.locked(self._smoothing.slew(rate, _CLIMB_SLEW_M_S2, dt_s))
            self._phase = "fly"
        if self._phase == "fly" and away < float(s.parameters["NAV_ACC_RAD"]):
            self._phase = "land"
            s.say(Severity.INFO, "RTL: land at destination", events.RETURN_LANDS)
        vertical = 0.0
        fastest = float(s.parameters["MPC_XY_CRUISE"])
        if self.landing:
            vertical = self._smoothing.descent_m_s(dt_s)
            fastest = _HOMING_MAX_M_S
        speed = min(_HOMING_GAIN_PER_S * away, fastest)
        share = speed / away if away > 1e-6 else 0.0
        return Command(FREE3, (north * share, east * share, vertical), self._smoothing.yaw_rad)
