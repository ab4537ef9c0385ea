"""What is so in a world, whoever flies: is there a way, how short, how narrow, how winding."""

import math

import msgspec
import numpy as np
from numpy.typing import NDArray

from autonomy.config import Config
from autonomy.geometry import Point, distance
from autonomy.planning import outline_hits
from autonomy.simulation import with_scenario
from autonomy.t3drm.spherical import (
    Arc,
    NoRouteReason,
    Route,
    fence_planes,
    shortest_path,
)
from hal.sim.scenario import Box, Disc, Scenario, Wall
from tools.bench.rooms import END_FREE_M

Floats = NDArray[np.float64]

BEND_RAD = math.radians(10.0)
"""Less than this in one sense is no turn."""
RASTER_M = 0.05
NARROW_M = 0.1
"""A passage of a smaller radius counts as none: no body that flies here is as small."""
SPACING_M = 0.02
"""Of the points on outlines: a passage of NARROW_M is told 0.5 mm too wide, one of 0.24 m 0.2."""
_ACTIVE_MAX = 1000
_BISECTIONS = 12
_TOUCH_M = 1e-3
"""So far over a top, or under an underside, the body counts as past it."""


class Truth(msgspec.Struct, frozen=True):
    """The truth for a vehicle that knows everything. Movers count as absent.

    It flies at one height, the best of those within the guard's limits: it climbs at the take-off
    point and descends at the goal, and neither counts into a length.
    """

    reachable: bool
    """The body's disc can be brought to the goal. What flies keeps more away (r_min)."""
    optimum_m: float | None
    """Length of the shortest way of the body's centre; None where there is none."""
    passage_m: float
    """Radius of the widest disc that gets to the goal: half the narrowest place on the best way.
    At most `tools.bench.rooms.END_FREE_M`, and 0 instead of less than NARROW_M."""


class Difficulty(msgspec.Struct, frozen=True):
    """How hard a world is."""

    density: float
    """Share of the fence's area where the body's centre cannot be, at the mission's height."""
    passage_m: float
    """As in Truth."""
    detour: float | None
    """Optimum over the straight line; None where there is no way."""
    turns: int
    """How often the shortest way bends by BEND_RAD or more without bending back."""
    turning_deg: float
    """All its bends together."""


def truth(scenario: Scenario, config: Config) -> Truth:
    """The truth about a world whose fence is convex; ValueError where it is not.

    Exact but for the sampling of outlines (SPACING_M), by the exact tangent search.
    """
    return _told(*_best(scenario, config))


def difficulty(scenario: Scenario, config: Config) -> Difficulty:
    """How hard it is to fly there; raises as `truth`."""
    return assessed(scenario, config)[1]


def assessed(scenario: Scenario, config: Config) -> tuple[Truth, Difficulty]:
    """Both at once, for the price of one."""
    route, passage = _best(scenario, config)
    told = _told(route, passage)
    bends = _bends(route)
    straight_m = distance((0.0, 0.0), scenario.goal_ne_m)
    return told, Difficulty(
        density(scenario, config),
        passage,
        told.optimum_m / straight_m if told.optimum_m is not None else None,
        sum(bend >= BEND_RAD for bend in bends),
        math.degrees(sum(bends)),
    )


def is_way(scenario: Scenario, config: Config, radius_m: float) -> bool:
    """True when a disc of this radius gets to the goal at one height at least."""
    return any(
        _route(scenario, at_height(config, height_m), radius_m) is not None
        for height_m in heights_m(scenario, config)
    )


def heights_m(scenario: Scenario, config: Config) -> tuple[float, ...]:
    """Heights of flight that stand for all others: the mission's, and past each top and underside.

    Between two of them what is in the way does not change, so that no other height is better.
    """
    guard, half_m = config.guard, config.body.half_height_m + _TOUCH_M
    edges = {config.mission.altitude_m}
    for obstacle in scenario.obstacles:
        if obstacle.base_m > 0.0:
            edges.add(obstacle.base_m - half_m)
        if obstacle.height_m is not None:
            edges.add(obstacle.height_m + half_m)
    highest_m = guard.altitude_max_m
    if scenario.ceiling_m is not None:
        highest_m = min(highest_m, scenario.ceiling_m - half_m)
    first = config.mission.altitude_m
    rest = sorted(edges - {first})
    return (first, *(h for h in rest if guard.altitude_min_m <= h <= highest_m))


def at_height(config: Config, height_m: float) -> Config:
    """The same configuration, its mission at another height."""
    mission = config.mission.model_copy(update={"altitude_m": height_m})
    return config.model_copy(update={"mission": mission})


def density(scenario: Scenario, config: Config) -> float:
    """Share of the fence's area where the body's centre cannot be, counted on a raster."""
    ring = np.array(scenario.fence.outline_ne_m)
    low, high = ring.min(axis=0), ring.max(axis=0)
    north, east = (
        np.arange(a + RASTER_M / 2.0, b, RASTER_M) for a, b in zip(low, high, strict=True)
    )
    cells = np.stack(np.meshgrid(north, east, indexing="ij"), axis=-1).reshape(-1, 2)
    planes = _planes(scenario)
    inside = cells[(cells @ planes[:, :2].T >= planes[:, 2]).all(axis=1)]
    if not inside.shape[0]:
        return 0.0
    barred = np.zeros(inside.shape[0], dtype=np.bool_)
    half_m, altitude_m = config.body.half_height_m, config.mission.altitude_m
    for obstacle in scenario.obstacles:
        if obstacle.base_m > altitude_m + half_m:
            continue
        if obstacle.height_m is not None and obstacle.height_m < altitude_m - half_m:
            continue
        barred |= _distances_m(obstacle, inside) < config.body.radius_m
    return float(barred.mean())


def _distances_m(obstacle: Disc | Box | Wall, points: Floats) -> Floats:
    """Signed distances of (n, 2) points from an obstacle's outline: `distance_m` for many."""
    if isinstance(obstacle, Disc):
        return np.asarray(np.hypot(*(points - obstacle.centre_ne_m).T) - obstacle.radius_m)
    footprint = obstacle.footprint
    c, s = math.cos(footprint.yaw_rad), math.sin(footprint.yaw_rad)
    north, east = (points - footprint.centre_ne_m).T
    along = np.abs(c * north + s * east) - footprint.half_along_m
    across = np.abs(c * east - s * north) - footprint.half_across_m
    outside = np.hypot(np.maximum(along, 0.0), np.maximum(across, 0.0))
    return np.asarray(outside + np.minimum(np.maximum(along, across), 0.0))


def _best(scenario: Scenario, config: Config) -> tuple[Route | None, float]:
    """The shortest way of all heights, and the widest passage of all heights."""
    best: Route | None = None
    widest_m = 0.0
    for height_m in heights_m(scenario, config):
        there = at_height(config, height_m)
        route = _route(scenario, there, config.body.radius_m)
        if route is not None and (best is None or route.length_m < best.length_m):
            best = route
        widest_m = max(widest_m, _passage_m(scenario, there, widest_m))
    return best, widest_m


def _passage_m(scenario: Scenario, config: Config, known_m: float) -> float:
    """Radius of the widest disc that gets to the goal at the mission's height; 0 below NARROW_M.

    `known_m`: what passes at another height; less than that need not be told exactly.
    """
    low_m, high_m = max(known_m, NARROW_M), END_FREE_M
    if low_m >= high_m or _route(scenario, config, high_m) is not None:
        return high_m
    if _route(scenario, config, low_m) is None:
        return 0.0
    for _ in range(_BISECTIONS):
        middle_m = 0.5 * (low_m + high_m)
        if _route(scenario, config, middle_m) is not None:
            low_m = middle_m
        else:
            high_m = middle_m
    return low_m


def _told(route: Route | None, passage: float) -> Truth:
    return Truth(route is not None, route.length_m if route is not None else None, passage)


def _route(scenario: Scenario, config: Config, radius_m: float) -> Route | None:
    """The shortest way of a disc at the mission's height."""
    flown = with_scenario(config, scenario)
    hits = np.array(outline_hits(scenario, flown, SPACING_M), dtype=np.float64).reshape(-1, 2)
    radii = np.full(hits.shape[0], radius_m)
    found = shortest_path(
        (0.0, 0.0), scenario.goal_ne_m, hits, radii, _planes(scenario), _ACTIVE_MAX
    )
    if isinstance(found, Route):
        return found
    if found.reason is NoRouteReason.TOO_MANY:
        raise ValueError(
            f"{scenario.name}: more than {_ACTIVE_MAX} points of outlines matter, too many to tell "
            "whether there is a way: use a smaller world"
        )
    return None


def _planes(scenario: Scenario) -> Floats:
    planes = fence_planes(scenario.fence.outline_ne_m)
    if planes is None:
        raise ValueError(f"{scenario.name}: the fence is not convex")
    return planes


def _bends(route: Route | None) -> list[float]:
    """What the way turns in one sense before it turns in the other, in radians."""
    bends: list[float] = []
    sense = 0.0
    for piece in route.pieces if route is not None else ():
        if isinstance(piece, Arc) and piece.sweep_rad != 0.0:
            if math.copysign(1.0, piece.sweep_rad) != sense:
                bends.append(0.0)
            sense = math.copysign(1.0, piece.sweep_rad)
            bends[-1] += abs(piece.sweep_rad)
    return bends


def corners(route: Route) -> tuple[Point, ...]:
    """A way as a polyline to draw."""
    found = [route.pieces[0].start]
    for piece in route.pieces:
        found.extend(piece.polyline(1e-3)[1:] if isinstance(piece, Arc) else (piece.end,))
    return tuple(found)


def shortest_way(scenario: Scenario, config: Config) -> tuple[Point, ...]:
    """The optimum as a polyline, () where there is none; raises as `truth`."""
    route, _ = _best(scenario, config)
    return corners(route) if route is not None else ()
