"""How far the fence is along a direction."""

import itertools
import math

from hal.config import Fence
from hal.frames import Vector3

INWARD_STEP_M = 0.01
INWARD_COSINE = 0.3
ROUNDING_M = 1e-9


class FenceAhead:
    """Distances to one fence. Its memory only saves computing: answers do not depend on it."""

    def __init__(self, fence: Fence) -> None:
        self._fence = fence
        corners = fence.outline_ne_m
        self._edges = tuple(itertools.pairwise((*corners, corners[0])))
        self._known_at = (0.0, 0.0)
        self._known_inside_m = fence.inside_distance_m(*self._known_at)

    def distance_m(self, position: Vector3, un: float, ue: float, reach_m: float) -> float:
        """How far along the unit vector (north, east) the fence is, at most `reach_m`.

        Outside (or on it): `reach_m` for a direction that leads inwards, else 0.
        """
        # The distance changes by no more than the way travelled since it was last computed.
        north, east = position[0], position[1]
        travelled_m = math.hypot(north - self._known_at[0], east - self._known_at[1])
        if self._known_inside_m - travelled_m >= reach_m:
            return reach_m
        inside_m = self._fence.inside_distance_m(north, east)
        self._known_at, self._known_inside_m = (north, east), inside_m
        if inside_m <= ROUNDING_M:
            ahead_m = self._fence.inside_distance_m(
                north + un * INWARD_STEP_M, east + ue * INWARD_STEP_M
            )
            return reach_m if ahead_m - inside_m >= INWARD_COSINE * INWARD_STEP_M else 0.0
        for a, b in self._edges:
            reach_m = min(reach_m, crossing_m(north, east, un, ue, a, b))
        return reach_m


def crossing_m(
    north: float, east: float, un: float, ue: float, a: tuple[float, float], b: tuple[float, float]
) -> float:
    """Where the ray from (north, east) along (un, ue) meets the edge a-b; inf when it does not."""
    edge_n, edge_e = b[0] - a[0], b[1] - a[1]
    cross = un * edge_e - ue * edge_n
    if cross == 0.0:
        return math.inf
    from_n, from_e = a[0] - north, a[1] - east
    along_ray = (from_n * edge_e - from_e * edge_n) / cross
    along_edge = (from_n * ue - from_e * un) / cross
    if along_ray < 0.0 or not -ROUNDING_M <= along_edge <= 1.0 + ROUNDING_M:
        return math.inf
    return along_ray
