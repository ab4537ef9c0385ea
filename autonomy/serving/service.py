"""The service's life: waits for a vehicle, looks at it, flies what is queued, waits anew."""

import asyncio
import contextlib
from collections.abc import Iterator

from autonomy import app
from autonomy.service.contract import Phase
from autonomy.serving.attending import Attendant
from autonomy.serving.missions import Missions
from autonomy.serving.parts import Connected, Parts, Prepare
from autonomy.serving.restart import Restart
from autonomy.termination import termination_signals
from autonomy.virtual_world import warning
from hal import registry
from hal.errors import HalError
from hal.readings import VehicleFacts

_CONNECT_S = 3.0
_RETRY_S = 0.5
_BEAT_S = 0.25


class Service:
    """`run()` ends after a signal, with the vehicle on the ground."""

    def __init__(self, parts: Parts) -> None:
        self._parts = parts
        self.attendant = Attendant(parts)
        self._missions = Missions(parts, self.attendant)
        self._restart = Restart(parts, self.attendant, self._missions)

    async def run(self) -> None:
        """Serve until `stop` is called or a signal arrives."""
        parts = self._parts
        with self._signals():
            async with asyncio.TaskGroup() as group:
                heart = group.create_task(self._beat())
                try:
                    await self._prepared()
                    while not parts.ending.is_set():
                        await self._one_connection()
                finally:
                    heart.cancel()
        parts.notifier.stopping()
        parts.station.enter(Phase.STOPPING, "the service has stopped")

    def stop(self) -> None:
        """Stop what is flown (hold, then land), then end; called again: land at once."""
        again = self._parts.ending.is_set()
        self._parts.ending.set()
        self._missions.stop(at_once=again)

    async def _prepared(self) -> None:
        """All that comes before the first vehicle, unless the service is told to end first.

        Raises what `prepare` raises, in groups.
        """
        parts = self._parts
        if parts.prepare is None:
            return
        async with asyncio.TaskGroup() as group:
            preparing = group.create_task(self._telling(parts.prepare))
            ending = group.create_task(parts.ending.wait())
            await asyncio.wait((preparing, ending), return_when=asyncio.FIRST_COMPLETED)
            preparing.cancel()
            ending.cancel()

    async def _telling(self, prepare: Prepare) -> None:
        await prepare(lambda words: self._parts.enter(Phase.PREPARING, words))

    async def _one_connection(self) -> None:
        """From waiting for a vehicle to its silence, or to the service's end."""
        parts, station = self._parts, self._parts.station
        vehicle = parts.drivers.vehicle()
        if station.phase is not Phase.WAITING or station.instant is None:
            connection = parts.config.vehicle.connection
            parts.enter(Phase.WAITING, f"waiting for a vehicle on {connection}")
        try:
            facts = await self._opened(vehicle)
            if facts is not None:
                await self._with_sensors(vehicle, facts)
        except HalError as error:
            station.vehicle_gone()
            parts.enter(Phase.WAITING, f"waiting for a vehicle: {error}")
            await self._pause(_RETRY_S)
        finally:
            await vehicle.close()

    async def _opened(self, vehicle: registry.LinkedVehicle) -> VehicleFacts | None:
        """The vehicle's facts, None when the service is told to end first; raises HalError."""
        async with asyncio.TaskGroup() as group:
            opening = group.create_task(_answer(vehicle))
            ending = group.create_task(self._parts.ending.wait())
            await asyncio.wait((opening, ending), return_when=asyncio.FIRST_COMPLETED)
            done = opening.done()
            opening.cancel()
            ending.cancel()
        if not done:
            return None
        answer = opening.result()
        if isinstance(answer, HalError):
            raise answer
        return answer

    async def _with_sensors(self, vehicle: registry.LinkedVehicle, facts: VehicleFacts) -> None:
        """A vehicle that answers gets its sensors; raises HalError when one fails to open."""
        parts, tell = self._parts, self._parts.station.tell
        sensors, gnss = parts.drivers.sensors(vehicle), parts.drivers.gnss(vehicle)
        virtual = parts.config.beams.virtual()
        if virtual is not None:
            tell("beams", warning(virtual))
        timeout_s = parts.config.vehicle.connect_timeout_s
        async with app.opened(sensors, gnss, timeout_s, lambda text: tell("gnss", text)):
            tell("connected", f"{facts.autopilot} {facts.version}, system {facts.system_id}")
            await self._at_vehicle(Connected(vehicle, facts, sensors, gnss))

    async def _at_vehicle(self, connected: Connected) -> None:
        """Look at it, fly what is queued; raises ConnectionFailed when it falls silent."""
        parts, attendant = self._parts, self.attendant
        attendant.meet(connected)
        await self._restart.see_to(connected)
        attendant.ready(connected)
        while True:
            attendant.look(connected)
            if parts.ending.is_set():
                await attendant.part(connected)
                return
            record = parts.station.take_mission()
            if record is not None:
                await self._missions.fly(record, connected)
                attendant.look(connected)
            attendant.ready(connected)
            for command in parts.station.take_commands():
                await attendant.obey(command, connected)
            await asyncio.sleep(parts.period_s)

    # ------------------------------------------------------------ life

    async def _beat(self) -> None:
        """Signs of life while nothing is flown; in flight only the control loop gives them.

        A loop that ended gives none, and the vehicle is brought down then: killed between Hold and
        Land it would stay in the air.
        """
        while True:
            flight, now_s = self._missions.flight, self._parts.drivers.clock.now_s()
            if flight is None or flight.is_closing(now_s):
                self._parts.notifier.alive(now_s)
            await asyncio.sleep(_BEAT_S)

    async def _pause(self, seconds: float) -> None:
        """Sleep, but not through the service's end."""
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(seconds):
                await self._parts.ending.wait()

    @contextlib.contextmanager
    def _signals(self) -> Iterator[None]:
        """Each of `termination_signals` is `stop`."""
        loop = asyncio.get_running_loop()
        numbers = termination_signals()
        for number in numbers:
            loop.add_signal_handler(number, self.stop)
        try:
            yield
        finally:
            for number in numbers:
                loop.remove_signal_handler(number)


async def _answer(vehicle: registry.LinkedVehicle) -> VehicleFacts | HalError:
    """The vehicle's facts, or why there is none: a task group would wrap what is raised."""
    try:
        return await vehicle.open(_CONNECT_S)
    except HalError as error:
        return error
