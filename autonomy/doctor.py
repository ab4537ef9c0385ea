"""What is wrong before flying, a sentence a finding: this machine, the vehicle on the link."""

import asyncio
import importlib.metadata
import os
import platform
import re
import shutil
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

import msgspec

from autonomy.config import Config
from autonomy.mission.preflight import parameter_findings
from autonomy.warm import warm_up
from hal.clock import MonotonicClock
from hal.errors import HalError
from hal.interfaces import RangeSensor, Vehicle
from hal.readings import RangeReading, RangeStatus

LOOK_S = 3.0
"""How long sensors are watched."""

_OLDEST_PYTHON = (3, 11)
_ROOM_BYTES = 200_000_000
"""What an hour of flight log needs, generously."""
_SLOW_WARM_UP_S = 5.0
_HALF_RATE = 0.5


class Finding(msgspec.Struct, frozen=True):
    """One thing that was looked at."""

    good: bool
    sentence: str

    def __str__(self) -> str:
        """A line for a terminal."""
        return f"{'ok  ' if self.good else 'BAD '} {self.sentence}"


# ---------------------------------------------------------------- this machine


def check_machine(config: Config, log_directory: Path) -> tuple[Finding, ...]:
    """Python, packages, kernels and disk. The configuration itself is valid: it was loaded."""
    beams = len(config.beams.mounts)
    return (
        Finding(good=True, sentence=f"the configuration is valid; it has {beams} range beams"),
        check_python(),
        *check_packages(),
        check_kernels(),
        check_disk(log_directory),
    )


def check_python() -> Finding:
    """Old Pythons do not run this program; 32-bit ones have no numba."""
    version = platform.python_version()
    if sys.version_info[:2] < _OLDEST_PYTHON or sys.maxsize < 2**32:
        return Finding(good=False, sentence=f"Python {version} is too old, or not 64-bit; use 3.11")
    return Finding(good=True, sentence=f"Python {version} on {platform.machine()}")


def check_packages() -> tuple[Finding, ...]:
    """Every dependency that this distribution asks for is there, and new enough."""
    findings = []
    for requirement in importlib.metadata.requires("autonomy") or ():
        match = re.match(r"([A-Za-z0-9_.-]+)\s*>=\s*([0-9.]+)\s*$", requirement)
        if match is None:  # an extra: not needed for flying
            continue
        name, least = match.groups()
        try:
            version = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            findings.append(f"the package {name} is missing; install it with: pip install {name}")
            continue
        if _numbers(version) < _numbers(least):
            findings.append(
                f"the package {name} is {version}; install {least} or newer with: "
                f"pip install --upgrade {name}"
            )
    if not findings:
        return (Finding(good=True, sentence="all packages are there and new enough"),)
    return tuple(Finding(good=False, sentence=sentence) for sentence in findings)


def _numbers(version: str) -> tuple[int, ...]:
    return tuple(int(part) for part in re.findall(r"\d+", version)[:3])


def check_kernels() -> Finding:
    """Compile what flies; the second time it comes from the disk."""
    before_s = time.monotonic()
    warm_up()
    took_s = time.monotonic() - before_s
    again = "; it was compiled now, the next start is fast" if took_s > _SLOW_WARM_UP_S else ""
    return Finding(good=True, sentence=f"the kernels were ready in {took_s:.1f} s{again}")


def check_disk(directory: Path) -> Finding:
    """A flight log can be written where it is to be, and there is room."""
    existing = directory
    while not existing.exists() and existing != existing.parent:
        existing = existing.parent
    try:
        with tempfile.TemporaryFile(dir=existing) as file:
            file.write(b"autonomy")
            file.flush()
            os.fsync(file.fileno())
    except OSError as error:
        return Finding(
            good=False,
            sentence=f"{directory}: flight logs cannot be written there ({error.strerror}); "
            "set log.directory or --log-dir to a folder that this user may write",
        )
    free = shutil.disk_usage(existing).free
    if free < _ROOM_BYTES:
        return Finding(
            good=False,
            sentence=f"{directory}: only {free / 1e6:.0f} MB are free; make room for flight logs",
        )
    return Finding(good=True, sentence=f"{directory}: {free / 1e9:.1f} GB free for flight logs")


# ---------------------------------------------------------------- the vehicle


def check_vehicle(config: Config, connection: str) -> tuple[Finding, ...]:
    """Link, autopilot, parameters, position, battery and the rate of every beam.

    Nothing is commanded. An error of the link is a finding, not an exception.
    """
    from hal import registry

    clock = MonotonicClock()
    vehicle_config = config.vehicle.model_copy(update={"connection": connection})
    vehicle = registry.vehicle(vehicle_config, config.beams, clock)
    sensors = registry.range_sensors(config.beams, vehicle, clock)
    return asyncio.run(_look(config, connection, vehicle, tuple(sensors)))


async def _look(
    config: Config, connection: str, vehicle: Vehicle, sensors: tuple[RangeSensor, ...]
) -> tuple[Finding, ...]:
    deadline_s = config.vehicle.connect_timeout_s
    readings: list[RangeReading] = []
    try:
        facts = await vehicle.open(deadline_s)
        for sensor in sensors:
            await sensor.open(deadline_s)
            sensor.take()
        ends_s = time.monotonic() + LOOK_S
        while time.monotonic() < ends_s:
            await asyncio.sleep(0.05)
            readings.extend(reading for sensor in sensors for reading in sensor.take())
        status, position = vehicle.status(), vehicle.local_position()
    except HalError as error:
        return (Finding(good=False, sentence=f"{connection}: {error}"),)
    finally:
        for sensor in sensors:
            await sensor.close()
        await vehicle.close()
    who = f"{facts.autopilot} {facts.version}, system {facts.system_id}, on {connection}"
    findings = [Finding(good=True, sentence=who)]
    findings += [
        Finding(good=False, sentence=text) for text in parameter_findings(facts.parameters)
    ]
    findings.append(
        Finding(good=True, sentence="it is ready to arm")
        if status.armable
        else Finding(good=False, sentence=f"it is not ready to arm: {status.not_armable_because}")
    )
    if position is None:
        findings.append(Finding(good=False, sentence="it has no local position estimate"))
    return (*findings, *check_beams(config, readings, LOOK_S))


def check_beams(
    config: Config, readings: list[RangeReading], seconds: float
) -> tuple[Finding, ...]:
    """One finding a configured beam, from what was read of all of them in `seconds`."""
    counts = Counter(reading.beam for reading in readings)
    heard = {reading.beam for reading in readings if reading.status is not RangeStatus.NO_SIGNAL}
    findings = []
    for mount in config.beams.mounts:
        rate_hz = counts[mount.name] / seconds
        if mount.name not in heard:
            what = "sends nothing" if not counts[mount.name] else "measures nothing"
            text = f"beam {mount.name} {what}; check the sensor, its wiring and beams.mounts"
            findings.append(Finding(good=False, sentence=text))
        elif rate_hz < _HALF_RATE * config.control.rate_hz:
            text = (
                f"beam {mount.name} comes at {rate_hz:.1f} Hz only; the loop runs at "
                f"{config.control.rate_hz:g} Hz: raise the sensor's rate"
            )
            findings.append(Finding(good=False, sentence=text))
        else:
            text = f"beam {mount.name}: {rate_hz:.1f} Hz"
            findings.append(Finding(good=True, sentence=text))
    return tuple(findings)
