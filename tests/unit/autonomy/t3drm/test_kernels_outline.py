"""Hulls, smallest circles and the numbers that describe a component, worked out by hand."""

import itertools
import math

import numpy as np
import pytest

from autonomy.t3drm import kernels
from autonomy.t3drm.kernels import Floats

Circle = tuple[float, float, float]


def points(*rows: tuple[float, float]) -> Floats:
    return np.array(rows, dtype=np.float64).reshape(-1, 2)


def everyone(count: int) -> "np.typing.NDArray[np.int64]":
    return np.arange(count, dtype=np.int64)


def lattices(seed: int, count: int, side: int, most: int) -> list[Floats]:
    """Few places, hence many ties, equal points and points in a row."""
    rng = np.random.default_rng(seed)
    sizes = rng.integers(1, most + 1, count)
    return [rng.integers(0, side, (size, 2)).astype(np.float64) for size in sizes]


def turn(o: Floats, a: Floats, b: Floats) -> float:
    return float((a[0] - o[0]) * (b[1] - o[1]) - (a[1] - o[1]) * (b[0] - o[0]))


# ---------------------------------------------------------------- hull


def test_the_hull_of_a_square_with_points_on_its_sides_is_its_corners_from_north_to_east() -> None:
    square = points((1, 1), (2, 0), (2, 2), (0, 2), (1, 0), (0, 0), (1, 2), (0, 1), (2, 1))
    assert kernels.convex_hull(square).tolist() == [5, 1, 2, 3]


@pytest.mark.parametrize(
    ("rows", "hull"),
    [
        (((3, 1),), [0]),
        (((3, 1), (2, 7)), [1, 0]),
        (((2, 7), (2, 5)), [1, 0]),
        (((1, 1), (1, 1), (1, 1)), [0]),
        (((0, 0), (1, 1), (2, 2), (3, 3)), [0, 3]),
        (((0, 3), (0, 1), (0, 2), (0, 0)), [3, 0]),
        (((4, 0), (3, 0), (5, 0)), [1, 2]),
        (((0, 0), (0, 1), (1, 0)), [0, 2, 1]),
        (((0, 0), (0, 1), (0, 1), (1, 0), (1, 0)), [0, 3, 1]),
    ],
)
def test_the_hull_of_few_equal_or_aligned_points(
    rows: tuple[tuple[float, float], ...], hull: list[int]
) -> None:
    cloud = points(*rows)
    found = kernels.convex_hull(cloud)
    places = list(dict.fromkeys(tuple(place) for place in cloud[found].tolist()))
    assert places == [tuple(place) for place in cloud[hull].tolist()]


@pytest.mark.parametrize("cloud", lattices(1, 60, 4, 9))
def test_every_point_is_inside_a_hull_that_turns_one_way_only(cloud: Floats) -> None:
    hull = cloud[kernels.convex_hull(cloud)]
    assert len({tuple(row) for row in hull.tolist()}) == len(hull) or len(hull) == 2
    if len(hull) > 2:
        for k in range(len(hull)):
            assert turn(hull[k - 2], hull[k - 1], hull[k]) > 0.0
            assert all(turn(hull[k - 1], hull[k], p) >= 0.0 for p in cloud)
    else:
        ends = hull[[0, -1]]
        assert all(turn(ends[0], ends[1], p) == 0.0 for p in cloud)
        spread = math.dist(ends[0], ends[1])
        assert max(math.dist(a, b) for a in cloud for b in cloud) == pytest.approx(spread)


# ---------------------------------------------------------------- circle


@pytest.mark.parametrize(
    ("rows", "circle"),
    [
        (((3.0, 1.0),), (3.0, 1.0, 0.0)),
        (((1.0, 1.0), (4.0, 5.0)), (2.5, 3.0, 2.5)),
        # A right angle: the circle on the long side; an obtuse one likewise.
        (((0.0, 0.0), (3.0, 0.0), (0.0, 4.0)), (1.5, 2.0, 2.5)),
        (((0.0, 0.0), (8.0, 0.0), (4.0, 1.0)), (4.0, 0.0, 4.0)),
        # Acute: through all three. (0, 0), (8, 0), (4, 8): centre (4, 3).
        (((0.0, 0.0), (8.0, 0.0), (4.0, 8.0)), (4.0, 3.0, 5.0)),
        (((10.0, 20.0), (14.0, 28.0), (18.0, 20.0)), (14.0, 23.0, 5.0)),
        # In a row, in any order; equal points.
        (((0.0, 0.0), (1.0, 1.0), (4.0, 4.0)), (2.0, 2.0, 2.0 * math.sqrt(2.0))),
        (((4.0, 4.0), (1.0, 1.0), (0.0, 0.0)), (2.0, 2.0, 2.0 * math.sqrt(2.0))),
        (((1.0, 1.0), (4.0, 4.0), (0.0, 0.0)), (2.0, 2.0, 2.0 * math.sqrt(2.0))),
        (((2.0, 2.0), (2.0, 2.0)), (2.0, 2.0, 0.0)),
        # Near each other; and the first where the second's coordinates are equal.
        (((2.0, 2.0), (2.5, 2.0)), (2.25, 2.0, 0.25)),
        (((3.0, 3.0), (3.0, 7.0)), (3.0, 5.0, 2.0)),
        (((7.0, 7.0), (3.0, 7.0)), (5.0, 7.0, 2.0)),
        (((0.0, 0.0), (0.08, 0.0), (0.04, 0.08)), (0.04, 0.03, 0.05)),
    ],
)
def test_the_smallest_circle(rows: tuple[tuple[float, float], ...], circle: Circle) -> None:
    assert kernels.enclosing_circle(points(*rows)) == pytest.approx(circle, abs=1e-12)


def smallest(cloud: Floats) -> float:
    """Radius by brute force: the smallest circle of two or three points that holds all."""
    best = math.inf if len(cloud) > 1 else 0.0
    rows = [tuple(row) for row in cloud.tolist()]
    candidates = [((a[0] + b[0]) / 2, (a[1] + b[1]) / 2) for a, b in itertools.product(rows, rows)]
    for a, b, c in itertools.combinations(rows, 3):
        det = 2.0 * turn(np.array(a), np.array(b), np.array(c))
        if det != 0.0:
            squares = [x * x + y * y for x, y in (a, b, c)]
            north = sum(
                s * (p[1] - q[1]) for s, p, q in zip(squares, (b, c, a), (c, a, b), strict=True)
            )
            east = sum(
                s * (q[0] - p[0]) for s, p, q in zip(squares, (b, c, a), (c, a, b), strict=True)
            )
            candidates.append((north / det, east / det))
    for candidate in candidates:
        best = min(best, max(math.dist(candidate, row) for row in rows))
    return best


@pytest.mark.parametrize("cloud", lattices(2, 40, 6, 7))
def test_no_circle_around_all_points_is_smaller(cloud: Floats) -> None:
    north, east, radius = kernels.enclosing_circle(cloud)
    assert max(math.dist((north, east), p) for p in cloud) <= radius + 1e-9
    assert radius == pytest.approx(smallest(cloud), abs=1e-9)


@pytest.mark.parametrize("order", list(itertools.permutations(range(3))))
def test_a_circle_through_three_points_in_a_row_is_the_one_on_the_longest_side(
    order: tuple[int, ...],
) -> None:
    row = points((0.0, 0.0), (1.0, 2.0), (3.0, 6.0))[list(order)]
    circle = kernels._circle_of_three(row[0], row[1], row[2])
    assert circle == pytest.approx((1.5, 3.0, 0.5 * math.sqrt(45.0)))


def test_what_is_on_a_circle_is_not_outside_of_it() -> None:
    circle = (1.0, 2.0, 5.0)
    assert not kernels._outside(circle, np.array((4.0, 6.0)))
    assert not kernels._outside(circle, np.array((4.0, 6.0 + 4e-12)))
    assert kernels._outside(circle, np.array((4.0, 6.0 + 1e-10)))
    edge = 5.0 * (1.0 + 1e-12) + 1e-12
    assert not kernels._outside((0.0, 0.0, 5.0), np.array((edge, 0.0)))
    assert kernels._outside((0.0, 0.0, 5.0), np.array((math.nextafter(edge, 9.0), 0.0)))
    assert not kernels._outside((1.0, 2.0, 0.0), np.array((1.0, 2.0)))


# ---------------------------------------------------------------- regularity, linearity


@pytest.mark.parametrize(
    ("edges", "members", "longest", "expected"),
    [
        # Edges 1 and 3: mean 2, deviation 1; the one of 9 is as long as what does not join.
        ((1.0, 3.0, 9.0), (0, 1, 2), 9.0, 1.0 / 1.5),
        ((1.0, 3.0, 9.0), (0, 1, 2), 9.5, 1.0 / (1.0 + math.sqrt(104.0 / 9.0) / (13.0 / 3.0))),
        ((1.0, 3.0, 9.0), (0, 1), 20.0, 1.0 / 1.5),
        ((0.1, 0.1, 0.1), (0, 1, 2), 1.0, 1.0),
        ((0.0, 0.0), (0, 1), 1.0, 1.0),
        ((4.0, 5.0), (0, 1), 4.0, 0.0),
        ((4.0, 5.0), (), 9.0, 0.0),
        ((4.0,), (0,), 9.0, 1.0),
    ],
)
def test_regularity_is_one_over_one_plus_the_variation_of_the_edges(
    edges: tuple[float, ...], members: tuple[int, ...], longest: float, expected: float
) -> None:
    found = kernels.regularity(np.array(edges), np.array(members, dtype=np.int64), longest)
    assert found == pytest.approx(expected)


@pytest.mark.parametrize("turned_deg", [0.0, 30.0, 90.0, 200.0])
def test_a_rectangle_is_described_by_its_circle_and_its_variances(turned_deg: float) -> None:
    # Corners (+-4, +-2): variances 16 and 4, hence 1 - 4 / 16; the circle's radius sqrt(20).
    c, s = math.cos(math.radians(turned_deg)), math.sin(math.radians(turned_deg))
    corners = [(4.0, 2.0), (-4.0, 2.0), (-4.0, -2.0), (4.0, -2.0)]
    cloud = points(*((10.0 + n * c - e * s, -5.0 + n * s + e * c) for n, e in corners))
    hull, north, east, radius, linearity = kernels.describe(cloud, everyone(4))
    assert (north, east, radius) == pytest.approx((10.0, -5.0, math.sqrt(20.0)))
    assert linearity == pytest.approx(0.75)
    assert sorted(hull.tolist()) == [0, 1, 2, 3]


def test_only_the_members_are_described_and_by_their_own_numbers() -> None:
    cloud = points((9.0, 9.0), (0.0, 0.0), (-7.0, 3.0), (2.0, 0.0), (1.0, 0.0))
    hull, north, east, radius, linearity = kernels.describe(cloud, np.array((1, 3, 4)))
    assert hull.tolist() == [1, 3]
    assert (north, east, radius) == (1.0, 0.0, 1.0)
    assert linearity == 1.0


def test_one_two_and_equal_members() -> None:
    cloud = points((9.0, 8.0), (3.0, 4.0), (3.0, 4.0), (3.3, 4.4))
    hull, *rest = kernels.describe(cloud, np.array((1,)))
    assert (hull.tolist(), rest) == ([1], [3.0, 4.0, 0.0, 0.0])
    hull, *rest = kernels.describe(cloud, np.array((1, 3)))
    assert hull.tolist() == [1, 3]
    assert rest == pytest.approx([3.15, 4.2, 0.25, 1.0])
    _, *rest = kernels.describe(cloud, np.array((1, 2)))
    assert rest == [3.0, 4.0, 0.0, 0.0]


def test_a_small_rectangle_has_the_same_linearity() -> None:
    cloud = points((0.04, 0.02), (-0.04, 0.02), (-0.04, -0.02), (0.04, -0.02))
    assert kernels.describe(cloud, everyone(4))[4] == pytest.approx(0.75)


def test_one_point_and_a_cross_have_no_direction() -> None:
    cloud = points((1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0))
    assert kernels.describe(cloud, everyone(4))[4] == 0.0
    assert kernels.describe(cloud, everyone(1))[4] == 0.0


# ---------------------------------------------------------------- components


def test_members_come_by_label_and_in_their_order() -> None:
    members, first = kernels.by_label(np.array((2, 0, 2, 3, 0, 2)), 4)
    assert members.tolist() == [1, 4, 0, 2, 5, 3]
    assert first.tolist() == [0, 2, 2, 5, 6]
    none, nothing = kernels.by_label(np.empty(0, dtype=np.int64), 0)
    assert (none.tolist(), nothing.tolist()) == ([], [0])


def test_outlines_come_component_by_component() -> None:
    cloud = points((0, 0), (4, 2), (9, 9), (0, 2), (4, 0), (2, 1))
    members, first = np.array((0, 1, 3, 4, 5, 2)), np.array((0, 5, 6))
    hulls, corner, rows = kernels.outlines(cloud, members, first)
    assert hulls.tolist() == [0, 4, 1, 3, 2]
    assert corner.tolist() == [0, 4, 5]
    # Variances 16 and 4 of the rectangle's corners.
    assert rows.tolist() == [
        pytest.approx([2.0, 1.0, math.sqrt(5.0), 0.75]),
        [9.0, 9.0, 0.0, 0.0],
    ]


def test_a_death_is_half_of_the_shortest_edge_to_another_component() -> None:
    # A chain of six points, joined below 0.4: (0, 1, 2), (3, 4), (5).
    parent = np.array((-1, 0, 1, 2, 3, 4))
    edges = np.array((math.inf, 0.1, 0.3, 0.5, 0.2, 0.4))
    labels = np.array((0, 0, 0, 1, 1, 2))
    rows = kernels.regularities_and_deaths(
        parent, edges, labels, np.arange(6), np.array((0, 3, 5, 6)), 0.4
    )
    # Edges 0.1 and 0.3: mean 0.2, deviation 0.1; 0.2 alone; none.
    assert rows[:, 0].tolist() == pytest.approx([1.0 / 1.5, 1.0, 0.0])
    assert rows[:, 1].tolist() == pytest.approx([0.25, 0.2, 0.2])
    alone = kernels.regularities_and_deaths(
        parent[:2], edges[:2], labels[:2], np.arange(2), np.array((0, 2)), 0.4
    )
    assert alone.tolist() == [[1.0, math.inf]]
