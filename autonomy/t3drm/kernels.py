"""The loops of this package, compiled. Every kernel lives in this one file.

numba's disk cache does not notice a change in a function of another file, so kernels and all that
they call stay together. Conventions: points are rows (north, east) of float64 arrays, angles grow
from north to east, `sense` is +1 in that direction and -1 against it, indices are int64. The typed
faces are in the paper's files (spherical, classification, geodesic, hyperbolic, planner).
"""

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
"""A tangent may cut a disc by this much: it is what rounding does to a touching one."""
CUT_M = 1e-6
"""A disc is added to the active set when the answer cuts it by more than this."""
TIE_RAD = 1e-7
"""Two directions nearer than this are one: collinear equal discs share their tangent."""
CHAIN_M = 1.5
"""How far around a cut the chain of its component is activated."""
ARC_STEP_RAD = 0.05
"""How finely an exposed arc is looked at for the fence that cuts it."""
SLACK_M = 1e-3
"""What sampled curves may take from a keep-out."""

FLOOD_FROM = 32
"""With more active discs than this it pays to ask which discs the free space around start meets."""
SQUARE_M = 0.25
"""Least side of a square of the spatial index."""
MANY = 2000
"""From this many points on the tree of boxes is quicker than Prim's algorithm (measured)."""
LEAF = 8
"""Points in a leaf of the tree of boxes (measured)."""

FOUND, CLOSED, TOO_MANY, START_INSIDE, GOAL_INSIDE, BEATEN = 0, 1, 2, 3, 4, 5

Squares = tuple[Floats, Ints, Ints]
"""A spatial index (`into_squares`): box, first, items."""
Field = tuple[Floats, Floats, Ints, Mask, Squares]
"""Discs made ready: centres, radii, component of each, sparse chain of each, index."""


def kernel(function: Compiled) -> Compiled:
    """`numba.njit` with the disk cache, with a type that mypy can follow."""
    return cast(Compiled, njit(cache=True)(function))


# ---------------------------------------------------------------- distances


@kernel
def segment_distance2(pn: float, pe: float, an: float, ae: float, bn: float, be: float) -> float:
    """Squared distance from p to the segment a-b."""
    dn, de = bn - an, be - ae
    wn, we = pn - an, pe - ae
    length2 = dn * dn + de * de
    t = wn * dn + we * de
    if t > 0.0 and length2 > 0.0:
        t = 1.0 if t >= length2 else t / length2
        wn -= t * dn
        we -= t * de
    return wn * wn + we * we


@kernel
def clearance2(points: Floats, n: float, e: float) -> float:
    """Squared distance from (n, e) to the nearest of `points`; inf when there are none."""
    best = np.inf
    for k in range(points.shape[0]):
        dn, de = points[k, 0] - n, points[k, 1] - e
        d2 = dn * dn + de * de
        best = min(best, d2)
    return best


# ---------------------------------------------------------------- spatial index

_ROW_COUNT, _COLUMN_COUNT, _WIDEST = 3, 4, 5


@kernel
def into_squares(points: Floats, widest: float) -> Squares:
    """Points sorted into squares: (box, first, items), what lies near is found without the rest.

    box: north and east of the corner, side, rows, columns, and `widest` (the largest radius of
    the discs whose centres the points are). Square r * columns + c holds
    items[first[square] : first[square + 1]], ascending: squares of a row follow each other.
    Never many more squares than points, however far these are apart.
    """
    n = points.shape[0]
    box = np.array([0.0, 0.0, SQUARE_M, 1.0, 1.0, widest])
    if n == 0:
        return box, np.zeros(2, dtype=np.int64), np.empty(0, dtype=np.int64)
    box[0], box[1] = points[0, 0], points[0, 1]
    high_n, high_e = points[0, 0], points[0, 1]
    for k in range(1, n):
        box[0], high_n = min(box[0], points[k, 0]), max(high_n, points[k, 0])
        box[1], high_e = min(box[1], points[k, 1]), max(high_e, points[k, 1])
    box[2] = max(SQUARE_M, max(high_n - box[0], high_e - box[1]) / (8.0 + 2.0 * math.sqrt(n)))
    box[_ROW_COUNT] = float(int((high_n - box[0]) / box[2]) + 1)
    box[_COLUMN_COUNT] = float(int((high_e - box[1]) / box[2]) + 1)
    columns = int(box[_COLUMN_COUNT])
    first = np.zeros(int(box[_ROW_COUNT]) * columns + 1, dtype=np.int64)
    square = np.empty(n, dtype=np.int64)
    for k in range(n):
        row, column = int((points[k, 0] - box[0]) / box[2]), int((points[k, 1] - box[1]) / box[2])
        square[k] = row * columns + column
        first[square[k] + 1] += 1
    for q in range(1, first.shape[0]):
        first[q] += first[q - 1]
    items = np.empty(n, dtype=np.int64)
    for k in range(n - 1, -1, -1):
        # Backwards over the ends of the squares: what is left in `first` are their beginnings.
        first[square[k] + 1] -= 1
        items[first[square[k] + 1]] = k
    for q in range(first.shape[0] - 1):
        first[q] = first[q + 1]
    first[-1] = n
    return box, first, items


@kernel
def _strip(low: float, high: float, origin: float, side: float, count: float) -> tuple[int, int]:
    """First and last row (or column) of squares that a strip meets; 0, -1: none."""
    bottom, top = (low - origin) / side, (high - origin) / side
    if not (top >= 0.0 and bottom < count):
        return 0, -1
    return int(max(bottom, 0.0)), int(min(top, count - 1.0))


@kernel
def _columns_of(
    box: Floats, row: int, reach: float, an: float, ae: float, bn: float, be: float
) -> tuple[int, int]:
    """First and last column of a row of squares within `reach` of the segment a-b; 0, -1: none."""
    begin, end = 0.0, 1.0
    if abs(bn - an) > 1e-9:
        low = (box[0] + row * box[2] - reach - 1e-9 - an) / (bn - an)
        high = (box[0] + (row + 1) * box[2] + reach + 1e-9 - an) / (bn - an)
        begin, end = max(0.0, min(low, high)), min(1.0, max(low, high))
        if begin > end:
            return 0, -1
    east, on = ae + begin * (be - ae), ae + end * (be - ae)
    return _strip(
        min(east, on) - reach - 1e-9, max(east, on) + reach + 1e-9, box[1], box[2], box[4]
    )


@kernel
def points_near(points: Floats, squares: Squares, n: float, e: float, within: float) -> Ints:
    """Numbers of the points nearer than `within` to (n, e), square by square."""
    box, first, items = squares
    bottom, top = _strip(n - within, n + within, box[0], box[2], box[_ROW_COUNT])
    left, right = _strip(e - within, e + within, box[1], box[2], box[_COLUMN_COUNT])
    columns = int(box[_COLUMN_COUNT])
    found = np.empty(16, dtype=np.int64)
    count = 0
    for r in range(bottom, top + 1):
        for j in range(first[r * columns + left], first[r * columns + right + 1]):
            k = items[j]
            dn, de = points[k, 0] - n, points[k, 1] - e
            if dn * dn + de * de < within * within:
                if count == found.shape[0]:
                    more = np.empty(2 * count, dtype=np.int64)
                    more[:count] = found
                    found = more
                found[count] = k
                count += 1
    return found[:count]


@kernel
def segment_is_free(
    points: Floats,
    squares: Squares,
    keep_out: float,
    an: float,
    ae: float,
    bn: float,
    be: float,
) -> bool:
    """True when every one of `points` is at least `keep_out` from the segment a-b."""
    box, first, items = squares
    limit = keep_out * keep_out
    columns = int(box[_COLUMN_COUNT])
    bottom, top = _strip(
        min(an, bn) - keep_out, max(an, bn) + keep_out, box[0], box[2], box[_ROW_COUNT]
    )
    for r in range(bottom, top + 1):
        left, right = _columns_of(box, r, keep_out, an, ae, bn, be)
        for j in range(first[r * columns + left], first[r * columns + right + 1]):
            k = items[j]
            if segment_distance2(points[k, 0], points[k, 1], an, ae, bn, be) < limit:
                return False
    return True


@kernel
def path_clearance(path: Floats, points: Floats) -> float:
    """The least distance between the polyline `path` and `points`; inf when there are none."""
    best = np.inf
    for i in range(path.shape[0] - 1):
        an, ae, bn, be = path[i, 0], path[i, 1], path[i + 1, 0], path[i + 1, 1]
        for k in range(points.shape[0]):
            best = min(best, segment_distance2(points[k, 0], points[k, 1], an, ae, bn, be))
    return math.sqrt(best)


@kernel
def path_is_free(path: Floats, points: Floats, squares: Squares, keep_out: float) -> bool:
    """True when the polyline keeps `keep_out` from all points."""
    for i in range(path.shape[0] - 1):
        if not segment_is_free(
            points, squares, keep_out, path[i, 0], path[i, 1], path[i + 1, 0], path[i + 1, 1]
        ):
            return False
    return True


@kernel
def path_is_inside(path: Floats, polygon: Floats, sides: Floats) -> bool:
    """True when every corner is inside the polygon and no leg crosses one of `sides`."""
    for i in range(path.shape[0]):
        if not _inside_polygon(polygon, path[i, 0], path[i, 1]):
            return False
    if sides.shape[0] > 0:
        for i in range(path.shape[0] - 1):
            if _leaves(sides, path[i, 0], path[i, 1], path[i + 1, 0], path[i + 1, 1]):
                return False
    return True


@kernel
def _entry(
    pn: float, pe: float, radius2: float, an: float, ae: float, bn: float, be: float
) -> float:
    """Length along a-b at which the segment first is nearer than sqrt(radius2) to p; inf: never."""
    if segment_distance2(pn, pe, an, ae, bn, be) >= radius2:
        return np.inf
    wn, we = pn - an, pe - ae
    start2 = wn * wn + we * we
    if start2 < radius2:
        return 0.0
    length = math.hypot(bn - an, be - ae)
    along = (wn * (bn - an) + we * (be - ae)) / length
    return max(0.0, along - math.sqrt(max(0.0, radius2 - start2 + along * along)))


@kernel
def first_violation(path: Floats, points: Floats, keep_out: float) -> tuple[int, float, int]:
    """(segment, length along the whole path, point) of the first place that is nearer than
    `keep_out` to a point; (-1, inf, -1) when there is none.

    A point that is nearer than that to the path's beginning counts only where the path comes
    nearer still (by more than SLACK_M): the way out of a keep-out is no violation of it.
    """
    near = np.empty(points.shape[0], dtype=np.int64)
    floor2 = np.empty(points.shape[0])
    low_n, high_n = path[:, 0].min() - keep_out, path[:, 0].max() + keep_out
    low_e, high_e = path[:, 1].min() - keep_out, path[:, 1].max() + keep_out
    count = 0
    for k in range(points.shape[0]):
        n, e = points[k, 0], points[k, 1]
        if low_n < n < high_n and low_e < e < high_e:
            near[count] = k
            begin = math.hypot(n - path[0, 0], e - path[0, 1]) - SLACK_M
            floor2[count] = max(0.0, min(begin, keep_out)) ** 2
            count += 1
    travelled = 0.0
    for i in range(path.shape[0] - 1):
        an, ae, bn, be = path[i, 0], path[i, 1], path[i + 1, 0], path[i + 1, 1]
        low_n, high_n = min(an, bn) - keep_out, max(an, bn) + keep_out
        low_e, high_e = min(ae, be) - keep_out, max(ae, be) + keep_out
        first, who = np.inf, -1
        for j in range(count):
            k = near[j]
            n, e = points[k, 0], points[k, 1]
            if low_n < n < high_n and low_e < e < high_e:
                at = _entry(n, e, floor2[j], an, ae, bn, be)
                if at < first:
                    first, who = at, k
        if who >= 0:
            return i, travelled + first, who
        travelled += math.hypot(bn - an, be - ae)
    return -1, np.inf, -1


# ---------------------------------------------------------------- components


@kernel
def spanning_tree(points: Floats) -> tuple[Ints, Ints, Floats]:
    """Minimum spanning tree of points: (order, parent, gap).

    `order` lists the points as they join from the first on, always the nearest one next,
    `parent[i]` is the one that i joined (-1 for the first), `gap[i]` the distance between them.
    Time is n log n from `MANY` points on. Where trees are equally long, which one comes out
    depends on how many points there are; the lengths of its edges do not.
    """
    if points.shape[0] < MANY:
        return prim_tree(points)
    return boxed_tree(points)


@kernel
def prim_tree(points: Floats) -> tuple[Ints, Ints, Floats]:
    """`spanning_tree` with Prim's algorithm: quadratic, and the quickest one for a small map."""
    n = points.shape[0]
    order = np.empty(n, dtype=np.int64)
    parent = np.full(n, -1, dtype=np.int64)
    gap = np.full(n, np.inf)
    # Those still open lie side by side, so that the first of the two loops is vectorised.
    north, east = points[:, 0].copy(), points[:, 1].copy()
    ids = np.arange(n)
    near = np.full(n, np.inf)
    by = np.full(n, -1, dtype=np.int64)
    at = 0
    for left in range(n - 1, -1, -1):
        i = ids[at]
        order[n - 1 - left] = i
        parent[i], gap[i] = by[at], near[at]
        cn, ce = north[at], east[at]
        # The chosen one leaves: the last one takes its place.
        north[at], east[at] = north[left], east[left]
        ids[at], near[at], by[at] = ids[left], near[left], by[left]
        for k in range(left):
            dn, de = north[k] - cn, east[k] - ce
            w = math.sqrt(dn * dn + de * de)
            closer = w < near[k]
            near[k] = w if closer else near[k]
            by[k] = i if closer else by[k]
        best = np.inf
        at = 0
        for k in range(left):
            if near[k] < best:
                best = near[k]
                at = k
    return order, parent, gap


@kernel
def _every_second(bits: int) -> int:
    """The lower 16 bits with a 0 before each of them."""
    bits = (bits | (bits << 8)) & 0x00FF00FF
    bits = (bits | (bits << 4)) & 0x0F0F0F0F
    bits = (bits | (bits << 2)) & 0x33333333
    return (bits | (bits << 1)) & 0x55555555


@kernel
def _along_z(points: Floats) -> Ints:
    """Numbers of the points along Morton's curve: what follows each other is mostly near."""
    n = points.shape[0]
    corner_n, corner_e = points[:, 0].min(), points[:, 1].min()
    wide = max(points[:, 0].max() - corner_n, points[:, 1].max() - corner_e)
    scale = 65535.0 / wide if wide > 0.0 else 0.0
    keys = np.empty(n, dtype=np.int64)
    for k in range(n):
        row = int((points[k, 0] - corner_n) * scale) & 0xFFFF
        column = int((points[k, 1] - corner_e) * scale) & 0xFFFF
        keys[k] = (((_every_second(row) << 1) | _every_second(column)) << 31) | k
    keys.sort()
    return keys & 0x7FFFFFFF


@kernel
def _boxes_of(points: Floats) -> Floats:
    """Bounding boxes (low north, low east, high north, high east) of a tree over the points.

    Node 1 is all of them, 2 k and 2 k + 1 are the halves of k. The last half of the nodes are
    leaves of LEAF points that follow each other; a box without points is at infinity.
    """
    n = points.shape[0]
    leaves = 1
    while leaves * LEAF < n:
        leaves *= 2
    boxes = np.full((2 * leaves, 4), np.inf)
    boxes[:, 2:] = -np.inf
    for k in range(n):
        box = boxes[leaves + k // LEAF]
        box[0], box[2] = min(box[0], points[k, 0]), max(box[2], points[k, 0])
        box[1], box[3] = min(box[1], points[k, 1]), max(box[3], points[k, 1])
    for node in range(leaves - 1, 0, -1):
        for side in range(2):
            boxes[node, side] = min(boxes[2 * node, side], boxes[2 * node + 1, side])
            boxes[node, 2 + side] = max(boxes[2 * node, 2 + side], boxes[2 * node + 1, 2 + side])
    return boxes


@kernel
def _own_boxes(labels: Ints, owners: Ints) -> None:
    """Set `owners` to the label that all points of a box have; -1: they differ, or none."""
    leaves = owners.shape[0] // 2
    owners[:] = -1
    for leaf in range((labels.shape[0] + LEAF - 1) // LEAF):
        label = labels[leaf * LEAF]
        for k in range(leaf * LEAF, min(labels.shape[0], (leaf + 1) * LEAF)):
            if labels[k] != label:
                label = -1
                break
        owners[leaves + leaf] = label
    for node in range(leaves - 1, 0, -1):
        if owners[2 * node] == owners[2 * node + 1]:
            owners[node] = owners[2 * node]


@kernel
def _box_distance2(boxes: Floats, node: int, n: float, e: float) -> float:
    """Squared distance to a box: rounded as those to its points are, so never above them."""
    dn = max(0.0, max(boxes[node, 0] - n, n - boxes[node, 2]))
    de = max(0.0, max(boxes[node, 1] - e, e - boxes[node, 3]))
    return float(dn * dn + de * de)


@kernel
def _nearest_stranger(
    i: int, points: Floats, boxes: Floats, labels: Ints, owners: Ints, limit2: float, stack: Ints
) -> tuple[float, int]:
    """(squared distance, number) of the nearest point with another label than point i.

    (limit2, -1) when none is nearer than that. From the leaf of i upwards, at every node the half
    from which one did not come.
    """
    n, e, mine = points[i, 0], points[i, 1], labels[i]
    leaves = boxes.shape[0] // 2
    nearest, who = limit2, -1
    climber = leaves + i // LEAF
    node = climber
    while True:
        stack[0] = node
        size = 1
        while size > 0:
            size -= 1
            node = stack[size]
            if owners[node] == mine or not _box_distance2(boxes, node, n, e) < nearest:
                continue
            if node >= leaves:
                first = (node - leaves) * LEAF
                for k in range(first, min(points.shape[0], first + LEAF)):
                    dn, de = points[k, 0] - n, points[k, 1] - e
                    d2 = dn * dn + de * de
                    if d2 < nearest and labels[k] != mine:
                        nearest, who = d2, k
                continue
            left, right = 2 * node, 2 * node + 1
            if _box_distance2(boxes, left, n, e) < _box_distance2(boxes, right, n, e):
                left, right = right, left
            stack[size], stack[size + 1] = left, right
            size += 2
        if climber == 1:
            return nearest, who
        node = climber ^ 1
        climber //= 2


@kernel
def _ways_out(
    points: Floats, boxes: Floats, labels: Ints, owners: Ints, near2: Floats, by: Ints
) -> Ints:
    """(n, 2) ends of the shortest edge that leaves each component, in the row of its label.

    `near2` and `by` are kept from round to round: no point outside i's component is nearer than
    near2[i], and by[i] is that near if it is still outside (-1: not known).
    """
    n = points.shape[0]
    least2 = np.full(n, np.inf)
    edges = np.full((n, 2), -1, dtype=np.int64)
    stack = np.empty(128, dtype=np.int64)
    for i in range(n):
        mine = labels[i]
        if by[i] >= 0 and labels[by[i]] == mine:
            by[i] = -1
        if by[i] >= 0 and near2[i] < least2[mine]:
            least2[mine] = near2[i]
            edges[mine, 0], edges[mine, 1] = i, by[i]
    for i in range(n):
        mine = labels[i]
        if by[i] >= 0 or near2[i] >= least2[mine]:
            continue
        near2[i], by[i] = _nearest_stranger(i, points, boxes, labels, owners, least2[mine], stack)
        if by[i] >= 0:
            least2[mine] = near2[i]
            edges[mine, 0], edges[mine, 1] = i, by[i]
            other = labels[by[i]]
            if near2[i] < least2[other]:
                least2[other] = near2[i]
                edges[other, 0], edges[other, 1] = by[i], i
    return edges


@kernel
def _root(above: Ints, label: int) -> int:
    while above[label] != label:
        above[label] = above[above[label]]
        label = above[label]
    return label


@kernel
def _edges_of_boxes(points: Floats) -> Ints:
    """(n - 1, 2) edges of a minimum spanning tree of points that lie along Morton's curve; fewer
    where distances are not finite.

    Boruvka: every component takes its shortest way out, until there is one component. An edge
    that would close a circle (equal lengths) is left out, which keeps the tree minimal: every
    component on the way round has no shorter way out than that edge.
    """
    n = points.shape[0]
    edges = np.empty((max(0, n - 1), 2), dtype=np.int64)
    labels, above = np.arange(n), np.arange(n)
    boxes = _boxes_of(points)
    owners = np.empty(boxes.shape[0], dtype=np.int64)
    near2, by = np.full(n, -1.0), np.full(n, -1, dtype=np.int64)
    count, before = 0, -1
    while before < count < n - 1:
        before = count
        _own_boxes(labels, owners)
        ways = _ways_out(points, boxes, labels, owners, near2, by)
        for k in range(n):
            a, b = ways[k, 0], ways[k, 1]
            if a < 0:
                continue
            one, other = _root(above, labels[a]), _root(above, labels[b])
            if one != other:
                above[max(one, other)] = min(one, other)
                edges[count, 0], edges[count, 1] = a, b
                count += 1
        for k in range(n):
            labels[k] = _root(above, labels[k])
    return edges[:count]


@kernel
def _grown(points: Floats, edges: Ints) -> tuple[Ints, Ints, Floats]:
    """(order, parent, gap) of a spanning tree's edges, as Prim's algorithm would find them."""
    n = points.shape[0]
    order = np.empty(n, dtype=np.int64)
    parent = np.full(n, -1, dtype=np.int64)
    gap = np.full(n, np.inf)
    first = np.zeros(n + 2, dtype=np.int64)
    for k in range(edges.shape[0]):
        first[edges[k, 0] + 2] += 1
        first[edges[k, 1] + 2] += 1
    for k in range(2, n + 2):
        first[k] += first[k - 1]
    neighbours = np.empty(2 * edges.shape[0], dtype=np.int64)
    for k in range(edges.shape[0]):
        a, b = edges[k, 0], edges[k, 1]
        neighbours[first[a + 1]], neighbours[first[b + 1]] = b, a
        first[a + 1] += 1
        first[b + 1] += 1
    keys, items, size = _push(np.empty(64), np.empty(64, dtype=np.int64), 0, 0.0, 0)
    for at in range(n):
        i = items[0]
        size -= 1
        _sift_down(keys, items, size)
        order[at] = i
        for k in range(first[i], first[i + 1]):
            j = neighbours[k]
            if j != parent[i]:
                dn, de = points[j, 0] - points[i, 0], points[j, 1] - points[i, 1]
                parent[j], gap[j] = i, math.sqrt(dn * dn + de * de)
                keys, items, size = _push(keys, items, size, gap[j], j)
    return order, parent, gap


@kernel
def boxed_tree(points: Floats) -> tuple[Ints, Ints, Floats]:
    """`spanning_tree` over a tree of boxes: n log n, wherever the points lie."""
    n = points.shape[0]
    along = _along_z(points) if n > 0 else np.empty(0, dtype=np.int64)
    edges = _edges_of_boxes(points[along])
    if edges.shape[0] < n - 1:
        # Distances that are not finite: no nearest one.
        return prim_tree(points)
    for k in range(edges.shape[0]):
        edges[k, 0], edges[k, 1] = along[edges[k, 0]], along[edges[k, 1]]
    return _grown(points, edges)


@kernel
def cut_tree(order: Ints, parent: Ints, gap: Floats, threshold: float) -> tuple[Ints, int]:
    """Component label of every disc when only gaps below `threshold` join; (labels, count)."""
    labels = np.empty(order.shape[0], dtype=np.int64)
    count = 0
    for at in range(order.shape[0]):
        i = order[at]
        if parent[i] >= 0 and gap[i] < threshold:
            labels[i] = labels[parent[i]]
        else:
            labels[i] = count
            count += 1
    return labels, count


@kernel
def sparse_chain(
    order: Ints, parent: Ints, gap: Floats, threshold: float, centres: Floats, radii: Floats
) -> Mask:
    """1 for enough discs of every component that neighbours along its tree still overlap.

    A wall of hits every 2.5 cm is as closed with one in fifteen of them: these few close it at
    once where single discs would be found one by one.
    """
    n = order.shape[0]
    anchor = np.empty(n, dtype=np.int64)
    chain = np.zeros(n, dtype=np.uint8)
    for at in range(n):
        i = order[at]
        p = parent[i]
        if p < 0 or gap[i] >= threshold:
            anchor[i] = i
            chain[i] = 1
            continue
        a = anchor[p]
        d = math.hypot(centres[i, 0] - centres[a, 0], centres[i, 1] - centres[a, 1])
        if d > 0.95 * (radii[i] + radii[a]) and p != a:
            chain[p] = 1
            a = p
        anchor[i] = a
    return chain


@kernel
def _cells(centres: Floats, radii: Floats) -> tuple[Floats, Ints, Ints, Ints]:
    """Discs sorted into squares as wide as the largest of them: (box, shape, heads, next).

    box: (north, east) of the corner and the side; `heads` has the first disc of every square and
    `next` the one after each disc, -1 at the end. Overlapping discs are in neighbouring squares.
    """
    n = centres.shape[0]
    box = np.empty(3)
    box[0], box[1] = centres[:, 0].min(), centres[:, 1].min()
    wide = max(centres[:, 0].max() - box[0], centres[:, 1].max() - box[1])
    # Never many more squares than discs, however far these are apart.
    box[2] = max(2.0 * radii.max(), wide / (1.0 + math.sqrt(n)), 1e-9)
    shape = np.empty(2, dtype=np.int64)
    shape[0] = int((centres[:, 0].max() - box[0]) / box[2]) + 1
    shape[1] = int((centres[:, 1].max() - box[1]) / box[2]) + 1
    heads = np.full(shape[0] * shape[1], -1, dtype=np.int64)
    following = np.empty(n, dtype=np.int64)
    for k in range(n):
        cell = int((centres[k, 0] - box[0]) / box[2]) * shape[1]
        cell += int((centres[k, 1] - box[1]) / box[2])
        following[k] = heads[cell]
        heads[cell] = k
    return box, shape, heads, following


@kernel
def _take_overlapping(
    a: int,
    centres: Floats,
    radii: Floats,
    cells: tuple[Floats, Ints, Ints, Ints],
    labels: Ints,
    stack: Ints,
    size: int,
) -> int:
    """Move the discs that overlap disc a from the squares to the stack, the farthest on top."""
    box, shape, heads, following = cells
    row, column = int((centres[a, 0] - box[0]) / box[2]), int((centres[a, 1] - box[1]) / box[2])
    begin, farthest = size, -np.inf
    for r in range(max(0, row - 1), min(shape[0], row + 2)):
        for c in range(max(0, column - 1), min(shape[1], column + 2)):
            cell = r * shape[1] + c
            before, k = -1, heads[cell]
            while k >= 0:
                after = following[k]
                reach = radii[a] + radii[k]
                dn, de = centres[k, 0] - centres[a, 0], centres[k, 1] - centres[a, 1]
                d2 = dn * dn + de * de
                if d2 >= reach * reach:
                    before, k = k, after
                    continue
                if before < 0:
                    heads[cell] = after
                else:
                    following[before] = after
                if k != a:
                    labels[k] = labels[a]
                    stack[size] = k
                    if d2 - reach * reach > farthest:
                        farthest = d2 - reach * reach
                        stack[begin], stack[size] = stack[size], stack[begin]
                    size += 1
                k = after
    if size > begin:
        stack[begin], stack[size - 1] = stack[size - 1], stack[begin]
    return size


@kernel
def join_overlapping(centres: Floats, radii: Floats) -> tuple[Ints, Mask]:
    """(component of every disc, sparse chain of it): as `cut_tree` and `sparse_chain` at gap 0.

    Time grows with the number of discs and of those that overlap each, not with its square. A
    disc joins the chain when it is the first to overlap discs that nobody did before; the farthest
    of those goes on, so that a chain along a wall has one disc in about a keep-out diameter.
    """
    n = centres.shape[0]
    labels = np.full(n, -1, dtype=np.int64)
    chain = np.zeros(n, dtype=np.uint8)
    if n == 0:
        return labels, chain
    cells = _cells(centres, radii)
    stack = np.empty(n, dtype=np.int64)
    count = 0
    for first in range(n):
        if labels[first] >= 0:
            continue
        labels[first] = count
        count += 1
        chain[first] = 1
        stack[0] = first
        size = 1
        while size > 0:
            size -= 1
            a = stack[size]
            before = size
            size = _take_overlapping(a, centres, radii, cells, labels, stack, size)
            if size > before:
                chain[a] = 1
    return labels, chain


@kernel
def _turn(points: Floats, o: int, a: int, b: int) -> float:
    on, oe = points[o, 0], points[o, 1]
    an, ae = points[a, 0] - on, points[a, 1] - oe
    return float(an * (points[b, 1] - oe) - ae * (points[b, 0] - on))


@kernel
def convex_hull(points: Floats) -> Ints:
    """Indices of the strictly convex hull, in the sense north to east (monotone chain)."""
    n = points.shape[0]
    by_north = np.argsort(points[:, 0], kind="mergesort")
    # Ties in north are ordered by east with an insertion pass.
    for i in range(1, n):
        j = i
        while (
            j > 0
            and points[by_north[j - 1], 0] == points[by_north[j], 0]
            and points[by_north[j - 1], 1] > points[by_north[j], 1]
        ):
            by_north[j - 1], by_north[j] = by_north[j], by_north[j - 1]
            j -= 1
    if n < 3:
        return by_north
    hull = np.empty(2 * n + 1, dtype=np.int64)
    size = 0
    for i in by_north:
        while size >= 2 and _turn(points, hull[size - 2], hull[size - 1], i) <= 0:
            size -= 1
        hull[size] = i
        size += 1
    lower = size + 1
    for at in range(n - 2, -1, -1):
        i = by_north[at]
        while size >= lower and _turn(points, hull[size - 2], hull[size - 1], i) <= 0:
            size -= 1
        hull[size] = i
        size += 1
    return hull[: max(1, size - 1)]


@kernel
def _circle_of_two(a: Floats, b: Floats) -> tuple[float, float, float]:
    return (
        0.5 * (a[0] + b[0]),
        0.5 * (a[1] + b[1]),
        0.5 * math.hypot(a[0] - b[0], a[1] - b[1]),
    )


@kernel
def _circle_of_three(a: Floats, b: Floats, c: Floats) -> tuple[float, float, float]:
    """Circumscribed circle; for collinear points the circle on the longest side."""
    bn, be, cn, ce = b[0] - a[0], b[1] - a[1], c[0] - a[0], c[1] - a[1]
    det = 2.0 * (bn * ce - be * cn)
    if abs(det) < 1e-12:
        first, second, third = _circle_of_two(a, b), _circle_of_two(a, c), _circle_of_two(b, c)
        if first[2] >= second[2] and first[2] >= third[2]:
            return first
        return second if second[2] >= third[2] else third
    b2, c2 = bn * bn + be * be, cn * cn + ce * ce
    un, ue = (ce * b2 - be * c2) / det, (bn * c2 - cn * b2) / det
    return a[0] + un, a[1] + ue, math.hypot(un, ue)


@kernel
def _outside(circle: tuple[float, float, float], p: Floats) -> bool:
    return math.hypot(p[0] - circle[0], p[1] - circle[1]) > circle[2] * (1.0 + 1e-12) + 1e-12


@kernel
def enclosing_circle(points: Floats) -> tuple[float, float, float]:
    """(north, east, radius) of the smallest circle around `points` (at least one of them)."""
    circle = (points[0, 0], points[0, 1], 0.0)
    for i in range(1, points.shape[0]):
        if not _outside(circle, points[i]):
            continue
        circle = (points[i, 0], points[i, 1], 0.0)
        for j in range(i):
            if not _outside(circle, points[j]):
                continue
            circle = _circle_of_two(points[i], points[j])
            for k in range(j):
                if _outside(circle, points[k]):
                    circle = _circle_of_three(points[i], points[j], points[k])
    return circle


@kernel
def regularity(edges: Floats, members: Ints, longest: float) -> float:
    """1 / (1 + deviation / mean) over the members' edges below `longest`; 0 when there are none."""
    count, total, squares = 0, 0.0, 0.0
    for k in members:
        if edges[k] < longest:
            count += 1
            total += edges[k]
            squares += edges[k] * edges[k]
    if count == 0:
        return 0.0
    if total == 0.0:
        return 1.0
    mean = total / count
    return 1.0 / (1.0 + math.sqrt(max(0.0, squares / count - mean * mean)) / mean)


@kernel
def describe(points: Floats, members: Ints) -> tuple[Ints, float, float, float, float]:
    """(hull as indices into `points`, circle north, east, radius, linearity) of `members`.

    linearity = 1 - l2 / l1 with l1 >= l2 the variances along the principal axes; 0 for one point.
    """
    if members.shape[0] == 1:
        return members, points[members[0], 0], points[members[0], 1], 0.0, 0.0
    own = points[members]
    hull = convex_hull(own)
    north, east, radius = enclosing_circle(own[hull])
    count = own.shape[0]
    mn, me = own[:, 0].mean(), own[:, 1].mean()
    nn = ee = ne = 0.0
    for k in range(count):
        dn, de = own[k, 0] - mn, own[k, 1] - me
        nn += dn * dn
        ee += de * de
        ne += dn * de
    half, spread = 0.5 * (nn + ee), math.hypot(0.5 * (nn - ee), ne)
    linearity = 0.0
    if half + spread > 0.0:
        linearity = min(1.0, max(0.0, 1.0 - (half - spread) / (half + spread)))
    return members[hull], north, east, radius, linearity


@kernel
def by_label(labels: Ints, count: int) -> tuple[Ints, Ints]:
    """(members, first): component c is members[first[c] : first[c + 1]], ascending."""
    first = np.zeros(count + 1, dtype=np.int64)
    for k in range(labels.shape[0]):
        first[labels[k] + 1] += 1
    for c in range(count):
        first[c + 1] += first[c]
    at = first[:count].copy()
    members = np.empty(labels.shape[0], dtype=np.int64)
    for k in range(labels.shape[0]):
        members[at[labels[k]]] = k
        at[labels[k]] += 1
    return members, first


@kernel
def outlines(points: Floats, members: Ints, first: Ints) -> tuple[Ints, Ints, Floats]:
    """Convex hulls and enclosing circles of all components: (hulls, first corner of each, rows).

    Component c has the corners hulls[corner[c] : corner[c + 1]] (numbers of points, north to east)
    and the row (circle's north, east, radius, linearity).
    """
    count = first.shape[0] - 1
    hulls = np.empty(members.shape[0], dtype=np.int64)
    corner = np.zeros(count + 1, dtype=np.int64)
    rows = np.empty((count, 4))
    size = 0
    for c in range(count):
        hull, north, east, radius, linearity = describe(points, members[first[c] : first[c + 1]])
        for k in hull:
            hulls[size] = k
            size += 1
        rows[c, 0], rows[c, 1], rows[c, 2], rows[c, 3] = north, east, radius, linearity
        corner[c + 1] = size
    return hulls[:size], corner, rows


@kernel
def regularities_and_deaths(
    parent: Ints, edges: Floats, labels: Ints, members: Ints, first: Ints, threshold: float
) -> Floats:
    """Per component (regularity, death radius) from the spanning tree of all points.

    Death: half of the shortest edge to another component, inf when there is none.
    """
    count = first.shape[0] - 1
    rows = np.empty((count, 2))
    for c in range(count):
        rows[c, 0] = regularity(edges, members[first[c] : first[c + 1]], threshold)
        rows[c, 1] = np.inf
    for k in range(labels.shape[0]):
        if edges[k] >= threshold and parent[k] >= 0:
            for c in (labels[k], labels[parent[k]]):
                rows[c, 1] = min(rows[c, 1], 0.5 * edges[k])
    return rows


@kernel
def with_spheres(
    points: Floats, keep_out: float, labels: Ints, chain: Mask, spheres: Mask, rows: Floats
) -> Field:
    """Every point as a disc of radius `keep_out`, but one sphere (as in `outlines`, and the
    keep-out) instead of the points of every component where `spheres` is 1; those come last.
    """
    count = 0
    for c in range(spheres.shape[0]):
        count += spheres[c]
    for k in range(labels.shape[0]):
        count += 1 - spheres[labels[k]]
    centres, radii = np.empty((count, 2)), np.full(count, keep_out)
    own, links = np.empty(count, dtype=np.int64), np.ones(count, dtype=np.uint8)
    at = 0
    for k in range(labels.shape[0]):
        if spheres[labels[k]] == 0:
            centres[at, 0], centres[at, 1] = points[k, 0], points[k, 1]
            own[at], links[at] = labels[k], chain[k]
            at += 1
    for c in range(spheres.shape[0]):
        if spheres[c] == 1:
            centres[at, 0], centres[at, 1] = rows[c, 0], rows[c, 1]
            radii[at] = keep_out + rows[c, 2]
            own[at] = c
            at += 1
    return centres, radii, own, links, into_squares(centres, radii.max())


# ---------------------------------------------------------------- tangent graph


@kernel
def tangent(
    n1: float, e1: float, r1: float, n2: float, e2: float, r2: float
) -> tuple[bool, float, float, float]:
    """The one tangent from oriented circle 1 to oriented circle 2 (signed radii, + is sense +1).

    (exists, length, direction north, direction east). It touches at c + r (t_e, -t_n).
    """
    dn, de = n2 - n1, e2 - e1
    d2 = dn * dn + de * de
    k = r1 - r2
    rest = d2 - k * k
    if rest <= 0.0:
        # Touching circles, and a point that rounding put just under its circle.
        if d2 == 0.0 or abs(k) - math.sqrt(d2) > TOUCH_M:
            return False, 0.0, 0.0, 0.0
        rest = 0.0
    length = math.sqrt(rest)
    tn, te = (length * dn - k * de) / d2, (length * de + k * dn) / d2
    norm = math.hypot(tn, te)
    return True, length, tn / norm, te / norm


@kernel
def ahead(sense: float, from_rad: float, to_rad: float) -> float:
    """Angle in [0, tau) from one direction to the other in the given sense; ties are 0."""
    angle = sense * (to_rad - from_rad)
    # Bearings differ by less than two turns: this is `% TAU`, several times faster.
    while angle < 0.0:
        angle += TAU
    while angle >= TAU:
        angle -= TAU
    return 0.0 if angle > TAU - TIE_RAD else angle


@kernel
def _crosses(a: Floats, cn: float, ce: float, dn: float, de: float) -> bool:
    """True when segment a = (n, e, n, e) and segment c-d cross."""
    rn, re = a[2] - a[0], a[3] - a[1]
    c = rn * (ce - a[1]) - re * (cn - a[0])
    d = rn * (de - a[1]) - re * (dn - a[0])
    if c * d >= 0.0:
        return False
    sn, se = dn - cn, de - ce
    first = sn * (a[1] - ce) - se * (a[0] - cn)
    second = sn * (a[3] - ce) - se * (a[2] - cn)
    return bool(first * second < 0.0)


@kernel
def _edge_is_free(
    first: int,
    second: int,
    ends: Floats,
    circles: Floats,
    planes: Floats,
    begin: int,
) -> bool:
    """True when the tangent cuts no circle from number `begin` on but its own two, and stays in
    the fence.
    """
    an, ae, bn, be = ends[0], ends[1], ends[2], ends[3]
    for p in range(planes.shape[0]):
        if (
            min(planes[p, 0] * an + planes[p, 1] * ae, planes[p, 0] * bn + planes[p, 1] * be)
            < planes[p, 2] - TOUCH_M
        ):
            return False
    for k in range(begin, circles.shape[0]):
        if k not in (first, second):
            keep = circles[k, 2] - TOUCH_M
            if segment_distance2(circles[k, 0], circles[k, 1], an, ae, bn, be) < keep * keep:
                return False
    return True


@kernel
def _overlap(circles: Floats, i: int, k: int, tolerance_m: float) -> bool:
    """True when two circles intersect, so that neither holds the other."""
    d = math.hypot(circles[k, 0] - circles[i, 0], circles[k, 1] - circles[i, 1])
    ri, rk = circles[i, 2], circles[k, 2]
    return bool(abs(ri - rk) + tolerance_m < d < ri + rk - tolerance_m)


@kernel
def _bar(bars: Floats, counts: Ints, i: int, bearing: float) -> None:
    if counts[i] < bars.shape[1]:
        bars[i, counts[i]] = bearing
        counts[i] += 1


@kernel
def _barred_bearings(circles: Floats, planes: Floats) -> tuple[Floats, Ints]:
    """Per circle the bearings that no free arc contains.

    Both ends of an arc are free, so an overlapping disc (or the fence beyond a side) bars it
    exactly when the bearing of its centre (the side's outward normal) lies inside the arc.
    """
    m = circles.shape[0]
    bars = np.empty((m, m + planes.shape[0]))
    counts = np.zeros(m, dtype=np.int64)
    for i in range(2, m):
        for k in range(i + 1, m):
            if _overlap(circles, i, k, TOUCH_M):
                dn, de = circles[k, 0] - circles[i, 0], circles[k, 1] - circles[i, 1]
                bearing = math.atan2(de, dn)
                _bar(bars, counts, i, bearing)
                _bar(bars, counts, k, bearing + math.pi)
        for p in range(planes.shape[0]):
            inside = planes[p, 0] * circles[i, 0] + planes[p, 1] * circles[i, 1] - planes[p, 2]
            if inside < circles[i, 2] - TOUCH_M:
                _bar(bars, counts, i, math.atan2(-planes[p, 1], -planes[p, 0]))
    return bars, counts


@kernel
def _reach(bars: Floats, counts: Ints, i: int, sense: float, from_rad: float) -> float:
    """How far an arc on circle i may go from `from_rad` before a barred bearing."""
    limit = TAU
    for j in range(counts[i]):
        limit = min(limit, ahead(sense, from_rad, bars[i, j]))
    return limit


@kernel
def _sift_up(keys: Floats, items: Ints, at: int) -> None:
    key, item = keys[at], items[at]
    while at > 0:
        up = (at - 1) >> 1
        if keys[up] <= key:
            break
        keys[at], items[at] = keys[up], items[up]
        at = up
    keys[at], items[at] = key, item


@kernel
def _sift_down(keys: Floats, items: Ints, size: int) -> None:
    """Take the root away: the item at `size` finds its place from the root."""
    key, item = keys[size], items[size]
    at = 0
    while True:
        down = 2 * at + 1
        if down >= size:
            break
        if down + 1 < size and keys[down + 1] < keys[down]:
            down += 1
        if keys[down] >= key:
            break
        keys[at], items[at] = keys[down], items[down]
        at = down
    keys[at], items[at] = key, item


@kernel
def _push(keys: Floats, items: Ints, size: int, key: float, item: int) -> tuple[Floats, Ints, int]:
    if size == keys.shape[0]:
        more_keys = np.empty(2 * size)
        more_items = np.empty(2 * size, dtype=np.int64)
        more_keys[:size] = keys
        more_items[:size] = items
        keys, items = more_keys, more_items
    keys[size] = key
    items[size] = item
    _sift_up(keys, items, size)
    return keys, items, size + 1


# Columns of the table of directed tangents. A row holds until the search ends, its cost for one
# round; it is known to cut none of the first _FREE circles.
_LENGTH, _DEPART, _AN, _AE, _BN, _BE, _COST, _ROUND, _FREE = 0, 1, 2, 3, 4, 5, 6, 7, 8
_COLUMNS = 9


@kernel
def _lay_tangent(circles: Floats, o1: int, o2: int, row: Floats) -> bool:
    """Fill the table's row for the tangent between two oriented circles; False: there is none."""
    c1, c2 = circles[o1 >> 1], circles[o2 >> 1]
    r1 = -c1[2] if o1 & 1 else c1[2]
    r2 = -c2[2] if o2 & 1 else c2[2]
    exists, length, tn, te = tangent(c1[0], c1[1], r1, c2[0], c2[1], r2)
    if not exists:
        return False
    row[_LENGTH] = length
    row[_DEPART] = math.atan2(-r1 * tn, r1 * te)
    row[_AN], row[_AE] = c1[0] + r1 * te, c1[1] - r1 * tn
    row[_BN], row[_BE] = c2[0] + r2 * te, c2[1] - r2 * tn
    return True


@kernel
def _arrival(circles: Floats, i: int, row: Floats) -> float:
    """Bearing from circle i at which the tangent touches it."""
    return math.atan2(row[_BE] - circles[i, 1], row[_BN] - circles[i, 0])


@kernel
def _dominated(
    arrivals: Floats, counts: Ints, o: int, radius: float, at_rad: float, cost: float
) -> bool:
    """True when an arrival expanded before reaches this one along the circle at no more cost."""
    sense = -1.0 if o & 1 else 1.0
    for j in range(min(counts[o], arrivals.shape[1])):
        arc = ahead(sense, arrivals[o, j, 0], at_rad)
        if arc <= arrivals[o, j, 2] and arrivals[o, j, 1] + radius * arc <= cost + 1e-12:
            return True
    return False


@kernel
def _remember(
    arrivals: Floats, counts: Ints, o: int, at_rad: float, cost: float, reach: float
) -> None:
    slot = counts[o] % arrivals.shape[1]
    arrivals[o, slot, 0] = at_rad
    arrivals[o, slot, 1] = cost
    arrivals[o, slot, 2] = reach
    counts[o] += 1


@kernel
def _lay_all(
    circles: Floats,
    o: int,
    at_rad: float,
    cost: float,
    reach: float,
    edge: int,
    turn: int,
    side: int,
    table: Floats,
    state: Mask,
    came: Ints,
    queue: tuple[Floats, Ints, int],
) -> tuple[Floats, Ints, int]:
    """Queue every tangent that leaves oriented circle `o` within `reach` of where it was met."""
    keys, items, size = queue
    i = o >> 1
    radius = circles[i, 2]
    sense = -1.0 if o & 1 else 1.0
    for o2 in range(2, 2 * circles.shape[0]):
        # The goal has no sense: only its even number is used.
        if o2 >> 1 == i or o2 == 3:
            continue
        following = o * side + o2
        row = table[following]
        if state[following] == 0:
            state[following] = 1 if _lay_tangent(circles, o, o2, row) else 2
            row[_ROUND] = 0.0
            row[_FREE] = 2.0
        if state[following] == 2:
            continue
        if row[_ROUND] != turn:
            row[_ROUND] = turn
            row[_COST] = np.inf
        arc = 0.0 if i == 0 else ahead(sense, at_rad, row[_DEPART])
        new = cost + radius * arc + row[_LENGTH]
        if arc <= reach and new < row[_COST] - 1e-12:
            row[_COST] = new
            came[following] = edge
            bound = new + math.hypot(circles[1, 0] - row[_BN], circles[1, 1] - row[_BE])
            keys, items, size = _push(keys, items, size, bound, following)
    return keys, items, size


@kernel
def solve_tangents(
    circles: Floats,
    planes: Floats,
    turn: int,
    side: int,
    table: Floats,
    state: Mask,
    came: Ints,
    limit_m: float,
) -> tuple[int, Ints]:
    """Shortest path over common tangents and arcs: (status, chain of directed tangents).

    FOUND; CLOSED, there is none; BEATEN, there is none shorter than `limit_m`.

    circles: rows (north, east, radius); row 0 is the start and row 1 the goal, radius 0.
    planes: rows (a, b, c): a path stays where a n + b e >= c (convex fence), may be empty.
    A directed tangent is o1 * side + o2 with o = 2 * circle + (sense is -1). A* over arrivals with
    the straight line as bound; a tangent is checked only when it is taken from the queue, and an
    arrival that an earlier one reaches along its circle at no more cost is not expanded.
    table, state (1: laid, 2: there is none or it is blocked) and came are kept from one round
    (`turn`, from 1) to the next: circles are only added, so what is blocked stays blocked, and
    what was free needs a check against the new ones alone.
    """
    bars, bar_counts = _barred_bearings(circles, planes)
    arrivals = np.empty((2 * circles.shape[0], 8, 3))
    arrival_counts = np.zeros(2 * circles.shape[0], dtype=np.int64)
    queue = (np.empty(256), np.empty(256, dtype=np.int64), 0)
    queue = _lay_all(circles, 0, 0.0, 0.0, TAU, -1, turn, side, table, state, came, queue)
    while queue[2] > 0:
        keys, items, size = queue
        edge = items[0]
        if keys[0] >= limit_m:
            return BEATEN, np.empty(0, dtype=np.int64)
        _sift_down(keys, items, size - 1)
        queue = (keys, items, size - 1)
        if state[edge] == 2:
            continue
        row = table[edge]
        o = edge % side
        i = o >> 1
        cost, at_rad = row[_COST], _arrival(circles, i, row)
        if o != 2 and _dominated(arrivals, arrival_counts, o, circles[i, 2], at_rad, cost):
            continue
        begin = int(row[_FREE])
        if not _edge_is_free((edge // side) >> 1, i, row[_AN : _BE + 1], circles, planes, begin):
            state[edge] = 2
            continue
        row[_FREE] = circles.shape[0]
        if o == 2:
            return FOUND, _chain(came, edge)
        reach = _reach(bars, bar_counts, i, -1.0 if o & 1 else 1.0, at_rad)
        _remember(arrivals, arrival_counts, o, at_rad, cost, reach)
        queue = _lay_all(
            circles, o, at_rad, cost, reach, edge, turn, side, table, state, came, queue
        )
    return CLOSED, np.empty(0, dtype=np.int64)


@kernel
def _wider(side: int, table: Floats, state: Mask, new: int) -> tuple[Floats, Mask, Ints]:
    """The table of directed tangents with room for `new` oriented circles instead of `side`."""
    more_table = np.empty((new * new, _COLUMNS))
    more_state = np.zeros(new * new, dtype=np.uint8)
    for o in range(side):
        for o2 in range(side):
            kept = state[o * side + o2]
            more_state[o * new + o2] = kept
            if kept == 1:
                more_table[o * new + o2] = table[o * side + o2]
    return more_table, more_state, np.empty(new * new, dtype=np.int64)


@kernel
def _chain(came: Ints, last: int) -> Ints:
    count = 0
    edge = last
    while edge >= 0:
        count += 1
        edge = came[edge]
    chain = np.empty(count, dtype=np.int64)
    edge = last
    while edge >= 0:
        count -= 1
        chain[count] = edge
        edge = came[edge]
    return chain


# Columns of a route's rows: a segment has disc -1 and sweep 0.
ROW_AN, ROW_AE, ROW_BN, ROW_BE, ROW_DISC, ROW_SWEEP = 0, 1, 2, 3, 4, 5


@kernel
def _rows(chain: Ints, side: int, table: Floats, circles: Floats, active: Ints) -> Floats:
    """The chain as rows (from, to, disc, signed sweep): tangent segments and arcs in turn."""
    rows = np.empty((2 * chain.shape[0], 6))
    count = 0
    for c in range(chain.shape[0]):
        edge = chain[c]
        if c > 0:
            before = table[chain[c - 1]]
            o = edge // side
            sense = -1.0 if o & 1 else 1.0
            arc = ahead(sense, _arrival(circles, o >> 1, before), table[edge, _DEPART])
            if arc > TIE_RAD:
                rows[count, 0:2] = before[_BN : _BE + 1]
                rows[count, 2:4] = table[edge, _AN : _AE + 1]
                rows[count, ROW_DISC] = active[(o >> 1) - 2]
                rows[count, ROW_SWEEP] = sense * arc
                count += 1
        rows[count, 0:4] = table[edge, _AN : _BE + 1]
        rows[count, ROW_DISC] = -1.0
        rows[count, ROW_SWEEP] = 0.0
        count += 1
    return rows[:count]


@kernel
def _depth(row: Floats, centres: Floats, radii: Floats, k: int) -> float:
    """How deep the path's row cuts disc k; negative: it is clear of it."""
    n, e = centres[k, 0], centres[k, 1]
    if row[ROW_DISC] < 0.0:
        away2 = segment_distance2(n, e, row[0], row[1], row[2], row[3])
        return float(radii[k] - math.sqrt(away2))
    i = int(row[ROW_DISC])
    dn, de = n - centres[i, 0], e - centres[i, 1]
    sense = 1.0 if row[ROW_SWEEP] > 0.0 else -1.0
    begin = math.atan2(row[1] - centres[i, 1], row[0] - centres[i, 0])
    if ahead(sense, begin, math.atan2(de, dn)) <= abs(row[ROW_SWEEP]):
        return float(radii[k] - abs(math.hypot(dn, de) - radii[i]))
    nearest = min(math.hypot(n - row[0], e - row[1]), math.hypot(n - row[2], e - row[3]))
    return float(radii[k] - nearest)


@kernel
def _box_of(row: Floats, radii: Floats, margin: float) -> Floats:
    """(north low, high, east low, high) of a row of the path, wider by `margin`."""
    box = np.empty(4)
    box[0], box[1] = min(row[0], row[2]) - margin, max(row[0], row[2]) + margin
    box[2], box[3] = min(row[1], row[3]) - margin, max(row[1], row[3]) + margin
    if row[ROW_DISC] >= 0.0:
        # The arc bulges out of its chord's box by no more than its sagitta.
        half = min(0.5 * abs(row[ROW_SWEEP]), math.pi)
        bulge = radii[int(row[ROW_DISC])] * (1.0 - math.cos(half))
        box[0], box[1] = box[0] - bulge, box[1] + bulge
        box[2], box[3] = box[2] - bulge, box[3] + bulge
    return box


@kernel
def _activate(active: Ints, flags: Mask, count: int, k: int) -> int:
    if flags[k] == 0:
        flags[k] = 1
        if count < active.shape[0]:
            active[count] = k
        return count + 1
    return count


@kernel
def _note_cut(
    row: Floats, field: Field, k: int, slot: Ints, found: Ints, depths: Floats, count: int
) -> int:
    """Note disc k where the row cuts it deeper than the discs of its component so far."""
    centres, radii, labels, _, _ = field
    depth = _depth(row, centres, radii, k)
    if depth <= CUT_M:
        return count
    at = slot[labels[k]]
    if at < 0:
        slot[labels[k]] = count
        found[count], depths[count] = k, depth
        return count + 1
    if depth > depths[at]:
        found[at], depths[at] = k, depth
    return count


@kernel
def _deepest_cuts(
    row: Floats, field: Field, flags: Mask, slot: Ints, found: Ints, depths: Floats
) -> int:
    """Per component that a row of the path cuts its deepest unflagged disc, in `found`; how many.

    `slot` has a place for every component, -1 before and after.
    """
    _, radii, labels, _, squares = field
    box, first, items = squares
    columns, widest = int(box[_COLUMN_COUNT]), box[_WIDEST]
    around = _box_of(row, radii, widest)
    bottom, top = _strip(around[0], around[1], box[0], box[2], box[_ROW_COUNT])
    left, right = _strip(around[2], around[3], box[1], box[2], box[_COLUMN_COUNT])
    count = 0
    for r in range(bottom, top + 1):
        if row[ROW_DISC] < 0.0:
            left, right = _columns_of(box, r, widest, row[0], row[1], row[2], row[3])
        for j in range(first[r * columns + left], first[r * columns + right + 1]):
            if flags[items[j]] == 0:
                count = _note_cut(row, field, items[j], slot, found, depths, count)
    for at in range(count):
        slot[labels[found[at]]] = -1
    return count


@kernel
def _add_chain(w: int, field: Field, active: Ints, flags: Mask, count: int) -> int:
    """Activate the chain of disc w's component within CHAIN_M of it."""
    centres, _, labels, chain, squares = field
    for k in points_near(centres, squares, centres[w, 0], centres[w, 1], CHAIN_M):
        if chain[k] == 1 and labels[k] == labels[w]:
            count = _activate(active, flags, count, k)
    return count


@kernel
def _inside_which(field: Field, n: float, e: float) -> int:
    """The first disc that holds (n, e), -1: none."""
    centres, radii, _, _, squares = field
    which = -1
    for k in points_near(centres, squares, n, e, squares[0][_WIDEST]):
        inside = math.hypot(centres[k, 0] - n, centres[k, 1] - e) < radii[k] - TOUCH_M
        if inside and (which < 0 or k < which):
            which = k
    return which


@kernel
def _buried(ends: Floats, field: Field, active: Ints) -> int:
    """FOUND, or which end lies in a disc: that is then the first active one."""
    for end in range(2):
        active[0] = _inside_which(field, ends[end, 0], ends[end, 1])
        if active[0] >= 0:
            return START_INSIDE if end == 0 else GOAL_INSIDE
    return FOUND


@kernel
def _window(ends: Floats, field: Field, active: Ints) -> tuple[Floats, Ints]:
    """A grid over start, goal and the active discs, with a free rim: (box, shape)."""
    centres, radii = field[0], field[1]
    low_n, high_n = min(ends[0, 0], ends[1, 0]), max(ends[0, 0], ends[1, 0])
    low_e, high_e = min(ends[0, 1], ends[1, 1]), max(ends[0, 1], ends[1, 1])
    least = np.inf
    for k in active:
        r = radii[k]
        least = min(least, r)
        low_n, high_n = min(low_n, centres[k, 0] - r), max(high_n, centres[k, 0] + r)
        low_e, high_e = min(low_e, centres[k, 1] - r), max(high_e, centres[k, 1] + r)
    cell = max(0.25 * least, max(high_n - low_n, high_e - low_e) / 160.0)
    box = np.array([low_n - 2.0 * cell, low_e - 2.0 * cell, cell])
    shape = np.empty(2, dtype=np.int64)
    shape[0] = int((high_n - box[0]) / cell) + 3
    shape[1] = int((high_e - box[1]) / cell) + 3
    return box, shape


@kernel
def _covered(field: Field, box: Floats, shape: Ints) -> tuple[Mask, Ints]:
    """(1 where a cell lies wholly inside one disc, numbers of the discs that reach the grid)."""
    centres, radii, _, _, squares = field
    widest, cell = squares[0][_WIDEST], box[2]
    covered = np.zeros((shape[0], shape[1]), dtype=np.uint8)
    middle_n, middle_e = box[0] + 0.5 * shape[0] * cell, box[1] + 0.5 * shape[1] * cell
    within = 0.5 * math.hypot(shape[0] * cell, shape[1] * cell) + widest
    near = points_near(centres, squares, middle_n, middle_e, within)
    for k in near:
        inner = radii[k] - 0.7072 * cell
        n, e = centres[k, 0] - box[0], centres[k, 1] - box[1]
        if inner <= 0.0:
            continue
        bottom, top = _strip(n - inner, n + inner, 0.0, cell, float(shape[0]))
        for r in range(bottom, top + 1):
            dn = (r + 0.5) * cell - n
            half2 = inner * inner - dn * dn
            if half2 <= 0.0:
                continue
            # Columns whose centres are nearer than `inner`: no root per cell.
            half = math.sqrt(half2)
            left, right = _strip(
                e - half - 0.5 * cell, e + half - 0.5 * cell, 0.0, cell, float(shape[1])
            )
            for c in range(left, right + 1):
                de = (c + 0.5) * cell - e
                if de * de < half2:
                    covered[r, c] = 1
    return covered, near


@kernel
def _spread(covered: Mask, row: int, column: int) -> Mask:
    """2 where the uncovered cells are joined (8 neighbours) to the given one; 1: covered."""
    rows, columns = covered.shape
    stack = np.empty(rows * columns, dtype=np.int64)
    stack[0] = row * columns + column
    covered[row, column] = 2
    size = 1
    while size > 0:
        size -= 1
        r0, c0 = stack[size] // columns, stack[size] % columns
        for r in range(max(0, r0 - 1), min(rows, r0 + 2)):
            for c in range(max(0, c0 - 1), min(columns, c0 + 2)):
                if covered[r, c] == 0:
                    covered[r, c] = 2
                    stack[size] = r * columns + c
                    size += 1
    return covered


@kernel
def _meets_free(around: Mask, box: Floats, n: float, e: float, radius: float) -> bool:
    """True when a cell that the free space around start may fill lies within `radius` of (n, e)."""
    cell = box[2]
    reach = radius + 0.7072 * cell
    bottom, top = _strip(n - reach, n + reach, box[0], cell, float(around.shape[0]))
    left, right = _strip(e - reach, e + reach, box[1], cell, float(around.shape[1]))
    for r in range(bottom, top + 1):
        for c in range(left, right + 1):
            if around[r, c] == 2:
                dn, de = box[0] + (r + 0.5) * cell - n, box[1] + (c + 0.5) * cell - e
                if dn * dn + de * de <= reach * reach:
                    return True
    return False


@kernel
def _set_aside(ends: Floats, field: Field, active: Ints, flags: Mask) -> tuple[int, Ints]:
    """Flag with 2 the discs that the free space around start does not meet; (active, closing).

    Its closure holds every path; a disc that is no part of its border is met by none. The space is
    taken too large (only cells wholly inside one disc are left out), so none is set aside in error.
    Where even that does not reach the goal, it is proven that there is no way: `closing` are the
    discs of the border, else it is empty. Those set aside leave `active`, all others are unflagged.
    """
    centres, radii = field[0], field[1]
    box, shape = _window(ends, field, active)
    around, near = _covered(field, box, shape)
    # Discs that are not active may reach the rim; behind it a way may lead round them all.
    around[0, :] = around[-1, :] = 0
    around[:, 0] = around[:, -1] = 0
    cell = box[2]
    _spread(around, int((ends[0, 0] - box[0]) / cell), int((ends[0, 1] - box[1]) / cell))
    parted = around[int((ends[1, 0] - box[0]) / cell), int((ends[1, 1] - box[1]) / cell)] != 2
    flags[:] = 0
    closing = np.empty(near.shape[0], dtype=np.int64)
    count = 0
    for k in near:
        r = radii[k]
        n, e = centres[k, 0] - box[0], centres[k, 1] - box[1]
        inside = r < n < shape[0] * cell - r and r < e < shape[1] * cell - r
        if inside and not _meets_free(around, box, centres[k, 0], centres[k, 1], r):
            flags[k] = 2
        elif parted:
            closing[count] = k
            count += 1
    kept = 0
    for k in active:
        if flags[k] == 0:
            flags[k] = 1
            active[kept] = k
            kept += 1
    return kept, closing[:count]


@kernel
def _take_back(flags: Mask) -> bool:
    """Unflag what was set aside; False when there was nothing."""
    some = False
    for k in range(flags.shape[0]):
        if flags[k] == 2:
            flags[k] = 0
            some = True
    return some


@kernel
def _circles_of(ends: Floats, field: Field, active: Ints) -> Floats:
    """Start, goal and the active discs as rows (north, east, radius)."""
    circles = np.zeros((active.shape[0] + 2, 3))
    circles[0:2, 0:2] = ends
    for a in range(active.shape[0]):
        circles[a + 2, 0:2] = field[0][active[a]]
        circles[a + 2, 2] = field[1][active[a]]
    return circles


@kernel
def _add_cut_discs(
    rows: Floats,
    field: Field,
    active: Ints,
    flags: Mask,
    count: int,
    scratch: tuple[Ints, Ints, Floats],
) -> int:
    """Activate, per row and component that it cuts, the deepest disc and the chain around it."""
    slot, found, depths = scratch
    for c in range(rows.shape[0]):
        cuts = _deepest_cuts(rows[c], field, flags, slot, found, depths)
        for at in range(cuts):
            count = _activate(active, flags, count, found[at])
        for at in range(cuts):
            count = _add_chain(found[at], field, active, flags, count)
    return count


@kernel
def lazy_route(
    ends: Floats,
    field: Field,
    planes: Floats,
    active_max: int,
    seeds: Ints,
    limit_m: float,
) -> tuple[int, Floats, Ints, int]:
    """Exact shortest path among discs by constraint generation: (status, rows, active, rounds).

    ends: rows start and goal. The answer over the active discs is the optimum of a relaxation:
    once it cuts no disc it is the optimum. What it cuts is added, with the part of its component's
    chain (sparse_chain, may be all zeros) that lies around it. `seeds` are active from the
    beginning: those that decided a similar question save rounds and change no answer.
    CLOSED: not even the active discs leave a way, they are the certificate. BEATEN: no path is
    shorter than `limit_m`, which a relaxation has shown.
    """
    n = field[0].shape[0]
    none = np.empty((0, 6))
    active = np.empty(max(active_max, 1), dtype=np.int64)
    status = _buried(ends, field, active)
    if status != FOUND:
        return status, none, active[:1], 0
    flags = np.zeros(n, dtype=np.uint8)
    scratch = (np.full(n, -1, dtype=np.int64), np.empty(n, dtype=np.int64), np.empty(n))
    rows = np.array([[ends[0, 0], ends[0, 1], ends[1, 0], ends[1, 1], -1.0, 0.0]])
    count = rounds = side = solved = 0
    for k in seeds:
        count = _activate(active, flags, count, k)
    asked = False
    table, state, came = _wider(0, rows, flags, 0)
    while True:
        if solved > 0 or count == 0:
            count = _add_cut_discs(rows, field, active, flags, count, scratch)
            if count == solved and not (asked and _take_back(flags)):
                return FOUND, rows, active[:count], rounds
            if count == solved:
                continue
        if count > FLOOD_FROM and not asked:
            asked = True
            count, closing = _set_aside(ends, field, active[:count], flags)
            if closing.shape[0] > 0:
                return CLOSED, none, closing, rounds
            side = 0
            table, state, came = _wider(0, rows, flags, 0)
        if count > active_max:
            return TOO_MANY, none, active, rounds
        solved = count
        rounds += 1
        circles = _circles_of(ends, field, active[:count])
        if 2 * circles.shape[0] > side:
            table, state, came = _wider(side, table, state, 3 * circles.shape[0])
            side = 3 * circles.shape[0]
        status, path = solve_tangents(circles, planes, rounds, side, table, state, came, limit_m)
        if status != FOUND:
            return status, none, active[:count], rounds
        rows = _rows(path, side, table, circles, active)


@kernel
def route_from_scratch(
    ends: Floats, centres: Floats, radii: Floats, planes: Floats, active_max: int
) -> tuple[int, Floats, Ints, int]:
    """`lazy_route` over discs that nothing is known about; only what is in the way costs time.

    Components are not looked for when the straight way is free.
    """
    n = centres.shape[0]
    labels = np.zeros(n, dtype=np.int64)
    chain = np.zeros(n, dtype=np.uint8)
    row = np.array([ends[0, 0], ends[0, 1], ends[1, 0], ends[1, 1], -1.0, 0.0])
    widest = 0.0
    barred = False
    for k in range(n):
        widest = max(widest, radii[k])
        barred = barred or _depth(row, centres, radii, k) > CUT_M
    if barred:
        labels, chain = join_overlapping(centres, radii)
    field = (centres, radii, labels, chain, into_squares(centres, widest))
    none = np.empty(0, dtype=np.int64)
    return lazy_route(ends, field, planes, active_max, none, np.inf)


# ---------------------------------------------------------------- out of the keep-out


@kernel
def _never_nearer(
    points: Floats, keep_out: float, n: float, e: float, to_n: float, to_e: float
) -> bool:
    """True when the straight way from (n, e) comes no nearer to any point that is too near now."""
    for k in range(points.shape[0]):
        now = math.hypot(points[k, 0] - n, points[k, 1] - e)
        floor = min(now, keep_out) - CUT_M
        if floor > 0.0:
            d2 = segment_distance2(points[k, 0], points[k, 1], n, e, to_n, to_e)
            if d2 < floor * floor:
                return False
    return True


@kernel
def _is_clear(points: Floats, keep_out: float, n: float, e: float) -> bool:
    """True when every one of `points` is at least `keep_out` from (n, e)."""
    for k in range(points.shape[0]):
        dn, de = points[k, 0] - n, points[k, 1] - e
        if dn * dn + de * de < keep_out * keep_out:
            return False
    return True


@kernel
def _better_exit(
    best: Floats,
    near: Floats,
    keep_out: float,
    n: float,
    e: float,
    cn: float,
    ce: float,
    careful: int,
) -> None:
    """Take (cn, ce) into `best` = (n, e, distance) when it is free and nearer."""
    d = math.hypot(cn - n, ce - e)
    if d >= best[2] or not _is_clear(near, keep_out, cn, ce):
        return
    if careful == 1 and not _never_nearer(near, keep_out, n, e, cn, ce):
        return
    best[0], best[1], best[2] = cn, ce, d


@kernel
def _try_crossings(
    best: Floats, near: Floats, away: Floats, keep_out: float, n: float, e: float, careful: int
) -> None:
    """Take the nearest place where two keep-out circles meet into `best`.

    `away`: distances of `near` from (n, e), ascending. Only circles that pass through the disc of
    radius best[2] around (n, e) meet inside it.
    """
    radius = keep_out + CUT_M
    for i in range(near.shape[0]):
        if away[i] - radius >= best[2]:
            return
        if radius - away[i] >= best[2]:
            continue
        for k in range(i):
            dn, de = near[k, 0] - near[i, 0], near[k, 1] - near[i, 1]
            half2 = 0.25 * (dn * dn + de * de)
            if radius - away[k] >= best[2] or half2 < 1e-18 or half2 > radius * radius:
                continue
            h = math.sqrt((radius * radius - half2) / (4.0 * half2))
            mn, me = near[i, 0] + 0.5 * dn, near[i, 1] + 0.5 * de
            _better_exit(best, near, keep_out, n, e, mn - h * de, me + h * dn, careful)
            _better_exit(best, near, keep_out, n, e, mn + h * de, me - h * dn, careful)


@kernel
def nearest_exit(
    points: Floats,
    squares: Squares,
    keep_out: float,
    n: float,
    e: float,
    within: float,
    careful: int,
) -> tuple[bool, float, float]:
    """The nearest place within `within` of (n, e) that is `keep_out` from all points, exactly.

    It lies on one circle straight away from its centre, or where two circles meet. `careful` = 1:
    the straight way there approaches no point that is nearer than the keep-out.
    """
    radius = keep_out + CUT_M
    near = points[points_near(points, squares, n, e, radius + within)]
    away = np.empty(near.shape[0])
    for k in range(near.shape[0]):
        away[k] = math.hypot(near[k, 0] - n, near[k, 1] - e)
    # The nearest first: they bar most of the places that are tried.
    order = np.argsort(away, kind="mergesort")
    near, away = near[order], away[order]
    best = np.array([n, e, within])
    for i in range(near.shape[0]):
        if away[i] > 1e-9:
            out = radius / away[i]
            cn, ce = near[i, 0] + (n - near[i, 0]) * out, near[i, 1] + (e - near[i, 1]) * out
            _better_exit(best, near, keep_out, n, e, cn, ce, careful)
    _try_crossings(best, near, away, keep_out, n, e, careful)
    return best[2] < within, best[0], best[1]


# ---------------------------------------------------------------- geodesic on the local grid


@kernel
def _inside_polygon(polygon: Floats, n: float, e: float) -> bool:
    inside = False
    count = polygon.shape[0]
    for i in range(count):
        n0, e0 = polygon[i - 1, 0], polygon[i - 1, 1]
        n1, e1 = polygon[i, 0], polygon[i, 1]
        if (e0 > e) != (e1 > e) and n < (n1 - n0) * (e - e0) / (e1 - e0) + n0:
            inside = not inside
    return inside


@kernel
def _near_a_side(sides: Floats, within: float, n: float, e: float) -> bool:
    for i in range(sides.shape[0]):
        an, ae, bn, be = sides[i - 1, 0], sides[i - 1, 1], sides[i, 0], sides[i, 1]
        if segment_distance2(n, e, an, ae, bn, be) < within * within:
            return True
    return False


@kernel
def free_cells(
    points: Floats, keep_out: float, polygon: Floats, sides: Floats, box: Floats, shape: Ints
) -> Mask:
    """1 where a cell's centre is inside the polygon and `keep_out` from every point.

    box: (north, east) of the corner of cell (0, 0) and the cell's side; shape: rows, columns.
    From `sides` (of a polygon that is not convex) centres keep 0.71 cells, so that no step
    between neighbours crosses one.
    """
    rows, columns = shape[0], shape[1]
    free = np.zeros((rows, columns), dtype=np.uint8)
    north, east, cell = box[0], box[1], box[2]
    for r in range(rows):
        for c in range(columns):
            n, e = north + (r + 0.5) * cell, east + (c + 0.5) * cell
            if _inside_polygon(polygon, n, e) and not _near_a_side(sides, 0.71 * cell, n, e):
                free[r, c] = 1
    limit = keep_out * keep_out
    for k in range(points.shape[0]):
        pn, pe = points[k, 0] - north, points[k, 1] - east
        for r in range(
            max(0, int((pn - keep_out) / cell)), min(rows, int((pn + keep_out) / cell) + 1)
        ):
            for c in range(
                max(0, int((pe - keep_out) / cell)), min(columns, int((pe + keep_out) / cell) + 1)
            ):
                dn, de = (r + 0.5) * cell - pn, (c + 0.5) * cell - pe
                if dn * dn + de * de < limit:
                    free[r, c] = 0
    return free


@kernel
def _leaves(polygon: Floats, an: float, ae: float, bn: float, be: float) -> bool:
    """True when the segment crosses a side of the polygon."""
    side = np.empty(4)
    for i in range(polygon.shape[0]):
        side[0:2] = polygon[i - 1]
        side[2:4] = polygon[i]
        if _crosses(side, an, ae, bn, be):
            return True
    return False


@kernel
def in_sight(
    points: Floats,
    squares: Squares,
    keep_out: float,
    polygon: Floats,
    an: float,
    ae: float,
    bn: float,
    be: float,
) -> bool:
    """True when the straight way a-b is free, checked against the points and the polygon's sides.

    An empty polygon is not checked (a convex one needs no check between two of its points).
    """
    if polygon.shape[0] > 0 and _leaves(polygon, an, ae, bn, be):
        return False
    return segment_is_free(points, squares, keep_out, an, ae, bn, be)


@kernel
def _near_cells(
    points: Floats,
    squares: Squares,
    keep_out: float,
    sides: Floats,
    free: Mask,
    box: Floats,
    n: float,
    e: float,
) -> Ints:
    """The free cells around (n, e) whose centres can be reached straight."""
    rows, columns = free.shape
    cell = box[2]
    row, column = int((n - box[0]) / cell), int((e - box[1]) / cell)
    found = np.empty(81, dtype=np.int64)
    count = 0
    for r in range(max(0, row - 4), min(rows, row + 5)):
        for c in range(max(0, column - 4), min(columns, column + 5)):
            cn, ce = box[0] + (r + 0.5) * cell, box[1] + (c + 0.5) * cell
            if free[r, c] == 1 and in_sight(points, squares, keep_out, sides, n, e, cn, ce):
                found[count] = r * columns + c
                count += 1
    return found[:count]


@kernel
def _best_neighbour(free: Mask, closed: Mask, place: Floats, cost: Floats, u: int) -> int:
    """The closed neighbour of cell u over which it is reached at the least cost."""
    rows, columns = free.shape
    row, column = u // columns, u % columns
    best, who = np.inf, -1
    for r in range(max(0, row - 1), min(rows, row + 2)):
        for c in range(max(0, column - 1), min(columns, column + 2)):
            v = r * columns + c
            if v != u and closed[v] == 1:
                way = cost[v] + math.hypot(place[v, 0] - place[u, 0], place[v, 1] - place[u, 1])
                if way < best:
                    best, who = way, v
    return who


@kernel
def _settle(
    points: Floats,
    squares: Squares,
    keep_out: float,
    sides: Floats,
    free: Mask,
    closed: Mask,
    place: Floats,
    cost: Floats,
    parent: Ints,
    u: int,
) -> None:
    """Lazy Theta*: cell u was reached on credit; where its parent does not see it, re-parent."""
    p = parent[u]
    pn, pe = place[p, 0], place[p, 1]
    if in_sight(points, squares, keep_out, sides, pn, pe, place[u, 0], place[u, 1]):
        return
    v = _best_neighbour(free, closed, place, cost, u)
    if v < 0:
        # Only the start sees it, as one of its own near cells.
        v = free.shape[0] * free.shape[1]
    parent[u] = v
    cost[u] = cost[v] + math.hypot(place[v, 0] - place[u, 0], place[v, 1] - place[u, 1])


@kernel
def _trace(place: Floats, parent: Ints, last: int) -> Floats:
    count = 1
    at = last
    while parent[at] >= 0:
        at = parent[at]
        count += 1
    path = np.empty((count, 2))
    at = last
    while count > 0:
        count -= 1
        path[count] = place[at]
        at = parent[at]
    return path


@kernel
def _reach_cell(
    v: int, p: int, place: Floats, cost: Floats, parent: Ints, queue: tuple[Floats, Ints, int]
) -> tuple[Floats, Ints, int]:
    """Queue cell v with parent p when that is shorter than what it has (lazy: sight unchecked)."""
    keys, items, size = queue
    way = cost[p] + math.hypot(place[p, 0] - place[v, 0], place[p, 1] - place[v, 1])
    if way < cost[v] - 1e-9:
        cost[v] = way
        parent[v] = p
        goal = place.shape[0] - 1
        bound = way + math.hypot(place[v, 0] - place[goal, 0], place[v, 1] - place[goal, 1])
        return _push(keys, items, size, bound, v)
    return keys, items, size


@kernel
def grid_geodesic(
    points: Floats,
    squares: Squares,
    keep_out: float,
    sides: Floats,
    free: Mask,
    box: Floats,
    ends: Floats,
) -> tuple[bool, Floats, Mask]:
    """Any-angle shortest path over the free cells (Lazy Theta*): (found, path, reached cells).

    Cells must be free at sqrt(keep_out^2 + cell^2 / 2), so that steps between neighbours keep the
    keep-out exactly; longer segments are checked against `points` themselves. Start and goal
    (`ends`) are joined to the free cells around them that they see.
    """
    rows, columns = free.shape
    total = rows * columns
    start, goal = total, total + 1
    place = np.empty((total + 2, 2))
    for r in range(rows):
        for c in range(columns):
            place[r * columns + c, 0] = box[0] + (r + 0.5) * box[2]
            place[r * columns + c, 1] = box[1] + (c + 0.5) * box[2]
    place[start] = ends[0]
    place[goal] = ends[1]
    cost = np.full(total + 2, np.inf)
    parent = np.full(total + 2, -1, dtype=np.int64)
    closed = np.zeros(total + 2, dtype=np.uint8)
    at_goal = np.zeros(total, dtype=np.uint8)
    for u in _near_cells(points, squares, keep_out, sides, free, box, ends[1, 0], ends[1, 1]):
        at_goal[u] = 1
    cost[start] = 0.0
    queue = (np.empty(1024), np.empty(1024, dtype=np.int64), 0)
    for u in _near_cells(points, squares, keep_out, sides, free, box, ends[0, 0], ends[0, 1]):
        queue = _reach_cell(u, start, place, cost, parent, queue)
    while queue[2] > 0:
        keys, items, size = queue
        u = items[0]
        _sift_down(keys, items, size - 1)
        queue = (keys, items, size - 1)
        if u == goal:
            return True, _trace(place, parent, goal), closed[:total].reshape(rows, columns)
        if closed[u] == 1:
            continue
        _settle(points, squares, keep_out, sides, free, closed, place, cost, parent, u)
        closed[u] = 1
        p = parent[u]
        if at_goal[u] == 1:
            sees = in_sight(
                points, squares, keep_out, sides, place[p, 0], place[p, 1], ends[1, 0], ends[1, 1]
            )
            queue = _reach_cell(goal, p if sees else u, place, cost, parent, queue)
        row, column = u // columns, u % columns
        for r in range(max(0, row - 1), min(rows, row + 2)):
            for c in range(max(0, column - 1), min(columns, column + 2)):
                if free[r, c] == 1 and closed[r * columns + c] == 0:
                    queue = _reach_cell(r * columns + c, p, place, cost, parent, queue)
    return False, np.empty((0, 2)), closed[:total].reshape(rows, columns)


@kernel
def pull_string(
    path: Floats, points: Floats, squares: Squares, keep_out: float, sides: Floats
) -> Floats:
    """The path without the corners that it does not need: from each to the farthest in sight."""
    kept = np.empty_like(path)
    kept[0] = path[0]
    count = 1
    at = 0
    last = path.shape[0] - 1
    while at < last:
        far = last
        while far > at + 1 and not in_sight(
            points, squares, keep_out, sides, path[at, 0], path[at, 1], path[far, 0], path[far, 1]
        ):
            far -= 1
        kept[count] = path[far]
        count += 1
        at = far
    return kept[:count]


@kernel
def flood(free: Mask, box: Floats, n: float, e: float) -> Mask:
    """The free cells joined (4 neighbours) to the free cell nearest to (n, e)."""
    rows, columns = free.shape
    reached = np.zeros((rows, columns), dtype=np.uint8)
    stack = np.empty(rows * columns + 1, dtype=np.int64)
    size = 0
    best = np.inf
    for r in range(rows):
        for c in range(columns):
            dn, de = box[0] + (r + 0.5) * box[2] - n, box[1] + (c + 0.5) * box[2] - e
            if free[r, c] == 1 and dn * dn + de * de < best:
                best = dn * dn + de * de
                stack[0] = r * columns + c
                size = 1
    if size == 1:
        reached[stack[0] // columns, stack[0] % columns] = 1
    while size > 0:
        size -= 1
        row, column = stack[size] // columns, stack[size] % columns
        for step in range(4):
            r = row + (1 if step == 0 else -1 if step == 1 else 0)
            c = column + (1 if step == 2 else -1 if step == 3 else 0)
            inside = 0 <= r < rows and 0 <= c < columns
            if inside and free[r, c] == 1 and reached[r, c] == 0:
                reached[r, c] = 1
                stack[size] = r * columns + c
                size += 1
    return reached


@kernel
def bordering(points: Floats, region: Mask, box: Floats, within: float) -> Mask:
    """1 for every point that has a cell of the region within `within` of it."""
    rows, columns = region.shape
    cell = box[2]
    touching = np.zeros(points.shape[0], dtype=np.uint8)
    for k in range(points.shape[0]):
        pn, pe = points[k, 0] - box[0], points[k, 1] - box[1]
        for r in range(max(0, int((pn - within) / cell)), min(rows, int((pn + within) / cell) + 1)):
            for c in range(
                max(0, int((pe - within) / cell)), min(columns, int((pe + within) / cell) + 1)
            ):
                dn, de = (r + 0.5) * cell - pn, (c + 0.5) * cell - pe
                if region[r, c] == 1 and dn * dn + de * de <= within * within:
                    touching[k] = 1
    return touching


# ---------------------------------------------------------------- fly-by conic


@kernel
def eccentricity(anomaly: float, ratio: float) -> float:
    """e of the conic with periapsis ratio = r_p / r of a point at the true anomaly given."""
    return (1.0 - ratio) / (ratio - math.cos(anomaly))


@kernel
def fly_by_anomaly(ratio_d: float, ratio_g: float, sweep: float) -> float:
    """True anomaly of D on the conic whose points D and G are `sweep` apart; nan: there is none.

    Findings 3.3: E(alpha, D) falls from +inf, E(sweep - alpha, G) rises to +inf, so bisection
    finds the one root; it exists when sweep > acos(ratio_d) + acos(ratio_g).
    """
    low = max(math.acos(ratio_d), sweep - math.pi)
    high = min(sweep - math.acos(ratio_g), math.pi)
    if not low < high:
        return np.nan
    for _ in range(64):
        middle = 0.5 * (low + high)
        d, g = ratio_d - math.cos(middle), ratio_g - math.cos(sweep - middle)
        if (1.0 - ratio_d) * g > (1.0 - ratio_g) * d:
            low = middle
        else:
            high = middle
    return 0.5 * (low + high)


@kernel
def sample_conic(e: float, periapsis: float, begin: float, end: float, sagitta: float) -> Floats:
    """Rows (true anomaly, radius) from `begin` to `end`, chords within `sagitta` of the curve."""
    rows = np.empty((512, 2))
    p = periapsis * (1.0 + e)
    nu = begin
    count = 0
    while count < 511:
        rows[count, 0] = nu
        rows[count, 1] = p / (1.0 + e * math.cos(nu))
        count += 1
        if nu >= end:
            break
        step = 0.5
        for _ in range(2):
            # The curve bends most at the periapsis: take the worse end of the step.
            worst = 0.5
            top = min(nu + step, end)
            for x in (nu, min(max(0.0, nu), top), top):
                root = math.sqrt(1.0 + e * e + 2.0 * e * math.cos(x))
                open_ = 1.0 + e * math.cos(x)
                bend = (open_ / root) ** 3 / p
                speed = p * root / (open_ * open_)
                worst = min(worst, math.sqrt(8.0 * sagitta / bend) / speed)
            step = worst
        nu = min(end, nu + max(step, 1e-3))
    rows[count, 0] = end
    rows[count, 1] = p / (1.0 + e * math.cos(end))
    return rows[:count] if rows[count - 1, 0] >= end else rows[: count + 1]


# ---------------------------------------------------------------- sides and perimeters


@kernel
def windings(loop: Floats, points: Floats) -> Ints:
    """How often the closed loop (k, 2) goes round each point of (n, 2); growing angles count +1.

    Sunday's count: crossings of a ray from the point, one way less the other.
    """
    turns = np.zeros(points.shape[0], dtype=np.int64)
    for i in range(loop.shape[0]):
        an, ae, bn, be = loop[i - 1, 0], loop[i - 1, 1], loop[i, 0], loop[i, 1]
        if ae == be:
            continue
        for j in range(points.shape[0]):
            n, e = points[j, 0], points[j, 1]
            if (ae <= e) == (be <= e):
                continue
            side = (bn - an) * (e - ae) - (n - an) * (be - ae)
            if ae <= e and side > 0.0:
                turns[j] += 1
            elif be <= e and side < 0.0:
                turns[j] -= 1
    return turns


@kernel
def mark_near(path: Floats, points: Floats, within: float, marks: Mask) -> None:
    """Set `marks` (n,) to 1 where a point of (n, 2) is nearer than `within` to the polyline."""
    for j in range(points.shape[0]):
        for i in range(path.shape[0] - 1):
            if marks[j] != 0:
                break
            away2 = segment_distance2(
                points[j, 0],
                points[j, 1],
                path[i, 0],
                path[i, 1],
                path[i + 1, 0],
                path[i + 1, 1],
            )
            if away2 < within * within:
                marks[j] = 1


@kernel
def _exposed_arc(centre: Floats, radius: float, polygon: Floats, begin: float, end: float) -> float:
    """How much of the arc from bearing `begin` to `end` is inside the polygon, in rad."""
    inside = 0.0
    parts = math.ceil((end - begin) / ARC_STEP_RAD)
    for k in range(parts):
        turn = begin + (k + 0.5) * (end - begin) / parts
        n, e = centre[0] + radius * math.cos(turn), centre[1] + radius * math.sin(turn)
        if _inside_polygon(polygon, n, e):
            inside += (end - begin) / parts
    return inside


@kernel
def exposed_arcs(centres: Floats, radius: float, polygon: Floats) -> Floats:
    """(n,) how much of each circle lies in no other disc and inside the polygon, in rad.

    Discs cover exact intervals of bearings, which are swept from -pi on; one that crosses pi is
    two. The polygon's share is found every ARC_STEP_RAD.
    """
    n = centres.shape[0]
    exposed = np.zeros(n)
    begins, ends = np.empty(2 * n), np.empty(2 * n)
    for i in range(n):
        count = 0
        for j in range(n):
            dn, de = centres[j, 0] - centres[i, 0], centres[j, 1] - centres[i, 1]
            away = math.hypot(dn, de)
            if j == i or away >= 2.0 * radius or away == 0.0:
                continue
            towards, half = math.atan2(de, dn), math.acos(away / (2.0 * radius))
            low, high = towards - half, towards + half
            begins[count], ends[count] = low, high
            if low < -math.pi:
                begins[count] = -math.pi
                count += 1
                begins[count], ends[count] = low + TAU, math.pi
            elif high > math.pi:
                ends[count] = math.pi
                count += 1
                begins[count], ends[count] = -math.pi, high - TAU
            count += 1
        reached = -math.pi
        for k in np.argsort(begins[:count]):
            if begins[k] > reached:
                exposed[i] += _exposed_arc(centres[i], radius, polygon, reached, begins[k])
            reached = max(reached, ends[k])
        if reached < math.pi:
            exposed[i] += _exposed_arc(centres[i], radius, polygon, reached, math.pi)
    return exposed
