"""One siege: a guard, a world, the worst vehicle, and the oracle that judges them.

The same moves are made by Hypothesis (tests/unit/tools/test_guard_siege.py), which shrinks what it
finds, and by a seeded random driver (`python -m tools.guard_siege`), which makes a million.
"""

import math
from collections import deque
from dataclasses import dataclass
from typing import NamedTuple

from hal.config import Fence, GuardConfig, six_beams
from hal.frames import Vector3, add, wrap_pi
from hal.readings import RangeReading, RangeStatus
from hal.setpoints import Setpoint
from hal.vehicle.guard import (
    BEAM,
    POSITION_STALE,
    SETPOINT_REPEATED,
    SETPOINT_STALE,
    WORDS,
    BeamSight,
    Guard,
    GuardVerdict,
    Sight,
)
from tools.guard_siege.vehicle import STEP_S, TYPICAL, Make, WorstVehicle
from tools.guard_siege.world import CORRIDOR_M, Border, Post, SiegeWorld

BODY_M = 0.15
"""The body's radius; the corridor keeps 3.5 cm more."""
HALF_HEIGHT_M = 0.08
ALOFT_M = 1.0
FENCES = (
    Fence.rectangle((-2.0, 2.0), (-2.0, 2.0)),
    Fence(radius_m=1.5),
    Fence(polygon_ne_m=((-2, -2), (2, -2), (2, 2), (0.7, 2), (0.7, 0.5), (-2, 0.5))),
)
BEAMS = six_beams()
BEAM_MIN_M, BEAM_MAX_M = 0.02, 1.0
START_FREE_M = 0.25
"""Nothing stands nearer to the place where a siege begins."""
SLACK_M = 1e-3
OLDEST_S = 0.3
"""The guard's `position_max_age_s`."""
LATE_S = 0.5
"""The guard's `reaction_s` less two ticks: link, vehicle and the age of what is seen, together."""
HOLDS = frozenset((SETPOINT_STALE, SETPOINT_REPEATED, POSITION_STALE))


class Violation(AssertionError):
    """The guard let something happen that it must not."""


@dataclass(frozen=True)
class Ask:
    """One tick's setpoint: how it differs from the vehicle's place, and how old it says to be."""

    velocity: Vector3 = (0.0, 0.0, 0.0)
    offset: Vector3 = (0.0, 0.0, 0.0)
    turn_rad: float = 0.0
    age_s: float = 0.0
    again: bool = False
    """The setpoint before, with a new stamp."""


class Moment(NamedTuple):
    """Where the vehicle was, believed to be, and how it moved."""

    position: Vector3
    estimate: Vector3
    velocity: Vector3


@dataclass(frozen=True)
class Stage:
    """What a siege begins with."""

    fence: int = 0
    posts: tuple[Post, ...] = ()
    borders: tuple[Border, ...] = ()
    ceiling_m: float = math.inf
    sigma_m: float = 0.0
    make: Make = TYPICAL
    yaw_rad: float = 0.0
    position_age_s: float = 0.0
    beams_age_s: float = 0.0
    """How old what the guard sees is at most, bounded by `oldest_s`; each tick says which part."""


def oldest_s(make: Make) -> float:
    """How old what the guard sees may be: what its `reaction_s` leaves beside vehicle and tick."""
    return min(OLDEST_S, max(0.0, LATE_S - make.link_s - make.dead_s))


class Siege:
    """A flight under adversarial setpoints. `tick` and `kill` raise Violation."""

    def __init__(self, stage: Stage) -> None:
        posts = tuple(
            post for post in stage.posts if math.hypot(*post[:2]) - post[2] > START_FREE_M
        )
        self.config = GuardConfig(
            fence=FENCES[stage.fence % len(FENCES)],
            position_gain_per_s=stage.make.gain_per_s,
        )
        self.world = SiegeWorld(posts, list(stage.borders))
        self.vehicle = WorstVehicle(stage.make, (0.0, 0.0, -ALOFT_M))
        self.guard = Guard(self.config)
        self._ceiling_m = max(stage.ceiling_m, ALOFT_M + 0.25)
        self._sigma_m = stage.sigma_m
        oldest = oldest_s(stage.make)
        self._ages_s = (min(stage.position_age_s, oldest), min(stage.beams_age_s, oldest))
        self._past = deque([self._moment()], maxlen=round(OLDEST_S / STEP_S) + 1)
        self._now_s = 100.0
        self._yaw_rad = stage.yaw_rad
        self._yaw_sent_rad: float | None = None
        self._asked = Setpoint(self._now_s, self.vehicle.position)
        self._sent = (0.0, 0.0)
        self._sent_s = -math.inf
        self._fence_known = ((0.0, 0.0), self.config.fence.inside_distance_m(0.0, 0.0))
        self.ticks = 0

    # ------------------------------------------------------------ moves

    def reveal(self, which: int, further_m: float) -> None:
        """More is seen: a border moves outwards."""
        if self.world.borders:
            index = which % len(self.world.borders)
            n, e, distance = self.world.borders[index]
            self.world.borders[index] = (n, e, distance + further_m)

    def mislead(self, north: float, east: float) -> None:
        """The estimate's error moves to this part of its sigma, slowly: 2 mm a tick at most."""
        length = max(1.0, math.hypot(north, east))
        n, e = self.vehicle.error
        gap_n = self._sigma_m * north / length - n
        gap_e = self._sigma_m * east / length - e
        gap = max(0.002, math.hypot(gap_n, gap_e))
        self.vehicle.error = (n + gap_n * 0.002 / gap, e + gap_e * 0.002 / gap)

    def tick(
        self,
        ask: Ask,
        *,
        tick_s: float = 0.05,
        beams: bool = True,
        ok: bool = True,
        age: float = 1.0,
    ) -> GuardVerdict:
        """Ask for a setpoint, fly what the guard lets pass for a tick, and judge.

        `age`: which part of the stage's ages position and beams have. Without beams nobody knows
        of the ceiling: where there is one they are never missing.
        """
        beams = beams or self._ceiling_m < math.inf
        sight = self._sight(age, beams=beams, ok=ok)
        asked = self._setpoint(ask, sight)
        verdict = self.guard.check(asked, sight)
        self._asked = asked
        self._judge_setpoint(asked, verdict, sight)
        self.vehicle.send(verdict.setpoint)
        self._turn(verdict.setpoint.yaw_rad, tick_s)
        for _ in range(round(tick_s / STEP_S)):
            self.vehicle.step()
            self._past.append(self._moment())
            self._judge_vehicle(self.vehicle)
        self._now_s += tick_s
        self.ticks += 1
        return verdict

    def kill(self) -> None:
        """The program dies: nobody sends any more. What comes of it is judged; the siege goes on as
        if it had not.
        """
        twin = self.vehicle.twin()
        for _ in twin.fly_blind():
            self._judge_vehicle(twin)

    # ------------------------------------------------------------ what the guard is told

    def _moment(self) -> Moment:
        return Moment(self.vehicle.position, self.vehicle.estimate, self.vehicle.velocity)

    def _ago(self, age_s: float) -> tuple[float, Moment]:
        """How things were, in whole steps, and how long ago that is."""
        steps = min(round(age_s / STEP_S), len(self._past) - 1)
        return steps * STEP_S, self._past[-1 - steps]

    def _setpoint(self, ask: Ask, sight: Sight) -> Setpoint:
        if ask.again:
            return replace_stamp(self._asked, self._now_s)
        return Setpoint(
            self._now_s - ask.age_s,
            add(sight.position_ned_m, ask.offset),
            ask.velocity,
            wrap_pi(self._yaw_rad + ask.turn_rad),
        )

    def _sight(self, age: float, *, beams: bool, ok: bool) -> Sight:
        position_age_s, then = self._ago(age * self._ages_s[0])
        return Sight(
            now_s=self._now_s,
            fused_stamp_s=self._now_s - position_age_s,
            position_ned_m=then.estimate,
            velocity_ned_m_s=then.velocity,
            yaw_rad=self._yaw_rad,
            space=self.world,
            beams=self._beams(*self._ago(age * self._ages_s[1])) if beams else (),
            position_sigma_m=self._sigma_m,
            position_ok=ok,
        )

    def _beams(self, age_s: float, then: Moment) -> tuple[BeamSight, ...]:
        """True ranges of that moment."""
        seen = []
        north, east, down = then.position
        for mount in BEAMS:
            if mount.horizontal:
                bearing = self._yaw_rad + math.radians(mount.yaw_deg)
                distance = self.world.range_m(north, east, bearing)
            else:
                distance = self._ceiling_m + down if mount.pitch_deg > 0.0 else -down
            status = RangeStatus.VALID
            if distance > BEAM_MAX_M:
                status, distance = RangeStatus.OUT_OF_RANGE, BEAM_MAX_M
            elif distance < BEAM_MIN_M:
                status, distance = RangeStatus.TOO_NEAR, BEAM_MIN_M
            reading = RangeReading(
                self._now_s - age_s, mount.name, status, distance, 1e-4, BEAM_MIN_M, BEAM_MAX_M
            )
            seen.append(BeamSight(mount, reading))
        return tuple(seen)

    def _turn(self, yaw_rad: float, tick_s: float) -> None:
        """The heading follows, by its shorter way and at most at 3 rad/s."""
        gap = wrap_pi(yaw_rad - self._yaw_rad)
        self._yaw_rad = wrap_pi(self._yaw_rad + max(-3.0 * tick_s, min(3.0 * tick_s, gap)))

    # ------------------------------------------------------------ the oracle

    def _judge_setpoint(self, asked: Setpoint, verdict: GuardVerdict, sight: Sight) -> None:
        sent, config = verdict.setpoint, self.config
        numbers = (*sent.position_ned_m, *sent.velocity_ned_m_s, sent.yaw_rad, sent.stamp_s)
        _must(all(map(math.isfinite, numbers)), "a number is none", verdict)
        _must(all(name in WORDS for name in verdict.limits), "a limit has no words", verdict)
        _must(len(set(verdict.limits)) == len(verdict.limits), "a limit is named twice", verdict)
        _must(bool(verdict.limits) or sent is asked, "changed, and no limit named", verdict)
        gain = config.position_gain_per_s
        pull = [gain * (sent.position_ned_m[k] - sight.position_ned_m[k]) for k in (0, 1)]
        north, east = (sent.velocity_ned_m_s[k] + pull[k] for k in (0, 1))
        speed = math.hypot(north, east)
        _must(speed <= config.speed_max_m_s + 1e-6, "faster than the top speed", verdict)
        climb = sent.velocity_ned_m_s[2] + sent.position_ned_m[2] - sight.position_ned_m[2]
        _must(abs(climb) <= config.climb_max_m_s + 1e-6, "climbs too fast", verdict)
        self._judge_pace(north, east, verdict)
        self._judge_turn(sent.yaw_rad, verdict)
        self._sent, self._sent_s, self._yaw_sent_rad = (north, east), self._now_s, sent.yaw_rad

    def _judge_pace(self, north: float, east: float, verdict: GuardVerdict) -> None:
        """Not quicker than the acceleration, except by braking; a hold may pull back."""
        held = HOLDS & set(verdict.limits) or verdict.setpoint.velocity_ned_m_s[:2] == (0.0, 0.0)
        if held:
            return
        passed_s = min(self._now_s - self._sent_s, self.config.setpoint_max_age_s)
        step = self.config.acceleration_max_m_s2 * passed_s
        before = self._sent
        gained = math.hypot(north, east) - math.hypot(*before)
        _must(gained <= step + 1e-6, "speeds up too quickly", verdict)
        if BEAM in verdict.limits:
            return
        # The nearest point of the way from rest to what was sent before.
        square = before[0] ** 2 + before[1] ** 2
        part = (north * before[0] + east * before[1]) / square if square else 0.0
        part = min(1.0, max(0.0, part))
        gap = math.dist((north, east), (part * before[0], part * before[1]))
        _must(gap <= step + 1e-6, "changes too quickly", verdict)

    def _judge_turn(self, yaw_rad: float, verdict: GuardVerdict) -> None:
        passed_s = min(self._now_s - self._sent_s, self.config.setpoint_max_age_s)
        step = math.radians(self.config.yaw_rate_max_deg_s) * passed_s
        ahead = wrap_pi(yaw_rad - self._yaw_rad)
        before = self._yaw_sent_rad
        lead = wrap_pi(before - self._yaw_rad) if before is not None else 0.0
        low, high = min(0.0, lead) - step - 1e-6, max(0.0, lead) + step + 1e-6
        _must(low <= ahead <= high, "turns too quickly", verdict)

    def _judge_vehicle(self, vehicle: WorstVehicle) -> None:
        """Where the vehicle really is."""
        north, east, down = vehicle.position
        clearance = self.world.to_posts_m(north, east)
        _must(clearance > BODY_M - SLACK_M, "the body touches a post", clearance)
        unseen = self.world.into_unseen_m(north, east)
        margin = CORRIDOR_M - BODY_M
        _must(unseen < margin + SLACK_M, "the body is in space that was not seen", unseen)
        inside = self._inside_m(north, east)
        _must(inside > -self._sigma_m - SLACK_M, "the fence was left", inside)
        low, high = self.config.altitude_min_m, self.config.altitude_max_m
        _must(low - 0.01 <= -down <= high + 0.01, "the altitude band was left", down)
        _must(HALF_HEIGHT_M - down <= self._ceiling_m, "the ceiling was touched", down)

    def _inside_m(self, north: float, east: float) -> float:
        """Distance to the fence, or less: computed anew only where that could matter."""
        place, inside = self._fence_known
        inside -= math.dist(place, (north, east))
        if inside < 0.0:
            inside = self.config.fence.inside_distance_m(north, east)
            self._fence_known = ((north, east), inside)
        return inside


def replace_stamp(setpoint: Setpoint, stamp_s: float) -> Setpoint:
    """The same setpoint, made now."""
    return Setpoint(stamp_s, setpoint.position_ned_m, setpoint.velocity_ned_m_s, setpoint.yaw_rad)


def _must(holds: bool, sentence: str, what: object) -> None:  # noqa: FBT001  # like assert
    if not holds:
        raise Violation(f"{sentence}: {what}")
