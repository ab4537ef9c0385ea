"""Readings as the messages that PX4 and ground stations know: DISTANCE_SENSOR, OBSTACLE_DISTANCE.

What looks down is not told: PX4's estimator takes a downward range for the height above ground,
and that of a room that is not there would be a lie to fly by.
"""

import json
import math
from collections.abc import Sequence

from hal.config import BeamMount, BeamsConfig
from hal.interfaces import MessageSink
from hal.ranging.distance_sensor import INVALID
from hal.ranging.orientations import DOWN, orientation_of
from hal.readings import RangeReading, RangeStatus

INTERVAL_S = 0.1
"""PX4 passes DISTANCE_SENSOR on at no more than 10 Hz (measured)."""

_INFRARED = 2  # MAV_DISTANCE_SENSOR
_BODY_FRD = 12  # MAV_FRAME
_GOOD = 100  # signal_quality
_SECTORS, _SECTOR_DEG = 72, 5
_UNKNOWN_CM = 65_535
_MOST_COVARIANCE = 254


def _wire_cm(reading: RangeReading) -> int:
    """One over the maximum: nothing there. One under the minimum: too near to measure."""
    if reading.status is RangeStatus.OUT_OF_RANGE:
        return round(reading.max_m * 100.0) + 1
    if reading.status is RangeStatus.TOO_NEAR:
        return max(round(reading.min_m * 100.0) - 1, 0)
    return round(reading.range_m * 100.0)


class BeamTeller:
    """Sends the newest reading of every beam that does not look down, at most every 0.1 s."""

    def __init__(self, sink: MessageSink, beams: BeamsConfig) -> None:
        """Raises ReadingRefused for a beam whose direction MAVLink has no number for."""
        self._sink = sink
        self._mounts: dict[str, BeamMount] = {
            mount.name: mount for mount in beams.mounts if orientation_of(mount) != DOWN
        }
        self._numbers = {name: number for number, name in enumerate(self._mounts)}
        self._newest: dict[str, RangeReading] = {}
        self._limits_cm = (round(beams.min_m * 100.0), round(beams.max_m * 100.0))
        self._due_s = -math.inf

    def tell(self, readings: Sequence[RangeReading]) -> None:
        """Remember `readings`, and send the newest ones when it is time."""
        mine = [reading for reading in readings if reading.beam in self._mounts]
        self._newest.update((reading.beam, reading) for reading in mine)
        if not mine or mine[-1].stamp_s < self._due_s:
            return
        now_s = mine[-1].stamp_s
        in_time = now_s - self._due_s < INTERVAL_S
        self._due_s = (self._due_s if in_time else now_s) + INTERVAL_S
        for reading in self._newest.values():
            self._sink.send_message("DISTANCE_SENSOR", json.dumps(self._distance(reading)))
        self._sink.send_message("OBSTACLE_DISTANCE", json.dumps(self._obstacles(now_s)))
        self._newest.clear()

    def _distance(self, reading: RangeReading) -> dict[str, object]:
        low_cm, high_cm = self._limits_cm
        blind = reading.status is RangeStatus.NO_SIGNAL
        return {
            "time_boot_ms": round(reading.stamp_s * 1e3) & 0xFFFFFFFF,
            "min_distance": low_cm,
            "max_distance": high_cm,
            "current_distance": _wire_cm(reading),
            "type": _INFRARED,
            "id": self._numbers[reading.beam],
            "orientation": orientation_of(self._mounts[reading.beam]),
            "covariance": min(round(reading.variance_m2 * 1e4), _MOST_COVARIANCE),
            "horizontal_fov": 0.0,
            "vertical_fov": 0.0,
            "quaternion": [0.0, 0.0, 0.0, 0.0],
            "signal_quality": INVALID if blind else _GOOD,
        }

    def _obstacles(self, now_s: float) -> dict[str, object]:
        """The horizontal beams, each in the sector that it looks into; the others are unknown."""
        low_cm, high_cm = self._limits_cm
        distances = [_UNKNOWN_CM] * _SECTORS
        for name, reading in self._newest.items():
            mount = self._mounts[name]
            if mount.horizontal and reading.status is not RangeStatus.NO_SIGNAL:
                distances[round(mount.yaw_deg / _SECTOR_DEG) % _SECTORS] = _wire_cm(reading)
        return {
            "time_usec": round(now_s * 1e6),
            "sensor_type": _INFRARED,
            "distances": distances,
            "increment": _SECTOR_DEG,
            "min_distance": low_cm,
            "max_distance": high_cm,
            "increment_f": float(_SECTOR_DEG),
            "angle_offset": 0.0,
            "frame": _BODY_FRD,
        }
