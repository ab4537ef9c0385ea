"""Cones: what they rule out is free, what they saw is somewhere on what is left of their arcs."""

import math
from collections.abc import Collection

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from autonomy.config import MapConfig
from autonomy.geometry import Point, along
from autonomy.perception.obstacle_map import FloatArray, ObstacleMap
from autonomy.perception.projection import Ray, RayKind
from hal.config import BeamsConfig, Fence, six_beams
from tests.unit.autonomy.perception.rooms import Flight, Room
from tests.unit.autonomy.perception.test_obstacle_map import (
    BODY_M,
    FENCE,
    HERE,
    ROOMS,
    still,
    true_free_m,
)

HALF_DEG = 12.5


def wide(half_angle_deg: float = HALF_DEG) -> BeamsConfig:
    cone = {"half_angle_deg": half_angle_deg}
    return BeamsConfig(mounts=tuple(mount.model_copy(update=cone) for mount in six_beams()))


def new_map() -> ObstacleMap:
    return ObstacleMap(MapConfig(), BODY_M, FENCE)


def cone(
    stamp_s: float,
    bearing_deg: float,
    length_m: float,
    kind: RayKind = RayKind.HIT,
    origin: Point = (0.0, 0.0),
    free_m: float = math.inf,
    beam: int = 0,
) -> Ray:
    bearing, half = math.radians(bearing_deg), math.radians(HALF_DEG)
    place = (*origin, -1.0)
    return Ray(stamp_s, beam, kind, place, bearing, 0.0, length_m, origin, half, free_m)


def seen_bearings_deg(obstacles: ObstacleMap, now_s: float, away_m: float) -> FloatArray:
    """Bearings of the seen cells about that far from the origin."""
    cells = obstacles.seen_cells(now_s)
    ring = np.abs(np.hypot(*cells.T) - away_m) < 0.02
    bearings: FloatArray = np.degrees(np.arctan2(cells[ring, 1], cells[ring, 0]))
    return bearings


def swept(room: Room, seconds: float = 2.1, half_angle_deg: float = HALF_DEG) -> ObstacleMap:
    """The map after a good turn on the spot, without noise."""
    obstacles = new_map()
    Flight(room, obstacles, still, beams=wide(half_angle_deg)).fly(seconds)
    return obstacles


# ---------------------------------------------------------------- one reading


def test_one_cone_sees_its_sector_free_but_not_quite_to_its_sides_nor_to_what_it_saw() -> None:
    obstacles = new_map()
    obstacles.update(1.0, (cone(1.0, 0.0, 0.8),))
    bearings = seen_bearings_deg(obstacles, 1.0, 0.6)
    assert 9.0 < bearings.max() < 11.1
    assert -11.1 < bearings.min() < -9.0
    away = np.hypot(*obstacles.seen_cells(1.0).T)
    assert 0.74 < away.max() < 0.77


def test_a_cone_that_leaves_the_slab_frees_no_more_than_it_saw_there() -> None:
    obstacles = new_map()
    obstacles.update(1.0, (cone(1.0, 0.0, 0.8, free_m=0.5),))
    assert np.hypot(*obstacles.seen_cells(1.0).T).max() < 0.5
    (arc,) = obstacles.open_arcs()
    assert np.hypot(*arc.T) == pytest.approx(0.8)


def test_a_hit_is_open_on_its_whole_arc_and_a_little_beyond_its_sides() -> None:
    obstacles = new_map()
    obstacles.update(1.0, (cone(1.0, 30.0, 0.8),))
    assert len(obstacles.hits()) == 0
    (arc,) = obstacles.open_arcs()
    assert np.hypot(*arc.T) == pytest.approx(0.8)
    bearings = np.degrees(np.arctan2(arc[:, 1], arc[:, 0]))
    assert (bearings.min(), bearings.max()) == pytest.approx((16.0, 44.0))


def test_a_short_arc_is_a_hit_at_once() -> None:
    obstacles = new_map()
    obstacles.update(1.0, (cone(1.0, 0.0, 0.25),))
    hits = obstacles.hits()
    assert np.hypot(*hits.T) == pytest.approx(0.25, abs=0.001)
    assert np.ptp(hits[:, 1]) == pytest.approx(2.0 * 0.25 * math.sin(math.radians(14.0)), abs=0.02)
    assert not obstacles.open_arcs()


def deny(obstacles: ObstacleMap, beam: int, until_deg: float = 12.0) -> None:
    """A beam that says free all over an arc at 0.8 m and 0 deg; at 6 deg the last of it."""
    for bearing in np.arange(-12.0, until_deg + 0.1, 3.0).tolist():
        stamp_s = 1.4 + 0.001 * bearing
        obstacles.update(stamp_s, (cone(stamp_s, bearing, 1.0, RayKind.FREE, beam=beam),))


def test_what_another_beam_alone_denies_is_there_all_the_same() -> None:
    denied_before = new_map()
    deny(denied_before, beam=1)
    denied_before.update(1.5, (cone(1.5, 0.0, 0.8),))
    (arc,) = denied_before.open_arcs()
    assert len(arc) > 20
    denied_after = new_map()
    denied_after.update(0.9, (cone(0.9, 0.0, 0.8),))
    deny(denied_after, beam=1, until_deg=6.0)
    assert len(denied_after.hits()) > 0


def test_a_beam_may_take_back_all_that_it_saw_itself() -> None:
    obstacles = new_map()
    obstacles.update(0.9, (cone(0.9, 0.0, 0.8),))
    deny(obstacles, beam=0)
    assert len(obstacles.hits()) == 0
    assert not obstacles.open_arcs()


def swept_past(
    missed: Collection[float], step_deg: int = 3, obstacles: ObstacleMap | None = None
) -> ObstacleMap:
    """One beam turns past a needle 0.5 m away at 0 deg, and misses it at some bearings."""
    length_m, obstacles = 0.5, obstacles or new_map()
    for bearing in range(-36, 37, step_deg):
        stamp_s = 1.0 + 0.05 * (bearing + 36) / step_deg
        seen = abs(bearing) <= 12 and bearing not in missed
        kind, range_m = (RayKind.HIT, length_m) if seen else (RayKind.FREE, 1.0)
        obstacles.update(stamp_s, (cone(stamp_s, float(bearing), range_m, kind),))
    return obstacles


@pytest.mark.parametrize("missed", [(), (0,), (-12, 3), (-9, 6), (-12, 0, 9)])
def test_what_a_beam_sees_in_most_readings_is_there(missed: tuple[int, ...]) -> None:
    hits = swept_past(missed).hits()
    assert len(hits) > 0
    assert np.hypot(*(hits - (0.5, 0.0)).T).max() < 0.06


@pytest.mark.parametrize("seen", [(0,), (-9, 9), (-12, 0, 12)])
def test_what_a_beam_sees_in_few_readings_is_not(seen: tuple[int, ...]) -> None:
    missed = [bearing for bearing in range(-12, 13, 3) if bearing not in seen]
    obstacles = swept_past(missed)
    assert len(obstacles.hits()) == 0
    assert not obstacles.open_arcs()


@pytest.mark.parametrize("missed", [(0,), (3,), (-12, 3)])
def test_what_another_beam_never_saw_is_there_all_the_same(missed: tuple[int, ...]) -> None:
    blind = new_map()
    for bearing in range(-36, 37, 3):
        stamp_s = 0.2 + 0.01 * (bearing + 36) / 3
        blind.update(stamp_s, (cone(stamp_s, float(bearing), 1.0, RayKind.FREE, beam=1),))
    assert len(swept_past(missed, obstacles=blind).hits()) > 0


def test_two_readings_that_stray_while_it_turns_fast_are_no_thing() -> None:
    strayed = swept_past((-12, -6, 12), step_deg=6)
    assert len(strayed.hits()) == 0
    assert not strayed.open_arcs()


@settings(deadline=None, max_examples=120)
@given(missed=st.sets(st.integers(-4, 4).map(lambda k: 3 * k), max_size=9))
def test_two_thirds_of_the_readings_decide(missed: set[int]) -> None:
    """Just two thirds may go either way, as arcs are voted on while the beam turns.

    The outermost readings hold the needle on their arcs, but not in what they surely see.
    """
    hits = swept_past(missed).hits()
    surely = sum(1 for bearing in missed if abs(bearing) <= 9)
    if 9 - len(missed) > 2 * surely:
        assert len(hits) > 0
    elif 9 - len(missed) < surely:
        assert len(hits) == 0


def test_nothing_measured_says_nothing() -> None:
    obstacles = new_map()
    obstacles.update(1.0, (cone(1.0, 0.0, 0.0, RayKind.NOTHING),))
    assert len(obstacles.hits()) == 0
    assert np.hypot(*obstacles.seen_cells(1.0).T).max() < BODY_M
    assert not obstacles.open_arcs()


# ---------------------------------------------------------------- carving


@pytest.mark.parametrize("free_first", [True, False])
def test_a_free_cone_takes_its_part_of_an_arc_whichever_came_first(free_first: bool) -> None:
    obstacles = new_map()
    hit, free = ((1.0, RayKind.HIT, 0.6), (1.05, RayKind.FREE, 1.0))
    if free_first:
        hit, free = (1.05, *hit[1:]), (1.0, *free[1:])
    for stamp_s, kind, length_m in sorted((hit, free)):
        bearing_deg = 0.0 if kind is RayKind.HIT else 10.0
        obstacles.update(stamp_s, (cone(stamp_s, bearing_deg, length_m, kind),))
    (arc,) = obstacles.open_arcs()
    bearings = np.degrees(np.arctan2(arc[:, 1], arc[:, 0]))
    # The free cone surely sees from 10 - 11 degrees on.
    assert bearings.min() == pytest.approx(-14.0)
    assert -3.0 < bearings.max() <= -1.0


def test_a_cone_that_ends_hardly_farther_takes_nothing_of_an_arc() -> None:
    obstacles = new_map()
    obstacles.update(1.0, (cone(1.0, 0.0, 0.6),))
    obstacles.update(1.05, (cone(1.05, 3.0, 0.63),))
    assert [len(arc) for arc in obstacles.open_arcs()] == [21, 21]


def test_an_arc_settles_when_its_beam_has_turned_away_and_keeps_what_is_left() -> None:
    obstacles = new_map()
    obstacles.update(1.0, (cone(1.0, 0.0, 0.6),))
    obstacles.update(1.2, (cone(1.2, 12.0, 1.0, RayKind.FREE),))
    assert len(obstacles.hits()) == 0
    obstacles.update(1.5, (cone(1.5, 30.0, 1.0, RayKind.FREE),))
    assert not obstacles.open_arcs()
    hits = obstacles.hits()
    assert np.hypot(*hits.T) == pytest.approx(0.6, abs=0.005)
    assert hits[:, 1].max() < 0.025
    assert hits[:, 1].min() == pytest.approx(-0.6 * math.sin(math.radians(14.0)), abs=0.01)


def test_an_arc_also_settles_by_age_where_the_beam_does_not_turn() -> None:
    obstacles = new_map()
    for stamp_s in (1.0, 2.9, 3.1):
        obstacles.update(stamp_s, (cone(stamp_s, 0.0, 0.6),))
        assert (len(obstacles.hits()) > 0) is (stamp_s > 3.0)


def test_of_an_arc_wider_than_a_passage_only_the_ends_become_hits() -> None:
    obstacles = new_map()
    obstacles.update(1.0, (cone(1.0, 0.0, 0.95),))
    obstacles.update(1.5, (cone(1.5, 40.0, 1.0, RayKind.FREE),))
    hits = obstacles.hits()
    assert len(hits) == 4
    assert np.abs(hits[:, 1]).min() > 0.18


def test_free_cones_erase_hits_and_seen_space_takes_their_place() -> None:
    obstacles = new_map()
    obstacles.update(1.0, (cone(1.0, 0.0, 0.25),))
    assert len(obstacles.hits()) > 0
    for step in range(1, 5):
        stamp_s = 1.0 + 0.05 * step
        obstacles.update(
            stamp_s,
            (cone(stamp_s, -8.0, 1.0, RayKind.FREE), cone(stamp_s + 0.01, 8.0, 1.0, RayKind.FREE)),
        )
    assert len(obstacles.hits()) == 0


def test_what_is_forgotten_is_not_hit_later_by_an_arc_from_before() -> None:
    obstacles = new_map()
    obstacles.update(1.0, (cone(1.0, 0.0, 0.6),))
    obstacles.forget_within((0.0, 0.0), 1.1, 0.14)
    obstacles.update(1.5, (cone(1.5, 40.0, 1.0, RayKind.FREE),))
    assert len(obstacles.hits()) == 0


def test_after_a_map_was_forgotten_whole_only_what_is_known_to_20_cm_is_a_hit() -> None:
    for length_m, counts in ((0.38, True), (0.6, False), (0.95, False)):
        obstacles = new_map()
        obstacles.forget_all((0.0, 0.0), 0.14)
        obstacles.update(1.0, (cone(1.0, 0.0, length_m),))
        obstacles.update(1.5, (cone(1.5, 40.0, 1.0, RayKind.FREE),))
        assert (len(obstacles.hits()) > 0) is counts
        assert not obstacles.open_arcs()


def test_open_arcs_follow_a_jump_of_the_frame() -> None:
    for delta in ((0.3, -0.2), (0.9, 0.0)):
        obstacles = new_map()
        obstacles.update(1.0, (cone(1.0, 0.0, 0.6),))
        (before,) = obstacles.open_arcs()
        obstacles.shift(delta)
        (after,) = obstacles.open_arcs()
        assert after == pytest.approx(before + delta)


# ---------------------------------------------------------------- whole turns


def test_a_post_is_mapped_where_it_is_after_one_turn() -> None:
    room = Room(discs=(((0.6, 0.3), 0.05),))
    hits = swept(room).hits()
    assert len(hits) > 2
    assert max(room.surface_distance_m((n, e)) for n, e in hits) < 0.06


def test_a_wall_is_mapped_within_its_arcs() -> None:
    room = Room(walls=(((0.6, -1.5), (0.6, 1.5)),))
    hits = swept(room).hits()
    errors = np.array([room.surface_distance_m((n, e)) for n, e in hits])
    assert np.median(errors) < 0.03
    assert errors.max() < 0.1
    for east in np.linspace(-0.4, 0.4, 17):
        assert np.hypot(hits[:, 0] - 0.6, hits[:, 1] - east).min() < 0.06


def test_a_gap_that_no_cone_fits_into_opens_when_the_vehicle_comes_nearer() -> None:
    room = Room(walls=(((0.88, -1.5), (0.88, -0.17)), ((0.88, 0.17), (0.88, 1.5))))
    obstacles = new_map()
    flight = Flight(room, obstacles, lambda t: (0.2 * max(0.0, t - 2.0), 0.0), beams=wide())
    gap = np.array([[0.88, 0.0]])
    flight.fly(2.0)
    assert not obstacles.ever_seen(gap)[0]
    assert obstacles.clearance_m((*gap[0], -1.0), 1.0) < 0.1
    flight.fly(3.0)
    assert obstacles.ever_seen(gap)[0]
    assert obstacles.clearance_m((*gap[0], -1.0), 1.0) > 0.1


@given(ROOMS, st.floats(-3.1, 3.1), st.sampled_from([5.0, HALF_DEG, 20.0]))
@settings(deadline=None, max_examples=10)
def test_free_distance_never_leads_the_body_into_a_surface(
    room: Room, heading: float, half_angle_deg: float
) -> None:
    obstacles = swept(room, half_angle_deg=half_angle_deg)
    free = obstacles.free_distance_m(HERE, heading, 0.7, 2.1)
    assert free <= true_free_m(room, heading, BODY_M, 0.7) + 1e-9


@given(ROOMS, st.floats(-3.1, 3.1), st.sampled_from([5.0, HALF_DEG, 20.0]))
@settings(deadline=None, max_examples=10)
def test_seen_space_was_in_sight_and_every_open_arc_holds_what_was_seen(
    room: Room, course: float, half_angle_deg: float
) -> None:
    beams = wide(half_angle_deg)
    obstacles = new_map()
    start = along((0.0, 0.0), course, -0.1)
    flight = Flight(room, obstacles, lambda t: along(start, course, 0.15 * t), beams=beams)
    while flight.now_s < 1.4:
        flight.tick()
        for arc in obstacles.open_arcs():
            step = float(np.hypot(*np.diff(arc, axis=0).T).min()) if len(arc) > 1 else 0.05
            assert min(room.surface_distance_m((n, e)) for n, e in arc) <= 0.5 * step + 0.01
    stamps = np.arange(0.05, flight.now_s + 0.01, 0.05) - beams.latency_s
    places = [flight.where(float(t)) for t in stamps]
    for cell in obstacles.seen_cells(flight.now_s):
        point = (float(cell[0]), float(cell[1]))
        if math.dist(point, places[-1]) > BODY_M and math.dist(point, (0.0, 0.0)) > 0.3:
            assert any(in_sight(room, place, point) for place in places), point


def in_sight(room: Room, place: Point, point: Point) -> bool:
    bearing = math.atan2(point[1] - place[1], point[0] - place[0])
    return room.range_m(place, bearing) > math.dist(place, point)


def test_the_same_flight_gives_the_same_map_bit_for_bit() -> None:
    def one() -> ObstacleMap:
        obstacles = new_map()
        room = Room(discs=(((-0.4, 0.3), 0.1), ((0.6, -0.3), 0.05)))
        noise = np.random.default_rng(5)
        Flight(room, obstacles, still, beams=wide(), noise=noise).fly(3.0)
        return obstacles

    a, b = one(), one()
    assert len(a.hits()) > 0
    assert a.hits().tobytes() == b.hits().tobytes()
    assert a.seen_cells(3.0).tobytes() == b.seen_cells(3.0).tobytes()


def test_a_map_may_be_small_and_arcs_may_end_outside() -> None:
    obstacles = ObstacleMap(MapConfig(), BODY_M, Fence.rectangle((-0.1, 0.1), (-0.1, 0.1)))
    for k in range(400):
        origin = (1.2, 1.2 - 0.001 * k)
        obstacles.update(0.05 * k, (cone(0.05 * k, 5.0 * k, 0.9, origin=origin),))
    assert np.isfinite(obstacles.hits()).all()
