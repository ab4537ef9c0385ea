"""Following an obstacle's boundary by hand: what Bug2 and TangentBug have in common.

The vehicle is a point among hits grown by the keep-out. From the bearing of the nearest hit on the
following hand it turns away until `REACH_M` are free, and flies there: along walls, round their
ends, out of corners, past gaps that it does not fit into.
"""

import math

from autonomy.geometry import Point, distance
from hal.frames import wrap_pi
from tools.bench.rivals import kernels
from tools.bench.rivals.interface import Floats, View

REACH_M = 0.1
_AWAY_M, _BACK_M = 0.6, 0.1
"""So far from where it began must a round lead before it can end there, and how near that is."""
_SETTLES_M = 0.15
"""After so much way it flies as near to the boundary as it will: there the round begins."""
_ALIKE_RAD = math.radians(60.0)


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
        self._first_rad = self._heading_rad

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
        if self._way_m < _SETTLES_M:
            self._began_at, self._first_rad = view.point, bearing
        self._heading_rad = bearing
        return bearing

    @property
    def closed(self) -> bool:
        """True when the way has come back to where it began, and goes on as it did then.

        Out of a narrow dead end it leads past where it began, too, the other way.
        """
        near = distance(self._last, self._began_at) <= _BACK_M
        if not near or abs(wrap_pi(self._heading_rad - self._first_rad)) > _ALIKE_RAD:
            return False
        # A pillar's round never leads far from where it began: there its length tells.
        return self._was_away or self._way_m > 4.0 * _AWAY_M
