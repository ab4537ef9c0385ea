"""Which driver answers to which name in the configuration: the only module that knows them all."""

from collections.abc import Callable
from typing import Any, Protocol

from hal.config import (
    AutopilotGnssConfig,
    BeamsConfig,
    DriverSection,
    GnssConfig,
    I2cDriver,
    MavlinkDriver,
    SerialGnssConfig,
    VehicleConfig,
    VirtualDriver,
)
from hal.errors import ReadingRefused
from hal.gnss.autopilot_gnss import AutopilotGnss
from hal.gnss.serial_receiver import SerialReceiver
from hal.interfaces import (
    Clock,
    GnssReceiver,
    MessageSink,
    MessageSource,
    ParameterStore,
    RangeSensor,
    Vehicle,
)
from hal.ranging.i2c_range_sensor import I2cRangeSensor
from hal.ranging.mavlink_beams import MavlinkBeams
from hal.ranging.told_beams import BeamTeller
from hal.ranging.virtual_beams import PoseSource, VirtualBeams

Sensors = tuple[RangeSensor, ...]
Gnss = GnssReceiver | None
Awaited = frozenset[str] | None


class LinkedVehicle(Vehicle, MessageSource, MessageSink, ParameterStore, Protocol):
    """A vehicle behind a link that drivers can listen to and the deadman can stop."""

    def hold_now(self) -> bool:
        """Ask for Hold, or for Land where it cannot hold, if the vehicle is in Offboard, as last
        heard; True when it was asked.

        From any thread; returns at once, without the answer, and needs no event loop.
        """
        ...


def _mavsdk(config: VehicleConfig, beams: BeamsConfig, clock: Clock) -> LinkedVehicle:
    # Loading the native library takes longer than printing a help text should.
    from hal.vehicle.mavsdk_vehicle import MavsdkVehicle

    return MavsdkVehicle(config, clock, beams)


VEHICLES: dict[str, Callable[[VehicleConfig, BeamsConfig, Clock], LinkedVehicle]] = {
    "mavsdk": _mavsdk
}


def vehicle(config: VehicleConfig, beams: BeamsConfig, clock: Clock) -> LinkedVehicle:
    """The vehicle that `config.driver` names; not open yet."""
    return VEHICLES[config.driver](config, beams, clock)


WIRED: dict[type[DriverSection], Callable[[Any, BeamsConfig, Clock, Awaited], RangeSensor]] = {
    I2cDriver: I2cRangeSensor,
}
"""Drivers of sensors that are wired to this computer, by their section in `beams.drivers`."""


def range_sensors(
    beams: BeamsConfig, source: MessageSource, clock: Clock, awaited: Awaited = None
) -> Sensors:
    """The drivers of all configured beams; not open yet. `awaited`: see `local_range_sensors`.

    Raises ReadingRefused when the mounts cannot be told apart over MAVLink, DocumentError when a
    virtual room does not exist or is none.
    """
    sensors: list[RangeSensor] = list(local_range_sensors(beams, clock, awaited))
    sensors += [
        _virtual(driver, beams, source, clock)
        for driver in beams.drivers
        if isinstance(driver, VirtualDriver)
    ]
    over_mavlink = next((d for d in beams.drivers if isinstance(d, MavlinkDriver)), None)
    if beams.over_mavlink() and over_mavlink is not None:
        own = beams.model_copy(update={"mounts": beams.over_mavlink()})
        sensors.append(MavlinkBeams(source, own, over_mavlink))
    return tuple(sensors)


def local_range_sensors(beams: BeamsConfig, clock: Clock, awaited: Awaited = None) -> Sensors:
    """The drivers of the beams that are wired to this computer and need no vehicle.

    Opening waits for the first measurement of the beams `awaited`; None: of all of its own.
    """
    wired = (driver for driver in beams.drivers if driver.beams_of())
    return tuple(WIRED[type(driver)](driver, beams, clock, awaited) for driver in wired)


def _virtual(
    driver: VirtualDriver, beams: BeamsConfig, source: MessageSource, clock: Clock
) -> VirtualBeams:
    # The simulated world is not loaded for those who fly in the real one.
    from hal.sim.scenario import load_scenario
    from hal.sim.virtual_room import VirtualRoom

    if not isinstance(source, PoseSource):
        raise ReadingRefused(
            "virtual beams are cast from a vehicle's pose, which this link does not tell; "
            "connect a vehicle"
        )
    teller = None
    if driver.send and isinstance(source, MessageSink):
        teller = BeamTeller(source, beams)
    room = VirtualRoom(load_scenario(driver.scenario), beams, driver.seed)
    return VirtualBeams(room, source, clock, teller=teller)


def gnss(config: GnssConfig, source: MessageSource, clock: Clock) -> Gnss:
    """The GNSS receiver that `config.driver` names; not open yet."""
    return AutopilotGnss(source) if config.driver == "autopilot" else local_gnss(config, clock)


def local_gnss(config: GnssConfig, clock: Clock) -> Gnss:
    """The receiver, where it is on this computer and needs no vehicle; not open yet."""
    match config:
        case AutopilotGnssConfig():
            return None
        case SerialGnssConfig():
            return SerialReceiver(config, clock)
