"""Every mission ends, in bounded time, with the goal or with a verdict that the truth supports."""

import math
from functools import cache

import pytest

from autonomy.config import Config
from autonomy.mission.navigation import WAYS_OUT_MAX
from autonomy.model import Ending
from autonomy.simulation import SimulatedFlight, Simulation, goal_of, with_scenario
from tools.bench.rooms import passage_m, room

ROOMS, CLOSED_ROOMS = 24, 6
FLOOR_M = Config().body.radius_m + Config().planner.hard_clearance_m
SENSING_M = 0.02
"""What range and position noise may take from each side of a gap (5 mm + 1 %, and some drift)."""
SAMPLING_M = 0.002
CLIMB_S = 4.0
"""To change height by one storey, come to rest there, and plan at all of them."""

CASES = [
    *((number, False, mode) for number in range(ROOMS) for mode in ("stop", "rolling")),
    *((number, True, mode) for number in range(CLOSED_ROOMS) for mode in ("stop", "rolling")),
]


@cache
def flown(number: int, closed: bool, mode: str) -> SimulatedFlight:
    scenario = room(number, closed=closed)
    config = with_scenario(configured(mode), scenario)
    return Simulation(scenario, config, (goal_of(scenario, config),), number).run()


def configured(mode: str) -> Config:
    return Config.model_validate({"mission": {"replan": {"mode": mode}}})


def budget_s(flight: SimulatedFlight, config: Config) -> float:
    """As long as a mission may take that flew no farther than the bound allows.

    The way at the least speed; a look round at every stop, every rung of the ladder and every way
    out of a pocket, after as long as it takes to notice being stuck; changes of height; and
    climbing, arming and landing.
    """
    replan, guidance = config.mission.replan, config.guidance
    look_s = 100.0 / guidance.yaw_rate_deg_s + 2.0
    rungs = replan.attempts + 2 * WAYS_OUT_MAX
    return (
        flight.path_bound.bound_m / guidance.speed_min_m_s
        + flight.stops * look_s
        + rungs * (look_s + replan.hover_s + 6.0)
        + flight.height_changes * (look_s + CLIMB_S)
        + 30.0
    )


@pytest.mark.parametrize(("number", "closed", "mode"), CASES)
def test_a_mission_in_any_small_room_ends_untouched_in_goal_or_verdict_within_its_budget(
    number: int, closed: bool, mode: str
) -> None:
    flight, config = flown(number, closed, mode), configured(mode)
    assert flight.outcome.ending in (Ending.GOAL_REACHED, Ending.UNREACHABLE), flight.outcome.why
    assert not flight.collided
    assert flight.path_bound.holds(flight.path_length_m), flight.path_bound
    # The first from the start, one for each rung of the ladder and for each new height; and one
    # more each of the two times that all is forgotten, where the search of heights ends for it.
    # Out by the way in, and on from there, where that was flown.
    again = 1 + config.mission.replan.attempts + flight.height_changes + 2 + 2 * WAYS_OUT_MAX
    assert flight.path_bound.stretches <= again
    assert flight.height_changes <= 2 * config.planner.storeys.changes_max
    # A stop is a new hit in the way: nobody stops oftener than every few centimetres.
    assert flight.stops <= flight.path_length_m / 0.1 + config.mission.replan.attempts
    assert flight.simulated_s <= budget_s(flight, config)


@pytest.mark.parametrize("mode", ["stop", "rolling"])
def test_a_verdict_is_wrong_only_where_the_gap_is_at_the_limit_of_sensing(mode: str) -> None:
    config = configured(mode)
    for number in range(ROOMS):
        passage, ending = passage_m(room(number), config), flown(number, False, mode).outcome.ending
        if passage > FLOOR_M + SENSING_M:
            assert ending is Ending.GOAL_REACHED, f"room {number}: a gap of {2 * passage:.3f} m"
        # Nothing wide enough only for the body is flown through: the floor is kept.
        if passage < FLOOR_M - SENSING_M:
            assert ending is Ending.UNREACHABLE, f"room {number}: a gap of {2 * passage:.3f} m"


def test_the_rooms_hold_ways_of_every_kind() -> None:
    passages = [passage_m(room(number), Config()) for number in range(ROOMS)]
    assert sum(passage < FLOOR_M for passage in passages) >= 4
    assert sum(passage > FLOOR_M + SENSING_M for passage in passages) >= 12
    assert any(FLOOR_M < passage < 0.28 for passage in passages)


@pytest.mark.parametrize("number", range(CLOSED_ROOMS))
def test_a_closed_room_has_no_way_and_is_said_to_have_none(number: int) -> None:
    assert passage_m(room(number, closed=True), Config()) < SAMPLING_M
    for mode in ("stop", "rolling"):
        flight = flown(number, True, mode)
        assert flight.outcome.ending is Ending.UNREACHABLE
        assert len(flight.outcome.evidence) > 3


def test_a_room_is_the_same_whenever_it_is_drawn() -> None:
    assert room(3) == room(3)
    assert room(3) != room(4)
    assert room(3) != room(3, seed=1)
    assert math.isclose(passage_m(room(3), Config()), passage_m(room(3), Config()))
