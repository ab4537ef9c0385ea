"""Ray casting and distances in the world, in compiled code: every kernel of the world is here.

numba's disk cache does not notice changes of called functions in other files, hence one file.

A world is a float64 array of shape (obstacles, 9), one row per obstacle:
shape (DISC or BOX), centre north, centre east, cos(yaw), sin(yaw), half along (a disc's radius),
half across, underside and top as heights above the floor (-inf and inf allowed). Heights are up.
"""

import math

import numpy as np
import numpy.typing as npt
from numba import njit

FloatArray = npt.NDArray[np.float64]

ROW = 9
DISC = 0.0
BOX = 1.0
_PARALLEL = 1e-12  # direction components below this never reach a surface within a room


@njit(cache=True)  # type: ignore[misc, unused-ignore]  # numba is untyped
def _slab(offset: float, slope: float, low: float, high: float) -> tuple[float, float]:
    """Ray parameters between which low <= offset + t * slope <= high: (enter, leave)."""
    if abs(slope) < _PARALLEL:
        if low <= offset <= high:
            return -math.inf, math.inf
        return math.inf, -math.inf
    first, second = (low - offset) / slope, (high - offset) / slope
    return min(first, second), max(first, second)


@njit(cache=True)  # type: ignore[misc, unused-ignore]  # numba is untyped
def _disc(
    offset_n: float, offset_e: float, slope_n: float, slope_e: float, radius: float
) -> tuple[float, float]:
    """Ray parameters between which the ray is inside a vertical cylinder: (enter, leave)."""
    a = slope_n * slope_n + slope_e * slope_e
    c = offset_n * offset_n + offset_e * offset_e - radius * radius
    if a < _PARALLEL * _PARALLEL:
        if c <= 0.0:
            return -math.inf, math.inf
        return math.inf, -math.inf
    b = offset_n * slope_n + offset_e * slope_e
    discriminant = b * b - a * c
    if discriminant < 0.0:
        return math.inf, -math.inf
    root = math.sqrt(discriminant)
    return (-b - root) / a, (-b + root) / a


@njit(cache=True)  # type: ignore[misc, unused-ignore]  # numba is untyped
def _ray(
    world: FloatArray,
    ceiling: float,
    north: float,
    east: float,
    height: float,
    dn: float,
    de: float,
    dh: float,
) -> float:
    """Distance to the first surface along a unit direction; inf for none, 0 from inside one."""
    best = math.inf
    if dh < -_PARALLEL:
        best = max(0.0, -height / dh)
    elif dh > _PARALLEL:
        best = max(0.0, (ceiling - height) / dh)
    for i in range(world.shape[0]):
        offset_n, offset_e = north - world[i, 1], east - world[i, 2]
        if world[i, 0] == DISC:
            enter, leave = _disc(offset_n, offset_e, dn, de, world[i, 5])
        else:
            c, s = world[i, 3], world[i, 4]
            enter, leave = _slab(
                c * offset_n + s * offset_e, c * dn + s * de, -world[i, 5], world[i, 5]
            )
            across_enter, across_leave = _slab(
                c * offset_e - s * offset_n, c * de - s * dn, -world[i, 6], world[i, 6]
            )
            enter, leave = max(enter, across_enter), min(leave, across_leave)
        if enter > leave or leave < 0.0 or enter >= best:
            continue
        up_enter, up_leave = _slab(height, dh, world[i, 7], world[i, 8])
        enter, leave = max(enter, up_enter), min(leave, up_leave)
        if enter <= leave and leave >= 0.0:
            best = min(best, max(0.0, enter))
    return best


@njit(cache=True)  # type: ignore[misc, unused-ignore]  # numba is untyped
def cast_ray(
    world: FloatArray,
    ceiling: float,
    north: float,
    east: float,
    down: float,
    dn: float,
    de: float,
    dd: float,
) -> float:
    """Distance along one NED unit direction; the floor is at down = 0."""
    return _ray(world, ceiling, north, east, -down, dn, de, -dd)


@njit(cache=True)  # type: ignore[misc, unused-ignore]  # numba is untyped
def cast_bundles(
    world: FloatArray,
    ceiling: float,
    north: float,
    east: float,
    down: float,
    roll: float,
    pitch: float,
    yaw: float,
    faces_frd: FloatArray,
    rays_frd: FloatArray,
    out: FloatArray,
) -> None:
    """Write the nearest return of each bundle into `out`.

    faces_frd (beams, 3): the sensors' positions on the body; rays_frd (beams, rays, 3): unit
    directions of each beam's bundle. Attitude is Z-Y-X Euler angles, as in `hal.frames`.
    """
    cr, sr = math.cos(roll), math.sin(roll)
    cp, sp = math.cos(pitch), math.sin(pitch)
    cy, sy = math.cos(yaw), math.sin(yaw)
    # The rotation matrix FRD -> NED, row by row.
    nf, nr, nd = cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr
    ef, er, ed = sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr
    df, dr, dd = -sp, cp * sr, cp * cr
    for b in range(faces_frd.shape[0]):
        f, r, d = faces_frd[b, 0], faces_frd[b, 1], faces_frd[b, 2]
        face_n = north + nf * f + nr * r + nd * d
        face_e = east + ef * f + er * r + ed * d
        face_h = -(down + df * f + dr * r + dd * d)
        nearest = math.inf
        for k in range(rays_frd.shape[1]):
            f, r, d = rays_frd[b, k, 0], rays_frd[b, k, 1], rays_frd[b, k, 2]
            distance = _ray(
                world,
                ceiling,
                face_n,
                face_e,
                face_h,
                nf * f + nr * r + nd * d,
                ef * f + er * r + ed * d,
                -(df * f + dr * r + dd * d),
            )
            nearest = min(nearest, distance)
        out[b] = nearest


@njit(cache=True)  # type: ignore[misc, unused-ignore]  # numba is untyped
def clearance(
    world: FloatArray, north: float, east: float, down: float, half_height: float
) -> float:
    """Signed horizontal distance to the nearest obstacle that reaches within `half_height` of
    that height.
    """
    nearest = math.inf
    for i in range(world.shape[0]):
        if -down + half_height < world[i, 7] or -down - half_height > world[i, 8]:
            continue
        offset_n, offset_e = north - world[i, 1], east - world[i, 2]
        if world[i, 0] == DISC:
            distance = math.hypot(offset_n, offset_e) - world[i, 5]
        else:
            c, s = world[i, 3], world[i, 4]
            along = abs(c * offset_n + s * offset_e) - world[i, 5]
            across = abs(c * offset_e - s * offset_n) - world[i, 6]
            distance = math.hypot(max(along, 0.0), max(across, 0.0)) + min(max(along, across), 0.0)
        nearest = min(nearest, distance)
    return nearest


def warm_up() -> None:
    """Compile every kernel with the argument types used in flight."""
    world = np.zeros((1, ROW))
    out = np.zeros(1)
    cast_ray(world, math.inf, 1.0, 1.0, -1.0, 1.0, 0.0, 0.0)
    faces, rays = np.zeros((1, 3)), np.zeros((1, 1, 3))
    cast_bundles(world, math.inf, 1.0, 1.0, -1.0, 0.0, 0.0, 0.0, faces, rays, out)
    clearance(world, 1.0, 1.0, -1.0, 0.0)
