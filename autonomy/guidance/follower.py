"""From a path to the velocity that flies it: a carrot just ahead, and a push away from walls.

A setpoint carries the vehicle's present position and this velocity. Should the stream freeze, PX4's
position loop pulls back towards that position, so that the vehicle cannot go farther than
speed / MPC_XY_P (0.21 m at 0.2 m/s) from where it was commanded last.
"""

import math

from autonomy.config import GuidanceConfig
from autonomy.geometry import Point, distance
from autonomy.guidance.path import FlownPath

# A carrot nearer than this makes the direction a matter of noise; where the path folds back on
# itself it is moved on by steps, or the vehicle would stand still for ever.
_CARROT_NEAREST_M = 0.06
_CARROT_STEP_M = 0.08


def carrot_direction(
    path: FlownPath, position: Point, velocity: Point, config: GuidanceConfig
) -> Point:
    """Unit direction (north, east) in which to fly now; (0, 0) at the end of the path.

    The carrot is `carrot_m` of path ahead of where the vehicle will be after `lead_s`.
    """
    ahead = (
        position[0] + velocity[0] * config.lead_s,
        position[1] + velocity[1] * config.lead_s,
    )
    path.advance(ahead)
    at = path.progress_m + config.carrot_m
    carrot = path.point_at(at)
    while distance(position, carrot) < _CARROT_NEAREST_M and at < path.length_m:
        at += _CARROT_STEP_M
        carrot = path.point_at(at)
    gap = distance(position, carrot)
    if gap < 1e-6:
        return (0.0, 0.0)
    return ((carrot[0] - position[0]) / gap, (carrot[1] - position[1]) / gap)


def arrival_speed(remaining_m: float, speed_m_s: float) -> float:
    """`speed_m_s`, falling with the distance to the end so that the vehicle does not overshoot."""
    return min(speed_m_s, max(0.05, 0.8 * remaining_m))


def push_away(
    velocity: Point, nearest: tuple[float, float] | None, config: GuidanceConfig
) -> Point:
    """`velocity` with a component of at least `push_speed_m_s` away from a hit that is too near.

    `nearest` is (distance_m, bearing_rad) of the nearest hit, or None.
    """
    if nearest is None or nearest[0] >= config.push_below_m:
        return velocity
    away = (-math.cos(nearest[1]), -math.sin(nearest[1]))
    component = velocity[0] * away[0] + velocity[1] * away[1]
    missing = max(0.0, config.push_speed_m_s - component)
    return (velocity[0] + missing * away[0], velocity[1] + missing * away[1])
