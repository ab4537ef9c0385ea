"""Out of a narrow place that the vehicle flew into, when the map has closed behind it.

A gap may be entered that is wider than twice the keep-out by less than what position and sensing
err by; seen from inside it reads as closed. The body went through it, so that it may be planned to
go out by the same way, as near to the hits as the guard lets it. Nothing new is entered like this.
"""

import itertools

import numpy as np

from autonomy.config import Config
from autonomy.geometry import Point, distance, interpolate
from autonomy.mission.trail import Trail
from autonomy.model import NoPlan, Plan
from autonomy.t3drm.kernels import Floats
from autonomy.t3drm.planner import Planner

SPARE_M = 0.005
"""A way out is planned this much wider than what the guard stops at."""
FLOWN_WITHIN_M = 0.1
"""Where it is narrow, a way out is no farther than this from the way that was flown."""
_SAMPLE_M = 0.02


class WayOut:
    """Plans back to a place on the way that was flown."""

    def __init__(self, config: Config, trail: Trail) -> None:
        self._trail = trail
        body_m = config.body.radius_m
        clearance_m = config.map.corridor_hit_m + SPARE_M - body_m
        tight = {
            "comfortable_clearance_m": clearance_m,
            "hard_clearance_m": clearance_m,
            "levels": 1,
        }
        self._planner = Planner(config.planner.model_copy(update=tight), body_m, config.guard.fence)
        self._wide_m = body_m + config.planner.hard_clearance_m

    def plan(
        self, point: Point, place: Point, height_m: float, hits: Floats, tolerance_m: float
    ) -> Plan | None:
        """A plan from `point` to `place`, or within the tolerance of it; None where there is none.

        hits: (n, 2) float64 rows (north, east). Where it keeps less from them than every other
        plan does, the vehicle has flown at this height.
        """
        found = self._planner.plan(point, place, hits, tolerance_m)
        if isinstance(found, NoPlan) or not self._is_flown(found.points, height_m, hits):
            return None
        return found

    def _is_flown(self, points: tuple[Point, ...], height_m: float, hits: Floats) -> bool:
        for a, b in itertools.pairwise(points):
            steps = max(1, round(distance(a, b) / _SAMPLE_M))
            for step in range(steps + 1):
                here = interpolate(a, b, step / steps)
                near_m = np.hypot(*(hits - here).T).min(initial=self._wide_m)
                if near_m >= self._wide_m:
                    continue
                if self._trail.distance_m(here, height_m) > FLOWN_WITHIN_M:
                    return False
        return True
