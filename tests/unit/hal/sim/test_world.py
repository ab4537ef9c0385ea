import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hal.frames import Vector3, add, rotate_frd_to_ned, scale
from hal.sim import kernels
from hal.sim.scenario import Box, Disc, Scenario, Wall, load_scenario
from hal.sim.world import RayBundles, World

NORTH: Vector3 = (1.0, 0.0, 0.0)
SOUTH: Vector3 = (-1.0, 0.0, 0.0)
UP: Vector3 = (0.0, 0.0, -1.0)
DOWN: Vector3 = (0.0, 0.0, 1.0)
PILLAR = Disc(centre_ne_m=(2.0, 0.0), radius_m=0.5)
CRATE = Box(centre_ne_m=(2.0, 0.0), size_m=(1.0, 0.4), height_m=0.6)

coordinates = st.floats(-4.0, 4.0)
angles = st.floats(-math.pi, math.pi)
poses = st.tuples(st.floats(-1.0, 5.0), st.floats(-1.5, 4.5), st.floats(-2.4, -0.1))


def world(*obstacles: Disc | Box | Wall, **keys: Any) -> World:
    return World(Scenario(name="test", obstacles=obstacles, **keys))


def test_a_ray_ends_at_the_near_side_of_a_disc() -> None:
    assert world(PILLAR).cast((0.0, 0.0, -1.0), NORTH) == pytest.approx(1.5)


def test_a_ray_ends_at_the_near_side_of_a_turned_box() -> None:
    turned = Box(centre_ne_m=(2.0, 0.0), size_m=(1.0, 1.0), yaw_deg=45.0)
    distance = world(turned).cast((0.0, 0.0, -1.0), NORTH)
    assert distance == pytest.approx(2.0 - math.sqrt(0.5))


def test_a_ray_ends_at_the_nearest_of_several() -> None:
    nearer = Wall(from_ne_m=(1.0, -1.0), to_ne_m=(1.0, 1.0), thickness_m=0.1)
    for order in ((PILLAR, nearer), (nearer, PILLAR)):
        assert world(*order).cast((0.0, 0.0, -1.0), NORTH) == pytest.approx(0.95)


def test_what_lies_behind_is_not_hit() -> None:
    assert world(PILLAR, CRATE).cast((0.0, 0.0, -0.3), SOUTH) == math.inf


def test_a_ray_past_an_edge_misses_and_one_inside_it_hits() -> None:
    assert world(PILLAR).cast((0.0, 0.501, -1.0), NORTH) == math.inf
    assert world(PILLAR).cast((0.0, 0.499, -1.0), NORTH) < 2.0


def test_the_length_of_a_direction_does_not_matter() -> None:
    assert world(PILLAR).cast((0.0, 0.0, -1.0), (7.0, 0.0, 0.0)) == pytest.approx(1.5)


@pytest.mark.parametrize("direction", [(0.0, 0.0, 0.0), (math.nan, 0.0, 0.0), (math.inf, 0, 0)])
def test_what_is_not_a_direction_is_refused(direction: Vector3) -> None:
    with pytest.raises(ValueError, match="is not a direction"):
        world().cast((0.0, 0.0, -1.0), direction)


def test_an_empty_world_has_a_floor_and_no_ceiling() -> None:
    assert world().cast((0.0, 0.0, -1.2), DOWN) == pytest.approx(1.2)
    assert world().cast((0.0, 0.0, -1.2), UP) == math.inf


def test_a_ceiling_ends_the_way_up() -> None:
    assert world(ceiling_m=2.5).cast((0.0, 0.0, -1.2), UP) == pytest.approx(1.3)


def test_a_tilted_ray_meets_the_floor_at_a_slant() -> None:
    assert world().cast((0.0, 0.0, -1.0), (1.0, 0.0, 1.0)) == pytest.approx(math.sqrt(2.0))


def test_a_vehicle_a_millimetre_below_the_floor_still_sees_obstacles_around_it() -> None:
    assert world(PILLAR).cast((0.0, 0.0, 0.001), NORTH) == pytest.approx(1.5)
    assert world(PILLAR).cast((0.0, 0.0, 0.001), DOWN) == 0.0


def test_rays_pass_over_and_under_what_is_not_there_at_their_height() -> None:
    lamp = Disc(centre_ne_m=(2.0, 0.0), radius_m=0.5, base_m=1.5, height_m=1.8)
    room = world(CRATE, lamp)
    assert room.cast((0.0, 0.0, -1.0), NORTH) == math.inf
    assert room.cast((0.0, 0.0, -1.6), NORTH) == pytest.approx(1.5)
    assert room.cast((0.0, 0.0, -0.5), NORTH) == pytest.approx(1.5)
    assert room.clearance_m((2.0, 0.0, -1.0)) == math.inf


def test_looking_down_on_a_crate_measures_to_its_top_and_up_to_a_lamp_to_its_underside() -> None:
    lamp = Disc(centre_ne_m=(2.0, 0.0), radius_m=0.5, base_m=1.5)
    room = world(CRATE, lamp)
    assert room.cast((2.0, 0.0, -1.0), DOWN) == pytest.approx(0.4)
    assert room.cast((2.0, 0.0, -1.0), UP) == pytest.approx(0.5)
    assert room.cast((2.6, 0.0, -1.0), DOWN) == pytest.approx(1.0)


def test_a_box_that_is_entered_from_above_does_not_hide_what_is_nearer() -> None:
    # The ray is over the long box before it meets the pillar, but would meet its top behind it.
    table = Box(centre_ne_m=(3.0, 0.0), size_m=(5.0, 1.0), height_m=0.2)
    for order in ((PILLAR, table), (table, PILLAR)):
        distance = world(*order).cast((0.0, 0.0, -1.0), (1.0, 0.0, 0.3))
        assert distance == pytest.approx(1.5 * math.hypot(1.0, 0.3))


def test_a_ray_from_inside_an_obstacle_is_over_at_once() -> None:
    assert world(PILLAR).cast((2.1, 0.0, -1.0), NORTH) == 0.0


def test_clearance_is_signed_and_counts_the_nearest() -> None:
    room = world(PILLAR, Wall(from_ne_m=(-1.0, -3.0), to_ne_m=(-1.0, 3.0), thickness_m=0.2))
    assert room.clearance_m((0.0, 0.0, -1.0)) == pytest.approx(0.9)
    assert room.clearance_m((1.2, 0.0, -1.0)) == pytest.approx(0.3)
    assert room.clearance_m((2.0, 0.1, -1.0)) == pytest.approx(-0.4)
    assert world().clearance_m((0.0, 0.0, -1.0)) == math.inf


def test_a_body_collides_when_its_rim_touches() -> None:
    room = world(PILLAR)
    assert room.collides((1.351, 0.0, -1.0), 0.15)
    assert not room.collides((1.349, 0.0, -1.0), 0.15)


def test_the_ceiling_is_a_collision_for_the_top_of_the_body_and_the_floor_is_none() -> None:
    room = world(ceiling_m=2.5)
    assert room.collides((0.0, 0.0, -2.421), 0.15)
    assert not room.collides((0.0, 0.0, -2.419), 0.15)
    assert room.collides((0.0, 0.0, -2.371), 0.15, 0.13)
    assert not room.collides((0.0, 0.0, -2.421), 0.15, 0.0)
    assert not room.collides((0.0, 0.0, 0.0), 0.15)


@pytest.mark.parametrize(
    ("height_m", "touches"), [(0.59, True), (0.679, True), (0.681, False), (1.4, False)]
)
def test_skimming_over_a_crate_is_a_collision(height_m: float, *, touches: bool) -> None:
    room = world(CRATE)
    assert room.collides((2.0, 0.0, -height_m), 0.15) == touches
    # The rim alone over its edge, and just beside it.
    assert room.collides((1.351, 0.0, -height_m), 0.15) == touches
    assert not room.collides((1.349, 0.0, -height_m), 0.15)


@pytest.mark.parametrize(("height_m", "touches"), [(1.419, False), (1.421, True), (1.6, True)])
def test_the_underside_of_a_lamp_is_a_collision(height_m: float, *, touches: bool) -> None:
    lamp = Disc(centre_ne_m=(2.0, 0.0), radius_m=0.5, base_m=1.5)
    assert world(lamp).collides((2.0, 0.0, -height_m), 0.15) == touches


def test_clearance_is_measured_at_the_height_of_the_centre() -> None:
    assert world(CRATE).clearance_m((1.0, 0.0, -0.61)) == math.inf


def test_a_world_in_which_nothing_moves_is_itself_at_every_time() -> None:
    room = world(PILLAR)
    assert room.at(12.5) is room


@settings(deadline=None, max_examples=80)
@given(north=coordinates, east=coordinates)
def test_clearance_agrees_with_the_scenarios_own_distances(north: float, east: float) -> None:
    scenario = load_scenario("default")
    at_height = [o for o in scenario.obstacles if o.height_m is None]
    expected = min(o.distance_m(north, east) for o in at_height)
    assert World(scenario).clearance_m((north, east, -1.0)) == pytest.approx(expected)


@settings(deadline=None, max_examples=80)
@given(origin=poses, bearing=angles, elevation=st.floats(-1.5, 1.5))
def test_a_ray_is_free_before_its_end_and_touches_something_there(
    origin: Vector3, bearing: float, elevation: float
) -> None:
    scenario = load_scenario("default")
    room = World(scenario)
    level = math.cos(elevation)
    direction = (level * math.cos(bearing), level * math.sin(bearing), -math.sin(elevation))
    distance = room.cast(origin, direction)
    assert math.isfinite(distance)
    if distance == 0.0:
        assert room.clearance_m(origin) <= 0.0
        return
    for k in range(40):
        point = add(origin, scale(direction, distance * k / 40.0))
        assert room.clearance_m(point) > -1e-9
        assert 0.0 <= -point[2] <= 2.5
    beyond = add(origin, scale(direction, distance + 1e-6))
    inside = room.clearance_m(beyond) <= 1e-6
    assert inside or -beyond[2] <= 1e-9 or -beyond[2] >= 2.5 - 1e-9


@settings(deadline=None, max_examples=60)
@given(
    position=poses,
    roll=st.floats(-0.5, 0.5),
    pitch=st.floats(-0.5, 0.5),
    yaw=angles,
    bearing=angles,
    elevation=st.floats(-1.5, 1.5),
    face=st.tuples(st.floats(-0.1, 0.1), st.floats(-0.1, 0.1), st.floats(-0.05, 0.05)),
)
def test_a_beam_on_a_tilted_body_is_the_ray_that_frames_rotate(
    position: Vector3,
    roll: float,
    pitch: float,
    yaw: float,
    bearing: float,
    elevation: float,
    face: Vector3,
) -> None:
    room = World(load_scenario("default"))
    level = math.cos(elevation)
    axis = (level * math.cos(bearing), level * math.sin(bearing), -math.sin(elevation))
    start = add(position, rotate_frd_to_ned(face, roll, pitch, yaw))
    direction = rotate_frd_to_ned(axis, roll, pitch, yaw)
    expected = room.cast(start, direction)
    # A ray that grazes an edge may end on either side of it: neighbours within 1e-7 count too.
    nearby = [
        room.cast(start, add(direction, (dn, de, dd)))
        for dn in (-1e-7, 0.0, 1e-7)
        for de in (-1e-7, 0.0, 1e-7)
        for dd in (-1e-7, 0.0, 1e-7)
    ]
    bundles = RayBundles((face,), (axis,))
    (found,) = room.cast_many(position, roll, pitch, yaw, bundles)
    assert any(found == pytest.approx(d, abs=1e-5) for d in (expected, *nearby))


def test_a_thin_beam_is_one_ray_and_a_cone_stays_within_its_half_angle() -> None:
    assert RayBundles(((0.0, 0.0, 0.0),), (NORTH,)).rays.shape == (1, 1, 3)
    for axis in (NORTH, UP, DOWN, (0.6, 0.8, 0.0)):
        rays = RayBundles(((0.0, 0.0, 0.0),), (axis,), 0.2).rays[0]
        cosines = rays @ np.array(axis)
        assert np.allclose(np.linalg.norm(rays, axis=1), 1.0)
        assert cosines.min() == pytest.approx(math.cos(0.2))
        assert np.allclose(rays[0], axis)
        off_axis = {round(math.acos(min(1.0, c)), 3) for c in cosines.tolist()}
        assert off_axis == {0.0, 0.067, 0.133, 0.2}


def test_a_cone_sees_a_post_beside_its_axis_and_not_one_outside_it() -> None:
    beside = Disc(centre_ne_m=(1.0, 0.15), radius_m=0.03)
    outside = Disc(centre_ne_m=(1.0, 0.3), radius_m=0.03)
    cone = RayBundles(((0.0, 0.0, 0.0),), (NORTH,), math.radians(12.5))
    thin = RayBundles(((0.0, 0.0, 0.0),), (NORTH,))
    here: Vector3 = (0.0, 0.0, -3.0)
    assert world(beside).cast_many(here, 0.0, 0.0, 0.0, thin) == [math.inf]
    assert world(beside).cast_many(here, 0.0, 0.0, 0.0, cone)[0] == pytest.approx(1.0, abs=0.05)
    assert world(outside).cast_many(here, 0.0, 0.0, 0.0, cone)[0] > 10.0  # the floor, far off


def test_a_cone_is_never_deeper_than_its_axis() -> None:
    room = World(load_scenario("default"))
    faces, axes = ((0.0, 0.0, 0.0),) * 2, (NORTH, (0.0, 1.0, 0.0))
    for yaw in np.linspace(-3.0, 3.0, 25).tolist():
        thin = room.cast_many((1.8, 1.0, -1.0), 0.0, 0.0, yaw, RayBundles(faces, axes))
        cone = room.cast_many((1.8, 1.0, -1.0), 0.0, 0.0, yaw, RayBundles(faces, axes, 0.2))
        assert all(c <= t + 1e-9 for c, t in zip(cone, thin, strict=True))


def test_warming_up_compiles_everything_that_flight_uses() -> None:
    kernels.warm_up()
    room = World(load_scenario("default"))
    compiled = (kernels.cast_ray, kernels.cast_bundles, kernels.clearance)
    before = [len(kernel.signatures) for kernel in compiled]
    room.cast((0.0, 0.0, -1.0), NORTH)
    room.cast_many((0.0, 0.0, -1.0), 0.0, 0.0, 0.0, RayBundles(((0.0, 0.0, 0.0),), (NORTH,)))
    room.clearance_m((0.0, 0.0, -1.0))
    assert [len(kernel.signatures) for kernel in compiled] == before
