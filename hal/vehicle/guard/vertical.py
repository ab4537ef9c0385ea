"""Climb rate, altitude band, ceiling and ground."""

import math

from hal.config import GuardConfig
from hal.frames import Vector3
from hal.vehicle.guard.around import Surroundings
from hal.vehicle.guard.limits import ALTITUDE, CEILING, CLIMB, GROUND

HEIGHT_GAIN_PER_S = 1.0
"""PX4's MPC_Z_P: the height a limit is approached with is that of a position error."""
RETREAT_M_S = 0.1
"""How fast the guard leaves a ceiling or a table that is too near, at most."""
ROUNDING = 1e-9


def limited(
    config: GuardConfig,
    offset: Vector3,
    velocity: Vector3,
    altitude: float,
    around: Surroundings,
    limits: list[str],
) -> tuple[Vector3, Vector3]:
    """Offset and velocity with their vertical part scaled, or a retreat from a surface."""
    lowest = min(config.altitude_min_m, altitude)
    highest = max(config.altitude_max_m, altitude)
    rise = -offset[2]
    if not lowest - ROUNDING <= altitude + rise <= highest + ROUNDING:
        limits.append(ALTITUDE)
        rise = min(highest, max(lowest, altitude + rise)) - altitude
    climb = -velocity[2]
    wanted = max(abs(climb + HEIGHT_GAIN_PER_S * rise), abs(climb))
    reason: str | None = None
    if wanted > config.climb_max_m_s + ROUNDING:
        reason = CLIMB
        rise *= config.climb_max_m_s / wanted
        climb *= config.climb_max_m_s / wanted
    effective = climb + HEIGHT_GAIN_PER_S * rise
    slowest, fastest = climb_range(config, altitude, around)
    limit = None
    if effective > fastest[0] + ROUNDING:
        limit = fastest
    elif effective < slowest[0] - ROUNDING:
        limit = slowest
    if limit is not None:
        allowed, reason = limit
        if allowed * effective >= 0.0 and abs(allowed) < abs(effective):
            rise, climb = rise * allowed / effective, climb * allowed / effective
        else:
            rise, climb = allowed / HEIGHT_GAIN_PER_S, 0.0
    if reason is not None and reason not in limits:
        limits.append(reason)
    if reason is None and rise == -offset[2]:
        return offset, velocity
    return _leashed_at(config.leash_m, offset, rise), (velocity[0], velocity[1], -climb)


def climb_range(
    config: GuardConfig, altitude_m: float, around: Surroundings
) -> tuple[tuple[float, str], tuple[float, str]]:
    """((least, its limit), (greatest, its limit)) velocity up that PX4 may fly.

    Both are beyond zero on the same side when a surface is too near: the way back to the
    height at which it is `beam_stop_m` away. Between two such surfaces that height is the
    middle.
    """
    above_m = max(0.0, config.altitude_max_m - altitude_m)
    below_m = max(0.0, altitude_m - config.altitude_min_m)
    up_m, down_m = around.ceiling_m - config.beam_stop_m, around.ground_m - config.beam_stop_m
    if below_m == 0.0:
        # Below the band it may stand on the floor: no reason to take off.
        down_m = math.inf
    if up_m < 0.0 and down_m < 0.0:
        up_m = (up_m - down_m) / 2.0
        down_m = -up_m
    up_m, down_m = max(up_m, -max(0.0, down_m)), max(down_m, -max(0.0, up_m))
    up_limit = CEILING if up_m < above_m else ALTITUDE
    down_limit = GROUND if down_m < below_m else ALTITUDE
    retreat_m_s = min(RETREAT_M_S, config.climb_max_m_s, HEIGHT_GAIN_PER_S * config.leash_m)
    fastest = max(-retreat_m_s, HEIGHT_GAIN_PER_S * max(-below_m, min(up_m, above_m)))
    slowest = max(-retreat_m_s, HEIGHT_GAIN_PER_S * max(-above_m, min(down_m, below_m)))
    return (-slowest, down_limit), (fastest, up_limit)


def _leashed_at(leash_m: float, offset: Vector3, rise_m: float) -> Vector3:
    """`offset` with another height, shortened horizontally where the leash asks for it."""
    level_m = math.hypot(offset[0], offset[1])
    leash2 = leash_m**2
    room_m = math.sqrt(leash2 - min(leash2, rise_m * rise_m))
    factor = room_m / level_m if level_m > room_m * (1.0 + ROUNDING) else 1.0
    return (offset[0] * factor, offset[1] * factor, -rise_m)
