"""Compiled loops of the obstacle map; `obstacle_map.py` says what they mean.

All of them are in this one file, because numba's disk cache does not notice a changed callee in
another one. Grid coordinates: x grows north, y grows east, in units of cells; cell (i, j) covers
[i, i + 1) x [j, j + 1). Metres are converted at the entry of each public kernel.

The state is a handful of arrays owned by `ObstacleMap`:

    slot (rows, columns, 2) int32  indices into the list of points, or -1: the cell's SURFACE
                                 point and its EDGE point
    seen (rows, columns) float64 when the cell was last seen free, -inf for never
    points (capacity, 2) float64 running mean of the hits in a cell, x and y
    evidence (capacity,) int32   hits minus misses
    cell_of (capacity,) int64    flat index of the point's slot
    counters (4,) int64          COUNT, APPEARED, CLEARED, NEXT_CONE
    beams (beams, 8) float64     the last ray of each beam, columns B_...
    cones (CONES, 12) float64    the latest readings of wide beams, a ring, columns C_...
    open_bits (CONES,) int64     for each of them which points of its arc may hold what it saw
    params (..,) float64         columns P_...

The list of points is dense: a removed point is replaced by the last one.

Edges are kept apart from the surface, because an edge that shares a mean with the hits beside it
is pulled inward by up to a cell: 2 cm at a wall's end, which is where the vehicle rounds it.
"""

# numba compiles by the types of the arguments; the typed door to these loops is obstacle_map.py.
# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators

import math

import numpy as np
from numba import njit

NOTHING, FREE, HIT = 0, 1, 2

SURFACE, EDGE, LAYERS = 0, 1, 2

COUNT, APPEARED, CLEARED, NEXT_CONE, COUNTERS = 0, 1, 2, 3, 4

P_CELL = 0  # m
P_GAIN = 1
P_CAP = 2
P_OCCUPIED = 3
P_CLEAR = 4  # cells from here on
P_WEIGHT = 5  # (a plain fraction)
P_EDGE_COS = 6  # (cosine of the largest step between two rays)
P_FREE_SHRINK = 7
P_HIT_SHRINK = 8
P_ACCOUNTED = 9
P_MAX_AGE = 10  # s
P_HIT_RADIUS = 11
P_SEEN_RADIUS = 12
P_BODY = 13
P_WHOLE_ARC = 14  # what is left of an arc becomes hits up to this length ...
P_ARC_ENDS = 15  # ... and beyond it this many points at either end do
PARAMS = 16

R_STAMP, R_BEAM, R_KIND, R_NORTH, R_EAST, R_COS, R_SIN, R_LENGTH, R_CENTRE_N, R_CENTRE_E = range(10)
R_HALF, R_FREE = 10, 11
RAY_COLUMNS = 12

B_KIND, B_STAMP, B_X, B_Y, B_COS, B_SIN, B_LENGTH, B_PERIOD = range(8)
BEAM_COLUMNS = 8

C_STAMP, C_BEAM, C_X, C_Y, C_COS, C_SIN = range(6)
C_LENGTH = 6  # where the arc is
C_REACH = 7  # nothing is nearer than this, inside the cone
C_ARC = 8  # half the arc's angle
C_TAN = 9  # tangent of half the angle within which the cone surely sees
C_ROUND = 10  # radius about the arc's middle that holds all of it
C_BEYOND = 11  # something is nearer than this, on the arc; 0 where nothing was
CONE_COLUMNS = 12

CONES = 256
"""How many readings of wide beams are remembered."""
CONE_AGE_S = 2.0
"""And for how long: one turn of the scan and a little more."""
ARC_POINTS = 21
ARC_MARGIN = math.radians(1.5)
"""An arc reaches this much beyond the beam's half angle, and free space stays this far inside."""
CARVE_M = 0.02
CARVE_SHARE = 0.025
"""A cone rules out what is nearer than its range by this much and this share of the range, and its
arc passes through what is as far or farther by no more than that."""
VOTES, ARCS_MIN = 2, 3
"""Where a beam's own readings leave nothing of an arc, the points stay that twice as many arcs pass
through as its cones rule out: a thin thing returns too little to be seen in every reading. Fewer
arcs than three are no vote: readings stray, and two in a row do."""
GRAZE = 1e-6
"""In cells: an arc passes through its own ends, however they are rounded."""
SHORT_ARC_M = 0.13
"""An arc this short is a hit as it is."""
# A gap this many times the beam's own period is a dropped reading.
DROPPED_RATIO = 1.6
# No fan is spread over a longer silence, nor over a longer way of the sensor.
FAN_GAP_MAX_S = 0.3
FAN_STEP_MAX_M = 0.12
# Ranges of neighbouring rays that differ by more than this are an edge, by less a surface.
EDGE_STEP_M = 0.10
# A start inside the keep-out must gain this much clearance per metre: 100 degrees off, or more.
ESCAPE_RATE = 0.17


@njit(cache=True)
def _inside(slot, i, j):
    return 0 <= i < slot.shape[0] and 0 <= j < slot.shape[1]


@njit(cache=True)
def _remove_point(slot, points, evidence, cell_of, counters, s):
    """Take point `s` out of the list; the last point moves into its place."""
    last = counters[COUNT] - 1
    slots = slot.reshape(slot.size)
    slots[cell_of[s]] = -1
    if s != last:
        points[s, 0] = points[last, 0]
        points[s, 1] = points[last, 1]
        evidence[s] = evidence[last]
        cell_of[s] = cell_of[last]
        slots[cell_of[s]] = s
    counters[COUNT] = last


@njit(cache=True)
def _add_hit(slot, points, evidence, cell_of, counters, params, x, y, layer):
    """Evidence for an obstacle at (x, y): a new point, or a better mean of the cell's."""
    i = math.floor(x)
    j = math.floor(y)
    if not _inside(slot, i, j):
        return
    gain = int(params[P_GAIN])
    s = slot[i, j, layer]
    before = 0
    if s < 0:
        s = counters[COUNT]
        counters[COUNT] = s + 1
        slot[i, j, layer] = s
        cell_of[s] = (i * slot.shape[1] + j) * LAYERS + layer
        points[s, 0] = x
        points[s, 1] = y
        evidence[s] = 0
    else:
        before = evidence[s]
        points[s, 0] += params[P_WEIGHT] * (x - points[s, 0])
        points[s, 1] += params[P_WEIGHT] * (y - points[s, 1])
    evidence[s] = min(before + gain, int(params[P_CAP]))
    if before < params[P_OCCUPIED] <= evidence[s]:
        counters[APPEARED] += 1


@njit(cache=True)
def _miss(slot, points, evidence, cell_of, counters, params, s, loss):
    """Evidence against the point `s`: a ray went through it, or a free cone holds it."""
    occupied_from = int(params[P_OCCUPIED])
    before = evidence[s]
    evidence[s] = before - loss
    if before >= occupied_from > evidence[s]:
        counters[CLEARED] += 1
    if evidence[s] <= 0:
        _remove_point(slot, points, evidence, cell_of, counters, s)


@njit(cache=True)
def _clear_along(slot, points, evidence, cell_of, counters, params, x, y, ux, uy, length):
    """Take evidence from every point within P_CLEAR of the ray; each cell is visited once.

    The cells are walked along the ray's steeper axis, with a band across it on each row.
    """
    steep = abs(ux) >= abs(uy)
    main, other, um, uo = (x, y, ux, uy) if steep else (y, x, uy, ux)
    near = params[P_CLEAR]
    band = near / abs(um) + 0.5  # the ray drifts at most half a cell aside within half a row
    end = main + length * um
    for row in range(math.floor(min(main, end) - near), math.floor(max(main, end) + near) + 1):
        mid = other + (row + 0.5 - main) / um * uo
        for column in range(math.floor(mid - band), math.floor(mid + band) + 1):
            i, j = (row, column) if steep else (column, row)
            if not _inside(slot, i, j):
                continue
            for layer in range(LAYERS):
                s = slot[i, j, layer]
                if s < 0:
                    continue
                dx = points[s, 0] - x
                dy = points[s, 1] - y
                a = dx * ux + dy * uy
                if 0.0 <= a <= length and abs(dy * ux - dx * uy) <= near:
                    _miss(slot, points, evidence, cell_of, counters, params, s, 1)


@njit(cache=True)
def _see_fan(seen, x0, y0, c0, s0, x1, y1, c1, s1, radius, stamp):
    """Mark the cells whose centres lie between two rays, at most `radius` from their origin.

    Half a cell beyond each ray counts too, so that neighbouring fans leave no seam.
    """
    x = 0.5 * (x0 + x1)
    y = 0.5 * (y0 + y1)
    mx = c0 + c1
    my = s0 + s1
    steep = abs(mx) >= abs(my)
    if steep:
        main, am, ao, a0, a1, bm, bo, b0, b1 = x, c0, s0, x0, y0, c1, s1, x1, y1
    else:
        main, am, ao, a0, a1, bm, bo, b0, b1 = y, s0, c0, y0, x0, s1, c1, y1, x1
    end_a = a0 + radius * am
    end_b = b0 + radius * bm
    low = min(main, min(end_a, end_b)) - 0.5
    high = max(main, max(end_a, end_b)) + 0.5
    slope_a = ao / am
    slope_b = bo / bm
    for row in range(math.floor(low), math.floor(high) + 1):
        on_a = a1 + (row + 0.5 - a0) * slope_a
        on_b = b1 + (row + 0.5 - b0) * slope_b
        left = math.floor(min(on_a, on_b) - 0.8)
        right = math.floor(max(on_a, on_b) + 0.8)
        for column in range(left, right + 1):
            i, j = (row, column) if steep else (column, row)
            if not _inside(seen, i, j):
                continue
            cx = i + 0.5
            cy = j + 0.5
            if (cx - x) * mx + (cy - y) * my < 0.0:
                continue
            if (cx - x) ** 2 + (cy - y) ** 2 > radius * radius:
                continue
            side0 = (cy - y0) * c0 - (cx - x0) * s0
            side1 = (cy - y1) * c1 - (cx - x1) * s1
            between = side0 * side1 <= 0.0 or abs(side0) <= 0.5 or abs(side1) <= 0.5
            if between and seen[i, j] < stamp:
                seen[i, j] = stamp


@njit(cache=True)
def _see_disc(seen, x, y, radius, stamp):
    """Mark the cells whose centres lie within `radius` of (x, y)."""
    for i in range(math.floor(x - radius), math.floor(x + radius) + 1):
        for j in range(math.floor(y - radius), math.floor(y + radius) + 1):
            if (
                _inside(seen, i, j)
                and (i + 0.5 - x) ** 2 + (j + 0.5 - y) ** 2 <= radius * radius
                and seen[i, j] < stamp
            ):
                seen[i, j] = stamp


@njit(cache=True)
def _follows(beams, b, stamp):
    """Whether a reading of beam `b` is the one right after its last; learns the beam's period.

    The period follows the shorter gaps quickly and the longer ones slowly, so that a dropped
    reading is noticed and a slower sensor is learned.
    """
    gap = stamp - beams[b, B_STAMP]
    period = beams[b, B_PERIOD]
    if period == 0.0:
        beams[b, B_PERIOD] = gap
        return gap <= FAN_GAP_MAX_S
    rate = 0.02
    if gap < period:
        rate = 0.5
    elif gap <= DROPPED_RATIO * period:
        rate = 0.05
    beams[b, B_PERIOD] = period + rate * (min(gap, 3.0 * period) - period)
    return gap <= min(FAN_GAP_MAX_S, DROPPED_RATIO * period)


@njit(cache=True)
def _join(slot, seen, points, evidence, cell_of, counters, beams, params, b, ray):
    """The edge rule and the seen fan between beam `b`'s last ray and `ray` (same columns)."""
    c0, s0, c1, s1 = beams[b, B_COS], beams[b, B_SIN], ray[B_COS], ray[B_SIN]
    if c0 * c1 + s0 * s1 < params[P_EDGE_COS]:
        return
    x0, y0, x1, y1 = beams[b, B_X], beams[b, B_Y], ray[B_X], ray[B_Y]
    if math.hypot(x1 - x0, y1 - y0) > FAN_STEP_MAX_M / params[P_CELL]:
        return
    length0, length1 = beams[b, B_LENGTH], ray[B_LENGTH]
    hit0, hit1 = beams[b, B_KIND] == HIT, ray[B_KIND] == HIT
    end0 = length0 - (params[P_HIT_SHRINK] if hit0 else params[P_FREE_SHRINK])
    end1 = length1 - (params[P_HIT_SHRINK] if hit1 else params[P_FREE_SHRINK])
    radius = min(end0, end1)
    if radius > 0.0:
        _see_fan(seen, x0, y0, c0, s0, x1, y1, c1, s1, radius, ray[B_STAMP])
    if hit0 or hit1:
        scale = min(length0, length1) / math.hypot(c0 + c1, s0 + s1)
        x = 0.5 * (x0 + x1) + (c0 + c1) * scale
        y = 0.5 * (y0 + y1) + (s0 + s1) * scale
        step = EDGE_STEP_M / params[P_CELL]
        surface = hit0 and hit1 and abs(length0 - length1) <= step
        layer = SURFACE if surface else EDGE
        _add_hit(slot, points, evidence, cell_of, counters, params, x, y, layer)


@njit(cache=True)
def _see_cone(
    slot,
    seen,
    points,
    evidence,
    cell_of,
    counters,
    params,
    x,
    y,
    ux,
    uy,
    tan,
    far,
    sure,
    stamp,
):
    """Mark the sector's cells to `far` as seen, and take evidence from its points up to `sure`."""
    cos = 1.0 / math.sqrt(1.0 + tan * tan)
    sin = tan * cos
    low_x = high_x = x
    low_y = high_y = y
    for side in (-1.0, 0.0, 1.0):
        ex = x + far * (ux * cos - side * uy * sin) if side != 0.0 else x + far * ux
        ey = y + far * (uy * cos + side * ux * sin) if side != 0.0 else y + far * uy
        low_x, high_x = min(low_x, ex), max(high_x, ex)
        low_y, high_y = min(low_y, ey), max(high_y, ey)
    gain = int(params[P_GAIN])
    # The arc bulges beyond its ends and its middle by less than a cell.
    for i in range(max(0, math.floor(low_x) - 1), min(slot.shape[0], math.floor(high_x) + 2)):
        for j in range(max(0, math.floor(low_y) - 1), min(slot.shape[1], math.floor(high_y) + 2)):
            for layer in range(LAYERS):
                s = slot[i, j, layer]
                if s < 0:
                    continue
                px = points[s, 0] - x
                py = points[s, 1] - y
                ahead = px * ux + py * uy
                if abs(py * ux - px * uy) <= ahead * tan and px * px + py * py <= sure * sure:
                    _miss(slot, points, evidence, cell_of, counters, params, s, gain)
            cx = i + 0.5 - x
            cy = j + 0.5 - y
            if (
                seen[i, j] < stamp
                and abs(cy * ux - cx * uy) <= (cx * ux + cy * uy) * tan
                and cx * cx + cy * cy <= far * far
            ):
                seen[i, j] = stamp


@njit(cache=True)
def _arc_point(cone, k):
    """Point `k` of a cone's arc, counted from one end to the other."""
    angle = cone[C_ARC] * (2.0 * k / (ARC_POINTS - 1) - 1.0)
    cos = math.cos(angle)
    sin = math.sin(angle)
    return (
        cone[C_X] + cone[C_LENGTH] * (cone[C_COS] * cos - cone[C_SIN] * sin),
        cone[C_Y] + cone[C_LENGTH] * (cone[C_SIN] * cos + cone[C_COS] * sin),
    )


@njit(cache=True)
def _carve(bits, arc, cone):
    """What is left of an arc's points when those that `cone` rules out are taken away."""
    dx = arc[C_X] + arc[C_LENGTH] * arc[C_COS] - cone[C_X]
    dy = arc[C_Y] + arc[C_LENGTH] * arc[C_SIN] - cone[C_Y]
    ux, uy, tan = cone[C_COS], cone[C_SIN], cone[C_TAN]
    near = arc[C_ROUND]
    reach = cone[C_REACH]
    beside = abs(dy * ux - dx * uy) - near * math.sqrt(1.0 + tan * tan)
    if beside > (dx * ux + dy * uy) * tan or dx * dx + dy * dy > (reach + near) ** 2:
        return bits
    for k in range(ARC_POINTS):
        if bits >> k & 1:
            px, py = _arc_point(arc, k)
            px -= cone[C_X]
            py -= cone[C_Y]
            if (
                px * px + py * py < reach * reach
                and abs(py * ux - px * uy) <= (px * ux + py * uy) * tan
            ):
                bits &= ~(1 << k)
    return bits


@njit(cache=True)
def _outvoted(cones, arc):
    """The points of an arc that VOTES times as many arcs pass through as its own beam rules out.

    ARCS_MIN arcs at least, and of these points the ones that the vote is clearest about: its lead
    is half the greatest or more. Points count again that were taken away one by one.
    """
    oldest = arc[C_STAMP] - CONE_AGE_S
    places = np.empty((ARC_POINTS, 2))
    for k in range(ARC_POINTS):
        places[k, 0], places[k, 1] = _arc_point(arc, k)
    arcs = np.zeros(ARC_POINTS, dtype=np.int64)
    ruled_out = np.zeros(ARC_POINTS, dtype=np.int64)
    for c in range(CONES):
        cone = cones[c]
        if cone[C_STAMP] < oldest:
            continue
        mine = cone[C_BEAM] == arc[C_BEAM]
        tan = math.tan(cone[C_ARC])
        near2 = (2.0 * cone[C_LENGTH] - cone[C_BEYOND]) ** 2
        for k in range(ARC_POINTS):
            dx = places[k, 0] - cone[C_X]
            dy = places[k, 1] - cone[C_Y]
            ahead = dx * cone[C_COS] + dy * cone[C_SIN]
            beside = abs(dy * cone[C_COS] - dx * cone[C_SIN])
            far2 = dx * dx + dy * dy
            if far2 < cone[C_REACH] * cone[C_REACH]:
                if mine and beside <= ahead * cone[C_TAN]:
                    ruled_out[k] += 1
            elif near2 <= far2 <= cone[C_BEYOND] * cone[C_BEYOND] and beside <= ahead * tan + GRAZE:
                arcs[k] += 1
    leads = np.where(arcs >= ARCS_MIN, arcs - VOTES * ruled_out, -1)
    least = max(0.0, 0.5 * leads.max())
    bits = 0
    for k in range(ARC_POINTS):
        if leads[k] >= least:
            bits |= 1 << k
    return bits


@njit(cache=True)
def _settle(slot, points, evidence, cell_of, counters, params, cone, bits):
    """Turn what is left of an arc into hits, about one in each cell.

    What is left is a few stretches that no cone fitted into. Of a stretch longer than P_WHOLE_ARC
    only the ends are hits: there is something at either, or the cones had come farther.
    """
    step = 2.0 * cone[C_ARC] / (ARC_POINTS - 1) * cone[C_LENGTH]
    stride = max(1, round(1.0 / step))
    ends = int(params[P_ARC_ENDS])
    begin = 0
    while begin < ARC_POINTS:
        if not bits >> begin & 1:
            begin += 1
            continue
        end = begin
        while end + 1 < ARC_POINTS and bits >> (end + 1) & 1:
            end += 1
        whole = (end - begin) * step <= params[P_WHOLE_ARC]
        for k in range(begin, end + 1):
            due = k == end or (k - begin) % stride == 0
            if due and (whole or k < begin + ends or k > end - ends):
                x, y = _arc_point(cone, k)
                _add_hit(slot, points, evidence, cell_of, counters, params, x, y, SURFACE)
        begin = end + 1


@njit(cache=True)
def _take_cone(
    slot,
    seen,
    points,
    evidence,
    cell_of,
    counters,
    cones,
    open_bits,
    params,
    b,
    ray,
    half,
    free,
):
    """One reading of a wide beam: free space, fewer places for earlier arcs, and its own arc."""
    cell = params[P_CELL]
    x, y, ux, uy = ray[B_X], ray[B_Y], ray[B_COS], ray[B_SIN]
    length, stamp = ray[B_LENGTH], ray[B_STAMP]
    hit = ray[B_KIND] == HIT
    clear = min(length, free)
    tan = math.tan(max(half - ARC_MARGIN, 0.5 * half))
    far = clear - (params[P_HIT_SHRINK] if hit else params[P_FREE_SHRINK])
    if far > 0.0:
        _see_cone(
            slot,
            seen,
            points,
            evidence,
            cell_of,
            counters,
            params,
            x,
            y,
            ux,
            uy,
            tan,
            far,
            clear - params[P_FREE_SHRINK],
            stamp,
        )
    at = counters[NEXT_CONE]
    counters[NEXT_CONE] = (at + 1) % CONES
    new = cones[at]
    if open_bits[at] != 0:
        _settle(slot, points, evidence, cell_of, counters, params, new, open_bits[at])
    new[C_STAMP] = stamp
    new[C_BEAM] = b
    new[C_X] = x
    new[C_Y] = y
    new[C_COS] = ux
    new[C_SIN] = uy
    new[C_LENGTH] = length
    error = CARVE_M / cell + CARVE_SHARE * length
    new[C_REACH] = clear - error
    new[C_BEYOND] = length + error if hit else 0.0
    new[C_ARC] = half + ARC_MARGIN
    new[C_TAN] = tan
    new[C_ROUND] = 2.0 * length * math.sin(0.5 * new[C_ARC])
    bits = (1 << ARC_POINTS) - 1 if hit else 0
    own = bits
    open_bits[at] = 0
    for c in range(CONES):
        if c == at or cones[c, C_STAMP] < stamp - CONE_AGE_S:
            continue
        mine = cones[c, C_BEAM] == b
        if bits != 0:
            bits = _carve(bits, new, cones[c])
        if mine and own != 0:
            own = _carve(own, new, cones[c])
        if open_bits[c] != 0:
            left = _carve(open_bits[c], cones[c], new)
            if left == 0 and mine:
                left = _outvoted(cones, cones[c])
            elif left == 0:
                # Denied altogether by another beam: one of the two is wrong, and it may be that.
                _settle(slot, points, evidence, cell_of, counters, params, cones[c], open_bits[c])
            open_bits[c] = left
    if hit and bits == 0:
        bits = own if own != 0 else _outvoted(cones, new)
    if bits != 0 and 2.0 * new[C_ARC] * length <= SHORT_ARC_M / cell:
        _settle(slot, points, evidence, cell_of, counters, params, new, bits)
        bits = 0
    open_bits[at] = bits


@njit(cache=True)
def _settle_passed(
    slot, points, evidence, cell_of, counters, cones, open_bits, beams, params, stamp
):
    """Settle the arcs that their beam has turned away from, and those that are old."""
    for c in range(CONES):
        if open_bits[c] == 0:
            continue
        cone = cones[c]
        b = int(cone[C_BEAM])
        turned = cone[C_COS] * beams[b, B_COS] + cone[C_SIN] * beams[b, B_SIN]
        if turned < math.cos(2.0 * cone[C_ARC]) or cone[C_STAMP] < stamp - CONE_AGE_S:
            _settle(slot, points, evidence, cell_of, counters, params, cone, open_bits[c])
            open_bits[c] = 0


@njit(cache=True)
def integrate(
    slot,
    seen,
    points,
    evidence,
    cell_of,
    counters,
    beams,
    cones,
    open_bits,
    params,
    rays,
    count,
    north0,
    east0,
):
    """Take the first `count` rows of `rays` into the map, in order; returns how many were new.

    `counters[APPEARED]` and `counters[CLEARED]` are set to what happened.
    """
    counters[APPEARED] = 0
    counters[CLEARED] = 0
    cell = params[P_CELL]
    taken = 0
    wide = False
    ray = np.empty(BEAM_COLUMNS)
    for k in range(count):
        b = int(rays[k, R_BEAM])
        stamp = rays[k, R_STAMP]
        known = beams[b, B_KIND] >= 0.0
        if known and stamp <= beams[b, B_STAMP]:
            continue  # repeated, or overtaken by a newer one: no new knowledge
        taken += 1
        kind = rays[k, R_KIND]
        ray[B_KIND] = kind
        ray[B_STAMP] = stamp
        ray[B_X] = (rays[k, R_NORTH] - north0) / cell
        ray[B_Y] = (rays[k, R_EAST] - east0) / cell
        ray[B_COS] = rays[k, R_COS]
        ray[B_SIN] = rays[k, R_SIN]
        ray[B_LENGTH] = rays[k, R_LENGTH] / cell
        x, y, ux, uy = ray[B_X], ray[B_Y], ray[B_COS], ray[B_SIN]
        length = ray[B_LENGTH]
        half = rays[k, R_HALF]
        if half > 0.0:
            wide = True
            if kind != NOTHING:
                free = rays[k, R_FREE] / cell
                _take_cone(
                    slot,
                    seen,
                    points,
                    evidence,
                    cell_of,
                    counters,
                    cones,
                    open_bits,
                    params,
                    b,
                    ray,
                    half,
                    free,
                )
            beams[b, :B_PERIOD] = ray[:B_PERIOD]
            continue
        if kind != NOTHING:
            reach = length - params[P_FREE_SHRINK]
            if reach > 0.0:
                _clear_along(slot, points, evidence, cell_of, counters, params, x, y, ux, uy, reach)
        if kind == HIT:
            _add_hit(
                slot,
                points,
                evidence,
                cell_of,
                counters,
                params,
                x + ux * length,
                y + uy * length,
                SURFACE,
            )
        follows = known and _follows(beams, b, stamp)
        if follows and kind != NOTHING and beams[b, B_KIND] != NOTHING:
            _join(slot, seen, points, evidence, cell_of, counters, beams, params, b, ray)
        beams[b, :B_PERIOD] = ray[:B_PERIOD]
    if taken > 0:
        last = count - 1
        if wide:
            _settle_passed(
                slot,
                points,
                evidence,
                cell_of,
                counters,
                cones,
                open_bits,
                beams,
                params,
                rays[last, R_STAMP],
            )
        _see_disc(
            seen,
            (rays[last, R_CENTRE_N] - north0) / cell,
            (rays[last, R_CENTRE_E] - east0) / cell,
            params[P_BODY],
            rays[last, R_STAMP],
        )
    return taken


@njit(cache=True)
def see_disc(seen, params, north0, east0, north, east, radius, stamp):
    """Mark the disc (metres) as seen at `stamp`."""
    cell = params[P_CELL]
    _see_disc(seen, (north - north0) / cell, (east - east0) / cell, radius / cell, stamp)


@njit(cache=True)
def _accounted(slot, points, evidence, params, i, j):
    """Whether an occupied point lies within P_ACCOUNTED of the centre of cell (i, j)."""
    near = params[P_ACCOUNTED]
    reach = math.ceil(near + 0.5)
    for ii in range(max(0, i - reach), min(slot.shape[0], i + reach + 1)):
        for jj in range(max(0, j - reach), min(slot.shape[1], j + reach + 1)):
            for layer in range(LAYERS):
                s = slot[ii, jj, layer]
                if s < 0 or evidence[s] < params[P_OCCUPIED]:
                    continue
                if (points[s, 0] - i - 0.5) ** 2 + (points[s, 1] - j - 0.5) ** 2 <= near * near:
                    return True
    return False


@njit(cache=True)
def _known(slot, seen, points, evidence, params, i, j, oldest):
    """Whether cell (i, j) was seen free not before `oldest`, or belongs to a hit."""
    if not _inside(slot, i, j):
        return False
    return seen[i, j] >= oldest or _accounted(slot, points, evidence, params, i, j)


@njit(cache=True)
def _nearest_square(slot, points, evidence, params, x, y, radius):
    """Squared distance to the nearest occupied point within `radius` of (x, y), or inf."""
    best = np.inf
    for i in range(max(0, math.floor(x - radius)), min(slot.shape[0], math.floor(x + radius) + 1)):
        for j in range(
            max(0, math.floor(y - radius)),
            min(slot.shape[1], math.floor(y + radius) + 1),
        ):
            for layer in range(LAYERS):
                s = slot[i, j, layer]
                if s >= 0 and evidence[s] >= params[P_OCCUPIED]:
                    d2 = (points[s, 0] - x) ** 2 + (points[s, 1] - y) ** 2
                    if d2 < best and d2 < radius * radius:
                        best = d2
    return best


@njit(cache=True)
def _hit_contact(a, b, square, radius, start2):
    """How far one may go before a point is too near; inf for never.

    The point lies `a` ahead and `b` aside, `square` its squared distance. Too near at travel s
    is nearer than `radius` and, when the start is too near already (`start2` < radius^2 is the
    squared distance of the nearest point), also nearer than sqrt(start2) + ESCAPE_RATE * s. Both
    are intervals of s, because distance to a point is convex along a line.
    """
    h = radius * radius - b * b
    if h <= 0.0:
        return np.inf
    w = math.sqrt(h)
    begin = a - w
    end = a + w
    if start2 < radius * radius:
        # (a - s)^2 + b^2 = (d0 + k s)^2
        lead = 1.0 - ESCAPE_RATE * ESCAPE_RATE
        half = a + ESCAPE_RATE * math.sqrt(start2)
        under = half * half - lead * (square - start2)
        if under < 0.0:
            return np.inf
        w = math.sqrt(under)
        begin = max(begin, (half - w) / lead)
        end = min(end, (half + w) / lead)
    begin = max(begin, 0.0)
    return begin if end > begin + 1e-9 else np.inf


@njit(cache=True)
def _unseen_contact(a, b, radius):
    """How far one may go before an unseen cell centre is within `radius`; inf for never.

    A cell within `radius` at the start blocks at once, unless it lies clearly behind.
    """
    h = radius * radius - b * b
    if h < 0.0:
        return np.inf
    square = a * a + b * b
    if square <= radius * radius:
        return np.inf if a < -ESCAPE_RATE * math.sqrt(square) else 0.0
    return a - math.sqrt(h) if a > 0.0 else np.inf


@njit(cache=True)
def free_distance(
    slot, seen, points, evidence, params, north0, east0, north, east, cos, sin, limit, now
):
    """`ObstacleMap.free_distance_m` for the direction (cos, sin); metres."""
    cell = params[P_CELL]
    x = (north - north0) / cell
    y = (east - east0) / cell
    hit_radius = params[P_HIT_RADIUS]
    seen_radius = params[P_SEEN_RADIUS]
    oldest = now - params[P_MAX_AGE]
    start2 = _nearest_square(slot, points, evidence, params, x, y, hit_radius)
    best = limit / cell
    reach = max(hit_radius, seen_radius) + 1.0
    end_x = x + best * cos
    end_y = y + best * sin
    low = min(y, end_y) - reach
    high = max(y, end_y) + reach
    for i in range(math.floor(min(x, end_x) - reach), math.floor(max(x, end_x) + reach) + 1):
        dx = i + 0.5 - x
        left = low
        right = high
        if abs(cos) > 1e-3:  # the part of the row that lies in the corridor
            across = y + dx * sin / cos
            half = reach / abs(cos)
            left = max(low, across - half)
            right = min(high, across + half)
        for j in range(math.floor(left), math.floor(right) + 1):
            if _inside(slot, i, j):
                for layer in range(LAYERS):
                    s = slot[i, j, layer]
                    if s < 0 or evidence[s] < params[P_OCCUPIED]:
                        continue
                    px = points[s, 0] - x
                    py = points[s, 1] - y
                    best = min(
                        best,
                        _hit_contact(
                            px * cos + py * sin,
                            py * cos - px * sin,
                            px * px + py * py,
                            hit_radius,
                            start2,
                        ),
                    )
                if seen[i, j] >= oldest:
                    continue
            dy = j + 0.5 - y
            contact = _unseen_contact(dx * cos + dy * sin, dy * cos - dx * sin, seen_radius)
            if contact < best and not _known(slot, seen, points, evidence, params, i, j, oldest):
                best = contact
    return best * cell


@njit(cache=True)
def nearest(points, evidence, counters, params, north0, east0, north, east):
    """(distance_m, index) of the occupied point nearest to a position; (inf, -1) for none."""
    cell = params[P_CELL]
    x = (north - north0) / cell
    y = (east - east0) / cell
    best = np.inf
    index = -1
    for s in range(counters[COUNT]):
        d2 = (points[s, 0] - x) ** 2 + (points[s, 1] - y) ** 2
        if d2 < best and evidence[s] >= params[P_OCCUPIED]:
            best = d2
            index = s
    return math.sqrt(best) * cell, index


@njit(cache=True)
def _on_grid(table, i, j, reach):
    """True when all cells within `reach` of the cell are on the grid."""
    return min(i, j) >= reach and i + reach < table.shape[0] and j + reach < table.shape[1]


@njit(cache=True)
def free_since(seen, i, j, reach, since):
    """True when the square of `reach` cells about a cell was seen free since then, all of it."""
    if not _on_grid(seen, i, j, reach):
        return False
    for a in range(i - reach, i + reach + 1):
        for b in range(j - reach, j + reach + 1):
            if not seen[a, b] >= since:
                return False
    return True


@njit(cache=True)
def hit_cells(slot, i, j, reach, out):
    """Lists the cells with evidence in the square of `reach` cells about a cell; their number.

    None where the square is not all on the grid; no more than `out` has rows.
    """
    count = 0
    if not _on_grid(slot, i, j, reach):
        return count
    for a in range(i - reach, i + reach + 1):
        for b in range(j - reach, j + reach + 1):
            for layer in range(LAYERS):
                if slot[a, b, layer] >= 0 and count < len(out):
                    out[count, 0] = a
                    out[count, 1] = b
                    count += 1
                    break
    return count


@njit(cache=True)
def occupied(points, evidence, counters, params, north0, east0):
    """(n, 2) north and east of the occupied points."""
    total = 0
    for s in range(counters[COUNT]):
        if evidence[s] >= params[P_OCCUPIED]:
            total += 1
    out = np.empty((total, 2))
    k = 0
    for s in range(counters[COUNT]):
        if evidence[s] >= params[P_OCCUPIED]:
            out[k, 0] = points[s, 0] * params[P_CELL] + north0
            out[k, 1] = points[s, 1] * params[P_CELL] + east0
            k += 1
    return out


@njit(cache=True)
def forget(
    slot,
    seen,
    points,
    evidence,
    cell_of,
    counters,
    params,
    north0,
    east0,
    north,
    east,
    radius,
    keep,
):
    """Remove points within `radius` of the position, and sights between `keep` and `radius`."""
    cell = params[P_CELL]
    x = (north - north0) / cell
    y = (east - east0) / cell
    counters[CLEARED] = 0
    r2 = (radius / cell) ** 2
    k2 = (keep / cell) ** 2
    for s in range(counters[COUNT] - 1, -1, -1):
        if (points[s, 0] - x) ** 2 + (points[s, 1] - y) ** 2 <= r2:
            if evidence[s] >= params[P_OCCUPIED]:
                counters[CLEARED] += 1
            _remove_point(slot, points, evidence, cell_of, counters, s)
    rows, columns = seen.shape
    span = min(radius / cell, 1.0e6)
    for i in range(max(0, int(x - span)), min(rows, int(x + span) + 1)):
        for j in range(max(0, int(y - span)), min(columns, int(y + span) + 1)):
            d2 = (i + 0.5 - x) ** 2 + (j + 0.5 - y) ** 2
            if k2 < d2 <= r2:
                seen[i, j] = -np.inf


@njit(cache=True)
def thin(points, spacing):
    """Indices of a greedy subset: in order, each point farther than `spacing` from all kept."""
    kept = np.empty(points.shape[0], dtype=np.int64)
    count = 0
    for s in range(points.shape[0]):
        free = True
        for k in range(count):
            q = kept[k]
            if (points[s, 0] - points[q, 0]) ** 2 + (
                points[s, 1] - points[q, 1]
            ) ** 2 <= spacing * spacing:
                free = False
                break
        if free:
            kept[count] = s
            count += 1
    return kept[:count]


def warm_up() -> None:
    """Compile (or load from numba's disk cache) every kernel with the types used in flight.

    Nothing is compiled in the air after this; a test holds that no other types are ever used.
    """
    slot = np.full((4, 4, LAYERS), -1, dtype=np.int32)
    seen = np.full((4, 4), -np.inf)
    points = np.zeros((8, 2))
    evidence = np.zeros(8, dtype=np.int32)
    cell_of = np.zeros(8, dtype=np.int64)
    counters = np.zeros(COUNTERS, dtype=np.int64)
    beams = np.zeros((1, BEAM_COLUMNS))
    rays = np.zeros((1, RAY_COLUMNS))
    params = np.ones(PARAMS)
    listed = (slot, seen, points, evidence, cell_of, counters)
    cones = np.full((CONES, CONE_COLUMNS), -np.inf)
    open_bits = np.zeros(CONES, dtype=np.int64)
    integrate(*listed, beams, cones, open_bits, params, rays, 1, 0.0, 0.0)
    see_disc(seen, params, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0)
    free_distance(slot, seen, points, evidence, params, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 1.0, 0.0)
    nearest(points, evidence, counters, params, 0.0, 0.0, 0.0, 0.0)
    occupied(points, evidence, counters, params, 0.0, 0.0)
    free_since(seen, 1, 1, 1, 0.0)
    hit_cells(slot, 1, 1, 1, np.zeros((9, 2), dtype=np.int64))
    thin(points, 1.0)
    forget(*listed, params, 0.0, 0.0, 0.0, 0.0, 1.0, 0.1)
