"""How far a vehicle still travels, by its speed, and how fast it may be, by the space it has."""

import math

from hal.config import GuardConfig


def stopping_distance_m(speed_m_s: float, reaction_s: float, braking_m_s2: float) -> float:
    """How far a vehicle travels from `speed_m_s` to rest: v T + v^2 / (2 a)."""
    return speed_m_s * reaction_s + speed_m_s * speed_m_s / (2.0 * braking_m_s2)


def stopping_speed_m_s(distance_m: float, reaction_s: float, braking_m_s2: float) -> float:
    """The speed that stops within `distance_m`: -a T + sqrt((a T)^2 + 2 a d); 0 for d <= 0.

    Inverse of `stopping_distance_m`.
    """
    at = braking_m_s2 * reaction_s
    return math.sqrt(at * at + 2.0 * braking_m_s2 * max(0.0, distance_m)) - at


def needed_distance_m(speed_m_s: float, config: GuardConfig) -> float:
    """How far ahead must be free for a setpoint of that speed.

    For the stop of a vehicle that is told to hold, and for the flight of one that is never told
    anything again (`blind_s`).
    """
    stop_m = stopping_distance_m(speed_m_s, config.reaction_s, config.braking_m_s2)
    return max(stop_m, speed_m_s * config.blind_s)


def allowed_speed_m_s(distance_m: float, config: GuardConfig) -> float:
    """The speed of a setpoint that `distance_m` of free way allow; inverse of `needed_distance_m`.

    Not more than the top speed.
    """
    room_m = max(0.0, distance_m)
    speed = stopping_speed_m_s(room_m, config.reaction_s, config.braking_m_s2)
    if speed * config.blind_s > room_m:
        speed = room_m / config.blind_s
    return min(speed, config.speed_max_m_s)
