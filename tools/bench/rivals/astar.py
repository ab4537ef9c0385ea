"""A*, planned anew from nothing whenever the map has changed.

Hart, Nilsson and Raphael (IEEE Trans. SSC 4(2), 1968), on eight neighbours; see grid.py.
"""

from tools.bench.rivals import kernels
from tools.bench.rivals.grid import Gains, GridRival
from tools.bench.rivals.interface import Craft, Floats
from tools.bench.rivals.kernels import Ints


class _Search:
    def solve(self, cost: Floats, start: int, goal: int) -> Ints:
        return kernels.astar(cost, start, goal)


class AStar(GridRival):
    """A* over the grid of costs."""

    def __init__(self, craft: Craft, gains: Gains | None = None) -> None:
        super().__init__(craft, _Search(), gains)
