"""A* over the eight neighbours of a grid: the plainest grid planner, and the one most used."""

import numpy as np

from tools.bench.baselines import kernels
from tools.bench.baselines.interface import Answer, box_of, discs_of, timed
from tools.bench.maps import Map

CELL_M = 0.05


class AStar:
    """8-connected A*. Its path has corners of 45 degrees and is up to 8 % too long for that."""

    name = "A*, 8 neighbours"

    def plan(self, problem: Map) -> Answer:
        """The shortest way over cells, laying the grid included."""
        discs, box = discs_of(problem), box_of(problem)
        start, goal = np.array(problem.start), np.array(problem.goal)
        return timed(lambda: kernels.grid_path(discs, start, goal, box, CELL_M, 0))
