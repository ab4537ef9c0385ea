"""Killed in flight and begun anew: what becomes of a vehicle that is found in the air.

What neither PX4's failsafe nor the last life's deadman has put into Hold is somebody's, and left
alone.
"""

import asyncio
from pathlib import Path

from autonomy import in_flight
from autonomy.custody import Custody
from autonomy.flight import bring_down
from autonomy.flightlog.folder import host_boot
from autonomy.service.contract import Phase
from autonomy.serving.attending import Attendant, held_for_us
from autonomy.serving.missions import Missions
from autonomy.serving.parts import Connected, Parts
from hal.errors import ConnectionFailed
from hal.readings import FlightMode, LandedState

_OFFBOARD_LOSS_S = 1.0
"""PX4's COM_OF_LOSS_T by default."""
_TELLS_WITHIN_S = 2.5
"""A heartbeat, and so the mode and the failsafe's flag, comes once a second."""


class Restart:
    """Sees once to the vehicle that the service's last life may have left in the air."""

    def __init__(self, parts: Parts, attendant: Attendant, missions: Missions) -> None:
        self._parts = parts
        self._attendant = attendant
        self._missions = missions
        self._seen_to = False
        """What becomes of it is decided, and done."""

    async def see_to(self, connected: Connected) -> None:
        """Do what is configured, once.

        A vehicle that falls silent meanwhile (ConnectionFailed) is seen to when it is back.
        """
        if self._seen_to:
            return
        await self._settled(connected)
        if in_flight.is_in_the_air(connected.vehicle.status()):
            await self._in_the_air(connected)
        self._seen_to = True

    async def _settled(self, connected: Connected) -> None:
        """Until the vehicle told what it does, and PX4 what becomes of a stream that ended."""
        vehicle, clock = connected.vehicle, self._parts.drivers.clock
        loss_s = connected.facts.parameters.get("COM_OF_LOSS_T", _OFFBOARD_LOSS_S)
        ends_s = clock.now_s() + loss_s + _TELLS_WITHIN_S
        while clock.now_s() < ends_s and not self._parts.ending.is_set():
            self._attendant.look(connected)
            status = vehicle.status()
            unknown = status.mode is FlightMode.UNKNOWN or status.landed is LandedState.UNKNOWN
            waiting = status.mode is FlightMode.OFFBOARD or not status.in_failsafe
            down = not in_flight.is_in_the_air(status)
            if not unknown and (down or (not waiting and vehicle.local_position() is not None)):
                return
            await asyncio.sleep(self._parts.period_s)

    async def _in_the_air(self, connected: Connected) -> None:
        """Find out whose the vehicle is, and do what is configured with one's own."""
        parts, vehicle = self._parts, connected.vehicle
        parts.enter(Phase.WAITING, "the vehicle is in the air: reading the last flight's log")
        folder = Path(parts.config.log.directory)
        flight, unread = await asyncio.to_thread(in_flight.read_last_flight, folder)
        self._attendant.look(connected)
        found = in_flight.Found(
            parts.drivers.clock.now_s(),
            host_boot(),
            connected.facts,
            vehicle.status(),
            vehicle.local_position(),
            parts.config,
            self._world(),
        )
        why = unread or in_flight.why_not_ours(flight, found)
        if flight is None or why:
            self._attendant.say(f"the vehicle is in the air and left alone: {why}")
            return
        self._attendant.left.proved_ours = True
        why = in_flight.why_not_held_for_us(flight, found)
        if why is not None:
            self._attendant.say(
                f"the vehicle is in the air and left alone: {why}; it was flown by this service, "
                "which lands it when ordered"
            )
            return
        await self._take_back(flight, found, connected)

    def _world(self) -> str:
        """The scenario that flight logs name; empty for a real flight."""
        virtual = self._parts.config.beams.virtual()
        return virtual.scenario if virtual is not None else self._parts.desk.scenario or ""

    async def _take_back(
        self, flight: in_flight.Interrupted, found: in_flight.Found, connected: Connected
    ) -> None:
        """The vehicle is the interrupted flight's, and PX4 holds it: hold, land or resume."""
        choice = self._parts.config.service.on_restart_in_flight
        left = self._attendant.left.custody = held_for_us()
        if choice == "land":
            # Not ready for a mission, which would begin when it is down; but watched.
            self._parts.enter(Phase.WAITING, "this service was interrupted in flight; landing")
            self._attendant.watched()
            await self._landed(left, connected)
            return
        why = in_flight.why_not_resumed(flight, found) if choice == "resume" else None
        resumed = flight.resumed
        if choice == "hold" or why is not None or resumed is None:
            refused = f"; its mission cannot go on: {why}" if why is not None else ""
            self._attendant.say(
                "this service was interrupted in flight, PX4 holds the vehicle"
                f"{refused}; order it to land"
            )
            return
        self._attendant.say("this service was interrupted in flight; going on")
        self._seen_to = True  # whatever becomes of it: a mission goes on once
        await self._missions.fly_on(flight, resumed, connected)

    async def _landed(self, left: Custody, connected: Connected) -> None:
        """Ask for landing until the vehicle is down or somebody else's; looks at it meanwhile."""
        vehicle, config = connected.vehicle, self._parts.config
        silent_s = 2.0 * config.vehicle.link_timeout_s
        while True:
            async with asyncio.TaskGroup() as group:
                landing = group.create_task(bring_down(vehicle, config, left))
                gone = await self._looked_while(landing, connected)
                landing.cancel()
            if gone is not None:
                raise gone
            if vehicle.status().link_age_s <= silent_s:
                return

    async def _looked_while(
        self, task: asyncio.Task[None], connected: Connected
    ) -> ConnectionFailed | None:
        """Look at the vehicle until `task` ends; its silence is returned, for a task group wraps
        what is raised.
        """
        while not task.done():
            try:
                self._attendant.look(connected)
            except ConnectionFailed as error:
                return error
            await asyncio.sleep(self._parts.period_s)
        return None
