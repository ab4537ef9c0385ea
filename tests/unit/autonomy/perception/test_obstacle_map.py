import math
from itertools import pairwise, product

import msgspec
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from autonomy.config import MapConfig, MoversConfig
from autonomy.geometry import Point, along
from autonomy.perception import kernels
from autonomy.perception.obstacle_map import ObstacleMap, representative_hits
from autonomy.perception.projection import Ray, RayKind
from hal.config import BeamMount, BeamsConfig, Fence
from hal.interfaces import SeenSpace
from tests.unit.autonomy.perception.rooms import Flight, Room

BODY_M = 0.15
FENCE = Fence.rectangle((-2.0, 2.0), (-2.0, 2.0))
HERE = (0.0, 0.0, -1.0)
WALL_NORTH = Room(walls=(((0.6, -1.5), (0.6, 1.5)),))


def new_map(**config: float) -> ObstacleMap:
    return ObstacleMap(MapConfig(**config), BODY_M, FENCE)


def ray(
    stamp_s: float,
    bearing_deg: float,
    length_m: float,
    kind: RayKind = RayKind.HIT,
    origin: Point = (0.0, 0.0),
    beam: int = 0,
) -> Ray:
    bearing = math.radians(bearing_deg)
    return Ray(stamp_s, beam, kind, (*origin, -1.0), bearing, 0.0, length_m, origin)


def still(_time_s: float) -> Point:
    return (0.0, 0.0)


def swept(room: Room, seconds: float = 1.7, **config: float) -> ObstacleMap:
    """The map after one turn on the spot, without noise."""
    obstacles = new_map(**config)
    Flight(room, obstacles, still).fly(seconds)
    return obstacles


def put_hit(obstacles: ObstacleMap, stamp_s: float, bearing_deg: float, length_m: float) -> None:
    """One hit by a beam of its own, so that no fan or edge comes with it."""
    obstacles.update(stamp_s, (ray(stamp_s, bearing_deg, length_m, beam=round(1e3 * stamp_s)),))


# ---------------------------------------------------------------- hits


def along_the_wall(seed: int, drift_m: float) -> ObstacleMap:
    obstacles = new_map()
    noise = np.random.default_rng(seed)
    Flight(
        WALL_NORTH, obstacles, lambda t: (0.0, -0.8 + 0.2 * t), noise=noise, drift_m=drift_m
    ).fly(8.0)
    return obstacles


@pytest.mark.parametrize("seed", range(4))
def test_a_wall_seen_from_a_moving_turning_vehicle_is_mapped_within_3_cm(seed: int) -> None:
    errors = np.abs(along_the_wall(seed, 0.0).hits()[:, 0] - 0.6)
    assert len(errors) > 60
    assert np.median(errors) < 0.015
    assert np.quantile(errors, 0.9) < 0.03


@pytest.mark.parametrize("seed", range(4))
def test_a_position_that_wanders_by_2_cm_spreads_the_wall_by_no_more(seed: int) -> None:
    errors = np.abs(along_the_wall(seed, 0.02).hits()[:, 0] - 0.6)
    assert np.median(errors) < 0.03
    assert np.quantile(errors, 0.9) < 0.06


def test_without_noise_every_hit_is_on_the_surface_or_a_little_in_front_of_it() -> None:
    room = Room(walls=WALL_NORTH.walls, discs=(((-0.5, 0.2), 0.1),))
    obstacles = new_map()
    Flight(room, obstacles, lambda t: (0.1 * math.sin(t), 0.15 * t - 0.4)).fly(5.0)
    distances = [room.surface_distance_m((n, e)) for n, e in obstacles.hits()]
    assert max(distances) < 0.03
    assert max(obstacles.hits()[:, 0]) < 0.6 + 2e-4  # the path bends between two poses


def test_every_part_of_the_wall_in_range_has_a_hit_nearby() -> None:
    hits = swept(WALL_NORTH).hits()
    for east in np.linspace(-0.6, 0.6, 25):
        assert np.hypot(hits[:, 0] - 0.6, hits[:, 1] - east).min() < 0.03


def test_a_sensor_on_the_rim_maps_the_same_wall() -> None:
    beams = BeamsConfig(mounts=(BeamMount(name="front", forward_m=0.1),))
    obstacles = new_map()
    Flight(WALL_NORTH, obstacles, still, beams=beams).fly(6.2)
    assert abs(obstacles.clearance_m(HERE, 1.0) - 0.6) < 0.005


def test_the_hit_of_a_cell_is_a_running_mean_of_the_hits_in_it() -> None:
    obstacles = new_map()
    put_hit(obstacles, 1.0, 0.0, 0.501)
    put_hit(obstacles, 1.1, 0.0, 0.521)
    assert obstacles.hits()[0] == pytest.approx((0.506, 0.0))


def test_rays_that_pass_through_a_hit_clear_it_one_by_one_up_to_its_cap() -> None:
    obstacles = new_map()
    for k in range(9):  # 9 hits of 3 would be 27: capped at 12, occupied from 3
        put_hit(obstacles, 1.0 + 0.1 * k, 0.0, 0.5)
    left = []
    for k in range(12):
        stamp = 3.0 + 0.1 * k
        obstacles.update(stamp, (ray(stamp, 0.0, 1.0, RayKind.FREE, beam=3000 + k),))
        left.append(len(obstacles.hits()))
    assert left == [1] * 9 + [0] * 3


@pytest.mark.parametrize("movers", [None, MoversConfig()])
def test_where_the_newest_look_is_trusted_a_few_rays_clear_what_many_have_hit(
    movers: MoversConfig | None,
) -> None:
    obstacles = new_map()
    for k in range(9):
        put_hit(obstacles, 1.0 + 0.1 * k, 0.0, 0.5)
    obstacles.trust_newest()
    obstacles.doubt(movers)
    assert len(obstacles.hits()) == 1
    assert rays_until_clear(obstacles, 3.0) == 4  # 6, and occupied from 3; 10 for 12
    for k in range(9):
        put_hit(obstacles, 5.0 + 0.1 * k, 0.0, 0.5)
    assert rays_until_clear(obstacles, 6.0) == 4


def rays_until_clear(obstacles: ObstacleMap, now_s: float) -> int:
    for number in range(1, 20):
        assert len(obstacles.hits()) == 1
        obstacles.update(now_s, (ray(now_s, 0.0, 1.0, RayKind.FREE, beam=number % 4),))
        now_s += 0.05
        if len(obstacles.hits()) == 0:
            return number
    raise AssertionError("never cleared")


def test_a_ray_clears_only_what_lies_near_it_and_well_before_its_end() -> None:
    obstacles = new_map()
    put_hit(obstacles, 1.0, 0.0, 0.5)
    obstacles.update(1.1, (ray(1.1, 3.0, 1.0, RayKind.FREE, beam=1),))  # 2.6 cm aside
    obstacles.update(1.2, (ray(1.2, 0.0, 0.55, RayKind.FREE, beam=2),))  # ends 5 cm behind
    obstacles.update(1.3, (ray(1.3, 180.0, 1.0, RayKind.FREE, beam=3),))  # the other way
    assert len(obstacles.hits()) == 1
    obstacles.update(1.4, (ray(1.4, 2.0, 1.0, RayKind.FREE, beam=4),))  # 1.7 cm aside
    assert len(obstacles.hits()) == 0


@given(st.floats(-180.0, 180.0), st.floats(-0.1, 1.0), st.floats(-0.04, 0.04))
@settings(deadline=None, max_examples=200)
def test_a_ray_of_any_bearing_clears_just_what_lies_within_2_cm_of_it(
    bearing_deg: float, ahead_m: float, aside_m: float
) -> None:
    assume(min(abs(abs(aside_m) - 0.02), abs(ahead_m), abs(ahead_m - 0.94)) > 1e-6)
    bearing = math.radians(bearing_deg)
    start = (0.137, -0.211)
    place = along(along(start, bearing, ahead_m), bearing + math.pi / 2.0, aside_m)
    obstacles = new_map()
    obstacles.update(1.0, (ray(1.0, 0.0, 0.0, RayKind.HIT, place),))
    obstacles.update(2.0, (ray(2.0, bearing_deg, 1.0, RayKind.FREE, start, 1),))
    cleared = abs(aside_m) < 0.02 and 0.0 < ahead_m < 0.94
    assert len(obstacles.hits()) == (0 if cleared else 1)


def test_a_reading_that_comes_twice_or_late_is_taken_once() -> None:
    obstacles = new_map()
    once = ray(1.0, 0.0, 0.5)
    obstacles.update(1.0, (once,))
    obstacles.update(1.1, (once, ray(0.9, 90.0, 0.5)))
    assert len(obstacles.hits()) == 1
    obstacles.update(1.2, (ray(1.2, 0.0, 1.0, RayKind.FREE, beam=1),))
    assert len(obstacles.hits()) == 0


def test_the_version_counts_changes_of_the_set_of_occupied_cells() -> None:
    obstacles = new_map()
    put_hit(obstacles, 1.0, 0.0, 0.5)
    first = obstacles.version
    put_hit(obstacles, 1.1, 0.0, 0.501)  # the same cell again: no new one
    assert obstacles.version == first
    put_hit(obstacles, 1.2, 90.0, 0.7)
    assert obstacles.version == first + 1
    for k in range(6):
        stamp = 2.0 + k
        obstacles.update(stamp, (ray(stamp, 90.0, 1.0, RayKind.FREE, beam=50 + k),))
    assert len(obstacles.hits()) == 1
    assert obstacles.version == first + 2


def test_hits_are_cached_read_only_and_renewed_by_updates() -> None:
    obstacles = new_map()
    put_hit(obstacles, 1.0, 0.0, 0.5)
    hits = obstacles.hits()
    assert obstacles.hits() is hits
    with pytest.raises(ValueError):
        hits[0, 0] = 9.0
    put_hit(obstacles, 1.1, 0.0, 0.51)
    assert obstacles.hits()[0, 0] != hits[0, 0]


def test_many_hits_make_the_list_grow_without_losing_any() -> None:
    obstacles = new_map()
    stamp = 0.0
    for i in range(60):
        for j in range(50):
            stamp += 1.0
            # Beam 0's rays are a second apart: no fan, no edge; no length: nothing is cleared.
            obstacles.update(stamp, (ray(stamp, 0.0, 0.0, RayKind.HIT, (0.03 * i, 0.03 * j)),))
    assert len(obstacles.hits()) == 3000
    assert obstacles.clearance_m((0.6, 0.9, -1.0), 1.0) == pytest.approx(0.0, abs=1e-9)


def test_hits_outside_the_grid_are_ignored() -> None:
    obstacles = new_map()
    obstacles.update(1.0, (ray(1.0, 0.0, 0.5, origin=(3.0, 0.0)),))
    obstacles.update(2.0, (ray(2.0, 180.0, 0.5, origin=(-50.0, 0.0)),))
    assert len(obstacles.hits()) == 0


# ---------------------------------------------------------------- edges and fans


@pytest.mark.parametrize("first_hits", [True, False])
def test_between_a_hit_and_a_miss_the_edge_gets_a_hit_at_the_nearer_range(
    first_hits: bool,
) -> None:
    obstacles = new_map()
    pair = [ray(1.0, 0.0, 0.4), ray(1.05, 3.0, 1.0, RayKind.FREE)]
    if not first_hits:
        pair = [ray(1.0, 3.0, 1.0, RayKind.FREE), ray(1.05, 0.0, 0.4)]
    for one in pair:
        obstacles.update(one.stamp_s, (one,))
    edge = along((0.0, 0.0), math.radians(1.5), 0.4)
    assert np.hypot(*(obstacles.hits() - edge).T).min() < 1e-9


def test_the_edge_rule_bounds_a_pillars_silhouette_from_outside() -> None:
    # The last ray that hits is at most 3 deg inside the silhouette, its edge hit half of that.
    room = Room(discs=(((0.5, 0.0), 0.06),))
    hits = swept(room).hits()
    bearings = np.arctan2(hits[:, 1], hits[:, 0])
    silhouette = math.asin(0.06 / 0.5)
    for side in (bearings.max(), -bearings.min()):
        assert silhouette - math.radians(1.5) <= side <= silhouette + math.radians(1.5)


def test_no_edge_is_put_between_rays_far_apart_in_bearing() -> None:
    obstacles = new_map()
    obstacles.update(1.0, (ray(1.0, 0.0, 0.4),))
    obstacles.update(1.05, (ray(1.05, 8.0, 0.4),))
    assert len(obstacles.hits()) == 2
    assert not is_seen(obstacles, 4.0, 0.25)


def is_seen(obstacles: ObstacleMap, bearing_deg: float, length_m: float) -> bool:
    point = np.array(along((0.0, 0.0), math.radians(bearing_deg), length_m))
    cells = obstacles.seen_cells(10.0)
    return bool(len(cells)) and bool((np.abs(cells - point).max(axis=1) <= 0.0125).any())


def test_the_fan_between_two_rays_is_seen_to_the_nearer_end_less_the_shrink() -> None:
    obstacles = new_map()
    obstacles.update(1.0, (ray(1.0, 20.0, 1.0, RayKind.FREE),))
    obstacles.update(1.05, (ray(1.05, 24.0, 0.8, RayKind.FREE),))
    assert all(is_seen(obstacles, 22.0, r) for r in np.arange(0.16, 0.72, 0.01))
    assert not any(is_seen(obstacles, 22.0, r) for r in np.arange(0.77, 1.1, 0.01))
    assert not any(is_seen(obstacles, b, 0.6) for b in (12.0, 32.0, 202.0))


def test_the_fan_of_a_sensor_that_moves_sideways_without_turning_is_the_strip_it_swept() -> None:
    obstacles = new_map()
    for k in range(11):
        stamp = 1.0 + 0.05 * k
        obstacles.update(stamp, (ray(stamp, 0.0, 1.0, RayKind.FREE, (0.0, 0.01 * k)),))
    cells = obstacles.seen_cells(10.0)
    ahead = cells[cells[:, 0] > 0.2]
    assert ahead[:, 0].max() == pytest.approx(0.94, abs=0.025)
    assert ahead[:, 1].min() > -0.025
    assert ahead[:, 1].max() < 0.125
    assert 0.74 * 0.1 <= len(ahead) * 0.025**2 <= 0.76 * 0.15


@pytest.mark.parametrize("breaker", ["missing", "no signal"])
def test_a_dropped_reading_breaks_the_fan_and_the_edge(breaker: str) -> None:
    obstacles = new_map()
    for k in range(5):
        stamp = 1.0 + 0.05 * k
        if k != 3:
            obstacles.update(stamp, (ray(stamp, 3.0 * k, 0.5),))
        elif breaker == "no signal":
            obstacles.update(stamp, (ray(stamp, 3.0 * k, 0.0, RayKind.NOTHING),))
    assert is_seen(obstacles, 4.5, 0.4)
    assert not is_seen(obstacles, 9.0, 0.44)
    bearings = sorted(np.degrees(np.arctan2(obstacles.hits()[:, 1], obstacles.hits()[:, 0])))
    gap = max(b - a for a, b in pairwise(bearings))
    assert gap > 4.0


def test_a_slower_sensor_is_learned_and_not_taken_for_dropping_readings() -> None:
    obstacles = new_map()
    stamp, bearing = 1.0, 0.0
    for period in [0.033] * 20 + [0.1] * 60:
        stamp += period
        bearing = (bearing + 3.0) % 360.0
        obstacles.update(stamp, (ray(stamp, bearing, 1.0, RayKind.FREE),))
    assert is_seen(obstacles, bearing - 4.5, 0.6)


def test_no_signal_says_nothing_about_space() -> None:
    obstacles = new_map()
    for k in range(20):
        stamp = 1.0 + 0.05 * k
        obstacles.update(stamp, (ray(stamp, 3.0 * k, 0.0, RayKind.NOTHING),))
    assert len(obstacles.hits()) == 0
    assert not is_seen(obstacles, 30.0, 0.3)


def in_sight_seen(obstacles: ObstacleMap, room: Room, radius_m: float) -> float:
    """Share of the points in sight of the origin, within the radius, that were seen."""
    points = [
        along((0.0, 0.0), bearing, away)
        for bearing in np.linspace(-math.pi, math.pi, 120, endpoint=False)
        for away in np.arange(0.05, radius_m, 0.05)
        if room.range_m((0.0, 0.0), float(bearing)) > away + 0.08
    ]
    return float(obstacles.ever_seen(np.array(points)).mean())


def test_one_turn_sees_everything_in_sight() -> None:
    room = Room(walls=WALL_NORTH.walls, discs=(((-0.3, -0.3), 0.05),))
    obstacles = swept(room)
    assert in_sight_seen(obstacles, room, 0.9) > 0.99
    assert in_sight_seen(obstacles, room, 1.5) < 0.9
    half = new_map()
    Flight(room, half, still).fly(0.8)
    assert 0.4 < in_sight_seen(half, room, 0.9) < 0.7


def test_where_the_body_is_the_space_is_free_even_if_no_beam_sees_it() -> None:
    obstacles = new_map()
    obstacles.update(1.0, (ray(1.0, 0.0, 0.0, RayKind.NOTHING, (0.5, 0.5)),))
    cells = obstacles.seen_cells(2.0) - (0.5, 0.5)
    assert len(cells) * 0.025**2 == pytest.approx(math.pi * 0.14**2, rel=0.05)
    assert np.hypot(*cells.T).max() <= 0.14


def test_an_old_sweep_is_not_a_new_one() -> None:
    obstacles = swept(Room(), seen_max_age_s=20.0)
    assert len(obstacles.seen_cells(20.0)) > 1000
    assert len(obstacles.seen_cells(21.8)) == 0
    assert len(new_map().seen_cells(0.0)) == 0


# ---------------------------------------------------------------- corridor


def test_the_map_is_what_the_guard_asks_for() -> None:
    obstacles = new_map()
    space: SeenSpace = obstacles
    assert space.free_distance_m(HERE, 0.0, 1.0, 0.0) == 0.0


def test_unseen_space_blocks_at_once_and_seen_space_up_to_its_end() -> None:
    assert new_map().free_distance_m(HERE, 0.3, 1.0, 0.0) == 0.0
    obstacles = swept(Room())
    for heading in np.linspace(-3.0, 3.0, 13):
        free = obstacles.free_distance_m(HERE, heading, 2.0, 1.7)
        # Seen to 0.94 m all round, and the corridor's corners are 0.17 m aside.
        assert free == pytest.approx(0.94 - 0.17, abs=0.03)


def test_hits_block_where_the_centre_would_come_too_near() -> None:
    obstacles = swept(WALL_NORTH)
    assert obstacles.free_distance_m(HERE, 0.0, 1.0, 1.7) == pytest.approx(0.6 - 0.185, abs=0.01)
    # Obliquely, the corridor's edge meets the wall.
    oblique = obstacles.free_distance_m(HERE, 0.5, 1.0, 1.7)
    assert oblique == pytest.approx((0.6 - 0.185) / math.cos(0.5), abs=0.02)


def test_a_hit_beside_the_corridor_does_not_block() -> None:
    obstacles = new_map()
    obstacles.mark_seen_disc((0.0, 0.0), 1.5, 1.0)
    put_hit(obstacles, 1.0, 30.0, 0.38)  # 0.19 m aside
    assert obstacles.free_distance_m(HERE, 0.0, 1.0, 1.0) == 1.0
    put_hit(obstacles, 1.1, -28.0, 0.38)  # 0.178 m aside
    expected = 0.38 * math.cos(math.radians(28.0)) - math.sqrt(
        0.185**2 - (0.38 * math.sin(math.radians(28.0))) ** 2
    )
    assert obstacles.free_distance_m(HERE, 0.0, 1.0, 1.1) == pytest.approx(expected, abs=1e-9)


def test_old_sight_does_not_count() -> None:
    obstacles = swept(Room(), seen_max_age_s=5.0)
    assert obstacles.free_distance_m(HERE, 0.0, 0.5, 5.0) == 0.5
    assert obstacles.free_distance_m(HERE, 0.0, 0.5, 7.0) == 0.0


def test_outside_the_grid_nothing_was_seen() -> None:
    obstacles = new_map()
    obstacles.mark_seen_disc((3.0, 0.0), 1.0, 1.0)
    assert obstacles.free_distance_m((2.9, 0.0, -1.0), 0.0, 1.0, 1.0) == pytest.approx(
        0.3 - 0.17, abs=0.03
    )
    assert obstacles.free_distance_m((20.0, 0.0, -1.0), 0.0, 1.0, 1.0) == 0.0


def test_cells_at_a_hit_are_accounted_for_even_if_never_seen() -> None:
    obstacles = new_map(corridor_hit_m=0.16)
    obstacles.mark_seen_disc((0.0, 0.0), 0.5, 1.0)
    before = obstacles.free_distance_m((0.25, 0.0, -1.0), 0.0, 1.0, 1.0)
    assert before < 0.11
    for bearing in range(-40, 41):
        put_hit(obstacles, 1.0 + 0.001 * (bearing + 60), float(bearing), 0.52)
    assert obstacles.free_distance_m((0.25, 0.0, -1.0), 0.0, 1.0, 2.0) > before


def beside_a_wall(distance_m: float) -> ObstacleMap:
    """Seen all round, with a wall of hits to the north at the distance."""
    obstacles = new_map()
    obstacles.mark_seen_disc((0.0, 0.0), 1.5, 1.0)
    for k, east in enumerate(np.arange(-0.5, 0.51, 0.02)):
        obstacles.update(1.0, (ray(1.0, 0.0, 0.0, RayKind.HIT, (distance_m, float(east)), beam=k),))
    return obstacles


@pytest.mark.parametrize("distance_m", [0.10, 0.15, 0.18])
def test_a_vehicle_too_near_to_a_wall_may_move_away_but_neither_nearer_nor_along(
    distance_m: float,
) -> None:
    obstacles = beside_a_wall(distance_m)
    for heading_deg in (180.0, 150.0, -150.0, 120.0):
        assert obstacles.free_distance_m(HERE, math.radians(heading_deg), 0.5, 1.0) == 0.5
    for heading_deg in (0.0, 60.0, 90.0, -90.0, 95.0):
        assert obstacles.free_distance_m(HERE, math.radians(heading_deg), 0.5, 1.0) == 0.0


def test_a_vehicle_that_escapes_one_hit_is_still_stopped_by_the_next() -> None:
    obstacles = new_map()
    obstacles.mark_seen_disc((0.0, 0.0), 1.5, 1.0)
    put_hit(obstacles, 1.0, 0.0, 0.12)
    put_hit(obstacles, 1.1, 180.0, 0.5)
    # 0.5 - s = 0.12 + 0.17 s: the limit has not grown back to 0.185 m when they meet.
    assert obstacles.free_distance_m(HERE, math.pi, 1.0, 1.1) == pytest.approx(0.38 / 1.17)
    # A second one that is too near as well allows no more than the middle between them.
    put_hit(obstacles, 1.2, 180.0, 0.13)
    assert obstacles.free_distance_m(HERE, math.pi, 1.0, 1.2) == pytest.approx(0.01 / 1.17)
    assert obstacles.free_distance_m(HERE, 0.0, 1.0, 1.2) == 0.0


def test_a_vehicle_in_a_corner_may_leave_it_along_the_diagonal() -> None:
    obstacles = beside_a_wall(0.10)
    for k, north in enumerate(np.arange(-0.5, 0.1, 0.02)):
        obstacles.update(
            1.0, (ray(1.0, 0.0, 0.0, RayKind.HIT, (float(north), 0.10), beam=100 + k),)
        )
    assert obstacles.free_distance_m(HERE, math.radians(-135.0), 0.5, 1.0) == 0.5
    assert obstacles.free_distance_m(HERE, math.radians(180.0), 0.5, 1.0) == 0.0


def test_an_unseen_spot_under_the_rim_blocks_all_but_the_way_from_it() -> None:
    obstacles = new_map()
    obstacles.mark_seen_disc((0.05, 0.0), 0.2, 1.0)  # a crescent from 0.15 m on in the south
    assert obstacles.free_distance_m(HERE, math.pi, 0.2, 1.0) == 0.0
    assert obstacles.free_distance_m(HERE, math.pi / 2.0, 0.2, 1.0) == 0.0
    assert obstacles.free_distance_m(HERE, 0.0, 0.2, 1.0) == pytest.approx(0.08, abs=0.02)


def test_an_unseen_spot_abeam_blocks_until_it_lies_clearly_behind() -> None:
    obstacles = new_map()
    obstacles.mark_seen_disc((0.0, 0.0), 1.5, 1.0)
    obstacles.forget_within((0.0, 0.15), 0.02, 0.0)
    for heading_deg in (20.0, 0.0, -8.0):
        assert obstacles.free_distance_m(HERE, math.radians(heading_deg), 0.2, 1.0) == 0.0
    assert obstacles.free_distance_m(HERE, math.radians(-25.0), 0.2, 1.0) == 0.2


# ---------------------------------------------------------------- clearance


def test_clearance_and_nearest_hit_agree_and_stop_at_the_limit() -> None:
    obstacles = new_map()
    assert obstacles.clearance_m(HERE, 0.8) == 0.8
    assert obstacles.nearest_hit(HERE, 0.8) is None
    put_hit(obstacles, 1.0, 120.0, 0.5)
    put_hit(obstacles, 1.1, 10.0, 0.7)
    assert obstacles.clearance_m(HERE, 0.8) == pytest.approx(0.5)
    assert obstacles.nearest_hit(HERE, 0.8) == pytest.approx((0.5, math.radians(120.0)))
    assert obstacles.nearest_hit(HERE, 0.4) is None
    assert obstacles.clearance_m(HERE, 0.4) == 0.4


# ---------------------------------------------------------------- start, resets, forgetting


def test_the_start_disc_is_free_from_the_first_update_on() -> None:
    obstacles = new_map()
    obstacles.mark_seen_disc((0.0, 0.0))
    assert obstacles.free_distance_m(HERE, 0.0, 1.0, 50_000.0) == 0.0
    obstacles.update(50_000.0, ())
    assert obstacles.free_distance_m(HERE, 0.0, 1.0, 50_000.0) == pytest.approx(0.06, abs=0.03)


def test_a_disc_is_seen_at_the_time_of_the_last_update_unless_told_otherwise() -> None:
    obstacles = new_map(seen_max_age_s=5.0)
    obstacles.update(1.0, ())
    obstacles.update(20.0, ())
    obstacles.mark_seen_disc((0.0, 0.0), 1.0)
    assert obstacles.free_distance_m(HERE, 0.0, 0.5, 20.0) == 0.5
    obstacles.mark_seen_disc((0.0, 0.0), 1.0, 30.0)
    assert obstacles.free_distance_m(HERE, 0.0, 0.5, 34.0) == 0.5


@pytest.mark.parametrize("delta", [(0.013, -0.037), (0.31, 0.2), (0.9, -0.7), (-1.3, 0.0)])
def test_after_a_reset_the_geometry_is_the_same_in_the_new_frame(delta: Point) -> None:
    room = Room(walls=WALL_NORTH.walls, discs=(((-0.4, 0.3), 0.1),))
    before = swept(room)
    after = swept(room)
    version = after.version
    after.shift(delta)
    assert after.version > version
    there = (delta[0], delta[1], -1.0)
    assert after.hits() - delta == pytest.approx(before.hits(), abs=1e-9)
    assert after.clearance_m(there, 1.0) == pytest.approx(before.clearance_m(HERE, 1.0))
    for heading in np.linspace(-3.0, 3.0, 9):
        expected = before.free_distance_m(HERE, heading, 0.9, 1.7)
        assert after.free_distance_m(there, heading, 0.9, 1.7) == pytest.approx(expected, abs=1e-9)


def test_what_is_seen_after_a_reset_lands_on_what_was_seen_before() -> None:
    obstacles = swept(WALL_NORTH)
    count = len(obstacles.hits())
    obstacles.shift((0.9, -0.7))
    moved = Room(walls=(((1.5, -2.2), (1.5, 0.8)),))
    Flight(moved, obstacles, lambda _: (0.9, -0.7), now_s=1.7).fly(1.7)
    assert np.abs(obstacles.hits()[:, 0] - 1.5).max() < 0.03
    assert len(obstacles.hits()) < 1.3 * count


@pytest.mark.parametrize("delta", [(0.1, 0.0), (0.9, -0.7)])
def test_a_reset_between_two_rays_does_not_tear_their_fan(delta: Point) -> None:
    obstacles = new_map()
    obstacles.update(1.0, (ray(1.0, 20.0, 1.0, RayKind.FREE),))
    obstacles.shift(delta)
    obstacles.update(1.05, (ray(1.05, 23.0, 1.0, RayKind.FREE, delta),))
    cells = obstacles.seen_cells(2.0) - delta
    middle = along((0.0, 0.0), math.radians(21.5), 0.6)
    assert np.abs(cells - middle).max(axis=1).min() <= 0.0125 + 1e-9
    assert np.hypot(*cells.T).max() < 0.95


def test_no_reset_changes_nothing() -> None:
    obstacles = swept(WALL_NORTH)
    version, hits = obstacles.version, obstacles.hits()
    obstacles.shift((0.0, 0.0))
    assert obstacles.version == version
    assert obstacles.hits() is hits


def test_a_reset_far_beyond_the_grid_leaves_an_empty_map_that_works() -> None:
    obstacles = swept(WALL_NORTH)
    obstacles.shift((40.0, 0.0))
    assert len(obstacles.hits()) == 0
    assert obstacles.free_distance_m(HERE, 0.0, 1.0, 1.7) == 0.0
    Flight(WALL_NORTH, obstacles, still, now_s=1.7).fly(1.7)
    assert obstacles.clearance_m(HERE, 1.0) == pytest.approx(0.6, abs=0.01)


def test_forgetting_nearby_removes_hits_and_sight_but_keeps_the_inner_disc() -> None:
    obstacles = swept(WALL_NORTH)
    put_hit(obstacles, 2.0, 180.0, 1.5)
    version = obstacles.version
    obstacles.forget_within((0.0, 0.0), 1.1, 0.14)
    assert obstacles.hits() == pytest.approx(np.array([[-1.5, 0.0]]))
    assert obstacles.version == version + 1
    seen = obstacles.seen_cells(2.0)
    assert 0.11 < np.hypot(*seen.T).max() <= 0.14
    assert obstacles.free_distance_m(HERE, 0.0, 1.0, 2.0) == 0.0
    Flight(WALL_NORTH, obstacles, still, now_s=2.0).fly(1.7)
    assert obstacles.clearance_m(HERE, 1.0) == pytest.approx(0.6, abs=0.01)


@given(st.lists(st.tuples(st.floats(-1.9, 1.9), st.floats(-1.9, 1.9)), max_size=40))
@settings(deadline=None, max_examples=40)
def test_forgetting_nearby_removes_just_the_hits_that_are_near(points: list[Point]) -> None:
    obstacles = new_map()
    for beam, point in enumerate(points):
        obstacles.update(1.0, (ray(1.0, 0.0, 0.0, RayKind.HIT, point, beam),))
    before = {tuple(hit) for hit in obstacles.hits().tolist()}
    obstacles.forget_within((0.3, 0.0), 1.0, 0.0)
    after = {tuple(hit) for hit in obstacles.hits().tolist()}
    assert after == {hit for hit in before if math.dist(hit, (0.3, 0.0)) > 1.0}
    # What is left is still found by its place: a ray through it takes it away.
    for number, (north, east) in enumerate(sorted(after)):
        for again in range(4 * 12):
            stamp, beam = 2.0 + again, 100 + number
            through = ray(stamp, 0.0, 0.2, RayKind.FREE, (north - 0.05, east), beam)
            obstacles.update(stamp, (through,))
    assert len(obstacles.hits()) == 0


def test_forgetting_everything_leaves_only_the_disc() -> None:
    obstacles = swept(WALL_NORTH)
    put_hit(obstacles, 2.0, 180.0, 1.5)
    obstacles.forget_all((0.0, 0.0), 0.3)
    assert len(obstacles.hits()) == 0
    assert obstacles.clearance_m(HERE, 3.0) == 3.0
    assert np.hypot(*obstacles.seen_cells(2.0).T).max() <= 0.3
    assert obstacles.free_distance_m(HERE, 0.0, 1.0, 2.0) == pytest.approx(0.13, abs=0.03)


# ---------------------------------------------------------------- as a whole


def test_the_same_flight_gives_the_same_map_bit_for_bit() -> None:
    def one() -> ObstacleMap:
        obstacles = new_map()
        room = Room(walls=WALL_NORTH.walls, discs=(((-0.4, 0.3), 0.1), ((0.1, -0.7), 0.05)))
        flight = Flight(
            room, obstacles, lambda t: (0.0, 0.1 * t - 0.3), noise=np.random.default_rng(5)
        )
        flight.fly(4.0)
        return obstacles

    a, b = one(), one()
    assert a.hits().tobytes() == b.hits().tobytes()
    assert a.seen_cells(4.0).tobytes() == b.seen_cells(4.0).tobytes()
    assert a.version == b.version


ROOMS = st.builds(
    Room,
    walls=st.lists(
        st.builds(
            lambda bearing, away, tilt, half: (
                along(along((0.0, 0.0), bearing, away), bearing + tilt, half),
                along(along((0.0, 0.0), bearing, away), bearing + tilt, -half),
            ),
            st.floats(-3.1, 3.1),
            st.floats(0.35, 1.2),
            st.floats(1.2, 1.9),
            st.floats(0.05, 0.3),
        ),
        max_size=3,
    ).map(tuple),
    discs=st.lists(
        st.builds(
            lambda bearing, gap, radius: (along((0.0, 0.0), bearing, gap + radius), radius),
            st.floats(-3.1, 3.1),
            st.floats(0.25, 1.0),
            st.floats(0.05, 0.3),
        ),
        max_size=3,
    ).map(tuple),
)


def true_free_m(room: Room, heading_rad: float, radius_m: float, limit_m: float) -> float:
    """First travel (5 mm steps) at which a surface is nearer than the radius."""
    for s in np.arange(0.0, limit_m, 0.005):
        if room.surface_distance_m(along((0.0, 0.0), heading_rad, float(s))) < radius_m:
            return float(s)
    return limit_m


@given(ROOMS, st.floats(-3.1, 3.1))
@settings(deadline=None, max_examples=40)
def test_free_distance_never_leads_the_body_into_a_surface(room: Room, heading: float) -> None:
    # 3 deg between rays leave at most 1.3 cm at 0.5 m to the side; a wall's end as much.
    obstacles = swept(room)
    free = obstacles.free_distance_m(HERE, heading, 0.7, 1.7)
    assert free <= true_free_m(room, heading, BODY_M, 0.7) + 1e-9
    assert free <= true_free_m(room, heading, 0.185 - 0.015, 0.7) + 1e-9


@given(ROOMS, st.floats(-3.1, 3.1), st.lists(st.floats(-0.1, 1.5), min_size=2, max_size=5))
@settings(deadline=None, max_examples=40)
def test_free_distance_is_monotone_in_the_limit(
    room: Room, heading: float, limits: list[float]
) -> None:
    obstacles = swept(room)
    free = obstacles.free_distance_m(HERE, heading, 2.0, 1.7)
    for limit in limits:
        answer = obstacles.free_distance_m(HERE, heading, limit, 1.7)
        assert answer == pytest.approx(max(0.0, min(limit, free)), abs=1e-9)


@given(st.lists(st.tuples(st.floats(-1, 1), st.floats(-1, 1)), min_size=1, max_size=60))
@settings(deadline=None, max_examples=50)
def test_representative_hits_cover_all_hits_and_keep_apart(points: list[Point]) -> None:
    hits = np.array(points)
    chosen = representative_hits(hits, 0.2)
    gaps = np.hypot(*(hits[:, None, :] - chosen[None, :, :]).transpose(2, 0, 1))
    assert gaps.min(axis=1).max() <= 0.2
    if len(chosen) > 1:
        between = np.hypot(*(chosen[:, None, :] - chosen[None, :, :]).transpose(2, 0, 1))
        assert between[~np.eye(len(chosen), dtype=bool)].min() > 0.2
    assert representative_hits(hits[::-1], 0.2).tobytes() == chosen.tobytes()


def test_after_warm_up_nothing_is_compiled_for_other_types() -> None:
    kernels.warm_up()
    obstacles = swept(WALL_NORTH)
    obstacles.mark_seen_disc((0.0, 0.0))
    obstacles.mark_seen_disc((0, 0), 1, 2)
    obstacles.free_distance_m((0, 0, -1), 0, 1, 2)
    obstacles.nearest_hit((0, 0, -1), 1)
    obstacles.was_free((0, 0), 1, 2)
    obstacles.hit_cells_within((0, 0), 1)
    obstacles.hits()
    representative_hits(obstacles.hits(), 0.05)
    obstacles.shift((0.9, 0.0))
    Flight(WALL_NORTH, obstacles, still, now_s=1.7).fly(0.2)
    wide = ray(2.0, 0.0, 0.5)
    obstacles.update(2.0, (msgspec.structs.replace(wide, half_angle_rad=0.2, free_m=0.5),))
    obstacles.forget_within((0.0, 0.0), 1.1, 0.14)
    obstacles.forget_all((0, 0), 1)
    compiled = {
        name: len(kernel.signatures)
        for name, kernel in vars(kernels).items()
        if hasattr(kernel, "signatures") and not name.startswith("_")
    }
    assert "integrate" in compiled
    assert "free_distance" in compiled
    assert set(compiled.values()) == {1}


def test_a_square_of_cells_is_free_or_hit_as_its_cells_are_and_neither_off_the_grid() -> None:
    rng = np.random.default_rng(3)
    slot = np.where(rng.random((7, 6, kernels.LAYERS)) < 0.1, 1, -1).astype(np.int32)
    seen = np.where(rng.random((7, 6)) < 0.9, 5.0, 1.0)
    room = np.zeros((25, 2), dtype=np.int64)
    for i, j, reach in product(range(-1, 8), range(-1, 7), range(3)):
        square = (slice(i - reach, i + reach + 1), slice(j - reach, j + reach + 1))
        on_grid = reach <= min(i, j) and i + reach < 7 and j + reach < 6
        free = on_grid and bool(seen[square].min() >= 5.0)
        hit = np.argwhere((slot[square] >= 0).any(axis=2)) + np.array((i - reach, j - reach))
        assert kernels.free_since(seen, i, j, reach, 5.0) == free
        count = kernels.hit_cells(slot, i, j, reach, room)
        assert room[:count].tolist() == (hit.tolist() if on_grid else [])
