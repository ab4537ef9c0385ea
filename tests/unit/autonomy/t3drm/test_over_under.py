"""Storeys, what they cost, and the search for the cheapest."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from autonomy.config import Config, GuidanceConfig, PlannerConfig, StoreysConfig
from autonomy.geometry import Point
from autonomy.model import NoPlan, Plan
from autonomy.t3drm.over_under import PACE, Price, Question, Search, Storeys, Way
from autonomy.t3drm.planner import Planner
from hal.config import Fence

Floats = NDArray[np.float64]
NOTHING = np.empty((0, 2))
START: Point = (0.0, 0.0)
GOAL: Point = (4.0, 0.0)
PLANNER = Planner(PlannerConfig(), 0.15, Fence.rectangle((-1.0, 5.0), (-1.5, 1.5)))
ROOM = Storeys(1.0, 0.22, 0.3, 2.0)
PRICE = Price(climb_m=0.4, change_m=0.3)

heights = st.floats(0.2, 2.5, allow_nan=False)


def wall(east_from: float, east_to: float, north: float = 2.0) -> Floats:
    easts = np.arange(east_from, east_to, 0.04)
    return np.stack((np.full(len(easts), north), easts), axis=1)


CLOSED = wall(-1.6, 1.6)
HALF = wall(-0.8, 1.6)  # open on the west side
SHORT = wall(-0.4, 0.4)


def question(
    present_m: float = 1.0, gain_m: float = 0.5, looked: tuple[float, ...] = ()
) -> Question:
    return Question(START, GOAL, 0.09, present_m, ROOM, PRICE, gain_m, looked)


def nothing_at(_: float) -> Floats:
    return NOTHING


def plan_at(hits: Floats) -> Plan | NoPlan:
    return PLANNER.plan(START, GOAL, hits, 0.09)


def searched(
    hits_by_height: dict[float, Floats], *, thorough: bool = False, asked: Question | None = None
) -> tuple[Way | NoPlan, int]:
    """The answer, and how many steps it took."""
    asked = asked or question()
    here = plan_at(hits_by_height[asked.present_m])
    search = Search(PLANNER, asked, here, hits_by_height.__getitem__, thorough=thorough)
    search.look_at(h for h in hits_by_height if h != asked.present_m)
    for steps in itertools.count():
        if search.decided:
            return search.result(), steps
        search.step()
    raise AssertionError


@given(goal=heights, spacing=st.floats(0.1, 1.0), low=heights, high=heights)
@settings(deadline=None, max_examples=200)
def test_storeys_are_whole_spacings_from_the_goal_and_inside_the_band(
    goal: float, spacing: float, low: float, high: float
) -> None:
    low, high = min(low, goal), max(high, goal)
    found = Storeys(goal, spacing, low, high).heights_m()
    assert found == tuple(sorted(found))
    assert min(abs(h - goal) for h in found) < 1e-5
    for h in found:
        assert low - 1e-5 <= h <= high + 1e-5
        assert abs((h - goal) / spacing - round((h - goal) / spacing)) < 1e-4
    # No further one would fit.
    assert found[0] - spacing < low
    assert found[-1] + spacing > high


@given(data=st.data())
@settings(deadline=None, max_examples=200)
def test_the_vehicle_looks_round_on_the_way_out_and_not_on_the_way_home(
    data: st.DataObject,
) -> None:
    every = ROOM.heights_m()
    present, wanted = data.draw(st.sampled_from(every)), data.draw(st.sampled_from(every))
    looked = tuple(data.draw(st.sets(st.sampled_from(every))))
    stops = ROOM.stops_m(present, wanted, looked)
    if present == wanted:
        assert stops == ()
        return
    assert stops[-1] == wanted
    assert list(stops) == sorted(stops, reverse=wanted < present)
    low, high = sorted((present, wanted))
    home = (wanted - 1.0) * (present - 1.0) >= 0.0 and abs(wanted - 1.0) <= abs(present - 1.0)
    between = {h for h in every if low < h < high} - set(looked)
    assert set(stops[:-1]) == (set() if home else between)


def test_staying_at_the_goals_height_costs_nothing_and_everything_else_its_climbs() -> None:
    assert PRICE.of_way(ROOM, 1.0, 1.0) == 0.0
    # Two storeys up, looking round at each, and down again in one go.
    assert PRICE.of_way(ROOM, 1.0, 1.44) == pytest.approx(2 * 0.44 * 0.4 + 3 * 0.3)
    assert PRICE.of_way(ROOM, 1.0, 1.44, (1.22,)) == pytest.approx(2 * 0.44 * 0.4 + 2 * 0.3)
    assert PRICE.of_way(ROOM, 1.44, 1.0) == PRICE.of_way(ROOM, 1.44, 1.44)


def test_the_price_is_time_at_the_pace_of_a_flight() -> None:
    storeys, guidance = StoreysConfig(climb_m_s=0.3, change_s=2.0), GuidanceConfig()
    price = Price.of(storeys, guidance)
    pace_m_s = PACE * guidance.speed_max_m_s
    assert price.climb_m == pytest.approx(pace_m_s / 0.3)
    assert price.change_m == pytest.approx(2.0 * pace_m_s)


def test_a_low_wall_is_flown_over_and_a_curtain_under() -> None:
    low_wall = dict.fromkeys(ROOM.heights_m(), CLOSED) | {1.66: NOTHING, 1.88: NOTHING}
    over, _ = searched(low_wall)
    assert isinstance(over, Way)
    assert over.height_m == over.plan.height_m == 1.66
    curtain = dict.fromkeys(ROOM.heights_m(), CLOSED) | {0.34: NOTHING}
    under, _ = searched(curtain)
    assert isinstance(under, Way)
    assert under.height_m == 0.34


def test_of_two_ways_that_cost_the_same_the_upper_one_is_taken() -> None:
    found, _ = searched({0.78: NOTHING, 1.0: CLOSED, 1.22: NOTHING})
    assert isinstance(found, Way)
    assert found.height_m == 1.22


def test_closed_at_every_height_names_the_heights_and_the_evidence_at_the_goals() -> None:
    found, steps = searched(dict.fromkeys(ROOM.heights_m(), CLOSED))
    assert isinstance(found, NoPlan)
    assert found.reason.endswith("0.34, 0.56, 0.78, 1.00, 1.22, 1.44, 1.66, 1.88 m")
    assert len(found.evidence) > 3
    assert steps == len(ROOM.heights_m()) - 1


def test_alone_the_present_height_is_decided_at_once_and_told_as_it_is() -> None:
    found, steps = searched({1.0: CLOSED})
    told = plan_at(CLOSED)
    assert found == told
    assert steps == 0


@given(
    hits=st.lists(st.sampled_from([NOTHING, SHORT, HALF, CLOSED]), min_size=8, max_size=8),
    present=st.integers(0, 7),
    gain=st.sampled_from([0.0, 0.5]),
)
@settings(deadline=None, max_examples=60)
def test_the_cheapest_storey_wins_and_the_present_one_keeps_its_advantage(
    hits: list[Floats], present: int, gain: float
) -> None:
    every = ROOM.heights_m()
    asked = question(every[present], gain)
    found, steps = searched(dict(zip(every, hits, strict=True)), asked=asked)
    assert steps <= 7
    bids = {}
    for height, known in zip(every, hits, strict=True):
        planned = plan_at(known)
        if isinstance(planned, Plan):
            cost = planned.length_m + PRICE.of_way(ROOM, asked.present_m, height)
            bids[height] = cost - (gain if height == asked.present_m else 0.0)
    if not bids:
        assert isinstance(found, NoPlan)
        return
    assert isinstance(found, Way)
    assert bids[found.height_m] == pytest.approx(min(bids.values()))
    advantage = gain if found.height_m == asked.present_m else 0.0
    assert found.cost_m - advantage == pytest.approx(min(bids.values()))


@pytest.mark.parametrize(("gain_m", "height_m"), [(0.0, 1.22), (0.2, 1.22), (2.0, 1.0)])
def test_another_storey_must_save_more_than_the_gain(gain_m: float, height_m: float) -> None:
    asked = Question(START, GOAL, 0.09, 1.0, ROOM, Price(0.01, 0.01), gain_m)
    found, _ = searched({1.0: HALF, 1.22: NOTHING}, asked=asked)
    assert isinstance(found, Way)
    assert found.height_m == height_m


def test_a_short_way_here_needs_no_look_at_other_heights() -> None:
    near = Search(PLANNER, question(), plan_at(SHORT), nothing_at)
    assert near.would_stay
    far = Search(PLANNER, question(gain_m=0.0), plan_at(HALF), nothing_at)
    closed = Search(PLANNER, question(), plan_at(CLOSED), nothing_at)
    assert not closed.would_stay
    proof = Search(PLANNER, question(), plan_at(SHORT), nothing_at, thorough=True)
    assert not proof.would_stay
    found, _ = searched({1.0: HALF, 1.22: NOTHING}, asked=question(gain_m=0.0))
    assert isinstance(found, Way)
    # The bound may be careful, never wrong: where another one wins it must not say "stay".
    assert found.height_m == 1.0 or not far.would_stay


def test_a_thorough_search_goes_where_most_open_storeys_are_seen() -> None:
    """One flight at 1.66 m shows what closes 1.44 and 1.88 m too."""
    open_above = dict.fromkeys(ROOM.heights_m(), CLOSED) | dict.fromkeys((1.44, 1.66, 1.88), HALF)
    cheapest, _ = searched(open_above)
    widest, steps = searched(open_above, thorough=True)
    assert isinstance(cheapest, Way)
    assert isinstance(widest, Way)
    assert (cheapest.height_m, widest.height_m) == (1.44, 1.66)
    assert steps == 7


def test_the_storeys_must_leave_room_for_body_and_beams() -> None:
    with pytest.raises(ValueError, match=r"spacing_m must be at least 0\.185"):
        Config.model_validate({"planner": {"storeys": {"spacing_m": 0.18}}})
    never = {"planner": {"storeys": {"spacing_m": 0.18, "use": "never"}}}
    assert Config.model_validate(never).planner.storeys.spacing_m == 0.18
