import math
from itertools import pairwise

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from autonomy.geometry import Point, distance, segment_distance
from autonomy.t3drm.hyperbolic import SAGITTA_M, FlyBy, fly_by, inside_hull, support_vertices

SQUARE: tuple[Point, ...] = ((1.0, -1.0), (3.0, -1.0), (3.0, 1.0), (1.0, 1.0))

distances = st.floats(0.5, 6.0)


@settings(deadline=None)
@given(
    distances, distances, st.floats(0.0, math.tau), st.floats(0.1, 0.4), st.sampled_from([1, -1])
)
def test_a_conic_exists_exactly_when_the_straight_way_is_too_near(
    to_drone: float, to_goal: float, sweep: float, periapsis: float, sense: int
) -> None:
    needed = math.acos(periapsis / to_drone) + math.acos(periapsis / to_goal)
    assume(abs(sweep - needed) > 1e-6)
    assume(sweep < math.pi)
    vertex = (1.0, -2.0)
    drone = (vertex[0] + to_drone, vertex[1])
    goal = (
        vertex[0] + to_goal * math.cos(sense * sweep),
        vertex[1] + to_goal * math.sin(sense * sweep),
    )
    conic = fly_by(drone, goal, vertex, periapsis, sense)
    assert (conic is not None) == (sweep > needed)
    if conic is None:
        return
    assert conic.points[0] == drone
    assert conic.points[-1] == goal
    # Focal polar form: every point has r (1 + e cos nu) = p, the closest one is the periapsis.
    p = periapsis * (1.0 + conic.eccentricity)
    assert distance(conic.closest, vertex) == pytest.approx(periapsis)
    axis = math.atan2(conic.closest[1] - vertex[1], conic.closest[0] - vertex[0])
    for point in conic.points:
        nu = math.atan2(point[1] - vertex[1], point[0] - vertex[0]) - axis
        assert distance(point, vertex) * (1.0 + conic.eccentricity * math.cos(nu)) == pytest.approx(
            p, rel=1e-6
        )
    nearest = min(segment_distance(vertex, a, b) for a, b in pairwise(conic.points))
    assert periapsis - 1e-3 <= nearest <= periapsis + 1e-3
    assert conic.length_m >= distance(drone, goal)


def test_the_conic_is_gentler_than_the_arc_and_hardly_longer() -> None:
    conic = fly_by((-3.0, 0.1), (3.0, 0.1), (0.0, 0.0), 0.2, -1)
    assert conic is not None
    assert conic.curvature_radius_m > 2.0 * 0.2
    tangent = math.sqrt(9.01 - 0.04)
    turned = 2.0 * (math.pi / 2 - math.acos(0.2 / math.sqrt(9.01))) - 2.0 * math.atan2(0.1, 3.0)
    assert 1.0 <= conic.length_m / (2.0 * tangent + 0.2 * turned) < 1.01


def test_the_vertex_on_the_line_between_is_well_conditioned() -> None:
    conic = fly_by((-2.0, 0.0), (4.0, 0.0), (0.0, 0.0), 0.2, 1)
    assert conic is not None
    assert math.isfinite(conic.eccentricity)


def test_the_sense_chooses_the_side() -> None:
    one = fly_by((-3.0, 0.0), (3.0, 0.0), (0.0, 0.0), 0.2, 1)
    other = fly_by((-3.0, 0.0), (3.0, 0.0), (0.0, 0.0), 0.2, -1)
    assert one is not None
    assert other is not None
    assert one.closest[1] == pytest.approx(-other.closest[1])
    assert one.closest[1] < 0.0


def test_inside_the_periapsis_circle_there_is_no_conic() -> None:
    assert fly_by((-0.1, 0.0), (3.0, 0.0), (0.0, 0.0), 0.2, 1) is None


@pytest.mark.parametrize(("drone_north", "goal_north"), [(-0.2, 3.0), (-3.0, 0.2)])
def test_on_the_periapsis_circle_there_is_no_conic(drone_north: float, goal_north: float) -> None:
    assert fly_by((drone_north, 0.0), (goal_north, 0.0), (0.0, 0.0), 0.2, 1) is None
    outside = (drone_north * 1.001, 0.0), (goal_north * 1.001, 0.0)
    assert fly_by(*outside, (0.0, 0.0), 0.2, 1) is not None


def turned(point: Point, angle_rad: float, about: Point = (0.0, 0.0)) -> Point:
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    n, e = point[0] - about[0], point[1] - about[1]
    return about[0] + c * n - s * e, about[1] + s * n + c * e


@pytest.mark.parametrize("sweep_deg", [160.0, 180.0, 200.0, 300.0])
@pytest.mark.parametrize("sense", [1, -1])
@pytest.mark.parametrize("begin_deg", [0.0, 100.0, 190.0, 260.0])
def test_a_symmetric_fly_by_in_every_direction(
    begin_deg: float, sense: int, sweep_deg: float
) -> None:
    vertex = (4.0, -7.0)
    half = math.radians(0.5 * sweep_deg)
    begin = math.radians(begin_deg)
    drone = turned((6.0, -7.0), begin, vertex)
    goal = turned((6.0, -7.0), begin + sense * 2.0 * half, vertex)
    conic = fly_by(drone, goal, vertex, 0.5, sense)
    assert conic is not None
    # p / 2 = 1 + e cos(half), p = (1 + e) / 2.
    assert conic.eccentricity == pytest.approx(0.75 / (0.25 - math.cos(half)))
    closest = turned((4.5, -7.0), begin + sense * half, vertex)
    assert conic.closest == pytest.approx(closest)
    assert conic.points[0] == drone
    assert conic.points[-1] == goal
    assert (conic.focus, conic.periapsis_m) == (vertex, 0.5)
    assert conic.length_m == pytest.approx(sum(distance(a, b) for a, b in pairwise(conic.points)))
    # Bearings from the vertex go one way only, and no point comes twice.
    steps = [
        sense
        * (
            math.atan2(b[1] - vertex[1], b[0] - vertex[0])
            - math.atan2(a[1] - vertex[1], a[0] - vertex[0])
        )
        % math.tau
        for a, b in pairwise(conic.points)
    ]
    assert all(1e-4 < step < 0.6 for step in steps)
    assert sum(steps) == pytest.approx(2.0 * half)


@pytest.mark.parametrize(
    ("drone", "goal", "periapsis_m"),
    [
        ((-3.0, 0.1), (5.0, 0.3), 0.2),
        ((-0.3, 0.1), (0.4, 0.1), 0.2),
        ((-1.0, 0.0), (9.0, 1.0), 0.4),
    ],
)
def test_chords_stay_within_half_a_millimetre_of_the_conic(
    drone: Point, goal: Point, periapsis_m: float
) -> None:
    conic = fly_by(drone, goal, (0.0, 0.0), periapsis_m, -1)
    assert conic is not None
    p = periapsis_m * (1.0 + conic.eccentricity)
    axis = math.atan2(conic.closest[1], conic.closest[0])
    for a, b in pairwise(conic.points):
        nu_a, nu_b = math.atan2(a[1], a[0]) - axis, math.atan2(b[1], b[0]) - axis
        away = 0.0
        for share in (0.3, 0.4, 0.5, 0.6, 0.7):
            nu = nu_a + share * ((nu_b - nu_a + math.pi) % math.tau - math.pi)
            r = p / (1.0 + conic.eccentricity * math.cos(nu))
            on = (r * math.cos(nu + axis), r * math.sin(nu + axis))
            away = max(away, segment_distance(on, a, b))
        assert away <= 1.1 * SAGITTA_M
    assert SAGITTA_M == 0.0005


def test_near_the_obstacle_the_conic_is_an_ellipse() -> None:
    conic = fly_by((-0.25, 0.05), (0.25, 0.05), (0.0, 0.0), 0.2, -1)
    assert conic is not None
    assert 0.0 < conic.eccentricity < 1.0
    assert not conic.is_hyperbola


@pytest.mark.parametrize(
    ("eccentricity", "hyperbola"), [(0.4, False), (1.0, False), (1.0 + 1e-9, True), (1.6, True)]
)
def test_a_parabola_is_no_hyperbola(eccentricity: float, *, hyperbola: bool) -> None:
    conic = FlyBy((0.0, 0.0), 0.2, eccentricity, (0.2, 0.0), ((0.0, 1.0), (1.0, 0.0)), 1.5)
    assert conic.is_hyperbola is hyperbola
    assert conic.curvature_radius_m == pytest.approx(0.2 + 0.2 * eccentricity)


def test_a_fly_by_cannot_be_changed() -> None:
    conic = fly_by((-3.0, 0.0), (3.0, 0.0), (0.0, 0.0), 0.2, 1)
    assert conic is not None
    with pytest.raises(AttributeError):
        conic.length_m = 0.0  # type: ignore[misc]  # that is the test


def test_where_the_straight_way_all_but_touches_there_is_no_conic_or_a_sane_one() -> None:
    # The straight way on that side passes at the periapsis, give or take what rounding makes of it.
    for k in range(-40, 41):
        goal = (3.0, 0.2 + k * 1e-17)
        for sense in (1, -1):
            conic = fly_by((-3.0, 0.2), goal, (0.0, 0.0), 0.2, sense)
            assert conic is None or 0.0 <= conic.eccentricity < 1e9


# ---------------------------------------------------------------- silhouettes


def test_the_silhouettes_of_a_square_are_its_near_corners() -> None:
    assert support_vertices((0.0, 0.0), SQUARE) == ((1.0, -1.0), (1.0, 1.0))


@pytest.mark.parametrize("angle_deg", range(0, 360, 20))
@pytest.mark.parametrize("drone", [(0.0, 0.0), (7.0, -4.0)])
def test_the_silhouettes_turn_with_what_is_seen(drone: Point, angle_deg: int) -> None:
    def placed(point: Point) -> Point:
        n, e = turned(point, math.radians(angle_deg))
        return n + drone[0], e + drone[1]

    assert support_vertices(drone, tuple(placed(v) for v in SQUARE)) == (
        placed((1.0, -1.0)),
        placed((1.0, 1.0)),
    )
    # A wall close by fills nearly half of the view.
    wall = (placed((0.2, -5.0)), placed((0.3, 0.0)), placed((0.2, 4.0)))
    assert support_vertices(drone, wall) == (wall[0], wall[2])


@pytest.mark.parametrize(
    ("drone", "middle"),
    [
        ((10.0, 5.0), (2.0, 1.0)),
        ((10.0, 0.0), (2.0, 0.0)),
        ((0.0, 10.0), (0.0, 2.0)),
        ((10.0, 0.0), (20.0, 0.0)),
        ((0.0, 10.0), (0.0, 20.0)),
        ((-3.0, 4.0), (-30.0, 40.0)),
    ],
)
def test_the_silhouettes_do_not_depend_on_where_the_origin_is(drone: Point, middle: Point) -> None:
    towards = math.atan2(middle[1] - drone[1], middle[0] - drone[0])
    aside = (-math.sin(towards), math.cos(towards))
    low = (middle[0] - 0.5 * aside[0], middle[1] - 0.5 * aside[1])
    high = (middle[0] + 0.5 * aside[0], middle[1] + 0.5 * aside[1])
    for hull in ((low, middle, high), (high, low, middle), (low, high)):
        assert support_vertices(drone, hull) == (low, high)


def test_from_within_a_triangle_no_silhouette_is_seen() -> None:
    triangle = ((0.0, 0.0), (4.0, 0.0), (0.0, 4.0))
    assert inside_hull((1.0, 1.0), triangle)
    assert support_vertices((1.0, 1.0), triangle) is None
    assert support_vertices((2.1, 2.1), triangle) == ((0.0, 4.0), (4.0, 0.0))


def test_the_silhouettes_do_not_depend_on_the_branch_of_the_bearing() -> None:
    turned = tuple((-n, e) for n, e in SQUARE)
    assert support_vertices((0.0, 0.0), turned) == ((-1.0, 1.0), (-1.0, -1.0))


def test_a_drone_inside_the_hull_sees_no_silhouette() -> None:
    assert support_vertices((2.0, 0.0), SQUARE) is None
    assert support_vertices((0.0, 0.0), ()) is None


def test_a_single_hit_is_both_silhouettes() -> None:
    assert support_vertices((0.0, 0.0), ((2.0, 0.5),)) == ((2.0, 0.5), (2.0, 0.5))


def test_inside_and_on_the_hull() -> None:
    assert inside_hull((2.0, 0.0), SQUARE)
    assert inside_hull((1.0, 0.0), SQUARE)
    assert not inside_hull((0.99, 0.0), SQUARE)
    assert not inside_hull((1.0, -1.0), SQUARE[:2])


@pytest.mark.parametrize("north", [0.9, 1.0, 1.1, 2.0, 2.9, 3.0, 3.1])
@pytest.mark.parametrize("east", [-1.1, -1.0, -0.9, 0.0, 0.9, 1.0, 1.1])
def test_inside_a_square_is_between_its_sides(north: float, east: float) -> None:
    assert inside_hull((north, east), SQUARE) is (1.0 <= north <= 3.0 and -1.0 <= east <= 1.0)


def test_inside_a_slanted_hull_is_on_the_left_of_all_its_sides() -> None:
    hull = ((10.0, 20.0), (14.0, 21.0), (13.0, 25.0), (9.0, 23.0))
    for point, inside in (
        ((12.0, 22.0), True),
        ((12.0, 20.6), True),
        ((12.0, 20.4), False),
        ((13.4, 23.0), True),
        ((13.6, 23.0), False),
        ((11.0, 23.9), True),
        ((11.0, 24.1), False),
        ((9.6, 21.5), True),
        ((9.4, 21.5), False),
    ):
        assert inside_hull(point, hull) is inside
