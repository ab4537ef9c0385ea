"""The loops of the baselines, compiled as the planner's own are, so that times compare.

All of them are in this one file because numba's disk cache does not notice a change in a function
of another file. Nothing here is shared with autonomy.t3drm: what is measured against must not
inherit its mistakes. Discs are rows (north, east, reach): the reach holds the keep-out already.
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
Mask = NDArray[np.uint8]
Compiled = TypeVar("Compiled", bound=Callable[..., Any])

TAU = 2.0 * math.pi
TOUCH_M = 1e-7
"""What rounding may take from a disc."""
NORTH = (1, 1, 0, -1, -1, -1, 0, 1)
EAST = (0, 1, 1, 1, 0, -1, -1, -1)
"""The eight neighbours of a cell."""


def kernel(function: Compiled) -> Compiled:
    """`numba.njit` with the disk cache, with a type that mypy can follow."""
    return cast(Compiled, njit(cache=True)(function))


# ---------------------------------------------------------------- one segment, all discs


@kernel
def distance2(pn: float, pe: float, an: float, ae: float, bn: float, be: float) -> float:
    """Squared distance from p to the segment a-b."""
    dn, de = bn - an, be - ae
    wn, we = pn - an, pe - ae
    along = wn * dn + we * de
    if along > 0.0:
        share = min(1.0, along / (dn * dn + de * de))
        wn -= share * dn
        we -= share * de
    return wn * wn + we * we


@kernel
def sees(discs: Floats, an: float, ae: float, bn: float, be: float) -> bool:
    """True when the segment a-b enters no disc."""
    for k in range(discs.shape[0]):
        keep = discs[k, 2] - TOUCH_M
        n, e = discs[k, 0], discs[k, 1]
        if (
            min(an, bn) - keep < n < max(an, bn) + keep
            and min(ae, be) - keep < e < max(ae, be) + keep
            and distance2(n, e, an, ae, bn, be) < keep * keep
        ):
            return False
    return True


# ---------------------------------------------------------------- the exact optimum


@kernel
def _covered(discs: Floats, near: Ints, own: int, n: float, e: float) -> bool:
    """True when one of the discs `near` (not `own`) holds the point."""
    for k in near:
        if k != own and k >= 0:
            dn, de = discs[k, 0] - n, discs[k, 1] - e
            keep = discs[k, 2] - TOUCH_M
            if dn * dn + de * de < keep * keep:
                return True
    return False


@kernel
def neighbours(discs: Floats) -> Ints:
    """Per disc the numbers of those that overlap it, filled up with -1."""
    n = discs.shape[0]
    counts = np.zeros(n, dtype=np.int64)
    for step in range(2):
        if step == 1:
            table = np.full((n, max(1, counts.max() if n > 0 else 0)), -1, dtype=np.int64)
            counts[:] = 0
        for i in range(n):
            for k in range(n):
                away = math.hypot(discs[i, 0] - discs[k, 0], discs[i, 1] - discs[k, 1])
                if k != i and away < discs[i, 2] + discs[k, 2]:
                    if step == 1:
                        table[i, counts[i]] = k
                    counts[i] += 1
    return table


@kernel
def _inside(box: Floats, n: float, e: float) -> bool:
    return bool(
        box[0] - TOUCH_M <= n <= box[2] + TOUCH_M and box[1] - TOUCH_M <= e <= box[3] + TOUCH_M
    )


@kernel
def _touch(discs: Floats, i: int, angle: float) -> tuple[float, float]:
    return (
        discs[i, 0] + discs[i, 2] * math.cos(angle),
        discs[i, 1] + discs[i, 2] * math.sin(angle),
    )


@kernel
def _candidates(discs: Floats, i: int, k: int, angles: Floats) -> int:
    """Fill rows (angle on i, angle on k) of the common tangents; the number of rows.

    From the right triangles of outer tangents (radii alike) and inner ones (radii against each
    other). A circle of radius 0 is a point; its tangents come twice, once is enough.
    """
    dn, de = discs[k, 0] - discs[i, 0], discs[k, 1] - discs[i, 1]
    d = math.hypot(dn, de)
    r1, r2 = discs[i, 2], discs[k, 2]
    line = math.atan2(de, dn)
    count = 0
    if d > abs(r1 - r2):
        half = math.acos((r1 - r2) / d)
        angles[0, 0] = angles[0, 1] = line + half
        angles[1, 0] = angles[1, 1] = line - half
        count = 2
    if r1 > 0.0 and r2 > 0.0 and d >= r1 + r2 - 1e-12:
        half = math.acos(min(1.0, (r1 + r2) / d))
        angles[count, 0], angles[count, 1] = line + half, line + half + math.pi
        angles[count + 1, 0], angles[count + 1, 1] = line - half, line - half + math.pi
        count += 2
    return count


@kernel
def free_tangents(discs: Floats, near: Ints, box: Floats) -> Floats:
    """Rows (disc, angle, disc, angle) of every common tangent that enters no disc.

    The first two discs are start and goal with radius 0.
    """
    n = discs.shape[0]
    rows = np.empty((256, 4))
    count = 0
    angles = np.empty((4, 2))
    for i in range(n):
        for k in range(i + 1, n):
            for c in range(_candidates(discs, i, k, angles)):
                an, ae = _touch(discs, i, angles[c, 0])
                bn, be = _touch(discs, k, angles[c, 1])
                if not (_inside(box, an, ae) and _inside(box, bn, be)):
                    continue
                if _covered(discs, near[i], i, an, ae) or _covered(discs, near[k], k, bn, be):
                    continue
                if not sees(discs, an, ae, bn, be):
                    continue
                if count == rows.shape[0]:
                    wider = np.empty((2 * count, 4))
                    wider[:count] = rows
                    rows = wider
                rows[count, 0], rows[count, 1] = i, angles[c, 0] % TAU
                rows[count, 2], rows[count, 3] = k, angles[c, 1] % TAU
                count += 1
    return rows[:count]


@kernel
def cuts(discs: Floats, near: Ints, box: Floats) -> Floats:
    """Rows (disc, angle): where circles meet other circles or the sides of the box."""
    rows = np.empty((discs.shape[0] * (2 * near.shape[1] + 8), 2))
    count = 0
    for i in range(2, discs.shape[0]):
        r = discs[i, 2]
        for k in near[i]:
            if k < 0:
                break
            dn, de = discs[k, 0] - discs[i, 0], discs[k, 1] - discs[i, 1]
            d = math.hypot(dn, de)
            cosine = (d * d + r * r - discs[k, 2] ** 2) / (2.0 * d * r) if d > 0.0 else 2.0
            if abs(cosine) <= 1.0:
                half, line = math.acos(cosine), math.atan2(de, dn)
                rows[count, 0] = rows[count + 1, 0] = i
                rows[count, 1], rows[count + 1, 1] = (line + half) % TAU, (line - half) % TAU
                count += 2
        for side in range(4):
            off = (box[side] - discs[i, side % 2]) / r
            if abs(off) <= 1.0:
                half = math.acos(off)
                middle = 0.0 if side % 2 == 0 else 0.5 * math.pi
                rows[count, 0] = rows[count + 1, 0] = i
                rows[count, 1], rows[count + 1, 1] = (middle + half) % TAU, (middle - half) % TAU
                count += 2
    return rows[:count]


@kernel
def free_arcs(places: Floats, order: Ints, discs: Floats, near: Ints, box: Floats) -> Floats:
    """Rows (place, place, sweep) of the free arcs between neighbours on a circle.

    places: rows (disc, angle), visited in `order`: by disc, then angle. An arc without a cut inside
    is free when its middle is.
    """
    rows = np.empty((order.shape[0], 3))
    count = 0
    first = 0
    while first < order.shape[0]:
        i = int(places[order[first], 0])
        last = first
        while last + 1 < order.shape[0] and int(places[order[last + 1], 0]) == i:
            last += 1
        for at in range(first, last + 1):
            a = order[at]
            b = order[at + 1] if at < last else order[first]
            sweep = places[b, 1] - places[a, 1] + (0.0 if at < last else TAU)
            n, e = _touch(discs, i, places[a, 1] + 0.5 * sweep)
            free = _inside(box, n, e) and not _covered(discs, near[i], i, n, e)
            if i > 1 and (free or sweep < 1e-9):
                rows[count, 0], rows[count, 1], rows[count, 2] = a, b, sweep
                count += 1
        first = last + 1
    return rows[:count]


@kernel
def cheapest(
    first: Ints, to: Ints, cost: Floats, bound: Floats, start: int, goal: int
) -> tuple[bool, Ints]:
    """A* over a graph in rows (edges of node i: first[i] to first[i + 1]): (found, edges taken)."""
    n = bound.shape[0]
    best = np.full(n, np.inf)
    came = np.full(n, -1, dtype=np.int64)
    origin = np.full(n, -1, dtype=np.int64)
    best[start] = 0.0
    queue = [(bound[start], start)]
    while len(queue) > 0:
        key, at = heapq.heappop(queue)
        if at == goal:
            break
        if key > best[at] + bound[at] + 1e-12:
            continue
        for edge in range(first[at], first[at + 1]):
            new = best[at] + cost[edge]
            if new < best[to[edge]]:
                best[to[edge]] = new
                came[to[edge]] = edge
                origin[to[edge]] = at
                heapq.heappush(queue, (new + bound[to[edge]], to[edge]))
    steps = 0
    at = goal
    while came[at] >= 0:
        steps += 1
        at = origin[at]
    taken = np.empty(steps, dtype=np.int64)
    at = goal
    while came[at] >= 0:
        steps -= 1
        taken[steps] = came[at]
        at = origin[at]
    return bool(best[goal] < np.inf), taken


# ---------------------------------------------------------------- grids


@kernel
def barred_steps(discs: Floats, start: Floats, box: Floats, cell: float) -> tuple[Mask, Ints]:
    """(rows, columns, 8) mask, 1 where the step to a neighbour enters a disc or leaves the box.

    Cell centres lie at start + (i, j) cell; also returned is the cell (row, column) of the start.
    Steps are tested against the discs themselves, so that cells close no more than they must.
    """
    low_r, low_c = int((start[0] - box[0]) / cell), int((start[1] - box[1]) / cell)
    rows = low_r + int((box[2] - start[0]) / cell) + 1
    columns = low_c + int((box[3] - start[1]) / cell) + 1
    barred = np.zeros((rows, columns, 8), dtype=np.uint8)
    north, east = start[0] - low_r * cell, start[1] - low_c * cell
    for step in range(8):
        for r in range(rows):
            for c in range(columns):
                if not (0 <= r + NORTH[step] < rows and 0 <= c + EAST[step] < columns):
                    barred[r, c, step] = 1
    for k in range(discs.shape[0]):
        keep = discs[k, 2] - TOUCH_M
        around = keep + cell
        pn, pe = discs[k, 0] - north, discs[k, 1] - east
        for r in range(max(0, int((pn - around) / cell)), min(rows, int((pn + around) / cell) + 2)):
            for c in range(
                max(0, int((pe - around) / cell)), min(columns, int((pe + around) / cell) + 2)
            ):
                for step in range(8):
                    n, e = r * cell, c * cell
                    to_n, to_e = (r + NORTH[step]) * cell, (c + EAST[step]) * cell
                    if distance2(pn, pe, n, e, to_n, to_e) < keep * keep:
                        barred[r, c, step] = 1
    return barred, np.array((low_r, low_c))


@kernel
def _trace(places: Floats, parent: Ints, last: int) -> Floats:
    count, at = 1, last
    while parent[at] >= 0:
        count += 1
        at = parent[at]
    path = np.empty((count, 2))
    at = last
    for k in range(count - 1, -1, -1):
        path[k] = places[at]
        at = parent[at]
    return path


@kernel
def _places(
    start: Floats, goal: Floats, origin: Ints, rows: int, columns: int, cell: float
) -> Floats:
    """The cells' centres in rows of the grid, and the goal as the last."""
    places = np.empty((rows * columns + 1, 2))
    for r in range(rows):
        for c in range(columns):
            places[r * columns + c, 0] = start[0] + (r - origin[0]) * cell
            places[r * columns + c, 1] = start[1] + (c - origin[1]) * cell
    places[-1] = goal
    return places


@kernel
def _joins(discs: Floats, place: Floats, goal: Floats, within: float) -> bool:
    """True when the goal is near to a cell's centre and seen from it."""
    if math.hypot(place[0] - goal[0], place[1] - goal[1]) > within:
        return False
    return bool(sees(discs, place[0], place[1], goal[0], goal[1]))


@kernel
def grid_path(
    discs: Floats, start: Floats, goal: Floats, box: Floats, cell: float, any_angle: int
) -> tuple[bool, Floats]:
    """A* over eight neighbours or, with `any_angle` = 1, Theta*: (found, path).

    Theta* (Nash, Daniel, Koenig, Felner, AAAI 2007): a neighbour that the parent of a cell sees
    hangs on that parent. Sight is tested against the discs themselves. The goal is joined to the
    cells within a cell's diagonal that see it.
    """
    barred, origin = barred_steps(discs, start, box, cell)
    rows, columns = barred.shape[0], barred.shape[1]
    total = rows * columns
    places = _places(start, goal, origin, rows, columns, cell)
    cost = np.full(total + 1, np.inf)
    parent = np.full(total + 1, -1, dtype=np.int64)
    closed = np.zeros(total + 1, dtype=np.uint8)
    first = origin[0] * columns + origin[1]
    cost[first] = 0.0
    queue = [(0.0, first)]
    while len(queue) > 0:
        u = heapq.heappop(queue)[1]
        if u == total:
            return True, _trace(places, parent, total)
        if closed[u] == 1:
            continue
        closed[u] = 1
        p = parent[u]
        for step in range(9):
            if step == 8:
                v = total
                if not _joins(discs, places[u], goal, 1.5 * cell):
                    continue
            elif barred[u // columns, u % columns, step] == 1:
                continue
            else:
                v = u + NORTH[step] * columns + EAST[step]
            if closed[v] == 1:
                continue
            shorter = any_angle == 1 and p >= 0
            if shorter:
                shorter = sees(discs, places[p, 0], places[p, 1], places[v, 0], places[v, 1])
            by = p if shorter else u
            way = cost[by] + math.hypot(places[by, 0] - places[v, 0], places[by, 1] - places[v, 1])
            if way < cost[v] - 1e-12:
                cost[v] = way
                parent[v] = by
                rest = math.hypot(places[v, 0] - goal[0], places[v, 1] - goal[1])
                heapq.heappush(queue, (way + rest, v))
    return False, np.empty((0, 2))


# ---------------------------------------------------------------- potential field


@kernel
def descend(
    discs: Floats, start: Floats, goal: Floats, repulsion: float, influence: float, step: float
) -> tuple[bool, Floats]:
    """Follow the force field from start: (arrived, path). See potential_field.py."""
    most = 20 * int(math.hypot(goal[0] - start[0], goal[1] - start[1]) / step)
    path = np.empty((most + 2, 2))
    path[0] = start
    n, e = start[0], start[1]
    best, patience = np.inf, 0
    for count in range(1, most + 1):
        dn, de = goal[0] - n, goal[1] - e
        away = math.hypot(dn, de)
        if away <= step:
            path[count] = goal
            return True, path[: count + 1]
        if away < best - step:
            best, patience = away, 0
        patience += 1
        if patience > 600:
            break
        pull = min(1.0, 1.0 / away)
        fn, fe = pull * dn, pull * de
        # A constant pull from afar, falling to zero at the goal; so does the push (Ge and Cui).
        fading = min(1.0, away)
        room = influence
        for k in range(discs.shape[0]):
            on, oe = n - discs[k, 0], e - discs[k, 1]
            if abs(on) > discs[k, 2] + influence or abs(oe) > discs[k, 2] + influence:
                continue
            centre = math.hypot(on, oe)
            gap = max(centre - discs[k, 2], 1e-4)
            room = min(room, gap)
            if gap < influence:
                push = repulsion * (1.0 / gap - 1.0 / influence) / gap * fading * fading
                fn += push * on / centre
                fe += push * oe / centre
        force = math.hypot(fn, fe)
        if force < 1e-9:
            break
        stride = min(step, max(0.5 * room, 1e-3)) / force
        n, e = n + stride * fn, e + stride * fe
        path[count, 0], path[count, 1] = n, e
    return False, np.empty((0, 2))


# ---------------------------------------------------------------- ant colony


@kernel
def _walk(
    barred: Mask,
    trail: Floats,
    pull: Floats,
    first: int,
    last: int,
    draws: Floats,
    stamp: int,
    visited: Ints,
    cells: Ints,
    steps: Ints,
) -> tuple[int, float]:
    """One ant's way over cells that it has not been to: (cells visited, length in cells; inf)."""
    columns = barred.shape[1]
    at, count, length = first, 1, 0.0
    cells[0] = first
    visited[first] = stamp
    weights = np.empty(8)
    while at != last and count < cells.shape[0]:
        total = 0.0
        r, c = at // columns, at % columns
        for step in range(8):
            weights[step] = 0.0
            if barred[r, c, step] == 0:
                v = at + NORTH[step] * columns + EAST[step]
                if visited[v] != stamp:
                    weights[step] = trail[at, step] * pull[at, step]
                    total += weights[step]
        if total <= 0.0:
            return count, np.inf
        threshold = draws[count - 1] * total
        chosen = -1
        for step in range(8):
            if weights[step] > 0.0:
                chosen = step
                threshold -= weights[step]
                if threshold <= 0.0:
                    break
        steps[count - 1] = chosen
        at += NORTH[chosen] * columns + EAST[chosen]
        length += 1.0 if chosen % 2 == 0 else math.sqrt(2.0)
        cells[count] = at
        visited[at] = stamp
        count += 1
    return count, length if at == last else np.inf


@kernel
def ant_colony(
    barred: Mask,
    first: int,
    last: int,
    ants: int,
    rounds: int,
    greed: float,
    evaporation: float,
    rng: np.random.Generator,
) -> tuple[bool, Ints]:
    """MAX-MIN ant system over the grid's steps: (found, cells of the best way).

    Weight of a step: trail * exp(greed * progress towards `last` in cells). After each round all
    trails fade by `evaporation` and the best way so far lays 1 / length, within the bounds of
    Stuetzle and Hoos (FGCS 2000).
    """
    rows, columns = barred.shape[0], barred.shape[1]
    total = rows * columns
    goal_r, goal_c = last // columns, last % columns
    pull = np.zeros((total, 8))
    for u in range(total):
        r, c = u // columns, u % columns
        here = math.hypot(goal_r - r, goal_c - c)
        for step in range(8):
            if barred[r, c, step] == 0:
                there = math.hypot(goal_r - r - NORTH[step], goal_c - c - EAST[step])
                stride = 1.0 if step % 2 == 0 else math.sqrt(2.0)
                pull[u, step] = math.exp(greed * (here - there) / stride)
    trail = np.ones((total, 8))
    visited = np.zeros(total, dtype=np.int64)
    longest = 4 * (rows + columns)
    cells, steps = np.empty(longest, dtype=np.int64), np.empty(longest, dtype=np.int64)
    best_cells, best_steps = cells.copy(), steps.copy()
    best, best_count, stamp = np.inf, 0, 0
    for _ in range(rounds):
        for _ in range(ants):
            stamp += 1
            draws = rng.random(longest)
            count, length = _walk(
                barred, trail, pull, first, last, draws, stamp, visited, cells, steps
            )
            if length < best:
                best, best_count = length, count
                best_cells[:count] = cells[:count]
                best_steps[: count - 1] = steps[: count - 1]
        if best == np.inf:
            continue
        most = 1.0 / (evaporation * best)
        least = most / (2.0 * rows)
        trail *= 1.0 - evaporation
        for k in range(best_count - 1):
            trail[best_cells[k], best_steps[k]] += 1.0 / best
        for u in range(total):
            for step in range(8):
                trail[u, step] = min(most, max(least, trail[u, step]))
    return bool(best < np.inf), best_cells[:best_count]


@kernel
def shortcut(discs: Floats, path: Floats, spacing: float) -> Floats:
    """The path pulled taut: resampled, then from each point to the farthest in sight, twice.

    Once from either end, with a point every `spacing`.
    """
    for _ in range(2):
        dense = np.empty((path.shape[0] + int(_length(path) / spacing) + 1, 2))
        dense[0] = path[0]
        count = 1
        for k in range(path.shape[0] - 1):
            dn, de = path[k + 1, 0] - path[k, 0], path[k + 1, 1] - path[k, 1]
            pieces = int(math.hypot(dn, de) / spacing) + 1
            for j in range(1, pieces + 1):
                dense[count, 0] = path[k, 0] + dn * j / pieces
                dense[count, 1] = path[k, 1] + de * j / pieces
                count += 1
        kept = np.empty((count, 2))
        kept[0] = dense[0]
        size, at = 1, 0
        while at < count - 1:
            far = count - 1
            while far > at + 1 and not sees(
                discs, dense[at, 0], dense[at, 1], dense[far, 0], dense[far, 1]
            ):
                far -= 1
            kept[size] = dense[far]
            size += 1
            at = far
        path = kept[:size][::-1].copy()
    return path


@kernel
def _length(path: Floats) -> float:
    total = 0.0
    for k in range(path.shape[0] - 1):
        total += math.hypot(path[k + 1, 0] - path[k, 0], path[k + 1, 1] - path[k, 1])
    return total
