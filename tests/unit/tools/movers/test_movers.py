import itertools
import math

import pytest

from hal.config import Fence
from hal.sim.movers import Itinerary
from hal.sim.scenario import Mover, Scenario, Wall
from tools.movers import campaign, worlds
from tools.movers.avoidable import is_avoidable

SPEED_M_S = 0.2


def coming(speed_m_s: float, *walls: Wall) -> Scenario:
    """Somebody walks from 2 m north over the origin."""
    walker = Mover(path_ne_m=((2.0, 0.0), (-2.0, 0.0)), speed_m_s=speed_m_s, then="stay")
    fence = Fence.rectangle((-3.0, 3.0), (-3.0, 3.0))
    return Scenario(name="test", movers=(walker,), obstacles=walls, goal_ne_m=(2, 2), fence=fence)


def hit_s(scenario: Scenario) -> float:
    """When somebody who stays at the origin is touched."""
    return (2.0 - 0.35) / scenario.movers[0].speed_m_s


@pytest.mark.parametrize("speed_m_s", [0.1, 0.3, 0.6])
def test_who_comes_can_be_avoided_when_seen_in_time_and_not_in_the_last_moment(
    speed_m_s: float,
) -> None:
    scenario = coming(speed_m_s)
    touched_s = hit_s(scenario)
    aside_s = 0.35 / SPEED_M_S + 0.6
    assert is_avoidable(scenario, touched_s - aside_s, (0.0, 0.0), touched_s, SPEED_M_S)
    if speed_m_s > SPEED_M_S:
        assert not is_avoidable(scenario, touched_s - 0.3, (0.0, 0.0), touched_s, SPEED_M_S)


def test_between_walls_one_who_is_faster_cannot_be_avoided() -> None:
    walls = tuple(Wall(from_ne_m=(-2.8, e), to_ne_m=(2.8, e)) for e in (-0.3, 0.3))
    scenario = coming(0.6, *walls)
    touched_s = hit_s(scenario)
    assert not is_avoidable(scenario, touched_s - 1.0, (0.0, 0.0), touched_s, SPEED_M_S)
    assert is_avoidable(coming(0.15, *walls), 1.0, (0.0, 0.0), 6.0, SPEED_M_S)


def test_rooms_are_the_same_at_every_speed_and_nobody_walks_through_what_stands() -> None:
    slow, fast = (worlds.world(3, speed) for speed in (0.1, 0.3))
    assert slow.obstacles == fast.obstacles
    assert [m.path_ne_m for m in slow.movers] == [m.path_ne_m for m in fast.movers]
    assert 3 <= len(slow.movers) <= 5
    for mover in fast.movers:
        way = Itinerary(mover, fast.obstacles)
        assert math.hypot(*mover.path_ne_m[0]) >= worlds.BEGIN_FREE_M
        for k in range(200):
            place = way.stretch(0.5 * k).at(0.5 * k)
            gaps = (obstacle.distance_m(*place) for obstacle in fast.obstacles)
            assert min(gaps) > mover.radius_m - 0.03


def test_a_campaign_counts_what_happened() -> None:
    row = campaign.fly(campaign.Case(9, 0.2))
    assert row.ending == "goal_reached"
    assert row.hits == ()
    hit = campaign.Row(
        campaign.Case(1, 0.2), "goal_reached", ((False, True), (True, False)), 1, 3, 50.0, 60, 1
    )
    lines = campaign.table([row, hit]).splitlines()
    assert len(lines) == 3
    assert lines[2].startswith("| 0.2 m/s | 2 | 1 (50.0 %) | 2 | 1 | 1 | 1 | 2 | 0 |")


def test_movers_are_blind_flown_without_looking() -> None:
    scenario = worlds.world(0, 0.2)
    watching, default, blind = (campaign.configuration(scenario, "stop", w) for w in campaign.Look)
    assert watching.movers.expected
    assert not blind.movers.watch
    assert default.movers.watch
    assert not default.movers.expected
    assert not blind.movers.expected
    assert len(set(itertools.chain((watching.guard.fence, blind.guard.fence)))) == 1
