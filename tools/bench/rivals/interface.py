"""What every rival is given at a tick, and what it may answer.

A rival plans, and nothing else: sensing, map, take-off, turning, speed rule, arrival, landing and
guard are the harness's, and the same for all.
"""

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from autonomy.config import Config
from autonomy.geometry import Point
from autonomy.perception.obstacle_map import ObstacleMap

Floats = NDArray[np.float64]

NEAR_M = 1.5
"""`View.near` holds what is within this of the vehicle."""


@dataclass(frozen=True, slots=True)
class View:
    """What is known at a tick. All in the mission frame, (north, east) in m.

    `hits` (n, 2): what beams have met, and where the fence stands; `near`: those within NEAR_M.
    `version` grows whenever the map's cells do. `space` is the map itself, with what was seen free.
    """

    now_s: float
    dt_s: float
    point: Point
    velocity: Point
    goal: Point
    hits: Floats
    near: Floats
    version: int
    space: ObstacleMap


@dataclass(frozen=True, slots=True)
class GivesUp:
    """No way, in a sentence. Not `certain`: the harness looks round, forgets as T3DRM's ladder does
    and asks again; `certain`: the rival has proved it, and the flight ends.
    """

    why: str
    certain: bool = False


Answer = Point | GivesUp
"""A velocity (north, east) in m/s, or no way."""


class Rival(Protocol):
    """A planner in closed loop. Deterministic; one object flies one flight."""

    def decide(self, view: View) -> Answer:
        """What to fly now."""


@dataclass(frozen=True, slots=True)
class Craft:
    """What a rival may know of the vehicle: the same numbers that T3DRM has.

    `keep_out_m` is T3DRM's floor (body and hard clearance), `range_m` how far the beams see.
    """

    body_m: float
    keep_out_m: float
    speed_m_s: float
    range_m: float
    acceleration_m_s2: float
    braking_m_s2: float
    fence: tuple[float, float, float, float]
    """The fence's least and largest north, least and largest east."""
    config: Config

    @classmethod
    def of(cls, config: Config) -> "Craft":
        """The configured vehicle."""
        body_m = config.body.radius_m
        return cls(
            body_m=body_m,
            keep_out_m=body_m + config.planner.hard_clearance_m,
            speed_m_s=config.guidance.speed_max_m_s,
            range_m=config.beams.max_m,
            acceleration_m_s2=config.guard.acceleration_max_m_s2,
            braking_m_s2=config.guard.braking_m_s2,
            fence=config.guard.fence.bounds(),
            config=config,
        )


def towards(bearing_rad: float, speed_m_s: float) -> Point:
    """The velocity of that bearing and speed."""
    return (speed_m_s * math.cos(bearing_rad), speed_m_s * math.sin(bearing_rad))
