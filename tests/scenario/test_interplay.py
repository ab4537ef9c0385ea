"""Doubt, heights, movers and wide beams in one flight: what each leaves to the others is safe."""

from autonomy.config import Config
from autonomy.model import Ending, MissionState
from autonomy.simulation import SimulatedFlight, Simulation, goal_of, with_scenario
from hal.sim.scenario import Scenario, load_scenario, with_faults
from tools.movers.campaign import NOT_STEERED, configuration
from tools.movers.worlds import world

ON_THE_WAY = {MissionState.CRUISE, MissionState.FOLLOW, MissionState.DETECT, MissionState.REPLAN}


def fly(scenario: Scenario, config: Config | None = None, seed: int = 0) -> SimulatedFlight:
    config = config or with_scenario(Config(), scenario)
    simulation = Simulation(scenario, config, (goal_of(scenario, config),), seed)
    return simulation.run(keep_commands=True)


def with_fault(room: str, line: str) -> Scenario:
    return with_faults(load_scenario(room), (line,))


def doubted(flight: SimulatedFlight) -> set[str]:
    return {doubt.beam for command in flight.commands for doubt in command.decision.doubts}


def test_a_beam_down_that_is_doubted_on_the_way_stops_no_level_flight() -> None:
    flight = fly(with_fault("default", "beam_constant@liftoff+6:beam=down,range_m=0.4"))
    assert doubted(flight) == {"down"}
    assert flight.outcome.ending is Ending.GOAL_REACHED
    assert not flight.collided


def test_above_a_wall_with_a_doubted_beam_down_the_vehicle_does_not_descend_on_its_way() -> None:
    flight = fly(with_fault("low_wall", "beam_constant@liftoff+50:beam=down,range_m=0.4"))
    assert doubted(flight) == {"down"}
    decisions = [command.decision for command in flight.commands]
    heights_m = [
        one.height_m for one in decisions if one.doubts and one.state in ON_THE_WAY and one.height_m
    ]
    assert max(heights_m) > 1.2
    assert heights_m == sorted(heights_m)
    assert flight.outcome.ending is Ending.UNREACHABLE
    assert "height" in flight.outcome.why
    assert not flight.collided


def test_wide_beams_track_nothing_and_the_vehicle_touches_nothing_on_its_way() -> None:
    """Nobody knows where on its arc a wide beam's hit is: then nothing is made way for, but a hit
    is an obstacle all the same.
    """
    scenario = world(11, 0.2)
    cone = scenario.beams.model_copy(update={"half_angle_deg": 12.5})
    scenario = scenario.model_copy(update={"beams": cone})
    flight = fly(scenario, configuration(scenario, "stop"), 11)
    assert not any(command.decision.movers for command in flight.commands)
    assert [contact for state, contact in flight.contacts if state not in NOT_STEERED] == []
    assert flight.outcome.ending is Ending.GOAL_REACHED
