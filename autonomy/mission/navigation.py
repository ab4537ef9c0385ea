"""The states of Algorithm 2: cruise and follow, stop, detect, replan.

    CRUISE   fly straight at the goal (Eq. 10: distance and bearing)
    STOP     something is in the way: come to rest
    DETECT   complete the picture: turn until every bearing was seen
    REPLAN   classify; sphere or hyperbola; choose the cheapest
    FOLLOW   fly the chosen path; anything new in the way: STOP again

Algorithm 2's steps, and where they are:

    1        start                           `Sequence`: preflight, arm, take off, Offboard
    2        Ricci flow with metric g0       `Planner.keep_outs_m`: the radii that are tried
    3        any obstacle?                   `follow`: none, `Steering.fly`; else `_on_blocked`,
                                             `stop`, `detect`; discrete or continuous: `replan`
    4-7      sphere, tangents T, T_min       `replan`: `Commitment`, `Planner`, `t3drm.spherical`
    8, 9     follow T_min; back to 3         `follow`
    10, 11   hyperbola, its speed; to 3      `replan`: `t3drm.hyperbolic`; `Steering.fly`: Table 2
    12, 13   goal reached; stop              `_arrived`, `_next_goal`; `Landing`
"""

import math

import numpy as np
from numpy.typing import NDArray

from autonomy.config import Config
from autonomy.geometry import Point, distance
from autonomy.mission.commitment import Commitment
from autonomy.mission.course import Course
from autonomy.mission.failsafe import Fault, Response, response_to
from autonomy.mission.heights import Heights
from autonomy.mission.ladder import Ladder, Rung
from autonomy.mission.making_way import predicted_hits
from autonomy.mission.sensing import UNDER_VEHICLE_M, Sensing
from autonomy.mission.sequence import Move
from autonomy.mission.steering import Steering
from autonomy.mission.tick import Tick
from autonomy.mission.trail import Trail
from autonomy.mission.way_out import WayOut
from autonomy.model import (
    Ending,
    Environment,
    FusedState,
    LegKind,
    MissionState,
    NoPlan,
    Outcome,
    Plan,
)
from autonomy.t3drm.over_under import Way
from autonomy.t3drm.planner import Planner
from hal.frames import Vector3, horizontal_norm

_AT_REST_M_S = 0.05
_BACK_WITHIN_M = 0.1
_CLOSED_FOR_S, _CLOSED_GAP_S = 0.5, 0.2
"""Over or under the goal: so long must the way to its height be closed, with no longer gaps."""
WAYS_OUT_MAX = 4
"""In one flight, so that it ends: a look round follows, and no rung is climbed for it."""
_GOAL_MAY_MOVE = 0.6
"""By this much of the tolerance the planner may move a goal that a noisy hit has come too near."""


class Navigation:
    """Each state is a function of the tick: where to go next, or None to stay."""

    def __init__(
        self,
        config: Config,
        route: tuple[Vector3, ...],
        sensing: Sensing,
        planner: Planner,
        heights: Heights,
        steering: Steering,
        trail: Trail,
    ) -> None:
        self._config = config
        self._route = route
        self._goal_index = 0
        self._sensing = sensing
        self._heights = heights
        self._steering = steering
        self._commitment = Commitment(planner, config.mission.replan.side_hysteresis_m)
        self._course = Course(sensing)
        self._planned_s = -math.inf
        self._ladder = Ladder(config.mission.replan.attempts)
        self._look_for_s = 0.0
        self._retreat_to: Point | None = None
        self._way_out = WayOut(config, planner, trail)
        self._ways_out = 0
        self._closed_since_s: float | None = None
        self._closed_at_s = -math.inf
        self.stops = 0
        self.replans = 0

    @property
    def goal_index(self) -> int:
        """Which goal of the route that is."""
        return self._goal_index

    def begin_at(self, goal_index: int) -> None:
        """The goals before this one were reached already."""
        self._goal_index = goal_index

    @property
    def goal(self) -> Vector3:
        """The goal being flown to."""
        return self._route[min(self._goal_index, len(self._route) - 1)]

    def follow(self, tick: Tick) -> Move | None:
        """CRUISE and FOLLOW: fly the path until the goal, or until something is in the way.

        Algorithm 2, steps 3, 8, 9, 11 and 12.
        """
        if self._arrived(tick.fused):
            return self._next_goal(tick)
        self._heights.note_place(tick.fused.point)
        if self._is_back(tick.fused):
            return Move(MissionState.STOP, "back where there is room")
        move = self._on_other_heights(tick)
        if move is not None:
            return move
        if self._steering.has_strayed():
            return self.replan(tick)
        blocked_m = self._course.blocked_ahead_m()
        if blocked_m is not None:
            move = self._on_blocked(tick, blocked_m)
            if move is not None:
                return move
        elif not self._steering.makes_way and self._course.is_stuck(tick):
            return self._no_way(tick, "no progress on a path that is free", ())
        self._steering.fly(tick, self._course.path)
        return None

    def _on_blocked(self, tick: Tick, blocked_m: float) -> Move | None:
        """Something known stands on the path, `blocked_m` ahead."""
        replan = self._config.mission.replan
        rolling = replan.mode == "rolling" and not self._sensing.things_move
        if rolling or self._heights.proving:
            if tick.now_s - self._planned_s < replan.min_interval_s:
                return None
            return self.replan(tick)
        if blocked_m > self._config.mission.detection_range_m:
            return None
        self.stops += 1
        return Move(MissionState.STOP, f"something is in the way {blocked_m:.2f} m ahead")

    def stop(self, tick: Tick) -> Move | None:
        """STOP: wait until the vehicle is at rest."""
        if horizontal_norm(tick.fused.velocity_ned_m_s) > _AT_REST_M_S:
            return None
        return Move(MissionState.DETECT, "at rest; looking at what is there")

    def detect(self, tick: Tick) -> Move | None:
        """DETECT: turn until every bearing was seen once more, at the height of the flight."""
        if self._heights.changing:
            if self._heights.change(tick):
                self._commitment.forget()
                tick.entered_s = tick.now_s
                self._steering.scan.restart()
            return None
        if (
            abs(self._steering.scan.turned_rad) < self._sensing.lookout.now.sweep_rad
            or tick.elapsed_s < self._look_for_s
        ):
            return None
        self._look_for_s = 0.0
        self._heights.looked_round(tick.fused.point)
        return Move(MissionState.REPLAN, "every direction was seen")

    def replan(self, tick: Tick) -> Move | None:
        """REPLAN: classify, choose sphere or hyperbola, take the cheapest free path.

        Algorithm 2, steps 4 to 7 and 10; Algorithm 1 times it. Where nothing leads on at this
        height, over and under are looked at, one a tick.
        """
        if tick.state is MissionState.REPLAN and self._heights.searching:
            found = self._heights.ask_on()
            if isinstance(found, NoPlan) and self._heights.stop_guessing():
                return None
            return self._decided(tick, found)
        self._planned_s = tick.now_s
        self.replans += 1
        goal, tolerance_m = (self.goal[0], self.goal[1]), self._goal_may_move_m
        here = self._heights.ask(tick, self._plan_here(tick, goal, tolerance_m), goal, tolerance_m)
        self._retreat_to = None
        if isinstance(here, Plan):
            return self._take(tick, here)
        back = self._heights.retreat(tick, here)
        if back is not None:
            self._retreat_to = back.points[-1]
            tick.say("height", f"{here.reason}; back to where there is room to change height")
            return self._take(tick, back)
        tick.plan = here
        if not self._heights.searching:
            if self._heights.stop_guessing():
                return None
            return self._decided(tick, self._heights.told(here))
        if tick.state is MissionState.REPLAN:
            return None
        height = f"{self._heights.present_m:.2f} m"
        return Move(MissionState.STOP, f"{here.reason} at {height}; looking at other heights")

    def _plan_here(self, tick: Tick, goal: Point, tolerance_m: float) -> Plan | NoPlan:
        """What the present height offers."""
        if self._heights.proving:
            return self._heights.prove(tick, goal, tolerance_m)
        hits, course = np.array(self._heights.hits()), self._course.path.remaining()
        point = tick.fused.point
        coming = self._predicted_hits(tick)
        if coming.shape[0] > 0:
            joined = np.concatenate((hits.reshape(-1, 2), coming))
            clear = self._commitment.plan(point, goal, joined, tolerance_m, course)
            if isinstance(clear, Plan):
                return clear
        # What moves will have moved on: a way that only it closes is no reason to give up.
        return self._commitment.plan(point, goal, hits, tolerance_m, course)

    def _predicted_hits(self, tick: Tick) -> NDArray[np.float64]:
        """Where what moves will be, as far as it concerns a plan."""
        config, point = self._config, tick.fused.point
        speed_m_s, horizon_s = config.guidance.speed_max_m_s, config.movers.plan_ahead_s
        return predicted_hits(tick.movers, point, speed_m_s, horizon_s)

    def _decided(self, tick: Tick, found: Way | NoPlan | None) -> Move | None:
        """What the search came to; None while it goes on."""
        if found is None:
            return None
        if isinstance(found, Way):
            if found.height_m == self._heights.present_m:
                return self._take(tick, found.plan)
            tick.plan = found.plan
            return Move(MissionState.DETECT, self._go_to_height(tick, found))
        tick.plan = found
        return self._no_way(tick, found.reason, found.evidence)

    def _on_other_heights(self, tick: Tick) -> Move | None:
        """On the way: come to the goal's height above or below it, or to a cheaper height."""
        heights = self._heights
        if not heights.at_goals_height and self._is_over_or_under_goal(tick.fused):
            goal_m = heights.goal_m
            if not heights.may_change(tick, goal_m):
                if not self._is_closed_for_long(tick):
                    return None
                return self._no_way(tick, f"the way to the goal's height, {goal_m:.2f} m", ())
            heights.change_to(goal_m)
            self._closed_since_s = None
            return Move(MissionState.STOP, f"over or under the goal; on to {goal_m:.2f} m")
        found = heights.ask_on() if heights.searching else None
        if found is None or isinstance(found, NoPlan) or found.height_m == heights.present_m:
            return None
        tick.plan = found.plan
        return Move(MissionState.STOP, self._go_to_height(tick, found))

    def _is_closed_for_long(self, tick: Tick) -> bool:
        """True when no change to the goal's height was possible for some readings on end: one
        stale or stray reading of the beam up or down is no verdict.
        """
        if self._closed_since_s is None or tick.now_s - self._closed_at_s > _CLOSED_GAP_S:
            self._closed_since_s = tick.now_s
        self._closed_at_s = tick.now_s
        if tick.now_s - self._closed_since_s < _CLOSED_FOR_S:
            return False
        self._closed_since_s = None
        return True

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

    def _take(self, tick: Tick, plan: Plan, why: str = "") -> Move | None:
        """Fly a plan of the present height; `why` where it is not the way to the goal."""
        tick.plan = plan
        self._course.take(plan)
        straight = all(leg.kind is LegKind.STRAIGHT for leg in plan.legs)
        state = MissionState.CRUISE if straight else MissionState.FOLLOW
        why = why or _why_this_plan(plan)
        if not self._heights.at_goals_height:
            why = f"at {self._heights.present_m:.2f} m high, {why}"
        if state is tick.state:
            tick.say("replan", why)
            self._steering.fly(tick, self._course.path)
            return None
        return Move(state, why)

    def _no_way(self, tick: Tick, reason: str, evidence: tuple[Point, ...]) -> Move | None:
        """Out of where the map has closed behind the vehicle, or one rung of the fixed ladder: look
        again, forget nearby, forget all, verdict. Never reset.

        From the first rung on the newest look counts: what was hit while the position was wrong by
        centimetres narrows every gap.
        """
        out = self._out_by_the_way_in(tick)
        if out is not None:
            return self._take(tick, out, f"{reason}; out by the way in, {out.length_m:.2f} m")
        replan, point = self._config.mission.replan, tick.fused.point
        rung = self._ladder.climb()
        self._sensing.maps.trust_newest()
        if rung is Rung.VERDICT:
            why = f"{rung}: {reason}"
            back = response_to(self._config, Fault.UNREACHABLE) is Response.RETURN
            back = back or not self._heights.may_land(point)
            state = MissionState.RETURN if back else MissionState.LAND
            return Move(state, why, Outcome(Ending.UNREACHABLE, why, evidence))
        doing = str(rung)
        if rung is Rung.FORGET_NEARBY:
            radius_m, spacing_m = replan.forget_radius_m, self._config.planner.storeys.spacing_m
            self._sensing.maps.forget_within(point, radius_m, UNDER_VEHICLE_M, spacing_m)
            doing = f"{rung} {radius_m:g} m"
        elif rung is Rung.FORGET_ALL:
            self._heights.forget(tick, UNDER_VEHICLE_M)
        self._look_for_s = replan.hover_s
        return Move(
            MissionState.DETECT,
            f"no way ({self._ladder.failures} of {replan.attempts}): {reason}; {doing}",
        )

    def _out_by_the_way_in(self, tick: Tick) -> Plan | None:
        """Where a look again has not helped, at rest, at the goal's height, and nothing moves."""
        looked = self._ladder.failures > 0 and tick.state is MissionState.REPLAN
        at_rest = horizontal_norm(tick.fused.velocity_ned_m_s) <= _AT_REST_M_S
        if not (looked and at_rest and self._heights.at_goals_height):
            return None
        if self._sensing.things_move or self._ways_out >= WAYS_OUT_MAX:
            return None
        hits, goal = np.array(self._heights.hits()).reshape(-1, 2), (self.goal[0], self.goal[1])
        point, height_m = tick.fused.point, self._heights.present_m
        out = self._way_out.plan(point, goal, height_m, hits, self._goal_may_move_m)
        if out is not None:
            self._ways_out += 1
            self._retreat_to = out.points[-1]
        return out

    @property
    def _goal_may_move_m(self) -> float:
        return _GOAL_MAY_MOVE * self._config.mission.goal_tolerance_m

    def _next_goal(self, tick: Tick) -> Move:
        """Arrived: next goal of the route, or the end of the flight."""
        self._goal_index += 1
        if self._goal_index < len(self._route):
            if self._heights.aim(-tick.fused.position_ned_m[2], -self.goal[2]):
                self._steering.let_go()
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
