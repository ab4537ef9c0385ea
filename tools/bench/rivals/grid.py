"""Planning on a grid of costs and following what was planned: A* and D* Lite in closed loop.

What was never seen counts as free (the freespace assumption). Whenever the map has changed, five
times a second at most, the grid is laid anew and the way planned from where the vehicle is; the way
is pulled taut and followed by the carrot that T3DRM's paths are followed by. No way at all: gives
up, not for certain, so that the harness looks round, forgets and asks again as T3DRM's ladder does.
"""

import math
from typing import Protocol

import msgspec

from autonomy.geometry import Point, distance
from autonomy.guidance.follower import carrot_direction
from autonomy.guidance.path import FlownPath
from tools.bench.rivals import kernels
from tools.bench.rivals.interface import Answer, Craft, Floats, GivesUp, View
from tools.bench.rivals.kernels import Ints

CELL_M = 0.05
SPARE_M = 0.12
"""Round the vehicle and the goal cells inside the keep-out are dear instead of blocked: noise may
put a hit too near to either, and no wall is as near as that.
"""
_STRAYED_M = 0.3


class Gains(msgspec.Struct, frozen=True):
    """Chosen by `tuning.py`: how far beyond the keep-out cells cost more, and how much."""

    band_m: float = 0.05
    steep: float = 1.0


class Solver(Protocol):
    """The search itself."""

    def solve(self, cost: Floats, start: int, goal: int) -> Ints:
        """Cells from start to goal; empty when there is no way."""


class GridRival:
    """A grid over the fence's bounding box, and the way being flown."""

    def __init__(self, craft: Craft, solver: Solver, gains: Gains | None = None) -> None:
        self._craft, self._solver = craft, solver
        self._gains = gains if gains is not None else Gains()
        low_n, high_n, low_e, high_e = craft.fence
        self._low = (low_n, low_e)
        self._rows = math.ceil((high_n - low_n) / CELL_M) + 1
        self._columns = math.ceil((high_e - low_e) / CELL_M) + 1
        self._path: FlownPath | None = None
        self._version = -1
        self._planned_s = -math.inf

    def decide(self, view: View) -> Answer:
        """Along the way; gives up where there is none."""
        if self._is_due(view):
            self._planned_s, self._version = view.now_s, view.version
            self._path = self._plan(view)
        if self._path is None:
            self._planned_s = -math.inf
            return GivesUp("no way over the grid")
        guidance = self._craft.config.guidance
        n, e = carrot_direction(self._path, view.point, view.velocity, guidance)
        return (n * self._craft.speed_m_s, e * self._craft.speed_m_s)

    def _is_due(self, view: View) -> bool:
        path = self._path
        if path is None:
            return True
        if view.now_s - self._planned_s < self._craft.config.mission.replan.min_interval_s:
            return False
        strayed = distance(view.point, path.point_at(path.progress_m)) > _STRAYED_M
        return strayed or view.version != self._version

    def _plan(self, view: View) -> FlownPath | None:
        cost = kernels.lay(
            view.hits,
            *self._low,
            CELL_M,
            self._rows,
            self._columns,
            self._craft.keep_out_m,
            self._gains.band_m,
            self._gains.steep,
        )
        start, goal = self._cell(view.point), self._cell(view.goal)
        for cell in (start, goal):
            kernels.spare(cost, cell, SPARE_M / CELL_M)
        cells = self._solver.solve(cost, start, goal)
        if not len(cells):
            return None
        corners = [self._point(cell) for cell in kernels.taut(cost, cells).tolist()]
        return FlownPath((view.point, *corners[1:-1], view.goal))

    def _cell(self, point: Point) -> int:
        row = min(self._rows - 1, max(0, round((point[0] - self._low[0]) / CELL_M)))
        column = min(self._columns - 1, max(0, round((point[1] - self._low[1]) / CELL_M)))
        return row * self._columns + column

    def _point(self, cell: int) -> Point:
        row, column = divmod(cell, self._columns)
        return (self._low[0] + row * CELL_M, self._low[1] + column * CELL_M)
