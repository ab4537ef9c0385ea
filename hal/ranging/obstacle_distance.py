"""What MAVLink's OBSTACLE_DISTANCE says along one beam: a ring of sectors about the vehicle."""

import math

import msgspec

from hal.config import BeamMount, BeamsConfig
from hal.errors import ReadingRefused
from hal.ranging.distance_sensor import believed_m, modelled_variance_m2
from hal.readings import RangeReading, RangeStatus

BODY_FRD = 12  # MAV_FRAME
UNKNOWN_CM = 65_535
_SECTORS = 72
_EDGE_DEG = 1e-6


class ObstacleMessage(msgspec.Struct, frozen=True):
    """OBSTACLE_DISTANCE: centimetres in up to 72 sectors, clockwise from `angle_offset` (degrees).

    A sector reaches half an increment to both sides of its direction. 65535 is unknown, more than
    `max_distance` is free.
    """

    time_usec: int
    distances: tuple[int, ...]
    increment: int
    min_distance: int
    max_distance: int
    increment_f: float = 0.0
    angle_offset: float = 0.0
    frame: int = 0

    def checked(self) -> "ObstacleMessage":
        """Itself; raises ReadingRefused for a ring that cannot be laid around the body."""
        if self.frame != BODY_FRD:
            raise ReadingRefused(
                f"OBSTACLE_DISTANCE in MAV_FRAME {self.frame}: only BODY_FRD turns with the beams"
            )
        if not 0 < len(self.distances) <= _SECTORS:
            raise ReadingRefused(f"OBSTACLE_DISTANCE with {len(self.distances)} sectors")
        if not 0.0 < self.step_deg <= 360.0:
            raise ReadingRefused(f"OBSTACLE_DISTANCE with sectors of {self.step_deg} deg")
        if not abs(self.angle_offset) <= 360.0:
            raise ReadingRefused(f"OBSTACLE_DISTANCE that begins at {self.angle_offset} deg")
        if not 0 <= self.min_distance < self.max_distance:
            raise ReadingRefused(
                f"OBSTACLE_DISTANCE within {self.min_distance}..{self.max_distance} cm"
            )
        return self

    @property
    def step_deg(self) -> float:
        """Width of a sector; `increment_f` counts unless it is zero."""
        return self.increment_f if self.increment_f != 0.0 else float(self.increment)

    def reading(self, stamp_s: float, mount: BeamMount, config: BeamsConfig) -> RangeReading | None:
        """The beam's reading, or None when the message knows nothing of its direction.

        The nearest return among the sectors that reach into the beam's cone (`half_angle_deg`).
        A cone frees the whole of itself up to its range, so where one of its sectors is unknown
        "free" says nothing, and a return is SUSPECT: it counts as near, and frees nothing. Of a
        thin beam only the sector in its own direction counts.
        Raises ReadingRefused when the limits leave no range.
        """
        min_m, max_m = believed_m(self.min_distance, self.max_distance, mount, config)
        ahead, beside = self._sectors(mount.yaw_deg, mount.half_angle_deg or 0.0)
        known = [cm for cm in (*ahead, *beside) if cm != UNKNOWN_CM]
        if not known:
            return None
        whole = UNKNOWN_CM not in (*ahead, *beside)
        range_m = max(0.0, min(known) * 0.01 - mount.offset_m)
        status = RangeStatus.VALID
        if range_m <= min_m:
            status, range_m = RangeStatus.TOO_NEAR, min_m
        elif range_m >= max_m:
            if not whole:
                return None
            status, range_m = RangeStatus.OUT_OF_RANGE, max_m
        elif not whole:
            status = RangeStatus.SUSPECT
        return RangeReading(
            stamp_s=stamp_s,
            beam=mount.name,
            status=status,
            range_m=range_m,
            variance_m2=max(modelled_variance_m2(range_m), mount.sigma_m * mount.sigma_m),
            min_m=min_m,
            max_m=max_m,
        )

    def _sectors(self, yaw_deg: float, half_angle_deg: float) -> tuple[list[int], list[int]]:
        """Distances of the sectors that hold the direction, and of those that the cone touches."""
        ahead, beside = [], []
        half_step = self.step_deg / 2.0
        for index, distance_cm in enumerate(self.distances):
            if index * self.step_deg >= 360.0 - _EDGE_DEG:
                break  # a ring is full; what follows is filled up
            off = yaw_deg - self.angle_offset - index * self.step_deg
            off = abs(math.remainder(off, 360.0))
            if off <= half_step + _EDGE_DEG:
                ahead.append(distance_cm)
            elif off < half_step + half_angle_deg - _EDGE_DEG:
                beside.append(distance_cm)
        return ahead, beside
