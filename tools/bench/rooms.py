"""Seeded small rooms to fly in, open or closed, and the truth about them: how narrow the way is.

A room is a scenario like the shipped ones: four walls, and discs, boxes and walls strewn over it.
Take-off point and goal stand in opposite corners, free of everything by `END_FREE_M`.
"""

import math

import numpy as np

from autonomy.config import Config
from autonomy.geometry import Point
from autonomy.planning import outline_hits
from autonomy.simulation import with_scenario
from autonomy.t3drm.spherical import Route, fence_planes, shortest_path
from hal.config import Fence
from hal.sim.scenario import Box, Disc, Scenario, SimObstacle, Wall

END_FREE_M = 0.35
"""Nothing stands nearer than this to the take-off point or the goal."""
SIDE_M = (2.6, 4.2)
DOOR_IN, DOOR_M = 0.5, (0.36, 0.9)
"""In this share of the open rooms a wall divides the room; how wide its door is."""
OFF_THE_WALLS_M = 0.2
"""The fence, which the vehicle's centre stays in, is this far inside the walls."""
CORNER_M = 0.6
"""How far take-off point and goal are from the walls of their corners."""
SENSING_M = 0.02
"""What sensing may take from each side of a gap: a narrower one may read as closed. With the
keep-out floor of 0.21 m a passage of 0.46 m is found."""
OUTLINE_M = 0.01
"""Outlines are sampled as finely; at 0.2 m the error of a passage is then 0.1 mm."""
_BISECTIONS = 12


def shipped_config(scenario: Scenario, mode: str) -> Config:
    """The configuration as shipped, in this room and mode of replanning."""
    return with_scenario(Config.model_validate({"mission": {"replan": {"mode": mode}}}), scenario)


def room(number: int, *, closed: bool = False, seed: int = 0) -> Scenario:
    """Room `number` of family `seed`. `closed`: the goal stands in a chamber without a door.

    Open rooms may have no way all the same: `passage_m` says.
    """
    rng = np.random.default_rng((seed, number, int(closed)))
    side = float(rng.uniform(*SIDE_M))
    low, high = -CORNER_M, side - CORNER_M
    goal = (high - CORNER_M, high - CORNER_M)
    if closed:
        goal = (high - 0.85, high - 0.85)
    obstacles: list[SimObstacle] = list(_walls_round(low, high))
    if closed:
        obstacles += _chamber(goal)
    elif rng.uniform() < DOOR_IN:
        obstacles += _door(rng, low, high)
    # So that the clutter takes up about as much of a small room as of a large one.
    wanted = 1 + round(0.5 * side * side * rng.uniform(0.4, 1.0))
    while wanted > 0:
        obstacle = _obstacle(rng, low, high)
        wanted -= 1
        if min(obstacle.distance_m(0.0, 0.0), obstacle.distance_m(*goal)) >= END_FREE_M:
            obstacles.append(obstacle)
    inside = (low + OFF_THE_WALLS_M, high - OFF_THE_WALLS_M)
    return Scenario(
        name=f"{'closed' if closed else 'open'} room {number}",
        obstacles=tuple(obstacles),
        goal_ne_m=goal,
        fence=Fence.rectangle(inside, inside),
        reachable=not closed,
    )


def passage_m(scenario: Scenario, config: Config) -> float:
    """Radius of the widest disc that can be slid from the take-off point to the goal.

    Its centre stays inside the scenario's fence, which must be convex. Exact up to the sampling of
    the outlines, by bisection over the exact tangent search; at most END_FREE_M.
    """
    flown = with_scenario(config, scenario)
    hits = np.array(outline_hits(scenario, flown, OUTLINE_M), dtype=np.float64).reshape(-1, 2)
    low, high = 0.0, END_FREE_M
    if is_way(scenario, hits, high):
        return high
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if is_way(scenario, hits, middle) else (low, middle)
    return low


def is_way(
    scenario: Scenario, hits: "np.ndarray[tuple[int, int], np.dtype[np.float64]]", radius_m: float
) -> bool:
    """True when a disc of this radius passes between the (n, 2) points and inside the fence."""
    planes = fence_planes(scenario.fence.outline_ne_m)
    if planes is None:
        raise ValueError(f"{scenario.name}: the fence is not convex")
    radii = np.full(hits.shape[0], max(radius_m, OUTLINE_M))
    return isinstance(shortest_path((0.0, 0.0), scenario.goal_ne_m, hits, radii, planes), Route)


def _walls_round(low: float, high: float) -> tuple[Wall, ...]:
    corners = ((low, low), (high, low), (high, high), (low, high))
    return tuple(
        Wall(from_ne_m=a, to_ne_m=b, thickness_m=0.02)
        for a, b in zip(corners, corners[1:] + corners[:1], strict=True)
    )


def _door(rng: np.random.Generator, low: float, high: float) -> list[SimObstacle]:
    """A wall across the room, from wall to wall, with a door in it."""
    at, width = 0.5 * (low + high), float(rng.uniform(*DOOR_M))
    door = float(rng.uniform(low + 0.2, high - 0.2 - width))
    ends = [(low, door), (door + width, high)]
    along_east = bool(rng.integers(2))
    return [
        Wall(from_ne_m=(at, a), to_ne_m=(at, b))
        if along_east
        else Wall(from_ne_m=(a, at), to_ne_m=(b, at))
        for a, b in ends
    ]


def _chamber(goal: Point) -> list[SimObstacle]:
    half = 0.5
    (n, e) = goal
    corners = (
        (n - half, e - half),
        (n + half, e - half),
        (n + half, e + half),
        (n - half, e + half),
    )
    return [
        Wall(from_ne_m=a, to_ne_m=b, thickness_m=0.06)
        for a, b in zip(corners, corners[1:] + corners[:1], strict=True)
    ]


def _obstacle(rng: np.random.Generator, low: float, high: float) -> SimObstacle:
    """A disc, a box or a wall anywhere in the room."""
    north, east = (float(x) for x in rng.uniform(low + 0.2, high - 0.2, 2))
    kind = int(rng.integers(3))
    if kind == 0:
        return Disc(centre_ne_m=(north, east), radius_m=float(rng.uniform(0.05, 0.25)))
    turn = float(rng.uniform(0.0, math.pi))
    if kind == 1:
        size = (float(rng.uniform(0.15, 0.5)), float(rng.uniform(0.15, 0.5)))
        return Box(centre_ne_m=(north, east), size_m=size, yaw_deg=math.degrees(turn))
    half = float(rng.uniform(0.3, 0.9))
    dn, de = half * math.cos(turn), half * math.sin(turn)
    return Wall(from_ne_m=(north - dn, east - de), to_ne_m=(north + dn, east + de))
