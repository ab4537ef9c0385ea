"""What one setpoint may differ by from the one before: acceleration, turn, repetition."""

import math

from hal.config import GuardConfig
from hal.frames import ZERO3, wrap_pi
from hal.setpoints import Setpoint

_ROUNDING = 1e-9


class Pace:
    """What was sent last, and what may follow it.

    What counts is what was sent at an earlier instant: checking twice at one instant changes
    nothing. After a pause longer than `setpoint_max_age_s` the vehicle counts as being at rest, and
    no more than that time counts.
    """

    def __init__(self, config: GuardConfig) -> None:
        self._pause_s = config.setpoint_max_age_s
        self._acceleration_m_s2 = config.acceleration_max_m_s2
        self._yaw_rate_rad_s = math.radians(config.yaw_rate_max_deg_s)
        self._before_s = self._sent_s = -math.inf
        self._before = self._sent = (0.0, 0.0)
        self._yaw_before_rad: float | None = None
        self._yaw_sent_rad: float | None = None
        self._asked: Setpoint | None = None
        self._asked_since_s = -math.inf

    def repeats(self, setpoint: Setpoint, now_s: float) -> bool:
        """Whether this motion was asked for, bit for bit, for longer than a setpoint may be old.

        Whoever flies knows where the vehicle is, and that is never twice the same place. Asking
        for the same place again and again, at rest, is a hold.
        """
        asked = self._asked
        if (
            asked is None
            or asked.position_ned_m != setpoint.position_ned_m
            or asked.velocity_ned_m_s != setpoint.velocity_ned_m_s
            or asked.yaw_rad != setpoint.yaw_rad
        ):
            self._asked, self._asked_since_s = setpoint, now_s
        moves = setpoint.velocity_ned_m_s != ZERO3
        return moves and now_s - self._asked_since_s > self._pause_s

    def accelerated(self, north: float, east: float, now_s: float) -> tuple[float, float] | None:
        """The velocity that may be sent instead of (north, east); None where that may be.

        Slowing down is free, to any part of what was sent before (a point on the segment from rest
        to it); from there the velocity may differ by the acceleration times the time that passed.
        What comes nearest to the velocity that was asked for is returned.
        """
        self._turn_the_page(now_s)
        before_n, before_e = self._before
        square = before_n * before_n + before_e * before_e
        part = (north * before_n + east * before_e) / square if square > 0.0 else 0.0
        part = min(1.0, max(0.0, part))
        kept_n, kept_e = part * before_n, part * before_e
        more_n, more_e = north - kept_n, east - kept_e
        more, limit = math.hypot(more_n, more_e), self._acceleration_m_s2 * self._elapsed_s(now_s)
        if more <= limit + _ROUNDING:
            return None
        return kept_n + more_n * limit / more, kept_e + more_e * limit / more

    def turned(self, yaw_rad: float, vehicle_yaw_rad: float, now_s: float) -> float | None:
        """The heading that may be sent instead of `yaw_rad`; None where that may be.

        Any heading between the vehicle's and what was sent before is free; beyond these it may
        turn by the yaw rate times the time that passed.
        """
        self._turn_the_page(now_s)
        ahead = 0.0
        if self._yaw_before_rad is not None:
            ahead = wrap_pi(self._yaw_before_rad - vehicle_yaw_rad)
        asked = wrap_pi(yaw_rad - vehicle_yaw_rad)
        step = self._yaw_rate_rad_s * self._elapsed_s(now_s)
        allowed = min(max(0.0, ahead) + step, max(min(0.0, ahead) - step, asked))
        if abs(asked - allowed) <= _ROUNDING:
            return None
        return wrap_pi(vehicle_yaw_rad + allowed)

    def note(self, north: float, east: float, yaw_rad: float, now_s: float) -> None:
        """This was sent."""
        self._turn_the_page(now_s)
        self._sent, self._yaw_sent_rad, self._sent_s = (north, east), yaw_rad, now_s

    def _turn_the_page(self, now_s: float) -> None:
        """What was sent at an earlier instant is what was sent before."""
        if now_s <= self._sent_s:
            return
        self._before_s = self._sent_s
        rested = now_s - self._sent_s > self._pause_s
        self._before = (0.0, 0.0) if rested else self._sent
        self._yaw_before_rad = None if rested else self._yaw_sent_rad

    def _elapsed_s(self, now_s: float) -> float:
        return max(0.0, min(now_s - self._before_s, self._pause_s))
