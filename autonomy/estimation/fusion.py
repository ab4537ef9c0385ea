"""Readings to one fused state: gates, resets, delays. Synchronous and deterministic.

The frame is the autopilot's local NED frame, because setpoints are flown in it. Its own position
and velocity lead; GNSS is placed in that frame and can only steady it; the down beam gives the
height over the surface below and never the altitude.
"""

import math

from autonomy.config import EstimationConfig
from autonomy.estimation.kalman import Kalman
from autonomy.model import FusedState
from hal.config import BeamMount, BeamsConfig
from hal.frames import (
    ZERO3,
    Vector3,
    add,
    ned_from_geodetic,
    norm,
    rotate_frd_to_ned,
    scale,
    subtract,
    wrap_pi,
)
from hal.readings import Attitude, GnssFix, LocalPosition, RangeReading, RangeStatus

UNKNOWN_SIGMA_M = 1000.0
_MOVING_M_S = 0.001  # slower than that, two messages of one place are no wonder
"""Position uncertainty before anything was measured (finite, so that it can be logged as JSON)."""
ORIGIN_FIXES = 10
"""So many GNSS fixes are averaged against the local position to learn where its origin is."""
TERRAIN_STEP_READINGS = 3
"""So many rejected heights in a row are a new surface, not outliers."""
GAP_RESTART_S = 1.0
"""After a silence this long the old state says nothing: the next reading starts anew."""
TILT_MAX_RAD = math.radians(30.0)
"""Tilted more than this, the down beam no longer looks at the surface below."""


class _GnssOrigin:
    """Where GNSS positions lie in the local frame, learned from the first fixes."""

    def __init__(self) -> None:
        self._reference: Vector3 | None = None
        self._offset_sum: Vector3 = ZERO3
        self._count = 0

    def shift(self, offset_ned_m: Vector3) -> None:
        """The local frame moved."""
        self._offset_sum = add(self._offset_sum, scale(offset_ned_m, float(self._count)))

    def place(self, fix: GnssFix, local_ned_m: Vector3) -> Vector3 | None:
        """The fix in local NED, or None while the origin is being learned (from this fix too)."""
        if self._reference is None:
            self._reference = (fix.latitude_deg, fix.longitude_deg, fix.amsl_m)
        ned = ned_from_geodetic(fix.latitude_deg, fix.longitude_deg, fix.amsl_m, self._reference)
        if self._count < ORIGIN_FIXES:
            self._offset_sum = add(self._offset_sum, subtract(local_ned_m, ned))
            self._count += 1
            return None
        return add(ned, scale(self._offset_sum, 1.0 / self._count))


class _DownBeam:
    """Height over the surface below, from the beam that looks down most steeply."""

    def __init__(self, beams: BeamsConfig) -> None:
        mounts = [m for m in beams.mounts if m.pitch_deg <= -60.0]
        self._mount: BeamMount | None = min(mounts, key=lambda m: m.pitch_deg, default=None)
        if self._mount is None:
            return
        yaw, pitch = math.radians(self._mount.yaw_deg), math.radians(self._mount.pitch_deg)
        self._look_frd: Vector3 = (
            math.cos(pitch) * math.cos(yaw),
            math.cos(pitch) * math.sin(yaw),
            -math.sin(pitch),
        )
        self._face_frd_m: Vector3 = (
            self._mount.forward_m,
            self._mount.right_m,
            self._mount.down_m,
        )

    def newest(self, ranges: tuple[RangeReading, ...]) -> RangeReading | None:
        """The newest valid reading of that beam among `ranges`."""
        if self._mount is None:
            return None
        name = self._mount.name
        found = [r for r in ranges if r.beam == name and r.status is RangeStatus.VALID]
        return max(found, key=lambda r: r.stamp_s) if found else None

    def height_m(self, reading: RangeReading, attitude: Attitude) -> float | None:
        """Height of the vehicle's centre over the surface; None when too tilted to say."""
        if max(abs(attitude.roll_rad), abs(attitude.pitch_rad)) > TILT_MAX_RAD:
            return None
        beam_frd = add(self._face_frd_m, scale(self._look_frd, reading.range_m))
        return rotate_frd_to_ned(beam_frd, attitude.roll_rad, attitude.pitch_rad, 0.0)[2]


class Fusion:
    """Owns the filter; one `step` per tick. Same inputs, bit-identical states."""

    def __init__(self, config: EstimationConfig, beams: BeamsConfig) -> None:
        self._config = config
        self._beam_stale_s = beams.stale_after_s
        self._kalman = Kalman(config.acceleration_noise_m_s2, config.gate_sigma)
        self._down = _DownBeam(beams)
        self._origin = _GnssOrigin()
        self._filter_s = -math.inf
        """Time up to which the filter was moved: the newest stamp that it took notice of."""
        self._fused_s = -math.inf
        """Stamp of the last local position that was fused."""
        self._reset_counter = 0
        self._newest: LocalPosition | None = None
        self._rejected_in_a_row = 0
        self._gnss_stamp_s = -math.inf
        self._gnss_rejected_in_a_row = 0
        self._height_stamp_s = -math.inf
        self._supported_s = -math.inf
        """Stamp of the last height that agrees with the surface estimate."""
        self._heights_rejected_in_a_row = 0

    def step(
        self,
        now_s: float,
        local_position: LocalPosition | None,
        attitude: Attitude | None,
        gnss: GnssFix | None,
        ranges: tuple[RangeReading, ...],
    ) -> FusedState:
        """The state at `now_s` from the newest readings (old ones may be handed in again).

        Local position and GNSS count once, by stamp. `frame_shift_ned_m` is set on the step at
        which the autopilot's frame jumped: `position_ned_m` is in the new frame, and what was
        placed in the old one has to be moved by as much.
        """
        shift = ZERO3
        new = local_position is not None and local_position.stamp_s > self._filter_s
        if local_position is not None and new and not self._repeats(local_position):
            shift = self._take_local(local_position)
        if self._filter_s > -math.inf:
            if gnss is not None and gnss.stamp_s > self._gnss_stamp_s:
                self._take_gnss(gnss)
            if attitude is not None:
                self._take_height(ranges, attitude)
        return self._state(now_s, attitude, shift)

    # ------------------------------------------------------------ local position

    def _repeats(self, local: LocalPosition) -> bool:
        """True for a message that moves and is at the very same place as the one before it.

        Whoever sends that sends an old estimate with new stamps: what moves is not where it was.
        """
        before, self._newest = self._newest, local
        return (
            before is not None
            and local.stamp_s > before.stamp_s
            and norm(local.velocity_ned_m_s) > _MOVING_M_S
            and local.position_ned_m == before.position_ned_m
            and local.velocity_ned_m_s == before.velocity_ned_m_s
        )

    def _take_local(self, local: LocalPosition) -> Vector3:
        """Fuse a new local position; returns how far the frame jumped."""
        config = self._config
        dt_s = local.stamp_s - self._filter_s
        self._filter_s = local.stamp_s
        was_reset = local.reset_counter != self._reset_counter
        self._reset_counter = local.reset_counter
        if dt_s == math.inf:
            self._start(local)
            return ZERO3
        self._kalman.predict(min(dt_s, GAP_RESTART_S))
        if was_reset:
            return self._jump(local)
        if dt_s > GAP_RESTART_S:
            self._start(local)
            return ZERO3
        position, _ = self._kalman.update(
            local.position_ned_m,
            local.velocity_ned_m_s,
            config.local_position_sigma_m,
            config.local_velocity_sigma_m_s,
        )
        if position.fused:
            self._rejected_in_a_row = 0
            self._fused_s = local.stamp_s
            return ZERO3
        self._rejected_in_a_row += 1
        if self._rejected_in_a_row < config.reset_after_rejections:
            return ZERO3
        # The autopilot insists. Setpoints are flown in its frame, so its frame has moved.
        return self._jump(local)

    def _start(self, local: LocalPosition) -> None:
        self._kalman.start(
            local.position_ned_m,
            local.velocity_ned_m_s,
            self._config.local_position_sigma_m,
            self._config.local_velocity_sigma_m_s,
        )
        self._rejected_in_a_row = 0
        self._fused_s = local.stamp_s

    def _jump(self, local: LocalPosition) -> Vector3:
        """Move filter, surface and GNSS origin with the frame, then start from the reading.

        A horizontal or vertical jump within the noise is none (a reset may concern one of them,
        or the heading alone); it would only shake the map.
        """
        gap = subtract(local.position_ned_m, self._kalman.position_ned_m)
        noise_m = 2.0 * self._config.local_position_sigma_m
        horizontal = math.hypot(gap[0], gap[1]) > noise_m
        vertical = abs(gap[2]) > noise_m
        shift = (
            gap[0] if horizontal else 0.0,
            gap[1] if horizontal else 0.0,
            gap[2] if vertical else 0.0,
        )
        self._kalman.shift(shift)
        self._origin.shift(shift)
        self._start(local)
        return shift

    # ------------------------------------------------------------ GNSS

    def _take_gnss(self, fix: GnssFix) -> None:
        """Fuse a new fix, moved from its stamp to the filter's time by the velocity.

        Its accuracy is never believed below the floor: errors of neighbouring fixes are alike. A
        fix cannot move the state against the autopilot for long: after too many rejections it is
        the origin that is learned anew.
        """
        self._gnss_stamp_s = fix.stamp_s
        delay_s = self._filter_s - fix.stamp_s
        if not fix.fix_type.has_position or abs(delay_s) > GAP_RESTART_S:
            return
        travelled = scale(self._kalman.velocity_ned_m_s, delay_s)
        position = subtract(self._kalman.position_ned_m, travelled)
        placed = self._origin.place(fix, position)
        if placed is None:
            return
        sigma_m = max(
            self._config.gnss_sigma_floor_m, fix.horizontal_accuracy_m, fix.vertical_accuracy_m
        )
        if self._kalman.update_position(add(placed, travelled), sigma_m).fused:
            self._gnss_rejected_in_a_row = 0
            return
        self._gnss_rejected_in_a_row += 1
        if self._gnss_rejected_in_a_row >= self._config.reset_after_rejections:
            self._gnss_rejected_in_a_row = 0
            self._origin = _GnssOrigin()

    # ------------------------------------------------------------ down beam

    def _take_height(self, ranges: tuple[RangeReading, ...], attitude: Attitude) -> None:
        """Fuse a new height into the surface below; a lasting step is a new surface."""
        reading = self._down.newest(ranges)
        if reading is None or reading.stamp_s <= self._height_stamp_s:
            return
        self._height_stamp_s = reading.stamp_s
        height_m = self._down.height_m(reading, attitude)
        if height_m is None:
            return
        # A driver's variance is repeatability; the surface itself is rougher than that.
        sigma_m = max(self._config.height_sigma_m, math.sqrt(reading.variance_m2))
        if not self._kalman.update_height(height_m, sigma_m).fused:
            self._heights_rejected_in_a_row += 1
            if self._heights_rejected_in_a_row < TERRAIN_STEP_READINGS:
                return
            self._kalman.start_terrain(height_m, sigma_m)
        self._heights_rejected_in_a_row = 0
        self._supported_s = reading.stamp_s

    # ------------------------------------------------------------ result

    def _state(self, now_s: float, attitude: Attitude | None, shift: Vector3) -> FusedState:
        """The state moved to now, as far as that can be answered for (`stale_after_s`)."""
        if self._filter_s == -math.inf:
            why = "no local position yet"
            return FusedState(
                now_s, ZERO3, ZERO3, 0.0, UNKNOWN_SIGMA_M, None, ok=False, why_not_ok=why
            )
        config = self._config
        ahead_s = min(max(0.0, now_s - self._filter_s), config.stale_after_s)
        velocity = self._kalman.velocity_ned_m_s
        position = add(self._kalman.position_ned_m, scale(velocity, ahead_s))
        sigma_m = self._kalman.position_sigma_m(ahead_s)
        why = self._why_not_ok(now_s, attitude, sigma_m)
        roll = pitch = yaw = rate = 0.0
        if attitude is not None:
            roll, pitch, rate = attitude.roll_rad, attitude.pitch_rad, attitude.yaw_rate_rad_s
            turned_s = min(max(0.0, now_s - attitude.stamp_s), config.stale_after_s)
            yaw = wrap_pi(attitude.yaw_rad + rate * turned_s)
        return FusedState(
            stamp_s=self._filter_s + ahead_s,
            position_ned_m=position,
            velocity_ned_m_s=velocity,
            yaw_rad=yaw,
            position_sigma_m=min(sigma_m, UNKNOWN_SIGMA_M),
            height_agl_m=self._height_agl_m(now_s, position[2]),
            ok=not why,
            why_not_ok=why,
            roll_rad=roll,
            pitch_rad=pitch,
            yaw_rate_rad_s=rate,
            frame_shift_ned_m=shift,
        )

    def _height_agl_m(self, now_s: float, down_m: float) -> float | None:
        terrain_m = self._kalman.terrain_down_m
        if terrain_m is None or now_s - self._supported_s > self._beam_stale_s:
            return None
        return terrain_m - down_m

    def _why_not_ok(self, now_s: float, attitude: Attitude | None, sigma_m: float) -> str:
        """The first reason not to fly by this state; empty when there is none."""
        limit_s = self._config.stale_after_s
        if now_s - self._filter_s > limit_s:
            return f"local position is {now_s - self._filter_s:.2f} s old"
        if self._filter_s - now_s > limit_s:
            return f"local position is {self._filter_s - now_s:.2f} s in the future"
        if now_s - self._fused_s > limit_s:
            return f"local position was rejected {self._rejected_in_a_row} times in a row"
        if attitude is None:
            return "no attitude yet"
        if abs(now_s - attitude.stamp_s) > limit_s:
            return f"attitude is {abs(now_s - attitude.stamp_s):.2f} s old"
        if sigma_m > self._config.sigma_max_m:
            return f"position is uncertain to {sigma_m:.2f} m"
        return ""
