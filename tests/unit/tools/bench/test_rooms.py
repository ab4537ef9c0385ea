"""The truth about random rooms is exact, and the flights' table tells what was flown."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from autonomy.config import Config
from hal.config import Fence
from hal.sim.scenario import Scenario, Wall
from tools.bench.flights import CLOSED_ROOMS, OPEN_ROOMS, Row, scenario_of, table, verdicts
from tools.bench.rooms import END_FREE_M, passage_m, room


def with_door(width_m: float, thickness_m: float = 0.06) -> Scenario:
    """A wall from fence to fence with a door off the straight line."""
    return Scenario(
        name="door",
        obstacles=(
            Wall(from_ne_m=(1.0, -2.0), to_ne_m=(1.0, 0.7), thickness_m=thickness_m),
            Wall(from_ne_m=(1.0, 0.7 + width_m), to_ne_m=(1.0, 2.0), thickness_m=thickness_m),
        ),
        goal_ne_m=(2.0, 0.0),
        fence=Fence.rectangle((-1.0, 3.0), (-1.5, 1.9)),
    )


@settings(deadline=None, max_examples=15)
@given(st.floats(0.2, 0.6))
def test_a_door_lets_half_its_width_pass(width_m: float) -> None:
    assert passage_m(with_door(width_m), Config()) == pytest.approx(0.5 * width_m, abs=1e-3)


def test_a_wall_without_a_door_lets_nothing_pass_and_an_open_room_everything() -> None:
    assert passage_m(room(0, closed=True), Config()) < 1e-2
    assert passage_m(Scenario(name="empty"), Config()) == END_FREE_M


def test_a_fence_that_is_not_convex_is_refused() -> None:
    bent = Fence(polygon_ne_m=((-1, -2), (3, -2), (3, 2), (1, 0.5), (-1, 2)))
    with pytest.raises(ValueError, match="not convex"):
        passage_m(with_door(0.5).model_copy(update={"fence": bent}), Config())


def test_rooms_have_names_by_which_they_are_flown() -> None:
    assert scenario_of(OPEN_ROOMS, 7) == room(7)
    assert scenario_of(CLOSED_ROOMS, 7) == room(7, closed=True)
    assert scenario_of("door", 7).name == "door"


def row(scenario: str, seed: int, ending: str, used: float, changes: int) -> Row:
    return Row(
        scenario=scenario,
        seed=seed,
        ending=ending,
        collided=False,
        clearance_m=0.2,
        length_m=10.0 * used,
        bound_m=10.0,
        side_changes=changes,
        navigation_s=50.0,
        stops=3,
        replans=5,
        error_m=0.1,
        simulated_s=60.0,
        wall_s=0.5,
        planning_s=(0.001,),
    )


def test_the_table_tells_how_much_of_the_bound_was_used_and_how_often_sides_changed() -> None:
    rows = [
        row("door", seed, "goal_reached", used, seed)
        for seed, used in ((0, 0.5), (1, 0.7), (3, 0.9))
    ]
    told = table(rows).splitlines()
    assert len({line.count("|") for line in told}) == 1
    assert "| 0.70/0.90 | 1.3/3 |" in told[-1]


def test_a_verdict_counts_as_wrong_where_the_truth_has_a_way() -> None:
    passages = {number: passage_m(room(number), Config()) for number in range(6)}
    wide = next(number for number, passage in passages.items() if passage > 0.23)
    shut = next(number for number, passage in passages.items() if passage < 0.2)
    rows = [
        row(OPEN_ROOMS, wide, "unreachable", 0.5, 0),
        row(OPEN_ROOMS, shut, "unreachable", 0.5, 0),
    ]
    told = verdicts(rows)
    assert "1 of 2 have a way" in told
    assert "said in 2, wrongly in 1" in told
    assert f"{2.0 * passages[wide]:.3f} m" in told
