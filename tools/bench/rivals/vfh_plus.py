"""VFH+: a polar histogram with hysteresis, openings, and a cost of three turns.

Ulrich and Borenstein, "VFH+: reliable obstacle avoidance for fast mobile robots" (ICRA 1998); the
local planner of PX4-Avoidance descends from it (a histogram, and a cost of goal, heading and the
direction before). Certainty is 1 for every hit of the map. The masked histogram is left out: it is
for vehicles that cannot turn on the spot, and a multirotor flies any way it likes. "Heading" is the
direction of motion, as the nose turns all the time. Hits farther than the goal do not count. It has
no memory beyond one direction, and never gives up.
"""

import math

import msgspec
import numpy as np

from autonomy.geometry import bearing, distance
from hal.frames import wrap_pi
from tools.bench.rivals import kernels
from tools.bench.rivals.interface import Answer, Craft, View, towards

SECTORS = 72
WIDE = 16
"""Sectors of an opening that has two sides (s_max of the paper, at its 5 degrees)."""
TARGET, HEADING, BEFORE = 5.0, 2.0, 2.0
"""The paper's mu1, mu2, mu3 (mu1 > mu2 + mu3: goal-directed)."""
_MOVING_M_S = 0.05


class Gains(msgspec.Struct, frozen=True):
    """Chosen by `tuning.py`: the active window, what hits are enlarged by beyond the keep-out, and
    the thresholds of the hysteresis.
    """

    window_m: float = 0.7
    margin_m: float = 0.0
    low: float = 0.2
    high: float = 1.0


class VfhPlus:
    """One flight's histogram and last direction."""

    def __init__(self, craft: Craft, gains: Gains | None = None) -> None:
        self._craft, self._gains = craft, gains if gains is not None else Gains()
        self._blocked = np.zeros(SECTORS, dtype=np.uint8)
        self._before_rad: float | None = None

    def decide(self, view: View) -> Answer:
        """Along the cheapest candidate; nothing where every sector is blocked."""
        gains, (n, e) = self._gains, view.point
        enlarged_m = self._craft.keep_out_m + gains.margin_m
        window_m = min(gains.window_m, distance(view.point, view.goal) + enlarged_m)
        kernels.polar(view.near, n, e, enlarged_m, window_m, gains.low, gains.high, self._blocked)
        target = bearing(view.point, view.goal)
        choices = candidates(self._blocked.tolist(), target)
        if not choices:
            return (0.0, 0.0)
        heading = target
        if math.hypot(*view.velocity) > _MOVING_M_S:
            heading = math.atan2(view.velocity[1], view.velocity[0])
        before = target if self._before_rad is None else self._before_rad

        def cost(angle: float) -> float:
            return (
                TARGET * abs(wrap_pi(angle - target))
                + HEADING * abs(wrap_pi(angle - heading))
                + BEFORE * abs(wrap_pi(angle - before))
            )

        self._before_rad = min(choices, key=cost)
        return towards(self._before_rad, self._craft.speed_m_s)


def candidates(blocked: list[int], target_rad: float) -> list[float]:
    """Bearings worth flying: a narrow opening's middle, a wide one's two sides and, if it lies in
    between, the target. `blocked` has one entry for each sector, the first about north.
    """
    step = 2.0 * math.pi / len(blocked)
    if not any(blocked):
        return [target_rad]
    found: list[float] = []
    for first, size in openings(blocked):
        if size < WIDE:
            found.append((first + 0.5 * (size - 1)) * step)
            continue
        low, high = (first + 0.5 * WIDE) * step, (first + size - 1 - 0.5 * WIDE) * step
        found += [low, high]
        if (target_rad - low) % (2.0 * math.pi) <= high - low:
            found.append(target_rad)
    return found


def openings(blocked: list[int]) -> list[tuple[int, int]]:
    """(first sector, number of sectors) of every run of free sectors, round the circle."""
    count = len(blocked)
    start = blocked.index(1)
    runs: list[tuple[int, int]] = []
    size = 0
    for k in range(start + 1, start + count + 1):
        if not blocked[k % count]:
            size += 1
        elif size:
            runs.append(((k - size) % count, size))
            size = 0
    return runs
