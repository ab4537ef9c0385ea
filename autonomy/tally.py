"""What adds up over a flight, tick by tick, and becomes its report.

Fed by a flight as it happens, or by its log afterwards.
"""

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field

from autonomy.config import Config
from autonomy.geometry import Point, distance, polyline_length
from autonomy.mission.flown import FlownLegs
from autonomy.mission.machine import OFFBOARD_STATES, PATH_STATES
from autonomy.model import (
    Command,
    Decision,
    Event,
    FilterHealth,
    Inputs,
    MissionState,
    Outcome,
    Plan,
    WallFixReport,
)
from autonomy.planning_time import PlanningTime
from autonomy.report import EXIT_CODES, FlightReport
from autonomy.t3drm.bound import BoundTally
from autonomy.t3drm.sides import SideChanges
from hal.frames import Vector3
from hal.readings import LandedState

_TRACK_STEP_M = 0.03
"""Steps shorter than the noise would add up to a length that nobody flew."""


@dataclass
class Tally:
    """Sums, extremes and counts of one flight."""

    planning: PlanningTime = field(default_factory=PlanningTime)
    bound: BoundTally = field(default_factory=BoundTally)
    sides: SideChanges = field(default_factory=SideChanges)
    legs: FlownLegs = field(default_factory=FlownLegs)
    path_length_m: float = 0.0
    minimum_clearance_m: float | None = None
    max_speed_m_s: float = 0.0
    flight_time_s: float = 0.0
    late_ticks: int = 0
    stops: int = 0
    replans: int = 0
    leg_kinds: list[str] = field(default_factory=list)
    guard_limits: Counter[str] = field(default_factory=Counter)
    events: list[Event] = field(default_factory=list)
    track: list[Point] = field(default_factory=list)
    health: FilterHealth | None = None
    stretches: list[tuple[float, list[Point]]] = field(default_factory=list)
    """(height above the take-off point, track) of every stretch of way at one height."""
    walls: WallFixReport | None = None
    wall_offset_max_m: float = 0.0
    path_to_goal_m: float = 0.0
    """Before a return began."""
    _returned: bool = False
    _airborne_s: float | None = None

    def note(self, command: Command, inputs: Inputs, step_s: float) -> None:
        """Add one tick."""
        decision = command.decision
        self.stops, self.replans = decision.stops, decision.replans
        self.events.extend(decision.events)
        self.guard_limits.update(command.guard.limits)
        self.planning.note(decision, step_s)
        self._note_plan(decision)
        if decision.walls is not None:
            self.walls = decision.walls
            offset_m = math.hypot(*decision.walls.offset_ne_m)
            self.wall_offset_max_m = max(self.wall_offset_max_m, offset_m)
        fused = decision.fused
        if fused is not None:
            self.health = fused.health
        if fused is None or not fused.ok or not inputs.status.armed:
            return
        if inputs.status.landed is LandedState.ON_GROUND:
            return
        if self._airborne_s is None:
            self._airborne_s = decision.now_s
        self.flight_time_s = decision.now_s - self._airborne_s
        if not self.track:
            self.track.append(fused.point)
        elif (step_m := distance(self.track[-1], fused.point)) > _TRACK_STEP_M:
            self.path_length_m += step_m
            self._returned = self._returned or decision.state is MissionState.RETURN
            if not self._returned:
                self.path_to_goal_m += step_m
            self.legs.moved(decision.now_s, fused.point, step_m)
            self.track.append(fused.point)
        self._note_height(decision)
        velocity = fused.velocity_ned_m_s
        self.max_speed_m_s = max(self.max_speed_m_s, (velocity[0] ** 2 + velocity[1] ** 2) ** 0.5)
        if decision.state in OFFBOARD_STATES:
            known = self.minimum_clearance_m
            clearance_m = decision.clearance_m
            self.minimum_clearance_m = clearance_m if known is None else min(known, clearance_m)

    def _note_plan(self, decision: Decision) -> None:
        """A plan, or that there is none, where this tick planned."""
        plan = decision.plan
        if plan is None or decision.fused is None:
            return
        if decision.state is not MissionState.RETURN:  # the bound is that of the way to the goal
            self.bound.planned(decision.distance_to_go_m, plan)
            self.sides.planned(decision.fused.point, plan)
        if not isinstance(plan, Plan):
            return
        self.legs.planned(plan)
        for leg in plan.legs:
            if leg.kind.value not in self.leg_kinds:
                self.leg_kinds.append(leg.kind.value)

    def _note_height(self, decision: Decision) -> None:
        """The stretch goes on, or another one begins."""
        height_m, fused = decision.height_m, decision.fused
        if height_m is None or fused is None or decision.state not in PATH_STATES:
            return
        if not self.stretches or self.stretches[-1][0] != height_m:
            self.stretches.append((height_m, []))
        points = self.stretches[-1][1]
        if not points or distance(points[-1], fused.point) > _TRACK_STEP_M:
            points.append(fused.point)

    def report(
        self,
        outcome: Outcome,
        route_ned_m: tuple[Vector3, ...],
        *,
        config: Config,
        log_path: str | None = None,
        log_notes: Sequence[str] = (),
        scenario: str | None = None,
        seed: int | None = None,
        origin_ne_m: Point = (0.0, 0.0),
    ) -> FlightReport:
        """What the flight was; the clearance is the mapped one."""
        comfortable_m = config.body.radius_m + config.planner.comfortable_clearance_m
        straight = ((0.0, 0.0), *((goal[0], goal[1]) for goal in route_ned_m))
        return FlightReport(
            ending=outcome.ending,
            why=outcome.why,
            exit_code=int(EXIT_CODES[outcome.ending]),
            route_ned_m=route_ned_m,
            flight_time_s=self.flight_time_s,
            path_length_m=self.path_length_m,
            path_to_goal_m=self.path_to_goal_m,
            origin_ne_m=origin_ne_m,
            straight_length_m=polyline_length(straight),
            stops=self.stops,
            replans=self.replans,
            minimum_clearance_m=self.minimum_clearance_m,
            body_radius_m=config.body.radius_m,
            path_bound=self.bound.bound(comfortable_m, config.guard.fence),
            side_changes=self.sides.count,
            legs=self.legs.record(),
            max_speed_m_s=self.max_speed_m_s,
            timing=self.planning.record(),
            leg_kinds=tuple(self.leg_kinds),
            heights_m=tuple(height_m for height_m, _ in self.stretches),
            guard_limits=dict(self.guard_limits),
            estimator=self.health,
            walls=self.walls,
            wall_offset_max_m=self.wall_offset_max_m,
            late_ticks=self.late_ticks,
            events=tuple((event.stamp_s, event.name, event.why) for event in self.events),
            log_path=log_path,
            log_notes=tuple(log_notes),
            seed=seed,
            scenario=scenario,
        )
