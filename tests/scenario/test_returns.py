"""Back along what was flown: where to, when, and what happens on the way."""

from collections.abc import Mapping

import pytest

from autonomy.config import Config
from autonomy.geometry import distance
from autonomy.model import Command, Ending, MissionState
from autonomy.simulation import SimulatedFlight, Simulation, goal_of, with_scenario
from hal.sim.scenario import load_scenario, with_faults

Changes = Mapping[str, Mapping[str, object]]
BUDGET: dict[str, dict[str, object]] = {"failsafe": {"budget": "return"}}


class Flown:
    """A flight, what was said in it, and where its vehicle ended."""

    def __init__(
        self, world: str, changes: Changes, *faults: str, falls: float | None = None
    ) -> None:
        scenario = with_faults(load_scenario(world), faults)
        config = with_scenario(Config.model_validate(changes), scenario)
        self.simulation = Simulation(scenario, config, (goal_of(scenario, config),))
        self.said: list[tuple[float, str, str]] = []
        self.falls_per_s = falls
        self.flight: SimulatedFlight = self.simulation.run(on_tick=self._watch, keep_commands=True)
        assert not self.flight.collided
        north, east, _ = self.simulation.vehicle.truth().position_ned_m
        self.end = (north, east)
        assert self.simulation.vehicle.truth().on_ground

    def _watch(self, simulation: Simulation, command: Command) -> None:
        if self.falls_per_s is not None:
            left = 0.3 - self.falls_per_s * command.decision.now_s
            simulation.vehicle.autopilot.battery_override = left
        self.said += [(e.stamp_s, e.name, e.why) for e in command.decision.events]

    @property
    def states(self) -> set[MissionState]:
        return {command.decision.state for command in self.flight.commands}


def test_a_used_up_way_leads_back_to_where_the_flight_began() -> None:
    flown = Flown("default", BUDGET | {"mission": {"path_limit_m": 4.0}})
    assert flown.flight.outcome.ending is Ending.BUDGET
    assert "4 m of way" in flown.flight.outcome.why
    assert distance(flown.end, (0.0, 0.0)) < 0.3
    assert MissionState.RETURN in flown.states


def test_without_that_choice_the_same_lands_where_it_is() -> None:
    flown = Flown("default", {"mission": {"path_limit_m": 4.0}})
    assert flown.flight.outcome.ending is Ending.BUDGET
    assert distance(flown.end, (0.0, 0.0)) > 2.0
    assert MissionState.RETURN not in flown.states


def test_the_last_open_place_is_nearer() -> None:
    there: dict[str, dict[str, object]] = {"failsafe": {"budget": "return", "return_to": "open"}}
    flown = Flown("default", there | {"mission": {"path_limit_m": 4.0}})
    assert any("open place" in why for _, _, why in flown.said)
    assert distance(flown.end, (0.0, 0.0)) > 1.0


def test_a_low_battery_with_time_left_returns() -> None:
    flown = Flown("empty", {"failsafe": {"battery_land": 0.05}}, falls=0.0035)
    assert flown.flight.outcome.ending is Ending.FAILSAFE
    assert "battery" in flown.flight.outcome.why
    assert distance(flown.end, (0.0, 0.0)) < 0.3


def test_a_battery_that_falls_too_fast_for_the_way_back_lands_at_once() -> None:
    flown = Flown("empty", {}, falls=0.0035)
    assert flown.flight.outcome.ending is Ending.FAILSAFE
    assert MissionState.RETURN not in flown.states
    assert distance(flown.end, (0.0, 0.0)) > 0.8


def test_a_goal_that_cannot_be_reached_leads_back_over_every_height_flown() -> None:
    flown = Flown("divided", {"failsafe": {"unreachable": "return"}})
    assert flown.flight.outcome.ending is Ending.UNREACHABLE
    assert flown.flight.outcome.evidence
    assert distance(flown.end, (0.0, 0.0)) < 0.3


def test_a_verdict_in_a_narrow_place_is_landed_with_at_the_last_open_one() -> None:
    one_height = {"planner": {"storeys": {"use": "never"}}}
    flown = Flown("sealed", one_height | {"mission": {"replan": {"mode": "rolling"}}})
    assert flown.flight.outcome.ending is Ending.UNREACHABLE
    assert MissionState.RETURN in flown.states
    assert any("open place" in why for _, _, why in flown.said)
    end = flown.simulation.vehicle.truth().position_ned_m
    assert flown.simulation.world.clearance_m(end) > 0.3
    assert distance(flown.end, (0.0, 0.0)) > 1.0


def test_a_vehicle_that_lost_two_beams_lands_where_the_others_show_it_no_way() -> None:
    lost = {"failsafe": {"sensor_loss": "return"}}
    faults = [f"beam_silence@liftoff+25:beam={beam}" for beam in ("front", "left")]
    flown = Flown("default", lost, *faults)
    assert "too few range beams are left" in flown.flight.outcome.why
    assert MissionState.RETURN in flown.states
    assert flown.said[-2][2] == "there is no way back: landing"


def test_a_position_lost_for_a_moment_on_the_way_back_holds_and_goes_on() -> None:
    flown = Flown(
        "default",
        BUDGET | {"mission": {"path_limit_m": 4.0}},
        "position_silence@liftoff+48/0.8",
    )
    back_s = next(s for s, name, _ in flown.said if name == "return")
    held = [why for s, name, why in flown.said if name == "hold" and s > back_s]
    assert any("no usable position" in why for why in held), flown.said
    assert distance(flown.end, (0.0, 0.0)) < 0.3


def test_a_jump_of_the_frame_leaves_the_way_back_where_it_was() -> None:
    flown = Flown(
        "default",
        BUDGET | {"mission": {"path_limit_m": 4.0}},
        "ekf_reset@liftoff+30:north_m=0.7,east_m=-0.5",
    )
    assert distance(flown.end, (0.0, 0.0)) < 0.35


def test_a_way_back_that_takes_too_long_lands() -> None:
    flown = Flown(
        "default",
        {
            "failsafe": {"budget": "return", "return_timeout_s": 5.0},
            "mission": {"path_limit_m": 4.0},
        },
    )
    assert any("took too long" in why for _, _, why in flown.said)
    assert distance(flown.end, (0.0, 0.0)) > 1.0


@pytest.mark.parametrize("off_s", [0.6, 1.2])
def test_a_position_that_comes_and_goes_ends_in_a_landing(off_s: float) -> None:
    gaps = [f"position_silence@liftoff+{at}/{off_s}" for at in range(8, 60, 3)]
    flown = Flown("empty", {}, *gaps)
    assert flown.flight.outcome.ending is Ending.FAILSAFE
    assert "10 times within 60 s" in flown.flight.outcome.why
