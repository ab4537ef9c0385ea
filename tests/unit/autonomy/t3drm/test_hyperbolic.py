import math
from itertools import pairwise

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from autonomy.geometry import Point, distance, segment_distance
from autonomy.t3drm.hyperbolic import fly_by, inside_hull, support_vertices

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


def test_the_silhouettes_of_a_square_are_its_near_corners() -> None:
    assert support_vertices((0.0, 0.0), SQUARE) == ((1.0, -1.0), (1.0, 1.0))


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
