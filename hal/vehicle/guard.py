"""The last check before the wire: no setpoint may ask for more than the vehicle can stop from.

The guard knows nothing of missions or plans. It sees where the vehicle is, what its beams read and
what was seen to be free, and makes a setpoint slower, shorter or a hold; it never turns a setpoint
into another direction except by taking a forbidden component away. It adds motion of its own in
two cases only: back to where a hold began, and up or down to the height at which a surface below
or above is `beam_stop_m` away again. There "stay here" would give way to every error of the
estimate, and always towards the surface.

What PX4 will fly is the *effective velocity* `v = velocity + position_gain * (position - where the
vehicle is)`, so that is what is limited: velocity and position offset are scaled together.

Stopping. `distance = v * reaction_s + v^2 / (2 * braking_m_s2)` bounds how far the vehicle still
travels when a hold begins. Fitted to the velocity loop measured on PX4 main bb59c637cd, SIH
quadrotor, 2026-11 (gains 1.8/0.4/0.2, thrust lag 0.26 s, dead time 0.03 s), one 20 Hz tick and
20 ms of link added, drag 0.2 and 1.0 /s, after a long cruise:

| m/s | zero velocity alone, m | held position, m | bound with 0.6 s, 0.5 m/s2, m |
|---|---|---|---|
| 0.05 | 0.03 .. 0.10 | 0.025 .. 0.028 | 0.033 |
| 0.10 | 0.06 .. 0.21 | 0.05 .. 0.06 | 0.070 |
| 0.20 | 0.12 .. 0.42 | 0.10 .. 0.11 | 0.160 |
| 0.30 | 0.19 .. 0.62 | 0.15 .. 0.17 | 0.270 |

Zero velocity alone has no bound worth having (the integrator unwinds slowly against drag), hence a
hold keeps the position at which it *began* until it ends: the guard's only memory.
"""

import itertools
import math

import msgspec

from hal.config import BeamMount, GuardConfig
from hal.errors import ReadingRefused
from hal.frames import ZERO3, Vector3, add, finite3, norm, scale, subtract
from hal.interfaces import SeenSpace
from hal.readings import RangeReading, RangeStatus
from hal.setpoints import Setpoint

# What a limit is called in verdicts, logs and on the screen.
SETPOINT_STALE = "setpoint_stale"
POSITION_STALE = "position_stale"
LEASH = "leash"
SPEED = "speed"
CLIMB = "climb"
ALTITUDE = "altitude"
CEILING = "ceiling"
GROUND = "ground"
BEAM = "beam"
BRAKE = "brake"
FENCE = "fence"
FREE_SPACE = "free_space"

HEIGHT_GAIN_PER_S = 1.0
"""PX4's MPC_Z_P: the height a limit is approached with is that of a position error."""
DRIFT_M_S = 0.03
"""Below this an actual velocity is noise (0.6 cm/s one sigma in offboard) and stops in 2 cm."""
ESCAPE_SPEED_M_S = 0.06
"""How fast the vehicle may leave a place that is too near to a hit."""
ESCAPE_COSINE = 0.4
"""An escape leads away from the nearest hit within about 66 degrees."""
RETREAT_M_S = 0.1
"""How fast the guard leaves a ceiling or a table that is too near, at most."""
ESCAPE_STEPS_M = (0.025, 0.05, 0.075, 0.1)
"""An escape must reach open space within one of these distances."""
HOLD_REACH_M = 0.3
"""A hold never pulls the vehicle farther than this; beyond it the hold begins anew."""

_INWARD_STEP_M = 0.01
_INWARD_COSINE = 0.3
_ROUNDING = 1e-9


class BeamSight(msgspec.Struct, frozen=True):
    """The newest reading of one beam, and where that beam looks."""

    mount: BeamMount
    reading: RangeReading


class Sight(msgspec.Struct, frozen=True):
    """What the guard may know at one tick; raises ReadingRefused when a number is none.

    `position_ned_m`, `velocity_ned_m_s`: the vehicle at `fused_stamp_s`, in the frame of the
    setpoint; `position_ok` is False when the estimator would not fly by it; `position_sigma_m`:
    its one-sigma horizontal uncertainty. `yaw_rad`: heading of the nose. `beams`: one entry for
    each beam, in any order, only those that are fresh. `space`: what was seen to be free.
    Altitudes are -down.
    """

    now_s: float
    fused_stamp_s: float
    position_ned_m: Vector3
    velocity_ned_m_s: Vector3
    yaw_rad: float
    space: SeenSpace
    beams: tuple[BeamSight, ...] = ()
    position_sigma_m: float = 0.0
    position_ok: bool = True

    def __post_init__(self) -> None:
        if not (
            finite3((self.now_s, self.fused_stamp_s, self.yaw_rad))
            and finite3(self.position_ned_m)
            and finite3(self.velocity_ned_m_s)
            and 0.0 <= self.position_sigma_m < math.inf
        ):
            raise ReadingRefused("guard: what is known of the vehicle is not a number")


class GuardVerdict(msgspec.Struct, frozen=True):
    """What may be sent.

    `setpoint` is the very object that was checked when `limits` is empty. `speed_limit_m_s` is
    what the effective horizontal velocity was allowed; `free_distance_m` how far the way along it
    is free (fence and space, less the position's uncertainty), at most `Guard.horizon_m`, which is
    also its value when no horizontal motion was asked for.
    """

    setpoint: Setpoint
    limits: tuple[str, ...]
    speed_limit_m_s: float
    free_distance_m: float


def stopping_distance_m(speed_m_s: float, reaction_s: float, braking_m_s2: float) -> float:
    """How far a vehicle travels from `speed_m_s` to rest: v T + v^2 / (2 a)."""
    return speed_m_s * reaction_s + speed_m_s * speed_m_s / (2.0 * braking_m_s2)


def stopping_speed_m_s(distance_m: float, reaction_s: float, braking_m_s2: float) -> float:
    """The speed that stops within `distance_m`: -a T + sqrt((a T)^2 + 2 a d); 0 for d <= 0.

    Inverse of `stopping_distance_m`.
    """
    at = braking_m_s2 * reaction_s
    return math.sqrt(at * at + 2.0 * braking_m_s2 * max(0.0, distance_m)) - at


class _Beam(msgspec.Struct, frozen=True):
    """A mount in the guard's terms: `rise` is +1 up, -1 down, 0 for a horizontal beam."""

    mount: BeamMount
    yaw_rad: float
    rise: int
    projection: float
    face_m: float


def _beam(mount: BeamMount) -> _Beam:
    yaw, pitch = math.radians(mount.yaw_deg), math.radians(mount.pitch_deg)
    if mount.horizontal:
        face_m = mount.forward_m * math.cos(yaw) + mount.right_m * math.sin(yaw)
        return _Beam(mount, yaw, 0, math.cos(pitch), face_m)
    rise = int(math.copysign(1.0, pitch))
    return _Beam(mount, yaw, rise, abs(math.sin(pitch)), -rise * mount.down_m)


class _Surroundings(msgspec.Struct, frozen=True):
    """What the beams say: unit vectors (north, east) towards what horizontal ones read nearer
    than allowed, and the surfaces above and below (inf when none is read).
    """

    near: tuple[tuple[float, float], ...]
    ceiling_m: float
    ground_m: float


class Guard:
    """Limits setpoints. Same sequence of checks, same verdicts: no clock, no randomness inside."""

    def __init__(self, config: GuardConfig) -> None:
        self._config = config
        self._speed_max_m_s = config.speed_max_m_s
        self._gain = config.position_gain_per_s
        self._reaction_s = config.reaction_s
        self._braking_m_s2 = config.braking_m_s2
        self._known_beams: dict[str, _Beam] = {}
        self._beam_stop_m = config.beam_stop_m
        points = config.fence.polygon_ne_m
        self._edges = tuple(itertools.pairwise((*points, points[0])))
        self._fence_at = (0.0, 0.0)
        self._fence_inside_m = config.fence.inside_distance_m(*self._fence_at)
        self._anchor: Vector3 | None = None
        self.horizon_m = stopping_distance_m(
            config.speed_max_m_s, config.reaction_s, config.braking_m_s2
        )
        """How far ahead must be free for full speed."""

    def check(self, setpoint: Setpoint, sight: Sight) -> GuardVerdict:
        """The setpoint that may be sent now, and which limits changed it."""
        stale = self._stale(setpoint, sight)
        if stale is not None:
            return self._hold_everything(setpoint, sight, stale)
        limits: list[str] = []
        offset = self._leashed(subtract(setpoint.position_ned_m, sight.position_ned_m), limits)
        velocity = setpoint.velocity_ned_m_s
        around = self._surroundings(sight)
        offset, velocity = self._vertical(
            offset, velocity, -sight.position_ned_m[2], around, limits
        )
        offset, velocity = self._off_near_beams(offset, velocity, around.near, limits)
        offset, velocity = self._at_most_top_speed(offset, velocity, limits)
        offset, velocity, speed_limit_m_s, free_m = self._with_room(offset, velocity, sight, limits)
        if velocity[:2] == (0.0, 0.0) and offset[:2] == (0.0, 0.0) and limits:
            anchor = self._hold_at(sight, around.near)
            back = subtract(anchor, sight.position_ned_m)
            offset = (back[0], back[1], offset[2])
        else:
            self._release(setpoint)
        if not limits:
            return GuardVerdict(setpoint, (), speed_limit_m_s, free_m)
        limited = Setpoint(
            setpoint.stamp_s, add(sight.position_ned_m, offset), velocity, setpoint.yaw_rad
        )
        return GuardVerdict(limited, tuple(limits), speed_limit_m_s, free_m)

    # ------------------------------------------------------------ age, and what a hold is (1)

    def _stale(self, setpoint: Setpoint, sight: Sight) -> str | None:
        """Old position or old setpoint (or one from the future): nobody is flying this vehicle."""
        age_s = sight.now_s - sight.fused_stamp_s
        if not sight.position_ok or age_s > self._config.position_max_age_s:
            return POSITION_STALE
        if abs(sight.now_s - setpoint.stamp_s) > self._config.setpoint_max_age_s:
            return SETPOINT_STALE
        return None

    def _hold_everything(self, setpoint: Setpoint, sight: Sight, reason: str) -> GuardVerdict:
        """Position and heading as they are, zero velocity; the same object if it says so already.

        The stamp is fresh: this setpoint was made now, by the guard. While the position is known
        the hold keeps its distance from a surface above and below, too.
        """
        around = self._surroundings(sight)
        anchor = self._hold_at(sight, around.near)
        limits = [reason]
        if reason == SETPOINT_STALE:
            back = subtract(anchor, sight.position_ned_m)
            altitude = -sight.position_ned_m[2]
            offset, _ = self._vertical(back, ZERO3, altitude, around, limits)
            if offset[2] != back[2]:
                anchor = (anchor[0], anchor[1], sight.position_ned_m[2] + offset[2])
        hold = Setpoint(sight.now_s, anchor, yaw_rad=sight.yaw_rad)
        if hold == setpoint:
            hold = setpoint
        return GuardVerdict(hold, tuple(limits), 0.0, 0.0)

    def _hold_at(self, sight: Sight, near: tuple[tuple[float, float], ...]) -> Vector3:
        """Where the present hold began; it begins now if there is none, or none worth keeping."""
        anchor = self._anchor
        if anchor is not None:
            back = subtract(anchor, sight.position_ned_m)
            if norm(back) > HOLD_REACH_M or _towards(back[0], back[1], near):
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

    # ------------------------------------------------------------ leash (7), top speed (2)

    def _leashed(self, offset: Vector3, limits: list[str]) -> Vector3:
        """The position setpoint at most `leash_m` from the vehicle."""
        length = norm(offset)
        if length <= self._config.leash_m * (1.0 + _ROUNDING):
            return offset
        limits.append(LEASH)
        return scale(offset, self._config.leash_m / length)

    def _effective(self, offset: Vector3, velocity: Vector3) -> tuple[float, float]:
        """The horizontal velocity that PX4 will fly (north, east)."""
        return velocity[0] + self._gain * offset[0], velocity[1] + self._gain * offset[1]

    def _at_most_top_speed(
        self, offset: Vector3, velocity: Vector3, limits: list[str]
    ) -> tuple[Vector3, Vector3]:
        """Effective velocity and feed-forward alone both within `speed_max_m_s`."""
        n, e = self._effective(offset, velocity)
        speed = max(math.hypot(n, e), math.hypot(velocity[0], velocity[1]))
        if speed <= self._speed_max_m_s * (1.0 + _ROUNDING):
            return offset, velocity
        limits.append(SPEED)
        factor = self._speed_max_m_s / speed
        return (
            (offset[0] * factor, offset[1] * factor, offset[2]),
            (velocity[0] * factor, velocity[1] * factor, velocity[2]),
        )

    # ------------------------------------------------------------ altitude (6)

    def _vertical(
        self,
        offset: Vector3,
        velocity: Vector3,
        altitude: float,
        around: _Surroundings,
        limits: list[str],
    ) -> tuple[Vector3, Vector3]:
        """Climb rate, altitude band, ceiling and ground: scaled, or a retreat from a surface."""
        config = self._config
        lowest = min(config.altitude_min_m, altitude)
        highest = max(config.altitude_max_m, altitude)
        rise = -offset[2]
        if not lowest - _ROUNDING <= altitude + rise <= highest + _ROUNDING:
            limits.append(ALTITUDE)
            rise = min(highest, max(lowest, altitude + rise)) - altitude
        climb = -velocity[2]
        wanted = max(abs(climb + HEIGHT_GAIN_PER_S * rise), abs(climb))
        reason: str | None = None
        if wanted > config.climb_max_m_s + _ROUNDING:
            reason = CLIMB
            rise *= config.climb_max_m_s / wanted
            climb *= config.climb_max_m_s / wanted
        effective = climb + HEIGHT_GAIN_PER_S * rise
        slowest, fastest = self._climb_range(altitude, around)
        limit = None
        if effective > fastest[0] + _ROUNDING:
            limit = fastest
        elif effective < slowest[0] - _ROUNDING:
            limit = slowest
        if limit is not None:
            allowed, reason = limit
            if allowed * effective >= 0.0 and abs(allowed) < abs(effective):
                rise, climb = rise * allowed / effective, climb * allowed / effective
            else:
                rise, climb = allowed / HEIGHT_GAIN_PER_S, 0.0
        if reason is not None and reason not in limits:
            limits.append(reason)
        if reason is None and rise == -offset[2]:
            return offset, velocity
        return self._leashed_at(offset, rise), (velocity[0], velocity[1], -climb)

    def _climb_range(
        self, altitude_m: float, around: _Surroundings
    ) -> tuple[tuple[float, str], tuple[float, str]]:
        """((least, its limit), (greatest, its limit)) velocity up that PX4 may fly.

        Both are beyond zero on the same side when a surface is too near: the way back to the
        height at which it is `beam_stop_m` away. Between two such surfaces that height is the
        middle.
        """
        config = self._config
        above_m = max(0.0, config.altitude_max_m - altitude_m)
        below_m = max(0.0, altitude_m - config.altitude_min_m)
        up_m, down_m = around.ceiling_m - self._beam_stop_m, around.ground_m - self._beam_stop_m
        if below_m == 0.0:
            # Below the band it may stand on the floor: no reason to take off.
            down_m = math.inf
        if up_m < 0.0 and down_m < 0.0:
            up_m = (up_m - down_m) / 2.0
            down_m = -up_m
        up_m, down_m = max(up_m, -max(0.0, down_m)), max(down_m, -max(0.0, up_m))
        up_limit = CEILING if up_m < above_m else ALTITUDE
        down_limit = GROUND if down_m < below_m else ALTITUDE
        retreat_m_s = min(RETREAT_M_S, config.climb_max_m_s, HEIGHT_GAIN_PER_S * config.leash_m)
        fastest = max(-retreat_m_s, HEIGHT_GAIN_PER_S * max(-below_m, min(up_m, above_m)))
        slowest = max(-retreat_m_s, HEIGHT_GAIN_PER_S * max(-above_m, min(down_m, below_m)))
        return (-slowest, down_limit), (fastest, up_limit)

    def _leashed_at(self, offset: Vector3, rise_m: float) -> Vector3:
        """`offset` with another height, shortened horizontally where the leash asks for it."""
        level_m = math.hypot(offset[0], offset[1])
        leash2 = self._config.leash_m**2
        room_m = math.sqrt(leash2 - min(leash2, rise_m * rise_m))
        factor = room_m / level_m if level_m > room_m * (1.0 + _ROUNDING) else 1.0
        return (offset[0] * factor, offset[1] * factor, -rise_m)

    # ------------------------------------------------------------ raw beams (4)

    def _beam(self, mount: BeamMount) -> _Beam:
        """The mount's geometry, computed once."""
        known = self._known_beams.get(mount.name)
        if known is None or known.mount is not mount:
            known = self._known_beams[mount.name] = _beam(mount)
        return known

    def _surroundings(self, sight: Sight) -> _Surroundings:
        """What the beams say, measured from the vehicle's centre.

        A doubted reading counts where it says "near": above and below it ends the approach, but
        is no reason to move.
        """
        bearings: list[tuple[float, float]] = []
        ceiling_m = ground_m = math.inf
        for seen in sight.beams:
            reading, beam = seen.reading, self._beam(seen.mount)
            status = reading.status
            if status is RangeStatus.NO_SIGNAL or status is RangeStatus.OUT_OF_RANGE:
                continue
            distance_m = reading.range_m * beam.projection + beam.face_m
            if status is RangeStatus.SUSPECT:
                if distance_m >= self._beam_stop_m:
                    continue
                if beam.rise:
                    distance_m = self._beam_stop_m
            if beam.rise > 0:
                ceiling_m = min(ceiling_m, distance_m)
            elif beam.rise < 0:
                ground_m = min(ground_m, distance_m)
            elif distance_m < self._beam_stop_m:
                bearing = sight.yaw_rad + beam.yaw_rad
                bearings.append((math.cos(bearing), math.sin(bearing)))
        return _Surroundings(tuple(bearings), ceiling_m, ground_m)

    def _off_near_beams(
        self,
        offset: Vector3,
        velocity: Vector3,
        near: tuple[tuple[float, float], ...],
        limits: list[str],
    ) -> tuple[Vector3, Vector3]:
        """No component towards a near reading, whatever the map says; no way left: no motion."""
        if not near or not _towards(*self._effective(offset, velocity), near):
            return offset, velocity
        limits.append(BEAM)
        for un, ue in near:
            n, e = self._effective(offset, velocity)
            if n * un + e * ue > _ROUNDING:
                offset = _without(offset, un, ue)
                velocity = _without(velocity, un, ue)
        if _towards(*self._effective(offset, velocity), near):
            # Taking one component away brought another back: the beams close a wedge.
            offset, velocity = (0.0, 0.0, offset[2]), (0.0, 0.0, velocity[2])
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
            return offset, velocity, self._speed_max_m_s, self.horizon_m
        allowed, free_m, reason = self._allowed(n / speed, e / speed, sight)
        factor = 1.0
        if self._must_brake(n, e, sight):
            limits.append(BRAKE)
            factor = 0.0
        if speed > allowed * (1.0 + _ROUNDING):
            limits.append(reason)
            factor *= allowed / speed
        offset = (offset[0] * factor, offset[1] * factor, offset[2])
        velocity = (velocity[0] * factor, velocity[1] * factor, velocity[2])
        return offset, velocity, allowed, free_m

    def _must_brake(self, north: float, east: float, sight: Sight) -> bool:
        """The vehicle moves faster than it can stop, and the command (north, east) feeds that."""
        vn, ve = sight.velocity_ned_m_s[0], sight.velocity_ned_m_s[1]
        actual = math.hypot(vn, ve)
        if actual <= DRIFT_M_S:
            return False
        un, ue = vn / actual, ve / actual
        fed = north * un + east * ue
        allowed, _, _ = self._allowed(un, ue, sight)
        return actual > allowed and fed > allowed * (1.0 + _ROUNDING)

    def _allowed(self, un: float, ue: float, sight: Sight) -> tuple[float, float, str]:
        """(speed, free distance, limit) along the unit vector (north, east)."""
        sigma = sight.position_sigma_m
        heading = math.atan2(ue, un)
        reach_m = self.horizon_m + sigma
        fence_m = self._fence_distance_m(sight.position_ned_m, un, ue, reach_m)
        seen_m = sight.space.free_distance_m(sight.position_ned_m, heading, reach_m, sight.now_s)
        free_m = min(self.horizon_m, fence_m - sigma, seen_m - sigma)
        reason = FENCE if fence_m < seen_m else FREE_SPACE
        if free_m >= self.horizon_m:
            return self._speed_max_m_s, self.horizon_m, reason
        speed = stopping_speed_m_s(free_m, self._reaction_s, self._braking_m_s2)
        if seen_m <= 0.0 and self._is_escape(heading, un, ue, sight):
            room = stopping_speed_m_s(fence_m - sigma, self._reaction_s, self._braking_m_s2)
            speed = min(ESCAPE_SPEED_M_S, self._speed_max_m_s, room)
        return speed, max(0.0, free_m), reason

    def _is_escape(self, heading_rad: float, un: float, ue: float, sight: Sight) -> bool:
        """Away from a hit that is already too near, to seen and open space within one short step.

        Without it a vehicle that drifted into a hit's keep-out could never leave it: from there no
        direction is free. True when all of these hold:
        - a hit is known within beam_stop_m + the longest step;
        - the direction leads away from the nearest one (cosine at least ESCAPE_COSINE);
        - from one of ESCAPE_STEPS_M along it the way is free (seen, and off every hit).
        """
        position = sight.position_ned_m
        space = sight.space
        nearest = space.nearest_hit(position, self._beam_stop_m + ESCAPE_STEPS_M[-1])
        if nearest is None or math.cos(heading_rad - nearest[1]) > -ESCAPE_COSINE:
            return False
        return any(
            space.free_distance_m(
                (position[0] + un * step, position[1] + ue * step, position[2]),
                heading_rad,
                ESCAPE_STEPS_M[0],
                sight.now_s,
            )
            > 0.0
            for step in ESCAPE_STEPS_M
        )

    def _fence_distance_m(self, position: Vector3, un: float, ue: float, reach_m: float) -> float:
        """How far along the unit vector the fence is, at most `reach_m`.

        Outside (or on it): `reach_m` for a direction that leads inwards, else 0.
        """
        fence = self._config.fence
        # The distance changes by no more than the way travelled since it was last computed.
        travelled_m = math.hypot(position[0] - self._fence_at[0], position[1] - self._fence_at[1])
        if self._fence_inside_m - travelled_m >= reach_m:
            return reach_m
        inside_m = fence.inside_distance_m(position[0], position[1])
        self._fence_at, self._fence_inside_m = (position[0], position[1]), inside_m
        if inside_m <= _ROUNDING:
            ahead_m = fence.inside_distance_m(
                position[0] + un * _INWARD_STEP_M, position[1] + ue * _INWARD_STEP_M
            )
            return reach_m if ahead_m - inside_m >= _INWARD_COSINE * _INWARD_STEP_M else 0.0
        for a, b in self._edges:
            reach_m = min(reach_m, _crossing_m(position[0], position[1], un, ue, a, b))
        return reach_m


def _towards(north: float, east: float, near: tuple[tuple[float, float], ...]) -> bool:
    """True when the vector has a component along one of the unit vectors."""
    return any(north * un + east * ue > _ROUNDING for un, ue in near)


def _without(vector: Vector3, un: float, ue: float) -> Vector3:
    """`vector` less its horizontal component along the unit vector (un, ue)."""
    along = vector[0] * un + vector[1] * ue
    return (vector[0] - along * un, vector[1] - along * ue, vector[2])


def _crossing_m(
    north: float, east: float, un: float, ue: float, a: tuple[float, float], b: tuple[float, float]
) -> float:
    """Where the ray from (north, east) along (un, ue) meets the edge a-b; inf when it does not."""
    edge_n, edge_e = b[0] - a[0], b[1] - a[1]
    cross = un * edge_e - ue * edge_n
    if cross == 0.0:
        return math.inf
    from_n, from_e = a[0] - north, a[1] - east
    along_ray = (from_n * edge_e - from_e * edge_n) / cross
    along_edge = (from_n * ue - from_e * un) / cross
    if along_ray < 0.0 or not -_ROUNDING <= along_edge <= 1.0 + _ROUNDING:
        return math.inf
    return along_ray
