"""The contract of the hardware layer. Drivers implement it; nothing else is known of them.

Concurrency: drivers run as tasks or threads and publish into `Latest` cells or a `RangeBuffer`;
reading them never blocks and never fails. Every coroutine ends within its deadline, and may be
cancelled at any await: cancelling never changes what the vehicle does by itself.
"""

from collections.abc import Callable, Mapping
from typing import Protocol, runtime_checkable

import msgspec

from hal.clock import Clock
from hal.frames import Vector3
from hal.readings import (
    Attitude,
    GnssFix,
    LocalPosition,
    RangeReading,
    StatusText,
    VehicleFacts,
    VehicleStatus,
)
from hal.setpoints import Reply, Request, Setpoint

__all__ = [
    "Clock",
    "GnssReceiver",
    "MessageSink",
    "MessageSource",
    "ParameterStore",
    "RangeSensor",
    "SeenSpace",
    "Vehicle",
    "WireMessage",
]


class Vehicle(Protocol):
    """One PX4 multicopter."""

    async def open(self, deadline_s: float) -> VehicleFacts:
        """Connect and learn who it is.

        Raises ConnectionFailed when nobody answers within `deadline_s` seconds, WrongAutopilot
        when it is not PX4. Cancelling leaves nothing open.
        """
        ...

    async def close(self) -> None:
        """Let go of the link; never changes the vehicle's mode. May be called twice."""
        ...

    def local_position(self) -> LocalPosition | None:
        """The newest estimate, or None before the first."""
        ...

    def attitude(self) -> Attitude | None:
        """The newest attitude, or None before the first."""
        ...

    def status(self) -> VehicleStatus:
        """The newest status; its `link_age_s` is counted to now."""
        ...

    def take_texts(self) -> tuple[StatusText, ...]:
        """Status texts since the last call, oldest first."""
        ...

    async def execute(self, request: Request) -> Reply:
        """Send one request and wait for the acknowledgement.

        A refusal or a silence is a Reply with `accepted=False` and a reason, not an exception.
        OFFBOARD is not even sent when the status speaks against it (`against_offboard`).
        Cancelling stops the waiting, not the request.
        """
        ...

    def send(self, setpoint: Setpoint) -> None:
        """Hand one setpoint to the link; returns at once."""
        ...

    def stop_now(self) -> None:
        """Replace the setpoint, which the link may repeat by itself, by one that stays here.

        From any thread; returns at once and asks for no mode, so it takes the vehicle from nobody.
        """
        ...


class RangeSensor(Protocol):
    """One or several beams behind one driver."""

    async def open(self, deadline_s: float) -> None:
        """Start measuring; raises ConnectionFailed when the hardware does not answer."""
        ...

    async def close(self) -> None:
        """Stop measuring. May be called twice."""
        ...

    def take(self) -> tuple[RangeReading, ...]:
        """Readings since the last call, oldest first; bounded, the oldest are dropped."""
        ...


class GnssReceiver(Protocol):
    """One GNSS receiver."""

    async def open(self, deadline_s: float) -> None:
        """Start receiving; raises ConnectionFailed when the hardware does not answer."""
        ...

    async def close(self) -> None:
        """Stop receiving. May be called twice."""
        ...

    def fix(self) -> GnssFix | None:
        """The newest solution, or None before the first."""
        ...


class WireMessage(msgspec.Struct, frozen=True):
    """One MAVLink message as it came over the vehicle's link.

    `fields_json` holds the fields under MAVLink's names and units; a number that is not finite
    is null there. `received_s` is the monotonic time of reception.
    """

    received_s: float
    system_id: int
    component_id: int
    fields_json: str


class MessageSource(Protocol):
    """A link that lets drivers read messages which its vehicle adapter does not interpret."""

    def listen(self, name: str, take: Callable[[WireMessage], None]) -> None:
        """Call `take` for each message of that name; before or after opening, until closing.

        `take` runs on the link's own thread: it must be quick and must not raise.
        """
        ...

    def stamp_s(self, message: WireMessage, boot_s: float) -> float:
        """When `boot_s`, the time in the message by its sender's clock since boot, was.

        Monotonic seconds, never after the reception; the reception itself when the sender's
        clock is not known.
        """
        ...


@runtime_checkable
class MessageSink(Protocol):
    """A link that carries messages to the vehicle which its adapter does not know."""

    def send_message(self, name: str, fields_json: str) -> None:
        """Put one message on the link, as this program; lost when the link is closed.

        `fields_json` holds the fields under MAVLink's names and units. From any thread; returns at
        once.
        """
        ...


class ParameterStore(Protocol):
    """The autopilot's parameters, and its report of what stands against arming."""

    async def read_parameters(
        self, kinds: Mapping[str, type[int] | type[float]]
    ) -> dict[str, float]:
        """Those of `kinds` that the vehicle knows. Cancelling stops after the one under way."""
        ...

    async def write_parameter(self, name: str, value: int | float) -> float | None:
        """Set a parameter and read it back; None when the vehicle did not take or tell it."""
        ...

    async def report_health(self) -> bool:
        """Ask to be told anew what stands against arming; False when the vehicle did not answer.

        The answer comes as status texts and EVENTs.
        """
        ...


class SeenSpace(Protocol):
    """What was seen to be free: the one thing that the guard asks of perception."""

    def free_distance_m(
        self, position_ned_m: Vector3, heading_rad: float, limit_m: float, now_s: float
    ) -> float:
        """How far the vehicle's body may travel horizontally from `position_ned_m` along
        `heading_rad` (NED bearing), at most `limit_m`, before its swept corridor meets space that
        holds an obstacle or was not seen free recently. 0.0 when it may not move at all.
        """
        ...

    def clearance_m(self, position_ned_m: Vector3, limit_m: float) -> float:
        """Horizontal distance from the position to the nearest known hit, at most `limit_m`."""
        ...

    def nearest_hit(self, position_ned_m: Vector3, limit_m: float) -> tuple[float, float] | None:
        """(distance_m, bearing_rad) of the nearest known hit within `limit_m`, else None."""
        ...
