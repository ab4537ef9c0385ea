"""Seeded rooms with three standing obstacles and three to five movers that give way to nobody."""

import itertools
import math

import numpy as np

from autonomy.geometry import Point
from hal.config import Fence
from hal.sim.scenario import Box, Disc, Mover, Scenario, Wall, Wander

LOW, HIGH = (-1.0, -1.5), (5.0, 4.5)
"""The walls of the room (north, east): 6 m x 6 m, as in the paper."""
OFF_THE_WALLS_M = 0.2
GOAL = (4.0, 3.0)
STANDING = 3
MOVERS = (3, 5)
RADIUS_M = (0.15, 0.25)
END_FREE_M = 0.5
"""Nothing stands nearer than this to the take-off point or the goal."""
BEGIN_FREE_M = 1.3
"""No mover begins nearer than this to the take-off point ..."""
BEGIN_S = 8.0
"""... nor sooner than this: the vehicle starts at 6 s, and on the ground nobody can make way."""


def world(number: int, speed_m_s: float) -> Scenario:
    """Room `number`: the same obstacles and ways at every speed.

    Odd movers go to and fro between two places, even ones wander, and every third stands for two
    seconds at every place, as people do.
    """
    rng = np.random.default_rng((5, number))
    standing = _standing(rng)
    movers: list[Mover] = []
    for index in range(int(rng.integers(MOVERS[0], MOVERS[1] + 1))):
        radius_m = float(rng.uniform(*RADIUS_M))
        path = _stretch(rng, standing, radius_m)
        area = {"low_ne_m": _inside(LOW, radius_m), "high_ne_m": _inside(HIGH, -radius_m)}
        wander = Wander(seed=int(rng.integers(2**31)), **area) if index % 2 else None
        movers.append(
            Mover(
                label=f"mover {index}",
                radius_m=radius_m,
                speed_m_s=speed_m_s,
                path_ne_m=path[: 1 if wander else 2],
                wander=wander,
                start_s=BEGIN_S,
                pause_s=2.0 if index % 3 == 2 else 0.0,
            )
        )
    inside = _inside(LOW, OFF_THE_WALLS_M), _inside(HIGH, -OFF_THE_WALLS_M)
    return Scenario(
        name=f"movers {number}",
        title=f"{len(movers)} movers at {speed_m_s:g} m/s, room {number}",
        obstacles=(*standing, *_walls()),
        movers=tuple(movers),
        goal_ne_m=GOAL,
        fence=Fence.rectangle(*zip(*inside, strict=True)),
    )


def _inside(corner: Point, by_m: float) -> Point:
    return (corner[0] + by_m, corner[1] + by_m)


def _walls() -> tuple[Wall, ...]:
    (n0, e0), (n1, e1) = LOW, HIGH
    ring = ((n0, e0), (n1, e0), (n1, e1), (n0, e1), (n0, e0))
    pairs = itertools.pairwise(ring)
    return tuple(Wall(from_ne_m=a, to_ne_m=b, thickness_m=0.02) for a, b in pairs)


def _place(rng: np.random.Generator, margin_m: float) -> Point:
    n, e = rng.uniform(_inside(LOW, margin_m), _inside(HIGH, -margin_m)).tolist()
    return (n, e)


def _standing(rng: np.random.Generator) -> list[Disc | Box]:
    """Discs and boxes away from both ends."""
    found: list[Disc | Box] = []
    while len(found) < STANDING:
        centre = _place(rng, 0.3)
        if rng.uniform() < 0.5:
            thing: Disc | Box = Disc(centre_ne_m=centre, radius_m=float(rng.uniform(0.08, 0.25)))
        else:
            size = (float(rng.uniform(0.2, 0.6)), float(rng.uniform(0.2, 0.6)))
            thing = Box(centre_ne_m=centre, size_m=size, yaw_deg=float(rng.uniform(0.0, 180.0)))
        if min(thing.distance_m(0.0, 0.0), thing.distance_m(*GOAL)) >= END_FREE_M:
            found.append(thing)
    return found


def _stretch(
    rng: np.random.Generator, standing: list[Disc | Box], radius_m: float
) -> tuple[Point, Point]:
    """A straight way of 1.5 m or more past what stands, beginning away from the take-off point."""
    while True:
        a, b = _place(rng, radius_m + 0.05), _place(rng, radius_m + 0.05)
        if math.hypot(*a) < BEGIN_FREE_M or math.dist(a, b) < 1.5:
            continue
        steps = [(a[0] + (b[0] - a[0]) * k / 60, a[1] + (b[1] - a[1]) * k / 60) for k in range(61)]
        if all(thing.distance_m(*p) > radius_m for thing in standing for p in steps):
            return a, b
