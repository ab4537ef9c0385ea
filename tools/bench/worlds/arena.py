"""The room that a generated world stands in: four walls, a fence inside them, both ends free."""

import itertools

import msgspec

from autonomy.geometry import Point
from hal.config import Fence
from hal.sim.scenario import Box, Disc, Mover, Scenario, SimObstacle, Wall
from tools.bench.rooms import END_FREE_M, OFF_THE_WALLS_M

CORNER_M = 0.7
"""How far take-off point and goal are from the walls of their corners."""
OUTER_M = 0.04
"""Thickness of the room's own walls; their middle lines are its sides."""


class Arena(msgspec.Struct, frozen=True):
    """A rectangle (north, east) with the take-off point at the origin, and a goal in it."""

    low: Point
    high: Point
    goal: Point

    @classmethod
    def corner_to_corner(cls, north_m: float, east_m: float) -> "Arena":
        """A room of these sides: from its south-west corner to its north-east one."""
        low = (-CORNER_M, -CORNER_M)
        high = (north_m - CORNER_M, east_m - CORNER_M)
        return cls(low, high, (high[0] - CORNER_M, high[1] - CORNER_M))

    @property
    def walls(self) -> tuple[Wall, ...]:
        """The four walls."""
        return closed_ring(
            (self.low, (self.high[0], self.low[1]), self.high, (self.low[0], self.high[1])),
            OUTER_M,
        )

    def is_clear_of(self, thing: Box | Disc | Wall, free_m: float = END_FREE_M) -> bool:
        """True when a thing stands nowhere near the take-off point or the goal."""
        return min(thing.distance_m(0.0, 0.0), thing.distance_m(*self.goal)) >= free_m

    def scenario(
        self,
        title: str,
        things: tuple[SimObstacle, ...],
        *,
        movers: tuple[Mover, ...] = (),
        reachable: bool = True,
        ceiling_m: float | None = None,
    ) -> Scenario:
        """The room with these things in it; whoever draws it gives it a name."""
        (low_n, low_e), (high_n, high_e), inset_m = self.low, self.high, OFF_THE_WALLS_M
        return Scenario(
            name="unnamed",
            title=title,
            obstacles=(*self.walls, *things),
            movers=movers,
            ceiling_m=ceiling_m,
            goal_ne_m=self.goal,
            fence=Fence.rectangle(
                (low_n + inset_m, high_n - inset_m), (low_e + inset_m, high_e - inset_m)
            ),
            reachable=reachable,
        )


def closed_ring(corners: tuple[Point, ...], thickness_m: float) -> tuple[Wall, ...]:
    """Walls from corner to corner and back to the first."""
    return polyline((*corners, corners[0]), thickness_m)


def polyline(corners: tuple[Point, ...], thickness_m: float) -> tuple[Wall, ...]:
    """Walls from corner to corner; squared off, so that no corner gapes."""
    return tuple(_squared(a, b, thickness_m) for a, b in itertools.pairwise(corners))


def _squared(a: Point, b: Point, thickness_m: float) -> Wall:
    """The wall from a to b and half its thickness beyond both."""
    north, east = b[0] - a[0], b[1] - a[1]
    part = 0.5 * thickness_m / (north**2 + east**2) ** 0.5
    return Wall(
        from_ne_m=(a[0] - part * north, a[1] - part * east),
        to_ne_m=(b[0] + part * north, b[1] + part * east),
        thickness_m=thickness_m,
    )
