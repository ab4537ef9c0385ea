"""Seeded maps for the planner benchmark: random discs, walls as rows of points, both, and BARN.

A map is known completely: discs, a keep-out radius that is added to each, start, goal and a
rectangle that no path leaves. The same generator state gives the same map, bit for bit.
"""

import json
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from autonomy.geometry import Point

Floats = NDArray[np.float64]

KEEP_OUT_M = 0.20
"""Body radius 0.15 m and 0.05 m of clearance."""
MARGIN_M = 1.0
"""How far the rectangle reaches beyond the arena: going round the outside is allowed."""
CORNER_M = 0.3
"""Start and goal stand this far outside opposite corners of the arena."""
HIT_SPACING_M = 0.05
WALL_M = (1.0, 2.4)
DISC_RADIUS_M = (0.10, 0.45)
BARN_RADIUS_M = 0.075
BARN_START: Point = (3.0, -2.25)
BARN_GOAL: Point = (13.0, -2.25)


@dataclass(frozen=True)
class Map:
    """One problem. Arrays are float64, rows (north, east) in metres."""

    name: str
    start: Point
    goal: Point
    centres: Floats
    """(n, 2)"""
    radii_m: Floats
    """(n,) radii of the obstacles themselves: 0 for a point."""
    keep_out_m: float
    low: Point
    high: Point
    """Corners of the rectangle that no path leaves."""

    @property
    def reach_m(self) -> Floats:
        """(n,) what the vehicle's centre must stay out of."""
        return self.radii_m + self.keep_out_m


@dataclass(frozen=True)
class Family:
    """Maps of one kind; `draw(number)` is map `number` of it."""

    name: str
    count: int
    draw: Callable[[int], Map]

    def maps(self, count: int) -> Iterator[Map]:
        """The first `count` maps, or as many as there are."""
        return (self.draw(number) for number in range(min(count, self.count)))


def random_map(name: str, side_m: float, discs: int, walls: int, rng: np.random.Generator) -> Map:
    """`discs` discs and `walls` straight rows of points in a square arena of `side_m`.

    Discs have radii DISC_RADIUS_M, rows WALL_M with a point every HIT_SPACING_M, directions at
    random. Everything may overlap, and nothing is moved out of the way: start and goal stand
    outside the corners, where no keep-out reaches.
    """
    inset = 0.45
    centres = [rng.uniform(inset, side_m - inset, (discs, 2))]
    radii = [rng.uniform(*DISC_RADIUS_M, discs)]
    for _ in range(walls):
        row = _wall(rng, side_m)
        centres.append(row)
        radii.append(np.zeros(row.shape[0]))
    corner, far = -CORNER_M, side_m + CORNER_M
    return Map(
        name,
        (corner, corner),
        (far, far),
        np.concatenate(centres),
        np.concatenate(radii),
        KEEP_OUT_M,
        (-MARGIN_M, -MARGIN_M),
        (side_m + MARGIN_M, side_m + MARGIN_M),
    )


def _wall(rng: np.random.Generator, side_m: float) -> Floats:
    """One straight row of points inside the arena."""
    length, angle = rng.uniform(*WALL_M), rng.uniform(0.0, math.pi)
    middle = rng.uniform(0.2, side_m - 0.2, 2)
    at = np.linspace(-0.5 * length, 0.5 * length, round(length / HIT_SPACING_M) + 1)
    row = middle + np.outer(at, (math.cos(angle), math.sin(angle)))
    inside = ((row >= 0.0) & (row <= side_m)).all(axis=1)
    return np.asarray(row[inside], dtype=np.float64)


def spread_map(count: int, rng: np.random.Generator) -> Map:
    """20 discs between start and goal, and `count` - 20 more in a field that is not in the way.

    The field keeps its density and grows, so that only the number of obstacles elsewhere changes.
    """
    near = random_map("near", 6.0, min(20, count), 0, rng)
    more = count - near.radii_m.shape[0]
    width = max(1.0, math.sqrt(more))
    far = rng.uniform((8.0, 8.0), (8.0 + width, 8.0 + width), (more, 2))
    return Map(
        f"{count} discs",
        near.start,
        near.goal,
        np.concatenate((near.centres, far)),
        np.concatenate((near.radii_m, rng.uniform(*DISC_RADIUS_M, more))),
        KEEP_OUT_M,
        near.low,
        (9.0 + width, 9.0 + width),
    )


def barn_maps(folder: Path) -> tuple[Map, ...]:
    """The worlds of `folder`/worlds.json, in order: index -> list of [x, y] of cylinders.

    Start (x -2.25, y 3), goal (-2.25, 13), y is taken as north. TypeError names a file that holds
    something else, FileNotFoundError is what it says.
    """
    path = folder / "worlds.json"
    worlds = json.loads(path.read_text())
    if not isinstance(worlds, dict):
        raise TypeError(f"{path} is no table of worlds")
    return tuple(
        _barn_map(index, np.array(worlds[index], dtype=np.float64).reshape(-1, 2))
        for index in sorted(worlds, key=int)
    )


def _barn_map(index: str, cylinders_xy: Floats) -> Map:
    centres = np.ascontiguousarray(cylinders_xy[:, ::-1])
    ends = np.array((BARN_START, BARN_GOAL))
    known = np.concatenate((centres, ends))
    low, high = known.min(axis=0) - MARGIN_M, known.max(axis=0) + MARGIN_M
    return Map(
        f"BARN {index}",
        BARN_START,
        BARN_GOAL,
        centres,
        np.full(centres.shape[0], BARN_RADIUS_M),
        KEEP_OUT_M,
        (float(low[0]), float(low[1])),
        (float(high[0]), float(high[1])),
    )


RANDOM_FAMILIES: tuple[tuple[str, float, int, int], ...] = (
    ("5 discs, 6 m", 6.0, 5, 0),
    ("10 discs, 6 m", 6.0, 10, 0),
    ("20 discs, 6 m", 6.0, 20, 0),
    ("40 discs, 12 m", 12.0, 40, 0),
    ("80 discs, 12 m", 12.0, 80, 0),
    ("200 discs, 20 m", 20.0, 200, 0),
    ("200 discs, 12 m", 12.0, 200, 0),
    ("4 walls, 6 m", 6.0, 0, 4),
    ("16 walls, 12 m", 12.0, 0, 16),
    ("3 walls, 10 discs, 6 m", 6.0, 10, 3),
    ("10 walls, 40 discs, 12 m", 12.0, 40, 10),
)
"""Name, side of the arena, discs, walls."""


def families(barn: Path | None, *, seed: int = 0) -> tuple[Family, ...]:
    """All families; another seed gives other maps (tuning happens on seeds not reported)."""
    found = [
        Family(name, 10**6, partial(_drawn, name, side, discs, walls, (seed, row)))
        for row, (name, side, discs, walls) in enumerate(RANDOM_FAMILIES)
    ]
    if barn is not None:
        worlds = barn_maps(barn)
        found.append(Family("BARN", len(worlds), worlds.__getitem__))
    return tuple(found)


def _drawn(
    name: str, side_m: float, discs: int, walls: int, key: tuple[int, int], number: int
) -> Map:
    rng = np.random.default_rng((*key, number))
    return random_map(f"{name}, {number}", side_m, discs, walls, rng)
