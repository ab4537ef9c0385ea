"""Before obstacles that are as long to the left as to the right, the vehicle makes up its mind."""

from functools import cache

import pytest

from autonomy.config import Config
from autonomy.model import Ending
from autonomy.simulation import SimulatedFlight, Simulation, goal_of, with_scenario
from hal.config import Fence
from hal.sim.scenario import Scenario, Wall

SEEDS = 6


@cache
def flown(mode: str, seed: int, hysteresis_m: float | None = None) -> SimulatedFlight:
    """A wall dead ahead whose ends are equally far and out of sight, the goal right behind it."""
    scenario = Scenario(
        name="symmetric wall",
        obstacles=(Wall(from_ne_m=(1.5, -1.6), to_ne_m=(1.5, 1.6)),),
        goal_ne_m=(1.95, 0.0),
        fence=Fence.rectangle((-2.0, 6.0), (-4.0, 4.0)),
    )
    replan: dict[str, object] = {"mode": mode}
    if hysteresis_m is not None:
        replan["side_hysteresis_m"] = hysteresis_m
    config = with_scenario(Config.model_validate({"mission": {"replan": replan}}), scenario)
    return Simulation(scenario, config, (goal_of(scenario, config),), seed).run()


@pytest.mark.parametrize("mode", ["stop", "rolling"])
@pytest.mark.parametrize("seed", range(SEEDS))
def test_a_symmetric_wall_is_passed_on_one_side(mode: str, seed: int) -> None:
    flight = flown(mode, seed)
    assert flight.outcome.ending is Ending.GOAL_REACHED
    assert flight.side_changes <= 1
    assert flight.path_bound.holds(flight.path_length_m)


@pytest.mark.parametrize("mode", ["stop", "rolling"])
def test_without_hysteresis_it_goes_to_and_fro_and_flies_farther(mode: str) -> None:
    kept = [flown(mode, seed) for seed in range(SEEDS)]
    free = [flown(mode, seed, 0.0) for seed in range(SEEDS)]
    changes = [sum(flight.side_changes for flight in flights) for flights in (kept, free)]
    assert changes[1] >= SEEDS
    assert changes[0] <= changes[1] // 3
    flown_m = [sum(flight.path_length_m for flight in flights) for flights in (kept, free)]
    assert flown_m[0] < 0.97 * flown_m[1]
