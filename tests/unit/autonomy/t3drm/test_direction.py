import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from autonomy.t3drm.direction import TABLE_1, Direction, Pair, direction_of, pair_of

angles = st.floats(-math.pi, math.pi)


@given(angles, st.floats(0.01, 10.0))
def test_the_horizontal_direction_is_the_nearest_body_axis(angle: float, length: float) -> None:
    forward, right = length * math.cos(angle), length * math.sin(angle)
    named = direction_of((forward, right, 0.0))
    along = {
        Direction.FRONT: forward,
        Direction.BACK: -forward,
        Direction.RIGHT: right,
        Direction.LEFT: -right,
    }
    assert named in along
    assert along[named] >= max(along.values()) - 1e-9 * length


def test_the_basis_keeps_the_length_of_a_horizontal_displacement() -> None:
    pair = pair_of((0.3, -0.4, 0.0))
    assert math.isclose(math.hypot(pair.x0, pair.y0), 0.5)


def test_the_pair_is_the_displacement_along_the_two_diagonals() -> None:
    # e1 = forward-right, e2 = forward-left: 3-4-5 turned by 45 degrees.
    pair = pair_of((7.0 * math.sqrt(0.5), -1.0 * math.sqrt(0.5), 0.0))
    assert (pair.x0, pair.y0) == pytest.approx((3.0, 4.0))
    assert (pair_of((0.0, 0.0, -0.7)).x0, pair_of((0.0, 0.0, -0.7)).y0) == (0.0, 0.7)


@pytest.mark.parametrize(
    ("direction", "signs"),
    [
        (Direction.FRONT, (+1, +1)),
        (Direction.BACK, (-1, -1)),
        (Direction.RIGHT, (+1, -1)),
        (Direction.LEFT, (-1, +1)),
        (Direction.UP, (0, +1)),
        (Direction.DOWN, (0, -1)),
    ],
)
def test_table_1_holds_the_printed_signs(direction: Direction, signs: tuple[int, int]) -> None:
    assert TABLE_1[direction] == signs


def test_a_pair_cannot_be_changed() -> None:
    pair = Pair(1.0, 2.0)
    with pytest.raises(AttributeError):
        pair.x0 = 3.0  # type: ignore[misc]  # that is the test


def test_exactly_along_a_basis_vector_the_noses_axis_is_named() -> None:
    assert direction_of((1.0, 1.0, 0.0)) is Direction.FRONT
    assert direction_of((1.0, -1.0, 0.0)) is Direction.FRONT
    assert direction_of((-1.0, 1.0, 0.0)) is Direction.BACK
    assert direction_of((-1.0, -1.0, 0.0)) is Direction.BACK
    assert direction_of((-0.2, 0.2, 0.0)) is Direction.BACK


def test_a_climb_that_is_mostly_vertical_is_up_and_a_shallow_one_is_not() -> None:
    assert direction_of((0.5, 0.0, -0.6)) is Direction.UP
    assert direction_of((0.5, 0.0, 0.6)) is Direction.DOWN
    assert direction_of((0.5, 0.0, -0.4)) is Direction.FRONT


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_climb_as_steep_as_it_is_long_is_still_horizontal(sign: float) -> None:
    assert direction_of((0.5, 0.0, -0.5 * sign)) is Direction.FRONT
    assert direction_of((0.0, -0.5, -0.5 * sign)) is Direction.LEFT
    assert pair_of((0.0, 0.5, 0.5 * sign)).signs == (1, -1)


def test_sideways_motion_counts_as_horizontal() -> None:
    assert direction_of((0.1, 0.6, -0.5)) is Direction.RIGHT
    assert direction_of((0.1, -0.6, 0.5)) is Direction.LEFT
    assert direction_of((0.1, 0.4, -0.5)) is Direction.UP


def test_no_displacement_has_no_direction() -> None:
    assert direction_of((0.0, 0.0, 0.0)) is None
