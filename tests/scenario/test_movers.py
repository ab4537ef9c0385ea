"""Flights among movers; the campaign of tools/movers is the same with hundreds of rooms."""

from functools import cache

import pytest

from autonomy.config import Config
from autonomy.model import Command, Ending, OperatorCommand
from autonomy.simulation import SimulatedFlight, Simulation, goal_of, with_scenario
from hal.sim.scenario import Mover, Scenario, load_scenario
from tools.movers.campaign import NOT_STEERED, configuration
from tools.movers.worlds import world


def fly(scenario: Scenario, config: Config, seed: int = 0) -> SimulatedFlight:
    simulation = Simulation(scenario, config, (goal_of(scenario, config),), seed)
    return simulation.run(keep_commands=True)


@cache
def among(number: int, speed_m_s: float) -> SimulatedFlight:
    scenario = world(number, speed_m_s)
    return fly(scenario, configuration(scenario, "stop"), number)


def said(flight: SimulatedFlight) -> list[str]:
    events = [event for command in flight.commands for event in command.decision.events]
    return [event.why for event in events if event.name == "make_way"]


@pytest.mark.parametrize(("number", "speed_m_s"), [(1, 0.1), (11, 0.2)])
def test_the_goal_is_reached_among_slow_movers_and_nobody_is_touched(
    number: int, speed_m_s: float
) -> None:
    flight = among(number, speed_m_s)
    assert flight.outcome.ending is Ending.GOAL_REACHED
    assert [c for state, c in flight.contacts if state not in NOT_STEERED] == []
    assert not any(command.decision.doubts for command in flight.commands)


def test_it_says_that_it_makes_way_and_for_what() -> None:
    whys = said(among(11, 0.2))
    assert whys
    assert all("for something" in why and "from the" in why for why in whys)


def test_what_moves_is_recorded_with_the_decision() -> None:
    seen = [m for command in among(11, 0.2).commands for m in command.decision.movers]
    assert any(m.moving and 0.05 < m.speed_m_s < 0.4 for m in seen)


def test_the_same_flight_twice_is_the_same_bit_for_bit() -> None:
    again = among.__wrapped__(11, 0.2)
    assert again.commands == among(11, 0.2).commands


def test_where_everything_stands_nothing_changes() -> None:
    scenario = load_scenario("default")
    flights = [
        fly(scenario, with_scenario(Config.model_validate({"movers": {"watch": watch}}), scenario))
        for watch in (True, False)
    ]
    assert flights[0].commands == flights[1].commands


def test_a_held_vehicle_makes_way() -> None:
    """Told to hold on its way, and somebody walks over that place."""
    walker = Mover(path_ne_m=((2.6, 0.05), (-2.6, 0.05)), speed_m_s=0.2, start_s=15.0, then="stay")
    scenario = Scenario(name="held", movers=(walker,), goal_ne_m=(4.0, 0.0))
    document = {"movers": {"expected": True}, "mission": {"time_limit_s": 120.0}}
    config = with_scenario(Config.model_validate(document), scenario)
    simulation = Simulation(scenario, config, (goal_of(scenario, config),), 1)

    def on_tick(flying: Simulation, command: Command) -> None:
        if 14.0 < command.decision.now_s < 14.2:
            flying.pending = [OperatorCommand.HOLD]
        elif 45.0 < command.decision.now_s < 45.2:
            flying.pending = [OperatorCommand.RESUME]

    flight = simulation.run(on_tick=on_tick, keep_commands=True)
    assert said(flight)
    assert flight.outcome.ending is Ending.GOAL_REACHED
    assert not flight.collided
    assert flight.true_clearance_m > 0.16


def test_people_in_a_corridor_are_not_run_into() -> None:
    scenario = load_scenario("corridor_people")
    document = {"movers": {"expected": True}, "mission": {"time_limit_s": 200.0}}
    flight = fly(scenario, with_scenario(Config.model_validate(document), scenario))
    assert not any(contact.moved_into() for _, contact in flight.contacts), flight.contacts
    assert flight.outcome.ending in (Ending.GOAL_REACHED, Ending.BUDGET)
