"""Tangents, cones, fences and the records of a route, by numbers worked out by hand."""

import math
from typing import Any

import numpy as np
import pytest

from autonomy.geometry import Point
from autonomy.t3drm import kernels
from autonomy.t3drm.spherical import (
    ACTIVE_MAX,
    NO_PLANES,
    Arc,
    Discs,
    NoRoute,
    NoRouteReason,
    Route,
    Segment,
    Tangents,
    fence_planes,
    route_among,
    shortest_path,
    tangent_cone,
    tangents_from,
    touch_angle,
)
from hal.frames import Vector3, add


@pytest.mark.parametrize("record", [Tangents, Segment, Arc, Route, NoRoute, Discs])
def test_what_was_found_cannot_be_changed(record: Any) -> None:
    assert record.__struct_config__.frozen


# ---------------------------------------------------------------- one sphere


def test_on_a_sphere_the_tangent_stands_upright() -> None:
    assert touch_angle(2.0, 2.0) == pytest.approx(0.5 * math.pi)
    with pytest.raises(ValueError, match="inside the sphere"):
        touch_angle(2.0, math.nextafter(2.0, 0.0))


@pytest.mark.parametrize("turned_deg", [0.0, 90.0, 200.0])
def test_tangents_from_any_side(turned_deg: float) -> None:
    # |DO| = 5, r = 3: they touch 4 m away at the angle asin 0.6 off DO.
    turn = math.radians(turned_deg)
    drone = (1.0, -2.0)
    centre = (1.0 + 5.0 * math.cos(turn), -2.0 + 5.0 * math.sin(turn))
    found = tangents_from(drone, centre, 3.0)
    for touch, side in ((found.left, -1.0), (found.right, 1.0)):
        angle = turn + side * math.asin(0.6)
        at = (1.0 + 4.0 * math.cos(angle), -2.0 + 4.0 * math.sin(angle))
        assert touch == pytest.approx(at)
    assert (found.length_m, found.touch_angle_rad) == pytest.approx((4.0, math.asin(0.6)))


def test_a_point_on_the_circle_is_its_own_touching_point() -> None:
    found = tangents_from((0.0, 3.0), (0.0, 0.0), 3.0)
    assert found.left == found.right == (0.0, 3.0)
    assert found.length_m == 0.0
    near = tangents_from((0.0, 0.0), (0.5, 0.0), 0.3)
    assert near.length_m == pytest.approx(0.4)


# ---------------------------------------------------------------- the cone


def test_the_cone_straight_above_begins_in_the_north() -> None:
    # |DO| = 5, r = 3: touching points 3.2 above, on a circle of 2.4.
    found = tangent_cone((1.0, 2.0, -1.0), (1.0, 2.0, -6.0), 3.0, 4)
    expected = [(3.4, 2.0), (1.0, -0.4), (-1.4, 2.0), (1.0, 4.4)]
    assert [point[:2] for point in found] == [pytest.approx(at) for at in expected]
    assert [point[2] for point in found] == pytest.approx([-4.2] * 4)


def test_exactly_a_billionth_of_a_millimetre_aside_is_still_straight_above() -> None:
    assert tangent_cone((0.0, 0.0, 0.0), (1e-12, 0.0, -1.0), 0.6, 1)[0] == pytest.approx(
        (0.48, 0.0, -0.64)
    )
    (aside,) = tangent_cone((0.0, 0.0, 0.0), (2e-12, 0.0, -1.0), 0.6, 1)
    assert aside == pytest.approx((0.0, 0.48, -0.64), abs=1e-9)


def test_the_cone_towards_the_north_goes_round_by_quarters() -> None:
    found = tangent_cone((0.0, 0.0, 0.0), (5.0, 0.0, 0.0), 3.0, 4)
    expected = [(3.2, 2.4, 0.0), (3.2, 0.0, 2.4), (3.2, -2.4, 0.0), (3.2, 0.0, -2.4)]
    for point, at in zip(found, expected, strict=True):
        assert point == pytest.approx(at, abs=1e-12)


@pytest.mark.parametrize(
    "towards", [(3.0, 4.0, 0.0), (-3.0, 4.0, 2.0), (1.0, -2.0, -5.0), (0.0, 3.0, 1.0)]
)
@pytest.mark.parametrize("drone", [(0.0, 0.0, 0.0), (10.0, -20.0, -30.0)])
def test_the_cone_is_even_touches_at_right_angles_and_begins_in_the_plane(
    drone: Vector3, towards: Vector3
) -> None:
    centre = add(drone, towards)
    found = tangent_cone(drone, centre, 1.5, 6)
    assert len(found) == 6
    away = math.hypot(*towards)
    for point in found:
        assert math.dist(point, centre) == pytest.approx(1.5)
        assert math.dist(point, drone) == pytest.approx(math.sqrt(away * away - 2.25))
    neighbours = {round(math.dist(found[k - 1], found[k]), 9) for k in range(6)}
    assert len(neighbours) == 1
    # The first one: at the drone's angle of climb along the axis, to the side of growing bearings.
    rim = 1.5 * math.sqrt(1.0 - (1.5 / away) ** 2)
    middle = [d + t * (1.0 - (1.5 / away) ** 2) for d, t in zip(drone, towards, strict=True)]
    flat = math.hypot(towards[0], towards[1])
    assert found[0] == pytest.approx(
        (
            middle[0] - rim * towards[1] / flat,
            middle[1] + rim * towards[0] / flat,
            middle[2],
        )
    )


# ---------------------------------------------------------------- arcs


def test_an_arcs_polyline_is_circumscribed() -> None:
    # With a sagitta as long as the radius a corner may stand 60 degrees from where it touches.
    start = (11.0, 20.0)
    for sweep_deg, corners_deg in (
        (200.0, (50.0, 150.0)),
        (-200.0, (-50.0, -150.0)),
        (100.0, (50.0,)),
        (0.0, (0.0,)),
        (300.0, (50.0, 150.0, 250.0)),
    ):
        end = (10.0 + math.cos(math.radians(sweep_deg)), 20.0 + math.sin(math.radians(sweep_deg)))
        arc = Arc(start, end, (10.0, 20.0), 1.0, math.radians(sweep_deg), 0)
        points = arc.polyline(1.0)
        assert points[0] == start
        assert points[-1] == end
        outer = 1.0 / math.cos(math.radians(0.5 * abs(sweep_deg) / len(corners_deg)))
        assert list(points[1:-1]) == [
            pytest.approx(
                (
                    10.0 + outer * math.cos(math.radians(corner)),
                    20.0 + outer * math.sin(math.radians(corner)),
                )
            )
            for corner in corners_deg
        ]
        assert arc.length_m == pytest.approx(math.radians(abs(sweep_deg)))


def test_an_arcs_polyline_has_as_few_corners_as_its_sagitta_allows() -> None:
    # Corners 1 / cos 15 from the centre: 30 degrees each.
    sagitta_m = 1.0 / math.cos(math.radians(15.0)) - 1.0
    for sweep_deg, corners in ((29.9, 1), (30.1, 2), (100.0, 4), (179.0, 6), (-181.0, 7)):
        sweep = math.radians(sweep_deg)
        end = (math.cos(sweep), math.sin(sweep))
        arc = Arc((1.0, 0.0), end, (0.0, 0.0), 1.0, sweep, 0)
        assert len(arc.polyline(sagitta_m)) == corners + 2


def test_the_length_of_an_arc_is_its_radius_times_its_angle() -> None:
    assert Arc((0.0, 0.0), (0.0, 0.0), (0.0, 0.0), 2.0, -1.5, 0).length_m == 3.0
    assert Segment((1.0, 2.0), (4.0, 6.0)).length_m == 5.0


# ---------------------------------------------------------------- fences


def planes_of(polygon: tuple[Point, ...]) -> list[tuple[float, float, float]] | None:
    planes = fence_planes(polygon)
    if planes is None:
        return None
    return sorted((round(a, 12) + 0.0, round(b, 12) + 0.0, round(c, 12)) for a, b, c in planes)


@pytest.mark.parametrize("backwards", [False, True])
def test_a_rectangle_is_four_half_planes(*, backwards: bool) -> None:
    for n0, n1, e0, e1 in ((-1.0, 5.0, -2.0, 2.5), (0.1, 0.6, 0.2, 0.7), (2.0, 3.0, 4.0, 5.0)):
        ring = ((n0, e0), (n1, e0), (n1, e1), (n0, e1))
        assert planes_of(ring[::-1] if backwards else ring) == sorted(
            [(1.0, 0.0, n0), (-1.0, 0.0, -n1), (0.0, 1.0, e0), (0.0, -1.0, -e1)]
        )


def test_a_slanted_fence_has_unit_normals_that_point_inwards() -> None:
    # The long side of a 3-4-5 triangle at (10, 20).
    triangle = ((10.0, 20.0), (14.0, 20.0), (10.0, 23.0))
    found = planes_of(triangle)
    assert found is not None
    assert found == sorted([(0.0, 1.0, 20.0), (1.0, 0.0, 10.0), (-0.6, -0.8, -24.4)])


def test_a_dent_of_more_than_a_nanometre_is_not_convex() -> None:
    for dent, convex in ((-1e-3, True), (0.0, True), (1e-10, True), (1e-8, False), (0.3, False)):
        polygon = ((0.0, 0.0), (1.0, dent), (2.0, 0.0), (2.0, 2.0), (0.0, 2.0))
        assert (fence_planes(polygon) is not None) is convex


@pytest.mark.parametrize("middle", [(0.0, 0.0), (9.0, -7.0), (-4.0, -30.0), (0.5, 20.0)])
@pytest.mark.parametrize("corners", [3, 5, 8])
@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_a_regular_fence_holds_its_middle_wherever_it_stands(
    middle: Point, corners: int, sense: float
) -> None:
    turns = [sense * math.tau * k / corners for k in range(corners)]
    planes = fence_planes(tuple((middle[0] + math.cos(t), middle[1] + math.sin(t)) for t in turns))
    assert planes is not None
    inner = math.cos(math.pi / corners)
    for a, b, c in planes.tolist():
        assert a * middle[0] + b * middle[1] - c == pytest.approx(inner)


def test_a_corner_twice_is_no_fence() -> None:
    assert fence_planes(((0.0, 0.0), (1.0, 0.0), (1.0, 0.0), (0.0, 1.0))) is None


# ---------------------------------------------------------------- routes as records


def wall(count: int) -> tuple[Any, Any]:
    return np.stack((np.full(count, 2.0), 0.2 * np.arange(count)), axis=1), np.full(count, 0.3)


def test_a_route_is_told_piece_by_piece() -> None:
    # A disc that is not in the way, then the one that is passed: 3 of radius, 1 off the way.
    centres, radii = np.array(((40.0, 40.0), (0.0, -1.0))), np.array((1.0, 3.0))
    for found in (
        shortest_path((-5.0, 0.0), (5.0, 0.0), centres, radii),
        route_among((-5.0, 0.0), (5.0, 0.0), Discs.of(centres, radii)),
    ):
        assert isinstance(found, Route)
        turn = math.pi - 2.0 * math.acos(3.0 / math.sqrt(26.0)) - 2.0 * math.atan2(1.0, 5.0)
        first, arc, last = found.pieces
        assert isinstance(first, Segment)
        assert isinstance(arc, Arc)
        assert isinstance(last, Segment)
        assert (first.start, last.end) == ((-5.0, 0.0), (5.0, 0.0))
        assert arc.start == pytest.approx(first.end)
        assert arc.end == pytest.approx(last.start)
        assert (arc.centre, arc.radius_m, arc.disc) == ((0.0, -1.0), 3.0, 1)
        assert arc.sweep_rad == pytest.approx(-turn)
        assert first.length_m == pytest.approx(math.sqrt(17.0))
        assert found.length_m == pytest.approx(2.0 * math.sqrt(17.0) + 3.0 * turn)
        assert (found.active, found.rounds) == ((1,), 1)


def test_the_first_disc_is_one_too() -> None:
    found = shortest_path((-5.0, 0.0), (5.0, 0.0), np.array(((0.0, 1.0),)), np.array((3.0,)))
    assert isinstance(found, Route)
    assert [getattr(piece, "disc", None) for piece in found.pieces] == [None, 0, None]


@pytest.mark.parametrize(
    ("start", "goal", "reason", "certificate"),
    [
        ((2.0, 0.05), (9.0, 9.0), NoRouteReason.START_INSIDE, (0,)),
        ((9.0, 9.0), (2.0, 0.85), NoRouteReason.GOAL_INSIDE, (3,)),
    ],
)
def test_a_reason_comes_with_the_disc_that_proves_it(
    start: Point, goal: Point, reason: NoRouteReason, certificate: tuple[int, ...]
) -> None:
    centres, radii = wall(5)
    assert shortest_path(start, goal, centres, radii) == NoRoute(reason, certificate)
    assert route_among(start, goal, Discs.of(centres, radii)) == NoRoute(reason, certificate)


def test_a_closed_way_and_too_many_discs_are_told_apart() -> None:
    centres, radii = wall(21)
    planes = fence_planes(((0.0, -0.1), (4.0, -0.1), (4.0, 4.1), (0.0, 4.1)))
    assert planes is not None
    closed = shortest_path((0.5, 2.0), (3.5, 2.0), centres, radii, planes)
    assert isinstance(closed, NoRoute)
    assert closed.reason is NoRouteReason.CLOSED
    among = route_among((0.5, 2.0), (3.5, 2.0), Discs.of(centres, radii), planes)
    assert isinstance(among, NoRoute)
    assert among.reason is NoRouteReason.CLOSED
    many = shortest_path((0.5, 2.0), (3.5, 2.0), centres, radii, NO_PLANES, 2)
    assert isinstance(many, NoRoute)
    assert many.reason is NoRouteReason.TOO_MANY
    many = route_among((0.5, 2.0), (3.5, 2.0), Discs.of(centres, radii), active_max=2)
    assert isinstance(many, NoRoute)
    assert many.reason is NoRouteReason.TOO_MANY


def test_a_route_that_cannot_be_shorter_than_asked_for_is_beaten() -> None:
    # The way round is 10.8 m long; the straight line 10 m.
    centres, radii = np.array(((0.0, -1.0),)), np.array((3.0,))
    discs = Discs.of(centres, radii)
    free = route_among((-5.0, 0.0), (5.0, 0.0), discs)
    assert isinstance(free, Route)
    for limit_m, found in ((free.length_m + 1e-3, True), (free.length_m - 1e-3, False)):
        again = route_among((-5.0, 0.0), (5.0, 0.0), discs, limit_m=limit_m)
        if found:
            assert again == free
        else:
            assert isinstance(again, NoRoute)
            assert again.reason is NoRouteReason.BEATEN


def test_discs_to_begin_with_do_not_change_the_answer() -> None:
    centres, radii = wall(21)
    discs = Discs.of(centres, radii)
    plain = route_among((0.5, 2.1), (3.5, 2.0), discs)
    seeded = route_among((0.5, 2.1), (3.5, 2.0), discs, seeds=np.array((0, 20)))
    assert isinstance(plain, Route)
    assert isinstance(seeded, Route)
    assert seeded.length_m == pytest.approx(plain.length_m)


def test_discs_know_the_widest_of_them() -> None:
    centres, radii = np.array(((0.0, 0.0), (1.0, 0.0))), np.array((0.2, 0.7))
    assert Discs.of(centres, radii).squares[0][5] == 0.7
    assert Discs.of(centres[:0], radii[:0]).squares[0][5] == 0.0


def test_four_hundred_discs_may_matter_when_nothing_else_is_said() -> None:
    # Its table has (2 (400 + 2))^2 rows of 72 bytes: 47 MB.
    assert ACTIVE_MAX == 400
    assert NO_PLANES.shape == (0, 3)
    assert {kernels.CLOSED, kernels.TOO_MANY, kernels.START_INSIDE, kernels.GOAL_INSIDE} == {
        1,
        2,
        3,
        4,
    }
