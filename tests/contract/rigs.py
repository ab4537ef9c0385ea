"""Every implementation of the hardware contract, each with a way to let time pass and to fall
silent. A driver that is added is added here."""

import asyncio
import os
import signal
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Protocol, Self

import numpy as np
import pytest
from _pytest.mark.structures import ParameterSet

from autonomy.embedded import EmbeddedPx4
from hal import registry
from hal.clock import MonotonicClock, SimClock
from hal.config import AutopilotGnssConfig, BeamsConfig, SerialGnssConfig, VehicleConfig
from hal.gnss.autopilot_gnss import AutopilotGnss
from hal.gnss.serial_receiver import PortState, SerialReceiver
from hal.interfaces import Clock, GnssReceiver, RangeSensor, Vehicle
from hal.ranging.mavlink_beams import MavlinkBeams
from hal.ranging.virtual_beams import VirtualBeams
from hal.sim.autopilot import Autopilot
from hal.sim.scenario import load_scenario
from hal.sim.vehicle import SimVehicle
from hal.sim.virtual_room import VirtualRoom
from tests.support import i2c_rig, readme_driver
from tests.support.gnss import PtyReceiver, moved_deg, nav_pvt
from tests.support.link import SpokenLink
from tests.support.lockstep import LockstepTime

SCENARIO = "empty"
_TICK_S = 0.05


class Rig(Protocol):
    """What a contract test needs to know of an implementation."""

    vehicle: Vehicle
    clock: Clock
    range_sensor: RangeSensor | None
    gnss: GnssReceiver | None

    async def __aenter__(self) -> Self: ...

    async def __aexit__(self, *_: object) -> None: ...

    async def pass_time(self, seconds: float) -> None: ...

    def fall_silent(self) -> None: ...

    def speak_again(self) -> None: ...


class SimulatedRig:
    """The in-process vehicle on its own clock."""

    def __init__(self) -> None:
        self.sim_clock = SimClock(100.0)
        self.clock: Clock = self.sim_clock
        autopilot = Autopilot(load_scenario(SCENARIO), np.random.default_rng(5))
        self.simulated = SimVehicle(autopilot, self.sim_clock)
        self.vehicle: Vehicle = self.simulated
        self.range_sensor: RangeSensor | None = None
        self.gnss: GnssReceiver | None = None

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *_: object) -> None:
        await self.vehicle.close()

    async def pass_time(self, seconds: float) -> None:
        for _ in range(round(seconds / _TICK_S)):
            self.simulated.advance(_TICK_S)

    def fall_silent(self) -> None:
        self.simulated.cut_link()

    def speak_again(self) -> None:
        self.simulated.restore_link()


class MavsdkRig:
    """MAVSDK and its drivers against the mock PX4, in wall-clock time."""

    def __init__(self, px4: EmbeddedPx4) -> None:
        self.clock: Clock = MonotonicClock()
        self._px4 = px4
        beams = BeamsConfig()
        linked = registry.vehicle(VehicleConfig(connection=self._px4.connection), beams, self.clock)
        self.vehicle: Vehicle = linked
        self.range_sensor: RangeSensor | None
        (self.range_sensor,) = registry.range_sensors(beams, linked, self.clock)
        self.gnss: GnssReceiver | None = registry.gnss(AutopilotGnssConfig(), linked, self.clock)

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(self, *_: object) -> None:
        self.speak_again()
        await self.vehicle.close()

    async def pass_time(self, seconds: float) -> None:
        await asyncio.sleep(seconds)

    def fall_silent(self) -> None:
        """Returns when nothing of the other process runs any more: it might still answer."""
        self._strike(signal.SIGSTOP)
        while not self._stands_still():
            time.sleep(0.001)

    def speak_again(self) -> None:
        self._strike(signal.SIGCONT)

    def _stands_still(self) -> bool:
        """True when every thread is stopped; the state follows the name in parentheses."""
        stats = Path(f"/proc/{self._px4.pid}/task").glob("*/stat")
        return all(stat.read_text().rpartition(")")[2].split()[0] == "T" for stat in stats)

    def _strike(self, number: signal.Signals) -> None:
        assert self._px4.pid is not None
        os.kill(self._px4.pid, number)


class SpokenRig:
    """The drivers over a link without a wire; the simulated vehicle stands beside them."""

    def __init__(self) -> None:
        self.link = SpokenLink()
        simulated = SimulatedRig()
        self.clock: Clock = simulated.clock
        self._sim_clock = simulated.sim_clock
        self.vehicle: Vehicle = simulated.vehicle
        self.range_sensor: RangeSensor | None = MavlinkBeams(self.link, BeamsConfig())
        self.gnss: GnssReceiver | None = AutopilotGnss(self.link)
        self._silent = False
        self._speaker: asyncio.Task[None] | None = None

    async def __aenter__(self) -> Self:
        self._speaker = asyncio.get_running_loop().create_task(self._speak_on())
        return self

    async def __aexit__(self, *_: object) -> None:
        if self._speaker is not None:
            self._speaker.cancel()
            await asyncio.gather(self._speaker, return_exceptions=True)

    async def pass_time(self, seconds: float) -> None:
        for _ in range(round(seconds / _TICK_S)):
            self._speak()

    def fall_silent(self) -> None:
        self._silent = True

    def speak_again(self) -> None:
        self._silent = False

    async def _speak_on(self) -> None:
        while True:
            self._speak()
            await asyncio.sleep(0.005)

    def _speak(self) -> None:
        self._sim_clock.advance(_TICK_S)
        now_s = self._sim_clock.now_s()
        if self._silent:
            return
        for orientation, distance_cm in ((0, 50), (2, 100), (4, 2), (6, 99), (24, 70), (25, 40)):
            self.link.say(
                "DISTANCE_SENSOR",
                now_s,
                time_boot_ms=int(now_s * 1000),
                min_distance=2,
                max_distance=100,
                current_distance=distance_cm,
                id=0,
                orientation=orientation,
                covariance=255,
                signal_quality=0,
            )
        self.link.say(
            "GPS_RAW_INT",
            now_s,
            time_usec=int(now_s * 1e6),
            fix_type=3,
            lat=473_981_442,
            lon=85_456_036,
            alt=489_405,
            eph=70,
            epv=110,
            satellites_visible=10,
            h_acc=900,
            v_acc=1780,
        )


class BusRig:
    """Sensors on a fake I2C bus in simulated time; the simulated vehicle stands beside them."""

    def __init__(self, wire: Callable[[Clock], i2c_rig.Bench]) -> None:
        self._time = LockstepTime()
        self.clock: Clock = self._time.clock
        self.bench = wire(self.clock)
        self.vehicle: Vehicle = SimulatedRig().vehicle
        self.range_sensor: RangeSensor | None = self.bench.sensor(self._time)
        self.gnss: GnssReceiver | None = None
        self._ticking: asyncio.Task[None] | None = None

    async def __aenter__(self) -> Self:
        self._ticking = asyncio.get_running_loop().create_task(self._tick_on())
        return self

    async def __aexit__(self, *_: object) -> None:
        if self.range_sensor is not None:
            await self.range_sensor.close()
        if self._ticking is not None:
            self._ticking.cancel()
            await asyncio.gather(self._ticking, return_exceptions=True)

    async def _tick_on(self) -> None:
        while True:
            self._time.advance(_TICK_S)
            await asyncio.sleep(0.001)

    async def pass_time(self, seconds: float) -> None:
        self._time.advance(seconds)

    def fall_silent(self) -> None:
        self.bench.bus.dead = True

    def speak_again(self) -> None:
        self.bench.bus.dead = False


class VirtualRig(SimulatedRig):
    """Virtual beams around the simulated vehicle, their thread in step with its time."""

    def __init__(self) -> None:
        super().__init__()
        self._time = LockstepTime()
        self.range_sensor: RangeSensor | None = VirtualBeams(
            VirtualRoom(load_scenario("default"), BeamsConfig(), 5),
            self.simulated,
            self.clock,
            new_waiter=self._time.new_waiter,
        )
        self._ticking: asyncio.Task[None] | None = None

    async def __aenter__(self) -> Self:
        self._ticking = asyncio.get_running_loop().create_task(self._tick_on())
        return self

    async def __aexit__(self, *_: object) -> None:
        if self.range_sensor is not None:
            await self.range_sensor.close()
        if self._ticking is not None:
            self._ticking.cancel()
            await asyncio.gather(self._ticking, return_exceptions=True)
        await super().__aexit__()

    async def _tick_on(self) -> None:
        while True:
            self._tick()
            await asyncio.sleep(0.001)

    def _tick(self) -> None:
        self.simulated.advance(_TICK_S)
        self._time.advance(_TICK_S)

    async def pass_time(self, seconds: float) -> None:
        for _ in range(round(seconds / _TICK_S)):
            self._tick()


class SerialGnssRig(SimulatedRig):
    """The serial receiver on a pseudo-terminal; the simulated vehicle stands beside it."""

    def __init__(self) -> None:
        super().__init__()
        self._folder = tempfile.TemporaryDirectory()
        self._device = PtyReceiver(Path(self._folder.name))
        config = SerialGnssConfig(port=str(self._device.path), baud=38_400)
        self.receiver = SerialReceiver(config, self.clock)
        self.gnss: GnssReceiver | None = self.receiver
        self._silent = False
        self._step = 0
        self._speaker: asyncio.Task[None] | None = None

    async def __aenter__(self) -> Self:
        self._speaker = asyncio.get_running_loop().create_task(self._speak_on())
        return self

    async def __aexit__(self, *_: object) -> None:
        if self._speaker is not None:
            self._speaker.cancel()
            await asyncio.gather(self._speaker, return_exceptions=True)
        await self.receiver.close()
        self._device.unplug()
        self._folder.cleanup()
        await super().__aexit__()

    async def pass_time(self, seconds: float) -> None:
        before = self.receiver.fix()
        for _ in range(round(seconds / _TICK_S)):
            self._speak()
            await asyncio.sleep(0.005)
        for _ in range(1_000):  # a busy machine's thread reads late
            receiving = self.receiver.health().state is PortState.RECEIVING
            if self._silent or not receiving or self.receiver.fix() != before:
                return
            await asyncio.sleep(0.005)

    def fall_silent(self) -> None:
        self._silent = True

    def speak_again(self) -> None:
        self._silent = False

    async def _speak_on(self) -> None:
        while True:
            self._speak()
            await asyncio.sleep(0.005)

    def _speak(self) -> None:
        self.sim_clock.advance(_TICK_S)
        self._step += 1
        if not self._silent:
            self._device.say(nav_pvt(self.clock.now_s(), latitude_deg=moved_deg(self._step)))


IN_PROCESS: dict[str, Callable[[], Rig]] = {
    "simulated": SimulatedRig,
    "spoken": SpokenRig,
    "serial": SerialGnssRig,
    "virtual": VirtualRig,
    "vl53l0x behind tca9548a": lambda: BusRig(i2c_rig.behind_a_multiplexer),
    "vl53l1x with xshut": lambda: BusRig(i2c_rig.with_xshut_lines),
    "gp2y0a21 on ads1115": lambda: BusRig(i2c_rig.on_converters),
    "mixed i2c": lambda: BusRig(i2c_rig.mixed),
    "the README's example": lambda: BusRig(readme_driver.worked_example),
}
_NOT_ON_A_BUS = ("simulated", "spoken", "serial", "virtual")
ON_A_BUS = tuple(name for name in IN_PROCESS if name not in _NOT_ON_A_BUS)
OVER_THE_WIRE: dict[str, Callable[[EmbeddedPx4], Rig]] = {"mavsdk": MavsdkRig}


def parameters(*in_process: str) -> list[ParameterSet]:
    """These in-process rigs and all that need the mock PX4, as parameters of a fixture."""
    return [
        *(pytest.param(name) for name in in_process),
        *(pytest.param(name, marks=pytest.mark.integration) for name in OVER_THE_WIRE),
    ]


def build(request: pytest.FixtureRequest) -> Rig:
    """The rig that the fixture's parameter names; starts the mock PX4 where it is needed."""
    if request.param in IN_PROCESS:
        return IN_PROCESS[request.param]()
    return OVER_THE_WIRE[request.param](request.getfixturevalue("px4"))
