"""What the beams say about the vehicle's surroundings, and motion with parts taken away."""

import math

import msgspec

from hal.config import BeamMount
from hal.frames import Vector3
from hal.readings import RangeStatus
from hal.vehicle.guard.sight import Sight

ROUNDING = 1e-9

Directions = tuple[tuple[float, float], ...]
"""Unit vectors (north, east)."""


class Beam(msgspec.Struct, frozen=True):
    """A mount in the guard's terms: `rise` is +1 up, -1 down, 0 for a horizontal beam."""

    mount: BeamMount
    yaw_rad: float
    rise: int
    projection: float
    face_m: float


def beam_of(mount: BeamMount) -> Beam:
    """The mount's geometry along its beam: how ranges are measured from the vehicle's centre."""
    yaw, pitch = math.radians(mount.yaw_deg), math.radians(mount.pitch_deg)
    if mount.horizontal:
        face_m = mount.forward_m * math.cos(yaw) + mount.right_m * math.sin(yaw)
        return Beam(mount, yaw, 0, math.cos(pitch), face_m)
    rise = int(math.copysign(1.0, pitch))
    return Beam(mount, yaw, rise, abs(math.sin(pitch)), -rise * mount.down_m)


class Surroundings(msgspec.Struct, frozen=True):
    """What the beams say: unit vectors (north, east) towards what horizontal ones read nearer
    than allowed, and the surfaces above and below (inf when none is read).
    """

    near: Directions
    ceiling_m: float
    ground_m: float


class Around:
    """Reads the beams. Its memory only saves computing the mounts' geometry again."""

    def __init__(self, beam_stop_m: float) -> None:
        self._beam_stop_m = beam_stop_m
        self._known_beams: dict[str, Beam] = {}

    def _beam(self, mount: BeamMount) -> Beam:
        """The mount's geometry, computed once."""
        known = self._known_beams.get(mount.name)
        if known is None or known.mount is not mount:
            known = self._known_beams[mount.name] = beam_of(mount)
        return known

    def look(self, sight: Sight) -> Surroundings:
        """What the beams say, measured from the vehicle's centre.

        A doubted reading counts where it says "near": above and below it ends the approach, but
        is no reason to move.
        """
        bearings: list[tuple[float, float]] = []
        ceiling_m = ground_m = math.inf
        for seen in sight.beams:
            reading, beam = seen.reading, self._beam(seen.mount)
            status = reading.status
            if status is RangeStatus.NO_SIGNAL or status is RangeStatus.OUT_OF_RANGE:
                continue
            distance_m = reading.range_m * beam.projection + beam.face_m
            if status is RangeStatus.SUSPECT:
                if distance_m >= self._beam_stop_m:
                    continue
                if beam.rise:
                    distance_m = self._beam_stop_m
            if beam.rise > 0:
                ceiling_m = min(ceiling_m, distance_m)
            elif beam.rise < 0:
                ground_m = min(ground_m, distance_m)
            elif distance_m < self._beam_stop_m:
                bearing = sight.yaw_rad + beam.yaw_rad
                bearings.append((math.cos(bearing), math.sin(bearing)))
        return Surroundings(tuple(bearings), ceiling_m, ground_m)


def towards(north: float, east: float, near: Directions) -> bool:
    """True when the vector has a component along one of the unit vectors."""
    return any(north * un + east * ue > ROUNDING for un, ue in near)


def without(vector: Vector3, un: float, ue: float) -> Vector3:
    """`vector` less its horizontal component along the unit vector (un, ue)."""
    along = vector[0] * un + vector[1] * ue
    return (vector[0] - along * un, vector[1] - along * ue, vector[2])
