"""How far the way along a direction is free, and how fast it may be flown."""

import math
from typing import NamedTuple

from hal.config import GuardConfig
from hal.vehicle.guard.fence_ahead import FenceAhead
from hal.vehicle.guard.limits import FENCE, FREE_SPACE
from hal.vehicle.guard.sight import Sight
from hal.vehicle.guard.stopping import allowed_speed_m_s, needed_distance_m, stopping_speed_m_s

ESCAPE_SPEED_M_S = 0.06
"""How fast the vehicle may leave a place that is too near to a hit."""
ESCAPE_COSINE = 0.4
"""An escape leads away from the nearest hit within about 66 degrees."""
ESCAPE_STEPS_M = (0.025, 0.05, 0.075, 0.1)
"""An escape must reach open space within one of these distances."""


class Way(NamedTuple):
    """One direction: how far it is free, the fastest setpoint, the fastest vehicle that is not yet
    too fast to stop, and what limits them.
    """

    free_m: float
    allowed_m_s: float
    stoppable_m_s: float
    limit: str


class Room:
    """Fence and seen-free space around the vehicle."""

    def __init__(self, config: GuardConfig) -> None:
        self._config = config
        self._fence = FenceAhead(config.fence)
        self.horizon_m = needed_distance_m(config.speed_max_m_s, config)
        """How far ahead must be free for full speed."""

    def way(self, un: float, ue: float, sight: Sight) -> Way:
        """The way along the unit vector (north, east)."""
        sigma = sight.position_sigma_m
        reach_m = self.horizon_m + sigma
        fence_m = self._fence.distance_m(sight.position_ned_m, un, ue, reach_m)
        seen_m = self._seen_m(un, ue, sight, reach_m)
        free_m = min(self.horizon_m, fence_m - sigma, seen_m - sigma)
        limit = FENCE if fence_m < seen_m else FREE_SPACE
        if free_m >= self.horizon_m:
            top_m_s = self._config.speed_max_m_s
            return Way(self.horizon_m, top_m_s, top_m_s, limit)
        allowed = allowed_speed_m_s(free_m, self._config)
        stoppable = stopping_speed_m_s(free_m, self._config.reaction_s, self._config.braking_m_s2)
        if seen_m <= 0.0 and self._is_escape(un, ue, sight):
            allowed = min(ESCAPE_SPEED_M_S, allowed_speed_m_s(fence_m - sigma, self._config))
            stoppable = allowed
        return Way(max(0.0, free_m), allowed, stoppable, limit)

    def _seen_m(self, un: float, ue: float, sight: Sight, reach_m: float) -> float:
        """How far the body's swept corridor is free; what is no number is no free space.

        The map's corridor is wider than the body, for errors of the position to both sides. Where
        these may be larger, the corridors beside it must be free as well.
        """
        aside_m = sight.position_sigma_m - self._config.corridor_sigma_m
        asides = (0.0,) if aside_m <= 0.0 else (0.0, aside_m, -aside_m)
        north, east, down = sight.position_ned_m
        heading = math.atan2(ue, un)
        for aside in asides:
            place = (north - aside * ue, east + aside * un, down)
            seen_m = sight.space.free_distance_m(place, heading, reach_m, sight.now_s)
            reach_m = min(reach_m, seen_m) if seen_m > 0.0 else 0.0
        return reach_m

    def _is_escape(self, un: float, ue: float, sight: Sight) -> bool:
        """Away from a hit that is already too near, to seen and open space within one short step.

        Without it a vehicle that drifted into a hit's keep-out could never leave it: from there no
        direction is free. True when all of these hold:
        - a hit is known within beam_stop_m + the longest step;
        - the direction leads away from the nearest one (cosine at least ESCAPE_COSINE);
        - from one of ESCAPE_STEPS_M along it the way is free (seen, and off every hit).
        """
        position = sight.position_ned_m
        space = sight.space
        heading = math.atan2(ue, un)
        nearest = space.nearest_hit(position, self._config.beam_stop_m + ESCAPE_STEPS_M[-1])
        if nearest is None or not math.cos(heading - nearest[1]) <= -ESCAPE_COSINE:
            return False
        return any(
            space.free_distance_m(
                (position[0] + un * step, position[1] + ue * step, position[2]),
                heading,
                ESCAPE_STEPS_M[0],
                sight.now_s,
            )
            > 0.0
            for step in ESCAPE_STEPS_M
        )
