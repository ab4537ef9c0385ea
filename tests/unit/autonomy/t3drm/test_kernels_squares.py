"""The spatial index against looking at everything, and at its borders."""

import math

import numpy as np
import pytest

from autonomy.t3drm import kernels
from autonomy.t3drm.kernels import Floats, Squares


def clouds(seed: int, count: int) -> list[Floats]:
    """Scattered points, points at few places, one far away, a row, none."""
    rng = np.random.default_rng(seed)
    found = [np.empty((0, 2)), np.array([[3.0, -4.0]]), np.array([[0.0, 0.0], [1e6, -1e6]])]
    for _ in range(count):
        size = int(rng.integers(1, 40))
        found.append(rng.uniform(-3.0, 5.0, (size, 2)))
        found.append(rng.integers(0, 5, (size, 2)) * 0.25 - 0.5)
        found.append(np.stack((np.full(size, 2.0), np.arange(size) * 0.3), axis=1))
    return found


CLOUDS = clouds(21, 5)


def squares_of(points: Floats) -> Squares:
    return kernels.into_squares(points, 0.3)


@pytest.mark.parametrize("points", CLOUDS)
def test_every_point_is_in_the_square_where_it_lies(points: Floats) -> None:
    box, first, items = squares_of(points)
    rows, columns = int(box[3]), int(box[4])
    assert box[5] == 0.3
    assert first.shape[0] == rows * columns + 1
    assert (first[0], first[-1]) == (0, len(points))
    assert sorted(items.tolist()) == list(range(len(points)))
    for square in range(rows * columns):
        held = items[first[square] : first[square + 1]].tolist()
        assert held == sorted(held)
        for k in held:
            row, column = (int(x) for x in (points[k] - box[:2]) / box[2])
            assert square == row * columns + column


@pytest.mark.parametrize("points", CLOUDS[1:])
def test_squares_begin_at_the_points_and_are_hardly_more_than_they(points: Floats) -> None:
    box, first, _ = squares_of(points)
    assert box[:2].tolist() == points.min(axis=0).tolist()
    wide = float((points.max(axis=0) - points.min(axis=0)).max())
    assert box[2] == pytest.approx(max(0.25, wide / (8.0 + 2.0 * math.sqrt(len(points)))))
    assert first.shape[0] - 1 <= (9.0 + 2.0 * math.sqrt(len(points))) ** 2


@pytest.mark.parametrize("points", CLOUDS)
def test_what_lies_near_is_what_lies_near(points: Floats) -> None:
    squares = squares_of(points)
    rng = np.random.default_rng(5)
    for north, east in (*rng.uniform(-5.0, 7.0, (12, 2)).tolist(), (0.0, 0.0), (-0.5, 0.25)):
        for within in (0.0, 0.2, 0.5, 1.3, 30.0):
            found = kernels.points_near(points, squares, north, east, within)
            away = np.hypot(points[:, 0] - north, points[:, 1] - east)
            assert sorted(found.tolist()) == np.flatnonzero(away < within).tolist()


def test_what_lies_exactly_as_far_is_not_near() -> None:
    points = np.array([[3.0, 4.0], [0.0, 5.0]])
    squares = squares_of(points)
    assert kernels.points_near(points, squares, 0.0, 0.0, 5.0).tolist() == []
    assert len(kernels.points_near(points, squares, 0.0, 0.0, 5.0 + 1e-9)) == 2


@pytest.mark.parametrize("points", CLOUDS)
def test_a_segment_is_free_when_every_point_is_far_enough(points: Floats) -> None:
    squares = squares_of(points)
    rng = np.random.default_rng(6)
    ways = rng.uniform(-4.0, 6.0, (12, 4)).tolist()
    ways += [[0.0, -4.0, 0.0, 6.0], [-4.0, 0.25, 6.0, 0.25], [1.0, 1.0, 1.0, 1.0]]
    for way in ways:
        for keep_out in (0.05, 0.3, 1.0):
            nearest = min(
                (kernels.segment_distance2(n, e, *way) for n, e in points.tolist()), default=9e9
            )
            free = kernels.segment_is_free(points, squares, keep_out, *way)
            assert free is (nearest >= keep_out * keep_out)


@pytest.mark.parametrize("turned_deg", [0.0, 90.0, 180.0, 270.0])
def test_a_segment_may_touch_a_keep_out(turned_deg: float) -> None:
    c, s = round(math.cos(math.radians(turned_deg))), round(math.sin(math.radians(turned_deg)))
    for away, free in ((0.5, True), (0.5 - 1e-9, False)):
        for n, e in ((1.0, away), (3.0 + away, 0.0), (-away, 0.0)):
            points = np.array([[c * n - s * e, s * n + c * e]], dtype=np.float64)
            way = (0.0, 0.0, 3.0 * c, 3.0 * s)
            assert kernels.segment_is_free(points, squares_of(points), 0.5, *way) is free


@pytest.mark.parametrize(
    ("low", "high", "expected"),
    [
        # Four squares of 0.5 from 10 on.
        (10.2, 10.3, (0, 0)),
        (10.2, 11.2, (0, 2)),
        (11.5, 11.9, (3, 3)),
        (3.0, 30.0, (0, 3)),
        (3.0, 10.0, (0, 0)),
        (3.0, 9.99, (0, -1)),
        (12.0, 13.0, (0, -1)),
        (11.99, 13.0, (3, 3)),
        (math.nan, math.nan, (0, -1)),
    ],
)
def test_a_strip_meets_squares(low: float, high: float, expected: tuple[int, int]) -> None:
    assert kernels._strip(low, high, 10.0, 0.5, 4.0) == expected


@pytest.mark.parametrize(
    ("row", "way", "expected"),
    [
        # Rows and columns of 1 m from the origin; a reach of 0.1 m. Along the diagonal:
        (0, (0.5, 0.5, 5.5, 5.5), (0, 1)),
        (2, (0.5, 0.5, 5.5, 5.5), (1, 3)),
        (5, (5.5, 5.5, 0.5, 0.5), (4, 5)),
        (6, (0.5, 0.5, 5.5, 5.5), (0, -1)),
        (2, (0.5, 5.5, 5.5, 0.5), (2, 4)),
        # Along a row, and along a column.
        (2, (2.5, 1.5, 2.5, 4.5), (1, 4)),
        (2, (0.5, 3.5, 5.5, 3.5), (3, 3)),
        (2, (2.5, 1.05, 2.5, 4.95), (0, 5)),
    ],
)
def test_a_way_meets_columns_of_a_row(
    row: int, way: tuple[float, float, float, float], expected: tuple[int, int]
) -> None:
    box = np.array([0.0, 0.0, 1.0, 9.0, 9.0, 0.3])
    assert kernels._columns_of(box, row, 0.1, *way) == expected
