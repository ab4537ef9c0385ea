"""D* Lite: the same ways as A*, found by repairing the search that was made before.

Koenig and Likhachev, "D* Lite" (AAAI 2002), the optimised version; from the goal to the vehicle, on
eight neighbours; see grid.py.
"""

import numpy as np

from tools.bench.rivals import kernels
from tools.bench.rivals.grid import Gains, GridRival
from tools.bench.rivals.interface import Craft, Floats
from tools.bench.rivals.kernels import Ints


class Repair:
    """The search that is kept from one plan to the next."""

    def __init__(self) -> None:
        self.expanded = 0
        """Cells that the last plan looked at."""
        self._goal = self._start = -1
        self._km = 0.0
        self._cost: Floats = np.empty((0, 0))
        self._begin(self._cost, 0, 0)

    def solve(self, cost: Floats, start: int, goal: int) -> Ints:
        """Cells from start to goal; empty when there is no way."""
        if goal != self._goal or cost.shape != self._cost.shape:
            self._begin(cost, start, goal)
            changed = np.empty(0, dtype=np.int64)
        else:
            self._km += float(_octile(self._start, start, cost.shape[1]))
            changed = np.flatnonzero(cost.ravel() != self._cost.ravel())
        self._start, self._cost = start, cost
        self.expanded = kernels.dstar_replan(
            cost,
            changed,
            self._g,
            self._rhs,
            self._keys,
            self._heap,
            self._place,
            self._small,
            self._km,
            start,
            goal,
        )
        return kernels.dstar_way(cost, self._g, start, goal)

    def _begin(self, cost: Floats, start: int, goal: int) -> None:
        total = max(1, cost.size)
        self._goal, self._start, self._km = goal, start, 0.0
        self._g, self._rhs = np.full(total, np.inf), np.full(total, np.inf)
        self._keys = np.full((total, 2), np.inf)
        self._heap = np.zeros(total, dtype=np.int64)
        self._place = np.full(total, -1, dtype=np.int64)
        self._small = np.ones(1, dtype=np.int64)
        self._rhs[goal] = 0.0
        self._heap[0], self._place[goal] = goal, 0
        self._keys[goal] = (_octile(start, goal, max(1, cost.shape[1])), 0.0)


class DStarLite(GridRival):
    """D* Lite over the grid of costs."""

    def __init__(self, craft: Craft, gains: Gains | None = None) -> None:
        super().__init__(craft, Repair(), gains)


def _octile(a: int, b: int, columns: int) -> float:
    rows, cols = abs(a // columns - b // columns), abs(a % columns - b % columns)
    return max(rows, cols) + 0.41421356 * min(rows, cols)
