"""What is still kept after a first move, if the best is made of it: a small space-time search.

A way that is good for four seconds may end in a corner which the movers close. So a first move is
judged by the best that can follow it: on a grid round the vehicle, step by step backwards from the
horizon, each cell keeps the greatest least distance to the movers that any way from there on has.
Cells that no bearing from the vehicle is seen free to are no way (rounded to cells, so that of the
last 8 cm of a bearing some are left out); a way may wait in any other.
"""

import math

import numpy as np
import numpy.typing as npt

from autonomy.geometry import Point

FloatArray = npt.NDArray[np.float64]

CELL_M = 0.08
REACH_CELLS = 15
"""Cells to each side of the vehicle."""
REACH_M = REACH_CELLS * CELL_M
"""How far a retreat is looked at."""
BARRED = -1.0
"""Kept in a cell that is no way, less than what any touch in sight would keep."""
_SIDE = 2 * REACH_CELLS + 1


class Continuations:
    """The cells round one vehicle; `of` judges what moves about there."""

    def __init__(self, speed_m_s: float) -> None:
        """`speed_m_s` is what the vehicle flies at most; diagonal steps take a fifth more."""
        self.speed_m_s = speed_m_s
        self.step_s = 1.2 * CELL_M / speed_m_s
        offsets = np.arange(-REACH_CELLS, REACH_CELLS + 1) * CELL_M
        self._north, self._east = np.meshgrid(offsets, offsets, indexing="ij")
        self._ranges = np.hypot(self._north, self._east)
        self._bearings = np.arctan2(self._east, self._north)

    def times_s(self, from_s: float, until_s: float) -> FloatArray:
        """When the cells are looked at: every step from `from_s`, until `until_s` or later."""
        steps = max(1, math.ceil((until_s - from_s) / self.step_s))
        times: FloatArray = from_s + self.step_s * np.arange(steps + 1, dtype=np.float64)
        return times

    def of(
        self, point: Point, centres: FloatArray, touching_m: FloatArray, reaches_m: FloatArray
    ) -> FloatArray:
        """(cells, cells) least distance kept from the first of the times on, on the best way.

        `centres` (movers, times, 2) and `touching_m` (movers, times) say where what would be
        touched is; `reaches_m` how far each of equally many bearings round `point`, from north on
        clockwise, is seen free.
        """
        barred = self._barred(reaches_m)
        gaps = self._gaps(point, centres, touching_m)
        kept: FloatArray = gaps[-1]
        kept[barred] = BARRED
        for gap in gaps[-2::-1]:
            kept = np.minimum(gap, _best_neighbour(kept))
            kept[barred] = BARRED
        return kept

    def at(self, kept: FloatArray, point: Point, places: FloatArray) -> FloatArray:
        """(k,) what `of` round `point` says of places (k, 2); BARRED off the cells."""
        cells = np.rint((places - np.array(point)) / CELL_M).astype(np.int64) + REACH_CELLS
        inside = ((cells >= 0) & (cells < _SIDE)).all(axis=1)
        cells = np.clip(cells, 0, _SIDE - 1)
        found: FloatArray = np.where(inside, kept[cells[:, 0], cells[:, 1]], BARRED)
        return found

    # ------------------------------------------------------------ inside

    def _barred(self, reaches_m: FloatArray) -> npt.NDArray[np.bool_]:
        """Cells farther away than the bearing nearest to them is free."""
        count = len(reaches_m)
        nearest = np.rint(self._bearings / (2.0 * math.pi / count)).astype(np.int64) % count
        barred: npt.NDArray[np.bool_] = self._ranges > np.maximum(reaches_m[nearest], CELL_M)
        return barred

    def _gaps(self, point: Point, centres: FloatArray, touching_m: FloatArray) -> FloatArray:
        """(times, cells, cells) distance to what would be touched then, the nearest of all."""
        north = self._north + point[0] - centres[..., 0][..., None, None]
        east = self._east + point[1] - centres[..., 1][..., None, None]
        gaps: FloatArray = (np.hypot(north, east) - touching_m[..., None, None]).min(axis=0)
        return gaps


def _best_neighbour(kept: FloatArray) -> FloatArray:
    """(cells, cells) the most that a cell or one beside it keeps."""
    padded = np.full((_SIDE + 2, _SIDE + 2), BARRED)
    padded[1:-1, 1:-1] = kept
    rows = np.maximum(np.maximum(padded[:-2], padded[1:-1]), padded[2:])
    best: FloatArray = np.maximum(np.maximum(rows[:, :-2], rows[:, 1:-1]), rows[:, 2:])
    return best
