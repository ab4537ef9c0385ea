import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from autonomy.geometry import Point, distance, segment_distance
from autonomy.t3drm.spherical import (
    Arc,
    NoRoute,
    NoRouteReason,
    Route,
    fence_planes,
    shortest_path,
    tangent_cone,
    tangents_from,
    touch_angle,
)
from tests.support.tangent_graph import shortest_length

Floats = NDArray[np.float64]


def rows(*points: Point) -> Floats:
    return np.array(points, dtype=np.float64).reshape(-1, 2)


def in_a_disc(point: Point, centres: Floats, radii: Floats) -> bool:
    away = np.hypot(centres[:, 0] - point[0], centres[:, 1] - point[1])
    return bool((away < radii).any())


def assert_agrees(start: Point, goal: Point, centres: Floats, radii: Floats) -> None:
    """The lazy search and brute force find the same length, or both nothing."""
    found = shortest_path(start, goal, centres, radii)
    if in_a_disc(start, centres, radii):
        assert isinstance(found, NoRoute)
        assert found.reason is NoRouteReason.START_INSIDE
        return
    if in_a_disc(goal, centres, radii):
        assert isinstance(found, NoRoute)
        assert found.reason is NoRouteReason.GOAL_INSIDE
        return
    expected = shortest_length(start, goal, centres, radii)
    if expected is None:
        assert isinstance(found, NoRoute)
        assert found.reason is NoRouteReason.CLOSED
        assert_closes(start, goal, centres, radii, found.certificate)
        return
    assert isinstance(found, Route)
    assert found.length_m == pytest.approx(expected, abs=2e-6)
    assert_continuous_and_free(found, start, goal, centres, radii)


def assert_closes(
    start: Point, goal: Point, centres: Floats, radii: Floats, certificate: tuple[int, ...]
) -> None:
    kept = list(certificate)
    assert shortest_length(start, goal, centres[kept], radii[kept]) is None


def assert_continuous_and_free(
    route: Route, start: Point, goal: Point, centres: Floats, radii: Floats
) -> None:
    assert route.pieces[0].start == start
    assert route.pieces[-1].end == goal
    for before, after in pairwise(route.pieces):
        assert distance(before.end, after.start) < 1e-6
    for piece in route.pieces:
        ends = piece.polyline(1e-4) if isinstance(piece, Arc) else (piece.start, piece.end)
        for centre, radius in zip(centres.tolist(), radii.tolist(), strict=True):
            for a, b in pairwise(ends):
                assert segment_distance((centre[0], centre[1]), a, b) >= radius - 1.1e-4


@st.composite
def random_discs(draw: st.DrawFn) -> tuple[Floats, Floats]:
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    n = draw(st.integers(0, 12))
    equal = draw(st.booleans())
    radii = np.full(n, 0.4) if equal else rng.uniform(0.1, 0.8, n)
    return rng.uniform(0.0, 4.0, (n, 2)), radii


@st.composite
def lattice_discs(draw: st.DrawFn) -> tuple[Floats, Floats]:
    """Touching, collinear, overlapping, contained: everything that rounding could break."""
    cells = draw(st.sets(st.tuples(st.integers(0, 5), st.integers(0, 5)), min_size=1, max_size=12))
    centres = 0.5 * np.array(sorted(cells), dtype=np.float64)
    if draw(st.booleans()):
        # Off the axes, rounding decides on which side of a tie two equal tangents fall.
        turn = draw(st.floats(-0.3, 0.3))
        c, s = math.cos(turn), math.sin(turn)
        centres = centres @ np.array(((c, s), (-s, c)))
    sizes = st.sampled_from([0.2, 0.25, 0.3, 0.5]) if draw(st.booleans()) else st.just(0.25)
    return centres, np.array([draw(sizes) for _ in cells])


@st.composite
def studded_discs(draw: st.DrawFn) -> tuple[Floats, Floats]:
    """A large disc with small ones on its rim: the way round it is barred in places."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    n = draw(st.integers(1, 6))
    turn = rng.uniform(0.0, math.tau, n)
    rim = np.stack((2.0 + 1.2 * np.cos(turn), 2.0 + 1.2 * np.sin(turn)), axis=1)
    centres = np.concatenate((np.array([(2.0, 2.0)]), rim))
    return centres, np.concatenate(((1.2,), rng.uniform(0.05, 0.3, n)))


places = st.tuples(st.floats(-1.0, 5.0), st.floats(-1.0, 5.0))


@settings(deadline=None, max_examples=120)
@given(random_discs(), places, places)
def test_the_route_is_the_shortest_among_random_discs(
    discs: tuple[Floats, Floats], start: Point, goal: Point
) -> None:
    assert_agrees(start, goal, *discs)


@settings(deadline=None, max_examples=120)
@given(lattice_discs(), st.floats(-1.0, 5.0), st.floats(-1.0, 5.0))
def test_the_route_is_the_shortest_among_touching_and_collinear_discs(
    discs: tuple[Floats, Floats], start_east: float, goal_east: float
) -> None:
    assert_agrees((-1.0, start_east), (5.0, goal_east), *discs)


@settings(deadline=None, max_examples=120)
@given(studded_discs(), st.floats(0.0, math.tau), st.floats(0.0, math.tau))
def test_the_route_is_the_shortest_round_a_studded_disc(
    discs: tuple[Floats, Floats], start_rad: float, goal_rad: float
) -> None:
    start = (2.0 + 1.6 * math.cos(start_rad), 2.0 + 1.6 * math.sin(start_rad))
    goal = (2.0 + 1.6 * math.cos(goal_rad), 2.0 + 1.6 * math.sin(goal_rad))
    if distance(start, goal) > 1e-3:
        assert_agrees(start, goal, *discs)


@settings(deadline=None, max_examples=60)
@given(st.integers(0, 5), st.floats(0.0, math.tau), st.floats(0.2, 0.35), st.floats(-1.0, 5.0))
def test_the_way_out_of_a_ring_with_a_gap_is_found(
    missing: int, turn: float, radius: float, goal_east: float
) -> None:
    angles = turn + np.linspace(0.0, math.tau, 14, endpoint=False)
    centres = np.stack((2.0 + 1.2 * np.cos(angles), 2.0 + 1.2 * np.sin(angles)), axis=1)[missing:]
    assert_agrees((2.0, 2.0), (5.0, goal_east), centres, np.full(len(centres), radius))


def test_a_long_wall_is_rounded_at_its_end_in_few_rounds() -> None:
    wall = np.stack((np.full(121, 2.0), np.linspace(-1.0, 2.0, 121)), axis=1)
    found = shortest_path((0.0, 0.0), (4.0, 0.0), wall, np.full(121, 0.2))
    assert isinstance(found, Route)
    assert found.rounds <= 6
    # Two tangents to the disc at its end and what is left of the outer angle between them.
    outer = math.tau - (math.pi - 2.0 * math.atan2(1.0, 2.0))
    arc = 0.2 * (outer - 2.0 * math.acos(0.2 / math.sqrt(5.0)))
    assert found.length_m == pytest.approx(2.0 * math.sqrt(5.0 - 0.04) + arc, abs=1e-9)


def test_without_discs_the_route_is_straight() -> None:
    found = shortest_path((0.0, 0.0), (3.0, 4.0), np.empty((0, 2)), np.empty(0))
    assert isinstance(found, Route)
    assert found.length_m == 5.0
    assert found.rounds == 0


def test_a_gap_of_exactly_both_radii_is_passable_and_a_smaller_one_is_not() -> None:
    for offset, passes in ((0.5, True), (0.5 - 1e-5, False)):
        centres = rows((0.0, offset), (0.0, -offset))
        found = shortest_path((-2.0, 0.0), (2.0, 0.0), centres, np.full(2, 0.5))
        assert isinstance(found, Route)
        assert (found.length_m == pytest.approx(4.0)) is passes


def test_a_start_on_a_disc_is_free() -> None:
    found = shortest_path((0.0, 0.0), (3.0, 0.0), rows((0.5, 0.0)), np.array([0.5]))
    assert isinstance(found, Route)
    # A quarter of the circle, then a tangent of sqrt(2.5^2 - 0.5^2) from the goal.
    assert found.length_m > 3.0
    assert found.length_m == pytest.approx(
        shortest_length((0.0, 0.0), (3.0, 0.0), rows((0.5, 0.0)), np.array([0.5])), abs=1e-5
    )


def test_more_active_discs_than_allowed_prove_nothing() -> None:
    wall = np.stack((np.full(61, 2.0), np.linspace(-3.0, 3.0, 61)), axis=1)
    found = shortest_path((0.0, 0.0), (4.0, 0.0), wall, np.full(61, 0.2), active_max=3)
    assert isinstance(found, NoRoute)
    assert found.reason is NoRouteReason.TOO_MANY


def test_inside_a_fence_a_wall_to_its_side_closes_the_way() -> None:
    wall = np.stack((np.full(41, 2.0), np.linspace(-1.0, 1.0, 41)), axis=1)
    radii = np.full(41, 0.2)
    # At 1.19 both touching points (1.17) are inside, only the arc between them (1.2) is not.
    for half_width, passes in ((1.1, False), (1.19, False), (1.3, True)):
        polygon = ((-1.0, -half_width), (5.0, -half_width), (5.0, half_width), (-1.0, half_width))
        planes = fence_planes(polygon)
        assert planes is not None
        found = shortest_path((0.0, 0.0), (4.0, 0.0), wall, radii, planes)
        assert isinstance(found, Route) is passes
        if isinstance(found, Route):
            corners = [p for piece in found.pieces for p in (piece.start, piece.end)]
            assert max(abs(east) for _, east in corners) <= half_width


def test_a_fence_is_convex_in_either_sense_or_refused() -> None:
    square = ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0))
    for ring in (square, square[::-1]):
        planes = fence_planes(ring)
        assert planes is not None
        assert (planes @ np.array((0.5, 0.5, -1.0)) > 0.0).all()
    assert fence_planes((*square, (0.5, 0.5))) is None
    assert fence_planes(((0.0, 0.0), (0.0, 0.0), (1.0, 1.0))) is None


@given(places, st.floats(0.1, 1.0))
def test_tangents_touch_at_right_angles(point: Point, radius: float) -> None:
    centre = (7.0, 2.0)
    tangents = tangents_from(point, centre, radius)
    for touch in (tangents.left, tangents.right):
        assert distance(touch, centre) == pytest.approx(radius)
        assert distance(touch, point) == pytest.approx(tangents.length_m)
        along = (touch[0] - point[0], touch[1] - point[1])
        out = (touch[0] - centre[0], touch[1] - centre[1])
        assert along[0] * out[0] + along[1] * out[1] == pytest.approx(0.0, abs=1e-9)
        assert math.sin(tangents.touch_angle_rad) == pytest.approx(radius / distance(point, centre))


def test_a_point_inside_a_sphere_has_no_tangents() -> None:
    with pytest.raises(ValueError, match="inside the sphere"):
        touch_angle(1.0, 0.5)


@given(st.tuples(*[st.floats(-2.0, 2.0)] * 3), st.floats(0.1, 1.0), st.integers(3, 12))
def test_the_cone_of_tangents_touches_the_sphere(
    offset: tuple[float, float, float], radius: float, count: int
) -> None:
    centre = (5.0 + offset[0], offset[1], offset[2])
    for touch in tangent_cone((0.0, 0.0, 0.0), centre, radius, count):
        assert math.dist(touch, centre) == pytest.approx(radius)
        out = [t - c for t, c in zip(touch, centre, strict=True)]
        assert sum(t * o for t, o in zip(touch, out, strict=True)) == pytest.approx(0.0, abs=1e-9)


def test_the_cone_exists_straight_above_and_begins_in_the_plane_elsewhere() -> None:
    above = tangent_cone((0.0, 0.0, 0.0), (0.0, 0.0, -5.0), 3.0, 4)
    assert all(point[2] == pytest.approx(-3.2) for point in above)
    assert tangent_cone((0.0, 0.0, 0.0), (5.0, 0.0, 0.0), 3.0, 4)[0] == pytest.approx(
        (3.2, 2.4, 0.0)
    )


@given(st.floats(0.05, 1.0), st.floats(-6.0, 6.0), st.floats(1e-4, 1e-2))
def test_an_arcs_polyline_never_enters_its_disc(
    radius: float, sweep: float, sagitta: float
) -> None:
    start = (radius, 0.0)
    end = (radius * math.cos(sweep), radius * math.sin(sweep))
    arc = Arc(start, end, (0.0, 0.0), radius, sweep, 0)
    points = arc.polyline(sagitta)
    assert points[0] == start
    assert points[-1] == end
    for a, b in pairwise(points):
        assert segment_distance((0.0, 0.0), a, b) >= radius - 1e-9
    assert all(math.hypot(*p) <= radius + sagitta + 1e-9 for p in points)
