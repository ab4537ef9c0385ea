"""What MAVLink's DISTANCE_SENSOR says: one range in one direction."""

import msgspec

from hal.config import BeamMount, BeamsConfig
from hal.readings import RangeReading, RangeStatus

INVALID = 1
"""signal_quality of a measurement that failed; 0 means that the quality is not known."""
WRAPPED_CM = 60_000
"""PX4 casts a slightly negative distance to unsigned (65532 was measured on the ground)."""
UNKNOWN_COVARIANCE = (0, 255)
"""255 by MAVLink; 0 is what drivers without a variance send, and no sensor is exact."""
SIGMA_M, SIGMA_PER_M = 0.01, 0.02
"""Model for an unknown variance: one sigma = 1 cm + 2 % of the range (infrared triangulation)."""
ROUNDING_M2 = 0.01**2 / 12.0
"""The wire carries whole centimetres."""


class DistanceMessage(msgspec.Struct, frozen=True):
    """DISTANCE_SENSOR: centimetres, variance in square centimetres."""

    time_boot_ms: int
    min_distance: int
    max_distance: int
    current_distance: int
    id: int
    orientation: int
    covariance: int
    signal_quality: int = 0
    quaternion: tuple[float | None, ...] = ()
    """Not a number where a sender fills it up with what is none; it counts when `orientation` is
    custom only."""

    def rotation(self) -> tuple[float, ...]:
        """The quaternion; empty when a component is not a number."""
        known = tuple(part for part in self.quaternion if part is not None)
        return known if len(known) == len(self.quaternion) else ()

    def reading(self, stamp_s: float, mount: BeamMount, config: BeamsConfig) -> RangeReading:
        """As a reading, within the narrower of the message's and the configured limits.

        Raises ReadingRefused when the limits leave no range.
        """
        min_m, max_m = believed_m(self.min_distance, self.max_distance, mount, config)
        range_m = max(0.0, self.current_distance * 0.01 - mount.offset_m)
        if self.signal_quality == INVALID or not 0 <= self.current_distance < WRAPPED_CM:
            status, range_m = RangeStatus.NO_SIGNAL, 0.0
        elif range_m <= min_m:
            status, range_m = RangeStatus.TOO_NEAR, min_m
        elif range_m >= max_m:
            status, range_m = RangeStatus.OUT_OF_RANGE, max_m
        else:
            status = RangeStatus.VALID
        return RangeReading(
            stamp_s=stamp_s,
            beam=mount.name,
            status=status,
            range_m=range_m,
            variance_m2=max(self._variance_m2(range_m), mount.sigma_m * mount.sigma_m),
            min_m=min_m,
            max_m=max_m,
        )

    def _variance_m2(self, range_m: float) -> float:
        if self.covariance in UNKNOWN_COVARIANCE:
            return modelled_variance_m2(range_m)
        return self.covariance * 1e-4 + ROUNDING_M2


def believed_m(
    min_cm: int, max_cm: int, mount: BeamMount, config: BeamsConfig
) -> tuple[float, float]:
    """(least, greatest) range that a message can tell of: the narrower of its own limits and the
    configured ones.

    A sender's limits are of what it reads, so the offset comes off them, too: what it clips to
    100 cm is clipped however far it reads wrong, and it looked no farther than that.
    """
    min_m = max(min_cm * 0.01 - mount.offset_m, config.min_m)
    return min_m, min(max_cm * 0.01 - mount.offset_m, config.max_m)


def modelled_variance_m2(range_m: float) -> float:
    """That of a range in whole centimetres whose sender tells none."""
    sigma_m = SIGMA_M + SIGMA_PER_M * range_m
    return sigma_m * sigma_m + ROUNDING_M2
