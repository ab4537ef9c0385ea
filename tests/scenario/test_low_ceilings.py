"""Flights at an altitude that the ceiling does not leave room for."""

import pytest

from autonomy.config import Config
from autonomy.model import Command, Ending
from autonomy.simulation import Simulation, goal_of, with_scenario
from hal.config import Fence
from hal.sim.scenario import Scenario

ALTITUDE_M = 1.0


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("ceiling_m", [1.1, 1.2])
def test_the_vehicle_stays_off_a_low_ceiling(ceiling_m: float, seed: int) -> None:
    fence = Fence.rectangle((-1.0, 4.0), (-2.0, 2.0))
    scenario = Scenario(name="low", ceiling_m=ceiling_m, goal_ne_m=(2.0, 0.5), fence=fence)
    config = with_scenario(Config.model_validate({"mission": {"altitude_m": ALTITUDE_M}}), scenario)
    gaps_m: list[float] = []

    def note(simulation: Simulation, command: Command) -> None:
        if command.wire_setpoint is not None:
            gaps_m.append(ceiling_m + simulation.vehicle.truth().position_ned_m[2])

    simulation = Simulation(scenario, config, (goal_of(scenario, config),), seed)
    flight = simulation.run(on_tick=note, limit_s=120.0)
    assert flight.outcome.ending is Ending.GOAL_REACHED, flight.outcome.why
    assert not flight.collided
    assert min(gaps_m) > 0.15


def test_a_scenarios_own_body_height_decides_what_a_collision_is() -> None:
    scenario = Scenario.model_validate(
        {
            "name": "tall",
            "ceiling_m": 1.3,
            "goal_ne_m": (1.0, 0.0),
            "fence": {"polygon_ne_m": [(-1.0, -2.0), (-1.0, 2.0), (4.0, 2.0), (4.0, -2.0)]},
            "vehicle": {"body_half_height_m": 0.5},
        }
    )
    config = with_scenario(Config(), scenario)
    assert Simulation(scenario, config, (goal_of(scenario, config),)).run().collided
