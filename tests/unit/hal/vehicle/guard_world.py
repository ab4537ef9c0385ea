"""What the guard's tests stand in: a world of hits, and short ways to say sight and setpoint."""

import dataclasses
import math
from typing import Any

import pytest

from hal.config import BeamMount, Fence, GuardConfig, six_beams
from hal.frames import Vector3
from hal.readings import RangeReading, RangeStatus
from hal.setpoints import Setpoint
from hal.vehicle.guard import BeamSight, GuardVerdict, Sight

NOW_S = 100.0
HOME: Vector3 = (0.0, 0.0, -1.0)
CORRIDOR_M = 0.185
MPC_Z_P = 1.0
"""PX4's gain from height to velocity."""


def plain(**limits: Any) -> GuardConfig:
    """A guard without the newer limits, which would hide the borders of the others."""
    off = {"blind_s": 0.0, "acceleration_max_m_s2": 1e6, "yaw_rate_max_deg_s": 1e6}
    off["corridor_sigma_m"] = 1.0
    return GuardConfig(**(off | limits))


CONFIG = plain()
SQUARE = plain(fence=Fence.rectangle((-1.0, 1.0), (-1.0, 1.0)))
L_SHAPE = plain(
    fence=Fence(
        polygon_ne_m=((-1.0, -1.0), (1.0, -1.0), (1.0, 0.0), (0.0, 0.0), (0.0, 1.0), (-1.0, 1.0))
    )
)
MOUNTS = {mount.name: mount for mount in six_beams()}


@dataclasses.dataclass
class DiscWorld:
    """Seen space made of hits: motion is free until the centre is within CORRIDOR_M of one.

    From inside such a disc nothing is free. Everything within `seen_m` of the origin is seen.
    """

    hits: tuple[tuple[float, float], ...] = ()
    seen_m: float = math.inf
    asked: list[tuple[float, float]] = dataclasses.field(default_factory=list)

    def free_distance_m(
        self, position_ned_m: Vector3, heading_rad: float, limit_m: float, now_s: float
    ) -> float:
        self.asked.append((limit_m, now_s))
        north, east = position_ned_m[:2]
        un, ue = math.cos(heading_rad), math.sin(heading_rad)
        free = limit_m
        for hit_n, hit_e in self.hits:
            along = (hit_n - north) * un + (hit_e - east) * ue
            across = (hit_e - east) * un - (hit_n - north) * ue
            if math.hypot(along, across) < CORRIDOR_M:
                return 0.0
            if along > 0.0 and abs(across) < CORRIDOR_M:
                free = min(free, along - math.sqrt(CORRIDOR_M**2 - across**2))
        if math.hypot(north, east) > self.seen_m:
            return 0.0
        if self.seen_m < math.inf:
            inner = north * un + east * ue
            room = inner * inner - (north * north + east * east - self.seen_m**2)
            free = min(free, -inner + math.sqrt(room)) if room > 0.0 else 0.0
        return max(0.0, free)

    def clearance_m(self, position_ned_m: Vector3, limit_m: float) -> float:
        nearest = self.nearest_hit(position_ned_m, limit_m)
        return limit_m if nearest is None else nearest[0]

    def nearest_hit(self, position_ned_m: Vector3, limit_m: float) -> tuple[float, float] | None:
        north, east = position_ned_m[:2]
        distances = [(math.hypot(n - north, e - east), n, e) for n, e in self.hits]
        if not distances or min(distances)[0] > limit_m:
            return None
        distance, n, e = min(distances)
        return distance, math.atan2(e - east, n - north)


def sight(
    position: Vector3 = HOME,
    velocity: Vector3 = (0.0, 0.0, 0.0),
    *,
    hits: tuple[tuple[float, float], ...] = (),
    space: DiscWorld | None = None,
    beams: tuple[BeamSight, ...] = (),
    yaw_rad: float = 0.0,
    sigma_m: float = 0.0,
    stamp_s: float = NOW_S,
    ok: bool = True,
) -> Sight:
    return Sight(
        now_s=NOW_S,
        fused_stamp_s=stamp_s,
        position_ned_m=position,
        velocity_ned_m_s=velocity,
        yaw_rad=yaw_rad,
        space=space if space is not None else DiscWorld(hits),
        beams=beams,
        position_sigma_m=sigma_m,
        position_ok=ok,
    )


def setpoint(
    position: Vector3 = HOME,
    velocity: Vector3 = (0.0, 0.0, 0.0),
    yaw_rad: float = 0.0,
    stamp_s: float = NOW_S,
) -> Setpoint:
    return Setpoint(stamp_s, position, velocity, yaw_rad)


def beam(
    name: str,
    range_m: float,
    status: RangeStatus = RangeStatus.VALID,
    mount: BeamMount | None = None,
) -> BeamSight:
    reading = RangeReading(NOW_S, name, status, range_m, 1e-4, 0.02, 1.0)
    return BeamSight(mount if mount is not None else MOUNTS[name], reading)


def effective(
    verdict: GuardVerdict, seen: Sight, config: GuardConfig = CONFIG
) -> tuple[float, float]:
    """The horizontal velocity that PX4 will fly."""
    sp = verdict.setpoint
    return (
        sp.velocity_ned_m_s[0]
        + config.position_gain_per_s * (sp.position_ned_m[0] - seen.position_ned_m[0]),
        sp.velocity_ned_m_s[1]
        + config.position_gain_per_s * (sp.position_ned_m[1] - seen.position_ned_m[1]),
    )


def climb(verdict: GuardVerdict, seen: Sight) -> float:
    """The vertical velocity, up, that PX4 will fly."""
    sp = verdict.setpoint
    rise_m = seen.position_ned_m[2] - sp.position_ned_m[2]
    return -sp.velocity_ned_m_s[2] + MPC_Z_P * rise_m


def is_hold_at(verdict: GuardVerdict, position: Vector3) -> bool:
    return verdict.setpoint.position_ned_m == pytest.approx(position) and (
        verdict.setpoint.velocity_ned_m_s == (0.0, 0.0, 0.0)
    )
