"""Flights with beams as wide as those of a VL53L0X: they go where thin beams lead."""

import pytest

from hal.sim.scenario import Scenario, load_scenario
from tools.bench.wide import fly

HALF_ANGLE_DEG = 12.5


def wide(name: str) -> Scenario:
    scenario = load_scenario(name)
    cone = scenario.beams.model_copy(update={"half_angle_deg": HALF_ANGLE_DEG})
    return scenario.model_copy(update={"beams": cone})


@pytest.mark.parametrize(
    ("name", "mode"), [("default", "stop"), ("door", "rolling"), ("u_trap", "rolling")]
)
def test_wide_beams_reach_the_goal_untouched(name: str, mode: str) -> None:
    flight = fly(wide(name), mode)
    assert flight.ending == "goal_reached"
    assert not flight.collided
    assert flight.clearance_m > 0.16


def test_wide_beams_say_rightly_that_a_goal_cannot_be_reached() -> None:
    flight = fly(wide("sealed"), "rolling")
    assert flight.ending == "unreachable"
    assert not flight.collided
