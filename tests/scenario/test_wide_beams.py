"""Flights with beams as wide as those of a VL53L0X: they go where thin beams lead."""

import pytest

from autonomy.simulation import SimulatedFlight, Simulation, goal_of
from hal.sim.scenario import load_scenario
from tools.bench.rooms import shipped_config

HALF_ANGLE_DEG = 12.5


def fly(name: str, mode: str) -> SimulatedFlight:
    scenario = load_scenario(name)
    cone = scenario.beams.model_copy(update={"half_angle_deg": HALF_ANGLE_DEG})
    scenario = scenario.model_copy(update={"beams": cone})
    config = shipped_config(scenario, mode)
    return Simulation(scenario, config, (goal_of(scenario, config),)).run()


@pytest.mark.parametrize(
    ("name", "mode"), [("default", "stop"), ("door", "rolling"), ("u_trap", "rolling")]
)
def test_wide_beams_reach_the_goal_untouched(name: str, mode: str) -> None:
    flight = fly(name, mode)
    assert flight.outcome.ending.value == "goal_reached"
    assert not flight.collided
    assert flight.true_clearance_m > 0.16


def test_wide_beams_say_rightly_that_a_goal_cannot_be_reached() -> None:
    flight = fly("sealed", "rolling")
    assert flight.outcome.ending.value == "unreachable"
    assert not flight.collided
