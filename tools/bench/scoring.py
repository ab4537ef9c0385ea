"""The same judge for every planner: is the path free, how long is it, how fast may it be flown?"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tools.bench.maps import Map

Floats = NDArray[np.float64]

CLEARANCE_TOLERANCE_M = 1e-3
"""What a path may take from a keep-out: what the planner's sampled curves are allowed to."""
END_TOLERANCE_M = 1e-6
SEGMENTS_AT_ONCE = 256
"""Bounds the memory of the check."""
CORNER_M = 0.005
"""How far a flown corner may cut inside the drawn one when its bend is measured."""


@dataclass(frozen=True)
class Score:
    """A path that passed: its length and the least distance to any disc beyond the keep-out."""

    length_m: float
    spare_m: float


def length_m(path: Floats) -> float:
    """Length of a polyline (k, 2)."""
    return float(np.hypot(*np.diff(path, axis=0).T).sum())


def spare_m(path: Floats, centres: Floats, reach_m: Floats) -> float:
    """The least of (distance from the polyline to a centre) - reach, exactly; inf without discs."""
    if reach_m.shape[0] == 0:
        return math.inf
    least = math.inf
    for first in range(0, path.shape[0] - 1, SEGMENTS_AT_ONCE):
        a = path[first : first + SEGMENTS_AT_ONCE]
        b = path[first + 1 : first + 1 + SEGMENTS_AT_ONCE]
        a = a[: b.shape[0], None, :]
        way = b[:, None, :] - a
        length2 = np.maximum((way**2).sum(axis=2), np.finfo(np.float64).tiny)
        share = np.clip(((centres - a) * way).sum(axis=2) / length2, 0.0, 1.0)
        away = centres - a - share[:, :, None] * way
        gaps = np.hypot(away[:, :, 0], away[:, :, 1]) - reach_m
        least = min(least, float(gaps.min()))
    return least


def judge(path: Floats | None, problem: Map) -> Score | None:
    """The score of a path, None when there is none or it does not pass.

    It must lead from start to goal, stay in the rectangle, and keep every disc's keep-out less
    CLEARANCE_TOLERANCE_M.
    """
    if path is None or path.shape[0] < 2 or not bool(np.isfinite(path).all()):
        return None
    joined = max(math.dist(path[0], problem.start), math.dist(path[-1], problem.goal))
    inside = bool(
        (path >= np.array(problem.low) - CLEARANCE_TOLERANCE_M).all()
        and (path <= np.array(problem.high) + CLEARANCE_TOLERANCE_M).all()
    )
    spare = spare_m(path, problem.centres, problem.reach_m)
    if joined > END_TOLERANCE_M or not inside or spare < -CLEARANCE_TOLERANCE_M:
        return None
    return Score(length_m(path), spare)


def bends(path: Floats) -> tuple[Floats, Floats]:
    """(turn in rad, radius in m) at every corner of a polyline.

    The radius is that of the widest arc which cuts the corner by CORNER_M at most and begins and
    ends within half of the shorter neighbouring piece. On a sampled curve that is the radius of
    the curve; at a true corner it is what flying it within CORNER_M takes.
    """
    kept = _without_straight_joints(path)
    way = np.diff(kept, axis=0)
    lengths = np.hypot(*way.T)
    a, b = way[:-1], way[1:]
    turn = np.abs(np.arctan2(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0], (a * b).sum(axis=1)))
    half = np.minimum(0.5 * turn, 0.5 * math.pi - 1e-9)
    room = 0.5 * np.minimum(lengths[:-1], lengths[1:])
    by_room = room / np.tan(half)
    by_cut = CORNER_M / (1.0 / np.cos(half) - 1.0)
    return turn, np.minimum(by_room, by_cut)


def _without_straight_joints(path: Floats) -> Floats:
    """The polyline without points where it does not bend, and without repeated ones."""
    apart = np.concatenate(((True,), np.hypot(*np.diff(path, axis=0).T) > 1e-9))
    points = path[apart]
    if points.shape[0] < 3:
        return points
    way = np.diff(points, axis=0)
    way /= np.hypot(*way.T)[:, None]
    bend = np.abs(way[:-1, 0] * way[1:, 1] - way[:-1, 1] * way[1:, 0])
    ahead = (way[:-1] * way[1:]).sum(axis=1) > 0.0
    return points[np.concatenate(((True,), (bend > 1e-6) | ~ahead, (True,)))]


def tightest_radius_m(path: Floats) -> float:
    """The smallest radius of all bends; inf for a straight path."""
    radii = bends(path)[1]
    return float(radii.min()) if radii.shape[0] else math.inf


def flight_time_s(path: Floats, speed_m_s: float, lateral_m_s2: float) -> float:
    """Time along the path at `speed_m_s`, in bends at sqrt(lateral_m_s2 * radius) at most.

    Only lateral acceleration is limited: braking and speeding up take no time.
    """
    turn, radius = bends(path)
    arcs = turn * radius
    tangents = 2.0 * radius * np.tan(np.minimum(0.5 * turn, 0.5 * math.pi - 1e-9))
    bend_speed = np.minimum(speed_m_s, np.sqrt(lateral_m_s2 * radius))
    straight = max(0.0, length_m(path) - float(tangents.sum()))
    return straight / speed_m_s + float((arcs / np.maximum(bend_speed, 1e-6)).sum())
