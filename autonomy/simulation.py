"""Whole missions in process, on a simulated clock: the same pilot, guard, sensors and world.

No MAVLink, no asyncio, no waiting: a flight of a minute takes a fraction of a second. What a
seed gives once it gives always.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property, partial
from typing import Protocol

import numpy as np

from autonomy.config import Config
from autonomy.geometry import Point, distance
from autonomy.mission.guarded import Command, GuardedPilot
from autonomy.model import Decision, Inputs, MissionState, OperatorCommand, Outcome
from autonomy.planning_time import PlanningTime
from autonomy.t3drm.bound import BoundTally, PathBound
from autonomy.t3drm.sides import SideChanges
from autonomy.t3drm.timing import TimingRecord
from hal.clock import SimClock
from hal.config import MavlinkDriver
from hal.frames import Vector3
from hal.setpoints import Reply
from hal.sim.autopilot import Autopilot
from hal.sim.fault_clock import FaultClock
from hal.sim.faults import FaultyBeams, GnssFaults, PositionFaults, with_beam_faults
from hal.sim.scenario import Scenario, VehicleSimulation
from hal.sim.sensors import EstimatorError, SimulatedBeams, SimulatedGnss
from hal.sim.vehicle import SimVehicle
from hal.sim.world import Contact, World

_BOOT_S = 6.0
"""The autopilot's time from power to armable; flown through before the mission starts."""
_AT_HEIGHT_M = 0.1
"""So near to the height of flight is at it."""


class Flyer(Protocol):
    """What flies in a simulation: the guarded pilot, or another planner in its place."""

    @property
    def goal(self) -> Vector3:
        """The goal being flown to, NED about the take-off point."""

    def step(self, inputs: Inputs) -> Command:
        """One tick; deterministic."""


@dataclass
class SimulatedFlight:
    """What a simulated flight was, with the truth that only a simulation knows."""

    outcome: Outcome
    flight_time_s: float
    navigation_time_s: float
    """From Offboard to LAND, the rest of the first climb included."""
    climb_time_s: float
    """Of that, until the height of flight was reached first; 0 where it never was."""
    path_length_m: float
    true_clearance_m: float
    collided: bool
    stops: int
    replans: int
    final_error_m: float
    max_speed_m_s: float
    simulated_s: float
    wall_s: float
    timing: TimingRecord | None
    reckon_path_bound: Callable[[], PathBound]
    side_changes: int
    height_changes: int
    track: list[Point] = field(default_factory=list)
    commands: list[Command] = field(default_factory=list)
    contacts: list[tuple[MissionState, Contact]] = field(default_factory=list)
    """The beginning of every touch, and the state of the mission then."""

    @cached_property
    def path_bound(self) -> PathBound:
        """The bound for what was planned; reckoned when first asked for, as campaigns seldom do."""
        return self.reckon_path_bound()


class Simulation:
    """One scenario, one vehicle, one pilot; `run()` flies the mission to its end."""

    def __init__(
        self,
        scenario: Scenario,
        config: Config,
        route: tuple[Vector3, ...],
        seed: int = 0,
        *,
        flyer: Flyer | None = None,
    ) -> None:
        """`config.guard.fence` is taken as given: callers put the scenario's there. `flyer` is new
        and made for this configuration; None is the guarded pilot on the route.
        """
        streams = [np.random.default_rng(child) for child in np.random.SeedSequence(seed).spawn(6)]
        self.clock = SimClock()
        when = FaultClock(self.clock.now_s())
        self.world = World(scenario)
        self._scenario = scenario
        self._config = config
        self.vehicle = SimVehicle(
            Autopilot(scenario, streams[0]),
            self.clock,
            EstimatorError(scenario.estimator, streams[1]),
            faults=scenario.faults,
            fault_clock=when,
            rng=streams[4],
        )
        self._beams = with_beam_faults(
            SimulatedBeams(self.world, config.beams, scenario.beams, streams[2]),
            scenario.faults,
            streams[2],
            clock=when,
        )
        self._position_faults = PositionFaults(scenario.faults, streams[2], clock=when)
        self._gnss_faults = GnssFaults(scenario.faults, streams[5], when)
        self._gnss = SimulatedGnss(scenario.gnss, streams[3]) if scenario.gnss.present else None
        self.flyer: Flyer = GuardedPilot(config, route) if flyer is None else flyer
        self._replies: list[Reply] = []
        self.pending: list[OperatorCommand] = []
        """Operator commands for the next tick."""

    @property
    def guarded(self) -> GuardedPilot:
        """The pilot with its guard; raises TypeError where something else flies."""
        if not isinstance(self.flyer, GuardedPilot):
            raise TypeError(f"no guarded pilot flies here, but a {type(self.flyer).__name__}")
        return self.flyer

    def spoilt_readings(self, beam: str) -> int:
        """How many readings of a beam its faults have changed, or kept back."""
        return self._beams.spoilt[beam] if isinstance(self._beams, FaultyBeams) else 0

    def inputs(self) -> Inputs:
        """What the pilot may know now."""
        truth = self.vehicle.truth()
        now_s = self.clock.now_s()
        local = self.vehicle.local_position()
        inputs = Inputs(
            now_s=now_s,
            ranges=self._beams.sample(
                now_s,
                truth.position_ned_m,
                truth.roll_rad,
                truth.pitch_rad,
                truth.yaw_rad,
            ),
            local_position=self._position_faults.pass_on(local) if local is not None else None,
            attitude=self.vehicle.attitude(),
            gnss=self._gnss_faults.pass_on(now_s, self._gnss.sample(now_s, truth.position_ned_m))
            if self._gnss
            else None,
            status=self.vehicle.status(),
            facts=self.vehicle.facts(),
            replies=tuple(self._replies),
            commands=tuple(self.pending),
        )
        self._replies.clear()
        self.pending.clear()
        return inputs

    def tick(self) -> Command:
        """Sense, decide, act, and let one period pass."""
        command = self.flyer.step(self.inputs())
        if command.wire_setpoint is not None:
            self.vehicle.send(command.wire_setpoint)
        for request in command.decision.requests:
            self._replies.append(self.vehicle.execute_now(request))
        self.vehicle.advance(1.0 / self._config.control.rate_hz)
        return command

    def run(
        self,
        *,
        on_tick: Callable[["Simulation", Command], None] | None = None,
        keep_commands: bool = False,
        limit_s: float = 3600.0,
    ) -> SimulatedFlight:
        """Fly until the pilot says DONE; raises TimeoutError after `limit_s` simulated seconds."""
        started = time.perf_counter()
        self.vehicle.advance(_BOOT_S)
        book = _Book(self._scenario.vehicle, self._config)
        while True:
            before = time.perf_counter()
            command = self.tick()
            book.note(self, command, time.perf_counter() - before)
            if keep_commands:
                book.commands.append(command)
            if on_tick is not None:
                on_tick(self, command)
            if command.decision.outcome is not None:
                return book.close(command, time.perf_counter() - started)
            if self.clock.now_s() > limit_s:
                raise TimeoutError(f"the simulated mission did not end within {limit_s:g} s")


class _Book:
    """Adds up a flight as it happens."""

    def __init__(self, body: VehicleSimulation, config: Config) -> None:
        self._body = body
        self._config = config
        self._bound = BoundTally()
        self._sides = SideChanges()
        self._height_m: float | None = None
        self._height_changes = 0
        self._airborne_from_s: float | None = None
        self._navigating: list[float] = []
        self._at_height_s: float | None = None
        self._clearance_m = float("inf")
        self._contacts: list[tuple[MissionState, Contact]] = []
        self._touching: str | None = ""
        self._max_speed_m_s = 0.0
        self._length_m = 0.0
        self._planning = PlanningTime()
        self._error_m = float("inf")
        self._last_s = 0.0
        self.track: list[Point] = []
        self.commands: list[Command] = []

    def note(self, simulation: Simulation, command: Command, step_s: float) -> None:
        """One tick's truth."""
        truth = simulation.vehicle.truth()
        decision = command.decision
        self._last_s = decision.now_s
        self._planning.note(decision, step_s)
        returning = decision.state is MissionState.RETURN
        if decision.plan is not None and decision.fused is not None and not returning:
            self._bound.planned(decision.distance_to_go_m, decision.plan)
            self._sides.planned(decision.fused.point, decision.plan)
        if decision.height_m not in (None, self._height_m):
            self._height_changes += self._height_m is not None
            self._height_m = decision.height_m
        if -truth.position_ned_m[2] < 0.1:
            return
        if self._airborne_from_s is None:
            self._airborne_from_s = decision.now_s
        point = (truth.position_ned_m[0], truth.position_ned_m[1])
        if self.track:
            self._length_m += distance(self.track[-1], point)
        self.track.append(point)
        velocity = truth.velocity_ned_m_s
        world, body = simulation.world.at(truth.stamp_s), self._body
        clearance_m = world.clearance_m(truth.position_ned_m, body.body_half_height_m)
        self._clearance_m = min(self._clearance_m, clearance_m)
        contact = world.contact(
            truth.stamp_s,
            truth.position_ned_m,
            velocity,
            body.body_radius_m,
            body.body_half_height_m,
        )
        if contact is not None and contact.label != self._touching:
            self._contacts.append((decision.state, contact))
        self._touching = contact.label if contact is not None else ""
        self._max_speed_m_s = max(self._max_speed_m_s, (velocity[0] ** 2 + velocity[1] ** 2) ** 0.5)
        if decision.state not in (MissionState.TAKEOFF, MissionState.LAND, MissionState.DONE):
            self._navigating.append(decision.now_s)
            self._note_height(decision)
            self._error_m = distance(point, simulation.flyer.goal[:2])

    def _note_height(self, decision: Decision) -> None:
        """When the height of flight was reached first."""
        fused, height_m = decision.fused, decision.height_m
        if self._at_height_s is not None or fused is None or height_m is None:
            return
        if abs(-fused.position_ned_m[2] - height_m) <= _AT_HEIGHT_M:
            self._at_height_s = decision.now_s

    def close(self, command: Command, wall_s: float) -> SimulatedFlight:
        """The finished record."""
        outcome = command.decision.outcome
        if outcome is None:
            raise ValueError("the flight has no outcome yet: close the book at its end")
        airborne_s = self._airborne_from_s
        began_s = self._navigating[0] if self._navigating else 0.0
        ended_s = self._navigating[-1] if self._navigating else 0.0
        at_height_s = began_s if self._at_height_s is None else self._at_height_s
        comfortable_m = self._config.body.radius_m + self._config.planner.comfortable_clearance_m
        return SimulatedFlight(
            outcome=outcome,
            flight_time_s=self._last_s - airborne_s if airborne_s is not None else 0.0,
            navigation_time_s=ended_s - began_s,
            climb_time_s=at_height_s - began_s,
            path_length_m=self._length_m,
            true_clearance_m=self._clearance_m,
            collided=bool(self._contacts),
            stops=command.decision.stops,
            replans=command.decision.replans,
            final_error_m=self._error_m,
            max_speed_m_s=self._max_speed_m_s,
            simulated_s=self._last_s,
            wall_s=wall_s,
            timing=self._planning.record(),
            reckon_path_bound=partial(self._bound.bound, comfortable_m, self._config.guard.fence),
            side_changes=self._sides.count,
            height_changes=self._height_changes,
            track=self.track,
            commands=self.commands,
            contacts=self._contacts,
        )


def with_scenario(config: Config, scenario: Scenario) -> Config:
    """The configuration for flying in a scenario: its fence, and beams that the simulated vehicle
    has. The sensors of this computer, and their calibration, are those of another vehicle.
    """
    guard = config.guard.model_copy(update={"fence": scenario.fence})
    simulated = {
        "half_angle_deg": scenario.beams.half_angle_deg,
        "offset_m": 0.0,
        "sigma_m": 0.0,
    }
    mounts = tuple(mount.model_copy(update=simulated) for mount in config.beams.mounts)
    beams = config.beams.model_copy(update={"mounts": mounts, "drivers": (MavlinkDriver(),)})
    return config.model_copy(update={"guard": guard, "beams": beams})


def goal_of(scenario: Scenario, config: Config) -> Vector3:
    """The scenario's suggested goal at the mission's altitude."""
    return (*scenario.goal_ne_m, -config.mission.altitude_m)
