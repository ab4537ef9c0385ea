"""The guard itself: the order of the checks, and the memory of where a hold began."""

import math

from hal.config import GuardConfig
from hal.frames import ZERO3, Vector3, add, norm, scale, subtract
from hal.setpoints import Setpoint
from hal.vehicle.guard import vertical
from hal.vehicle.guard.around import ROUNDING, Around, Directions, towards, without
from hal.vehicle.guard.limits import (
    ACCELERATION,
    BEAM,
    BRAKE,
    LEASH,
    POSITION_STALE,
    SETPOINT_REPEATED,
    SETPOINT_STALE,
    SPEED,
    YAW_RATE,
)
from hal.vehicle.guard.pace import Pace
from hal.vehicle.guard.room import Room
from hal.vehicle.guard.sight import GuardVerdict, Sight

DRIFT_M_S = 0.03
"""Below this an actual velocity is noise (0.6 cm/s one sigma in offboard) and stops in 2 cm."""
HOLD_REACH_M = 0.3
"""A hold never pulls the vehicle farther than this; beyond it the hold begins anew."""


class Guard:
    """Limits setpoints. Same sequence of checks, same verdicts: no clock, no randomness inside."""

    def __init__(self, config: GuardConfig) -> None:
        self._config = config
        self._speed_max_m_s = config.speed_max_m_s
        self._gain = config.position_gain_per_s
        self._around = Around(config.beam_stop_m)
        self._room = Room(config)
        self._pace = Pace(config)
        self._anchor: Vector3 | None = None
        self._reach_m = min(HOLD_REACH_M, config.leash_m)
        if self._gain > 0.0:
            self._reach_m = min(self._reach_m, config.speed_max_m_s / self._gain)
        self.horizon_m = self._room.horizon_m
        """How far ahead must be free for full speed."""

    def check(self, setpoint: Setpoint, sight: Sight) -> GuardVerdict:
        """The setpoint that may be sent now, and which limits changed it."""
        stale = self._stale(setpoint, sight)
        if stale is not None:
            verdict = self._hold_everything(setpoint, sight, stale)
        else:
            verdict = self._limited(setpoint, sight)
        sent = verdict.setpoint
        offset = subtract(sent.position_ned_m, sight.position_ned_m)
        north, east = self._effective(offset, sent.velocity_ned_m_s)
        self._pace.note(north, east, sent.yaw_rad, sight.now_s)
        return verdict

    def _limited(self, setpoint: Setpoint, sight: Sight) -> GuardVerdict:
        """The setpoint, of which nothing is old, within every limit."""
        limits: list[str] = []
        offset = self._leashed(subtract(setpoint.position_ned_m, sight.position_ned_m), limits)
        velocity = setpoint.velocity_ned_m_s
        around = self._around.look(sight)
        altitude = -sight.position_ned_m[2]
        offset, velocity = vertical.limited(
            self._config, offset, velocity, altitude, around, limits
        )
        offset, velocity = self._at_most_top_speed(offset, velocity, limits)
        offset, velocity = self._accelerated(offset, velocity, sight.now_s, limits)
        offset, velocity = self._off_near_beams(offset, velocity, around.near, limits)
        offset, velocity, speed_limit_m_s, free_m = self._with_room(offset, velocity, sight, limits)
        if velocity[:2] == (0.0, 0.0) and offset[:2] == (0.0, 0.0) and limits:
            back = subtract(self._hold_at(sight, around.near), sight.position_ned_m)
            offset = (back[0], back[1], offset[2])
        else:
            self._release(setpoint)
        yaw_rad = self._turned(setpoint.yaw_rad, sight, limits)
        if not limits:
            return GuardVerdict(setpoint, (), speed_limit_m_s, free_m)
        place = add(sight.position_ned_m, offset)
        limited = Setpoint(setpoint.stamp_s, place, velocity, yaw_rad)
        return GuardVerdict(limited, tuple(limits), speed_limit_m_s, free_m)

    # ------------------------------------------------------------ age, and what a hold is (1)

    def _stale(self, setpoint: Setpoint, sight: Sight) -> str | None:
        """Old position or old setpoint (or one from the future, or always the same): nobody is
        flying this vehicle.
        """
        repeated = self._pace.repeats(setpoint, sight.now_s)
        age_s = sight.now_s - sight.fused_stamp_s
        if not sight.position_ok or age_s > self._config.position_max_age_s:
            return POSITION_STALE
        if abs(sight.now_s - setpoint.stamp_s) > self._config.setpoint_max_age_s:
            return SETPOINT_STALE
        return SETPOINT_REPEATED if repeated else None

    def _hold_everything(self, setpoint: Setpoint, sight: Sight, reason: str) -> GuardVerdict:
        """Position and heading as they are, zero velocity; the same object if it says so already.

        The stamp is fresh: this setpoint was made now, by the guard. While the position is known
        the hold keeps its distance from a surface above and below, too.
        """
        around = self._around.look(sight)
        anchor = self._hold_at(sight, around.near)
        limits = [reason]
        if reason != POSITION_STALE:
            back = subtract(anchor, sight.position_ned_m)
            altitude = -sight.position_ned_m[2]
            offset, _ = vertical.limited(self._config, back, ZERO3, altitude, around, limits)
            if offset[2] != back[2]:
                anchor = (anchor[0], anchor[1], sight.position_ned_m[2] + offset[2])
        hold = Setpoint(sight.now_s, anchor, yaw_rad=sight.yaw_rad)
        if hold == setpoint:
            hold = setpoint
        return GuardVerdict(hold, tuple(limits), 0.0, 0.0)

    def _hold_at(self, sight: Sight, near: Directions) -> Vector3:
        """Where the present hold began; it begins now if there is none, or none worth keeping."""
        anchor = self._anchor
        if anchor is not None:
            back = subtract(anchor, sight.position_ned_m)
            if norm(back) > self._reach_m or towards(back[0], back[1], near):
                anchor = None
        if anchor is None:
            anchor = sight.position_ned_m
        self._anchor = anchor
        return anchor

    def _release(self, setpoint: Setpoint) -> None:
        """The hold is over, unless it is the hold itself that was checked once more."""
        anchor = self._anchor
        if anchor is not None and setpoint.position_ned_m[:2] != anchor[:2]:
            self._anchor = None

    # ------------------------------------------------------------ leash (7), top speed (2), pace

    def _leashed(self, offset: Vector3, limits: list[str]) -> Vector3:
        """The position setpoint at most `leash_m` from the vehicle."""
        length = norm(offset)
        if length <= self._config.leash_m * (1.0 + ROUNDING):
            return offset
        limits.append(LEASH)
        return scale(offset, self._config.leash_m / length) if length < math.inf else ZERO3

    def _effective(self, offset: Vector3, velocity: Vector3) -> tuple[float, float]:
        """The horizontal velocity that PX4 will fly (north, east)."""
        return velocity[0] + self._gain * offset[0], velocity[1] + self._gain * offset[1]

    def _at_most_top_speed(
        self, offset: Vector3, velocity: Vector3, limits: list[str]
    ) -> tuple[Vector3, Vector3]:
        """Effective velocity and feed-forward alone both within `speed_max_m_s`."""
        n, e = self._effective(offset, velocity)
        speed = max(math.hypot(n, e), math.hypot(velocity[0], velocity[1]))
        if speed <= self._speed_max_m_s * (1.0 + ROUNDING):
            return offset, velocity
        limits.append(SPEED)
        return _scaled(offset, velocity, self._speed_max_m_s / speed)

    def _accelerated(
        self, offset: Vector3, velocity: Vector3, now_s: float, limits: list[str]
    ) -> tuple[Vector3, Vector3]:
        """No jump of the effective velocity, except to a slower one.

        What is limited becomes a velocity alone: the sum of both is what is flown.
        """
        allowed = self._pace.accelerated(*self._effective(offset, velocity), now_s)
        if allowed is None:
            return offset, velocity
        limits.append(ACCELERATION)
        return (0.0, 0.0, offset[2]), (*allowed, velocity[2])

    def _turned(self, yaw_rad: float, sight: Sight, limits: list[str]) -> float:
        """The heading, no farther round than the yaw rate allows."""
        allowed = self._pace.turned(yaw_rad, sight.yaw_rad, sight.now_s)
        if allowed is None:
            return yaw_rad
        limits.append(YAW_RATE)
        return allowed

    # ------------------------------------------------------------ raw beams (4)

    def _off_near_beams(
        self, offset: Vector3, velocity: Vector3, near: Directions, limits: list[str]
    ) -> tuple[Vector3, Vector3]:
        """No component towards a near reading, whatever the map says; no way left: no motion."""
        if not near or not towards(*self._effective(offset, velocity), near):
            return offset, velocity
        limits.append(BEAM)
        for un, ue in near:
            n, e = self._effective(offset, velocity)
            if n * un + e * ue > ROUNDING:
                offset = without(offset, un, ue)
                velocity = without(velocity, un, ue)
        if towards(*self._effective(offset, velocity), near):
            # Taking one component away brought another back: the beams close a wedge.
            return _scaled(offset, velocity, 0.0)
        return offset, velocity

    # ------------------------------------------------------------ room to stop (2, 3, 5, 8)

    def _with_room(
        self, offset: Vector3, velocity: Vector3, sight: Sight, limits: list[str]
    ) -> tuple[Vector3, Vector3, float, float]:
        """Offset and velocity scaled to what can be stopped from (to zero: hold), the speed that
        is allowed, and how far the way is free.
        """
        n, e = self._effective(offset, velocity)
        speed = math.hypot(n, e)
        if speed == 0.0:
            if self._must_brake(n, e, speed, sight):
                limits.append(BRAKE)
                offset, velocity = _scaled(offset, velocity, 0.0)
            return offset, velocity, self._speed_max_m_s, self.horizon_m
        way = self._room.way(n / speed, e / speed, sight)
        factor = 1.0
        if speed > way.allowed_m_s * (1.0 + ROUNDING):
            factor = way.allowed_m_s / speed
        brakes = self._must_brake(n, e, speed * factor, sight)
        if brakes:
            limits.append(BRAKE)
        if factor < 1.0:
            limits.append(way.limit)
        offset, velocity = _scaled(offset, velocity, 0.0 if brakes else factor)
        return offset, velocity, way.allowed_m_s, way.free_m

    def _must_brake(self, north: float, east: float, left_m_s: float, sight: Sight) -> bool:
        """The vehicle moves faster than it can stop, and the command (north, east) feeds that.

        Or what room leaves of the command, `left_m_s`, says stop wherever the vehicle is by then:
        that has no bound worth having, a held position has.
        """
        vn, ve = sight.velocity_ned_m_s[0], sight.velocity_ned_m_s[1]
        actual = math.hypot(vn, ve)
        if actual <= DRIFT_M_S:
            return False
        un, ue = vn / actual, ve / actual
        fed = north * un + east * ue
        stoppable = self._room.way(un, ue, sight).stoppable_m_s
        fed_on = fed > stoppable * (1.0 + ROUNDING)
        return actual > stoppable and (fed_on or left_m_s <= DRIFT_M_S)


def _scaled(offset: Vector3, velocity: Vector3, factor: float) -> tuple[Vector3, Vector3]:
    """Both with their horizontal parts times `factor`."""
    return (
        (offset[0] * factor, offset[1] * factor, offset[2]),
        (velocity[0] * factor, velocity[1] * factor, velocity[2]),
    )
