"""Where the movers of a scenario are: straight stretches walked at constant speed, with pauses.

A mover's way is a function of its own time, which is the simulation's unless it is polite and
stands still for a vehicle.
"""

import bisect
import itertools
import math
from collections.abc import Iterator, Sequence

import msgspec
import numpy as np

from hal.config import PointNE
from hal.sim.scenario import Mover, SimObstacle

_STEP_M = 0.05
"""A stretch is looked at for obstacles in steps of this."""
_DRAWS_MAX = 200
_WANDER_LEAST_M = 0.3


class Stretch(msgspec.Struct, frozen=True):
    """From one place to another between two times; standing still is a stretch, too."""

    begin_s: float
    end_s: float
    from_ne_m: PointNE
    to_ne_m: PointNE

    @property
    def velocity_ne_m_s(self) -> PointNE:
        """North, east."""
        span_s = self.end_s - self.begin_s
        if not 0.0 < span_s < math.inf:
            return (0.0, 0.0)
        (n0, e0), (n1, e1) = self.from_ne_m, self.to_ne_m
        return ((n1 - n0) / span_s, (e1 - e0) / span_s)

    def at(self, time_s: float) -> PointNE:
        """The place at a time within the stretch."""
        (n, e), (vn, ve) = self.from_ne_m, self.velocity_ne_m_s
        gone_s = time_s - self.begin_s
        return (n + vn * gone_s, e + ve * gone_s)


class Itinerary:
    """One mover's way in its own time; worked out as far as it is asked for."""

    def __init__(self, mover: Mover, obstacles: Sequence[SimObstacle] = ()) -> None:
        self.mover = mover
        self._stops = _stops(mover, obstacles)
        first = next(self._stops)
        wait_s = mover.start_s + mover.pause_s
        self._stretches = [Stretch(0.0, wait_s, first, first)]
        self._ends_s = [wait_s]

    def stretch(self, time_s: float) -> Stretch:
        """The stretch that the mover is on at `time_s` >= 0 of its own time."""
        while self._ends_s[-1] <= time_s:
            self._extend()
        return self._stretches[bisect.bisect_right(self._ends_s, time_s)]

    def _extend(self) -> None:
        mover, last = self.mover, self._stretches[-1]
        place, now_s = last.to_ne_m, last.end_s
        following = next(self._stops, None)
        if following is None:
            self._append(Stretch(now_s, math.inf, place, place))
            return
        arrives_s = now_s + math.dist(place, following) / mover.speed_m_s
        self._append(Stretch(now_s, arrives_s, place, following))
        if mover.pause_s > 0.0:
            self._append(Stretch(arrives_s, arrives_s + mover.pause_s, following, following))

    def _append(self, stretch: Stretch) -> None:
        if stretch.end_s > stretch.begin_s:
            self._stretches.append(stretch)
            self._ends_s.append(stretch.end_s)


def _stops(mover: Mover, obstacles: Sequence[SimObstacle]) -> Iterator[PointNE]:
    """The places that the mover goes to, in order, the first included."""
    path = mover.path_ne_m
    if mover.wander is not None:
        return itertools.chain(path, _wandering(mover, path[-1], obstacles))
    if mover.then == "stay":
        return iter(path)
    if mover.then == "circle":
        return itertools.cycle(path)
    return itertools.cycle((*path, *path[-2:0:-1]))


def _wandering(mover: Mover, place: PointNE, obstacles: Sequence[SimObstacle]) -> Iterator[PointNE]:
    """Random places without end; where none can be reached it stays."""
    wander = mover.wander
    if wander is None:
        return
    rng = np.random.default_rng(wander.seed)
    while True:
        for _ in range(_DRAWS_MAX):
            n, e = rng.uniform(wander.low_ne_m, wander.high_ne_m).tolist()
            there = (n, e)
            far = math.dist(place, there) >= _WANDER_LEAST_M
            if far and _is_free(place, there, mover.radius_m, obstacles):
                break
        else:
            return
        yield there
        place = there


def _is_free(a: PointNE, b: PointNE, radius_m: float, obstacles: Sequence[SimObstacle]) -> bool:
    """True when a disc slides from a to b without touching an obstacle."""
    steps = max(1, math.ceil(math.dist(a, b) / _STEP_M))
    for k in range(steps + 1):
        n, e = a[0] + (b[0] - a[0]) * k / steps, a[1] + (b[1] - a[1]) * k / steps
        if any(obstacle.distance_m(n, e) <= radius_m for obstacle in obstacles):
            return False
    return True


class Walker:
    """A mover as time goes by. Times must not run backwards; a polite one remembers its waits."""

    def __init__(self, mover: Mover, obstacles: Sequence[SimObstacle] = ()) -> None:
        self.mover = mover
        self._itinerary = Itinerary(mover, obstacles)
        self._last_s = 0.0
        self._waited_s = 0.0
        self._waits = False
        self._set(0.0)

    def step(self, time_s: float, vehicle_ne_m: PointNE | None = None) -> None:
        """Be where one is at `time_s`; a polite one stands while the vehicle is near."""
        if self._waits:
            self._waited_s += max(0.0, time_s - self._last_s)
        self._last_s = max(self._last_s, time_s)
        self._set(time_s - self._waited_s)
        if vehicle_ne_m is not None and self.mover.polite_m > 0.0:
            gap_m = math.dist(self.place_ne_m, vehicle_ne_m) - self.mover.radius_m
            self._waits = gap_m < self.mover.polite_m

    def _set(self, own_s: float) -> None:
        own_s = max(0.0, own_s)
        stretch = self._itinerary.stretch(own_s)
        self.place_ne_m = stretch.at(own_s)
        """North, east of its centre."""
        self._velocity = stretch.velocity_ne_m_s

    @property
    def velocity_ne_m_s(self) -> PointNE:
        """North, east."""
        return (0.0, 0.0) if self._waits else self._velocity
