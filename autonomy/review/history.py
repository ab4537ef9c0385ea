"""A recorded flight, flown again: what every tick knew and decided, ready to be judged and drawn.

The log has inputs and decisions, not the map. So the inputs are flown again, and what the map said
at each tick is noted beside the recorded decision.
"""

import math
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import msgspec
import numpy as np

from autonomy.config import Config
from autonomy.errors import NotReplayable
from autonomy.flightlog.reader import FlightLog
from autonomy.geometry import Point
from autonomy.logbook import flown_again, recorded_config
from autonomy.mission.guarded import GuardedPilot
from autonomy.mission.machine import OFFBOARD_STATES
from autonomy.model import (
    BeamDoubt,
    Command,
    Event,
    FilterHealth,
    MissionState,
    NoPlan,
    Outcome,
    Plan,
)
from autonomy.t3drm.bound import PathBound
from autonomy.t3drm.classification import Linkage
from autonomy.tally import Tally
from hal.frames import Vector3
from hal.interfaces import SeenSpace
from hal.readings import StatusText
from hal.vehicle.guard import stopping_distance_m

STILL_M_S = 0.03
"""Slower than this is noise, and has no direction to look along."""


class Moment(msgspec.Struct, frozen=True):
    """One tick. Distances are from the vehicle's centre, positions in the mission frame.

    `ahead_m`: how far the body could have gone on the way it was really moving, through space that
    was seen free, at most the guard's horizon; None while it rested or nothing was streamed.
    """

    now_s: float
    state: MissionState
    position_ned_m: Vector3
    velocity_ned_m_s: Vector3
    known: bool
    streaming: bool
    clearance_m: float
    ahead_m: float | None
    speed_limit_m_s: float
    limits: tuple[str, ...]
    asked_ned_m_s: Vector3 | None
    sent_ned_m_s: Vector3 | None
    events: tuple[Event, ...]
    health: FilterHealth
    flown_m: float = 0.0
    """The way flown by then, without that of a return."""
    doubts: tuple[BeamDoubt, ...] = ()
    faults: tuple[str, ...] = ()

    @property
    def speed_m_s(self) -> float:
        """Horizontal speed."""
        return math.hypot(self.velocity_ned_m_s[0], self.velocity_ned_m_s[1])

    @property
    def altitude_m(self) -> float:
        """Height over the take-off point."""
        return -self.position_ned_m[2]


class Replan(msgspec.Struct, frozen=True):
    """One planning step: its result, what it cost, and the topology it was made from.

    `hits` are all that the map held; `persistence` are the death radii of their components.
    """

    now_s: float
    seconds: float
    at: Point
    result: Plan | NoPlan
    hits: tuple[Point, ...]
    persistence: tuple[float, ...]


@dataclass
class History:
    """A whole flight. `difference` says where flying it again departed from the record."""

    path: Path
    config: Config
    route: tuple[Vector3, ...]
    scenario: str
    moments: list[Moment] = field(default_factory=list)
    replans: list[Replan] = field(default_factory=list)
    texts: list[StatusText] = field(default_factory=list)
    limits: Counter[str] = field(default_factory=Counter)
    outcome: Outcome | None = None
    hits: tuple[Point, ...] = ()
    difference: str | None = None
    damage: str | None = None
    offset_ne_m: Point = (0.0, 0.0)
    """Where the mission frame begins in the frame of the service that flew it."""
    tally: Tally = field(default_factory=Tally)
    movers: bool = False
    """True when something was seen to move."""

    @property
    def path_bound(self) -> PathBound:
        """What TangentBug's bound allows for the obstacles met."""
        config = self.config
        comfortable_m = config.body.radius_m + config.planner.comfortable_clearance_m
        return self.tally.bound.bound(comfortable_m, config.guard.fence)

    @property
    def events(self) -> list[Event]:
        """Everything that was told, oldest first."""
        return [event for moment in self.moments for event in moment.events]

    @property
    def start_s(self) -> float:
        """Time of the first tick; other times are told from it."""
        return self.moments[0].now_s


def history_of(path: Path, tell_share: Callable[[float], None] = lambda _: None) -> History:
    """Read the log and fly it again; raises NotReplayable when there is nothing to fly.

    `tell_share` hears at every tick how much of the log is read, from 0 to 1.

    A log with a gap, or of a program that decided otherwise, is told by `difference`: what the
    record itself says stays right, what needs the map (`ahead_m`, hits) is of the flight again.
    """
    log = FlightLog.open(path)
    config, route = recorded_config(log), log.route()
    history = History(path, config, route, log.header.scenario, offset_ne_m=log.offset_ne_m())
    guarded = GuardedPilot(config, route, log.resumed())
    for tick, difference in flown_again(log, guarded):
        tell_share(log.share_read)
        history.difference = difference
        history.tally.note(tick.command, tick.inputs, tick.step_s)
        _note(history, tick.command, guarded, tick.step_s)
    if not history.moments:
        raise NotReplayable(f"{path}: holds no complete tick; there is nothing to review")
    history.hits = _hits(guarded)
    history.damage = log.damage
    history.texts = list(log.texts())
    return history


def _note(history: History, command: Command, guarded: GuardedPilot, step_s: float) -> None:
    decision = command.decision
    fused = decision.fused
    streaming = decision.state in OFFBOARD_STATES and command.setpoint is not None
    position = fused.position_ned_m if fused is not None else (0.0, 0.0, 0.0)
    velocity = fused.velocity_ned_m_s if fused is not None else (0.0, 0.0, 0.0)
    known = fused is not None and fused.ok
    guard = history.config.guard
    horizon_m = stopping_distance_m(guard.speed_max_m_s, guard.reaction_s, guard.braking_m_s2)
    history.moments.append(
        Moment(
            now_s=decision.now_s,
            state=decision.state,
            position_ned_m=position,
            velocity_ned_m_s=velocity,
            known=known,
            streaming=streaming,
            clearance_m=decision.clearance_m,
            ahead_m=_ahead_m(guarded.pilot.space, position, velocity, decision.now_s, horizon_m)
            if known and streaming
            else None,
            speed_limit_m_s=decision.speed_limit_m_s,
            limits=command.guard.limits,
            asked_ned_m_s=decision.setpoint.velocity_ned_m_s if decision.setpoint else None,
            sent_ned_m_s=command.setpoint.velocity_ned_m_s if command.setpoint else None,
            events=decision.events,
            health=fused.health if fused is not None else FilterHealth(),
            flown_m=history.tally.path_to_goal_m,
            doubts=decision.doubts,
            faults=decision.faults,
        )
    )
    history.movers = history.movers or any(mover.moving for mover in decision.movers)
    history.limits.update(command.guard.limits)
    history.outcome = decision.outcome or history.outcome
    if decision.plan is not None:
        hits = _hits(guarded)
        points = np.array(hits, dtype=np.float64).reshape(-1, 2)
        history.replans.append(
            Replan(
                decision.now_s,
                step_s,
                (position[0], position[1]),
                decision.plan,
                hits,
                Linkage.of(points).persistence(),
            )
        )


def _ahead_m(
    space: SeenSpace, position: Vector3, velocity: Vector3, now_s: float, horizon_m: float
) -> float | None:
    """Seen-free way along the true velocity; None at rest."""
    if math.hypot(velocity[0], velocity[1]) < STILL_M_S:
        return None
    heading_rad = math.atan2(velocity[1], velocity[0])
    return space.free_distance_m(position, heading_rad, horizon_m, now_s)


def _hits(guarded: GuardedPilot) -> tuple[Point, ...]:
    return tuple((north, east) for north, east in guarded.pilot.sensing.map.hits().tolist())
