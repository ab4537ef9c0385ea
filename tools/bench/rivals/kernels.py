"""The loops of the rivals, compiled as T3DRM's are, so that computing times compare.

Points are (north, east) in m, bearings grow from north to east; `near` and `hits` are (n, 2).
All of them are in this one file because numba's disk cache does not notice a change in a function
of another file.
"""

import heapq
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


# ---------------------------------------------------------------- following a boundary


@kernel
def wall_bearing(near: Floats, n: float, e: float, heading: float, side: int) -> float:
    """Bearing of the nearest hit on the hand that follows (`side` 1: the left one, -1 the right
    one), of a vehicle that moves along `heading`; the nearest of all where that hand is empty.
    """
    best, found = np.inf, heading - side * 0.5 * math.pi
    for hand in range(2):
        for k in range(near.shape[0]):
            dn, de = near[k, 0] - n, near[k, 1] - e
            away = dn * dn + de * de
            if away >= best:
                continue
            bearing = math.atan2(de, dn)
            off = (side * (heading - bearing) + math.pi) % TAU - math.pi
            if hand == 1 or -0.5 <= off <= 2.8:
                best, found = away, bearing
        if best < np.inf:
            break
    return found


@kernel
def first_free(free: Floats, bearing: float, side: int, reach: float) -> float:
    """The first bearing from `bearing` on, turning away from the hand that follows, with `reach`
    free; NaN when there is none. `free` is a `profile`.
    """
    step = TAU / BEARINGS
    first = round(bearing / step)
    for k in range(BEARINGS):
        j = first + side * k
        if free[j % BEARINGS] >= reach:
            return j * step
    return np.nan


# ---------------------------------------------------------------- BendyRuler


@kernel
def bend(
    near: Floats,
    n: float,
    e: float,
    goal_n: float,
    goal_e: float,
    step1: float,
    step2: float,
    clear: float,
) -> tuple[bool, float, float]:
    """(found a clear way, bearing, margin along it): BendyRuler's search; see bendy_ruler.py."""
    to_goal = math.atan2(goal_e - e, goal_n - n)
    best_bearing, best_margin = to_goal, -1.0
    for i in range(35):
        for hand in range(2 if i > 0 else 1):
            turn = math.radians(5.0 * i) * (1.0 if hand == 0 else -1.0)
            un, ue = math.cos(to_goal + turn), math.sin(to_goal + turn)
            an, ae = n + step1 * un, e + step1 * ue
            room = margin(near, n, e, an, ae)
            if room > best_margin:
                best_bearing, best_margin = to_goal + turn, room
            if room <= clear:
                continue
            onward = math.atan2(goal_e - ae, goal_n - an)
            length = min(step2, math.hypot(goal_n - an, goal_e - ae))
            for j in range(3):
                second = onward + (0.0 if j == 0 else math.radians(45.0 if j == 1 else -45.0))
                bn, be = an + length * math.cos(second), ae + length * math.sin(second)
                if margin(near, an, ae, bn, be) > clear:
                    return True, to_goal + turn, room
    return False, best_bearing, best_margin


# ---------------------------------------------------------------- dynamic window

DWA_SPEEDS = 5


@kernel
def window(
    free: Floats,
    goal_bearing: float,
    goal_m: float,
    vn: float,
    ve: float,
    top: float,
    reach: float,
    acceleration: float,
    braking: float,
    ahead_s: float,
    heading: float,
    clearance: float,
    speed: float,
) -> tuple[float, float]:
    """(bearing, speed) of the best admissible velocity in the window; see dwa.py."""
    best, best_bearing, best_speed = -1.0, goal_bearing, 0.0
    step = TAU / BEARINGS
    for j in range(BEARINGS + 1):
        bearing = goal_bearing if j == BEARINGS else j * step
        # Between two bearings of the profile the shorter one is believed.
        at = bearing / step
        low, high = math.floor(at + 1e-9), math.ceil(at - 1e-9)
        way = min(free[low % BEARINGS], free[high % BEARINGS])
        off = abs((bearing - goal_bearing + math.pi) % TAU - math.pi)
        for s in range(1, DWA_SPEEDS + 1):
            v = top * s / DWA_SPEEDS
            if v * v > 2.0 * braking * way:
                break
            change = math.hypot(v * math.cos(bearing) - vn, v * math.sin(bearing) - ve)
            if change > acceleration * ahead_s:
                continue
            score = (
                heading * (1.0 - off / math.pi)
                + clearance * min(way, goal_m) / min(reach, max(goal_m, 1e-6))
                + speed * s / DWA_SPEEDS
            )
            if score > best:
                best, best_bearing, best_speed = score, bearing, v
    return best_bearing, best_speed


# ---------------------------------------------------------------- grids

NORTH = (1, 1, 0, -1, -1, -1, 0, 1)
EAST = (0, 1, 1, 1, 0, -1, -1, -1)
"""The eight neighbours of a cell."""
ROUNDING = 1e-6
DEAR = 20.0
"""Cost of a cell that would be blocked, where the vehicle is in it already, or the goal."""


@kernel
def lay(
    hits: Floats,
    low_n: float,
    low_e: float,
    cell: float,
    rows: int,
    columns: int,
    keep_out: float,
    band: float,
    steep: float,
) -> Floats:
    """(rows, columns) cost of crossing a cell: 1 far from hits, up to 1 + `steep` within `band` of
    the keep-out, inf inside it. Cell (0, 0) has its centre at (low_n, low_e).
    """
    away2 = np.full((rows, columns), np.inf)
    wide = keep_out + band
    reach = int(wide / cell) + 1
    for k in range(hits.shape[0]):
        pn, pe = (hits[k, 0] - low_n) / cell, (hits[k, 1] - low_e) / cell
        r0, c0 = math.floor(pn + 0.5), math.floor(pe + 0.5)
        for r in range(max(0, r0 - reach), min(rows, r0 + reach + 1)):
            for c in range(max(0, c0 - reach), min(columns, c0 + reach + 1)):
                gap2 = ((r - pn) ** 2 + (c - pe) ** 2) * cell * cell
                if gap2 < away2[r, c]:
                    away2[r, c] = gap2
    cost = np.ones((rows, columns))
    for r in range(rows):
        for c in range(columns):
            if away2[r, c] < keep_out * keep_out:
                cost[r, c] = np.inf
            elif away2[r, c] < wide * wide:
                cost[r, c] += steep * (wide - math.sqrt(away2[r, c])) / band
    return cost


@kernel
def spare(cost: Floats, at: int, reach: float) -> None:
    """Blocked cells within `reach` cells of cell `at` are only DEAR."""
    rows, columns = cost.shape
    wide = int(reach)
    row, column = at // columns, at % columns
    for r in range(max(0, row - wide), min(rows, row + wide + 1)):
        for c in range(max(0, column - wide), min(columns, column + wide + 1)):
            if math.hypot(r - row, c - column) <= reach and cost[r, c] == np.inf:
                cost[r, c] = DEAR


@kernel
def _octile(dr: int, dc: int) -> float:
    long, short = max(abs(dr), abs(dc)), min(abs(dr), abs(dc))
    return float(long + 0.41421356 * short)


@kernel
def _edge(flat: Floats, u: int, v: int, step: int) -> float:
    return float(0.5 * (flat[u] + flat[v])) * (1.0 if step % 2 == 0 else 1.41421356)


@kernel
def astar(cost: Floats, start: int, goal: int) -> Ints:
    """Cells (row * columns + column) of the cheapest way over eight neighbours; empty: none."""
    rows, columns = cost.shape
    flat = cost.ravel()
    total = rows * columns
    best = np.full(total, np.inf)
    parent = np.full(total, -1, dtype=np.int64)
    closed = np.zeros(total, dtype=np.uint8)
    best[start] = 0.0
    queue = [(0.0, start)]
    while len(queue) > 0:
        u = heapq.heappop(queue)[1]
        if u == goal:
            break
        if closed[u] == 1:
            continue
        closed[u] = 1
        r, c = u // columns, u % columns
        for step in range(8):
            nr, nc = r + NORTH[step], c + EAST[step]
            if not (0 <= nr < rows and 0 <= nc < columns):
                continue
            v = nr * columns + nc
            way = best[u] + _edge(flat, u, v, step)
            if way < best[v]:
                best[v] = way
                parent[v] = u
                rest = _octile(nr - goal // columns, nc - goal % columns)
                heapq.heappush(queue, (way + rest, v))
    count = 0
    if best[goal] < np.inf:
        at = goal
        while at >= 0:
            count += 1
            at = parent[at]
    cells = np.empty(count, dtype=np.int64)
    at = goal
    for k in range(count - 1, -1, -1):
        cells[k] = at
        at = parent[at]
    return cells


@kernel
def _sees(cost: Floats, a: int, b: int, most: float) -> bool:
    """True when no cell on the segment between two cells costs more than `most`."""
    columns = cost.shape[1]
    dr, dc = b // columns - a // columns, b % columns - a % columns
    pieces = 2 * max(abs(dr), abs(dc), 1)
    for k in range(pieces + 1):
        r = math.floor(a // columns + dr * k / pieces + 0.5)
        c = math.floor(a % columns + dc * k / pieces + 0.5)
        if cost[r, c] > most:
            return False
    return True


@kernel
def taut(cost: Floats, cells: Ints) -> Ints:
    """The way pulled taut: from each cell to the farthest one that is seen over cells no dearer
    than the dearest one in between.
    """
    columns = cost.shape[1]
    kept = np.empty(cells.shape[0], dtype=np.int64)
    count, at = 0, 0
    last = cells.shape[0] - 1
    while at < last:
        kept[count] = cells[at]
        count += 1
        most, far = 1.0, at + 1
        for k in range(at, min(last, at + 80) + 1):
            most = max(most, cost[cells[k] // columns, cells[k] % columns])
            if k > at + 1 and _sees(cost, cells[at], cells[k], most + 1e-9):
                far = k
        at = far
    kept[count] = cells[last]
    return kept[: count + 1]


# ---------------------------------------------------------------- D* Lite
#
# keys (cells, 2): of those in the queue; heap: their numbers; place: where in the heap each is, -1:
# nowhere; small: [size of the heap]; km: by how much the heuristic has shifted.


@kernel
def _before(keys: Floats, a: int, b: int) -> bool:
    return bool(keys[a, 0] < keys[b, 0] or (keys[a, 0] == keys[b, 0] and keys[a, 1] < keys[b, 1]))


@kernel
def _sift(heap: Ints, place: Ints, small: Ints, keys: Floats, at: int) -> None:
    """Put heap[at] where it belongs."""
    u = heap[at]
    while at > 0 and _before(keys, u, heap[(at - 1) // 2]):
        heap[at] = heap[(at - 1) // 2]
        place[heap[at]] = at
        at = (at - 1) // 2
    while True:
        child = 2 * at + 1
        if child >= small[0]:
            break
        if child + 1 < small[0] and _before(keys, heap[child + 1], heap[child]):
            child += 1
        if not _before(keys, heap[child], u):
            break
        heap[at] = heap[child]
        place[heap[at]] = at
        at = child
    heap[at] = u
    place[u] = at


@kernel
def _remove(heap: Ints, place: Ints, small: Ints, keys: Floats, u: int) -> None:
    at = place[u]
    place[u] = -1
    small[0] -= 1
    if at < small[0]:
        heap[at] = heap[small[0]]
        place[heap[at]] = at
        _sift(heap, place, small, keys, at)


@kernel
def _settle(
    g: Floats,
    rhs: Floats,
    keys: Floats,
    heap: Ints,
    place: Ints,
    small: Ints,
    u: int,
    rest: float,
) -> None:
    """UpdateVertex of the paper; `rest` is the heuristic from the start, shifted by km."""
    if g[u] == rhs[u]:
        if place[u] >= 0:
            _remove(heap, place, small, keys, u)
        return
    least = min(g[u], rhs[u])
    keys[u, 0], keys[u, 1] = least + rest, least
    if place[u] < 0:
        heap[small[0]] = u
        place[u] = small[0]
        small[0] += 1
    _sift(heap, place, small, keys, place[u])


@kernel
def _lookahead(cost: Floats, g: Floats, u: int) -> float:
    """The least cost of a step to a neighbour and on from there."""
    rows, columns = cost.shape
    flat = cost.ravel()
    best = np.inf
    for step in range(8):
        r, c = u // columns + NORTH[step], u % columns + EAST[step]
        if 0 <= r < rows and 0 <= c < columns:
            v = r * columns + c
            best = min(best, _edge(flat, u, v, step) + g[v])
    return best


@kernel
def _around(
    cost: Floats,
    g: Floats,
    rhs: Floats,
    keys: Floats,
    heap: Ints,
    place: Ints,
    small: Ints,
    km: float,
    start: int,
    goal: int,
    u: int,
) -> None:
    """Renew a cell and its neighbours."""
    rows, columns = cost.shape
    for step in range(9):
        r = u // columns + (NORTH[step] if step < 8 else 0)
        c = u % columns + (EAST[step] if step < 8 else 0)
        if 0 <= r < rows and 0 <= c < columns:
            v = r * columns + c
            if v != goal:
                rhs[v] = _lookahead(cost, g, v)
            rest = _octile(r - start // columns, c - start % columns) + km
            _settle(g, rhs, keys, heap, place, small, v, rest)


@kernel
def dstar_replan(
    cost: Floats,
    changed: Ints,
    g: Floats,
    rhs: Floats,
    keys: Floats,
    heap: Ints,
    place: Ints,
    small: Ints,
    km: float,
    start: int,
    goal: int,
) -> int:
    """D* Lite: take in the cells whose cost has changed, and repair; the number of expansions.

    Koenig and Likhachev's second version, but that right-hand sides are always looked up anew.
    """
    columns = cost.shape[1]
    for k in range(changed.shape[0]):
        _around(cost, g, rhs, keys, heap, place, small, km, start, goal, changed[k])
    count = 0
    while small[0] > 0:
        u = heap[0]
        mine = min(g[start], rhs[start])
        # Sums round: a key that should equal the start's may come out a little above it.
        if keys[u, 0] > mine + km + ROUNDING and rhs[start] == g[start]:
            break
        count += 1
        rest = _octile(u // columns - start // columns, u % columns - start % columns) + km
        least = min(g[u], rhs[u])
        if keys[u, 0] < least + rest - ROUNDING:
            _settle(g, rhs, keys, heap, place, small, u, rest)
            continue
        g[u] = rhs[u] if g[u] > rhs[u] else np.inf
        _around(cost, g, rhs, keys, heap, place, small, km, start, goal, u)
    return count


@kernel
def dstar_way(cost: Floats, g: Floats, start: int, goal: int) -> Ints:
    """Downhill from start to goal; empty when no way is known."""
    rows, columns = cost.shape
    flat = cost.ravel()
    cells = np.empty(rows * columns, dtype=np.int64)
    cells[0] = start
    count, at = 1, start
    while at != goal and count < cells.shape[0]:
        best, to = np.inf, -1
        for step in range(8):
            r, c = at // columns + NORTH[step], at % columns + EAST[step]
            if 0 <= r < rows and 0 <= c < columns:
                v = r * columns + c
                way = _edge(flat, at, v, step) + g[v]
                if way < best:
                    best, to = way, v
        if to < 0:
            return cells[:0]
        cells[count] = to
        count += 1
        at = to
    return cells[:count] if at == goal else cells[:0]
