"""Worlds without a plan: discs strewn over a room, walls, beams and tables, and movers."""

import math

import numpy as np

from autonomy.geometry import Point
from hal.sim.scenario import Box, Disc, Scenario, SimObstacle, Wall
from tools.bench.worlds.arena import Arena
from tools.movers import worlds as moving

MOVER_SPEEDS_M_S = (0.05, 0.1, 0.15)
"""Slower than the vehicle: from its own speed on nobody can always make way."""
CEILING_M = 2.5
_INSET_M = 0.2


def discs(rng: np.random.Generator) -> Scenario:
    """Six to seventy upright cylinders anywhere in a room."""
    arena = _arena(rng)
    area_m2 = (arena.high[0] - arena.low[0]) * (arena.high[1] - arena.low[1])
    count = max(6, round(area_m2 * rng.uniform(0.25, 0.9)))
    found: list[Disc] = []
    while len(found) < count:
        disc = Disc(centre_ne_m=_place(rng, arena), radius_m=float(rng.uniform(0.06, 0.35)))
        if arena.is_clear_of(disc):
            found.append(disc)
    return arena.scenario(f"{count} discs", tuple(found))


def walls(rng: np.random.Generator) -> Scenario:
    """Straight walls in any direction."""
    arena = _arena(rng)
    area_m2 = (arena.high[0] - arena.low[0]) * (arena.high[1] - arena.low[1])
    count = max(4, round(area_m2 * rng.uniform(0.12, 0.35)))
    found: list[Wall] = []
    while len(found) < count:
        (north, east), half_m = _place(rng, arena), float(rng.uniform(0.4, 1.3))
        turn = float(rng.uniform(0.0, math.pi))
        dn, de = half_m * math.cos(turn), half_m * math.sin(turn)
        ends = (north - dn, east - de), (north + dn, east + de)
        wall = Wall(from_ne_m=ends[0], to_ne_m=ends[1])
        if all(_inside(arena, end) for end in ends) and arena.is_clear_of(wall):
            found.append(wall)
    return arena.scenario(f"{count} walls", tuple(found))


def low(rng: np.random.Generator) -> Scenario:
    """Something from wall to wall to fly over or under, tables with legs, pillars.

    What bars the way leaves room for two heights of flight above it or below it.
    """
    arena = Arena.corner_to_corner(float(rng.uniform(5.0, 7.0)), float(rng.uniform(4.0, 6.0)))
    bars, title = _bars(rng, arena)
    things: list[SimObstacle] = list(bars)
    for _ in range(int(rng.integers(1, 4))):
        things += _table(rng, arena)
    for _ in range(int(rng.integers(1, 4))):
        things.append(Disc(centre_ne_m=_place(rng, arena), radius_m=float(rng.uniform(0.08, 0.2))))
    clear = tuple(thing for thing in things if arena.is_clear_of(thing))
    return arena.scenario(f"{title}, {len(clear)} things", clear, ceiling_m=CEILING_M)


def movers(rng: np.random.Generator) -> Scenario:
    """A room of `tools.movers`, with movers slower than the vehicle."""
    speed_m_s = MOVER_SPEEDS_M_S[int(rng.integers(len(MOVER_SPEEDS_M_S)))]
    return moving.world(int(rng.integers(2**31)), speed_m_s)


def _arena(rng: np.random.Generator) -> Arena:
    return Arena.corner_to_corner(float(rng.uniform(4.5, 9.0)), float(rng.uniform(4.5, 9.0)))


def _inside(arena: Arena, point: Point) -> bool:
    return all(
        low <= at <= high for low, at, high in zip(arena.low, point, arena.high, strict=True)
    )


def _place(rng: np.random.Generator, arena: Arena) -> Point:
    north, east = (
        float(rng.uniform(low + _INSET_M, high - _INSET_M))
        for low, high in zip(arena.low, arena.high, strict=True)
    )
    return (north, east)


def _bars(rng: np.random.Generator, arena: Arena) -> tuple[list[SimObstacle], str]:
    """One or two of a kind across the whole room: low walls, curtains or beams."""
    kind = int(rng.integers(3))
    base_m, top_m = (
        (0.0, float(rng.uniform(1.1, 1.3))),
        (float(rng.uniform(0.7, 0.9)), CEILING_M),
        (float(rng.uniform(0.85, 0.95)), float(rng.uniform(1.05, 1.3))),
    )[kind]
    count = int(rng.integers(1, 3))
    found: list[SimObstacle] = []
    for index in range(count):
        north = arena.low[0] + (arena.high[0] - arena.low[0]) * (index + 1) / (count + 1)
        lean_m = float(rng.uniform(-0.4, 0.4))
        found.append(
            Wall(
                from_ne_m=(north - lean_m, arena.low[1]),
                to_ne_m=(north + lean_m, arena.high[1]),
                thickness_m=float(rng.uniform(0.05, 0.15)),
                base_m=base_m,
                height_m=top_m,
            )
        )
    return found, f"{count} {('low wall', 'curtain', 'beam')[kind]}{'s' if count > 1 else ''}"


def _table(rng: np.random.Generator, arena: Arena) -> list[SimObstacle]:
    """A top at 0.75 or 1.05 m (a high table, at the height of flight) on four legs."""
    (north, east), turn = _place(rng, arena), float(rng.uniform(0.0, math.pi))
    along_m, across_m = float(rng.uniform(0.6, 1.2)), float(rng.uniform(0.5, 0.8))
    top_m = 1.05 if rng.uniform() < 0.5 else 0.75
    c, s = math.cos(turn), math.sin(turn)
    legs = [
        (0.5 * along_m * a - 0.05 * a, 0.5 * across_m * b - 0.05 * b)
        for a, b in ((1, 1), (1, -1), (-1, -1), (-1, 1))
    ]
    top = Box(
        centre_ne_m=(north, east),
        size_m=(along_m, across_m),
        yaw_deg=math.degrees(turn),
        base_m=top_m - 0.05,
        height_m=top_m,
    )
    if not arena.is_clear_of(top):
        return []
    return [
        top,
        *(
            Disc(
                centre_ne_m=(north + c * x - s * y, east + s * x + c * y),
                radius_m=0.03,
                height_m=top_m - 0.05,
            )
            for x, y in legs
        ),
    ]
