"""How far the vehicle is flown elsewhere than it was asked to: wind, or somebody else's setpoints.

PX4 flies v = velocity + gain * (position - where the vehicle is) with a lag of half a second. The
difference between what was flown and that, summed with a short memory, stays below a bound in
every flight whose setpoints are alone; a second computer's setpoints, or a wind that PX4 cannot
hold against, add up.
"""

import math

from autonomy.config import Config
from autonomy.model import FusedState
from hal.frames import Vector3, add, scale, subtract
from hal.interfaces import SeenSpace
from hal.setpoints import Setpoint
from hal.vehicle.guard import stopping_speed_m_s

MEMORY_S = 1.5
"""After this, a past difference counts by 1/e."""
_SPEED_M_S = 0.25
"""Up to here `failsafe.drift_m` is the limit: flights whose setpoints were alone came to 0.14 m,
0.17 m with one stuck beam."""

_AHEAD_M = 1.0
_NEAR, _NEAR_TICKS = 0.8, 2
"""Towards an obstacle, this part of the limit is enough, for so many ticks."""


class Drift:
    """Fed with what was flown and with what was sent."""

    def __init__(self, config: Config) -> None:
        self._guard = config.guard
        self._gain_per_s = config.guard.position_gain_per_s
        self.limit_m = config.failsafe.drift_m * max(1.0, config.guard.speed_max_m_s / _SPEED_M_S)
        """What lags behind a setpoint grows with the speed, and so does this."""
        self._sent: Setpoint | None = None
        self._sum_m: Vector3 = (0.0, 0.0, 0.0)
        self._over_since_s: float | None = None
        self._near_ticks = 0

    def sent(self, setpoint: Setpoint | None) -> None:
        """What the guard let pass at the last tick, in the mission frame; None: nothing."""
        self._sent = setpoint

    def restart(self) -> None:
        """The past says nothing any more: the frame jumped, or somebody else flew."""
        self._sum_m = (0.0, 0.0, 0.0)
        self._over_since_s = None
        self._near_ticks = 0

    @property
    def drift_m(self) -> float:
        """Metres, horizontal or vertical, whichever is more."""
        return max(math.hypot(self._sum_m[0], self._sum_m[1]), abs(self._sum_m[2]))

    @property
    def towards_something(self) -> bool:
        """True when it is flown elsewhere faster than it could stop there."""
        return self._near_ticks >= _NEAR_TICKS

    def over_s(self, now_s: float) -> float:
        """How long it has been over the limit."""
        return 0.0 if self._over_since_s is None else now_s - self._over_since_s

    def step(self, fused: FusedState, dt_s: float, space: SeenSpace, now_s: float) -> None:
        """One tick in which the last setpoint was flown, in a space seen so far."""
        sent = self._sent
        if sent is None or not fused.ok:
            self.restart()
            return
        pull = scale(subtract(sent.position_ned_m, fused.position_ned_m), self._gain_per_s)
        asked = add(sent.velocity_ned_m_s, pull)
        added = scale(subtract(fused.velocity_ned_m_s, asked), dt_s)
        self._sum_m = add(scale(self._sum_m, math.exp(-dt_s / MEMORY_S)), added)
        near = self.drift_m > _NEAR * self.limit_m and self._too_fast(fused, space, now_s)
        self._near_ticks = self._near_ticks + 1 if near else 0
        if self.drift_m <= self.limit_m:
            self._over_since_s = None
        elif self._over_since_s is None:
            self._over_since_s = fused.stamp_s

    def _too_fast(self, fused: FusedState, space: SeenSpace, now_s: float) -> bool:
        """Faster than the vehicle could stop before what is ahead, or before what was not seen."""
        north, east = fused.velocity_ned_m_s[:2]
        speed_m_s = math.hypot(north, east)
        heading_rad = math.atan2(east, north)
        ahead_m = space.free_distance_m(fused.position_ned_m, heading_rad, _AHEAD_M, now_s)
        guard = self._guard
        return speed_m_s > stopping_speed_m_s(ahead_m, guard.reaction_s, guard.braking_m_s2)
