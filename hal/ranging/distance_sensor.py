"""Range beams that reach the vehicle's link as MAVLink DISTANCE_SENSOR messages."""

import asyncio
from collections import deque

import msgspec

from hal.config import BeamMount, BeamsConfig
from hal.errors import ReadingRefused, SensorSilent
from hal.interfaces import MessageSource, WireMessage
from hal.readings import RangeReading, RangeStatus

_AUTOPILOT_COMPONENT = 1
_UP, _DOWN = 24, 25  # MAV_SENSOR_ROTATION_PITCH_90, _PITCH_270
_VERTICAL_DEG = 60.0
_SECTOR_DEG = 45.0  # MAV_SENSOR_ROTATION_NONE..YAW_315 are 0..7
_OFF_SECTOR_DEG = 10.0
_KEPT = 256
_SOURCE_GONE_S = 1.0
_POLL_S = 0.02

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


def orientation_of(mount: BeamMount) -> int:
    """MAV_SENSOR_ORIENTATION of a mount.

    Raises ReadingRefused for a direction that DISTANCE_SENSOR has no number for.
    """
    if mount.pitch_deg >= _VERTICAL_DEG:
        return _UP
    if mount.pitch_deg <= -_VERTICAL_DEG:
        return _DOWN
    sector = round(mount.yaw_deg / _SECTOR_DEG)
    if abs(mount.yaw_deg - sector * _SECTOR_DEG) > _OFF_SECTOR_DEG:
        raise ReadingRefused(
            f"beam {mount.name}: MAVLink has no orientation for a yaw of {mount.yaw_deg:g} deg; "
            "use a multiple of 45 deg"
        )
    return sector % 8


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

    def reading(self, stamp_s: float, beam: str, config: BeamsConfig) -> RangeReading:
        """As a reading, within the narrower of the message's and the configured limits.

        Raises ReadingRefused when the limits leave no range.
        """
        min_m = max(self.min_distance * 0.01, config.min_m)
        max_m = min(self.max_distance * 0.01, config.max_m)
        mount = config.mount(beam)
        range_m = max(0.0, self.current_distance * 0.01 - mount.offset_m)
        if self.signal_quality == INVALID or self.current_distance >= WRAPPED_CM:
            status, range_m = RangeStatus.NO_SIGNAL, 0.0
        elif range_m <= min_m:
            status, range_m = RangeStatus.TOO_NEAR, min_m
        elif range_m >= max_m:
            status, range_m = RangeStatus.OUT_OF_RANGE, max_m
        else:
            status = RangeStatus.VALID
        return RangeReading(
            stamp_s=stamp_s,
            beam=beam,
            status=status,
            range_m=range_m,
            variance_m2=max(self._variance_m2(range_m), mount.sigma_m * mount.sigma_m),
            min_m=min_m,
            max_m=max_m,
        )

    def _variance_m2(self, range_m: float) -> float:
        if self.covariance in UNKNOWN_COVARIANCE:
            sigma_m = SIGMA_M + SIGMA_PER_M * range_m
            return sigma_m * sigma_m + ROUNDING_M2
        return self.covariance * 1e-4 + ROUNDING_M2


class MavlinkDistanceSensor:
    """`hal.interfaces.RangeSensor` over the vehicle's link: every configured beam.

    A beam listens to one source, (component, sensor id). PX4 repeats what a companion sends it
    under its own name, late, thinned and with another id: a source that is not the autopilot
    therefore takes its beam over, and what others say in the same direction is counted in
    `echoes` and dropped until the source was silent for 1 s.
    """

    def __init__(self, source: MessageSource, config: BeamsConfig) -> None:
        """Raises ReadingRefused when two mounts cannot be told apart by orientation."""
        self._source = source
        self._config = config
        self._beams: dict[int, str] = {}
        for mount in config.mounts:
            orientation = orientation_of(mount)
            if orientation in self._beams:
                raise ReadingRefused(
                    f"beams {self._beams[orientation]} and {mount.name} have the same MAVLink "
                    "orientation; only one of them can use this driver"
                )
            self._beams[orientation] = mount.name
        self._decoder = msgspec.json.Decoder(DistanceMessage)
        self._readings: deque[RangeReading] = deque(maxlen=_KEPT)
        self._heard: dict[str, tuple[tuple[int, int], float]] = {}
        self._listening = False
        self._open = False
        self.echoes = 0
        """Messages of a second source for a beam."""
        self.unknown_orientations = 0
        """Messages that belong to no configured beam."""
        self.unreadable = 0
        """Messages that were no measurement."""

    async def open(self, deadline_s: float) -> None:
        """Listen; returns with the first reading of any beam.

        Raises SensorSilent when none comes within `deadline_s`. Cancelling closes it.
        """
        self._open = True
        self._heard.clear()
        if not self._listening:
            self._listening = True
            self._source.listen("DISTANCE_SENSOR", self._take)
        try:
            async with asyncio.timeout(deadline_s):
                while not self._heard:  # noqa: ASYNC110 - the cell's writer knows no event loop
                    await asyncio.sleep(_POLL_S)
        except TimeoutError:
            self._open = False
            raise SensorSilent(
                f"no beam of {', '.join(self._beams.values())} was heard as DISTANCE_SENSOR "
                f"within {deadline_s:g} s; check the sensors' drivers and the link's stream rates"
            ) from None
        except BaseException:
            self._open = False
            raise

    async def close(self) -> None:
        """Stop taking readings. May be called twice."""
        self._open = False
        self._readings.clear()

    def take(self) -> tuple[RangeReading, ...]:
        """Readings since the last call, oldest first; at most the last 256."""
        return tuple(self._readings.popleft() for _ in range(len(self._readings)))

    def _take(self, message: WireMessage) -> None:
        if not self._open:
            return
        try:
            fields = self._decoder.decode(message.fields_json)
            beam = self._beams.get(fields.orientation)
            if beam is None:
                self.unknown_orientations += 1
                return
            reading = fields.reading(
                self._source.stamp_s(message, fields.time_boot_ms * 1e-3), beam, self._config
            )
        except (msgspec.DecodeError, ReadingRefused):
            self.unreadable += 1
            return
        if self._is_echo(beam, (message.component_id, fields.id), message.received_s):
            self.echoes += 1
            return
        self._readings.append(reading)

    def _is_echo(self, beam: str, source: tuple[int, int], now_s: float) -> bool:
        """True for what another source than the beam's own says; else it is the beam's own now."""
        own = self._heard.get(beam)
        if own is not None and own[0] != source and now_s - own[1] < _SOURCE_GONE_S:
            takes_over = source[0] != _AUTOPILOT_COMPONENT and own[0][0] == _AUTOPILOT_COMPONENT
            if not takes_over:
                return True
        self._heard[beam] = (source, now_s)
        return False
