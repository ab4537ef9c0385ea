"""A vehicle that is not flown: looked at, kept in the service's frame, and, where this service left
it in the air, ordered about.
"""

import math

from autonomy import in_flight
from autonomy.custody import Custody
from autonomy.flight import bring_down
from autonomy.geometry import Point
from autonomy.model import OperatorCommand
from autonomy.service.contract import Phase
from autonomy.service.station import Instant
from autonomy.serving.parts import Connected, Parts
from hal.drops import dropped_by
from hal.errors import ConnectionFailed
from hal.frames import ZERO3, Vector3, add, subtract
from hal.readings import (
    FlightMode,
    LandedState,
    LocalPosition,
    RangeReading,
    VehicleFacts,
    VehicleStatus,
)
from hal.setpoints import Request, RequestKind

_JUMP_M = 0.3
"""A vehicle on the ground does not move this far between two looks: its frame jumped."""


class ServiceFrame:
    """Where the service's frame lies in the autopilot's local frame."""

    def __init__(self) -> None:
        self._origin_ned_m: Vector3 | None = None
        """None until a mission was armed."""
        self._last: LocalPosition | None = None

    def forget(self) -> None:
        """Another vehicle, or one that was away: a new frame begins where it stands."""
        self._origin_ned_m, self._last = None, None

    def landed(self, home_ned_m: Vector3, offset: Point, position: LocalPosition | None) -> None:
        """A mission is over whose pilot's frame began at `home_ned_m`, `offset` in this frame."""
        self._origin_ned_m = (home_ned_m[0] - offset[0], home_ned_m[1] - offset[1], home_ned_m[2])
        self._last = position

    def follow(self, position: LocalPosition | None, *, on_ground: bool) -> None:
        """On the ground only the frame moves: where it jumps, the service's frame jumps along."""
        last, self._last = self._last, position
        if last is None or position is None or self._origin_ned_m is None:
            return
        jump = subtract(position.position_ned_m, last.position_ned_m)
        reset = position.reset_counter != last.reset_counter
        if on_ground and (reset or math.hypot(*jump) > _JUMP_M):
            self._origin_ned_m = add(self._origin_ned_m, jump)

    def origin(self, position: LocalPosition | None, *, in_the_air: bool = False) -> Vector3:
        """The origin; before the first mission it is where the vehicle stands.

        Found in the air, its height counts from PX4's own origin: where PX4 was started, mostly.
        """
        if self._origin_ned_m is not None:
            return self._origin_ned_m
        if position is None:
            return ZERO3
        north, east, down = position.position_ned_m
        return north, east, 0.0 if in_the_air else down


class LeftInAir:
    """What a mission of this service, or of its last life, left flying."""

    def __init__(self) -> None:
        self.custody: Custody | None = None
        """None when it landed, or somebody else chose its mode."""
        self.proved_ours = False
        """The vehicle in the air is this service's, by a log or because it was lost in its flight:
        it obeys an operator's order also where Hold may be a pilot's."""
        self._lost = False
        """Its link or its setpoints were lost, and nobody but PX4's failsafe was seen since."""
        self._met: tuple[VehicleFacts, float] | None = None

    def meet(self, facts: VehicleFacts, now_s: float) -> None:
        """A vehicle answers: what is left belonged to another, or to its life before."""
        met, self._met = self._met, (facts, now_s)
        if met is not None and in_flight.why_another(*met, facts, now_s) is not None:
            self._forget()

    def _forget(self) -> None:
        self.custody, self.proved_ours, self._lost = None, False, False

    def lose(self) -> None:
        """A flight lost its link or its setpoints: PX4's failsafe is not somebody else."""
        self.proved_ours = self._lost = True

    def see(self, status: VehicleStatus) -> bool:
        """Let go of a vehicle that is down, or in a mode that somebody else chose.

        True when PX4's failsafe is found to hold what was lost.
        """
        if status.landed is LandedState.ON_GROUND and not status.armed:
            self._forget()
            return False
        if self.custody is not None and not self.custody.holds(status.mode):
            self.custody = None
        if not self._lost or self.custody is not None:
            return False
        self._lost = status.mode is FlightMode.HOLD and status.in_failsafe
        self.custody = held_for_us() if self._lost else None
        return self._lost

    def ordered(self, mode: FlightMode) -> Custody | None:
        """The custody by which an order is obeyed; None where it is not this service's to obey."""
        left = self.custody
        if left is not None and left.holds(mode):
            return left
        if self.proved_ours and mode in in_flight.OBEYED_IN:
            return held_for_us()
        return None


def held_for_us() -> Custody:
    """Custody of a vehicle that PX4 holds for this service."""
    custody = Custody()
    custody.adopt(RequestKind.HOLD)
    return custody


class Attendant:
    """Looks after whatever vehicle is connected while nothing is flown."""

    def __init__(self, parts: Parts) -> None:
        self._parts = parts
        self.frame = ServiceFrame()
        self.left = LeftInAir()
        self._said: tuple[str, Custody | None] = ("", None)
        """What was found out of the vehicle in the air, and the custody that it is true for."""
        self._readings: dict[str, RangeReading] = {}
        self._ready_told = False

    def meet(self, connected: Connected) -> None:
        """A vehicle answers: what was known of the last one is forgotten."""
        self.frame.forget()
        self.left.meet(connected.facts, self._parts.drivers.clock.now_s())
        self._readings.clear()
        self.forget_said()
        drivers = (connected.vehicle, *connected.sensors, connected.gnss)
        self._parts.station.dropped = lambda: dropped_by(drivers)

    def ready(self, connected: Connected) -> None:
        """Say that a mission may come, or what is in the air."""
        if self._parts.ending.is_set():
            return
        self._parts.enter(Phase.READY, self._at_rest(connected))
        self.watched()

    def watched(self) -> None:
        """Tell systemd, once, that the service does what it is for: its watchdog counts from here.

        It is no promise that a mission may come: `Phase.READY` is.
        """
        if not self._ready_told:
            self._ready_told = True
            self._parts.notifier.ready()

    def say(self, why: str) -> None:
        """Of the vehicle in the air: told now, and the answer to `ready` while its custody stays
        what it is.
        """
        self._said = why, self.left.custody
        self._parts.station.tell("in_flight", why)

    def forget_said(self) -> None:
        """What was found out is no longer so: it is down, flown, or another vehicle."""
        self._said = "", None

    def _at_rest(self, connected: Connected) -> str:
        """A vehicle that is not flown by this service, in a sentence."""
        facts = connected.facts
        name = f"{facts.autopilot} {facts.version}"
        status, custody = connected.vehicle.status(), self.left.custody
        if not in_flight.is_in_the_air(status):
            self.forget_said()
            return f"{name} is ready for a mission"
        if custody is not None and status.mode is FlightMode.LAND:
            return f"{name} is landing for this service"
        said, while_held = self._said
        if said and while_held is custody:
            return said
        if custody is not None:
            return f"{name} is in the air, where its mission left it; order it to land"
        return f"{name} is in the air, and not flown by this service"

    def look(self, connected: Connected) -> None:
        """One look; raises ConnectionFailed when it fell silent."""
        vehicle, station, config = connected.vehicle, self._parts.station, self._parts.config
        status = vehicle.status()
        if status.link_age_s > config.service.reconnect_after_s:
            raise ConnectionFailed(
                f"the vehicle on {config.vehicle.connection} fell silent; check its power "
                "and its link"
            )
        for sensor in connected.sensors:
            for reading in sensor.take():
                self._readings[reading.beam] = reading
        for text in vehicle.take_texts():
            station.tell("px4", f"PX4: {text.text}")
        position = vehicle.local_position()
        on_ground = status.landed is LandedState.ON_GROUND or not status.armed
        self.frame.follow(position, on_ground=on_ground)
        if self.left.see(status):
            self.say("PX4's failsafe holds the vehicle, which this service lost; order it to land")
        station.at_rest(
            Instant(
                now_s=self._parts.drivers.clock.now_s(),
                status=status,
                readings=dict(self._readings),
                position=position,
                attitude=vehicle.attitude(),
                origin_ned_m=self.frame.origin(
                    position, in_the_air=in_flight.is_in_the_air(status)
                ),
            )
        )

    async def obey(self, command: OperatorCommand, connected: Connected) -> None:
        """Commands while nothing is flown: they matter only for what this service left in the air.

        A vehicle that somebody else flies is not this service's to stop.
        """
        tell = self._parts.station.tell
        left = self.left.ordered(connected.vehicle.status().mode)
        if left is None:
            tell("refused", f"{command.value}: nothing is flown by this service")
            return
        if command is OperatorCommand.RESUME:
            tell("refused", "resume: the mission is over; begin a new one")
            return
        self.left.custody = left
        kind = RequestKind.LAND if command is OperatorCommand.LAND else RequestKind.HOLD
        left.asked(kind)
        reply = await connected.vehicle.execute(Request(kind))
        said = "accepted" if reply.accepted else reply.reason
        tell(command.value, f"{kind.value} in Hold: {said}")

    async def part(self, connected: Connected) -> None:
        """The service ends: what it left in the air is landed."""
        if self.left.custody is not None:
            await bring_down(connected.vehicle, self._parts.config, self.left.custody)
