"""Table 2: the speed from the volume of the free sphere around the drone and its rate.

The table itself is `decide`. The loop flies `speed_for_clearance`: taken literally, the table's
third row would stop the drone for ever wherever its clearance does not change, so 0 is kept for
what is blocked or not seen, and a constant volume gets the speed that goes with the volume.
"""

import math
from enum import StrEnum

from autonomy.config import GuidanceConfig


class SpeedDecision(StrEnum):
    """The third column of Table 2."""

    MAXIMUM = "maximum"
    MINIMUM = "minimum"
    ZERO = "zero"


def free_volume_m3(clearance_m: float, range_max_m: float) -> float:
    """V: volume of the sphere that is free around the drone, capped at the sensors' range."""
    return 4.0 / 3.0 * math.pi * min(max(clearance_m, 0.0), range_max_m) ** 3


def volume_rate_per_s(clearance_m: float, clearance_rate_m_s: float, range_max_m: float) -> float:
    """dV/dt as a fraction of the full volume per second: 3 c^2 dc/dt / c_max^3; 0 at the cap."""
    if clearance_m >= range_max_m:
        return 0.0
    return 3.0 * max(clearance_m, 0.0) ** 2 * clearance_rate_m_s / range_max_m**3


def decide(volume: float, volume_rate: float, dead_band: float = 0.0) -> SpeedDecision:
    """Table 2: (V, dV > 0) maximum, (V, dV < 0) minimum, (V, 0) and everything else 0.

    A rate within the dead band counts as 0. V must be positive and both finite, or it is
    "everything else".
    """
    if not (math.isfinite(volume) and math.isfinite(volume_rate)) or volume <= 0.0:
        return SpeedDecision.ZERO
    if volume_rate > dead_band:
        return SpeedDecision.MAXIMUM
    if volume_rate < -dead_band:
        return SpeedDecision.MINIMUM
    return SpeedDecision.ZERO


def speed_for_clearance(
    clearance_m: float, config: GuidanceConfig, *, receding: bool = False, seen_free: bool = True
) -> float:
    """The loop's speed in m/s: Table 2, with the speed growing with the free sphere.

    Not seen free: 0. Clear of what is near by `slow_below_m`, or receding from it (dV > 0) and
    clear by half the way from `slowest_at_m` to there: maximum. Else linear in the clearance from
    the minimum at `slowest_at_m` to the maximum at `slow_below_m`. Nearer than half the way a
    narrow place may have another side that the beams have not met yet: Table 2's maximum waits.
    clearance_m is measured from the vehicle's centre, inf when nothing is near.
    """
    if not seen_free or math.isnan(clearance_m):
        return 0.0
    halfway_m = 0.5 * (config.slowest_at_m + config.slow_below_m)
    if clearance_m >= (halfway_m if receding else config.slow_below_m):
        return config.speed_max_m_s
    share = (clearance_m - config.slowest_at_m) / (config.slow_below_m - config.slowest_at_m)
    rise = config.speed_max_m_s - config.speed_min_m_s
    return config.speed_min_m_s + max(0.0, share) * rise


def speed_limit_m_s(
    clearance_m: float, clearance_rate_m_s: float, config: GuidanceConfig, range_max_m: float = 1.0
) -> float:
    """`speed_for_clearance` with receding read off Table 2: dV/dt over the dead band."""
    volume = free_volume_m3(clearance_m, range_max_m)
    rate = volume_rate_per_s(clearance_m, clearance_rate_m_s, range_max_m)
    decision = decide(volume, rate, config.volume_rate_dead_band)
    return speed_for_clearance(clearance_m, config, receding=decision is SpeedDecision.MAXIMUM)
