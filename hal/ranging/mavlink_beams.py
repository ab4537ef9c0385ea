"""Range beams that reach the vehicle's link as MAVLink DISTANCE_SENSOR or OBSTACLE_DISTANCE."""

import asyncio
from collections import deque
from collections.abc import Callable

import msgspec

from hal.config import BeamMount, BeamsConfig, MavlinkDriver
from hal.drops import Dropped, Drops
from hal.errors import ReadingRefused, SensorSilent
from hal.interfaces import MessageSource, WireMessage
from hal.ranging.distance_sensor import DistanceMessage
from hal.ranging.obstacle_distance import ObstacleMessage
from hal.ranging.orientations import BeamDirections
from hal.ranging.rival_sources import RivalSources, Source, Verdict
from hal.readings import RangeReading

_KEPT = 256
_POLL_S = 0.02
_RANGE, _RING = "DISTANCE_SENSOR", "OBSTACLE_DISTANCE"


class MavlinkBeams:
    """`hal.interfaces.RangeSensor` over the vehicle's link: every beam of `config`.

    A stamp is the sender's time less the beam's latency (`BeamsConfig.latency_of`), which the wire
    does not tell. Several sources of one beam: see `rival_sources`.
    """

    def __init__(
        self, source: MessageSource, config: BeamsConfig, driver: MavlinkDriver | None = None
    ) -> None:
        """Raises ReadingRefused when two mounts cannot be told apart."""
        self._source = source
        self._config = config
        self._driver = driver or MavlinkDriver()
        self._mounts = {mount.name: mount for mount in config.mounts}
        self._directions = BeamDirections(config.mounts)
        self._rivals = {name: RivalSources(config.stale_after_s) for name in self._mounts}
        self._range = msgspec.json.Decoder(DistanceMessage)
        self._ring = msgspec.json.Decoder(ObstacleMessage)
        self._readings: deque[RangeReading] = deque(maxlen=_KEPT)
        self._drops = Drops()
        self._listening = False
        self._heard = False
        self._open = False

    def dropped(self) -> Dropped:
        """See `hal.drops`: "unreadable", "no such direction", "echo", "overruled",
        "late".
        """
        return self._drops.dropped()

    async def open(self, deadline_s: float) -> None:
        """Listen; returns with the first reading of any beam.

        Raises SensorSilent when none comes within `deadline_s`. Cancelling closes it.
        """
        self._open = True
        self._heard = False
        if not self._listening:
            self._listening = True
            self._source.listen(_RANGE, self._guarded(_RANGE, self._take_range))
            if self._driver.obstacle_distance:
                self._source.listen(_RING, self._guarded(_RING, self._take_ring))
        try:
            async with asyncio.timeout(deadline_s):
                while not self._heard:  # noqa: ASYNC110 - the cell's writer knows no event loop
                    await asyncio.sleep(_POLL_S)
        except TimeoutError:
            self._open = False
            names = " or ".join((_RANGE, _RING) if self._driver.obstacle_distance else (_RANGE,))
            raise SensorSilent(
                f"no beam of {', '.join(self._mounts)} was heard as {names} within "
                f"{deadline_s:g} s; check the sensors' drivers and the link's stream rates"
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

    def _guarded(
        self, name: str, take: Callable[[WireMessage], None]
    ) -> Callable[[WireMessage], None]:
        def taken(message: WireMessage) -> None:
            if not self._open:
                return
            try:
                take(message)
            except (msgspec.DecodeError, ReadingRefused):
                self._drops.note(name, "unreadable")

        return taken

    def _take_range(self, message: WireMessage) -> None:
        fields = self._range.decode(message.fields_json)
        beam = self._directions.beam(fields.orientation, fields.rotation())
        if beam is None:
            self._drops.note(_RANGE, "no such direction")
            return
        mount, sent_s = self._mounts[beam], fields.time_boot_ms * 1e-3
        reading = fields.reading(self._stamp_s(message, sent_s, mount), mount, self._config)
        self._judge(_RANGE, Source(message.component_id, fields.id), reading, message, sent_s)

    def _take_ring(self, message: WireMessage) -> None:
        fields = self._ring.decode(message.fields_json).checked()
        source, sent_s = Source(message.component_id, ring=True), fields.time_usec * 1e-6
        for mount in self._mounts.values():
            if not mount.horizontal:
                continue
            stamp_s = self._stamp_s(message, sent_s, mount)
            reading = fields.reading(stamp_s, mount, self._config)
            if reading is not None:
                self._judge(_RING, source, reading, message, sent_s)

    def _stamp_s(self, message: WireMessage, sent_s: float, mount: BeamMount) -> float:
        return self._source.stamp_s(message, sent_s) - self._config.latency_of(mount)

    def _judge(
        self,
        name: str,
        source: Source,
        reading: RangeReading,
        message: WireMessage,
        sent_s: float,
    ) -> None:
        rivals = self._rivals[reading.beam]
        verdict = rivals.judge(source, reading, message.received_s, sent_s)
        if verdict is not Verdict.BELIEVED:
            self._drops.note(name, verdict.value)
            return
        self._heard = True
        self._readings.append(reading)
