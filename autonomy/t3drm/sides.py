"""On which side of the obstacles a path goes, and what going on like that costs.

Two paths between the same ends pass an obstacle on the same side when the loop out on one and back
on the other does not go round it: homotopy, not angle. TangentBug commits itself to a side while it
follows a boundary; T3DRM asks again at every replan, and two sides that are nearly equal would be
taken in turn as noise has it. `on_the_same_side` finds what the chosen side costs now.
"""

import itertools
import math

import msgspec
import numpy as np

from autonomy.geometry import Point, closest_fraction, distance, interpolate
from autonomy.model import NoPlan, Plan
from autonomy.t3drm import kernels
from autonomy.t3drm.kernels import Floats
from autonomy.t3drm.planner import Planner

STILL_THERE_M = 0.05
"""A hit that has none this near to it any more was noise, or has been forgotten."""
SAME_GOAL_M = 0.2
"""The planner moves a goal by less than this; two plans that end farther apart have two goals."""
STEP_M = 0.1
"""How finely a path is searched for the place to bar it."""
ANCHOR_MAX_M = 0.6
"""A path farther than this from every obstacle that it passes on the other side is not barred."""
BAR_SPACING = 1.4
"""Distance of the bar's points in keep-out radii: nothing passes between two of them."""


def switched(before: tuple[Point, ...], after: tuple[Point, ...], known: Floats) -> Floats:
    """Those of the hits known (n, 2) that `after` passes on another side than `before`.

    Both polylines lead from (about) the same place to (about) the same goal, and keep clear of the
    hits; the gaps between their ends are closed by straight lines.
    """
    if known.shape[0] == 0:
        return known
    loop = np.array((*before, *after[::-1]))
    return np.asarray(known[kernels.windings(loop, known) != 0])


def still_there(hits: Floats, among: Floats) -> Floats:
    """Those of the hits (n, 2) that have one of (m, 2) beside them."""
    near2 = STILL_THERE_M * STILL_THERE_M
    kept = [kernels.clearance2(among, n, e) < near2 for n, e in hits.tolist()]
    return hits[np.array(kept, dtype=np.bool_)]


class SideChanges:
    """Counts, over the plans of one flight, those that passed a known obstacle differently."""

    def __init__(self) -> None:
        self.count = 0
        self._plan: Plan | None = None

    def planned(self, point: Point, result: Plan | NoPlan) -> None:
        """The vehicle at `point` was given this result; a plan after none has nothing to change."""
        before = self._plan
        self._plan = None if isinstance(result, NoPlan) else result
        if before is None or isinstance(result, NoPlan):
            return
        elsewhere = before.height_m != result.height_m  # other obstacles there
        if elsewhere or distance(before.points[-1], result.points[-1]) > SAME_GOAL_M:
            return
        course = (point, *_rest(before.points, point))
        passed = switched(course, result.points, hits_of(before))
        if still_there(passed, hits_of(result)).shape[0] > 0:
            self.count += 1


def hits_of(plan: Plan) -> Floats:
    """(n, 2) all hits that were known to a plan."""
    rows = [hit for obstacle in plan.obstacles for hit in obstacle.hits]
    return np.array(rows, dtype=np.float64).reshape(-1, 2)


def _rest(path: tuple[Point, ...], point: Point) -> tuple[Point, ...]:
    """What is left of a path from its place nearest to `point`."""
    best, rest = math.inf, path
    for k, (a, b) in enumerate(itertools.pairwise(path)):
        place = interpolate(a, b, closest_fraction(point, a, b))
        away_m = distance(point, place)
        if away_m < best:
            best, rest = away_m, (place, *path[k + 1 :])
    return rest


def on_the_same_side(
    planner: Planner,
    plan: Plan,
    course: tuple[Point, ...],
    passed: Floats,
    hits: Floats,
    tolerance_m: float,
) -> Plan | None:
    """The path that passes `passed` (n, 2) as the polyline `course` does, for that of `plan`.

    The way of `plan` past them is barred, from one of them outwards, and the rest is planned as
    ever. None when there is no such path, or no place for a bar.
    """
    bar = barred(plan.points, course, passed, planner)
    if bar is None:
        return None
    start, goal = plan.points[0], plan.points[-1]
    kept = planner.plan(start, goal, np.concatenate((hits, bar)), tolerance_m)
    if isinstance(kept, NoPlan) or switched(course, kept.points, passed).shape[0] > 0:
        return None
    # What was met are the hits alone: nobody is shown the bar.
    return msgspec.structs.replace(
        kept,
        environment=plan.environment,
        obstacles=plan.obstacles,
        rejected=(*kept.rejected, plan.points),
    )


def barred(
    path: tuple[Point, ...], course: tuple[Point, ...], passed: Floats, planner: Planner
) -> Floats | None:
    """Points (k, 2) of a straight bar that begins at one of `passed` and crosses `path`.

    It crosses where the path is farthest from `course`, and ends at the fence or before `course`.
    """
    keep_out_m = planner.keep_outs_m[0]
    lane = np.array(course)
    place = _farthest(path, lane, passed)
    if place is None:
        return None
    anchor, at = place
    step_m = BAR_SPACING * planner.keep_outs_m[-1]
    gap_m = distance(anchor, at)
    if gap_m == 0.0:
        return None
    bar: list[Point] = []
    inside = True
    while inside:
        point = interpolate(anchor, at, len(bar) * step_m / gap_m)
        # The first point is a hit itself: the course keeps clear of it already, if only just.
        off_m = kernels.path_clearance(lane, np.array((point,)))
        if bar and off_m < keep_out_m + kernels.SLACK_M:
            break
        bar.append(point)
        inside = planner.fence.inside_distance_m(*point) >= 0.0
    return np.array(bar) if len(bar) * step_m > gap_m else None


def _farthest(path: tuple[Point, ...], lane: Floats, passed: Floats) -> tuple[Point, Point] | None:
    """(hit, place on the path beside it) where the path is farthest from `lane`."""
    best, best_m = None, 0.0
    for at in _strewn(path):
        away = np.hypot(passed[:, 0] - at[0], passed[:, 1] - at[1])
        nearest = int(away.argmin())
        if away[nearest] > ANCHOR_MAX_M:
            continue
        off_m = kernels.path_clearance(lane, np.array((at,)))
        if off_m > best_m:
            best, best_m = ((float(passed[nearest, 0]), float(passed[nearest, 1])), at), off_m
    return best


def _strewn(path: tuple[Point, ...]) -> list[Point]:
    """Points every STEP_M or less along a polyline."""
    points: list[Point] = []
    for a, b in itertools.pairwise(path):
        count = max(1, math.ceil(distance(a, b) / STEP_M))
        points.extend(interpolate(a, b, k / count) for k in range(count))
    return points
