"""The path being flown: whether it is still free, and whether the vehicle gets on along it."""

import numpy as np

from autonomy.geometry import Point, distance
from autonomy.guidance.path import FlownPath
from autonomy.mission.sensing import Sensing
from autonomy.mission.tick import Tick
from autonomy.model import Plan
from autonomy.t3drm.planner import violated

_PATH_SLACK_M = 0.015
"""A hit this much inside the keep-out radius is noise, not an obstacle in the way."""
_STUCK_AFTER_S = 6.0
_STUCK_WITHIN_M = 0.05


class Course:
    """One plan at a time."""

    def __init__(self, sensing: Sensing) -> None:
        self._sensing = sensing
        self.path = FlownPath(((0.0, 0.0),))
        self._keep_out_m = 0.0
        self._free_at: int | None = None
        self._moved_from: tuple[float, Point] | None = None

    def take(self, plan: Plan) -> None:
        """From now on this plan is flown."""
        self.path = FlownPath(plan.points)
        self._keep_out_m = plan.keep_out_m
        self._free_at = None
        self._moved_from = None

    def blocked_ahead_m(self) -> float | None:
        """How far ahead along the path a known hit is too near; None when the path is free.

        A path once found free stays free until the map changes, whose versions never repeat.
        """
        version = self._sensing.map.version
        if version == self._free_at:
            return None
        found = violated(
            np.array(self.path.remaining()),
            self._sensing.map.hits(),
            self._keep_out_m - _PATH_SLACK_M,
        )
        if found is None:
            self._free_at = version
            return None
        return found.distance_m

    def is_stuck(self, tick: Tick) -> bool:
        """True after `_STUCK_AFTER_S` on a path without leaving a small circle."""
        point = tick.fused.point
        if self._moved_from is None or distance(point, self._moved_from[1]) > _STUCK_WITHIN_M:
            self._moved_from = (tick.now_s, point)
            return False
        return tick.now_s - self._moved_from[0] > _STUCK_AFTER_S
