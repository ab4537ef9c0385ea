"""Compiled loops of the wall fix; `wall_fix.py` says what they mean.

The reference is a grid of square cells. A cell holds the moments of the hits in it, twice: of
those that have been there for a while (settled), against which rays are measured, and of those
that came lately (fresh). So no ray is compared with what the same pass has just laid down.

    settled, fresh (rows, columns, 8) float64   count, sums of n, e, n n, n e, e e in metres, and
                                                of the directions that they were seen in
    times (rows, columns, 2) float64            when the first of the fresh hits came, and the
                                                newest one
    doubts (rows, columns) float64              contradictions less confirmations, from 0
    state (7,) float64                          wander n, e; drift n, e; yaw; the drift's rate
                                                n, e: estimate less truth
    covariance (7, 7) float64                   of the state
    params (..,) float64                        columns P_...
    rays (n, 5) float64                         origin n, e; direction cos, sin; length, in m
    told (4,) float64                           columns TOLD_...
"""

# numba compiles by the types of the arguments; the typed door to these loops is wall_fix.py.
# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators

import math

import numpy as np
from numba import njit

MOMENTS = 8
T_FIRST, T_NEWEST, TIMES = range(3)
WANDER_N, WANDER_E, DRIFT_N, DRIFT_E, YAW, RATE_N, RATE_E, STATES = range(8)

P_NORTH0, P_EAST0, P_CELL, P_SETTLE, P_HITS_MIN, P_HITS_MAX, P_REACH, P_THICK, P_LENGTH = range(9)
P_COS, P_GATE, P_GATE_M, P_RANGE, P_RANGE_FRACTION, P_SURFACE, P_INFLATION = range(9, 16)
(
    P_DOUBTS,
    P_WANDER,
    P_WANDER_S,
    P_DRIFT,
    P_YAW,
    P_YAW_S,
    P_RATE,
    P_RATE_S,
    P_STALE,
    P_ONE_SIDED,
    PARAMS,
) = range(16, 27)

R_NORTH, R_EAST, R_COS, R_SIN, R_LENGTH, RAY_COLUMNS = range(6)

TOLD_FUSED, TOLD_REJECTED, TOLD_RATIO, TOLD_FORGOTTEN, TOLD = range(5)

FIT_N, FIT_E, FIT_NORMAL_N, FIT_NORMAL_E, FIT = range(5)


@njit(cache=True)
def _settle(settled, fresh, times, params, i, j, now):
    """Let the fresh hits of a cell join the settled ones once the first of them is old enough.

    The settled ones never count more than P_HITS_MAX: a wall is known well, not for ever. What was
    seen from the other side makes way: that is another surface.
    """
    if fresh[i, j, 0] == 0.0 or now - times[i, j, T_FIRST] < params[P_SETTLE]:
        return
    keep = 1.0
    if settled[i, j, 0] + fresh[i, j, 0] > params[P_HITS_MAX] and settled[i, j, 0] > 0.0:
        keep = max(0.0, params[P_HITS_MAX] - fresh[i, j, 0]) / settled[i, j, 0]
    if settled[i, j, 6] * fresh[i, j, 6] + settled[i, j, 7] * fresh[i, j, 7] < 0.0:
        keep = 0.0
    for k in range(MOMENTS):
        settled[i, j, k] = keep * settled[i, j, k] + fresh[i, j, k]
        fresh[i, j, k] = 0.0


@njit(cache=True)
def _cell(params, north, east):
    i = math.floor((north - params[P_NORTH0]) / params[P_CELL])
    j = math.floor((east - params[P_EAST0]) / params[P_CELL])
    return i, j


@njit(cache=True)
def _lay(settled, fresh, times, params, north, east, cos, sin, now):
    """One more hit for the cell that it lies in."""
    i, j = _cell(params, north, east)
    if not (0 <= i < settled.shape[0] and 0 <= j < settled.shape[1]):
        return
    _settle(settled, fresh, times, params, i, j, now)
    if fresh[i, j, 0] == 0.0:
        times[i, j, T_FIRST] = now
    times[i, j, T_NEWEST] = now
    fresh[i, j, 0] += 1.0
    fresh[i, j, 1] += north
    fresh[i, j, 2] += east
    fresh[i, j, 3] += north * north
    fresh[i, j, 4] += north * east
    fresh[i, j, 5] += east * east
    fresh[i, j, 6] += cos
    fresh[i, j, 7] += sin


@njit(cache=True)
def _gather(settled, fresh, times, params, north, east, cos, sin, now):
    """Moments of the settled hits of the 3 x 3 cells round a point whose means are in reach.

    Cells count that were seen from one side, and from the side of the ray (cos, sin): a thin wall
    has two surfaces, and the other one is nearer than many a drift.
    """
    total = np.zeros(MOMENTS)
    row, column = _cell(params, north, east)
    reach2 = params[P_REACH] * params[P_REACH]
    for i in range(max(0, row - 1), min(settled.shape[0], row + 2)):
        for j in range(max(0, column - 1), min(settled.shape[1], column + 2)):
            _settle(settled, fresh, times, params, i, j, now)
            count = settled[i, j, 0]
            view_n, view_e = settled[i, j, 6], settled[i, j, 7]
            if count == 0.0 or math.hypot(view_n, view_e) < params[P_ONE_SIDED] * count:
                continue
            if view_n * cos + view_e * sin < 0.0:
                continue
            dn = settled[i, j, 1] / count - north
            de = settled[i, j, 2] / count - east
            if dn * dn + de * de <= reach2:
                for k in range(MOMENTS):
                    total[k] += settled[i, j, k]
    return total


@njit(cache=True)
def _surface(total, params, north, east, fit):
    """Fit a line to the hits round a point: `fit` becomes its middle and its unit normal.

    False where they are too few, too thick a band, too short a piece, or where the point lies
    beyond its ends: a corner, a post, an edge, or nothing known.
    """
    count = total[0]
    if count < params[P_HITS_MIN]:
        return False
    mn = total[1] / count
    me = total[2] / count
    a = total[3] / count - mn * mn
    b = total[4] / count - mn * me
    d = total[5] / count - me * me
    half = 0.5 * (a + d)
    root = math.sqrt(0.25 * (a - d) * (a - d) + b * b)
    along2 = half + root
    if half - root > params[P_THICK] ** 2 or along2 < params[P_LENGTH] ** 2:
        return False
    tn, te = (along2 - d, b) if a > d else (b, along2 - a)
    size = math.hypot(tn, te)
    if size < 1e-12:
        return False
    tn /= size
    te /= size
    along = (north - mn) * tn + (east - me) * te
    if along * along > 4.0 * along2:
        return False
    fit[FIT_N] = mn
    fit[FIT_E] = me
    fit[FIT_NORMAL_N] = -te
    fit[FIT_NORMAL_E] = tn
    return True


@njit(cache=True)
def _confirm(doubts, params, north, east):
    """A ray ended where it should: what is round there was not moved."""
    row, column = _cell(params, north, east)
    for i in range(max(0, row - 1), min(doubts.shape[0], row + 2)):
        for j in range(max(0, column - 1), min(doubts.shape[1], column + 2)):
            doubts[i, j] = max(0.0, doubts[i, j] - 1.0)


@njit(cache=True)
def _contradict(settled, doubts, times, params, north, east, oldest):
    """A ray ended where nothing should be, or where the hits make no surface any more.

    Cells round there without a hit since `oldest` are doubted; returns how many of them were
    doubted so often that they are forgotten.
    """
    forgotten = 0.0
    row, column = _cell(params, north, east)
    for i in range(max(0, row - 1), min(settled.shape[0], row + 2)):
        for j in range(max(0, column - 1), min(settled.shape[1], column + 2)):
            if settled[i, j, 0] == 0.0 or times[i, j, T_NEWEST] > oldest:
                continue
            doubts[i, j] += 1.0
            if doubts[i, j] >= params[P_DOUBTS]:
                doubts[i, j] = 0.0
                settled[i, j] = 0.0
                forgotten += 1.0
    return forgotten


@njit(cache=True)
def _end(rays, r, state):
    """Where ray `r` ends by the present state."""
    length = rays[r, R_LENGTH]
    cos = rays[r, R_COS] + state[YAW] * rays[r, R_SIN]
    sin = rays[r, R_SIN] - state[YAW] * rays[r, R_COS]
    north = rays[r, R_NORTH] + length * cos - state[WANDER_N] - state[DRIFT_N]
    east = rays[r, R_EAST] + length * sin - state[WANDER_E] - state[DRIFT_E]
    return north, east


@njit(cache=True)
def _predict(state, covariance, params, dt):
    """Ornstein-Uhlenbeck for wander, yaw and rate; the drift is a random walk with that rate."""
    wander = math.exp(-dt / params[P_WANDER_S])
    yaw = math.exp(-dt / params[P_YAW_S])
    rate = math.exp(-dt / params[P_RATE_S])
    for axis in range(2):
        drift, speed = DRIFT_N + axis, RATE_N + axis
        state[drift] += dt * state[speed]
        for a in range(STATES):
            covariance[drift, a] += dt * covariance[speed, a]
        for a in range(STATES):
            covariance[a, drift] += dt * covariance[a, speed]
    keep = np.ones(STATES)
    keep[WANDER_N] = keep[WANDER_E] = wander
    keep[YAW] = yaw
    keep[RATE_N] = keep[RATE_E] = rate
    for a in range(STATES):
        state[a] *= keep[a]
        for b in range(STATES):
            covariance[a, b] *= keep[a] * keep[b]
    for axis in range(2):
        covariance[WANDER_N + axis, WANDER_N + axis] += params[P_WANDER] ** 2 * (1.0 - wander**2)
        covariance[DRIFT_N + axis, DRIFT_N + axis] += params[P_DRIFT] ** 2 * dt
        covariance[RATE_N + axis, RATE_N + axis] += params[P_RATE] ** 2 * (1.0 - rate**2)
    covariance[YAW, YAW] += params[P_YAW] ** 2 * (1.0 - yaw**2)


@njit(cache=True)
def _fuse(state, covariance, params, rays, r, fit, innovation, told):
    """One ray against one surface; returns whether its innovation passed the gate."""
    nn, ne = fit[FIT_NORMAL_N], fit[FIT_NORMAL_E]
    length = rays[r, R_LENGTH]
    h = np.zeros(STATES)
    h[WANDER_N] = h[DRIFT_N] = nn
    h[WANDER_E] = h[DRIFT_E] = ne
    h[YAW] = length * (ne * rays[r, R_COS] - nn * rays[r, R_SIN])
    ph = np.zeros(STATES)
    own = 0.0
    for a in range(STATES):
        for b in range(STATES):
            ph[a] += covariance[a, b] * h[b]
        own += h[a] * ph[a]
    along = abs(nn * rays[r, R_COS] + ne * rays[r, R_SIN])
    sigma = (params[P_RANGE] + params[P_RANGE_FRACTION] * length) * along
    noise = sigma * sigma + params[P_SURFACE] ** 2
    allowed = min(params[P_GATE] ** 2 * (own + noise), params[P_GATE_M] ** 2)
    ratio = innovation * innovation / allowed
    told[TOLD_RATIO] = max(told[TOLD_RATIO], ratio)
    if not ratio <= 1.0:
        told[TOLD_REJECTED] += 1.0
        return False
    told[TOLD_FUSED] += 1.0
    variance = own + params[P_INFLATION] * noise
    for a in range(STATES):
        state[a] += ph[a] / variance * innovation
        for b in range(STATES):
            covariance[a, b] -= ph[a] * ph[b] / variance
    return True


@njit(cache=True)
def observe(
    settled, fresh, times, doubts, params, state, covariance, rays, count, now, dt, told, learn
):
    """Move the state on by `dt`, measure the first `count` rays against settled surfaces, and lay
    their ends down when `learn`.

    Rays are laid by the autopilot's frame: the state is what that frame is wrong by.
    """
    told[:] = 0.0
    _predict(state, covariance, params, dt)
    fit = np.empty(FIT)
    stale = now - params[P_STALE]
    for r in range(count):
        north, east = _end(rays, r, state)
        total = _gather(
            settled, fresh, times, params, north, east, rays[r, R_COS], rays[r, R_SIN], now
        )
        if not _surface(total, params, north, east, fit):
            if total[0] >= params[P_HITS_MIN]:
                told[TOLD_FORGOTTEN] += _contradict(
                    settled, doubts, times, params, north, east, stale
                )
            continue
        nn, ne = fit[FIT_NORMAL_N], fit[FIT_NORMAL_E]
        if abs(nn * rays[r, R_COS] + ne * rays[r, R_SIN]) < params[P_COS]:
            continue
        innovation = nn * (north - fit[FIT_N]) + ne * (east - fit[FIT_E])
        if _fuse(state, covariance, params, rays, r, fit, innovation, told):
            _confirm(doubts, params, north, east)
        else:
            told[TOLD_FORGOTTEN] += _contradict(settled, doubts, times, params, north, east, now)
    if learn:
        for r in range(count):
            north, east = _end(rays, r, state)
            cos, sin = rays[r, R_COS], rays[r, R_SIN]
            _lay(settled, fresh, times, params, north, east, cos, sin, now)


def warm_up() -> None:
    """Compile (or load from numba's disk cache) the kernel with the types used in flight."""
    grid = np.zeros((4, 4, MOMENTS))
    observe(
        grid,
        grid.copy(),
        np.zeros((4, 4, TIMES)),
        np.zeros((4, 4)),
        np.ones(PARAMS),
        np.zeros(STATES),
        np.eye(STATES),
        np.ones((1, RAY_COLUMNS)),
        1,
        0.0,
        0.05,
        np.zeros(TOLD),
        learn=True,
    )
