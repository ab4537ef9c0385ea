"""Ranges of the mock PX4: the scenario's beams, and what a companion sends in.

Measured on PX4 main bb59c637cd, SIH quadrotor, 2026-11.
"""

import math
from collections.abc import Sequence

import numpy as np
from pymavlink.dialects.v20 import development as mavlink

from hal.config import BeamMount
from hal.readings import RangeReading, RangeStatus
from hal.sim.mock_px4_plant import Plant
from hal.sim.mock_px4_streams import Message, boot_ms


def orientation(mount: BeamMount) -> int:
    """MAV_SENSOR_ORIENTATION of a mount: up, down, or the nearest multiple of 45 deg of yaw."""
    if mount.pitch_deg > 45.0:
        return int(mavlink.MAV_SENSOR_ROTATION_PITCH_90)
    if mount.pitch_deg < -45.0:
        return int(mavlink.MAV_SENSOR_ROTATION_PITCH_270)
    return round(mount.yaw_deg / 45.0) % 8


class BeamEncoder:
    """Range readings as DISTANCE_SENSOR, in whole centimetres.

    Nothing in range is one centimetre over the maximum, something too near one under the minimum;
    a beam that could not measure sends nothing.
    """

    def __init__(self, mounts: tuple[BeamMount, ...], half_angle_deg: float) -> None:
        self._places = {
            mount.name: (index, orientation(mount)) for index, mount in enumerate(mounts)
        }
        self._fov_rad = 2.0 * math.radians(half_angle_deg)

    def encode(self, reading: RangeReading) -> Message | None:
        """One message, or None for a reading that says nothing."""
        if reading.status is RangeStatus.NO_SIGNAL:
            return None
        index, looks = self._places[reading.beam]
        return mavlink.MAVLink_distance_sensor_message(
            time_boot_ms=round(reading.stamp_s * 1e3),
            min_distance=round(reading.min_m * 100.0),
            max_distance=round(reading.max_m * 100.0),
            current_distance=_wire_cm(reading),
            type=mavlink.MAV_DISTANCE_SENSOR_INFRARED,
            id=index,
            orientation=looks,
            covariance=min(round(reading.variance_m2 * 1e4), 254),
            horizontal_fov=self._fov_rad,
            vertical_fov=self._fov_rad,
            quaternion=[0.0] * 4,
            signal_quality=100,
        )


class RingEncoder:
    """The beams around as a companion's OBSTACLE_DISTANCE, as a ring of scanners sends it.

    Each beam fills the sector that it looks into; what it could not measure, and all the other
    sectors, are unknown.
    """

    _SECTORS, _STEP_DEG = 72, 5
    _UNKNOWN = 65_535

    def __init__(self, mounts: tuple[BeamMount, ...]) -> None:
        self._sectors = {
            mount.name: round(mount.yaw_deg / self._STEP_DEG) % self._SECTORS
            for mount in mounts
            if mount.horizontal
        }

    def tells(self, beam: str) -> bool:
        """True for a beam that is in the ring."""
        return beam in self._sectors

    def encode(self, readings: Sequence[RangeReading]) -> Message | None:
        """One message of what is around, or None when there is nothing to tell."""
        around = [reading for reading in readings if reading.beam in self._sectors]
        if not around:
            return None
        distances = [self._UNKNOWN] * self._SECTORS
        for reading in around:
            if reading.status is not RangeStatus.NO_SIGNAL:
                distances[self._sectors[reading.beam]] = _wire_cm(reading)
        low, high = round(around[0].min_m * 100.0), round(around[0].max_m * 100.0)
        return mavlink.MAVLink_obstacle_distance_message(
            time_usec=round(around[-1].stamp_s * 1e6),
            sensor_type=mavlink.MAV_DISTANCE_SENSOR_INFRARED,
            distances=distances,
            increment=self._STEP_DEG,
            min_distance=low,
            max_distance=high,
            increment_f=float(self._STEP_DEG),
            angle_offset=0.0,
            frame=mavlink.MAV_FRAME_BODY_FRD,
        )


class RangeEcho:
    """DISTANCE_SENSOR that a companion sends in: published again as the autopilot's own.

    All of them share one instance, whose number takes the place of the sender's id; of what comes
    faster than 10 Hz only the newest is seen.
    """

    _PERIOD_S = 0.1

    def __init__(self, own_sensors: int) -> None:
        self._instance = max(own_sensors, 1)
        self._newest: Message | None = None
        self._due_s = 0.0

    def take(self, message: Message) -> None:
        """One reading arrived."""
        self._newest = message

    def due(self, plant: Plant) -> Message | None:
        """What is published now."""
        now_s, told = plant.autopilot.now_s, self._newest
        if told is None or now_s < self._due_s:
            return None
        self._newest = None
        self._due_s = max(self._due_s + self._PERIOD_S, now_s)
        return mavlink.MAVLink_distance_sensor_message(
            time_boot_ms=boot_ms(plant),
            min_distance=_through_a_float(told.min_distance),
            max_distance=_through_a_float(told.max_distance),
            current_distance=_through_a_float(told.current_distance),
            type=told.type,
            id=self._instance,
            orientation=told.orientation,
            covariance=told.covariance,
            horizontal_fov=told.horizontal_fov,
            vertical_fov=told.vertical_fov,
            quaternion=list(told.quaternion),
            signal_quality=max((told.signal_quality - 1) * 100 // 99, 1),
        )


def _wire_cm(reading: RangeReading) -> int:
    """One over the maximum: nothing there. One under the minimum: too near to measure."""
    if reading.status is RangeStatus.OUT_OF_RANGE:
        return round(reading.max_m * 100.0) + 1
    if reading.status is RangeStatus.TOO_NEAR:
        return max(round(reading.min_m * 100.0) - 1, 0)
    return round(reading.range_m * 100.0)


def _through_a_float(centimetres: int) -> int:
    """Centimetres that were metres in single precision for a while, and truncated: 20 is 19."""
    return int(np.float32(centimetres) * np.float32(1e-2) * np.float32(1e2))
