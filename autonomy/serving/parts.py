"""What every room of the service works with: its parts, its drivers, a vehicle that answers."""

import asyncio
import logging
from collections.abc import Awaitable, Callable
from dataclasses import dataclass, field

from autonomy.config import Config
from autonomy.service.contract import Phase
from autonomy.service.metrics import Metrics
from autonomy.service.station import Station
from autonomy.service.systemd import Notifier
from autonomy.serving.desk import Desk
from hal import registry
from hal.clock import MonotonicClock
from hal.interfaces import Clock
from hal.readings import VehicleFacts

_LOG = logging.getLogger("autonomy")

Prepare = Callable[[Callable[[str], None]], Awaitable[None]]


@dataclass(frozen=True)
class Drivers:
    """What the service flies with; made anew for every connection."""

    vehicle: Callable[[], registry.LinkedVehicle]
    sensors: Callable[[registry.LinkedVehicle], registry.Sensors]
    gnss: Callable[[registry.LinkedVehicle], registry.Gnss]
    clock: Clock


def real_drivers(config: Config) -> Drivers:
    """The drivers that the configuration names."""
    clock = MonotonicClock()
    return Drivers(
        lambda: registry.vehicle(config.vehicle, config.beams, clock),
        lambda vehicle: registry.range_sensors(config.beams, vehicle, clock),
        lambda vehicle: registry.gnss(config.gnss, vehicle, clock),
        clock,
    )


@dataclass(frozen=True)
class Connected:
    """A vehicle that answers, with its sensors."""

    vehicle: registry.LinkedVehicle
    facts: VehicleFacts
    sensors: registry.Sensors
    gnss: registry.Gnss


@dataclass(frozen=True)
class Parts:
    """What the service is made of; `ending` is set once it was told to stop."""

    config: Config
    desk: Desk
    station: Station
    metrics: Metrics
    notifier: Notifier
    drivers: Drivers
    ending: asyncio.Event = field(default_factory=asyncio.Event)
    true_clearance_m: Callable[[], float | None] | None = None
    """In simulation: the least true clearance since it was asked last."""
    prepare: Prepare | None = None
    """What comes before the first vehicle; it tells what it does, a sentence at a time."""

    @property
    def period_s(self) -> float:
        """Between two looks at a vehicle."""
        return 1.0 / self.config.control.rate_hz

    def enter(self, phase: Phase, why: str) -> None:
        """Say to everybody (page, log, systemd) what the service does now."""
        if phase is not self.station.phase or why != self.station.why:
            said = why if why.startswith(phase.value) else f"{phase.value}: {why}"
            _LOG.info("%s", said)
        self.station.enter(phase, why)
        self.notifier.status(why)
