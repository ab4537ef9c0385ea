"""Artificial potential field: downhill in a field that pulls to the goal and pushes from hits.

Khatib, "Real-time obstacle avoidance for manipulators and mobile robots" (IJRR 5(1), 1986), with
the push of Ge and Cui, "New potential functions for mobile robot path planning" (IEEE Trans. on
Robotics and Automation 16(5), 2000): it fades with the distance to the goal, and draws to the goal
itself, so that a goal beside an obstacle is reached. Khatib knows obstacles, each with one nearest
point; here the nearest hit of every 15 degrees stands for one. Has no memory and never gives up: in
a local minimum it waits for the time limit.
"""

import math

import msgspec

from tools.bench.rivals import kernels
from tools.bench.rivals.interface import Answer, Craft, View


class Gains(msgspec.Struct, frozen=True):
    """Chosen by `tuning.py`: `strength` in m^3 of push to a pull of 1, `influence_m` of an
    obstacle beyond the body.
    """

    strength: float = 0.0003
    influence_m: float = 0.2


class PotentialField:
    """Fails in local minima; that is its nature, not its tuning."""

    def __init__(self, craft: Craft, gains: Gains | None = None) -> None:
        self._craft, self._gains = craft, gains if gains is not None else Gains()

    def decide(self, view: View) -> Answer:
        """Down the field: top speed where the force is at least the pull from afar."""
        (n, e), (goal_n, goal_e) = view.point, view.goal
        fn, fe = kernels.push(
            view.near,
            n,
            e,
            goal_n,
            goal_e,
            self._craft.body_m,
            self._gains.strength,
            self._gains.influence_m,
        )
        away_m = max(math.hypot(goal_n - n, goal_e - e), 1e-6)
        fn += (goal_n - n) / away_m
        fe += (goal_e - e) / away_m
        share = self._craft.speed_m_s / max(1.0, math.hypot(fn, fe))
        return (share * fn, share * fe)
