"""Worlds with a plan: mazes, traps, spirals, rings, warehouses, and rows that repeat themselves."""

import math

import numpy as np

from autonomy.geometry import Point
from hal.sim.scenario import Box, Disc, Scenario, SimObstacle, Wall
from tools.bench.worlds.arena import CORNER_M, Arena, closed_ring, polyline

Cell = tuple[int, int]

WALL_M = 0.06
GAP_M = (0.0, 0.34)
"""Between the posts of a row: narrower than the body with its keep-out, so that nothing passes."""


def corridor(rng: np.random.Generator) -> Scenario:
    """A maze of corridors 0.8 to 1.2 m wide, with one way through it and dead ends beside it.

    Some of its inner walls are taken away again, so that there may be two ways.
    """
    width_m = float(rng.uniform(0.8, 1.2)) + WALL_M
    rows, columns = int(rng.integers(3, 6)), int(rng.integers(3, 6))
    open_edges = _passages(rng, rows, columns)
    corner = 0.5 * width_m
    low: Point = (-corner, -corner)
    goal: Point = ((rows - 1) * width_m, (columns - 1) * width_m)
    found: list[SimObstacle] = []
    for row in range(rows):
        for column in range(columns):
            for other in ((row + 1, column), (row, column + 1)):
                if other[0] == rows or other[1] == columns:
                    continue
                if ((row, column), other) in open_edges or rng.uniform() < 0.08:
                    continue
                found.append(_between((row, column), other, width_m))
    high = (low[0] + rows * width_m, low[1] + columns * width_m)
    return Arena(low, high, goal).scenario(f"{rows} x {columns} cells", tuple(found))


def u_trap(rng: np.random.Generator) -> Scenario:
    """A dead end on the straight line, open towards the take-off point, and a few posts."""
    arena = Arena.corner_to_corner(float(rng.uniform(5.5, 8.0)), float(rng.uniform(5.5, 8.0)))
    north, east = arena.goal
    away_m = math.hypot(north, east)
    ahead, aside = (north / away_m, east / away_m), (-east / away_m, north / away_m)
    depth_m, half_m = float(rng.uniform(0.8, 2.2)), float(rng.uniform(0.7, 1.3))
    bottom_m = float(rng.uniform(0.55, 0.7)) * away_m
    shift_m = float(rng.uniform(-0.4, 0.4))

    def at(along_m: float, across_m: float) -> Point:
        return (
            ahead[0] * along_m + aside[0] * across_m,
            ahead[1] * along_m + aside[1] * across_m,
        )

    mouth_m = max(0.9, bottom_m - depth_m)
    trap = polyline(
        (
            at(mouth_m, shift_m - half_m),
            at(bottom_m, shift_m - half_m),
            at(bottom_m, shift_m + half_m),
            at(mouth_m, shift_m + half_m),
        ),
        WALL_M,
    )
    posts = []
    for _ in range(int(rng.integers(0, 5))):
        centre = (
            float(rng.uniform(arena.low[0] + 0.3, arena.high[0] - 0.3)),
            float(rng.uniform(arena.low[1] + 0.3, arena.high[1] - 0.3)),
        )
        post = Disc(centre_ne_m=centre, radius_m=float(rng.uniform(0.06, 0.2)))
        if arena.is_clear_of(post):
            posts.append(post)
    return arena.scenario(f"{bottom_m - mouth_m:.1f} m deep", (*trap, *posts))


def spiral(rng: np.random.Generator) -> Scenario:
    """A corridor that winds inwards at right angles: the way in or the way out, left or right."""
    lane_m, legs = float(rng.uniform(0.85, 1.15)), int(rng.integers(5, 9))
    inwards, mirrored = bool(rng.integers(2)), bool(rng.integers(2))
    corners = [(0.0, 0.0)]
    for leg in range(legs):
        (n, e), step = corners[-1], (1 + leg // 2) * lane_m
        corners.append((n + step * (1, 0, -1, 0)[leg % 4], e + step * (0, 1, 0, -1)[leg % 4]))
    # The heart lies beside the first leg, inside the winding; the other end in the outer lane.
    centre = (0.5 * lane_m, 0.5 * lane_m)
    norths, easts = zip(*corners, strict=True)
    low = (min(norths) - lane_m, min(easts) - lane_m)
    high = (max(norths) + lane_m, max(easts) + lane_m)
    outside = (low[0] + 0.5 * lane_m, high[1] - 0.5 * lane_m)
    start, goal = (outside, centre) if inwards else (centre, outside)

    def moved(point: Point) -> Point:
        n, e = point[0] - start[0], point[1] - start[1]
        return (e, n) if mirrored else (n, e)

    ends = sorted((moved(low), moved(high)))
    winding = polyline(tuple(moved(corner) for corner in corners), WALL_M)
    title = f"{legs} legs, {'in' if inwards else 'out'}"
    return Arena(ends[0], ends[1], moved(goal)).scenario(title, winding)


def ring(rng: np.random.Generator) -> Scenario:
    """A wall without a door, or posts that touch, round the goal or the take-off point."""
    arena = Arena.corner_to_corner(float(rng.uniform(5.0, 7.5)), float(rng.uniform(5.0, 7.5)))
    radius_m, corners = float(rng.uniform(0.85, 1.4)), int(rng.integers(3, 10))
    corners = max(corners, 4 if radius_m > 1.0 else 6)
    # Moved inwards, so that the ring has its own space in the corner.
    inner_m = radius_m + 0.3 - CORNER_M
    goal = (arena.goal[0] - inner_m, arena.goal[1] - inner_m)
    low, centre = arena.low, goal
    if rng.uniform() < 0.3:
        low, centre = (low[0] - inner_m, low[1] - inner_m), (0.0, 0.0)
    arena = Arena(low, arena.high, goal)
    turn = float(rng.uniform(0.0, 2.0 * math.pi))
    points = tuple(
        (
            centre[0] + radius_m * math.cos(turn + 2.0 * math.pi * k / corners),
            centre[1] + radius_m * math.sin(turn + 2.0 * math.pi * k / corners),
        )
        for k in range(corners)
    )
    what = "the goal" if centre == goal else "the take-off point"
    if rng.uniform() < 0.3:
        posts = _palisade(centre, radius_m, float(rng.uniform(0.06, 0.15)))
        return arena.scenario(f"{len(posts)} posts round {what}", posts, reachable=False)
    walls = closed_ring(points, WALL_M)
    return arena.scenario(f"{corners} walls round {what}", walls, reachable=False)


def shelves(rng: np.random.Generator) -> Scenario:
    """A warehouse: shelves back to back in rows, aisles between them, cross aisles, pillars."""
    depth_m, aisle_m = float(rng.uniform(0.4, 0.7)), float(rng.uniform(0.9, 1.3))
    shelf_m, bays = float(rng.uniform(1.2, 2.2)), int(rng.integers(2, 4))
    rows = int(rng.integers(2, 5))
    cross_m = float(rng.uniform(0.9, 1.2))
    width_m = bays * shelf_m + (bays + 1) * cross_m
    length_m = rows * depth_m + (rows + 1) * aisle_m + 0.4
    arena = Arena.corner_to_corner(length_m, width_m)
    found: list[SimObstacle] = []
    for row in range(rows):
        north = arena.low[0] + 0.2 + aisle_m + 0.5 * depth_m + row * (depth_m + aisle_m)
        shut = int(rng.integers(bays + 1)) if rng.uniform() < 0.6 else 0
        for bay in range(bays):
            first = arena.low[1] + cross_m + bay * (shelf_m + cross_m)
            # Now and then goods stand in a cross aisle.
            more_m = cross_m if bay + 1 == shut and bay + 1 < bays else 0.0
            found.append(
                Box(
                    centre_ne_m=(north, first + 0.5 * (shelf_m + more_m)),
                    size_m=(depth_m, shelf_m + more_m),
                )
            )
    clear = tuple(thing for thing in found if arena.is_clear_of(thing, 0.3))
    return arena.scenario(f"{rows} rows of {bays} shelves", clear)


def rows(rng: np.random.Generator) -> Scenario:
    """Equal posts at equal distances across the way: the paper's continuous obstacles.

    One to three straight rows, an arc or a chevron, each symmetric about its middle, which lies
    near the straight line; nothing passes between the posts, but round either end.
    """
    arena = Arena.corner_to_corner(float(rng.uniform(5.5, 8.0)), float(rng.uniform(5.5, 8.0)))
    north, east = arena.goal
    away_m, ahead = math.hypot(north, east), math.atan2(east, north)
    shape, count = int(rng.integers(3)), int(rng.integers(1, 4))
    radius_m = float(rng.uniform(0.05, 0.2))
    pitch_m = 2.0 * radius_m + float(rng.uniform(*GAP_M))
    found: list[SimObstacle] = []
    for index in range(count):
        along_m = away_m * (index + 1.0) / (count + 1.0)
        half = max(1, round(float(rng.uniform(0.5, 1.4)) / pitch_m))
        shift_m = float(rng.uniform(-0.5, 0.5)) if count > 1 else 0.0
        for k in range(-half, half + 1):
            back_m, across_m = _on_shape(shape, k * pitch_m)
            found.append(_post(along_m + back_m, across_m + shift_m, ahead, radius_m))
    clear = tuple(post for post in found if arena.is_clear_of(post))
    name = ("straight", "arched", "bent")[shape]
    return arena.scenario(f"{count} {name} row{'s' if count > 1 else ''}", clear)


def _passages(rng: np.random.Generator, rows: int, columns: int) -> set[tuple[Cell, Cell]]:
    """Pairs of cells without a wall between them: a tree over all of them, dug depth first."""
    dug: set[tuple[Cell, Cell]] = set()
    seen: set[Cell] = {(0, 0)}
    trail: list[Cell] = [(0, 0)]
    while trail:
        row, column = trail[-1]
        beside = [
            cell
            for cell in ((row + 1, column), (row - 1, column), (row, column + 1), (row, column - 1))
            if 0 <= cell[0] < rows and 0 <= cell[1] < columns and cell not in seen
        ]
        if not beside:
            trail.pop()
            continue
        cell = beside[int(rng.integers(len(beside)))]
        dug.add((min((row, column), cell), max((row, column), cell)))
        seen.add(cell)
        trail.append(cell)
    return dug


def _between(a: Cell, b: Cell, width_m: float) -> Wall:
    """The wall between two cells; cell (0, 0) has its middle at the origin."""
    north, east = 0.5 * (a[0] + b[0]) * width_m, 0.5 * (a[1] + b[1]) * width_m
    half_m = 0.5 * (width_m + WALL_M)
    dn, de = (0.0, half_m) if a[0] != b[0] else (half_m, 0.0)
    return Wall(from_ne_m=(north - dn, east - de), to_ne_m=(north + dn, east + de))


def _palisade(centre: Point, radius_m: float, post_m: float) -> tuple[Disc, ...]:
    """Posts on a circle that overlap a little."""
    count = math.ceil(math.pi * radius_m / (0.95 * post_m))
    return tuple(
        Disc(
            centre_ne_m=(
                centre[0] + radius_m * math.cos(2.0 * math.pi * k / count),
                centre[1] + radius_m * math.sin(2.0 * math.pi * k / count),
            ),
            radius_m=post_m,
        )
        for k in range(count)
    )


def _on_shape(shape: int, across_m: float) -> tuple[float, float]:
    """(towards the goal, across) of a post `across_m` along its row: straight, arc, chevron."""
    if shape == 0:
        return (0.0, across_m)
    if shape == 1:
        bow_m = 1.6
        return (bow_m * (math.cos(across_m / bow_m) - 1.0), bow_m * math.sin(across_m / bow_m))
    return (-0.5 * abs(across_m), math.sqrt(0.75) * across_m)


def _post(along_m: float, across_m: float, bearing_rad: float, radius_m: float) -> Disc:
    c, s = math.cos(bearing_rad), math.sin(bearing_rad)
    centre = (c * along_m - s * across_m, s * along_m + c * across_m)
    return Disc(centre_ne_m=centre, radius_m=radius_m)
