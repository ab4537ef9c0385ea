"""Range readings to rays in NED, with the pose that the vehicle had when each was measured.

While the vehicle turns at 60 deg/s a latency of 30 ms is 1.8 deg, or 3 cm at 1 m: more than the
sensor's own error. So poses are kept for a moment, and each reading gets the one of its time.
"""

import math
from collections import deque
from collections.abc import Iterable
from enum import IntEnum

import msgspec

from autonomy.geometry import Point
from autonomy.model import FusedState
from hal.config import BeamsConfig
from hal.frames import Turn, Vector3, wrap_pi
from hal.readings import RangeReading, RangeStatus


class RayKind(IntEnum):
    """What a ray says about the line that it measured."""

    NOTHING = 0  # no measurement: says nothing, but breaks the sequence of its beam
    FREE = 1  # free up to its length, unknown beyond
    HIT = 2  # free up to its length, an obstacle at its end


class Ray(msgspec.Struct, frozen=True, gc=False):
    """One reading of one horizontal beam, laid into the plane of flight.

    `origin_ned_m` is the sensor's face and `centre` the vehicle's centre (north, east) at
    `stamp_s`, the time of measurement. `length_m` is the horizontal length, 0 for NOTHING.
    `beam` is the index of the mount in the configuration.

    With `half_angle_rad` above 0 it is a cone: free in every direction within that angle of
    `bearing_rad`, and what it hit is somewhere on the arc at `length_m`. No farther than
    `free_m` is a cone free (infinite: up to its arc).
    """

    stamp_s: float
    beam: int
    kind: RayKind
    origin_ned_m: Vector3
    bearing_rad: float
    elevation_rad: float
    length_m: float
    centre: Point
    half_angle_rad: float = 0.0
    free_m: float = math.inf


class Pose(msgspec.Struct, frozen=True, gc=False):
    """Where the vehicle was, and how it moved on from there."""

    stamp_s: float
    position_ned_m: Vector3
    velocity_ned_m_s: Vector3
    roll_rad: float
    pitch_rad: float
    yaw_rad: float
    yaw_rate_rad_s: float


class _Mount(msgspec.Struct, frozen=True):
    """A beam's index, direction and face in the body frame, and half the angle that it sees."""

    index: int
    direction_frd: Vector3
    face_frd_m: Vector3
    half_angle_rad: float


_UPRIGHT_DEG = 60.0
"""A beam steeper than this measures the surface above or below."""
_SURFACE_SHARE = 0.95
_SURFACE_M = 0.03
"""A cone's return from at most this much before a floor, or from beyond, may be the floor's."""
_LAST = 0.95
"""A cone's return from farther than this share of the maximum range is no obstacle yet: a cone
that sees nothing is not certain to have looked farther, so no part of such an arc is ruled out."""

_LEVEL = Turn.of(0.0, 0.0, 0.0)

HISTORY_POSES = 40
# Across a longer hole in the poses, or farther beyond their ends, nothing is projected.
HOLE_MAX_S = 0.25
EXTRAPOLATION_MAX_S = 0.1


class Projector:
    """Keeps the recent poses and turns readings into rays.

    Only beams near the horizon (`BeamMount.horizontal`) map the plane; readings of the others,
    and of beams that are not mounted, give no ray. `half_height_m` is half the body's height: a
    ray is used as far as it stays within the slab that the body sweeps, so that a tilted beam
    neither puts the floor into the map nor calls space free that it passed above.

    A cone is free as far as its axis stays within the slab, and what it returns from is taken for
    an obstacle as long as any of it is within. Where its edge reaches the floor or the ceiling, as
    near as the beams down and up measured them last, the return may be theirs: what is nearer is
    free, and no obstacle is known.
    """

    def __init__(self, beams: BeamsConfig, half_height_m: float = 0.08) -> None:
        self._half_height_m = half_height_m
        self._poses: deque[Pose] = deque(maxlen=HISTORY_POSES)
        self._stale_after_s = beams.stale_after_s
        self._upright: dict[str, int] = {}
        self._surfaces: dict[int, tuple[float, float]] = {}
        self._mounts: dict[str, _Mount] = {}
        for index, mount in enumerate(beams.mounts):
            if abs(mount.pitch_deg) > _UPRIGHT_DEG:
                self._upright[mount.name] = 1 if mount.pitch_deg > 0.0 else -1
            if mount.horizontal:
                yaw, pitch = math.radians(mount.yaw_deg), math.radians(mount.pitch_deg)
                level = math.cos(pitch)
                self._mounts[mount.name] = _Mount(
                    index,
                    (level * math.cos(yaw), level * math.sin(yaw), -math.sin(pitch)),
                    (mount.forward_m, mount.right_m, mount.down_m),
                    math.radians(beams.half_angle_deg(mount.name)),
                )

    def step(self, fused: FusedState, ranges: Iterable[RangeReading]) -> tuple[Ray, ...]:
        """Remember the pose of `fused`, and project `ranges` with the poses of their times.

        A state that is not ok is not remembered and gives no rays; neither does a reading from
        before or after the known poses.
        A jump of the frame (`fused.frame_shift_ned_m`) moves the remembered poses along.
        """
        if any(fused.frame_shift_ned_m):
            self._shift(fused.frame_shift_ned_m)
        if not fused.ok:
            return ()
        self._remember(fused)
        rays = []
        stamp_s, pose, turn = math.nan, None, _LEVEL
        for reading in ranges:
            mount = self._mounts.get(reading.beam)
            if mount is None:
                self._note_surface(reading)
                continue
            if reading.stamp_s != stamp_s:
                stamp_s = reading.stamp_s
                pose = self.pose_at(stamp_s)
                if pose is not None:
                    turn = Turn.of(pose.roll_rad, pose.pitch_rad, pose.yaw_rad)
            if pose is not None:
                rays.append(self._ray(pose, turn, mount, reading))
        return tuple(rays)

    def pose_at(self, time_s: float) -> Pose | None:
        """The pose at `time_s`, or None when no remembered one supports it.

        Interpolated between its neighbours; up to 0.1 s beyond the ends of the history the
        nearest pose is carried on with its velocity and yaw rate.
        """
        after = None
        for before in reversed(self._poses):
            if before.stamp_s <= time_s:
                if after is None:
                    return _carried(before, time_s)
                return _between(before, after, time_s)
            after = before
        return None if after is None else _carried(after, time_s)

    def _remember(self, fused: FusedState) -> None:
        if self._poses and fused.stamp_s <= self._poses[-1].stamp_s:
            return
        self._poses.append(
            Pose(
                fused.stamp_s,
                fused.position_ned_m,
                fused.velocity_ned_m_s,
                fused.roll_rad,
                fused.pitch_rad,
                fused.yaw_rad,
                fused.yaw_rate_rad_s,
            )
        )

    def _note_surface(self, reading: RangeReading) -> None:
        """Remember how far away a beam that looks up or down saw nothing."""
        rise = self._upright.get(reading.beam)
        if rise is not None and reading.status not in (RangeStatus.NO_SIGNAL, RangeStatus.SUSPECT):
            self._surfaces[rise] = (reading.stamp_s, reading.range_m)

    def _surface_m(self, rise: int, pose: Pose) -> float:
        """Height of the free space above (`rise` 1) or below (-1) the vehicle's centre.

        Without a fresh reading: below, that over the take-off point; above, nothing is known to be
        there.
        """
        measured = self._surfaces.get(rise)
        if measured is not None and pose.stamp_s - measured[0] <= self._stale_after_s:
            return measured[1]
        return max(0.0, -pose.position_ned_m[2]) if rise < 0 else math.inf

    def _shift(self, delta: Vector3) -> None:
        moved = [
            msgspec.structs.replace(
                pose,
                position_ned_m=(
                    pose.position_ned_m[0] + delta[0],
                    pose.position_ned_m[1] + delta[1],
                    pose.position_ned_m[2] + delta[2],
                ),
            )
            for pose in self._poses
        ]
        self._poses.clear()
        self._poses.extend(moved)

    def _ray(self, pose: Pose, turn: Turn, mount: _Mount, reading: RangeReading) -> Ray:
        north, east, down = turn.to_ned(mount.direction_frd)
        position = pose.position_ned_m
        face = (0.0, 0.0, 0.0)
        if mount.face_frd_m != face:
            face = turn.to_ned(mount.face_frd_m)
        level = math.hypot(north, east)
        elevation = math.asin(max(-1.0, min(1.0, -down)))
        if mount.half_angle_rad > 0.0:
            kind, length, free = self._cone(pose, mount, reading, face[2], elevation)
        else:
            kind, length = self._kind_and_length(reading, face[2], down)
            free = math.inf
        return Ray(
            pose.stamp_s,
            mount.index,
            kind,
            (position[0] + face[0], position[1] + face[1], position[2] + face[2]),
            math.atan2(east, north),
            elevation,
            length * level,
            (position[0], position[1]),
            mount.half_angle_rad,
            free * level,
        )

    def _kind_and_length(
        self, reading: RangeReading, face_down_m: float, slope_down: float
    ) -> tuple[RayKind, float]:
        """What the reading says within the body's slab, and up to which slant length."""
        status = reading.status
        if status in (RangeStatus.NO_SIGNAL, RangeStatus.SUSPECT):
            return RayKind.NOTHING, 0.0
        kind = RayKind.FREE if status is RangeStatus.OUT_OF_RANGE else RayKind.HIT
        inside = self._half_height_m
        if abs(face_down_m) > inside:
            return RayKind.NOTHING, 0.0
        way = inside - face_down_m if slope_down > 0.0 else inside + face_down_m
        leaves_at = way / abs(slope_down) if slope_down != 0.0 else math.inf
        if reading.range_m > leaves_at:
            return RayKind.FREE, leaves_at
        return kind, reading.range_m

    def _cone(
        self,
        pose: Pose,
        mount: _Mount,
        reading: RangeReading,
        face_down_m: float,
        elevation_rad: float,
    ) -> tuple[RayKind, float, float]:
        """The same for a wide beam, and how far it is free."""
        kind, length = self._kind_and_length(reading, face_down_m, -math.sin(elevation_rad))
        if kind is RayKind.NOTHING or reading.status is RangeStatus.OUT_OF_RANGE:
            return kind, length, math.inf
        steepness = max(0.0, abs(elevation_rad) - mount.half_angle_rad)
        way = self._half_height_m + (face_down_m if elevation_rad > 0.0 else -face_down_m)
        range_m = reading.range_m
        open_m = self._surface_from_m(pose, mount.half_angle_rad, face_down_m, elevation_rad)
        if range_m * math.sin(steepness) > way or range_m >= min(open_m, _LAST * reading.max_m):
            return RayKind.FREE, length, math.inf
        return RayKind.HIT, range_m, length

    def _surface_from_m(
        self, pose: Pose, half_angle_rad: float, face_down_m: float, elevation_rad: float
    ) -> float:
        """From which range on a cone's return may be that of the floor or the ceiling."""
        nearest_m = math.inf
        for rise in (-1, 1):
            steepness = rise * elevation_rad + half_angle_rad
            if steepness > 0.0:
                height_m = self._surface_m(rise, pose) + rise * face_down_m
                nearest_m = min(nearest_m, height_m / math.sin(steepness))
        return _SURFACE_SHARE * nearest_m - _SURFACE_M


def _carried(pose: Pose, time_s: float) -> Pose | None:
    """The pose moved to `time_s` with its own rates; None when that is too far away."""
    step = time_s - pose.stamp_s
    if step == 0.0:
        return pose
    if abs(step) > EXTRAPOLATION_MAX_S:
        return None
    position, velocity = pose.position_ned_m, pose.velocity_ned_m_s
    return Pose(
        time_s,
        (
            position[0] + step * velocity[0],
            position[1] + step * velocity[1],
            position[2] + step * velocity[2],
        ),
        velocity,
        pose.roll_rad,
        pose.pitch_rad,
        wrap_pi(pose.yaw_rad + step * pose.yaw_rate_rad_s),
        pose.yaw_rate_rad_s,
    )


def _between(before: Pose, after: Pose, time_s: float) -> Pose | None:
    """Linear in between, yaw the short way round; None across a hole in the poses."""
    span = after.stamp_s - before.stamp_s
    if span > HOLE_MAX_S:
        near = before if time_s - before.stamp_s < after.stamp_s - time_s else after
        return _carried(near, time_s)
    f = (time_s - before.stamp_s) / span
    p, q = before.position_ned_m, after.position_ned_m
    return Pose(
        time_s,
        (p[0] + f * (q[0] - p[0]), p[1] + f * (q[1] - p[1]), p[2] + f * (q[2] - p[2])),
        after.velocity_ned_m_s,
        before.roll_rad + f * (after.roll_rad - before.roll_rad),
        before.pitch_rad + f * (after.pitch_rad - before.pitch_rad),
        wrap_pi(before.yaw_rad + f * wrap_pi(after.yaw_rad - before.yaw_rad)),
        before.yaw_rate_rad_s + f * (after.yaw_rate_rad_s - before.yaw_rate_rad_s),
    )
