import itertools
import math
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from hal.config import PointNE
from hal.frames import Vector3
from hal.sim.movers import Itinerary, Walker
from hal.sim.scenario import Disc, Mover, Scenario, Wall, Wander
from hal.sim.world import World

coordinates = st.floats(-3.0, 3.0)
places = st.tuples(coordinates, coordinates)


def mover(*path: PointNE, **keys: Any) -> Mover:
    return Mover(path_ne_m=path, **keys)


def place(itinerary: Itinerary, time_s: float) -> PointNE:
    return itinerary.stretch(time_s).at(time_s)


def world(*movers: Mover, **keys: Any) -> World:
    return World(Scenario(name="test", movers=movers, goal_ne_m=(4.0, 0.0), **keys))


def test_it_walks_at_its_speed_from_point_to_point() -> None:
    way = Itinerary(mover((1.0, 0.0), (3.0, 0.0), speed_m_s=0.5))
    assert place(way, 0.0) == (1.0, 0.0)
    assert place(way, 2.0) == pytest.approx((2.0, 0.0))
    assert way.stretch(2.0).velocity_ne_m_s == pytest.approx((0.5, 0.0))


@pytest.mark.parametrize(
    ("then", "at"), [("turn", (2.0, 1.0)), ("circle", (1.5, 0.5)), ("stay", (2.0, 1.5))]
)
def test_what_comes_after_the_last_point(then: str, at: PointNE) -> None:
    way = Itinerary(mover((1.0, 0.0), (2.0, 0.0), (2.0, 1.5), speed_m_s=1.0, then=then))
    seconds = 2.5 + (0.5 if then == "turn" else 0.625 * math.hypot(1.0, 1.5) * 1.0)
    if then == "circle":
        seconds, at = 2.5 + 0.5 * math.hypot(1.0, 1.5), (1.5, 0.75)
    assert place(way, seconds) == pytest.approx(at)


def test_it_waits_to_begin_and_stands_at_every_point() -> None:
    way = Itinerary(mover((1.0, 0.0), (2.0, 0.0), speed_m_s=1.0, start_s=2.0, pause_s=3.0))
    assert place(way, 4.9) == (1.0, 0.0)
    assert place(way, 5.5) == pytest.approx((1.5, 0.0))
    assert place(way, 8.9) == pytest.approx((2.0, 0.0))
    assert way.stretch(8.9).velocity_ne_m_s == (0.0, 0.0)
    assert place(way, 9.5) == pytest.approx((1.5, 0.0))


@settings(deadline=None, max_examples=60)
@given(
    path=st.lists(places, min_size=2, max_size=5, unique=True),
    speed=st.floats(0.05, 1.0),
    pause=st.floats(0.0, 2.0),
    then=st.sampled_from(["turn", "circle", "stay"]),
)
def test_nobody_jumps_or_hurries(
    path: list[PointNE], speed: float, pause: float, then: str
) -> None:
    walker = Walker(mover(*path, speed_m_s=speed, pause_s=pause, then=then))
    been = []
    for tick in range(400):
        walker.step(0.1 * tick)
        been.append(walker.place_ne_m)
        assert math.hypot(*walker.velocity_ne_m_s) <= speed * (1.0 + 1e-6)
    assert all(math.dist(a, b) <= 0.1 * speed + 1e-9 for a, b in itertools.pairwise(been))


@settings(deadline=None, max_examples=25)
@given(seed=st.integers(0, 10_000))
def test_who_wanders_stays_in_its_rectangle_and_off_the_obstacles(seed: int) -> None:
    pillar = Disc(centre_ne_m=(0.5, 0.5), radius_m=0.3)
    area = Wander(low_ne_m=(-1.0, -1.0), high_ne_m=(2.0, 2.0), seed=seed)
    way = Itinerary(mover((-0.5, -0.5), wander=area, speed_m_s=0.5, radius_m=0.2), (pillar,))
    for tick in range(300):
        n, e = place(way, 0.2 * tick)
        assert -1.0 <= n <= 2.0
        assert -1.0 <= e <= 2.0
        assert pillar.distance_m(n, e) > 0.2 - 0.03


def test_the_same_seed_wanders_the_same_way() -> None:
    area = Wander(low_ne_m=(-1.0, -1.0), high_ne_m=(2.0, 2.0), seed=4)
    one, two = (Itinerary(mover((0.0, 1.0), wander=area)) for _ in range(2))
    assert place(one, 50.0) == place(two, 50.0)


def test_who_is_walled_in_stays() -> None:
    walls = tuple(
        Wall(from_ne_m=a, to_ne_m=b)
        for a, b in itertools.pairwise(((0, 0), (1, 0), (1, 1), (0, 1), (0, 0)))
    )
    area = Wander(low_ne_m=(2.0, 2.0), high_ne_m=(3.0, 3.0))
    way = Itinerary(mover((0.5, 0.5), wander=area, radius_m=0.2), walls)
    assert place(way, 100.0) == (0.5, 0.5)


def test_a_polite_one_stands_while_the_vehicle_is_near_and_walks_on_after() -> None:
    walker = Walker(mover((1.0, 0.0), (3.0, 0.0), speed_m_s=0.5, polite_m=0.5, radius_m=0.2))
    walker.step(1.0, (2.1, 0.0))
    assert walker.place_ne_m == pytest.approx((1.5, 0.0))
    walker.step(3.0, (2.1, 0.0))
    assert walker.place_ne_m == pytest.approx((1.5, 0.0))
    assert walker.velocity_ne_m_s == (0.0, 0.0)
    walker.step(4.0, (9.0, 0.0))
    walker.step(5.0, (9.0, 0.0))
    assert walker.place_ne_m == pytest.approx((2.0, 0.0))


def test_a_ray_meets_a_mover_where_it_is_at_that_time() -> None:
    there = world(mover((2.0, -1.0), (2.0, 1.0), speed_m_s=0.5, radius_m=0.25))
    level: Vector3 = (0.0, 0.0, -1.0)
    assert there.at(0.0).cast(level, (1.0, 0.0, 0.0)) == math.inf
    assert there.at(2.0).cast(level, (1.0, 0.0, 0.0)) == pytest.approx(1.75)
    assert there.at(2.0).clearance_m(level) == pytest.approx(1.75)
    assert there.at(4.0).cast(level, (1.0, 0.0, 0.0)) == math.inf


def test_a_mover_may_be_low_enough_to_be_flown_over() -> None:
    there = world(mover((1.0, 0.0), (2.0, 0.0), height_m=0.5))
    assert there.clearance_m((1.0, 0.0, -1.0)) == math.inf
    assert not there.collides((1.0, 0.0, -1.0), 0.15)
    assert there.collides((1.0, 0.0, -0.4), 0.15)


def test_a_contact_says_who_came_to_whom() -> None:
    there = world(mover((3.0, 0.0), (0.5, 0.0), label="anna", speed_m_s=0.4, radius_m=0.2))
    still, fleeing, meeting = (0.0, 0.0, 0.0), (-0.2, 0.0, 0.0), (0.2, 0.0, 0.0)
    assert there.contact(1.0, (1.0, 0.0, -1.0), still, 0.15) is None
    position = (1.0, 0.0, -1.0)
    contacts = [there.contact(4.2, position, v, 0.15) for v in (still, fleeing, meeting)]
    assert [c.label for c in contacts if c is not None] == ["anna"] * 3
    assert [c.moved_into() for c in contacts if c is not None] == [False, False, True]
    assert contacts[1] is not None
    assert contacts[1].mover_towards_m_s == pytest.approx(0.4)
    assert contacts[1].body_towards_m_s == pytest.approx(-0.2)


def test_what_stands_is_always_moved_into() -> None:
    pillar = Disc(centre_ne_m=(1.0, 0.0), radius_m=0.2)
    there = world(mover((3.0, 0.0), (2.0, 0.0)), obstacles=(pillar,))
    contact = there.contact(0.0, (0.7, 0.0, -1.0), (0.0, 0.0, 0.0), 0.15)
    assert contact is not None
    assert contact.label is None
    assert contact.moved_into()


@pytest.mark.parametrize(
    ("keys", "sentence"),
    [
        ({"path_ne_m": [[1.0, 0.0]]}, "needs two points"),
        ({"path_ne_m": [[1.0, 0.0], [1.0, 0.0]]}, "needs two points"),
        (
            {"path_ne_m": [[1, 0]], "wander": {"low_ne_m": [1, 0], "high_ne_m": [0, 1]}},
            "south-west",
        ),
        ({"path_ne_m": [[0.1, 0.0], [1.0, 0.0]]}, "on the vehicle"),
    ],
)
def test_who_cannot_walk_is_refused_with_a_sentence(keys: dict[str, Any], sentence: str) -> None:
    with pytest.raises(ValidationError, match=sentence):
        Scenario.model_validate({"name": "test", "movers": [keys]})
