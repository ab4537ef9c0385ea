"""Whole missions on a simulated clock: every shipped scenario over twenty seeds."""

from functools import cache

import pytest

from autonomy.config import Config
from autonomy.model import Ending, LegKind, MissionState, Plan
from autonomy.simulation import SimulatedFlight, Simulation, goal_of, with_scenario
from hal.sim.scenario import load_scenario, shipped_scenarios

SEEDS = 20


@cache
def flown(name: str, seed: int, mode: str = "stop") -> SimulatedFlight:
    scenario = load_scenario(name)
    config = with_scenario(Config.model_validate({"mission": {"replan": {"mode": mode}}}), scenario)
    simulation = Simulation(scenario, config, (goal_of(scenario, config),), seed)
    return simulation.run(keep_commands=seed == 0)


@pytest.mark.parametrize("seed", range(SEEDS))
@pytest.mark.parametrize("name", shipped_scenarios())
def test_every_flight_reaches_the_goal_untouched_or_says_rightly_that_it_cannot(
    name: str, seed: int
) -> None:
    flight = flown(name, seed)
    assert not flight.collided
    assert flight.true_clearance_m > 0.15
    if load_scenario(name).reachable:
        assert flight.outcome.ending is Ending.GOAL_REACHED, flight.outcome.why
        assert flight.final_error_m < 0.3
    else:
        assert flight.outcome.ending is Ending.UNREACHABLE, flight.outcome.why
        assert len(flight.outcome.evidence) > 3


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("name", [n for n in shipped_scenarios() if load_scenario(n).reachable])
def test_rolling_replans_without_stopping(name: str, seed: int) -> None:
    flight = flown(name, seed, "rolling")
    assert not flight.collided
    assert flight.outcome.ending is Ending.GOAL_REACHED, flight.outcome.why
    assert flight.stops == 0


def test_the_default_room_needs_spheres_and_a_hyperbola_in_one_flight() -> None:
    kinds = {
        leg.kind
        for command in flown("default", 0).commands
        if isinstance(command.decision.plan, Plan)
        for leg in command.decision.plan.legs
    }
    assert {LegKind.ARC, LegKind.HYPERBOLA} <= kinds


def test_the_empty_room_needs_no_stop() -> None:
    flight = flown("empty", 0)
    assert flight.stops == 0
    assert flight.path_length_m < 5.6


def test_the_speed_limit_of_the_paper_is_kept() -> None:
    assert flown("default", 0).max_speed_m_s < Config().guard.speed_max_m_s + 0.05


def test_the_same_seed_flies_the_same_flight_and_another_seed_another() -> None:
    first = flown("default", 0)
    scenario = load_scenario("default")
    config = with_scenario(Config(), scenario)
    again = Simulation(scenario, config, (goal_of(scenario, config),), 0).run()
    assert again.track == first.track
    assert flown("default", 1).track != first.track


def test_every_setpoint_of_a_flight_passed_the_guard() -> None:
    flying = [c for c in flown("default", 0).commands if c.decision.setpoint is not None]
    assert len(flying) > 100
    assert all(command.wire_setpoint is not None for command in flying)


def test_the_states_of_algorithm_2_are_all_flown_through() -> None:
    states = {command.decision.state for command in flown("default", 0).commands}
    elsewhere = {MissionState.PREFLIGHT, MissionState.HOLD, MissionState.YIELDED}
    assert states >= set(MissionState) - elsewhere
