"""Could this hit have been avoided? A bound: what one could do that knows every path.

It begins where the vehicle was when the mover last came into the reach of a beam, flies at the same
greatest speed, needs no time to change its velocity, and must keep off movers, obstacles and fence
until some time after the hit. The places that it can reach are a set of cells that grows by one
cell a step along north and east (so slower than it might on the diagonals) and loses what is
touched. A hit is avoidable when the set does not die out.
"""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from scipy.ndimage import binary_dilation

from autonomy.geometry import Point
from hal.sim.movers import Itinerary
from hal.sim.scenario import Scenario

CELL_M = 0.05
HALF_M = 2.5
AFTER_S = 2.0

Grid = npt.NDArray[np.float64]


def is_avoidable(
    scenario: Scenario, from_s: float, place: Point, hit_s: float, speed_m_s: float
) -> bool:
    """True when a vehicle at `place` at `from_s` can stay free until 2 s after the hit."""
    centres = place[0] + _offsets()[:, None], place[1] + _offsets()[None, :]
    open_cells = _free_of_what_stands(scenario, *centres)
    ways = [Itinerary(mover, scenario.obstacles) for mover in scenario.movers]
    reached = np.zeros(open_cells.shape, dtype=np.bool_)
    middle = open_cells.shape[0] // 2
    reached[middle, middle] = True
    step_s = CELL_M / speed_m_s
    for step in range(1, 1 + round((hit_s + AFTER_S - from_s) / step_s)):
        free = open_cells & _free_of_movers(scenario, ways, from_s + step * step_s, *centres)
        reached = binary_dilation(reached) & free
        if not reached.any():
            return False
    return True


def _offsets() -> Grid:
    cells = round(HALF_M / CELL_M)
    return np.linspace(-HALF_M, HALF_M, 2 * cells + 1)


def _free_of_what_stands(scenario: Scenario, norths: Grid, easts: Grid) -> npt.NDArray[np.bool_]:
    body_m = scenario.vehicle.body_radius_m
    free = np.ones((norths.shape[0], easts.shape[1]), dtype=np.bool_)
    for i, north in enumerate(norths[:, 0].tolist()):
        for j, east in enumerate(easts[0].tolist()):
            free[i, j] = scenario.fence.inside_distance_m(north, east) >= 0.0 and all(
                obstacle.distance_m(north, east) > body_m for obstacle in scenario.obstacles
            )
    return free


def _free_of_movers(
    scenario: Scenario, ways: Sequence[Itinerary], time_s: float, norths: Grid, easts: Grid
) -> npt.NDArray[np.bool_]:
    body_m = scenario.vehicle.body_radius_m
    free = np.ones((norths.shape[0], easts.shape[1]), dtype=np.bool_)
    for way in ways:
        north, east = way.stretch(time_s).at(time_s)
        free &= np.hypot(norths - north, easts - east) > way.mover.radius_m + body_m
    return free
