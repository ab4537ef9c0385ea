"""A point that sees every hit within its range and flies its plans exactly: theory made to fly."""

from collections.abc import Callable
from dataclasses import dataclass

import msgspec
import numpy as np

from autonomy.geometry import Point, distance
from autonomy.guidance.path import FlownPath
from autonomy.model import NoPlan, Plan
from autonomy.t3drm.bound import BoundTally, PathBound
from autonomy.t3drm.kernels import Floats
from autonomy.t3drm.planner import Planner, violated
from autonomy.t3drm.sides import SideChanges

SIGHT_M = 1.0
STEP_M = 0.05
SLACK_M = 2e-3

Misled = Callable[[Point, Floats], Floats]
"""From where the vehicle is and what it knows to hits that only planning believes in."""


@dataclass(frozen=True)
class IdealFlight:
    """What came of it; `track` holds a point for every step."""

    reached: bool
    length_m: float
    bound: PathBound
    side_changes: int
    track: tuple[Point, ...]


def row(a: Point, b: Point, spacing_m: float = 0.05) -> Floats:
    """(n, 2) hits along the straight line from a to b."""
    count = max(2, round(distance(a, b) / spacing_m) + 1)
    part = np.linspace(0.0, 1.0, count)[:, None]
    return np.asarray((1.0 - part) * np.array(a) + part * np.array(b))


def fly_ideally(
    planner: Planner,
    world: Floats,
    start: Point,
    goal: Point,
    *,
    misled: Misled | None = None,
    limit_m: float = 200.0,
) -> IdealFlight:
    """Fly until the goal, "no way", or `limit_m`; replan whenever something known is in the way."""
    known = np.zeros(world.shape[0], dtype=np.bool_)
    bound, sides = BoundTally(), SideChanges()
    path: FlownPath | None = None
    keep_out_m, flown_m = planner.keep_outs_m[0], 0.0
    point, track = start, [start]
    while flown_m < limit_m and distance(point, goal) > STEP_M:
        known |= np.hypot(world[:, 0] - point[0], world[:, 1] - point[1]) <= SIGHT_M
        hits = world[known]
        believed = hits if misled is None else np.concatenate((hits, misled(point, hits)))
        if path is None or violated(np.array(path.remaining()), believed, keep_out_m - SLACK_M):
            plan = planner.plan(point, goal, believed)
            honest = planner.plan(point, goal, hits) if misled is not None else plan
            bound.planned(distance(point, goal), _met(plan, honest))
            sides.planned(point, _met(plan, honest))
            if isinstance(plan, NoPlan):
                break
            path, keep_out_m = FlownPath(plan.points), plan.keep_out_m
        path.progress_m += STEP_M
        before, point = point, path.point_at(path.progress_m)
        flown_m += distance(before, point)
        track.append(point)
    reached = distance(point, goal) <= STEP_M
    limit = bound.bound(planner.keep_outs_m[0], planner.fence)
    return IdealFlight(reached, flown_m, limit, sides.count, tuple(track))


def _met(plan: Plan | NoPlan, honest: Plan | NoPlan) -> Plan | NoPlan:
    """The plan as if it had been made for what is really there."""
    if isinstance(plan, NoPlan):
        return plan
    return msgspec.structs.replace(plan, obstacles=honest.obstacles)
