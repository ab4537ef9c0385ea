"""Table 1: the direction of a displacement from the signs of its coordinates.

Basis e1 = forward-right and e2 = forward-left, at 45 degrees to the nose: then (+, +) is front,
(-, -) back, (+, -) right and (-, +) left, as printed. A vertical displacement has the pair
(0, +) for up and (0, -) for down: the printed row for up (x0 > 0, y0 = 0) and its own pair
(0, +) disagree, the pair column is followed.
"""

import math
from enum import StrEnum

import msgspec

from hal.frames import Vector3

_HALF = math.sqrt(0.5)


class Direction(StrEnum):
    """The six rows of Table 1."""

    FRONT = "front"
    BACK = "back"
    RIGHT = "right"
    LEFT = "left"
    UP = "up"
    DOWN = "down"


class Pair(msgspec.Struct, frozen=True):
    """The coordinates (x0, y0) of a displacement in Table 1's basis, in metres."""

    x0: float
    y0: float

    @property
    def signs(self) -> tuple[int, int]:
        """(-1, 0 or +1) of both coordinates."""
        return (_sign(self.x0), _sign(self.y0))


TABLE_1: dict[Direction, tuple[int, int]] = {
    Direction.FRONT: (1, 1),
    Direction.BACK: (-1, -1),
    Direction.RIGHT: (1, -1),
    Direction.LEFT: (-1, 1),
    Direction.UP: (0, 1),
    Direction.DOWN: (0, -1),
}
"""Direction -> signs of (x0, y0)."""


def pair_of(displacement_frd_m: Vector3) -> Pair:
    """(x0, y0) of a body displacement: by e1 and e2 when it is mostly horizontal, else (0, up)."""
    forward, right, down = displacement_frd_m
    if _is_vertical(displacement_frd_m):
        return Pair(0.0, -down)
    return Pair(_HALF * (forward + right), _HALF * (forward - right))


def direction_of(displacement_frd_m: Vector3) -> Direction | None:
    """The row of Table 1 for a displacement in the body frame (forward, right, down); None for 0.

    Exactly along e1 or e2 no row fits; there the nose's axis is taken (front or back), so that
    the sensor on the nearer side is the one that looks ahead.
    """
    pair = pair_of(displacement_frd_m)
    for direction, signs in TABLE_1.items():
        if pair.signs == signs and _is_vertical(displacement_frd_m) == (signs[0] == 0):
            return direction
    forward = displacement_frd_m[0]
    if forward > 0.0:
        return Direction.FRONT
    return Direction.BACK if forward < 0.0 else None


def _is_vertical(displacement_frd_m: Vector3) -> bool:
    forward, right, down = displacement_frd_m
    return abs(down) > math.hypot(forward, right)


def _sign(value: float) -> int:
    return (value > 0.0) - (value < 0.0)
