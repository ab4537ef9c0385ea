"""Frames and the conversions between them; the only place where axes are swapped or rotated.

- NED: local north-east-down, metres, origin where the autopilot's estimator started.
- ENU: east-north-up about the same origin.
- FRD: forward-right-down, fixed to the body. `yaw_rad` is about down, 0 = north, positive east.

A vector is a plain tuple of three floats: fast, immutable, serialisable.
"""

import math
from typing import NamedTuple

Vector3 = tuple[float, float, float]

ZERO3: Vector3 = (0.0, 0.0, 0.0)

# Mean radius of the WGS-84 ellipsoid: over one room the sphere's error is far below GPS noise.
EARTH_RADIUS_M = 6_371_008.8


def wrap_pi(angle_rad: float) -> float:
    """The same angle in [-pi, pi)."""
    return (angle_rad + math.pi) % (2.0 * math.pi) - math.pi


def finite3(vector: Vector3) -> bool:
    """True when all three components are finite numbers."""
    return math.isfinite(vector[0]) and math.isfinite(vector[1]) and math.isfinite(vector[2])


def add(a: Vector3, b: Vector3) -> Vector3:
    """a + b."""
    return (a[0] + b[0], a[1] + b[1], a[2] + b[2])


def subtract(a: Vector3, b: Vector3) -> Vector3:
    """a - b."""
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


def scale(a: Vector3, factor: float) -> Vector3:
    """factor * a."""
    return (a[0] * factor, a[1] * factor, a[2] * factor)


def norm(a: Vector3) -> float:
    """Euclidean length."""
    return math.sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2])


def horizontal_norm(a: Vector3) -> float:
    """Length of the horizontal (first two) components."""
    return math.hypot(a[0], a[1])


def enu_from_ned(ned: Vector3) -> Vector3:
    """(north, east, down) -> (east, north, up); its own inverse is `ned_from_enu`."""
    return (ned[1], ned[0], -ned[2])


def ned_from_enu(enu: Vector3) -> Vector3:
    """(east, north, up) -> (north, east, down)."""
    return (enu[1], enu[0], -enu[2])


def ned_from_frd(frd: Vector3, yaw_rad: float) -> Vector3:
    """Body vector to NED by yaw alone (roll and pitch are levelled out by the caller)."""
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    return (c * frd[0] - s * frd[1], s * frd[0] + c * frd[1], frd[2])


def frd_from_ned(ned: Vector3, yaw_rad: float) -> Vector3:
    """NED vector to body by yaw alone; inverse of `ned_from_frd`."""
    return ned_from_frd(ned, -yaw_rad)


class Turn(NamedTuple):
    """A full attitude as the cosines and sines of its Z-Y-X (yaw, pitch, roll) Euler angles.

    For turning many vectors alike; `rotate_frd_to_ned` is for one.
    """

    cos_roll: float
    sin_roll: float
    cos_pitch: float
    sin_pitch: float
    cos_yaw: float
    sin_yaw: float

    @classmethod
    def of(cls, roll_rad: float, pitch_rad: float, yaw_rad: float) -> "Turn":
        """The turn by these angles."""
        return cls(
            math.cos(roll_rad),
            math.sin(roll_rad),
            math.cos(pitch_rad),
            math.sin(pitch_rad),
            math.cos(yaw_rad),
            math.sin(yaw_rad),
        )

    def to_ned(self, frd: Vector3) -> Vector3:
        """Body vector to NED."""
        cr, sr, cp, sp, cy, sy = self
        x, y, z = frd
        # Roll about x, then pitch about y; yaw last.
        y, z = cr * y - sr * z, sr * y + cr * z
        x, z = cp * x + sp * z, -sp * x + cp * z
        return (cy * x - sy * y, sy * x + cy * y, z)


def rotate_frd_to_ned(frd: Vector3, roll_rad: float, pitch_rad: float, yaw_rad: float) -> Vector3:
    """Body vector to NED by the full attitude, Z-Y-X (yaw, pitch, roll) Euler angles."""
    return Turn.of(roll_rad, pitch_rad, yaw_rad).to_ned(frd)


def ned_from_geodetic(lat_deg: float, lon_deg: float, amsl_m: float, origin: Vector3) -> Vector3:
    """Latitude, longitude, AMSL altitude to NED about `origin` = (lat_deg, lon_deg, amsl_m).

    Local tangent plane on a sphere: better than 1 mm within 100 m of the origin.
    """
    north = math.radians(lat_deg - origin[0]) * EARTH_RADIUS_M
    east = math.radians(lon_deg - origin[1]) * EARTH_RADIUS_M * math.cos(math.radians(origin[0]))
    return (north, east, origin[2] - amsl_m)


def geodetic_from_ned(ned: Vector3, origin: Vector3) -> Vector3:
    """NED about `origin` to (lat_deg, lon_deg, amsl_m); inverse of `ned_from_geodetic`."""
    lat = origin[0] + math.degrees(ned[0] / EARTH_RADIUS_M)
    lon = origin[1] + math.degrees(ned[1] / (EARTH_RADIUS_M * math.cos(math.radians(origin[0]))))
    return (lat, lon, origin[2] - ned[2])
