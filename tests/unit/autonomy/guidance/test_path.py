"""A flown path: arc length, progress, what remains."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from autonomy.geometry import distance, polyline_length
from autonomy.guidance.path import FlownPath

coordinate = st.floats(-5.0, 5.0)
points = st.lists(st.tuples(coordinate, coordinate), min_size=1, max_size=8).map(tuple)


def test_an_empty_path_is_refused() -> None:
    with pytest.raises(ValueError, match="at least one point"):
        FlownPath(())


def test_points_on_the_path_are_at_their_arc_length() -> None:
    path = FlownPath(((0.0, 0.0), (3.0, 0.0), (3.0, 4.0)))
    assert path.length_m == 7.0
    assert path.point_at(1.5) == (1.5, 0.0)
    assert path.point_at(5.0) == (3.0, 2.0)
    assert path.point_at(-1.0) == (0.0, 0.0)
    assert path.point_at(99.0) == (3.0, 4.0)


@given(points, st.lists(st.tuples(coordinate, coordinate), max_size=20))
@settings(deadline=None, max_examples=60)
def test_progress_never_runs_backwards_and_never_passes_the_end(
    corners: tuple[tuple[float, float], ...], positions: list[tuple[float, float]]
) -> None:
    path = FlownPath(corners)
    before = 0.0
    for position in positions:
        path.advance(position)
        assert before <= path.progress_m <= path.length_m + 1e-9
        before = path.progress_m
        assert math.isclose(
            polyline_length(path.remaining()), path.remaining_m, rel_tol=1e-9, abs_tol=1e-9
        )


def test_progress_follows_a_vehicle_that_flies_along() -> None:
    path = FlownPath(((0.0, 0.0), (2.0, 0.0), (2.0, 2.0)))
    for step in range(41):
        along = 0.1 * step
        at = path.point_at(along)
        path.advance((at[0] + 0.02, at[1] - 0.02))
        assert abs(path.progress_m - along) < 0.05


def test_a_path_that_comes_back_beside_itself_is_not_cut_short() -> None:
    # Out and back along both sides of a thin wall: the way back is nearer than the way on.
    path = FlownPath(((0.0, 0.0), (2.0, 0.0), (2.0, 0.2), (0.0, 0.2)))
    path.advance((0.3, 0.2))
    assert path.progress_m < 0.5


def test_remaining_starts_where_the_vehicle_is() -> None:
    path = FlownPath(((0.0, 0.0), (2.0, 0.0), (2.0, 2.0)))
    path.advance((0.4, 0.1))
    remaining = path.remaining()
    assert distance(remaining[0], (0.4, 0.0)) < 1e-12
    assert remaining[1:] == ((2.0, 0.0), (2.0, 2.0))
