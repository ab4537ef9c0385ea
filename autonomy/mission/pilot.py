"""The pilot: `Pilot.step(inputs) -> decision`, pure and deterministic; Algorithm 2 of the paper.

Sense, respond to faults, then let the present state decide:

    CRUISE   fly straight at the goal (Eq. 10: distance and bearing)
    STOP     something is in the way: come to rest
    DETECT   complete the picture: turn until every bearing was seen
    REPLAN   classify; sphere or hyperbola; choose the cheapest
    FOLLOW   fly the chosen path; anything new in the way: STOP again

Algorithm 2's steps, and where they are:

    1        start                           `Sequence`: preflight, arm, take off, Offboard
    2        Ricci flow with metric g0       `Planner.keep_outs_m`: the radii that are tried
    3        any obstacle?                   `_follow`: none, `_fly_path`; else `_on_blocked`,
                                             `_stop`, `_detect`; discrete or continuous: `_replan`
    4-7      sphere, tangents T, T_min       `_replan`: `Commitment`, `Planner`, `t3drm.spherical`
    8, 9     follow T_min; back to 3         `_follow`
    10, 11   hyperbola, its speed; to 3      `_replan`: `t3drm.hyperbolic`; `_fly_path`: Table 2
    12, 13   goal reached; stop              `_arrived`, `_next_goal`, `_land`

There is no clock, no randomness, no input or output here: everything comes in `Inputs`.
"""

import math
from collections.abc import Callable

import msgspec
import numpy as np

from autonomy.config import Config
from autonomy.geometry import Point, distance
from autonomy.guidance.follower import arrival_speed, carrot_direction, push_away
from autonomy.guidance.outer_loops import OuterLoops
from autonomy.guidance.path import FlownPath
from autonomy.guidance.pid import Pid
from autonomy.guidance.yaw_scan import YawScan
from autonomy.mission import failsafe
from autonomy.mission.commitment import Commitment
from autonomy.mission.heights import Heights
from autonomy.mission.ladder import Ladder, Rung
from autonomy.mission.machine import NAVIGATING_STATES, OFFBOARD_STATES, TRANSITIONS
from autonomy.mission.sensing import Sensing
from autonomy.mission.sequence import Move, Sequence
from autonomy.mission.tick import Tick
from autonomy.model import (
    Decision,
    Ending,
    Environment,
    FusedState,
    Inputs,
    LegKind,
    MissionState,
    NoPlan,
    OperatorCommand,
    Outcome,
    Plan,
)
from autonomy.t3drm.over_under import Way
from autonomy.t3drm.planner import Planner, violated
from autonomy.t3drm.speed import speed_limit_m_s
from hal.frames import Vector3, horizontal_norm
from hal.interfaces import SeenSpace
from hal.readings import FlightMode, LandedState, VehicleStatus
from hal.setpoints import Setpoint

_AT_REST_M_S = 0.05
_SWEEP_RAD = math.radians(100.0)
"""A quarter turn of four beams, and a little more so that the ends overlap."""
_STOP_LEAD_S = 0.1
"""Where to hold: the vehicle cannot stop at once, and is not asked to come back."""
_PATH_SLACK_M = 0.015
"""A hit this much inside the keep-out radius is noise, not an obstacle in the way."""
_STUCK_AFTER_S = 6.0
_STUCK_WITHIN_M = 0.05
_DISC_UNDER_VEHICLE_M = 0.14
_BACK_WITHIN_M = 0.1
_CLEARANCE_LIMIT_M = 1.0
_GOAL_MAY_MOVE = 0.6
"""By this much of the tolerance the planner may move a goal that a noisy hit has come too near."""
_HOLD_BEFORE_LANDING_S = 3.0
_HANDOVER_TIMEOUT_S = 5.0
_BRIEF_HOLD_S = 1.0
"""After a fault this short the flight goes on without a new look round: within one turn of the
scan nothing that was seen has become old."""


_STALL_S = 0.5
"""A loop that comes later than this did not listen meanwhile: silence then says nothing."""


class Pilot:
    """Flies one mission over a route of goals (NED about the take-off point)."""

    def __init__(self, config: Config, route: tuple[Vector3, ...]) -> None:
        """Take a route that `preflight.check_route` accepts."""
        self._config = config
        self._route = route
        self._goal_index = 0
        self._sensing = Sensing(config)
        self._sequence = Sequence(config)
        planner = Planner(config.planner, config.body.radius_m, config.guard.fence)
        self._commitment = Commitment(planner, config.mission.replan.side_hysteresis_m)
        self._heights = Heights(config, self._sensing, planner)
        self._scan = YawScan(math.radians(config.guidance.yaw_rate_deg_s))
        self._loops = OuterLoops(config.guidance)
        self._climb = Pid(config.guidance.altitude, config.guard.climb_max_m_s)
        self._state = MissionState.PREFLIGHT
        self._entered_s: float | None = None
        self._armed_s: float | None = None
        self._last_s: float | None = None
        self._listening_since_s = -math.inf
        self._outcome: Outcome | None = None
        self._path = FlownPath(((0.0, 0.0),))
        self._path_keep_out_m = 0.0
        self._path_free_at: int | None = None
        self._planned_s = -math.inf
        self._hold_at: Point | None = None
        self._landing_ordered = False
        self._held = False
        self._must_land = False
        self._held_from = MissionState.PREFLIGHT
        self._ladder = Ladder(config.mission.replan.attempts)
        self._look_for_s = 0.0
        self._retreat_to: Point | None = None
        self._moved_from: tuple[float, Point] | None = None
        self.stops = 0
        self.replans = 0

        elapsed, sequence = self._elapsed_s, self._sequence
        self._states: dict[MissionState, Callable[[Tick], Move | None]] = {
            MissionState.PREFLIGHT: self._preflight,
            MissionState.ARM: lambda tick: sequence.arm(tick, elapsed(tick)),
            MissionState.TAKEOFF: lambda tick: sequence.takeoff(tick, elapsed(tick)),
            MissionState.OFFBOARD: lambda tick: sequence.offboard(tick, elapsed(tick)),
            MissionState.CRUISE: self._follow,
            MissionState.FOLLOW: self._follow,
            MissionState.STOP: self._stop,
            MissionState.DETECT: self._detect,
            MissionState.REPLAN: self._replan,
            MissionState.HOLD: self._hold,
            MissionState.LAND: self._land,
            MissionState.YIELDED: lambda _: Move(MissionState.DONE, "no longer ours to command"),
            MissionState.DONE: lambda _: None,
        }

    @property
    def space(self) -> SeenSpace:
        """What was seen to be free, for the guard."""
        return self._sensing.map

    @property
    def sensing(self) -> Sensing:
        """Newest readings, map and frame, for the guard and for pictures."""
        return self._sensing

    @property
    def goal(self) -> Vector3:
        """The goal being flown to."""
        return self._route[min(self._goal_index, len(self._route) - 1)]

    # ------------------------------------------------------------ one step

    def step(self, inputs: Inputs) -> Decision:
        """Decide everything for this tick. `inputs.now_s` must not run backwards."""
        if self._last_s is not None and inputs.now_s < self._last_s:
            raise ValueError(f"time ran backwards: {inputs.now_s} s after {self._last_s} s")
        fused = self._sensing.step(inputs)
        nominal_s = 1.0 / self._config.control.rate_hz
        dt_s = inputs.now_s - self._last_s if self._last_s is not None else nominal_s
        tick = Tick(inputs, fused, dt_s)
        self._last_s = inputs.now_s
        if dt_s > _STALL_S:
            self._listening_since_s = inputs.now_s
        if self._entered_s is None:
            self._entered_s = inputs.now_s
        self._obey_operator(tick)
        self._respond_to_faults(tick)
        move = self._decide(tick)
        if move is not None:
            self._enter(tick, move)
        self._stream_something(tick)
        return self._decision(tick)

    def _decide(self, tick: Tick) -> Move | None:
        """The present state's word on where to go next."""
        return self._states[self._state](tick)

    def _preflight(self, tick: Tick) -> Move | None:
        """PREFLIGHT: wait until nothing forbids arming."""
        silent = tuple(self._sensing.silent_beams(tick.now_s))
        above_m = self._sensing.room_above_m()
        return self._sequence.preflight(tick, self._elapsed_s(tick), silent, above_m)

    # ------------------------------------------------------------ Algorithm 2

    def _follow(self, tick: Tick) -> Move | None:
        """CRUISE and FOLLOW: fly the path until the goal, or until something is in the way.

        Algorithm 2, steps 3, 8, 9, 11 and 12.
        """
        if self._arrived(tick.fused):
            return self._next_goal(tick)
        self._heights.note_place(tick.fused.point)
        if self._is_back(tick.fused):
            return Move(MissionState.STOP, "room to change height")
        move = self._on_other_heights(tick)
        if move is not None:
            return move
        blocked_m = self._blocked_ahead_m()
        if blocked_m is not None:
            move = self._on_blocked(tick, blocked_m)
            if move is not None:
                return move
        elif self._is_stuck(tick):
            return self._no_way(tick, "no progress on a path that is free", ())
        self._fly_path(tick)
        return None

    def _on_blocked(self, tick: Tick, blocked_m: float) -> Move | None:
        """Something known stands on the path, `blocked_m` ahead."""
        replan = self._config.mission.replan
        if replan.mode == "rolling" or self._heights.proving:
            if tick.now_s - self._planned_s < replan.min_interval_s:
                return None
            return self._replan(tick)
        if blocked_m > self._config.mission.detection_range_m:
            return None
        self.stops += 1
        return Move(MissionState.STOP, f"something is in the way {blocked_m:.2f} m ahead")

    def _stop(self, tick: Tick) -> Move | None:
        """STOP: wait until the vehicle is at rest."""
        if horizontal_norm(tick.fused.velocity_ned_m_s) > _AT_REST_M_S:
            return None
        return Move(MissionState.DETECT, "at rest; looking at what is there")

    def _detect(self, tick: Tick) -> Move | None:
        """DETECT: turn until every bearing was seen once more, at the height of the flight."""
        if self._heights.changing:
            if self._heights.change(tick):
                self._commitment.forget()
                self._entered_s = tick.now_s
                self._scan.restart()
            return None
        if abs(self._scan.turned_rad) < _SWEEP_RAD or self._elapsed_s(tick) < self._look_for_s:
            return None
        self._look_for_s = 0.0
        self._heights.looked_round(tick.fused.point)
        return Move(MissionState.REPLAN, "every direction was seen")

    def _replan(self, tick: Tick) -> Move | None:
        """REPLAN: classify, choose sphere or hyperbola, take the cheapest free path.

        Algorithm 2, steps 4 to 7 and 10; Algorithm 1 times it. Where nothing leads on at this
        height, over and under are looked at, one a tick.
        """
        if self._state is MissionState.REPLAN and self._heights.searching:
            found = self._heights.ask_on()
            if isinstance(found, NoPlan) and self._heights.stop_guessing():
                return None
            return self._decided(tick, found)
        self._planned_s = tick.now_s
        self.replans += 1
        tolerance_m = _GOAL_MAY_MOVE * self._config.mission.goal_tolerance_m
        goal = (self.goal[0], self.goal[1])
        here = self._heights.ask(tick, self._plan_here(tick, goal, tolerance_m), goal, tolerance_m)
        self._retreat_to = None
        if isinstance(here, Plan):
            return self._take(tick, here)
        back = self._heights.retreat(tick, here)
        if back is not None:
            self._retreat_to = back.points[-1]
            tick.say("height", f"{here.reason}; back to where there is room to change height")
            return self._take(tick, back)
        if not self._heights.searching:
            if self._heights.stop_guessing():
                return None
            return self._decided(tick, self._heights.told(here))
        if self._state is MissionState.REPLAN:
            return None
        height = f"{self._heights.present_m:.2f} m"
        return Move(MissionState.STOP, f"{here.reason} at {height}; looking at other heights")

    def _plan_here(self, tick: Tick, goal: Point, tolerance_m: float) -> Plan | NoPlan:
        """What the present height offers."""
        if self._heights.proving:
            return self._heights.prove(tick, goal, tolerance_m)
        hits, course = np.array(self._heights.hits()), self._path.remaining()
        return self._commitment.plan(tick.fused.point, goal, hits, tolerance_m, course)

    def _decided(self, tick: Tick, found: Way | NoPlan | None) -> Move | None:
        """What the search came to; None while it goes on."""
        if found is None:
            return None
        if isinstance(found, Way):
            if found.height_m == self._heights.present_m:
                return self._take(tick, found.plan)
            return Move(MissionState.DETECT, self._go_to_height(tick, found))
        tick.plan = found
        return self._no_way(tick, found.reason, found.evidence)

    def _on_other_heights(self, tick: Tick) -> Move | None:
        """On the way: come to the goal's height above or below it, or to a cheaper height."""
        heights = self._heights
        if not heights.at_goals_height and self._is_over_or_under_goal(tick.fused):
            goal_m = heights.goal_m
            if not heights.may_change(tick, goal_m):
                return self._no_way(tick, f"the way to the goal's height, {goal_m:.2f} m", ())
            heights.change_to(goal_m)
            return Move(MissionState.STOP, f"over or under the goal; on to {goal_m:.2f} m")
        found = heights.ask_on() if heights.searching else None
        if found is None or isinstance(found, NoPlan) or found.height_m == heights.present_m:
            return None
        return Move(MissionState.STOP, self._go_to_height(tick, found))

    def _go_to_height(self, tick: Tick, way: Way) -> str:
        """Order the change of height on a way, and say so."""
        above_m = way.height_m - self._heights.goal_m
        which = "over the obstacle" if above_m > 0.0 else "under the obstacle"
        if above_m == 0.0:
            which = "at the goal's height"
        first_m = self._heights.towards(way, tick.fused.point)
        first = "" if first_m == way.height_m else f"; first to {first_m:.2f} m"
        return (
            f"{which} at {way.height_m:.2f} m: {way.plan.length_m:.2f} m of way, with the climbs "
            f"as dear as {way.cost_m:.2f} m{first}"
        )

    def _take(self, tick: Tick, plan: Plan) -> Move | None:
        """Fly a plan of the present height."""
        tick.plan = plan
        self._path = FlownPath(plan.points)
        self._path_keep_out_m = plan.keep_out_m
        self._path_free_at = None
        self._moved_from = None
        straight = all(leg.kind is LegKind.STRAIGHT for leg in plan.legs)
        state = MissionState.CRUISE if straight else MissionState.FOLLOW
        why = _why_this_plan(plan)
        if not self._heights.at_goals_height:
            why = f"at {self._heights.present_m:.2f} m high, {why}"
        if state is self._state:
            tick.say("replan", why)
            self._fly_path(tick)
            return None
        return Move(state, why)

    def _no_way(self, tick: Tick, reason: str, evidence: tuple[Point, ...]) -> Move:
        """The fixed ladder: look again, forget nearby, forget all, verdict. Never reset."""
        replan, point = self._config.mission.replan, tick.fused.point
        rung = self._ladder.climb()
        if rung is Rung.VERDICT:
            why = f"{rung}: {reason}"
            return Move(MissionState.LAND, why, Outcome(Ending.UNREACHABLE, why, evidence))
        doing = str(rung)
        if rung is Rung.FORGET_NEARBY:
            radius_m, spacing_m = replan.forget_radius_m, self._config.planner.storeys.spacing_m
            self._sensing.maps.forget_within(point, radius_m, _DISC_UNDER_VEHICLE_M, spacing_m)
            doing = f"{rung} {radius_m:g} m"
        elif rung is Rung.FORGET_ALL:
            self._heights.forget(tick, _DISC_UNDER_VEHICLE_M)
        self._look_for_s = replan.hover_s
        return Move(
            MissionState.DETECT,
            f"no way ({self._ladder.failures} of {replan.attempts}): {reason}; {doing}",
        )

    def _next_goal(self, tick: Tick) -> Move:
        """Arrived: next goal of the route, or the end of the flight."""
        self._goal_index += 1
        if self._goal_index < len(self._route):
            if self._heights.aim(-tick.fused.position_ned_m[2], -self.goal[2]):
                self._hold_at = None
                why = f"goal {self._goal_index} reached; changing height in place"
                return Move(MissionState.DETECT, why)
            return Move(MissionState.REPLAN, f"goal {self._goal_index} reached; going on")
        gap_m = distance(tick.fused.point, (self.goal[0], self.goal[1]))
        why = f"{gap_m:.2f} m from the goal"
        return Move(MissionState.LAND, why, Outcome(Ending.GOAL_REACHED, why))

    def _arrived(self, fused: FusedState) -> bool:
        """Within the tolerance of the goal, horizontally and in height."""
        tolerance_m = self._config.mission.goal_tolerance_m
        return (
            self._heights.at_goals_height
            and self._is_over_or_under_goal(fused)
            and abs(fused.position_ned_m[2] - self.goal[2]) <= 2.0 * tolerance_m
        )

    def _is_back(self, fused: FusedState) -> bool:
        """True where there is room again, after a retreat from a narrow place."""
        place = self._retreat_to
        return place is not None and distance(fused.point, place) <= _BACK_WITHIN_M

    def _is_over_or_under_goal(self, fused: FusedState) -> bool:
        """Within the tolerance of the goal, horizontally."""
        gap_m = distance(fused.point, (self.goal[0], self.goal[1]))
        return gap_m <= self._config.mission.goal_tolerance_m

    def _blocked_ahead_m(self) -> float | None:
        """How far ahead along the path a known hit is too near; None when the path is free.

        A path once found free stays free until the map changes, whose versions never repeat.
        """
        version = self._sensing.map.version
        if version == self._path_free_at:
            return None
        found = violated(
            np.array(self._path.remaining()),
            self._sensing.map.hits(),
            self._path_keep_out_m - _PATH_SLACK_M,
        )
        if found is None:
            self._path_free_at = version
            return None
        return found.distance_m

    def _is_stuck(self, tick: Tick) -> bool:
        """True after `_STUCK_AFTER_S` on a path without leaving a small circle."""
        point = tick.fused.point
        if self._moved_from is None or distance(point, self._moved_from[1]) > _STUCK_WITHIN_M:
            self._moved_from = (tick.now_s, point)
            return False
        return tick.now_s - self._moved_from[0] > _STUCK_AFTER_S

    # ------------------------------------------------------------ setpoints

    def _fly_path(self, tick: Tick) -> None:
        """Velocity along the path by Table 2's speed, pushed away from what is too near."""
        fused, guidance = tick.fused, self._config.guidance
        velocity = (fused.velocity_ned_m_s[0], fused.velocity_ned_m_s[1])
        direction = carrot_direction(self._path, fused.point, velocity, guidance)
        nearest = self._sensing.map.nearest_hit(fused.position_ned_m, _CLEARANCE_LIMIT_M)
        clearance_m, closing = math.inf, 0.0
        if nearest is not None:
            clearance_m = nearest[0]
            closing = direction[0] * math.cos(nearest[1]) + direction[1] * math.sin(nearest[1])
        tick.speed_limit_m_s = speed_limit_m_s(
            clearance_m,
            -closing * guidance.speed_max_m_s,
            guidance,
            self._config.beams.max_m,
        )
        speed_m_s = arrival_speed(self._path.remaining_m, tick.speed_limit_m_s)
        wanted = self._loops.track(
            (direction[0] * speed_m_s, direction[1] * speed_m_s), velocity, tick.dt_s
        )
        north, east = push_away(wanted, nearest, guidance)
        down_m = -self._heights.commanded_m
        climb_m_s = self._climb.step(down_m, fused.position_ned_m[2], tick.dt_s)
        self._hold_at = None
        tick.setpoint = Setpoint(
            tick.now_s,
            fused.position_ned_m,
            (north, east, climb_m_s),
            self._scan.step(fused.yaw_rad, tick.dt_s),
        )

    def _hold_position(self, tick: Tick) -> None:
        """Hold with a position (zero velocity alone drifts), turning on.

        Where a hit turns out to be too near to stay, the place to hold moves away from it.
        """
        fused = tick.fused
        yaw_rad = fused.yaw_rad
        if self._state is not MissionState.OFFBOARD:
            yaw_rad = self._scan.step(fused.yaw_rad, tick.dt_s)
        nearest = self._sensing.map.nearest_hit(fused.position_ned_m, _CLEARANCE_LIMIT_M)
        push = push_away((0.0, 0.0), nearest, self._config.guidance)
        down_m = -self._heights.commanded_m
        if push != (0.0, 0.0):
            self._hold_at = None
            tick.setpoint = Setpoint(tick.now_s, (*fused.point, down_m), (*push, 0.0), yaw_rad)
            return
        if self._hold_at is None:
            velocity = fused.velocity_ned_m_s
            self._hold_at = (
                fused.position_ned_m[0] + velocity[0] * _STOP_LEAD_S,
                fused.position_ned_m[1] + velocity[1] * _STOP_LEAD_S,
            )
        added = self._loops.hold(self._hold_at, fused.point, tick.dt_s)
        place = (*self._hold_at, down_m)
        tick.setpoint = Setpoint(tick.now_s, place, (*added, 0.0), yaw_rad)

    def _stream_something(self, tick: Tick) -> None:
        """Every offboard tick has a setpoint; where no state gave one, it is to hold."""
        streaming = self._state in OFFBOARD_STATES or (
            # Until PX4 has taken over the landing, keep holding.
            self._state is MissionState.LAND
            and tick.inputs.status.mode is FlightMode.OFFBOARD
            and tick.inputs.status.landed is not LandedState.ON_GROUND
        )
        if tick.setpoint is None and streaming:
            self._hold_position(tick)

    # ------------------------------------------------------------ operator, faults, end

    def _obey_operator(self, tick: Tick) -> None:
        """STOP holds and then lands; LAND, or a second STOP, lands at once.

        HOLD holds until RESUME; said before the vehicle navigates, it holds as soon as it does.
        """
        for command in tick.inputs.commands:
            if self._state in (MissionState.LAND, MissionState.YIELDED, MissionState.DONE):
                return
            if command in (OperatorCommand.HOLD, OperatorCommand.RESUME):
                self._held = command is OperatorCommand.HOLD
                continue
            why = "stopped by the operator"
            outcome = Outcome(Ending.ABORTED, why)
            if self._state is MissionState.PREFLIGHT:
                self._enter(tick, Move(MissionState.DONE, why, outcome))
            elif (
                command is OperatorCommand.LAND
                or self._landing_ordered
                or self._state not in NAVIGATING_STATES
            ):
                self._enter(tick, Move(MissionState.LAND, f"{why}: landing", outcome))
            else:
                self._landing_ordered = True
                self._outcome = outcome
                move = Move(MissionState.HOLD, f"{why}: holding, landing soon", outcome)
                if self._state is not MissionState.HOLD:
                    self._enter(tick, move)
                self._entered_s = tick.now_s
        if self._held and self._state in NAVIGATING_STATES - {MissionState.HOLD}:
            self._enter(tick, Move(MissionState.HOLD, "held by the operator until told to go on"))

    def _respond_to_faults(self, tick: Tick) -> None:
        """Let go when PX4 or a pilot took over; else do what the fault table says."""
        status = self._status(tick)
        heard = status.link_age_s <= self._config.vehicle.link_timeout_s
        why = self._who_took_it(status) if heard else None
        if why is not None:
            self._enter(tick, Move(MissionState.YIELDED, why, Outcome(Ending.TAKEN_OVER, why)))
            return
        if self._state not in OFFBOARD_STATES and self._state is not MissionState.TAKEOFF:
            return
        found = self._faults(tick)
        if not found:
            return
        worst = found[0]
        if worst.response is failsafe.Response.LAND:
            why = f"{worst.why}: landing"
            self._enter(tick, Move(MissionState.LAND, why, Outcome(worst.ending, worst.why)))
        elif self._state in NAVIGATING_STATES - {MissionState.HOLD}:
            self._enter(tick, Move(MissionState.HOLD, f"{worst.why}: holding"))

    def _who_took_it(self, status: VehicleStatus) -> str | None:
        """Why the vehicle is no longer this service's to command; None while it is."""
        if self._state in OFFBOARD_STATES | {MissionState.TAKEOFF} and not status.armed:
            return "a pilot or PX4 disarmed the vehicle; this service lets go"
        if self._sequence.taken_over(self._state, status) or (
            self._state in NAVIGATING_STATES and status.mode is not FlightMode.OFFBOARD
        ):
            who = "PX4's failsafe" if status.in_failsafe else "a pilot or PX4"
            return f"{who} switched the vehicle to {status.mode.value}; this service lets go"
        return None

    def _faults(self, tick: Tick) -> tuple[failsafe.Found, ...]:
        """Faults present now, strongest response first."""
        mission_s = tick.now_s - self._armed_s if self._armed_s is not None else 0.0
        return failsafe.detect(
            self._config,
            self._status(tick),
            tick.fused,
            self._sensing.state_lost_s(tick.now_s),
            self._silent_beams(tick),
            mission_s,
        )

    def _silent_beams(self, tick: Tick) -> dict[str, float]:
        """Horizontal beams without a fresh reading, silent only for as long as this loop has
        listened: one that stood still hears first whether PX4's failsafe has the vehicle.
        """
        listened_s = tick.now_s - self._listening_since_s
        silent = self._sensing.silent_horizontal_beams(tick.now_s)
        return {name: min(age_s, listened_s) for name, age_s in silent.items()}

    def _status(self, tick: Tick) -> VehicleStatus:
        """The vehicle's status, silent only for as long as this loop has listened."""
        status = tick.inputs.status
        listened_s = tick.now_s - self._listening_since_s
        if status.link_age_s <= listened_s:
            return status
        return msgspec.structs.replace(status, link_age_s=listened_s)

    def _hold(self, tick: Tick) -> Move | None:
        """HOLD: until the fault is gone, or until the operator's landing is due."""
        if self._landing_ordered:
            if self._elapsed_s(tick) >= _HOLD_BEFORE_LANDING_S:
                return Move(MissionState.LAND, "held as ordered; landing", self._outcome)
            return None
        if self._held or self._faults(tick):
            return None
        flying = self._held_from in (MissionState.CRUISE, MissionState.FOLLOW)
        if flying and self._elapsed_s(tick) < _BRIEF_HOLD_S:
            return Move(self._held_from, "a moment's fault is over; what was seen is still true")
        return Move(MissionState.DETECT, "nothing forbids it any more; looking around to go on")

    def _land(self, tick: Tick) -> Move | None:
        """LAND, or end in PX4's Hold when the mission says so and the goal was reached."""
        if not self._stays_up(tick):
            return self._sequence.land(tick, self._elapsed_s(tick))
        if tick.inputs.status.mode is FlightMode.HOLD:
            return Move(MissionState.DONE, "holding at the goal in PX4's Hold mode")
        self._sequence.ask_hold(tick)
        return None

    def _stays_up(self, tick: Tick) -> bool:
        """True while the mission is to end in PX4's Hold, and nothing is in the way of that."""
        reached = self._outcome is not None and self._outcome.ending is Ending.GOAL_REACHED
        if self._config.mission.land_at_end or not reached or self._must_land:
            return False
        if tick.inputs.commands or self._faults(tick):
            self._must_land = True
        elif self._elapsed_s(tick) > _HANDOVER_TIMEOUT_S:
            self._must_land = True
            tick.say("land", "PX4 did not take the vehicle into Hold; landing instead")
        return not self._must_land

    # ------------------------------------------------------------ bookkeeping

    def _elapsed_s(self, tick: Tick) -> float:
        """Time in the present state."""
        return tick.now_s - self._entered_s if self._entered_s is not None else 0.0

    def _enter(self, tick: Tick, move: Move) -> None:
        """Change state; the transition must be in the table."""
        if move.state not in TRANSITIONS[self._state]:
            raise AssertionError(f"{self._state} -> {move.state} is not in the mission's table")
        if move.state is MissionState.HOLD:
            self._held_from = self._state
        self._state = move.state
        self._entered_s = tick.now_s
        if move.outcome is not None:
            self._outcome = move.outcome
        tick.say(move.state.value, move.why)
        match move.state:
            case MissionState.ARM:
                self._sensing.fix_home()
                self._armed_s = tick.now_s
            case MissionState.OFFBOARD:
                self._hold_at = None
                height_m = -tick.fused.position_ned_m[2]
                self._heights.begin(tick.now_s, height_m, -self.goal[2])
                self._sensing.map.mark_seen_disc(tick.fused.point, self._config.map.start_disc_m)
            case MissionState.STOP | MissionState.DETECT | MissionState.HOLD:
                self._scan.restart()
                self._heights.pause(-tick.fused.position_ned_m[2])
            case MissionState.LAND:
                self._heights.pause(-tick.fused.position_ned_m[2])
            case _:
                pass

    def _decision(self, tick: Tick) -> Decision:
        """What this tick decided, as one record."""
        fused = tick.fused
        navigating = self._state in OFFBOARD_STATES
        goal = (self.goal[0], self.goal[1])
        return Decision(
            now_s=tick.now_s,
            state=self._state,
            fused=fused,
            setpoint=tick.setpoint,
            requests=tuple(tick.requests),
            events=tuple(tick.events),
            plan=tick.plan,
            distance_to_go_m=distance(fused.point, goal),
            clearance_m=(
                self._sensing.map.clearance_m(fused.position_ned_m, _CLEARANCE_LIMIT_M)
                if navigating
                else _CLEARANCE_LIMIT_M
            ),
            speed_limit_m_s=tick.speed_limit_m_s,
            stops=self.stops,
            replans=self.replans,
            outcome=self._outcome if self._state is MissionState.DONE else None,
            height_m=self._heights.flown_at_m if navigating else None,
        )


def _why_this_plan(plan: Plan) -> str:
    """One sentence on what was chosen and why."""
    if plan.environment is Environment.FREE or all(
        leg.kind is LegKind.STRAIGHT for leg in plan.legs
    ):
        return f"the straight line to the goal is free, {plan.length_m:.2f} m"
    kinds = {leg.kind for leg in plan.legs}
    if LegKind.HYPERBOLA in kinds:
        way = "hyperbola round the continuous obstacle"
    elif LegKind.GEODESIC in kinds:
        way = "geodesic through what is known"
    else:
        way = "tangent of the sphere"
    if LegKind.HYPERBOLA in kinds and LegKind.ARC in kinds:
        way += " and tangents of spheres"
    return (
        f"{plan.environment.value} obstacles ({len(plan.obstacles)}): {way}, "
        f"{plan.length_m:.2f} m at keep-out {plan.keep_out_m:.3f} m"
    )
