"""Every rival does on hand-made maps what it is known for."""

import math

import pytest

from autonomy.geometry import distance
from tests.unit.tools.bench.rivals.hand_made import CRAFT, NOTHING, POST, WALL, U, fly
from tools.bench.rivals.roster import RIVALS

ALL = tuple(RIVALS)
STUCK_IN_A_U = ("potential-field",)


@pytest.mark.parametrize("name", ALL)
def test_nothing_in_the_way_is_flown_straight_at_top_speed(name: str) -> None:
    flown = fly(RIVALS[name](CRAFT), NOTHING)
    assert flown.arrived
    assert flown.length_m == pytest.approx(2.9, abs=0.06)
    assert max(abs(point[1]) for point in flown.track) < 0.02
    steps = [distance(a, b) / 0.1 for a, b in zip(flown.track, flown.track[1:], strict=False)]
    assert max(steps) <= CRAFT.speed_m_s + 1e-9
    assert sorted(steps)[len(steps) // 2] == pytest.approx(CRAFT.speed_m_s, rel=0.01)


@pytest.mark.parametrize("name", ALL)
def test_what_stands_in_the_way_is_flown_round_without_touching_it(name: str) -> None:
    flown = fly(RIVALS[name](CRAFT), POST if name == "potential-field" else WALL)
    assert flown.arrived
    assert flown.least_m > CRAFT.body_m
    assert flown.length_m < 6.5


@pytest.mark.parametrize("name", STUCK_IN_A_U)
def test_who_has_no_memory_is_stuck_in_a_dead_end_and_does_not_know(name: str) -> None:
    flown = fly(RIVALS[name](CRAFT), U)
    assert not flown.arrived
    assert flown.gave_up is None
    assert distance(flown.track[-1], flown.track[-50]) < 0.3
    assert flown.least_m > CRAFT.body_m


@pytest.mark.parametrize("name", ALL)
def test_the_same_views_give_the_same_flight_bit_for_bit(name: str) -> None:
    assert fly(RIVALS[name](CRAFT), WALL).track == fly(RIVALS[name](CRAFT), WALL).track


@pytest.mark.parametrize("name", ALL)
def test_inside_the_keep_out_there_is_still_a_way_out(name: str) -> None:
    north = WALL[0, 0] - CRAFT.keep_out_m + 0.03
    flown = fly(RIVALS[name](CRAFT), WALL, goal=(0.0, 0.0), start=(float(north), 0.0))
    assert flown.arrived
    assert math.isfinite(flown.length_m)
