"""Over a low wall, under a curtain, and rightly not at all: every flight judged in space."""

from dataclasses import dataclass, field
from functools import cache

import pytest

from autonomy.config import Config
from autonomy.mission.guarded import GuardedPilot
from autonomy.model import Command, Ending, Inputs, MissionState, Plan
from autonomy.simulation import SimulatedFlight, Simulation, goal_of, with_scenario
from hal.sim.fault_kinds import BeamFault
from hal.sim.scenario import Scenario, load_scenario

MARGIN_M = 0.04
"""What must be left above and below the body, the errors of the estimate taken off."""


@dataclass
class Witness:
    """What only the simulated world knows: how near anything came above and below the body."""

    half_height_m: float = 0.08
    touched_with_margin: bool = False
    heights_m: list[float] = field(default_factory=list)
    said: list[str] = field(default_factory=list)

    def note(self, simulation: Simulation, command: Command) -> None:
        decision, truth = command.decision, simulation.vehicle.truth()
        self.said += [event.why for event in decision.events]
        if decision.state not in (MissionState.CRUISE, MissionState.FOLLOW):
            return
        self.touched_with_margin |= simulation.world.collides(
            truth.position_ned_m, 0.15, self.half_height_m + MARGIN_M
        )
        if decision.height_m is not None and decision.height_m not in self.heights_m[-1:]:
            self.heights_m.append(decision.height_m)


def scenario_with(name: str, **changes: object) -> Scenario:
    return load_scenario(name).model_copy(update=changes)


def config_for(scenario: Scenario, mode: str, use: str = "closed") -> Config:
    keys = {
        "mission": {"replan": {"mode": mode}},
        "planner": {"storeys": {"use": use}},
    }
    return with_scenario(Config.model_validate(keys), scenario)


def fly(
    scenario: Scenario, seed: int, mode: str, use: str = "closed"
) -> tuple[SimulatedFlight, Witness]:
    config, witness = config_for(scenario, mode, use), Witness()
    simulation = Simulation(scenario, config, (goal_of(scenario, config),), seed)
    return simulation.run(on_tick=witness.note), witness


@cache
def flown(name: str, seed: int, mode: str) -> tuple[SimulatedFlight, Witness]:
    return fly(load_scenario(name), seed, mode)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("mode", ["stop", "rolling"])
@pytest.mark.parametrize(("name", "above"), [("low_wall", True), ("curtain", False)])
def test_what_closes_one_height_is_passed_at_another(
    name: str, above: bool, mode: str, seed: int
) -> None:
    flight, witness = flown(name, seed, mode)
    assert flight.outcome.ending is Ending.GOAL_REACHED, flight.outcome.why
    assert not flight.collided
    assert flight.true_clearance_m > 0.15
    assert not witness.touched_with_margin
    # Back at the goal's height at the end, and off it in between.
    assert witness.heights_m[0] == witness.heights_m[-1] == 1.0
    passed_at_m = witness.heights_m[-2]
    assert (passed_at_m > 1.3) if above else (passed_at_m < 0.6)
    which = "over" if above else "under"
    assert any(f"{which} the obstacle at {passed_at_m:.2f} m" in said for said in witness.said)


@pytest.mark.parametrize("mode", ["stop", "rolling"])
def test_a_wall_from_floor_to_ceiling_is_proven_closed_at_every_height(mode: str) -> None:
    flight, witness = flown("divided", 0, mode)
    assert flight.outcome.ending is Ending.UNREACHABLE
    assert not flight.collided
    storeys = "0.34, 0.56, 0.78, 1.00, 1.22, 1.44, 1.66, 1.88 m"
    assert f"at every height: {storeys}" in flight.outcome.why
    assert len(flight.outcome.evidence) > 50
    # Flown along at three heights, of which each closes its neighbours as well.
    assert {1.0, 0.56, 1.66} <= set(witness.heights_m)
    assert flight.simulated_s < 400.0


def test_switched_off_nothing_but_the_goals_height_is_flown_at() -> None:
    flight, witness = fly(load_scenario("low_wall"), 0, "rolling", "never")
    assert flight.outcome.ending is Ending.UNREACHABLE
    assert witness.heights_m == [1.0]
    assert "height" not in flight.outcome.why


@pytest.mark.parametrize("beam", ["up", "down"])
def test_a_dead_beam_forbids_the_heights_that_it_looks_at(beam: str) -> None:
    """With a blind eye above, the wall that can only be flown over is a closed one."""
    fault = BeamFault(kind="beam_dropout", beam=beam, start_s=12.0)
    flight, witness = fly(scenario_with("low_wall", faults=(fault,)), 0, "rolling")
    assert not flight.collided
    if beam == "up":
        assert flight.outcome.ending is Ending.UNREACHABLE
        assert max(witness.heights_m) <= 1.0
        assert "1.22" not in flight.outcome.why
    else:
        # Over it goes; down to the goal's height again it may not.
        assert flight.outcome.ending is Ending.UNREACHABLE
        assert min(witness.heights_m) >= 1.0
        assert max(witness.heights_m) > 1.3
        assert "the way to the goal's height" in flight.outcome.why


def test_a_shorter_way_over_is_taken_where_cheapest_is_wanted() -> None:
    """Round the open end of the wall is possible, and much longer."""
    longer = scenario_with("low_wall", obstacles=load_scenario("low_wall").obstacles)
    walls = [o for o in longer.obstacles if o.label != "low partition"]
    low = next(o for o in longer.obstacles if o.label == "low partition")
    shortened = low.model_copy(update={"from_ne_m": (2.3, -0.7)})
    scenario = scenario_with("low_wall", obstacles=(*walls, shortened))
    closed, stays = fly(scenario, 1, "rolling", "closed")
    cheapest, climbs = fly(scenario, 1, "rolling", "cheapest")
    for flight in (closed, cheapest):
        assert flight.outcome.ending is Ending.GOAL_REACHED
        assert not flight.collided
    assert stays.heights_m == [1.0]
    assert climbs.heights_m[0] == climbs.heights_m[-1] == 1.0


class Recorded(Simulation):
    """A simulation that keeps what its pilot was told."""

    told: tuple[Inputs, ...] = ()

    def inputs(self) -> Inputs:
        """As ever, and kept."""
        made = super().inputs()
        self.told = (*self.told, made)
        return made


def test_a_flight_over_a_wall_replays_bit_for_bit() -> None:
    scenario = load_scenario("low_wall")
    config = config_for(scenario, "rolling")
    route = (goal_of(scenario, config),)
    simulation = Recorded(scenario, config, route, 3)
    commands = simulation.run(keep_commands=True).commands
    again = GuardedPilot(config, route)
    assert [again.step(inputs) for inputs in simulation.told] == commands
    plans = [c.decision.plan for c in commands if isinstance(c.decision.plan, Plan)]
    assert len({plan.height_m for plan in plans}) > 1
