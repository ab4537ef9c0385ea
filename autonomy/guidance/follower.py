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
_PUSH_DOUBLES_IN_M, _PUSH_MOST = 0.03, 3.0
_AT_REST_M_S = 0.03
_LEAVING = 0.17
"""Cosine to "away" of a motion that gains the clearance which the map asks for."""


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
    velocity: Point,
    nearest: tuple[float, float] | None,
    config: GuidanceConfig,
    flown: Point = (0.0, 0.0),
) -> Point:
    """`velocity` with a component away from a hit that is too near.

    `nearest` is (distance_m, bearing_rad) of the nearest hit, or None; `flown` the vehicle's own
    velocity. The component is at least `push_speed_m_s` at `push_below_m`, and grows from there to
    `_PUSH_MOST` times as much: the autopilot's own velocity is wrong by some cm/s for seconds.

    While the vehicle closes in, or nearer than `slowest_at_m` is not on its way out, it is pushed
    away and nothing else: the guard brakes what feeds a motion that it allows no more, and would
    take the push with it.
    """
    if nearest is None or nearest[0] >= config.push_below_m:
        return velocity
    away = (-math.cos(nearest[1]), -math.sin(nearest[1]))
    if _feeds_the_approach(nearest[0], flown, away, config):
        velocity = (0.0, 0.0)
    deeper = (config.push_below_m - nearest[0]) / _PUSH_DOUBLES_IN_M
    push_m_s = config.push_speed_m_s * min(_PUSH_MOST, 1.0 + deeper)
    component = velocity[0] * away[0] + velocity[1] * away[1]
    missing = max(0.0, push_m_s - component)
    return (velocity[0] + missing * away[0], velocity[1] + missing * away[1])


def _feeds_the_approach(
    distance_m: float, flown: Point, away: Point, config: GuidanceConfig
) -> bool:
    """True where flying on along the path would feed a motion that has to end first."""
    moving_m_s = math.hypot(*flown)
    leaving_m_s = flown[0] * away[0] + flown[1] * away[1]
    if distance_m >= config.slowest_at_m:
        return leaving_m_s < -_AT_REST_M_S
    return moving_m_s > _AT_REST_M_S and leaving_m_s < _LEAVING * moving_m_s
