"""Where a MAVLink range message looks: MAV_SENSOR_ORIENTATION and quaternions as directions."""

import math

from hal.config import BeamMount
from hal.errors import ReadingRefused
from hal.frames import Vector3

UP, DOWN = 24, 25  # MAV_SENSOR_ROTATION_PITCH_90, _PITCH_270
CUSTOM = 100  # MAV_SENSOR_ROTATION_CUSTOM: the quaternion tells
_VERTICAL_DEG = 60.0
_SECTOR_DEG = 45.0  # MAV_SENSOR_ROTATION_NONE..YAW_315 are 0..7
OFF_SECTOR_DEG = 10.0
"""How far a mount may look past the direction that a message names."""
_UNIT_TOLERANCE = 0.05

_YAWS = tuple(range(0, 360, 45))
_PITCH_YAW_DEG: dict[int, tuple[float, float]] = {
    **{code: (0.0, float(yaw)) for code, yaw in enumerate(_YAWS)},
    **{8 + code: (0.0, float(yaw)) for code, yaw in enumerate(_YAWS)},
    12: (180.0, 0.0),
    **{16 + code: (0.0, float(yaw)) for code, yaw in enumerate(_YAWS[:4])},
    **{20 + code: (0.0, float(yaw)) for code, yaw in enumerate(_YAWS[:4])},
    UP: (90.0, 0.0),
    DOWN: (270.0, 0.0),
    26: (180.0, 90.0),
    27: (180.0, 270.0),
    28: (90.0, 0.0),
    29: (90.0, 0.0),
    30: (90.0, 0.0),
    31: (180.0, 0.0),
    32: (180.0, 0.0),
    33: (270.0, 0.0),
    34: (270.0, 0.0),
    35: (270.0, 0.0),
    36: (180.0, 90.0),
    37: (0.0, 270.0),
    38: (68.0, 293.0),
    39: (315.0, 0.0),
    40: (315.0, 0.0),
}
"""Pitch and yaw of every orientation of MAVLink; the roll turns a beam about itself."""


def direction_frd(pitch_deg: float, yaw_deg: float) -> Vector3:
    """Unit vector in the body frame; pitch is up."""
    pitch, yaw = math.radians(pitch_deg), math.radians(yaw_deg)
    level = math.cos(pitch)
    return (level * math.cos(yaw), level * math.sin(yaw), -math.sin(pitch))


_DIRECTIONS = {code: direction_frd(*angles) for code, angles in _PITCH_YAW_DEG.items()}


def orientation_of(mount: BeamMount) -> int:
    """MAV_SENSOR_ORIENTATION of a mount.

    Raises ReadingRefused for a direction that DISTANCE_SENSOR has no number for.
    """
    if mount.pitch_deg >= _VERTICAL_DEG:
        return UP
    if mount.pitch_deg <= -_VERTICAL_DEG:
        return DOWN
    sector = round(mount.yaw_deg / _SECTOR_DEG)
    if abs(mount.yaw_deg - sector * _SECTOR_DEG) > OFF_SECTOR_DEG:
        raise ReadingRefused(
            f"beam {mount.name}: MAVLink has no orientation for a yaw of {mount.yaw_deg:g} deg; "
            "use a multiple of 45 deg"
        )
    return sector % 8


def looks_along(quaternion: tuple[float, ...]) -> Vector3:
    """Where a sensor looks that is turned by `quaternion` (w, x, y, z): the turned x axis, FRD.

    Raises ReadingRefused for what is not a rotation (MAVLink sends zeros for an unknown one).
    """
    if len(quaternion) != 4:
        raise ReadingRefused("a quaternion has four components")
    w, x, y, z = quaternion
    length = math.sqrt(w * w + x * x + y * y + z * z) if max(map(abs, quaternion)) < 2.0 else 0.0
    if abs(length - 1.0) > _UNIT_TOLERANCE:
        raise ReadingRefused(f"the quaternion {quaternion} is not a rotation")
    square = length * length
    return (
        (w * w + x * x - y * y - z * z) / square,
        2.0 * (x * y + w * z) / square,
        2.0 * (x * z - w * y) / square,
    )


class BeamDirections:
    """Which beam a message belongs to, by where it looks.

    The ten directions that have a number of their own (eight around, up, down) belong to the mount
    that `orientation_of` gives that number: its pitch and a few degrees of yaw do not matter.
    Everything else belongs to the mount that looks nearest to it, within 10 deg.
    """

    def __init__(self, mounts: tuple[BeamMount, ...]) -> None:
        """Raises ReadingRefused when two mounts cannot be told apart."""
        self._mounts = tuple((m.name, direction_frd(m.pitch_deg, m.yaw_deg)) for m in mounts)
        self._by_orientation: dict[int, str] = {}
        for mount in mounts:
            try:
                orientation = orientation_of(mount)
            except ReadingRefused:
                continue  # told by quaternion or OBSTACLE_DISTANCE only
            other = self._by_orientation.setdefault(orientation, mount.name)
            if other != mount.name:
                raise ReadingRefused(
                    f"beams {other} and {mount.name} have the same MAVLink orientation; only one "
                    "of them can use this driver"
                )
        plain = (*range(8), UP, DOWN)
        for code, direction in _DIRECTIONS.items():
            same = next((p for p in plain if _near(_DIRECTIONS[p], direction, 1.0)), None)
            name = self._nearest(direction) if same is None else self._by_orientation.get(same)
            if name is not None:
                self._by_orientation[code] = name

    def beam(self, orientation: int, quaternion: tuple[float, ...]) -> str | None:
        """The beam, or None for a direction that no mount looks in.

        Raises ReadingRefused when a custom orientation has no usable quaternion.
        """
        if orientation == CUSTOM:
            return self._nearest(looks_along(quaternion))
        return self._by_orientation.get(orientation)

    def _nearest(self, direction: Vector3) -> str | None:
        near = [
            (_cosine(direction, looks), name)
            for name, looks in self._mounts
            if _near(direction, looks, OFF_SECTOR_DEG)
        ]
        return max(near)[1] if near else None


def _cosine(a: Vector3, b: Vector3) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _near(a: Vector3, b: Vector3, limit_deg: float) -> bool:
    return _cosine(a, b) >= math.cos(math.radians(limit_deg)) - 1e-9
