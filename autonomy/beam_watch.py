"""Looking at the range beams without flying: for `autonomy check --live` and `calibrate`."""

import asyncio
import statistics
import time
from collections import deque
from collections.abc import Callable, Sequence

from autonomy.config import Config
from autonomy.errors import BadInput
from hal import registry
from hal.clock import Clock, MonotonicClock
from hal.config import BeamsConfig
from hal.interfaces import RangeSensor
from hal.readings import RangeReading, RangeStatus

WINDOW_S = 2.0
"""Rate and noise are those of this long."""
_REFRESH_S = 0.1
_BAR = 40

Show = Callable[[Sequence[RangeReading], float], None]


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


def watch(
    config: Config, connection: str | None, seconds: float, show: Show | None = None
) -> list[RangeReading]:
    """All readings of the next `seconds`; `show` sees those of the last `WINDOW_S` ten times a
    second. Ctrl-C ends it early.

    Raises BadInput when beams come over MAVLink and there is no `connection`, HalError when
    vehicle or sensors do not answer. Nothing is commanded.
    """
    if connection is None and config.beams.over_mavlink():
        names = ", ".join(mount.name for mount in config.beams.over_mavlink())
        raise BadInput(f"{names} come over the vehicle's link: say which with --connection URL")
    return asyncio.run(_watch(config, connection, seconds, show))


async def _watch(
    config: Config, connection: str | None, seconds: float, show: Show | None
) -> list[RangeReading]:
    clock = MonotonicClock()
    deadline_s = config.vehicle.connect_timeout_s
    if connection is None:
        return await _read(
            registry.local_range_sensors(config.beams, clock), clock, deadline_s, seconds, show
        )
    vehicle_config = config.vehicle.model_copy(update={"connection": connection})
    vehicle = registry.vehicle(vehicle_config, config.beams, clock)
    try:
        await vehicle.open(deadline_s)
        sensors = registry.range_sensors(config.beams, vehicle, clock)
        return await _read(sensors, clock, deadline_s, seconds, show)
    finally:
        await vehicle.close()


async def _read(
    sensors: Sequence[RangeSensor],
    clock: Clock,
    deadline_s: float,
    seconds: float,
    show: Show | None,
) -> list[RangeReading]:
    taken: list[RangeReading] = []
    recent: deque[RangeReading] = deque(maxlen=4096)
    try:
        for sensor in sensors:
            await sensor.open(deadline_s)
        for sensor in sensors:
            sensor.take()
        ends_s = time.monotonic() + seconds
        while time.monotonic() < ends_s:
            await asyncio.sleep(min(_REFRESH_S, max(ends_s - time.monotonic(), 0.0)))
            new = [reading for sensor in sensors for reading in sensor.take()]
            taken += new
            recent.extend(new)
            if show is not None:
                show(tuple(recent), clock.now_s())
    finally:
        for sensor in sensors:
            await sensor.close()
    return taken
