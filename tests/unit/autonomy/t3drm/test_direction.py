import math

from hypothesis import given
from hypothesis import strategies as st

from autonomy.t3drm.direction import Direction, direction_of, pair_of

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


def test_exactly_along_a_basis_vector_the_noses_axis_is_named() -> None:
    assert direction_of((1.0, 1.0, 0.0)) is Direction.FRONT
    assert direction_of((1.0, -1.0, 0.0)) is Direction.FRONT
    assert direction_of((-1.0, 1.0, 0.0)) is Direction.BACK
    assert direction_of((-1.0, -1.0, 0.0)) is Direction.BACK


def test_a_climb_that_is_mostly_vertical_is_up_and_a_shallow_one_is_not() -> None:
    assert direction_of((0.5, 0.0, -0.6)) is Direction.UP
    assert direction_of((0.5, 0.0, 0.6)) is Direction.DOWN
    assert direction_of((0.5, 0.0, -0.4)) is Direction.FRONT


def test_no_displacement_has_no_direction() -> None:
    assert direction_of((0.0, 0.0, 0.0)) is None
