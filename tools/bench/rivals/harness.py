"""The common harness: everything of a flight but the planning, as `autonomy.mission.Pilot` does it.

The same parts where they can be had alone: sensing and map, the sequence of arming and take-off,
the hold, the turning, Table 2's speed rule, the push away from what is too near, the ladder before
"unreachable". What is not here: faults, returns, other heights, making way for what moves.
"""

import math
from dataclasses import dataclass

import msgspec
import numpy as np

from autonomy.config import Config
from autonomy.geometry import Point, distance
from autonomy.guidance.follower import arrival_speed, push_away
from autonomy.guidance.pid import Pid
from autonomy.mission.heights import Heights
from autonomy.mission.ladder import Ladder, Rung
from autonomy.mission.machine import NAVIGATING_STATES
from autonomy.mission.sensing import UNDER_VEHICLE_M, Sensing
from autonomy.mission.sequence import Move, Sequence
from autonomy.mission.steering import CLEARANCE_LIMIT_M, Steering
from autonomy.mission.tick import Tick
from autonomy.model import (
    Command,
    Decision,
    Ending,
    GuardReport,
    Inputs,
    MissionState,
    Outcome,
)
from autonomy.perception.obstacle_map import ObstacleMap
from autonomy.t3drm.planner import Planner
from autonomy.t3drm.speed import speed_limit_m_s
from hal.frames import Vector3, add
from hal.setpoints import Setpoint
from tools.bench.rivals import kernels
from tools.bench.rivals.interface import NEAR_M, Craft, Floats, GivesUp, Rival, View

FENCE_STEP_M = 0.05
_AT_REST_M_S, _ON_ITS_WAY_M_S = 0.03, 0.1


class RivalPilot:
    """Flies one mission to one goal with a rival in place of T3DRM; a `mission.guarded.Decider`."""

    def __init__(self, config: Config, route: tuple[Vector3, ...], rival: Rival) -> None:
        """Raises ValueError for a route of several goals: rivals fly to one."""
        if len(route) != 1:
            raise ValueError(f"a rival flies to one goal, not {len(route)}: give it the last alone")
        self._config, self._rival = config, rival
        self.goal: Vector3 = route[0]
        self.sensing = Sensing(config)
        planner = Planner(config.planner, config.body.radius_m, config.guard.fence)
        self._heights = Heights(config, self.sensing, planner)
        self._steering = Steering(config, self.sensing, self._heights)
        self._sequence = Sequence(config)
        self._ladder = Ladder(config.mission.replan.attempts)
        self._climb = Pid(config.guidance.altitude, config.guard.climb_max_m_s)
        self._fence = fence_hits(config, Craft.of(config).keep_out_m)
        self._state = MissionState.PREFLIGHT
        self._entered_s: float | None = None
        self._armed_s = math.inf
        self._last_s: float | None = None
        self._look_for_s = 0.0
        self._outcome: Outcome | None = None
        self._pace = _Pace()

    @property
    def space(self) -> ObstacleMap:
        """What was seen to be free, for the guard."""
        return self.sensing.map

    def sent(self, setpoint: Setpoint | None) -> None:
        """Nothing here looks at what the guard let pass."""

    def step(self, inputs: Inputs) -> Decision:
        """Sense; let the present state decide; hold where nothing was decided."""
        fused = self.sensing.step(inputs)
        last_s = inputs.now_s if self._last_s is None else self._last_s
        entered_s = inputs.now_s if self._entered_s is None else self._entered_s
        tick = Tick(inputs, fused, inputs.now_s - last_s, self._state, entered_s)
        self._last_s = inputs.now_s
        move = self._decide(tick) if fused.ok or self._on_the_ground(tick) else None
        if self._spent(tick):
            why = f"{self._config.mission.time_limit_s:g} s are used up"
            move = Move(MissionState.LAND, why, Outcome(Ending.BUDGET, why))
        if move is not None:
            self._go(tick, move)
        self._steering.stream_something(tick)
        self._state, self._entered_s = tick.state, tick.entered_s
        return self._decision(tick)

    # ------------------------------------------------------------ the states

    def _decide(self, tick: Tick) -> Move | None:
        match tick.state:
            case MissionState.PREFLIGHT:
                silent = tuple(self.sensing.silent_beams(tick.now_s))
                above_m, covered = self.sensing.room_above_m(), self.sensing.covered_beams()
                return self._sequence.preflight(tick, tick.elapsed_s, silent, above_m, covered)
            case MissionState.ARM:
                return self._sequence.arm(tick, tick.elapsed_s)
            case MissionState.TAKEOFF:
                return self._sequence.takeoff(tick, tick.elapsed_s)
            case MissionState.OFFBOARD:
                return self._sequence.offboard(tick, tick.elapsed_s)
            case MissionState.DETECT:
                return self._look_round(tick)
            case MissionState.CRUISE:
                return self._cruise(tick)
            case MissionState.LAND:
                return self._sequence.land(tick, tick.elapsed_s)
            case _:
                return None

    def _look_round(self, tick: Tick) -> Move | None:
        """Come to the goal's height; turn until every bearing was seen once more."""
        if self._heights.changing:
            if self._heights.change(tick):
                tick.entered_s = tick.now_s
                self._steering.scan.restart()
            return None
        swept = abs(self._steering.scan.turned_rad) >= self.sensing.lookout.now.sweep_rad
        if not swept or tick.elapsed_s < self._look_for_s:
            return None
        return Move(MissionState.CRUISE, "every direction was seen")

    def _cruise(self, tick: Tick) -> Move | None:
        """Ask the rival, unless the goal is reached."""
        gap_m = distance(tick.fused.point, self.goal[:2])
        tolerance_m = self._config.mission.goal_tolerance_m
        level = abs(tick.fused.position_ned_m[2] - self.goal[2]) <= 2.0 * tolerance_m
        if gap_m <= tolerance_m and level:
            why = f"{gap_m:.2f} m from the goal"
            return Move(MissionState.LAND, why, Outcome(Ending.GOAL_REACHED, why))
        answer = self._rival.decide(self._view(tick))
        if isinstance(answer, GivesUp):
            return self._no_way(tick, answer)
        self._fly(tick, answer, gap_m)
        return None

    def _view(self, tick: Tick) -> View:
        space, fused = self.sensing.map, tick.fused
        hits = np.concatenate((space.hits(), self._fence))
        north, east = fused.point
        return View(
            now_s=tick.now_s,
            dt_s=tick.dt_s,
            point=fused.point,
            velocity=fused.velocity_ned_m_s[:2],
            goal=self.goal[:2],
            hits=hits,
            near=kernels.within(hits, north, east, NEAR_M),
            version=space.version,
            space=space,
        )

    def _no_way(self, tick: Tick, answer: GivesUp) -> Move:
        """T3DRM's ladder: look again, forget what is near, forget all, verdict."""
        rung = Rung.VERDICT if answer.certain else self._ladder.climb()
        self.sensing.maps.trust_newest()
        if rung is Rung.VERDICT:
            why = f"{rung}: {answer.why}"
            return Move(MissionState.LAND, why, Outcome(Ending.UNREACHABLE, why))
        replan = self._config.mission.replan
        if rung is Rung.FORGET_NEARBY:
            self.sensing.map.forget_within(
                tick.fused.point, replan.forget_radius_m, UNDER_VEHICLE_M
            )
        elif rung is Rung.FORGET_ALL:
            self.sensing.map.forget_all(tick.fused.point, UNDER_VEHICLE_M)
        self._look_for_s = replan.hover_s
        return Move(MissionState.DETECT, f"no way ({self._ladder.failures}): {answer.why}; {rung}")

    def _fly(self, tick: Tick, wanted: Point, gap_m: float) -> None:
        """The rival's velocity within Table 2's speed, slower towards the goal, pushed away."""
        fused, guidance = tick.fused, self._config.guidance
        velocity = fused.velocity_ned_m_s[:2]
        speed_m_s = math.hypot(*wanted)
        nearest = self.sensing.map.nearest_hit(fused.position_ned_m, CLEARANCE_LIMIT_M)
        self._steering.turn_beside(nearest)
        clearance_m, rate_m_s = math.inf, 0.0
        if nearest is not None and speed_m_s > 0.0:
            clearance_m = nearest[0]
            closing = wanted[0] * math.cos(nearest[1]) + wanted[1] * math.sin(nearest[1])
            rate_m_s = -closing / speed_m_s * guidance.speed_max_m_s
        limit_m_s = speed_limit_m_s(clearance_m, rate_m_s, guidance, self._config.beams.max_m)
        limit_m_s = min(limit_m_s, self.sensing.lookout.speed_max_m_s)
        tick.speed_limit_m_s = arrival_speed(gap_m, limit_m_s)
        if speed_m_s > tick.speed_limit_m_s:
            share = tick.speed_limit_m_s / speed_m_s
            wanted = (wanted[0] * share, wanted[1] * share)
        north, east = push_away(wanted, nearest, guidance, velocity)
        climb_m_s = self._climb.step(-self._heights.commanded_m, fused.position_ned_m[2], tick.dt_s)
        self._steering.let_go()
        tick.setpoint = Setpoint(
            tick.now_s,
            fused.position_ned_m,
            (north, east, climb_m_s),
            self._steering.scan.step(fused.yaw_rad, tick.dt_s),
        )

    # ------------------------------------------------------------ bookkeeping

    def _on_the_ground(self, tick: Tick) -> bool:
        return tick.state in (MissionState.PREFLIGHT, MissionState.ARM, MissionState.LAND)

    def _spent(self, tick: Tick) -> bool:
        spent = tick.now_s - self._armed_s > self._config.mission.time_limit_s
        return spent and tick.state in NAVIGATING_STATES

    def _go(self, tick: Tick, move: Move) -> None:
        tick.state, tick.entered_s = move.state, tick.now_s
        if move.outcome is not None:
            self._outcome = move.outcome
        tick.say(move.state.value, move.why)
        match move.state:
            case MissionState.ARM:
                self.sensing.fix_home()
                self._armed_s = tick.now_s
            case MissionState.OFFBOARD:
                self._steering.let_go()
                height_m = -tick.fused.position_ned_m[2]
                self._heights.begin(tick.now_s, height_m, -self.goal[2])
                self.sensing.map.mark_seen_disc(tick.fused.point, self._config.map.start_disc_m)
            case MissionState.DETECT:
                self._steering.scan.restart()
            case _:
                pass

    def _decision(self, tick: Tick) -> Decision:
        fused = tick.fused
        if tick.state is MissionState.CRUISE:
            self._pace.note(math.hypot(*fused.velocity_ned_m_s[:2]))
        return Decision(
            now_s=tick.now_s,
            state=tick.state,
            fused=fused,
            setpoint=tick.setpoint,
            requests=tuple(tick.requests),
            events=tuple(tick.events),
            distance_to_go_m=distance(fused.point, self.goal[:2]),
            clearance_m=self.sensing.map.clearance_m(fused.position_ned_m, CLEARANCE_LIMIT_M),
            speed_limit_m_s=tick.speed_limit_m_s,
            stops=self._pace.stops,
            outcome=self._outcome if tick.state is MissionState.DONE else None,
            height_m=self._heights.flown_at_m if tick.state in NAVIGATING_STATES else None,
            walls=self.sensing.walls,
            doubts=self.sensing.lookout.doubts,
        )


class Unguarded:
    """A decider whose setpoints go to the wire as they are; a `simulation.Flyer`."""

    def __init__(self, decider: RivalPilot) -> None:
        self.decider = decider

    @property
    def goal(self) -> Vector3:
        """The goal being flown to."""
        return self.decider.goal

    def step(self, inputs: Inputs) -> Command:
        """One tick: decide."""
        return unguarded(self.decider.step(inputs), self.decider.sensing.home_ned_m)


def unguarded(decision: Decision, home_ned_m: Vector3) -> Command:
    """The decision with its setpoint untouched; `home_ned_m` is the mission frame's origin."""
    setpoint = decision.setpoint
    if setpoint is None:
        return Command(decision, None, None, GuardReport())
    place = add(setpoint.position_ned_m, home_ned_m)
    wire = msgspec.structs.replace(setpoint, position_ned_m=place)
    return Command(decision, setpoint, wire, GuardReport())


@dataclass(slots=True)
class _Pace:
    """Counts how often the vehicle came to rest on its way."""

    stops: int = 0
    moving: bool = False

    def note(self, speed_m_s: float) -> None:
        if self.moving and speed_m_s < _AT_REST_M_S:
            self.stops += 1
            self.moving = False
        elif speed_m_s > _ON_ITS_WAY_M_S:
            self.moving = True


def fence_hits(config: Config, keep_out_m: float) -> Floats:
    """(n, 2) points `keep_out_m` outside each side of the fence, FENCE_STEP_M apart.

    Rivals know obstacles alone: who keeps out of these keeps the vehicle's centre inside the fence.
    A fence that is not convex is drawn as its bounding box; the guard knows the true one.
    """
    low_n, high_n, low_e, high_e = config.guard.fence.bounds()
    low_n, low_e = low_n - keep_out_m, low_e - keep_out_m
    high_n, high_e = high_n + keep_out_m, high_e + keep_out_m
    norths = np.arange(low_n, high_n + FENCE_STEP_M, FENCE_STEP_M)
    easts = np.arange(low_e, high_e + FENCE_STEP_M, FENCE_STEP_M)
    sides = [np.column_stack((norths, np.full(len(norths), e))) for e in (low_e, high_e)]
    sides += [np.column_stack((np.full(len(easts), n), easts)) for n in (low_n, high_n)]
    return np.concatenate(sides)
