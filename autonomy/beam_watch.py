"""Looking at the range beams without flying: for `autonomy check --live` and `calibrate`."""

import asyncio
import math
import statistics
import time
from collections import deque
from collections.abc import Callable, Sequence

from autonomy.config import Config
from autonomy.errors import BadInput
from hal import registry
from hal.clock import MonotonicClock
from hal.config import BeamsConfig
from hal.errors import HalError
from hal.interfaces import RangeSensor
from hal.readings import RangeReading, RangeStatus
from hal.troubles import troubles_of

WINDOW_S = 2.0
"""Rate and noise are those of this long."""
_REFRESH_S = 0.1
_BAR = 40

_AGAIN_S = 1.0

Show = Callable[[Sequence[RangeReading], float, Sequence[str]], None]
"""Given the latest readings, the time, and a sentence for each thing that does not come."""


def bar_lines(beams: BeamsConfig, recent: Sequence[RangeReading], now_s: float) -> tuple[str, ...]:
    """One line a beam: bar, range, noise, rate, age, status; from readings of `WINDOW_S`."""
    return tuple(
        _bar_line(
            mount.name,
            [r for r in recent if r.beam == mount.name and now_s - r.stamp_s <= WINDOW_S],
            beams,
            now_s,
        )
        for mount in beams.mounts
    )


def _bar_line(name: str, own: Sequence[RangeReading], beams: BeamsConfig, now_s: float) -> str:
    if not own:
        return f"{name:>8} |{'?' * _BAR}| silent"
    last = own[-1]
    filled = round(_BAR * min(last.range_m / beams.max_m, 1.0))
    mark = {
        RangeStatus.VALID: "#",
        RangeStatus.SUSPECT: "~",
        RangeStatus.TOO_NEAR: "!",
        RangeStatus.OUT_OF_RANGE: "-",
        RangeStatus.NO_SIGNAL: "?",
    }[last.status]
    bar = (mark * (_BAR if last.status is RangeStatus.NO_SIGNAL else filled)).ljust(_BAR)
    ranges = [reading.range_m for reading in own if reading.status is RangeStatus.VALID]
    noise = f"{statistics.stdev(ranges) * 1000:5.1f} mm" if len(ranges) > 2 else "    - mm"
    age_s = now_s - last.stamp_s
    stale = " STALE" if age_s > beams.stale_after_s else ""
    return (
        f"{name:>8} |{bar}| {last.range_m:6.3f} m {noise} {len(own) / WINDOW_S:5.1f} Hz "
        f"{age_s * 1000:4.0f} ms {last.status}{stale}"
    )


def measure(
    config: Config, connection: str | None, beam: str, seconds: float
) -> list[RangeReading]:
    """The readings of the next `seconds` of what it takes to read `beam`, and of nothing else.

    Raises BadInput when it comes over MAVLink and there is no `connection`, HalError when vehicle
    or sensor do not answer. Nothing is commanded.
    """
    needed = config.model_copy(update={"beams": config.beams.only(beam)})
    if not needed.beams.over_mavlink():
        connection = None
    elif connection is None:
        raise BadInput(f"{beam} comes over the vehicle's link: say which with --connection URL")
    watch = _Watch(needed, connection, awaited=frozenset({beam}))
    return asyncio.run(watch.run(seconds, None))


def watch(
    config: Config, connection: str | None, seconds: float, show: Show | None = None
) -> list[RangeReading]:
    """All readings of the `seconds` after everything was tried once; `show` is called ten times a
    second from the beginning. Ctrl-C ends it early.

    What does not come is told to `show` and tried again. Raises BadInput when every beam comes over
    MAVLink and there is no `connection`, HalError when there are no others and the vehicle does not
    answer. Nothing is commanded.
    """
    if connection is None and not config.beams.wired():
        names = ", ".join(mount.name for mount in config.beams.over_mavlink())
        raise BadInput(f"{names} come over the vehicle's link: say which with --connection URL")
    return asyncio.run(_Watch(config, connection, awaited=None).run(seconds, show))


class _Watch:
    """Drivers that are opened beside each other, and what they measure.

    Of `awaited` all must measure, and any error ends it; None: each may come when it can.
    """

    def __init__(
        self, config: Config, connection: str | None, awaited: frozenset[str] | None
    ) -> None:
        self._beams = config.beams
        self._awaited = awaited
        self._deadline_s = config.vehicle.connect_timeout_s
        self._clock = MonotonicClock()
        self._refused: dict[object, str] = {}
        self._sensors: list[RangeSensor] = []
        self._untried = 0
        self._vehicle: registry.LinkedVehicle | None = None
        if connection is not None:
            linked = config.vehicle.model_copy(update={"connection": connection})
            self._vehicle = registry.vehicle(linked, config.beams, self._clock)
        elif awaited is None:
            self._without_a_link()

    def _without_a_link(self) -> None:
        names = ", ".join(mount.name for mount in self._beams.over_mavlink())
        if names:
            self._refused[names] = f"{names}: over the vehicle's link, say --connection URL"

    async def run(self, seconds: float, show: Show | None) -> list[RangeReading]:
        """See `watch`."""
        try:
            async with asyncio.TaskGroup() as group:
                openings = self._begin(group)
                taken = await self._taken(seconds, show)
                for opening in openings:
                    opening.cancel()
        except BaseExceptionGroup as errors:
            raise errors.exceptions[0] from None
        finally:
            for sensor in self._sensors:
                await sensor.close()
            if self._vehicle is not None:
                await self._vehicle.close()
        return taken

    async def _taken(self, seconds: float, show: Show | None) -> list[RangeReading]:
        taken: list[RangeReading] = []
        recent: deque[RangeReading] = deque(maxlen=4096)
        ends_s = math.inf
        while time.monotonic() < ends_s:
            await asyncio.sleep(min(_REFRESH_S, max(ends_s - time.monotonic(), 0.0)))
            new = [reading for sensor in self._sensors for reading in sensor.take()]
            recent.extend(new)
            if ends_s < math.inf:
                taken += new
            elif not self._untried:
                ends_s = time.monotonic() + seconds
            if show is not None:
                show(tuple(recent), self._clock.now_s(), self.troubles())
        return taken

    def troubles(self) -> tuple[str, ...]:
        """What is wrong with what does not measure, a sentence each."""
        single = (f"{beam}: {told}" for beam, told in troubles_of(self._sensors).items())
        return (*self._refused.values(), *single)

    def _begin(self, group: asyncio.TaskGroup) -> list[asyncio.Task[None]]:
        awaited = frozenset[str]() if self._awaited is None else self._awaited
        here = registry.local_range_sensors(self._beams, self._clock, awaited)
        self._untried = len(here)
        openings = [group.create_task(self._opened(sensor)) for sensor in here]
        if self._vehicle is not None:
            self._untried += 1
            openings.append(group.create_task(self._linked(self._vehicle)))
        return openings

    async def _linked(self, vehicle: registry.LinkedVehicle) -> None:
        """The vehicle, then what comes over its link."""
        try:
            await vehicle.open(self._deadline_s)
            afar = registry.range_sensors(self._beams.afar(), vehicle, self._clock)
        except HalError as error:
            if self._awaited is not None or not self._beams.wired():
                raise
            self._refused[vehicle] = str(error)
            self._untried -= 1
            return
        self._untried += len(afar) - 1
        await asyncio.gather(*(self._opened(sensor) for sensor in afar))

    async def _opened(self, sensor: RangeSensor) -> None:
        """Open it, if need be again and again."""
        first = True
        while True:
            try:
                await sensor.open(self._deadline_s)
            except HalError as error:
                if self._awaited is not None:
                    raise
                self._refused[sensor] = str(error)
            else:
                self._refused.pop(sensor, None)
                self._sensors.append(sensor)
                return
            finally:
                self._untried -= first
                first = False
            await asyncio.sleep(_AGAIN_S)
