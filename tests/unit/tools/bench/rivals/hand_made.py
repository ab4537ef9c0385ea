"""Hand-made maps, and a vehicle that flies exactly what it is told and sees a metre far."""

import itertools
import math
from dataclasses import dataclass

import numpy as np

from autonomy.config import Config
from autonomy.geometry import Point, distance
from autonomy.perception.obstacle_map import ObstacleMap
from tools.bench.rivals import kernels
from tools.bench.rivals.interface import NEAR_M, Craft, Floats, GivesUp, Rival, View

CONFIG = Config()
CRAFT = Craft.of(CONFIG)
DT_S = 0.1
NOTHING: Floats = np.empty((0, 2))


def line(a: Point, b: Point, spacing_m: float = 0.03) -> Floats:
    count = max(2, math.ceil(distance(a, b) / spacing_m) + 1)
    return np.linspace(a, b, count)


def lines(*corners: Point) -> Floats:
    return np.concatenate([line(a, b) for a, b in itertools.pairwise(corners)])


WALL = lines((1.5, -0.8), (1.5, 0.6))
"""Across the straight way from (0, 0) to (3, 0)."""
POST = lines((1.5, -0.05), (1.6, 0.05), (1.6, 0.15), (1.5, 0.15), (1.5, -0.05))
"""Thin, and a little to the right of the straight way."""
U = lines((0.6, -0.7), (1.6, -0.7), (1.6, 0.7), (0.6, 0.7))
"""Open towards (0, 0), closed towards (3, 0)."""
RING = lines((2.4, -0.6), (3.6, -0.6), (3.6, 0.6), (2.4, 0.6), (2.4, -0.6))
"""All round (3, 0)."""


@dataclass
class Flown:
    track: list[Point]
    gave_up: GivesUp | None
    arrived: bool
    least_m: float

    @property
    def length_m(self) -> float:
        return sum(distance(a, b) for a, b in zip(self.track, self.track[1:], strict=False))


def fly(
    rival: Rival,
    obstacles: Floats,
    goal: Point = (3.0, 0.0),
    limit_s: float = 200.0,
    start: Point = (0.0, 0.0),
) -> Flown:
    """What was once within range stays known."""
    space = ObstacleMap(CONFIG.map, CRAFT.body_m, CONFIG.guard.fence)
    known = np.zeros(len(obstacles), dtype=np.bool_)
    track, velocity, version = [start], (0.0, 0.0), 0
    least_m = math.inf
    for tick in range(round(limit_s / DT_S)):
        point = track[-1]
        if len(obstacles):
            away = np.hypot(*(obstacles - point).T)
            least_m = min(least_m, float(away.min()))
            fresh = (away <= CRAFT.range_m) & ~known
            known |= fresh
            version += bool(fresh.any())
        if distance(point, goal) <= 0.1:
            return Flown(track, None, arrived=True, least_m=least_m)
        hits = obstacles[known]
        view = View(
            tick * DT_S,
            DT_S,
            point,
            velocity,
            goal,
            hits,
            kernels.within(hits, *point, NEAR_M),
            version,
            space,
        )
        answer = rival.decide(view)
        if isinstance(answer, GivesUp):
            return Flown(track, answer, arrived=False, least_m=least_m)
        velocity = answer
        track.append((point[0] + velocity[0] * DT_S, point[1] + velocity[1] * DT_S))
    return Flown(track, None, arrived=False, least_m=least_m)
