"""Artificial potential field: downhill in a field that pulls to the goal and pushes from discs.

Khatib's field (IJRR 1986) with Ge and Cui's correction (IEEE T-RA 2000): the push fades near the
goal, so that a disc beside it does not keep the vehicle away. Strides of fixed length, shorter near
discs. Of 7 repulsions x 5 influences (0.0005 to 0.05, 0.1 to 0.8 m) those that arrived most often
on 120 maps of another seed: 61 of them. No smoothing: a field is followed, not planned.
"""

import numpy as np

from tools.bench.baselines import kernels
from tools.bench.baselines.interface import Answer, discs_of, timed
from tools.bench.maps import Map

REPULSION = 0.002
INFLUENCE_M = 0.8
STRIDE_M = 0.02


class PotentialField:
    """Fails in local minima; that is its nature, not its tuning."""

    name = "potential field"

    def __init__(self, repulsion: float = REPULSION, influence_m: float = INFLUENCE_M) -> None:
        self._repulsion, self._influence_m = repulsion, influence_m

    def plan(self, problem: Map) -> Answer:
        """The way downhill, or None where it ends before the goal."""
        discs = discs_of(problem)
        start, goal = np.array(problem.start), np.array(problem.goal)
        return timed(
            lambda: kernels.descend(
                discs, start, goal, self._repulsion, self._influence_m, STRIDE_M
            )
        )
