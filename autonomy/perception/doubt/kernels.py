"""Compiled loops of the doubt: what each reading says about its beam, and about the others.

All of them are in this one file, because numba's disk cache does not notice a changed callee in
another one. README.md says what is looked for and why; `evidence.py` is the typed door.

The state is a handful of float64 arrays, one row a beam:

    views (beams, BINS, V_...)   newest ray of the beam in each sector of NED bearing
    rings (beams, RING, R_...)   its newest readings, in a circle
    tracks (beams, T_...)        runs of equal values, what is too near, how it follows the height
    pairs (beams, beams, 2)      places where two beams contradict each other, and agree; fading
    copies (beams, beams)        lone spikes that are the other beam's value; fading
    gone (beams, beams)          the other's hits swept past, since the beam last hit; fading
    clock (C_...)                what is common
    moving (n, D_...)            discs where something moves, or moved a moment ago
"""

# numba compiles by the types of the arguments; the typed door to these loops is evidence.py.
# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators

import math

import numpy as np
from numba import njit

VALID, TOO_NEAR, OUT_OF_RANGE, NO_SIGNAL = 0, 1, 2, 3

BINS = 120
# V_PAST: which beams have looked past this ray's hit, one bit a beam
V_STAMP, V_NORTH, V_EAST, V_DOWN, V_COS, V_SIN, V_RANGE, V_KIND, V_PAST = range(9)
VIEW_COLUMNS = 9
NONE, FREE, HIT = 0, 1, 2

RING = 64
R_STAMP, R_RANGE, R_STATUS = range(3)
RING_COLUMNS = 3

T_COUNT = 0
T_STAMP = 1
T_MEASURED = 2
T_RUN = 3  # readings in a row with the same value and status
T_RUN_VALUE = 4
T_RUN_STATUS = 5
T_RUN_TURN = 6  # the vehicle's heading, unwrapped, when the run began
T_RUN_LOW = 7  # least and greatest height meanwhile
T_RUN_HIGH = 8
T_LONGEST = 9  # longest run of a measured value before this one
T_NEAR = 10  # since when everything measured lies inside the body; nan: it does not
T_REF_STAMP = 11
T_REF_HEIGHT = 12
T_REF_RANGE = 13
T_REF_NORTH = 14
T_REF_EAST = 15
T_STAYS = 16  # readings that did not follow the height ...
T_FOLLOWS = 17  # ... and that did, since the last that did not
T_BLIND = 18  # readings in a row without a surface where the floor must be
T_SIGMA = 19  # the standard deviation that the newest reading claims
T_FLOWN = 20  # readings that measured a value in the air
T_DISPUTED = 22  # 1: it showed as free, lately, what another beam has just hit
T_HIT = 21  # when it last hit something in the plane
T_RUN_SINCE = 23  # stamp of the run's first reading
T_BORNE = 24  # readings that agree with the reference ...
T_LEAPS = 25  # ... and those in a row that do not, though the vehicle has hardly moved
T_LEAP_LOW = 26  # least and greatest of these, less what the height explains
T_LEAP_HIGH = 27
T_AT_NORTH = 28  # where the last reading agreed with the reference
T_AT_EAST = 29
T_FLOOR = 30  # readings in a row of the floor of the take-off ...
T_NO_FLOOR = 31  # ... and those after them with nothing in range, though it is in reach
TRACK_COLUMNS = 32

# C_GONE_...: what was swept past, as a sum of unit vectors, and how much it was; fading
C_TIME, C_TURNED, C_YAW, C_GONE_N, C_GONE_E, C_GONE = range(6)
CLOCK_COLUMNS = 6

M_RISE = 0  # 0 horizontal, +1 up, -1 down
M_DIRECTION = 1  # three columns, FRD
M_FACE = 4  # three columns, FRD
M_BODY = 7  # inside this distance from the face is the vehicle itself
M_TRUSTED = 8  # 0: the beam is not believed now
MOUNT_COLUMNS = 9

Q_BEAM, Q_STAMP, Q_STATUS, Q_RANGE, Q_SIGMA, Q_DENIED = range(6)
READING_COLUMNS = 6

(
    P_NOW,
    P_STAMP,
    P_NORTH,
    P_EAST,
    P_DOWN,
    P_VN,
    P_VE,
    P_VD,
    P_ROLL,
    P_PITCH,
    P_YAW,
    P_RATE,
    P_OK,
) = range(13)
POSE_COLUMNS = 13

D_NORTH, D_EAST, D_RADIUS, D_LEFT = range(4)  # D_LEFT 1: it is not there any more
DISC_COLUMNS = 4

S_AGE = 0  # s since it said anything
S_UNMEASURED = 1  # s since it measured anything
S_LOST = 2  # share of the last second's readings that are no signal
S_HEARD = 3  # readings in the last second
S_NEAR = 4  # s for which everything lies inside the body
S_RUN = 5
S_RUN_STATUS = 6
S_RUN_VALUE = 7
S_TURNED = 8  # rad that the vehicle turned during the run
S_CLIMBED = 9  # m between the run's least and greatest height
S_LONGEST = 10
S_NOISE = 11  # m, one sigma estimated from how it jumps
S_CLAIMED = 12  # m, one sigma that it claims
S_STAYS = 13
S_FOLLOWS = 14
S_BLIND = 15
S_SAME = 16  # greatest share of a recent second's values that are another beam's ...
S_SAME_AS = 17  # ... and that beam
S_COPIES = 18  # lone spikes that are another beam's value ...
S_COPIES_OF = 19
S_SPREAD = 20  # m between its least and greatest measured value lately
S_EMPTY = 21  # share of the recent readings with nothing in range
S_FLOWN = 22
S_VANISHED = 23
S_UNHIT = 24  # s since it hit something in the plane
S_LEAPS = 25  # up, down: readings in a row of another surface, though the vehicle stayed
S_NO_FLOOR = 26  # down: readings in a row that miss the floor that it saw just before
S_RUN_S = 27  # s since the run began
SUMMARY_COLUMNS = 28

AGE_S = 3.5
"""Two sweeps of four beams at 60 deg/s: older views are of another time."""
FADE_S = 8.0
GONE_FADE_S = 3.0
LATE_S = 0.15
"""A pose is not carried farther than this."""
LEVEL_M = 0.06
"""Views from heights that differ by more are not compared ..."""
CLIMBING_M_S = 0.1
"""... and none from before a climb, which may end just above a wall."""
WINDOW_RAD = math.radians(17.5)
"""A hit lies within this of a beam's axis: half of a VL53L0X' cone, and 5 deg of heading."""
COVER_RAD = math.radians(10.0)
"""The other beam's sweep must reach so far to both sides of the hit ..."""
HOLE_RAD = math.radians(9.0)
"""... without a hole wider than this."""
SWEEP_RAYS = 4
REACH_BINS = 20
BEHIND_BINS = 6
AMID_BINS = 2
TOLERANCE_M = 0.12
TOLERANCE_PER_M = 0.22
"""Sine of 12.5 deg: how much the place of a hit on its arc matters seen from elsewhere."""
NEAREST_M = 0.15
SLAB_M = 0.08
YAW_JUMP_RAD = math.radians(8.0)
SPIKE_M = 0.1
COPY_M = 0.006
INSIDE_RAD = math.radians(10.0)
BOTH_SIDES_RAD = math.radians(4.5)
"""Hits this far to both sides of a ray: it looks at the inside of something, not past its edge."""
SAME_TIME_S = 0.04
RECENT_S = 1.5
NOISE_READINGS = 20
TRIPLETS_MIN = 10
FOLLOW_M = 0.15
FOLLOW_SHARE = 0.3
FOLLOW_WITHIN_M = 0.12
FOLLOW_S = 5.0
LEAP_M, LEAP_WITHIN_M = 0.15, 0.03
"""No surface steps by so much while the vehicle stays within so little ..."""
LEAP_SPREAD_M = 0.12
"""... and then stays there, with no more noise than this."""
BORNE_MIN = 5.0
TAKE_OFF_FLOOR_M = 0.2
"""What is nearer than the floor of the take-off by this is something on it."""
FROZEN_RUN = 5.0
FLOOR_LOW_M, FLOOR_HIGH_M, FLOOR_WITHIN_M = 0.25, 0.8, 0.25
FLYING_M = 0.3


@njit(cache=True)
def _wrap(angle):
    return angle - 2.0 * math.pi * math.floor((angle + math.pi) / (2.0 * math.pi))


@njit(cache=True)
def _bin_of(bearing):
    return math.floor((bearing + math.pi) / (2.0 * math.pi) * BINS) % BINS


@njit(cache=True)
def _ned(x, y, z, roll, pitch, yaw):
    """(x, y, z) forward, right, down -> north, east, down."""
    cr, sr = math.cos(roll), math.sin(roll)
    cp, sp = math.cos(pitch), math.sin(pitch)
    cy, sy = math.cos(yaw), math.sin(yaw)
    level = cp * x + sp * (sr * y + cr * z)
    side = cr * y - sr * z
    return cy * level - sy * side, sy * level + cy * side, -sp * x + cp * (sr * y + cr * z)


@njit(cache=True)
def _compare(view, north, east, down, from_n, from_e, now):
    """What a sweep says of a hit at (north, east), seen from (from_n, from_e).

    1: all of the sweep looked past it; -1: it measured something at that distance; else 0.
    """
    centre = _bin_of(math.atan2(east - from_e, north - from_n))
    rays = 0
    low = high = last = 0.0
    hole = False
    for step in range(-REACH_BINS, REACH_BINS + 1):
        ray = view[(centre + step) % BINS]
        if ray[V_KIND] == NONE or now - ray[V_STAMP] > AGE_S:
            continue
        if abs(ray[V_DOWN] - down) > LEVEL_M:
            continue
        dn = north - ray[V_NORTH]
        de = east - ray[V_EAST]
        along = dn * ray[V_COS] + de * ray[V_SIN]
        across = de * ray[V_COS] - dn * ray[V_SIN]
        if along <= 0.0:
            continue
        off = math.atan2(across, along)
        if abs(off) > WINDOW_RAD:
            continue
        distance = math.hypot(dn, de)
        if distance < NEAREST_M:
            return 0
        moved = math.hypot(ray[V_NORTH] - from_n, ray[V_EAST] - from_e)
        slack = TOLERANCE_M + TOLERANCE_PER_M * moved
        if ray[V_KIND] == HIT and abs(ray[V_RANGE] - distance) <= slack:
            return -1
        if ray[V_RANGE] <= distance + slack:
            return 0
        if rays == 0:
            low = high = off
        elif abs(off - last) > HOLE_RAD:
            hole = True
        low = min(low, off)
        high = max(high, off)
        last = off
        rays += 1
    if rays < SWEEP_RAYS or hole or low > -COVER_RAD or high < COVER_RAD:
        return 0
    return 1


@njit(cache=True)
def _is_explained(moving, north, east):
    """True for a place where something moves: seen free and hit there are both right."""
    for disc in moving:
        if math.hypot(north - disc[D_NORTH], east - disc[D_EAST]) <= disc[D_RADIUS]:
            return True
    return False


@njit(cache=True)
def _looks_past_what_left(moving, ray):
    """True for a ray that goes through the place that something has just left."""
    for disc in moving:
        dn = disc[D_NORTH] - ray[V_NORTH]
        de = disc[D_EAST] - ray[V_EAST]
        along = dn * ray[V_COS] + de * ray[V_SIN]
        across = de * ray[V_COS] - dn * ray[V_SIN]
        if disc[D_LEFT] != 0.0 and along > 0.0 and abs(across) <= disc[D_RADIUS]:
            return True
    return False


@njit(cache=True)
def _book(pairs, a, b, verdict):
    if verdict == 0:
        return
    column = 0 if verdict > 0 else 1
    pairs[a, b, column] += 1.0
    pairs[b, a, column] += 1.0


@njit(cache=True)
def _turn(views, gone, clock, pose):
    """Keep count of the heading; its jump, a climb, or a state that is none end all comparisons."""
    dt = pose[P_NOW] - clock[C_TIME]
    clock[C_TIME] = pose[P_NOW]
    if not 0.0 <= dt < 1.0e6:
        dt = 0.0
    turned = _wrap(pose[P_YAW] - clock[C_YAW])
    clock[C_YAW] = pose[P_YAW]
    jumped = abs(_wrap(turned - pose[P_RATE] * dt)) > YAW_JUMP_RAD
    if pose[P_OK] == 0.0 or jumped or dt > 1.0 or abs(pose[P_VD]) > CLIMBING_M_S:
        views[:, :, V_KIND] = NONE
        gone[:, :] = 0.0
    clock[C_TURNED] += turned
    return dt


@njit(cache=True)
def _lay(views, mounts, reading, pose):
    """Lay one horizontal reading into the plane; its sector, -1 for none."""
    beam = int(reading[Q_BEAM])
    status = int(reading[Q_STATUS])
    ahead = min(LATE_S, max(-LATE_S, reading[Q_STAMP] - pose[P_STAMP]))
    yaw = pose[P_YAW] + pose[P_RATE] * ahead
    mount = mounts[beam]
    un, ue, ud = _ned(
        mount[M_DIRECTION],
        mount[M_DIRECTION + 1],
        mount[M_DIRECTION + 2],
        pose[P_ROLL],
        pose[P_PITCH],
        yaw,
    )
    fn, fe, fd = _ned(
        mount[M_FACE], mount[M_FACE + 1], mount[M_FACE + 2], pose[P_ROLL], pose[P_PITCH], yaw
    )
    north = pose[P_NORTH] + pose[P_VN] * ahead + fn
    east = pose[P_EAST] + pose[P_VE] * ahead + fe
    down = pose[P_DOWN] + pose[P_VD] * ahead + fd
    level = math.hypot(un, ue)
    if level <= 0.0:
        return -1
    cos, sin = un / level, ue / level
    leaves = SLAB_M / abs(ud) if ud != 0.0 else math.inf
    ranged = reading[Q_RANGE]
    kind = NONE
    if status in (VALID, OUT_OF_RANGE):
        kind = HIT if status == VALID else FREE
        if ranged > leaves:
            kind = FREE
            ranged = leaves
    sector = _bin_of(math.atan2(sin, cos))
    own = views[beam, sector]
    own[V_STAMP] = reading[Q_STAMP]
    own[V_NORTH] = north
    own[V_EAST] = east
    own[V_DOWN] = down
    own[V_COS] = cos
    own[V_SIN] = sin
    own[V_RANGE] = ranged * level
    own[V_KIND] = kind
    own[V_PAST] = 0.0
    return -1 if kind == NONE else sector


@njit(cache=True)
def _look(views, tracks, mounts, pairs, gone, clock, moving, reading, pose):
    """Lay one horizontal reading into the plane, and compare it with what the others saw."""
    sector = _lay(views, mounts, reading, pose)
    if sector < 0:
        return
    beam = int(reading[Q_BEAM])
    own = views[beam, sector]
    for other in range(len(mounts)):
        if other != beam and mounts[other, M_RISE] == 0.0 and mounts[other, M_TRUSTED] != 0.0:
            reading[Q_DENIED] += _denied(views[other], own, sector)
    if reading[Q_DENIED] != 0.0 and _looks_past_what_left(moving, own):
        reading[Q_DENIED] = 0.0
    rate = pose[P_RATE]
    if own[V_KIND] == HIT:
        tracks[beam, T_HIT] = reading[Q_STAMP]
        gone[beam, :] = 0.0
        _meet(views, tracks, mounts, pairs, moving, beam, sector, rate)
    if abs(rate) < 0.1:
        return
    now, down = reading[Q_STAMP], own[V_DOWN]
    _sweep_past(views, tracks, mounts, pairs, gone, clock, moving, beam, sector, down, now, rate)


@njit(cache=True)
def _meet(views, tracks, mounts, pairs, moving, beam, sector, rate):
    """What the others' sweeps say of the hit that the beam has in this sector."""
    own = views[beam, sector]
    now = own[V_STAMP]
    hit_n = own[V_NORTH] + own[V_COS] * own[V_RANGE]
    hit_e = own[V_EAST] + own[V_SIN] * own[V_RANGE]
    explained = _is_explained(moving, hit_n, hit_e)
    amid = (sector - (AMID_BINS if rate > 0.0 else -AMID_BINS)) % BINS
    for other in range(len(mounts)):
        if other == beam or mounts[other, M_RISE] != 0.0:
            continue
        view = views[other]
        said = _compare(view, hit_n, hit_e, own[V_DOWN], own[V_NORTH], own[V_EAST], now)
        if said < 0 or not explained:
            _book(pairs, beam, other, said)
        if said > 0 or _through(views[beam], view[amid], amid, now):
            tracks[other, T_DISPUTED] = 1.0


@njit(cache=True)
def _through(view, ray, sector, now):
    """True when a ray of the last seconds went right through what a beam is hitting now."""
    if ray[V_KIND] == NONE or now - ray[V_STAMP] > AGE_S:
        return False
    return _denied(view, ray, sector) > 0.0


@njit(cache=True)
def _denied(view, ray, sector):
    """1 when another beam has lately hit something on both sides of the ray, nearer than it."""
    low = high = 0.0
    for step in range(-REACH_BINS, REACH_BINS + 1):
        hit = view[(sector + step) % BINS]
        if hit[V_KIND] == NONE or ray[V_STAMP] - hit[V_STAMP] > AGE_S:
            continue
        if abs(hit[V_DOWN] - ray[V_DOWN]) > LEVEL_M:
            continue
        dn = hit[V_NORTH] + hit[V_COS] * hit[V_RANGE] - ray[V_NORTH]
        de = hit[V_EAST] + hit[V_SIN] * hit[V_RANGE] - ray[V_EAST]
        off = math.atan2(de * ray[V_COS] - dn * ray[V_SIN], dn * ray[V_COS] + de * ray[V_SIN])
        if abs(off) > INSIDE_RAD:
            continue
        moved = math.hypot(ray[V_NORTH] - hit[V_NORTH], ray[V_EAST] - hit[V_EAST])
        nearer = math.hypot(dn, de) + TOLERANCE_M + TOLERANCE_PER_M * moved < ray[V_RANGE]
        if hit[V_KIND] == FREE or not nearer:
            return 0.0
        low = min(low, off)
        high = max(high, off)
    return 1.0 if low <= -BOTH_SIDES_RAD and high >= BOTH_SIDES_RAD else 0.0


@njit(cache=True)
def _repeated(track, stamp):
    """True when what the beam said then it still says: nothing that may have vanished."""
    return track[T_RUN] >= FROZEN_RUN and stamp >= track[T_RUN_SINCE]


@njit(cache=True)
def _first_past(seen, beam):
    """1 the first time that the beam looks past this hit, else 0.

    A sensor that is fast for how the vehicle turns measures several times while one sector lies
    behind the beam: a lone hit on a thin post is one thing that vanished, not several.
    """
    past, bit = int(seen[V_PAST]), 1 << beam
    if past & bit:
        return 0.0
    seen[V_PAST] = float(past | bit)
    return 1.0


@njit(cache=True)
def _sweep_past(views, tracks, mounts, pairs, gone, clock, moving, beam, sector, down, now, rate):
    """What others hit there before, now that this beam has swept past it."""
    behind = (sector - (BEHIND_BINS if rate > 0.0 else -BEHIND_BINS)) % BINS
    for other in range(len(mounts)):
        if other == beam or mounts[other, M_RISE] != 0.0:
            continue
        seen = views[other, behind]
        if seen[V_KIND] != HIT or now - seen[V_STAMP] > AGE_S or now - seen[V_STAMP] < 0.5:
            continue
        if abs(seen[V_DOWN] - down) > LEVEL_M:
            continue
        hit_n = seen[V_NORTH] + seen[V_COS] * seen[V_RANGE]
        hit_e = seen[V_EAST] + seen[V_SIN] * seen[V_RANGE]
        said = _compare(views[beam], hit_n, hit_e, seen[V_DOWN], seen[V_NORTH], seen[V_EAST], now)
        if said > 0 and _is_explained(moving, hit_n, hit_e):
            continue
        _book(pairs, beam, other, said)
        if said <= 0 or mounts[other, M_TRUSTED] == 0.0:
            continue
        if not _repeated(tracks[other], seen[V_STAMP]):
            gone[beam, other] += _first_past(seen, beam)
            clock[C_GONE_N] += seen[V_COS]
            clock[C_GONE_E] += seen[V_SIN]
            clock[C_GONE] += 1.0


@njit(cache=True)
def _follow(track, mount, reading, pose):
    """Up and down: the range must change as the height does, while the place stays."""
    height = -pose[P_DOWN]
    status = int(reading[Q_STATUS])
    if status == NO_SIGNAL:
        return
    away = math.hypot(pose[P_NORTH] - track[T_REF_NORTH], pose[P_EAST] - track[T_REF_EAST])
    climbed = height - track[T_REF_HEIGHT]
    old = reading[Q_STAMP] - track[T_REF_STAMP] > FOLLOW_S or away > FOLLOW_WITHIN_M
    if mount[M_RISE] < 0.0:
        _see_floor(track, reading, pose)
    if not old and _leapt(track, reading, pose, -mount[M_RISE] * climbed):
        return
    if status == OUT_OF_RANGE:
        if track[T_BORNE] < BORNE_MIN or old:
            track[T_REF_STAMP] = -math.inf
        return
    ranged = reading[Q_RANGE]
    if old:
        pass
    elif abs(climbed) < FOLLOW_M:
        return
    elif abs(ranged - track[T_REF_RANGE]) < FOLLOW_SHARE * abs(climbed):
        track[T_STAYS] += 1.0
        track[T_FOLLOWS] = 0.0
        return
    else:
        track[T_STAYS] = 0.0
        track[T_FOLLOWS] += 1.0
    track[T_BORNE] = track[T_LEAPS] = 0.0
    track[T_REF_STAMP] = reading[Q_STAMP]
    track[T_REF_HEIGHT] = height
    track[T_REF_RANGE] = ranged
    track[T_REF_NORTH] = pose[P_NORTH]
    track[T_REF_EAST] = pose[P_EAST]


@njit(cache=True)
def _see_floor(track, reading, pose):
    """Count what the beam down says of the floor of the take-off."""
    height = -pose[P_DOWN]
    ranged = reading[Q_RANGE]
    if int(reading[Q_STATUS]) != OUT_OF_RANGE or ranged <= height + SPIKE_M:
        track[T_BLIND] = track[T_NO_FLOOR] = 0.0
        seen = int(reading[Q_STATUS]) == VALID and abs(ranged - height) < TAKE_OFF_FLOOR_M
        track[T_FLOOR] = track[T_FLOOR] + 1.0 if seen else 0.0
        return
    near_home = math.hypot(pose[P_NORTH], pose[P_EAST]) < FLOOR_WITHIN_M
    if near_home and FLOOR_LOW_M < height < FLOOR_HIGH_M:
        track[T_BLIND] += 1.0
    if track[T_FLOOR] >= BORNE_MIN and height > FLYING_M:
        track[T_NO_FLOOR] += 1.0


@njit(cache=True)
def _leapt(track, reading, pose, longer):
    """Count the readings of another surface than the reference, at the same place.

    `longer`: by how much the height makes the range longer than the reference. True while a
    surface that several readings bore out seems to have gone: then the reference stays.
    """
    off = reading[Q_RANGE] - track[T_REF_RANGE] - longer
    if int(reading[Q_STATUS]) == TOO_NEAR or abs(longer) > FOLLOW_M:
        return False
    if abs(off) <= LEAP_M:
        # Nothing in range, at the end of the range, agrees with a surface there.
        track[T_BORNE] += 1.0
        track[T_LEAPS] = 0.0
        track[T_AT_NORTH] = pose[P_NORTH]
        track[T_AT_EAST] = pose[P_EAST]
        return False
    away = math.hypot(pose[P_NORTH] - track[T_AT_NORTH], pose[P_EAST] - track[T_AT_EAST])
    nothing = int(reading[Q_STATUS]) == OUT_OF_RANGE
    if (nothing and off < 0.0) or track[T_BORNE] < BORNE_MIN or away > LEAP_WITHIN_M:
        track[T_LEAPS] = 0.0
        return False
    if track[T_LEAPS] == 0.0:
        track[T_LEAP_LOW] = track[T_LEAP_HIGH] = off
    low, high = min(track[T_LEAP_LOW], off), max(track[T_LEAP_HIGH], off)
    track[T_LEAP_LOW], track[T_LEAP_HIGH] = low, high
    if high - low > LEAP_SPREAD_M:
        track[T_LEAPS] = 0.0
        return False
    track[T_LEAPS] += 1.0
    return True


@njit(cache=True)
def _remember(ring, track, mount, reading, clock, height):
    """The newest reading into the ring, and into the run of equal ones."""
    stamp = reading[Q_STAMP]
    status = reading[Q_STATUS]
    at = ring[int(track[T_COUNT]) % RING]
    at[R_STAMP] = stamp
    at[R_RANGE] = reading[Q_RANGE]
    at[R_STATUS] = status
    track[T_COUNT] += 1.0
    track[T_STAMP] = stamp
    if status == NO_SIGNAL:
        return
    track[T_SIGMA] = reading[Q_SIGMA]
    track[T_MEASURED] = stamp
    flying = height > FLYING_M
    if not flying:
        track[T_FLOWN] = track[T_LONGEST] = 0.0
    elif status == VALID:
        track[T_FLOWN] += 1.0
    if flying and status == track[T_RUN_STATUS] and reading[Q_RANGE] == track[T_RUN_VALUE]:
        track[T_RUN] += 1.0
    else:
        if flying and track[T_RUN_STATUS] == VALID:
            track[T_LONGEST] = max(track[T_LONGEST], track[T_RUN])
        track[T_RUN] = 1.0
        track[T_RUN_VALUE] = reading[Q_RANGE]
        track[T_RUN_STATUS] = status
        track[T_RUN_TURN] = clock[C_TURNED]
        track[T_RUN_SINCE] = stamp
        track[T_RUN_LOW] = track[T_RUN_HIGH] = height
    track[T_RUN_LOW] = min(track[T_RUN_LOW], height)
    track[T_RUN_HIGH] = max(track[T_RUN_HIGH], height)
    inside = status in (TOO_NEAR, VALID)
    if not flying or not inside or reading[Q_RANGE] >= mount[M_BODY]:
        track[T_NEAR] = math.nan
    elif math.isnan(track[T_NEAR]):
        track[T_NEAR] = stamp


@njit(cache=True)
def _ranged(status):
    """Nothing in range is a range, too: the greatest one."""
    return status in (VALID, OUT_OF_RANGE)


@njit(cache=True)
def _spike(rings, tracks, copies, beam):
    """A lone value between two others: whose is it?"""
    count = int(tracks[beam, T_COUNT])
    if count < 3:
        return
    ring = rings[beam]
    a = ring[(count - 3) % RING]
    b = ring[(count - 2) % RING]
    c = ring[(count - 1) % RING]
    if b[R_STATUS] != VALID or not _ranged(a[R_STATUS]) or not _ranged(c[R_STATUS]):
        return
    before = b[R_RANGE] - a[R_RANGE]
    after = b[R_RANGE] - c[R_RANGE]
    if before * after <= 0.0 or min(abs(before), abs(after)) < SPIKE_M:
        return
    for other in range(len(rings)):
        if other != beam and _said(rings[other], tracks[other], b[R_STAMP], b[R_RANGE]) == 1:
            copies[beam, other] += 1.0


@njit(cache=True)
def _said(ring, track, stamp, ranged):
    """1 when the beam measured that range at that time, 0 another one, -1 none."""
    count = int(track[T_COUNT])
    for back in range(1, min(count, 12) + 1):
        at = ring[(count - back) % RING]
        if at[R_STAMP] < stamp - SAME_TIME_S:
            return -1
        if at[R_STAMP] <= stamp + SAME_TIME_S and at[R_STATUS] == VALID:
            return 1 if abs(at[R_RANGE] - ranged) <= COPY_M else 0
    return -1


@njit(cache=True)
def take(views, rings, tracks, pairs, copies, gone, clock, moving, mounts, readings, count, pose):
    """Take in the first `count` rows of `readings`, oldest first; the pose is the tick's.

    (whether one is denied, whether a beam is disputed): `Q_DENIED` and `T_DISPUTED` say which.
    """
    dt = _turn(views, gone, clock, pose)
    fade = math.exp(-dt / FADE_S)
    gone_fade = math.exp(-dt / GONE_FADE_S)
    for a in range(len(mounts)):
        for b in range(len(mounts)):
            pairs[a, b, 0] *= fade
            pairs[a, b, 1] *= fade
            copies[a, b] *= fade
            gone[a, b] *= gone_fade
    clock[C_GONE_N : C_GONE + 1] *= gone_fade
    height = -pose[P_DOWN]
    for k in range(count):
        reading = readings[k]
        beam = int(reading[Q_BEAM])
        if reading[Q_STAMP] <= tracks[beam, T_STAMP]:
            readings[k, Q_BEAM] = -1.0
            continue
        mount = mounts[beam]
        _remember(rings[beam], tracks[beam], mount, reading, clock, height)
        if pose[P_OK] != 0.0 and mount[M_RISE] == 0.0:
            _look(views, tracks, mounts, pairs, gone, clock, moving, reading, pose)
        elif pose[P_OK] != 0.0:
            _follow(tracks[beam], mount, reading, pose)
    for k in range(count):
        if readings[k, Q_BEAM] >= 0.0:
            _spike(rings, tracks, copies, int(readings[k, Q_BEAM]))
    denied = disputed = False
    for k in range(count):
        denied = denied or readings[k, Q_DENIED] != 0.0
    for beam in range(len(tracks)):
        disputed = disputed or tracks[beam, T_DISPUTED] != 0.0
    return denied, disputed


@njit(cache=True)
def _noise(ring, track, now):
    """One sigma, from the median of |second differences| of its newest values; 0: too few."""
    count = int(track[T_COUNT])
    found = np.empty(NOISE_READINGS)
    n = 0
    for back in range(1, min(count, RING) - 1):
        if n == NOISE_READINGS:
            break
        c = ring[(count - back) % RING]
        b = ring[(count - back - 1) % RING]
        a = ring[(count - back - 2) % RING]
        if now - a[R_STAMP] > 2.0 * RECENT_S:
            break
        if a[R_STATUS] == VALID and b[R_STATUS] == VALID and c[R_STATUS] == VALID:
            found[n] = abs(a[R_RANGE] - 2.0 * b[R_RANGE] + c[R_RANGE])
            n += 1
    if n < TRIPLETS_MIN:
        return 0.0
    found[:n].sort()
    return found[n // 2] / (0.6745 * math.sqrt(6.0))


@njit(cache=True)
def _sameness(rings, tracks, beam, other, now):
    """(share of the beam's recent values that the other has, too, how many there were)."""
    ring = rings[beam]
    count = int(tracks[beam, T_COUNT])
    same = n = 0
    for back in range(1, min(count, RING) + 1):
        at = ring[(count - back) % RING]
        if now - at[R_STAMP] > RECENT_S or n == 12:
            break
        if at[R_STATUS] != VALID:
            continue
        said = _said(rings[other], tracks[other], at[R_STAMP], at[R_RANGE])
        if said >= 0:
            n += 1
            same += said
    return (same / n if n > 0 else 0.0), n


@njit(cache=True)
def summarize(rings, tracks, copies, gone, clock, now, out):
    """One row of `out` (S_... columns) for every beam."""
    for beam in range(len(tracks)):
        track, ring, row = tracks[beam], rings[beam], out[beam]
        row[S_AGE] = now - track[T_STAMP]
        row[S_UNMEASURED] = now - track[T_MEASURED]
        count = int(track[T_COUNT])
        heard = lost = empty = 0
        low, high = math.inf, -math.inf
        for back in range(1, min(count, RING) + 1):
            at = ring[(count - back) % RING]
            if now - at[R_STAMP] > RECENT_S:
                break
            heard += 1
            lost += at[R_STATUS] == NO_SIGNAL
            empty += at[R_STATUS] == OUT_OF_RANGE
            if at[R_STATUS] == VALID:
                low = min(low, at[R_RANGE])
                high = max(high, at[R_RANGE])
        row[S_HEARD] = heard
        row[S_LOST] = lost / heard if heard > 0 else 0.0
        row[S_EMPTY] = empty / heard if heard > 0 else 0.0
        row[S_SPREAD] = max(0.0, high - low)
        near = track[T_NEAR]
        row[S_NEAR] = 0.0 if math.isnan(near) else track[T_MEASURED] - near
        row[S_RUN] = track[T_RUN]
        row[S_RUN_STATUS] = track[T_RUN_STATUS]
        row[S_RUN_VALUE] = track[T_RUN_VALUE]
        row[S_TURNED] = abs(clock[C_TURNED] - track[T_RUN_TURN])
        row[S_CLIMBED] = track[T_RUN_HIGH] - track[T_RUN_LOW]
        row[S_LONGEST] = track[T_LONGEST]
        row[S_NOISE] = _noise(ring, track, now)
        row[S_CLAIMED] = track[T_SIGMA]
        row[S_FLOWN] = track[T_FLOWN]
        row[S_VANISHED] = np.sum(gone[beam])
        row[S_UNHIT] = now - track[T_HIT]
        row[S_STAYS] = track[T_STAYS]
        row[S_FOLLOWS] = track[T_FOLLOWS]
        row[S_BLIND] = track[T_BLIND]
        row[S_LEAPS] = track[T_LEAPS]
        row[S_NO_FLOOR] = track[T_NO_FLOOR]
        row[S_RUN_S] = now - track[T_RUN_SINCE] if count > 0 else 0.0
        row[S_SAME] = row[S_COPIES] = 0.0
        row[S_SAME_AS] = row[S_COPIES_OF] = -1.0
        for other in range(len(tracks)):
            if other == beam:
                continue
            share, n = _sameness(rings, tracks, beam, other, now)
            if n >= 6 and share > row[S_SAME]:
                row[S_SAME] = share
                row[S_SAME_AS] = other
            if copies[beam, other] > row[S_COPIES]:
                row[S_COPIES] = copies[beam, other]
                row[S_COPIES_OF] = other


def warm_up() -> None:
    """Compile every kernel with the argument types of a flight."""
    count = 2
    views = np.zeros((count, BINS, VIEW_COLUMNS))
    rings = np.zeros((count, RING, RING_COLUMNS))
    tracks = np.zeros((count, TRACK_COLUMNS))
    pairs = np.zeros((count, count, 2))
    copies = np.zeros((count, count))
    clock = np.zeros(CLOCK_COLUMNS)
    mounts = np.zeros((count, MOUNT_COLUMNS))
    readings = np.zeros((4, READING_COLUMNS))
    pose = np.zeros(POSE_COLUMNS)
    moving = np.zeros((0, DISC_COLUMNS))
    gone = copies.copy()
    take(views, rings, tracks, pairs, copies, gone, clock, moving, mounts, readings, 0, pose)
    summarize(rings, tracks, copies, copies, clock, 0.0, np.zeros((count, SUMMARY_COLUMNS)))
