"""Faults in the air, in process: each ends as the table says, and nothing is ever touched."""

from collections.abc import Callable

import pytest

from autonomy.config import Config
from autonomy.mission.guarded import Command
from autonomy.model import Ending, MissionState, OperatorCommand
from autonomy.simulation import SimulatedFlight, Simulation, goal_of, with_scenario
from hal.frames import add
from hal.setpoints import Reply, Request, RequestKind
from hal.sim.fault_kinds import BeamBlocked, BeamFault, PositionFault
from hal.sim.scenario import Scenario, load_scenario

IN_CRUISE_S = 22.0
"""Simulated time at which every flight of the default room is on its way."""

OnTick = Callable[[Simulation, Command], None]


def nothing(simulation: Simulation, command: Command) -> None:
    """No intervention."""


def fly(
    *faults: BeamFault | BeamBlocked | PositionFault,
    on_tick: OnTick = nothing,
    config: Config | None = None,
    scenario: str = "default",
) -> SimulatedFlight:
    world: Scenario = load_scenario(scenario).model_copy(update={"faults": faults})
    full = with_scenario(config or Config(), world)
    simulation = Simulation(world, full, (goal_of(world, full),))
    flight = simulation.run(on_tick=on_tick, keep_commands=True)
    assert not flight.collided
    return flight


def states(flight: SimulatedFlight) -> list[MissionState]:
    """The states in order, each once while it lasts."""
    order: list[MissionState] = []
    for command in flight.commands:
        if not order or order[-1] is not command.decision.state:
            order.append(command.decision.state)
    return order


def after(flight: SimulatedFlight, state: MissionState) -> MissionState:
    order = states(flight)
    return order[order.index(state) + 1]


def test_a_position_gone_for_a_moment_holds_and_goes_on_as_before() -> None:
    gone = PositionFault(kind="position_silence", start_s=IN_CRUISE_S, duration_s=0.6)
    flight = fly(gone, scenario="empty")
    assert flight.outcome.ending is Ending.GOAL_REACHED, flight.outcome.why
    assert after(flight, MissionState.HOLD) is MissionState.CRUISE


def test_a_position_gone_for_good_lands() -> None:
    flight = fly(PositionFault(kind="position_silence", start_s=IN_CRUISE_S))
    assert flight.outcome.ending is Ending.FAILSAFE
    assert "position" in flight.outcome.why
    assert after(flight, MissionState.HOLD) is MissionState.LAND


@pytest.mark.parametrize("beam", ["front", "left"])
def test_a_beam_silent_for_a_while_stops_and_looks_round_before_it_goes_on(beam: str) -> None:
    silent = BeamFault(kind="beam_silence", beam=beam, start_s=IN_CRUISE_S, duration_s=3.0)
    flight = fly(silent)
    assert flight.outcome.ending is Ending.GOAL_REACHED, flight.outcome.why
    assert after(flight, MissionState.STOP) is MissionState.DETECT
    assert MissionState.HOLD not in states(flight)
    told = [event.why for c in flight.commands for event in c.decision.events]
    assert any(why.startswith(f"beam {beam} is not believed (stale)") for why in told)
    assert any(why.startswith(f"beam {beam} is believed again") for why in told)


@pytest.mark.parametrize("kind", ["beam_silence", "beam_dropout"])
def test_one_beam_lost_for_good_is_covered_for_more_slowly(kind: str) -> None:
    lost = BeamFault.model_validate({"kind": kind, "beam": "back", "start_s": IN_CRUISE_S})
    flight = fly(lost)
    assert flight.outcome.ending is Ending.GOAL_REACHED, flight.outcome.why
    later = [c.decision for c in flight.commands if c.decision.now_s > IN_CRUISE_S + 4.0]
    assert all(d.doubts[0].beam == "back" and d.doubts[0].covered_by == "right" for d in later)
    assert max(decision.speed_limit_m_s for decision in later) <= 0.1


@pytest.mark.parametrize("kind", ["beam_silence", "beam_dropout"])
def test_two_beams_lost_for_good_hold_and_land_and_say_which(kind: str) -> None:
    lost = [
        BeamFault.model_validate({"kind": kind, "beam": beam, "start_s": IN_CRUISE_S + later_s})
        for beam, later_s in (("back", 0.0), ("left", 3.0))
    ]
    flight = fly(*lost)
    assert flight.outcome.ending is Ending.FAILSAFE
    assert "back" in flight.outcome.why
    assert "left" in flight.outcome.why
    assert after(flight, MissionState.HOLD) is MissionState.LAND


def test_a_missing_beam_on_the_ground_never_arms() -> None:
    flight = fly(BeamFault(kind="beam_silence", beam="left", start_s=0.0))
    assert flight.outcome.ending is Ending.PREFLIGHT_REFUSED
    assert "left" in flight.outcome.why
    assert MissionState.ARM not in states(flight)


def test_a_covered_lens_on_the_ground_never_arms() -> None:
    flight = fly(BeamBlocked(kind="beam_blocked", beam="left", start_s=0.0))
    assert flight.outcome.ending is Ending.PREFLIGHT_REFUSED
    assert "left see something inside the vehicle's own body" in flight.outcome.why
    assert MissionState.ARM not in states(flight)


def test_an_empty_battery_lands() -> None:
    def drain(simulation: Simulation, command: Command) -> None:
        if command.decision.now_s > IN_CRUISE_S:
            simulation.vehicle.autopilot.battery_override = 0.1

    flight = fly(on_tick=drain)
    assert flight.outcome.ending is Ending.FAILSAFE
    assert "battery" in flight.outcome.why


def test_the_time_limit_lands() -> None:
    flight = fly(config=Config.model_validate({"mission": {"time_limit_s": 20.0}}))
    assert flight.outcome.ending is Ending.BUDGET


@pytest.mark.parametrize("shift", [(0.6, -0.4, 0.0), (-1.5, 2.0, 0.1)])
def test_a_jump_of_the_autopilots_frame_moves_no_goal_and_no_wall(
    shift: tuple[float, float, float],
) -> None:
    jumped: list[float] = []
    ends: list[tuple[float, float, float]] = []

    def jump(simulation: Simulation, command: Command) -> None:
        if command.decision.now_s > IN_CRUISE_S and not jumped:
            jumped.append(command.decision.now_s)
            simulation.vehicle.jump_estimate(shift)
        ends.append(simulation.vehicle.truth().position_ned_m)

    flight = fly(on_tick=jump)
    assert jumped
    assert flight.outcome.ending is Ending.GOAL_REACHED, flight.outcome.why
    assert flight.final_error_m < 0.3
    missed = add(ends[-1], (-4.0, -3.0, 0.0))
    assert abs(missed[0]) < 0.3
    assert abs(missed[1]) < 0.3


def test_a_link_cut_in_flight_is_told_as_such() -> None:
    def cut(simulation: Simulation, command: Command) -> None:
        if command.decision.now_s > IN_CRUISE_S:
            simulation.vehicle.cut_link()

    flight = fly(on_tick=cut)
    assert flight.outcome.ending is Ending.LINK_LOST


def commanded(*commands: OperatorCommand, gap_s: float = 0.5) -> OnTick:
    """Give the commands one after another, the first in cruise."""
    left = list(commands)
    due_s = [IN_CRUISE_S]

    def give(simulation: Simulation, command: Command) -> None:
        if left and command.decision.now_s > due_s[0]:
            simulation.pending.append(left.pop(0))
            due_s[0] += gap_s

    return give


def held_s(flight: SimulatedFlight) -> float:
    return 0.05 * sum(c.decision.state is MissionState.HOLD for c in flight.commands)


def test_an_operators_stop_holds_and_then_lands() -> None:
    flight = fly(on_tick=commanded(OperatorCommand.STOP))
    assert flight.outcome.ending is Ending.ABORTED
    assert after(flight, MissionState.HOLD) is MissionState.LAND
    assert held_s(flight) > 2.5


def test_a_second_stop_lands_at_once() -> None:
    flight = fly(on_tick=commanded(OperatorCommand.STOP, OperatorCommand.STOP))
    assert flight.outcome.ending is Ending.ABORTED
    assert held_s(flight) < 1.0


def test_an_operators_land_lands_without_holding() -> None:
    flight = fly(on_tick=commanded(OperatorCommand.LAND))
    assert flight.outcome.ending is Ending.ABORTED
    assert MissionState.HOLD not in states(flight)


def test_an_operators_hold_lasts_until_resume_and_the_mission_goes_on() -> None:
    flight = fly(on_tick=commanded(OperatorCommand.HOLD, OperatorCommand.RESUME, gap_s=5.0))
    assert flight.outcome.ending is Ending.GOAL_REACHED, flight.outcome.why
    assert held_s(flight) > 4.5


NO_LANDING = Config.model_validate({"mission": {"land_at_end": False}})


class RefusesHold:
    """Stands before a simulated vehicle and refuses Hold."""

    def __init__(self, simulation: Simulation) -> None:
        self._execute = simulation.vehicle.execute_now
        self._now_s = simulation.clock.now_s

    def __call__(self, request: Request) -> Reply:
        if request.kind is RequestKind.HOLD:
            return Reply(self._now_s(), request.kind, False, "not now")
        return self._execute(request)


def test_a_hold_at_the_end_that_px4_refuses_becomes_a_landing() -> None:
    world = load_scenario("empty")
    full = with_scenario(NO_LANDING, world)
    simulation = Simulation(world, full, (goal_of(world, full),))
    simulation.vehicle.execute_now = RefusesHold(simulation)  # type: ignore[method-assign]
    flight = simulation.run()
    assert flight.outcome.ending is Ending.GOAL_REACHED
    assert simulation.vehicle.truth().on_ground
    assert not simulation.vehicle.truth().armed


def test_a_link_cut_while_landing_is_not_called_a_success() -> None:
    def cut(simulation: Simulation, command: Command) -> None:
        if command.decision.state is MissionState.LAND:
            simulation.vehicle.cut_link()

    flight = fly(on_tick=cut, scenario="empty")
    assert flight.outcome.ending is Ending.LINK_LOST


def test_a_route_changes_its_height_in_place_and_looks_round_again_there() -> None:
    world = load_scenario("empty")
    full = with_scenario(Config(), world)
    flight = Simulation(world, full, ((2.0, 0.0, -1.0), (0.5, 0.5, -1.7)), 1).run(
        keep_commands=True
    )
    assert flight.outcome.ending is Ending.GOAL_REACHED, flight.outcome.why
    second = [c.decision for c in flight.commands if c.decision.events]
    climb_s = next(d.now_s for d in second if "changing height" in d.events[-1].why)
    moving = [
        c.decision
        for c in flight.commands
        if c.decision.now_s > climb_s and c.decision.state is MissionState.CRUISE
    ]
    assert moving[0].fused is not None
    assert abs(moving[0].fused.position_ned_m[2] + 1.7) < 0.25


def test_without_landing_the_mission_ends_in_px4s_hold() -> None:
    flight = fly(config=NO_LANDING, scenario="empty")
    assert flight.outcome.ending is Ending.GOAL_REACHED
    assert flight.commands[-1].decision.fused is not None
    assert flight.commands[-1].decision.fused.position_ned_m[2] < -0.8
