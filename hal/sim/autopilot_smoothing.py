"""What all phases of flight have in common: to stop smoothly, keep the heading, climb and descend.

Profiles: measured on PX4 main bb59c637cd, SIH quadrotor, 2026-11.
"""

import math

import msgspec

from hal.frames import ZERO3, Vector3, add, norm, scale, wrap_pi
from hal.sim.autopilot_situation import Situation
from hal.sim.quadrotor import Command

# Velocity per height still to go, its limit and slew.
_TAKEOFF_GAIN_PER_S, _TAKEOFF_MAX_M_S = 0.5, 0.77
_CLIMB_SLEW_M_S2 = 0.8
_DESCENT_SLEW_M_S2 = 1.5
_CRAWL_BELOW_M = 0.9


class Braking(msgspec.Struct, frozen=True):
    """PX4's jerk-limited stop from a velocity: triangular deceleration within MPC_JERK_AUTO."""

    start_s: float
    position_ned_m: Vector3
    velocity_ned_m_s: Vector3
    duration_s: float

    @classmethod
    def plan(
        cls, now_s: float, position_ned_m: Vector3, velocity_ned_m_s: Vector3, jerk_m_s3: float
    ) -> "Braking":
        """A stop that begins now: its deceleration rises and falls in 2 sqrt(speed / jerk)."""
        duration_s = 2.0 * math.sqrt(norm(velocity_ned_m_s) / max(jerk_m_s3, 0.1))
        return cls(now_s, position_ned_m, velocity_ned_m_s, duration_s)

    @property
    def end_ned_m(self) -> Vector3:
        """Where the stop ends."""
        return add(self.position_ned_m, scale(self.velocity_ned_m_s, 0.5 * self.duration_s))

    def at(self, now_s: float) -> tuple[Vector3, Vector3, Vector3]:
        """(position, velocity, acceleration) of the stop at `now_s`."""
        if self.duration_s <= 0.0 or now_s >= self.start_s + self.duration_s:
            return self.end_ned_m, ZERO3, ZERO3
        x = (now_s - self.start_s) / self.duration_s
        if x < 0.5:
            path, speed, slope = x - 2.0 * x**3 / 3.0, 1.0 - 2.0 * x * x, -4.0 * x
        else:
            y = 1.0 - x
            path, speed, slope = 0.5 - 2.0 * y**3 / 3.0, 2.0 * y * y, -4.0 * y
        v = self.velocity_ned_m_s
        return (
            add(self.position_ned_m, scale(v, path * self.duration_s)),
            scale(v, speed),
            scale(v, slope / self.duration_s),
        )


class Smoothing:
    """The stop that was begun last, the heading kept since, and the vertical velocity asked for."""

    def __init__(self, situation: Situation) -> None:
        self._situation = situation
        self._vertical_sp_m_s = 0.0
        self.braking = Braking(0.0, ZERO3, ZERO3, 0.0)
        self.yaw_rad = situation.quadrotor.yaw_rad

    def stop_here(self) -> None:
        """Begin to stop from what is flown now."""
        s = self._situation
        here, moving = s.estimated_position_ned_m, s.estimated_velocity_ned_m_s
        jerk_m_s3 = float(s.parameters["MPC_JERK_AUTO"])
        self.braking = Braking.plan(s.now_s, here, moving, jerk_m_s3)
        self.yaw_rad = wrap_pi(s.estimated_yaw_rad + 0.4 * s.quadrotor.yaw_rate_rad_s)
        self._vertical_sp_m_s = moving[2] if s.airborne else 0.0

    def stand_at(self, position_ned_m: Vector3) -> None:
        """Stand there, without a stop."""
        self.braking = Braking(self._situation.now_s, position_ned_m, ZERO3, 0.0)

    def leave_ground(self) -> None:
        """The climb begins from rest."""
        self._vertical_sp_m_s = 0.0

    def shift(self, by_ned_m: Vector3, by_yaw_rad: float) -> None:
        """The frame has jumped: where it stops and what it looks at move along."""
        b = self.braking
        self.braking = msgspec.structs.replace(b, position_ned_m=add(b.position_ned_m, by_ned_m))
        self.yaw_rad = wrap_pi(self.yaw_rad + by_yaw_rad)

    def stand(self, down_m: float | None = None) -> Command:
        """Stop, and stand where the stop ends; `down_m` instead of the stop's own height."""
        p, v, a = self.braking.at(self._situation.now_s)
        down = p[2] if down_m is None else down_m
        return Command((p[0], p[1], down), v, self.yaw_rad, acceleration_ned_m_s2=(a[0], a[1], 0.0))

    def locked(self, vertical_m_s: float) -> Command:
        """Stand horizontally where the stop ends, move vertically."""
        p, v, a = self.braking.at(self._situation.now_s)
        return Command(
            (p[0], p[1], math.nan),
            (v[0], v[1], vertical_m_s),
            self.yaw_rad,
            acceleration_ned_m_s2=(a[0], a[1], 0.0),
        )

    def slew(self, target_m_s: float, slew_m_s2: float, dt_s: float) -> float:
        """The vertical velocity (down) after one more step towards the target."""
        step = slew_m_s2 * dt_s
        change = target_m_s - self._vertical_sp_m_s
        self._vertical_sp_m_s += min(max(change, -step), step)
        return self._vertical_sp_m_s

    def climb(self, to_go_m: float, dt_s: float) -> Command:
        """Climb as a take-off does, with `to_go_m` still to climb (negative: too high)."""
        rate = _TAKEOFF_GAIN_PER_S * to_go_m
        target_m_s = -min(max(rate, -_TAKEOFF_MAX_M_S), _TAKEOFF_MAX_M_S)
        return self.locked(self.slew(target_m_s, _CLIMB_SLEW_M_S2, dt_s))

    def descent_m_s(self, dt_s: float) -> float:
        """The vertical velocity of a landing."""
        return self.slew(self._landing_m_s(), _DESCENT_SLEW_M_S2, dt_s)

    def _landing_m_s(self) -> float:
        """PX4's landing speed by height: fast above MPC_LAND_ALT1, at last a crawl."""
        p, height_m = self._situation.parameters, self._situation.quadrotor.height_m
        if height_m < _CRAWL_BELOW_M:
            return float(p["MPC_LAND_CRWL"])
        low_m, high_m = float(p["MPC_LAND_ALT2"]), float(p["MPC_LAND_ALT1"])
        slow, fast = float(p["MPC_LAND_SPEED"]), float(p["MPC_Z_V_AUTO_DN"])
        share = min(max((height_m - low_m) / max(high_m - low_m, 1e-6), 0.0), 1.0)
        return slow + share * (fast - slow)
