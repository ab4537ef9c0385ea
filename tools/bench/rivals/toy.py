"""A vehicle of a few lines for rivals on known outlines: no sensing, no guard, no autopilot.

For unit tests (exact: it flies what it is told) and for the search for gains, where it lags behind
its commands and errs about its place as the simulated vehicle does, at a hundredth of its cost.
"""

import itertools
import math
from dataclasses import dataclass

import numpy as np

from autonomy.config import Config
from autonomy.geometry import Point, distance
from autonomy.perception.obstacle_map import ObstacleMap
from tools.bench.rivals import kernels
from tools.bench.rivals.interface import NEAR_M, Craft, Floats, GivesUp, Rival, View

DT_S = 0.1
LAG_S = 0.3
ERROR_M, ERROR_S = 0.015, 3.0
"""One sigma of what it errs by about its place on each axis, and for how long."""
ARRIVED_M = 0.1


@dataclass(frozen=True, slots=True)
class Flown:
    """What came of it; `least_m` is the least distance of the true centre to the outlines."""

    track: list[Point]
    gave_up: GivesUp | None
    arrived: bool
    least_m: float

    @property
    def length_m(self) -> float:
        """Way flown."""
        return sum(distance(a, b) for a, b in itertools.pairwise(self.track))

    @property
    def seconds(self) -> float:
        """Time flown."""
        return DT_S * (len(self.track) - 1)


def fly(
    rival: Rival,
    outlines: Floats,
    goal: Point,
    *,
    start: Point = (0.0, 0.0),
    limit_s: float = 200.0,
    rng: np.random.Generator | None = None,
    config: Config | None = None,
) -> Flown:
    """From start to goal among points (n, 2) that are known once they were within range.

    With `rng` the vehicle lags and errs; without it does what it is told.
    """
    config = config if config is not None else Config()
    craft = Craft.of(config)
    space = ObstacleMap(config.map, craft.body_m, config.guard.fence)
    known = np.zeros(len(outlines), dtype=np.bool_)
    track, velocity, error = [start], np.zeros(2), np.zeros(2)
    version, least_m = 0, math.inf
    for tick in range(round(limit_s / DT_S)):
        point = track[-1]
        if len(outlines):
            away = np.hypot(outlines[:, 0] - point[0], outlines[:, 1] - point[1])
            least_m = min(least_m, float(away.min()))
            fresh = (away <= craft.range_m) & ~known
            known |= fresh
            version += bool(fresh.any())
        if distance(point, goal) <= ARRIVED_M:
            return Flown(track, None, arrived=True, least_m=least_m)
        if rng is not None:
            kept = math.exp(-DT_S / ERROR_S)
            error = kept * error + ERROR_M * math.sqrt(1.0 - kept**2) * rng.standard_normal(2)
        believed = (float(point[0] + error[0]), float(point[1] + error[1]))
        hits = outlines[known]
        view = View(
            now_s=tick * DT_S,
            dt_s=DT_S,
            point=believed,
            velocity=(float(velocity[0]), float(velocity[1])),
            goal=goal,
            hits=hits,
            near=kernels.within(hits, *believed, NEAR_M),
            version=version,
            space=space,
        )
        answer = rival.decide(view)
        if isinstance(answer, GivesUp):
            return Flown(track, answer, arrived=False, least_m=least_m)
        share = 1.0 if rng is None else DT_S / LAG_S
        velocity = velocity + share * (np.array(answer) - velocity)
        track.append((float(point[0] + velocity[0] * DT_S), float(point[1] + velocity[1] * DT_S)))
    return Flown(track, None, arrived=False, least_m=least_m)
