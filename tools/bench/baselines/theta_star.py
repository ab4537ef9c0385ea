"""Theta*: A* on a grid whose paths may take any angle."""

import numpy as np

from tools.bench.baselines import kernels
from tools.bench.baselines.astar import CELL_M
from tools.bench.baselines.interface import Answer, box_of, discs_of, timed
from tools.bench.maps import Map


class ThetaStar:
    """Theta* on the grid of A*, with sight tested against the discs themselves."""

    name = "Theta*, any angle"

    def plan(self, problem: Map) -> Answer:
        """An any-angle path with corners at cell centres, laying the grid included."""
        discs, box = discs_of(problem), box_of(problem)
        start, goal = np.array(problem.start), np.array(problem.goal)
        return timed(lambda: kernels.grid_path(discs, start, goal, box, CELL_M, 1))
