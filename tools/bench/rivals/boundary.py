"""Following an obstacle's boundary by hand: what Bug2 and TangentBug have in common.

The vehicle is a point among hits grown by the keep-out. From the bearing of the nearest hit on the
following hand it turns away until `REACH_M` are free, and flies there: along walls, round their
ends, out of corners, past gaps that it does not fit into.
"""

import math

from autonomy.geometry import Point, distance
from tools.bench.rivals import kernels
from tools.bench.rivals.interface import Floats, View

REACH_M = 0.1
_AWAY_M, _BACK_M = 0.6, 0.15
"""So far from where it began must a round lead before it can end there, and how near that is."""


class Boundary:
    """One obstacle being followed. `side` 1: it is on the left hand; -1: on the right."""

    def __init__(self, at: Point, heading_rad: float, side: int) -> None:
        """`heading_rad`: where the vehicle was going when it met the obstacle."""
        self._began_at, self._side = at, side
        self._heading_rad = heading_rad + side * 0.5 * math.pi
        self.wall_rad = heading_rad
        """Bearing of what is followed."""
        self._last = at
        self._way_m = 0.0
        self._was_away = False

    def step(self, view: View, free: Floats) -> float | None:
        """The bearing to fly; None where nothing is free. `free` is the profile seen from here."""
        self._way_m += distance(self._last, view.point)
        self._last = view.point
        self._was_away = self._was_away or distance(view.point, self._began_at) > _AWAY_M
        n, e = view.point
        self.wall_rad = kernels.wall_bearing(view.near, n, e, self._heading_rad, self._side)
        bearing = kernels.first_free(free, self.wall_rad, self._side, REACH_M)
        if math.isnan(bearing):
            return None
        self._heading_rad = bearing
        return bearing

    @property
    def closed(self) -> bool:
        """True when the way has come back to where it began."""
        near = distance(self._last, self._began_at) <= _BACK_M
        # A pillar's round never leads far from where it began: there its length tells.
        return near and (self._was_away or self._way_m > 4.0 * _AWAY_M)
