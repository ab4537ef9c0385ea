"""Out of a place that the vehicle flew into, when the map has closed behind it.

A gap may be entered that is wider than twice the keep-out by less than what position and sensing
err by; seen from inside it reads as closed. The body went through it, so that it may be planned to
go out by the same way, nearly as near to the hits as the guard lets it. What is as narrow and was
not flown is not entered like this.
"""

from collections.abc import Iterator

import msgspec
import numpy as np

from autonomy.config import Config
from autonomy.geometry import Point, distance
from autonomy.guidance.path import FlownPath
from autonomy.mission.trail import JOINED_M, STEP_M, Trail
from autonomy.model import Plan
from autonomy.t3drm.kernels import Floats
from autonomy.t3drm.planner import Planner

SPARE_M = 0.005
"""A way out is planned this much wider than what the guard stops at."""
FLOWN_WITHIN_M = 0.1
"""Where it is narrow, a way out is no farther than this from the way that was flown."""
NEAREST_M = 0.3
"""It leads so far away, or twice as far, or four times: to the first open crumb that helps."""
STRETCH_MAX_M = 2.0 * STEP_M
"""Crumbs that lie farther apart have something between them that was not flown under this eye."""
_SAMPLE_M = 0.02
_SLACK_M = 0.002


class WayOut:
    """Plans below the keep-out of every other plan, along what was flown and no other way."""

    def __init__(self, config: Config, planner: Planner, trail: Trail) -> None:
        """`planner`: the one whose ways count beyond the narrow place."""
        self._planner = planner
        self._trail = trail
        body_m = config.body.radius_m
        clearance_m = config.map.corridor_hit_m + SPARE_M - body_m
        clearance_m = min(clearance_m, config.planner.hard_clearance_m)
        tight = {
            "comfortable_clearance_m": clearance_m,
            "hard_clearance_m": clearance_m,
            "levels": 1,
        }
        self._tight = Planner(config.planner.model_copy(update=tight), body_m, config.guard.fence)

    def plan(
        self, point: Point, goal: Point, height_m: float, hits: Floats, tolerance_m: float
    ) -> Plan | None:
        """To an open place on the way flown from which there is a way to the goal; None without.

        hits: (n, 2) float64 rows (north, east). Where the plan keeps less from them than every
        other plan does, the vehicle has flown at this height within FLOWN_WITHIN_M, if perhaps
        with more room. `tolerance_m`: of the goal, as in `Planner.plan`.
        """
        for place in self._open_places(point, height_m):
            if not isinstance(self._planner.seek(place, goal, hits, tolerance_m), Plan):
                continue
            found = self._tight.seek(point, place, hits)
            if isinstance(found, Plan) and self._is_flown(found, point, height_m, hits):
                return msgspec.structs.replace(found, height_m=height_m)
        return None

    def _open_places(self, point: Point, height_m: float) -> Iterator[Point]:
        """Newest first, each about twice as far as the one before."""
        away_m = NEAREST_M
        for place in self._trail.open_places(height_m):
            if distance(point, place) >= away_m:
                yield place
                away_m = 2.0 * distance(point, place)

    def _is_flown(self, plan: Plan, point: Point, height_m: float, hits: Floats) -> bool:
        path = FlownPath(plan.points)
        steps = max(1, round(path.length_m / _SAMPLE_M))
        places = np.array([path.point_at(path.length_m * k / steps) for k in range(steps + 1)])
        apart = places[:, None, :] - hits.reshape(-1, 2)
        near_m = np.hypot(apart[:, :, 0], apart[:, :, 1]).min(axis=1, initial=np.inf)
        narrow = places[near_m < self._planner.keep_outs_m[-1] - _SLACK_M]
        return narrow.shape[0] == 0 or self._was_flown(narrow, point, height_m)

    def _was_flown(self, places: Floats, point: Point, height_m: float) -> bool:
        stretches = self._trail.stretches(height_m, STRETCH_MAX_M)
        newest = self._trail.newest(height_m)
        # The next crumb may be a step away, and more where it closes a loop.
        if newest is not None and np.hypot(*np.subtract(point, newest)) <= STEP_M + JOINED_M:
            stretches += ((newest, point),)
        if not stretches:
            return False
        begin, end = (np.array(ends) for ends in zip(*stretches, strict=True))
        along = end - begin
        squared = np.maximum((along**2).sum(axis=1), 1e-12)
        share = ((places[:, None, :] - begin) * along).sum(axis=2) / squared
        nearest = begin + np.clip(share, 0.0, 1.0)[:, :, None] * along
        apart = places[:, None, :] - nearest
        away_m = np.hypot(apart[:, :, 0], apart[:, :, 1]).min(axis=1)
        return bool((away_m <= FLOWN_WITHIN_M).all())
