"""Whoever takes the vehicle has it: the service never fights for it, in no state."""

from collections.abc import Callable

import pytest

from autonomy.config import Config
from autonomy.mission.guarded import Command
from autonomy.model import Ending, MissionState
from autonomy.simulation import SimulatedFlight, Simulation, goal_of, with_scenario
from hal.readings import FlightMode
from hal.setpoints import RequestKind
from hal.sim.px4 import Landed, Mode
from hal.sim.scenario import load_scenario

Watch = Callable[[Simulation, Command], None]

A_HEARTBEAT_S = 1.1
"""PX4 tells that it was disarmed at its next heartbeat."""


def fly(on_tick: Watch) -> SimulatedFlight:
    scenario = load_scenario("empty")
    config = with_scenario(Config(), scenario)
    simulation = Simulation(scenario, config, (goal_of(scenario, config),))
    return simulation.run(on_tick=on_tick, keep_commands=True)


def taken(state: MissionState, seen: FlightMode, to: Mode) -> Watch:
    """Switches the mode to `to` once, in `state`, as soon as `seen` is flown off the ground."""
    done = False

    def watch(simulation: Simulation, command: Command) -> None:
        nonlocal done
        autopilot = simulation.vehicle.autopilot
        flown = autopilot.mode.flight_mode is seen and autopilot.landed is not Landed.ON_GROUND
        if not done and flown and command.decision.state is state:
            autopilot.set_mode(to.main, to.sub)
            done = True

    return watch


@pytest.mark.parametrize(
    ("state", "seen", "to"),
    [
        (MissionState.TAKEOFF, FlightMode.TAKEOFF, Mode.LAND),
        (MissionState.TAKEOFF, FlightMode.TAKEOFF, Mode.RETURN),
        (MissionState.CRUISE, FlightMode.OFFBOARD, Mode.HOLD),
        (MissionState.DETECT, FlightMode.OFFBOARD, Mode.LAND),
        (MissionState.LAND, FlightMode.LAND, Mode.HOLD),
    ],
)
def test_after_a_switch_of_mode_nothing_more_is_sent_or_asked(
    state: MissionState, seen: FlightMode, to: Mode
) -> None:
    flight = fly(taken(state, seen, to))
    assert flight.outcome.ending is Ending.TAKEN_OVER, flight.outcome.why
    assert to.flight_mode.value in flight.outcome.why
    states = [command.decision.state for command in flight.commands]
    assert state in states
    after = flight.commands[states.index(MissionState.DONE) :]
    assert after
    for command in after:
        assert command.wire_setpoint is None
        assert command.decision.requests == ()
    asked = [r.kind for command in flight.commands for r in command.decision.requests]
    assert RequestKind.DISARM not in asked
    assert asked.count(RequestKind.LAND) == (state is MissionState.LAND)


@pytest.mark.parametrize(
    ("state", "seen"),
    [
        (MissionState.TAKEOFF, FlightMode.TAKEOFF),
        (MissionState.DETECT, FlightMode.OFFBOARD),
        (MissionState.CRUISE, FlightMode.OFFBOARD),
    ],
)
def test_a_vehicle_whose_motors_were_cut_in_the_air_is_let_go_of_at_once(
    state: MissionState, seen: FlightMode
) -> None:
    cut_s: list[float] = []

    def watch(simulation: Simulation, command: Command) -> None:
        autopilot = simulation.vehicle.autopilot
        flown = autopilot.mode.flight_mode is seen and autopilot.landed is not Landed.ON_GROUND
        if not cut_s and flown and command.decision.state is state:
            autopilot.disarm(force=True)
            cut_s.append(command.decision.now_s)

    flight = fly(watch)
    assert flight.outcome.ending is Ending.TAKEN_OVER, flight.outcome.why
    assert "disarmed" in flight.outcome.why
    late = [c for c in flight.commands if c.decision.now_s > cut_s[0] + A_HEARTBEAT_S]
    assert all(c.wire_setpoint is None and not c.decision.requests for c in late)


def test_an_undisturbed_flight_is_nobody_else_s() -> None:
    assert fly(lambda *_: None).outcome.ending is Ending.GOAL_REACHED
