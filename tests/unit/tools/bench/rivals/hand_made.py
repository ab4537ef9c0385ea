"""Hand-made maps for a vehicle that flies exactly what it is told and sees a metre far."""

import itertools
import math

import numpy as np

from autonomy.config import Config
from autonomy.geometry import Point, distance
from tools.bench.rivals import toy
from tools.bench.rivals.interface import Craft, Floats, Rival

CONFIG = Config()
CRAFT = Craft.of(CONFIG)
NOTHING: Floats = np.empty((0, 2))
GOAL = (3.0, 0.0)


def line(a: Point, b: Point, spacing_m: float = 0.03) -> Floats:
    count = max(2, math.ceil(distance(a, b) / spacing_m) + 1)
    return np.linspace(a, b, count)


def lines(*corners: Point) -> Floats:
    return np.concatenate([line(a, b) for a, b in itertools.pairwise(corners)])


WALL = lines((1.5, -0.8), (1.5, 0.6))
"""Across the straight way from (0, 0) to GOAL."""
POST = lines((1.5, -0.05), (1.6, 0.05), (1.6, 0.15), (1.5, 0.15), (1.5, -0.05))
"""Thin, and a little to the right of the straight way."""
U = lines((0.6, -0.7), (1.6, -0.7), (1.6, 0.7), (0.6, 0.7))
"""Open towards (0, 0), closed towards GOAL."""
RING = lines((2.4, -0.6), (3.6, -0.6), (3.6, 0.6), (2.4, 0.6), (2.4, -0.6))
"""All round GOAL."""


def fly(rival: Rival, outlines: Floats, goal: Point = GOAL, start: Point = (0.0, 0.0)) -> toy.Flown:
    return toy.fly(rival, outlines, goal, start=start)
