"""Ant colony: MAX-MIN ant system on a grid, its best way pulled taut afterwards.

Ants walk cells they have not been to, drawn to the trails and to the goal. Without smoothing such
ways are half as long again as they need to be, so the best one is resampled and cut short against
the discs themselves (`kernels.shortcut`). Greed and evaporation are the best of 5 x 5 (1 to 6, 0.02
to 0.4) in mean length on 40 maps of another seed; the smoothing matters more than either.
"""

import numpy as np

from tools.bench.baselines import kernels
from tools.bench.baselines.interface import Answer, Floats, box_of, discs_of, timed
from tools.bench.maps import Map

CELL_M = 0.2
ANTS = 30
ROUNDS = 40
GREED = 3.0
EVAPORATION = 0.4
SPACING_M = 0.05


class AntColony:
    """Draws from the generator handed in; a new one gives another path."""

    name = "ant colony, smoothed"

    def __init__(
        self, rng: np.random.Generator, greed: float = GREED, evaporation: float = EVAPORATION
    ) -> None:
        self._rng, self._greed, self._evaporation = rng, greed, evaporation

    def plan(self, problem: Map) -> Answer:
        """The best ant's way after smoothing; None when no ant arrived."""
        return timed(lambda: self._solve(problem))

    def _solve(self, problem: Map) -> tuple[bool, Floats]:
        discs, box = discs_of(problem), box_of(problem)
        start, goal = np.array(problem.start), np.array(problem.goal)
        # Cells that lie on start and goal both: the grid is stretched by a few per mille.
        steps = np.maximum(1, np.round(np.abs(goal - start).max() / CELL_M))
        cell = float(np.abs(goal - start).max() / steps)
        barred, origin = kernels.barred_steps(discs, start, box, cell)
        last_r, last_c = origin + np.round((goal - start) / cell).astype(np.int64)
        columns = barred.shape[1]
        first, last = int(origin[0] * columns + origin[1]), int(last_r * columns + last_c)
        found, cells = kernels.ant_colony(
            barred, first, last, ANTS, ROUNDS, self._greed, self._evaporation, self._rng
        )
        if not found:
            return False, np.empty((0, 2))
        places = np.column_stack((cells // columns, cells % columns)) - origin
        path = start + cell * places
        path[-1] = goal
        return True, kernels.shortcut(discs, path, SPACING_M)
