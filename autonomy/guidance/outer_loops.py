"""Table 3's outer loops beside PX4's own: what they add to the velocity that is asked for.

PX4 closes a position and a velocity loop itself; with the default gains of 0 these add nothing.
They are for vehicles that PX4's loops leave with an offset (drag, a bad trim).
"""

from autonomy.config import GuidanceConfig
from autonomy.geometry import Point
from autonomy.guidance.pid import Pid

ADDED_MAX_M_S = 0.1
"""What a loop may add per axis; the guard limits the sum."""


class OuterLoops:
    """One PID per horizontal axis and loop; a loop that is not used forgets its past."""

    def __init__(self, config: GuidanceConfig) -> None:
        self._position = (
            Pid(config.position, ADDED_MAX_M_S),
            Pid(config.position, ADDED_MAX_M_S),
        )
        self._velocity = (
            Pid(config.velocity, ADDED_MAX_M_S),
            Pid(config.velocity, ADDED_MAX_M_S),
        )

    def hold(self, target: Point, position: Point, dt_s: float) -> Point:
        """Position -> velocity: what to add to a hold at `target`."""
        for loop in self._velocity:
            loop.reset()
        north, east = self._position
        return (
            north.step(target[0], position[0], dt_s),
            east.step(target[1], position[1], dt_s),
        )

    def track(self, wanted: Point, velocity: Point, dt_s: float) -> Point:
        """Velocity error -> velocity: `wanted` and what to add to it so that it is flown."""
        for loop in self._position:
            loop.reset()
        north, east = self._velocity
        return (
            wanted[0] + north.step(wanted[0], velocity[0], dt_s),
            wanted[1] + east.step(wanted[1], velocity[1], dt_s),
        )
