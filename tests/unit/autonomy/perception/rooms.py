"""A world of walls and pillars that answers rays exactly, and a vehicle that scans it."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from autonomy.geometry import Point, segment_distance
from autonomy.model import FusedState
from autonomy.perception.obstacle_map import ObstacleMap
from autonomy.perception.projection import Projector
from hal.config import BeamMount, BeamsConfig
from hal.readings import RangeReading, RangeStatus

MIN_M, MAX_M = 0.02, 1.0
TURN_RAD_S = math.radians(60.0)
LATENCY_S = 0.02

Wall = tuple[Point, Point]
Disc = tuple[Point, float]


@dataclass(frozen=True)
class Room:
    walls: tuple[Wall, ...] = ()
    discs: tuple[Disc, ...] = ()

    def range_m(self, origin: Point, bearing_rad: float) -> float:
        """Distance to the first surface along the ray, inf for none."""
        un, ue = math.cos(bearing_rad), math.sin(bearing_rad)
        nearest = math.inf
        for (an, ae), (bn, be) in self.walls:
            wn, we = bn - an, be - ae
            det = un * -we + wn * ue
            if abs(det) > 1e-12:
                n, e = an - origin[0], ae - origin[1]
                along = (n * -we + wn * e) / det
                part = (un * e - ue * n) / det
                if along >= 0.0 and 0.0 <= part <= 1.0:
                    nearest = min(nearest, along)
        for (cn, ce), radius in self.discs:
            n, e = cn - origin[0], ce - origin[1]
            a, b = n * un + e * ue, e * un - n * ue
            if abs(b) < radius and a > 0.0:
                nearest = min(nearest, a - math.sqrt(radius * radius - b * b))
        return nearest

    def cone_range_m(self, origin: Point, bearing_rad: float, half_angle_rad: float) -> float:
        """Distance to the nearest surface within the angle, inf for none; by rays 0.5 deg apart."""
        count = 1 + 2 * math.ceil(half_angle_rad / math.radians(0.5))
        turns = np.linspace(-half_angle_rad, half_angle_rad, count)
        return min(self.range_m(origin, bearing_rad + float(turn)) for turn in turns)

    def surface_distance_m(self, point: Point) -> float:
        """Unsigned distance from the point to the nearest surface."""
        walls = [segment_distance(point, a, b) for a, b in self.walls]
        discs = [abs(math.dist(point, c) - r) for c, r in self.discs]
        return min(walls + discs, default=math.inf)

    def reading(self, stamp_s: float, beam: str, true_m: float, noise_m: float) -> RangeReading:
        measured = true_m + noise_m
        if true_m > MAX_M:
            status, value = RangeStatus.OUT_OF_RANGE, MAX_M
        elif measured < MIN_M:
            status, value = RangeStatus.TOO_NEAR, MIN_M
        else:
            status, value = RangeStatus.VALID, measured
        return RangeReading(stamp_s, beam, status, value, 1e-4, MIN_M, MAX_M)


def fused_at(
    stamp_s: float,
    point: Point,
    yaw_rad: float = 0.0,
    yaw_rate_rad_s: float = 0.0,
    down_m: float = -1.0,
    velocity_ne_m_s: Point = (0.0, 0.0),
    **more: float,
) -> FusedState:
    return FusedState(
        stamp_s=stamp_s,
        position_ned_m=(point[0], point[1], down_m),
        velocity_ned_m_s=(*velocity_ne_m_s, 0.0),
        yaw_rad=yaw_rad,
        position_sigma_m=0.02,
        height_agl_m=-down_m,
        ok=True,
        yaw_rate_rad_s=yaw_rate_rad_s,
        **more,  # type: ignore[arg-type]  # roll and pitch only
    )


@dataclass
class Flight:
    """A vehicle on a path `where(time)`, turning; its readings come `LATENCY_S` late."""

    room: Room
    obstacles: ObstacleMap
    where: Callable[[float], Point]
    beams: BeamsConfig = field(default_factory=BeamsConfig)
    turn_rad_s: float = TURN_RAD_S
    rate_hz: float = 20.0
    noise: np.random.Generator | None = None
    drift_m: float = 0.02
    now_s: float = 0.0

    def __post_init__(self) -> None:
        self.projector = Projector(self.beams)
        self.drift = np.zeros(2)

    def yaw_at(self, time_s: float) -> float:
        return self.turn_rad_s * time_s

    def fly(self, seconds: float) -> None:
        for _ in range(round(seconds * self.rate_hz)):
            self.tick()

    def tick(self) -> None:
        self.now_s += 1.0 / self.rate_hz
        taken_at = self.now_s - LATENCY_S
        true = self.where(taken_at)
        yaw = self.yaw_at(taken_at)
        readings = tuple(
            self._read(mount, true, yaw) for mount in self.beams.mounts if mount.horizontal
        )
        here = self.where(self.now_s)
        self._wander()
        believed = (here[0] + float(self.drift[0]), here[1] + float(self.drift[1]))
        soon = self.where(self.now_s + 1e-3)
        velocity = (1e3 * (soon[0] - here[0]), 1e3 * (soon[1] - here[1]))
        yaw_now = self.yaw_at(self.now_s)
        fused = fused_at(self.now_s, believed, yaw_now, self.turn_rad_s, velocity_ne_m_s=velocity)
        self.obstacles.update(self.now_s, self.projector.step(fused, readings))

    def _wander(self) -> None:
        """Position error of `drift_m`, correlated over 2 s."""
        if self.noise is not None:
            keep = math.exp(-1.0 / (2.0 * self.rate_hz))
            self.drift = keep * self.drift + self.drift_m * math.sqrt(
                1.0 - keep * keep
            ) * self.noise.standard_normal(2)

    def _read(self, mount: BeamMount, centre: Point, yaw_rad: float) -> RangeReading:
        c, s = math.cos(yaw_rad), math.sin(yaw_rad)
        face = (
            centre[0] + c * mount.forward_m - s * mount.right_m,
            centre[1] + s * mount.forward_m + c * mount.right_m,
        )
        half_angle = math.radians(self.beams.half_angle_deg(mount.name))
        true_m = self.room.cone_range_m(face, yaw_rad + math.radians(mount.yaw_deg), half_angle)
        noise_m = 0.0
        if self.noise is not None and true_m <= MAX_M:
            noise_m = float(self.noise.normal(0.0, 0.01 + 0.01 * true_m))
        return self.room.reading(self.now_s - LATENCY_S, mount.name, true_m, noise_m)
