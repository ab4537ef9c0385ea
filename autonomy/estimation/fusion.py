"""Readings to one fused state: gates, resets, delays. Synchronous and deterministic.

The frame is the autopilot's local NED frame, because setpoints are flown in it. Its own position
and velocity lead; GNSS has a bias of its own against them and can only warn; the vertical beams
give floor and ceiling and never the altitude.
"""

import math

from autonomy.config import EstimationConfig
from autonomy.estimation.counts import Count
from autonomy.estimation.gnss import Apartness, Places, finite
from autonomy.estimation.kalman import SIGMA_MAX_M, Kalman
from autonomy.estimation.surfaces import Levels, Surface, VerticalBeam
from autonomy.estimation.timeline import HISTORY_S, GnssObservation, LocalObservation, Timeline
from autonomy.model import Event, FilterHealth, FusedState
from hal.config import BeamsConfig
from hal.frames import ZERO3, Vector3, add, norm, scale, subtract, wrap_pi
from hal.readings import Attitude, GnssFix, LocalPosition, RangeReading

UNKNOWN_SIGMA_M = SIGMA_MAX_M
"""Position uncertainty before anything was measured (finite, so that it can be logged as JSON)."""
GAP_RESTART_S = HISTORY_S
"""After a silence this long the old state says nothing: the next reading starts anew."""
_MOVING_M_S = 0.001  # slower than that, two messages of one place are no wonder


class Fusion:
    """Owns the filter; one `step` per tick. Same inputs, bit-identical states."""

    def __init__(self, config: EstimationConfig, beams: BeamsConfig) -> None:
        self._config = config
        self._beam_stale_s = beams.stale_after_s
        self._kalman = Kalman(
            config.acceleration_noise_m_s2, config.gate_sigma, config.gnss_bias_noise_m_per_sqrt_s
        )
        self._timeline = Timeline(self._kalman)
        self._began_s: float | None = None
        self._news: list[tuple[str, str]] = []
        self._frame_jumps = self._late = self._restarts = 0

        self._local_s = -math.inf
        """Stamp of the newest local position that was taken notice of."""
        self._late_local_s = -math.inf
        self._reset_counter = 0
        self._newest: LocalPosition | None = None
        self._position, self._velocity = Count(), Count()

        self._fix_s = self._future_fix_s = -math.inf
        self._places = Places()
        self._apartness = Apartness(config.gnss_apart_m)
        self._gnss = Count()

        self._beams = (VerticalBeam(beams, -1), VerticalBeam(beams, 1))
        self._surfaces = (Surface(config.gate_sigma), Surface(config.gate_sigma))
        self._levels = Levels(*self._surfaces)
        self._level_counts = (Count(), Count())
        self._level_s = [-math.inf, -math.inf]

    def step(
        self,
        now_s: float,
        local_position: LocalPosition | None,
        attitude: Attitude | None,
        gnss: GnssFix | None,
        ranges: tuple[RangeReading, ...],
    ) -> FusedState:
        """The state at `now_s` from the newest readings (old ones may be handed in again).

        Every reading counts once, by stamp, and at its stamp: a late one changes what came after
        it, too. `frame_shift_ned_m` is set on the step at which the autopilot's frame jumped:
        `position_ned_m` is in the new frame, and what was placed in the old one has to be moved by
        as much.
        """
        shift = ZERO3
        if local_position is not None:
            shift = self._take_local(local_position)
        if self._began_s is not None:
            if gnss is not None and gnss.stamp_s > self._fix_s:
                self._take_gnss(now_s, gnss)
            if attitude is not None:
                self._take_levels(ranges, attitude)
            self._news.extend(self._levels.news(now_s))
        return self._state(now_s, attitude, shift)

    # ------------------------------------------------------------ local position

    def _take_local(self, local: LocalPosition) -> Vector3:
        """Fuse a local position that is new; returns how far the frame jumped."""
        if local.stamp_s > self._local_s:
            return ZERO3 if self._repeats(local) else self._take_newest(local)
        if local.stamp_s not in (self._local_s, self._late_local_s):
            self._late_local_s = local.stamp_s
            # One from before a reset lies in a frame that is no more.
            if local.reset_counter == self._reset_counter and self._began_s is not None:
                self._late += self._fuse_local(local) is not None
        return ZERO3

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

    def _take_newest(self, local: LocalPosition) -> Vector3:
        silent_s = local.stamp_s - self._local_s
        self._local_s = local.stamp_s
        was_reset = local.reset_counter != self._reset_counter
        self._reset_counter = local.reset_counter
        if self._began_s is None:
            self._began_s = local.stamp_s
            self._begin(local)
            return ZERO3
        if was_reset:
            return self._jump(local, "the autopilot reset its estimate")
        if silent_s > GAP_RESTART_S:
            self._restart(local, f"local position was silent for {silent_s:.1f} s")
            return ZERO3
        if self._fuse_local(local) is not False:
            return ZERO3
        if self._position.rejected_in_a_row < self._config.reset_after_rejections:
            return ZERO3
        # The autopilot insists. Setpoints are flown in its frame, so its frame has moved.
        rejected = self._position.rejected_in_a_row
        return self._jump(local, f"the autopilot insists after {rejected} rejected positions")

    def _observed(self, local: LocalPosition, *, anew: bool = False) -> LocalObservation:
        return LocalObservation(
            local.stamp_s,
            local.position_ned_m,
            local.velocity_ned_m_s,
            self._config.local_position_sigma_m,
            self._config.local_velocity_sigma_m_s,
            anew,
        )

    def _fuse_local(self, local: LocalPosition) -> bool | None:
        """Whether its position passed the gate; None when it came too late."""
        tests = self._timeline.insert(self._observed(local))
        if tests is None:
            self._position.refused()
            return None
        position, velocity = tests
        self._position.note(position, local.stamp_s)
        self._velocity.note(velocity, local.stamp_s)
        why = self._kalman.why_unhealthy()
        if why:
            self._kalman.forget_bias()
            self._restart(local, why)
        return position.fused

    def _begin(self, local: LocalPosition) -> None:
        self._timeline.begin(self._observed(local))
        self._position.began(local.stamp_s)
        self._velocity.began(local.stamp_s)

    def _restart(self, local: LocalPosition, why: str) -> None:
        self._restarts += 1
        self._news.append(("filter_restart", f"the position filter began anew: {why}"))
        self._begin(local)

    def _jump(self, local: LocalPosition, why: str) -> Vector3:
        """Move filter, surfaces and GNSS bias with the frame, then start from the reading.

        A horizontal or vertical jump within the noise is none (a reset may concern one of them,
        or the heading alone); it would only shake the map.
        """
        gap = subtract(local.position_ned_m, self._timeline.position_at(local.stamp_s))
        noise_m = 2.0 * self._config.local_position_sigma_m
        horizontal = math.hypot(gap[0], gap[1]) > noise_m
        vertical = abs(gap[2]) > noise_m
        shift = (
            gap[0] if horizontal else 0.0,
            gap[1] if horizontal else 0.0,
            gap[2] if vertical else 0.0,
        )
        if shift != ZERO3:
            self._frame_jumps += 1
            words = f"the frame moved by ({shift[0]:.2f}, {shift[1]:.2f}, {shift[2]:.2f}) m NED"
            self._news.append(("frame_jump", f"{why}: {words}, and the map with it"))
            self._timeline.shift(shift)
            self._apartness.shift((shift[0], shift[1]))
            for surface in self._surfaces:
                surface.shift(shift[2])
        tests = self._timeline.insert(self._observed(local, anew=True))
        if tests is None:
            self._timeline.begin(self._observed(local))
        self._position.began(local.stamp_s)
        self._velocity.began(local.stamp_s)
        return shift

    # ------------------------------------------------------------ GNSS

    def _take_gnss(self, now_s: float, fix: GnssFix) -> None:
        """Fuse a new fix where it belongs.

        Errors of neighbouring fixes are alike: one is enough for `gnss_interval_s`, and its
        accuracy is never believed below the floor. It cannot move the state against the autopilot:
        its bias takes what lasts, and after too many rejections the bias is learned anew.
        """
        config = self._config
        stamp_s = min(fix.stamp_s, now_s)
        if fix.stamp_s - now_s > config.stale_after_s:
            # Its time is not believed, and must not make those that come after it old.
            if fix.stamp_s != self._future_fix_s:
                self._future_fix_s = fix.stamp_s
                self._gnss.refused()
            return
        if stamp_s > self._local_s + config.stale_after_s:
            return  # GNSS alone carries nothing; it is fused when the autopilot is heard again.
        self._fix_s = fix.stamp_s
        if not fix.fix_type.has_position or stamp_s - self._gnss.fused_s < config.gnss_interval_s:
            return
        if self._began_s is None or stamp_s < self._began_s:
            return
        place = self._places.place(fix, self._timeline.position_at(stamp_s))
        if not finite(place):
            self._gnss.refused()
            return
        sigma_m = max(config.gnss_sigma_floor_m, fix.horizontal_accuracy_m)
        self._late += self._fuse_gnss(GnssObservation(stamp_s, place, sigma_m))
        bias = self._kalman.bias_ne_m
        if bias is not None:
            self._news.extend(self._apartness.step(stamp_s, bias, sigma_m))

    def _fuse_gnss(self, observation: GnssObservation) -> bool:
        """Insert it, or learn the bias anew from it; whether it came behind newer readings."""
        late = observation.stamp_s < (self._timeline.head_s or 0.0)
        tests = self._timeline.insert(observation)
        if tests is None:
            self._gnss.refused()
            return False
        self._gnss.note(tests[0], observation.stamp_s)
        if self._gnss.rejected_in_a_row >= self._config.reset_after_rejections:
            rejected, self._gnss.rejected_in_a_row = self._gnss.rejected_in_a_row, 0
            before = self._kalman.bias_ne_m or (0.0, 0.0)
            self._timeline.insert(
                GnssObservation(
                    observation.stamp_s, observation.position_ne_m, observation.sigma_m, anew=True
                )
            )
            after = self._kalman.bias_ne_m or before
            gap_m = math.hypot(after[0] - before[0], after[1] - before[1])
            why = f"{rejected} fixes in a row were rejected: GNSS jumped by {gap_m:.1f} m"
            self._news.append(("gnss_jump", f"{why} against the autopilot; its bias begins anew"))
        return late

    # ------------------------------------------------------------ floor and ceiling

    def _take_levels(self, ranges: tuple[RangeReading, ...], attitude: Attitude) -> None:
        """Fuse new readings of the vertical beams into floor and ceiling, at their own time."""
        for index, name in enumerate(("floor", "ceiling")):
            reading = self._beams[index].newest(ranges)
            if reading is None or reading.stamp_s <= self._level_s[index]:
                continue
            self._level_s[index] = reading.stamp_s
            below_m = self._beams[index].end_below_m(reading, attitude)
            if below_m is None:
                continue
            # A driver's variance is repeatability; the surface itself is rougher than that.
            sigma_m = max(self._config.height_sigma_m, math.sqrt(reading.variance_m2))
            position_sigma_m = self._kalman.position_sigma_m()
            down_m = self._timeline.position_at(reading.stamp_s)[2] + below_m
            tested, step = self._surfaces[index].update(
                reading.stamp_s, down_m, sigma_m**2 + position_sigma_m**2
            )
            self._level_counts[index].note(tested, reading.stamp_s)
            self._levels.stepped(name, step)

    def _free_m(self, surface: Surface, now_s: float, down_m: float) -> float | None:
        """How far the surface is below `down_m`; None when no beam supports it."""
        if surface.down_m is None or now_s - surface.supported_s > self._beam_stale_s:
            return None
        return surface.down_m - down_m

    # ------------------------------------------------------------ result

    def _state(self, now_s: float, attitude: Attitude | None, shift: Vector3) -> FusedState:
        """The state moved to now, as far as that can be answered for (`stale_after_s`)."""
        head_s = self._timeline.head_s
        if head_s is None:
            why = "no local position yet"
            return FusedState(
                now_s, ZERO3, ZERO3, 0.0, UNKNOWN_SIGMA_M, None, ok=False, why_not_ok=why
            )
        config = self._config
        until_s = max(head_s, min(now_s, self._local_s + config.stale_after_s))
        velocity = self._kalman.velocity_ned_m_s
        position = add(self._kalman.position_ned_m, scale(velocity, until_s - head_s))
        sigma_m = self._kalman.position_sigma_m(until_s - head_s)
        why = self._why_not_ok(now_s, attitude, sigma_m)
        roll = pitch = yaw = rate = 0.0
        if attitude is not None:
            roll, pitch, rate = attitude.roll_rad, attitude.pitch_rad, attitude.yaw_rate_rad_s
            turned_s = min(max(0.0, now_s - attitude.stamp_s), config.stale_after_s)
            yaw = wrap_pi(attitude.yaw_rad + rate * turned_s)
        above_m = self._free_m(self._surfaces[1], now_s, position[2])
        news = tuple([Event(now_s, name, words) for name, words in self._news])
        self._news.clear()
        return FusedState(
            stamp_s=until_s,
            position_ned_m=position,
            velocity_ned_m_s=velocity,
            yaw_rad=yaw,
            position_sigma_m=min(sigma_m, UNKNOWN_SIGMA_M),
            height_agl_m=self._free_m(self._surfaces[0], now_s, position[2]),
            ok=not why,
            why_not_ok=why,
            roll_rad=roll,
            pitch_rad=pitch,
            yaw_rate_rad_s=rate,
            frame_shift_ned_m=shift,
            room_above_m=None if above_m is None else -above_m,
            health=self._health(now_s, sigma_m),
            news=news,
        )

    def _health(self, now_s: float, sigma_m: float) -> FilterHealth:
        bias, apart_m = self._kalman.bias_ne_m, self._apartness.apart_m
        flown_s = 0.0 if self._began_s is None else max(0.0, now_s - self._began_s)
        drift_m2 = self._config.drift_noise_m_per_sqrt_s**2 * flown_s
        floor, ceiling = self._level_counts
        return FilterHealth(
            position=self._position.health(now_s),
            velocity=self._velocity.health(now_s),
            gnss=self._gnss.health(now_s),
            floor=floor.health(now_s),
            ceiling=ceiling.health(now_s),
            gnss_bias_ne_m=None if bias is None else (round(bias[0], 3), round(bias[1], 3)),
            gnss_apart_m=None if apart_m is None else round(apart_m, 3),
            room_sigma_m=round(math.sqrt(sigma_m * sigma_m + drift_m2), 4),
            floor_steps=self._surfaces[0].steps,
            ceiling_steps=self._surfaces[1].steps,
            frame_jumps=self._frame_jumps,
            late=self._late,
            restarts=self._restarts,
        )

    def _why_not_ok(self, now_s: float, attitude: Attitude | None, sigma_m: float) -> str:
        """The first reason not to fly by this state; empty when there is none."""
        limit_s = self._config.stale_after_s
        if now_s - self._local_s > limit_s:
            return f"local position is {now_s - self._local_s:.2f} s old"
        if self._local_s - now_s > limit_s:
            return f"local position is {self._local_s - now_s:.2f} s in the future"
        if now_s - self._position.fused_s > limit_s:
            rejected = self._position.rejected_in_a_row
            return f"local position was rejected {rejected} times in a row"
        if attitude is None:
            return "no attitude yet"
        if abs(now_s - attitude.stamp_s) > limit_s:
            return f"attitude is {abs(now_s - attitude.stamp_s):.2f} s old"
        if sigma_m > self._config.sigma_max_m:
            return f"position is uncertain to {sigma_m:.2f} m"
        return ""
