"""The sensors on this computer, looked at before flying, without a vehicle."""

import asyncio
import time

from autonomy.config import Config
from autonomy.finding import Finding, bad
from autonomy.vehicle_check import LOOK_S, STARTS_S, about_gnss, check_beams, troubles
from hal import registry
from hal.clock import MonotonicClock
from hal.errors import HalError
from hal.interfaces import Clock, RangeSensor
from hal.readings import RangeReading

_GNSS_S = 5.0
_POLL_S = 0.02


def check_local(config: Config) -> tuple[Finding, ...]:
    """Range beams on I2C and the like, and a receiver on a serial port; nothing where none is."""
    return asyncio.run(_check(config))


async def _check(config: Config) -> tuple[Finding, ...]:
    clock = MonotonicClock()
    return (*await _beams(config, clock), *await _gnss(config, clock))


async def _beams(config: Config, clock: Clock) -> list[Finding]:
    wired = config.beams.wired()
    if not wired:
        return []
    found: list[Finding] = []
    opened: list[RangeSensor] = []
    readings: list[RangeReading] = []
    try:
        for sensor in registry.local_range_sensors(config.beams, clock, frozenset()):
            try:
                await sensor.open(LOOK_S)
                opened.append(sensor)
            except HalError as error:
                found.append(bad(str(error), "beams"))
        if opened:
            await asyncio.sleep(STARTS_S)
            for sensor in opened:
                sensor.take()
            ends_s = time.monotonic() + LOOK_S
            while time.monotonic() < ends_s:
                await asyncio.sleep(_POLL_S)
                readings += [reading for sensor in opened for reading in sensor.take()]
        ended_s = clock.now_s()
        found += troubles(opened)
    finally:
        for sensor in opened:
            await sensor.close()
    here = config.model_copy(update={"beams": config.beams.model_copy(update={"mounts": wired})})
    return [*found, *check_beams(here, readings, LOOK_S, ended_s)]


async def _gnss(config: Config, clock: Clock) -> tuple[Finding, ...]:
    receiver = registry.local_gnss(config.gnss, clock)
    if receiver is None:
        return ()
    try:
        await receiver.open(_GNSS_S)
        return about_gnss(receiver.fix())
    except HalError as error:
        return (bad(str(error), "gnss"),)
    finally:
        await receiver.close()
