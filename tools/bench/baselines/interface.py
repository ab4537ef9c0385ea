"""What every planner of the benchmark offers: a path for a map, and what it cost.

Nobody's word is taken for a path: `tools.bench.scoring` checks and measures every one alike.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from tools.bench.maps import Map

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Answer:
    """A path (k, 2) from start to goal, or None, and the CPU time of the thread that it took."""

    path: Floats | None
    seconds: float


class Baseline(Protocol):
    """A planner. Everything that depends on the map happens inside `plan`, and is timed."""

    @property
    def name(self) -> str:
        """As in the tables."""

    def plan(self, problem: Map) -> Answer:
        """A path, or None when this planner finds none."""


def discs_of(problem: Map) -> Floats:
    """Rows (north, east, reach)."""
    return np.column_stack((problem.centres, problem.reach_m))


def box_of(problem: Map) -> Floats:
    """(low north, low east, high north, high east)."""
    return np.array((*problem.low, *problem.high))


def timed(solve: Callable[[], tuple[bool, Floats]]) -> Answer:
    """Run `solve` on this thread's clock. CPU time, because the machine may have other work."""
    begin = time.thread_time()
    found, path = solve()
    seconds = time.thread_time() - begin
    return Answer(path if found else None, seconds)
