"""The loops of the rivals, compiled as T3DRM's are, so that computing times compare.

Points are (north, east) in m, bearings grow from north to east; `near` and `hits` are (n, 2).
All of them are in this one file because numba's disk cache does not notice a change in a function
of another file.
"""

import math
from collections.abc import Callable
from typing import Any, TypeVar, cast

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Compiled = TypeVar("Compiled", bound=Callable[..., Any])

TAU = 2.0 * math.pi
BEARINGS = 120
"""Directions of a profile: every 3 degrees."""
LEAVING = 0.17
"""Cosine to "away" of a motion that gains the clearance which the guard asks for."""


def kernel(function: Compiled) -> Compiled:
    """`numba.njit` with the disk cache, with a type that mypy can follow."""
    return cast(Compiled, njit(cache=True)(function))


# ---------------------------------------------------------------- hits about a place


@kernel
def within(hits: Floats, n: float, e: float, radius: float) -> Floats:
    """The rows of `hits` within `radius` of the place."""
    found = np.empty((hits.shape[0], 2))
    count = 0
    for k in range(hits.shape[0]):
        dn, de = hits[k, 0] - n, hits[k, 1] - e
        if dn * dn + de * de <= radius * radius:
            found[count, 0], found[count, 1] = hits[k, 0], hits[k, 1]
            count += 1
    return found[:count].copy()


@kernel
def nearest(near: Floats, n: float, e: float) -> tuple[float, float]:
    """(distance, bearing) of the nearest hit; (inf, 0) without any."""
    best, bn, be = np.inf, 1.0, 0.0
    for k in range(near.shape[0]):
        dn, de = near[k, 0] - n, near[k, 1] - e
        away = dn * dn + de * de
        if away < best:
            best, bn, be = away, dn, de
    return math.sqrt(best), math.atan2(be, bn)


@kernel
def way_free(
    near: Floats, n: float, e: float, un: float, ue: float, keep_out: float, reach: float
) -> float:
    """How far a disc of radius `keep_out` slides along the unit vector, at most `reach`.

    A hit that is inside the disc already stops what does not gain LEAVING of clearance a metre.
    """
    free = reach
    for k in range(near.shape[0]):
        dn, de = near[k, 0] - n, near[k, 1] - e
        along = dn * un + de * ue
        away2 = dn * dn + de * de
        if away2 < keep_out * keep_out:
            if along > -LEAVING * math.sqrt(away2):
                return 0.0
            continue
        if along <= 0.0:
            continue
        aside2 = away2 - along * along
        if aside2 < keep_out * keep_out:
            free = min(free, max(0.0, along - math.sqrt(keep_out * keep_out - aside2)))
    return free


@kernel
def profile(near: Floats, n: float, e: float, keep_out: float, reach: float) -> Floats:
    """`way_free` in BEARINGS directions, the first north; all in one pass over the hits."""
    free = np.full(BEARINGS, reach)
    step = TAU / BEARINGS
    for k in range(near.shape[0]):
        dn, de = near[k, 0] - n, near[k, 1] - e
        away = math.hypot(dn, de)
        if away >= reach + keep_out:
            continue
        bearing = math.atan2(de, dn)
        inside = away < keep_out
        half = math.acos(-LEAVING) if inside else math.asin(keep_out / away)
        first, last = math.ceil((bearing - half) / step), math.floor((bearing + half) / step)
        for j in range(first, last + 1):
            if inside:
                free[j % BEARINGS] = 0.0
                continue
            off = j * step - bearing
            aside = away * math.sin(off)
            entry = away * math.cos(off) - math.sqrt(max(0.0, keep_out**2 - aside**2))
            if entry < free[j % BEARINGS]:
                free[j % BEARINGS] = max(0.0, entry)
    return free


@kernel
def margin(near: Floats, an: float, ae: float, bn: float, be: float) -> float:
    """Distance of the nearest hit to the segment a-b; inf without any."""
    best = np.inf
    dn, de = bn - an, be - ae
    length2 = max(dn * dn + de * de, 1e-12)
    for k in range(near.shape[0]):
        wn, we = near[k, 0] - an, near[k, 1] - ae
        share = min(1.0, max(0.0, (wn * dn + we * de) / length2))
        wn -= share * dn
        we -= share * de
        best = min(best, wn * wn + we * we)
    return math.sqrt(best)


# ---------------------------------------------------------------- potential field

FIELD_SECTORS = 24


@kernel
def push(
    near: Floats,
    n: float,
    e: float,
    goal_n: float,
    goal_e: float,
    body: float,
    strength: float,
    influence: float,
) -> tuple[float, float]:
    """Repulsive force (north, east) of Ge and Cui with n = 2; see potential_field.py.

    One hit a sector counts, the nearest, so that the map's density does not.
    """
    sectors = np.full(FIELD_SECTORS, -1)
    least = np.full(FIELD_SECTORS, body + influence)
    for k in range(near.shape[0]):
        dn, de = near[k, 0] - n, near[k, 1] - e
        away = math.hypot(dn, de)
        if away < body + influence:
            s = int((math.atan2(de, dn) + math.pi) / TAU * FIELD_SECTORS) % FIELD_SECTORS
            if away < least[s]:
                least[s], sectors[s] = away, k
    to_go = max(math.hypot(goal_n - n, goal_e - e), 1e-6)
    fade = min(1.0, to_go)
    fn = fe = 0.0
    for s in range(FIELD_SECTORS):
        if sectors[s] < 0:
            continue
        dn, de = near[sectors[s], 0] - n, near[sectors[s], 1] - e
        away = max(math.hypot(dn, de), 1e-6)
        gap = max(away - body, 0.01)
        over = 1.0 / gap - 1.0 / influence
        out = strength * over / (gap * gap) * fade * fade
        on = strength * over * over * fade if to_go < 1.0 else 0.0
        fn += -out * dn / away + on * (goal_n - n) / to_go
        fe += -out * de / away + on * (goal_e - e) / to_go
    return fn, fe


# ---------------------------------------------------------------- VFH+


@kernel
def polar(
    near: Floats,
    n: float,
    e: float,
    enlarged: float,
    window: float,
    low: float,
    high: float,
    blocked: NDArray[np.uint8],
) -> None:
    """Renew the binary histogram `blocked` (sectors) with hysteresis; see vfh_plus.py."""
    sectors = blocked.shape[0]
    density = np.zeros(sectors)
    step = TAU / sectors
    for k in range(near.shape[0]):
        dn, de = near[k, 0] - n, near[k, 1] - e
        away = math.hypot(dn, de)
        if away > window:
            continue
        magnitude = 1.0 - (away / (window + 1e-9)) ** 2
        half = math.asin(min(1.0, enlarged / max(away, 1e-6)))
        bearing = math.atan2(de, dn)
        first, last = math.ceil((bearing - half) / step), math.floor((bearing + half) / step)
        for j in range(first, last + 1):
            density[j % sectors] += magnitude
    for j in range(sectors):
        if density[j] > high:
            blocked[j] = 1
        elif density[j] < low:
            blocked[j] = 0
