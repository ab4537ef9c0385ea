"""Every rival does on hand-made maps what it is known for."""

import itertools
import math

import numpy as np
import pytest

from autonomy.geometry import distance
from tests.unit.tools.bench.rivals.hand_made import CRAFT, NOTHING, POST, RING, WALL, U, fly
from tools.bench.rivals.roster import RIVALS

ALL = tuple(RIVALS)
GETS_OUT = ("bug2", "tangentbug", "astar", "dstar-lite")
STUCK = ("potential-field", "vfh+", "bendyruler", "dwa")
PROVES = ("bug2", "tangentbug")
SEES_NO_WAY = ("astar", "dstar-lite")
"""Once all of the ring is known."""
BLOCKED_BY_WALLS = ("potential-field", "dwa")
"""Straight across the way, one is a local minimum of theirs."""


@pytest.mark.parametrize("name", ALL)
def test_nothing_in_the_way_is_flown_straight_at_top_speed(name: str) -> None:
    flown = fly(RIVALS[name](CRAFT), NOTHING)
    assert flown.arrived
    assert flown.length_m == pytest.approx(2.9, abs=0.06)
    assert max(abs(point[1]) for point in flown.track) < 0.02
    steps = [distance(a, b) / 0.1 for a, b in itertools.pairwise(flown.track)]
    assert max(steps) <= CRAFT.speed_m_s + 1e-9
    assert sorted(steps)[len(steps) // 2] == pytest.approx(CRAFT.speed_m_s, rel=0.01)


@pytest.mark.parametrize("name", ALL)
def test_what_stands_in_the_way_is_flown_round_without_touching_it(name: str) -> None:
    flown = fly(RIVALS[name](CRAFT), POST if name in BLOCKED_BY_WALLS else WALL)
    assert flown.arrived
    assert flown.least_m > CRAFT.body_m
    assert flown.length_m < 6.5


@pytest.mark.parametrize("name", GETS_OUT)
def test_a_dead_end_is_left_and_the_goal_reached(name: str) -> None:
    flown = fly(RIVALS[name](CRAFT), U)
    assert flown.arrived
    assert flown.least_m > CRAFT.body_m
    assert flown.length_m < 9.0


@pytest.mark.parametrize("name", STUCK)
def test_who_has_no_memory_is_stuck_in_a_dead_end_and_does_not_know(name: str) -> None:
    flown = fly(RIVALS[name](CRAFT), U)
    assert not flown.arrived
    assert flown.gave_up is None
    assert flown.least_m > CRAFT.body_m


@pytest.mark.parametrize("name", PROVES)
def test_a_closed_round_proves_that_there_is_no_way(name: str) -> None:
    flown = fly(RIVALS[name](CRAFT), RING)
    assert flown.gave_up is not None
    assert flown.gave_up.certain
    assert flown.least_m > CRAFT.body_m


@pytest.mark.parametrize("name", SEES_NO_WAY)
def test_a_closed_ring_on_the_grid_is_no_way_but_no_proof(name: str) -> None:
    flown = fly(RIVALS[name](CRAFT), RING)
    assert flown.gave_up is not None
    assert not flown.gave_up.certain


@pytest.mark.parametrize("name", ALL)
def test_the_same_views_give_the_same_flight_bit_for_bit(name: str) -> None:
    assert fly(RIVALS[name](CRAFT), WALL).track == fly(RIVALS[name](CRAFT), WALL).track


@pytest.mark.parametrize("name", ALL)
def test_inside_the_keep_out_there_is_still_a_way_out(name: str) -> None:
    north = WALL[0, 0] - CRAFT.keep_out_m + 0.03
    flown = fly(RIVALS[name](CRAFT), WALL, goal=(0.0, 0.0), start=(float(north), 0.0))
    assert flown.arrived
    assert math.isfinite(flown.length_m)
    assert np.isfinite(flown.track).all()
