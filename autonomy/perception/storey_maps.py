"""One map for each height of flight: what was seen at another height is kept, and kept apart.

The beams see a ring at the vehicle's own height. What is free at 0.3 m says nothing about a table
top at 0.7 m, so the guard is shown the present map alone; planning over and under looks at all.
"""

import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from autonomy.config import MapConfig
from autonomy.geometry import Point
from autonomy.perception.obstacle_map import ObstacleMap
from hal.config import Fence

FloatArray = npt.NDArray[np.float64]

MAPS_MAX = 12
"""More heights than this are not remembered: the one left longest ago is forgotten."""
SAME_M = 1e-6
SAME_OBSTACLE_M = 0.1
"""Hits at two heights nearer than this, seen from above, are of one obstacle."""


class StoreyMaps:
    """Maps by height (m above the take-off point); one of them is present. Deterministic.

    Only the present map is updated. The others do not age by themselves: their sights do, by the
    time that is asked for; their hits stay until rays clear them, or something forgets them.
    """

    def __init__(self, config: MapConfig, body_radius_m: float, fence: Fence) -> None:
        self._config, self._body_radius_m, self._fence = config, body_radius_m, fence
        self._newest_counts = False
        self.height_m = 0.0
        """Height of the present map."""
        self.present = self._new()
        self._away: dict[float, ObstacleMap] = {}

    @property
    def count(self) -> int:
        """How many heights are remembered, the present one included."""
        return 1 + len(self._away)

    def settle(self, height_m: float) -> None:
        """The present map is that of `height_m`: the vehicle is there, and nothing was left."""
        self.height_m = height_m

    def enter(self, height_m: float, point: Point, now_s: float) -> None:
        """The vehicle has come to rest at `height_m`: its map is the present one from now on.

        A new map knows nothing but the disc that the vehicle is in: `start_disc_m`, a little more
        than its body. That ring is an assumption until the vehicle has looked round there, which
        it does before it moves (mission/heights.py); a hit in it counts all the same.
        """
        if abs(height_m - self.height_m) <= SAME_M:
            return
        left = self.present
        self._away[self.height_m] = left
        known = height_m in self._away
        self.present = self._away.pop(height_m) if known else self._new()
        self.height_m = height_m
        while len(self._away) >= MAPS_MAX:
            del self._away[next(iter(self._away))]
        self.present.follow(left.version)
        self.present.mark_seen_disc(point, now_s=now_s)

    def hits_cutting(self, height_m: float, spacing_m: float) -> FloatArray:
        """(n, 2) hits seen not farther than `spacing_m` above or below `height_m`; read-only.

        Those of the map at that height come first, all of them; of another map's only those in
        cells that none before has a hit in.
        """
        maps = [m for h, m in self._all() if abs(h - height_m) <= SAME_M and m.hit_count]
        maps += [m for h, m in self._all() if SAME_M < abs(h - height_m) <= spacing_m + SAME_M]
        found = [m.hits() for m in maps if m.hit_count]
        if not found:
            return np.empty((0, 2))
        if len(found) == 1:
            return found[0]
        return self._one_a_cell(found)

    def guessed(self, height_m: float, spacing_m: float) -> FloatArray:
        """`hits_cutting`, and what is likely to be there: what was seen at other heights only, if
        the nearest of those obstacles that were looked at here too are here as well.

        A wall is guessed to go on at the height at which it began.
        """
        known = self.hits_cutting(height_m, spacing_m)
        own = dict(self._all()).get(height_m)
        others = [m.hits() for h, m in self._all() if abs(h - height_m) > spacing_m + SAME_M]
        elsewhere = np.concatenate(others) if others else np.empty((0, 2))
        if own is None or not len(known) or not len(elsewhere):
            return known
        gap_m = _gaps_m(elsewhere, known)
        there = gap_m <= SAME_OBSTACLE_M
        unknown = ~there & ~own.ever_seen(elsewhere)
        open_m = _gaps_m(elsewhere, elsewhere[~there & ~unknown])
        return self._one_a_cell([known, elsewhere[unknown & (gap_m < open_m)]])

    def shaft_is_free(
        self, point: Point, from_m: float, to_m: float, radius_m: float, *, own: bool
    ) -> bool:
        """True when no hit seen between the two heights is nearer than `radius_m` to `point`.

        The map at `from_m` counts too when `own` says so, that at `to_m` always.
        """
        low, high = sorted((from_m, to_m))
        position = (*point, 0.0)
        return all(
            m.clearance_m(position, 2.0 * radius_m) >= radius_m
            for h, m in self._all()
            if low - SAME_M <= h <= high + SAME_M and (own or abs(h - from_m) > SAME_M)
        )

    def trust_newest(self) -> None:
        """`ObstacleMap.trust_newest`, at every height from now on."""
        self._newest_counts = True
        for _, one in self._all():
            one.trust_newest()

    def forget_within(
        self, point: Point, radius_m: float, keep_disc_m: float, spacing_m: float
    ) -> None:
        """`ObstacleMap.forget_within` on the present map and those that cut its plane."""
        for height_m, one in self._all():
            if abs(height_m - self.height_m) <= spacing_m + SAME_M:
                one.forget_within(point, radius_m, keep_disc_m)

    def forget_cutting(
        self, height_m: float, spacing_m: float, point: Point, keep_disc_m: float
    ) -> None:
        """Forget all that `hits_cutting` would give; at the present height the disc stays seen."""
        for h in [h for h in self._away if abs(h - height_m) <= spacing_m + SAME_M]:
            del self._away[h]
        if abs(self.height_m - height_m) <= spacing_m + SAME_M:
            self.present.forget_all(point, keep_disc_m)

    def forget_all(self, point: Point, keep_disc_m: float) -> None:
        """Forget every height; the disc around `point` was seen at the present one."""
        self._away.clear()
        self.present.forget_all(point, keep_disc_m)

    def all_hits(self) -> FloatArray:
        """(n, 2) hits at whatever height, for pictures."""
        return np.concatenate([one.hits() for _, one in self._all()])

    def _all(self) -> list[tuple[float, ObstacleMap]]:
        return [(self.height_m, self.present), *self._away.items()]

    def _new(self) -> ObstacleMap:
        new = ObstacleMap(self._config, self._body_radius_m, self._fence)
        if self._newest_counts:
            new.trust_newest()
        return new

    def _one_a_cell(self, found: list[FloatArray]) -> FloatArray:
        taken, cells = found[0], _cells(found[0], self._config.cell_m)
        for more in found[1:]:
            theirs = _cells(more, self._config.cell_m)
            new = ~np.isin(theirs, cells)
            taken = np.concatenate((taken, more[new]))
            cells = np.concatenate((cells, theirs[new]))
        return taken


def _gaps_m(points: FloatArray, others: FloatArray) -> FloatArray:
    """(n,) distance of each point (n, 2) to the nearest of the others; inf when there is none."""
    if not len(others):
        return np.full(len(points), np.inf)
    gaps: FloatArray = np.asarray(cKDTree(others).query(points)[0])
    return gaps


def _cells(hits: FloatArray, cell_m: float) -> npt.NDArray[np.int64]:
    """One number for each hit's cell, the same for two hits of one cell."""
    index = np.floor(hits / cell_m).astype(np.int64)
    numbers: npt.NDArray[np.int64] = index[:, 0] * 2_000_003 + index[:, 1]
    return numbers
