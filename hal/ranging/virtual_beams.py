"""Range beams that are cast from the vehicle's reported pose into a room that is not there.

For flying a real PX4 (in its own simulation, or in an empty hall) past obstacles that harm nobody.
The vehicle is as blind to the real world as without beams.
"""

import asyncio
import math
import threading
from collections import deque
from collections.abc import Callable
from typing import Protocol, runtime_checkable

import msgspec

from hal.clock import Clock
from hal.errors import SensorSilent
from hal.frames import ZERO3, Vector3, add, scale, subtract
from hal.ranging.told_beams import BeamTeller
from hal.ranging.waiter import ThreadWaiter, Waiter
from hal.readings import (
    Attitude,
    LandedState,
    LocalPosition,
    RangeReading,
    RangeStatus,
    VehicleStatus,
)

_KEPT = 256
_LOOK_S = 0.01
_POLL_S = 0.02
_ATTITUDE_FRESH_S = 0.2
_JOIN_S = 2.0
_NOT_FLYING = (LandedState.ON_GROUND, LandedState.UNKNOWN)


@runtime_checkable
class PoseSource(Protocol):
    """Who tells where the vehicle is: every `hal.interfaces.Vehicle`."""

    def local_position(self) -> LocalPosition | None:
        """The newest estimate, or None before the first."""
        ...

    def attitude(self) -> Attitude | None:
        """The newest attitude, or None before the first."""
        ...

    def status(self) -> VehicleStatus:
        """The newest status."""
        ...


class Room(Protocol):
    """What the beams look into; `hal.sim.virtual_room` has one."""

    @property
    def beams(self) -> tuple[str, ...]:
        """The names of the beams."""
        ...

    def sample(
        self,
        elapsed_s: float,
        position_ned_m: Vector3,
        roll_rad: float,
        pitch_rad: float,
        yaw_rad: float,
    ) -> tuple[RangeReading, ...]:
        """The readings that become known now, stamped in the room's time; empty when none."""
        ...

    def clearance_m(self, elapsed_s: float, position_ned_m: Vector3) -> float:
        """Distance from a point to the nearest surface; inf where there is none."""
        ...

    def touches(self, elapsed_s: float, position_ned_m: Vector3) -> bool:
        """True when the vehicle's body would touch something there."""
        ...


class TakeOffFrame:
    """Where the room is: its origin is the place at which the vehicle was first armed.

    Until then the room moves with the vehicle, which stands in its origin. North is the vehicle's
    own north. When PX4's local frame jumps (its reset counter changes), the room jumps with it:
    the vehicle did not move, so nothing around it may.
    """

    def __init__(self) -> None:
        self._origin_ned_m = ZERO3
        self._fixed = False
        self._last: LocalPosition | None = None

    def place(self, position: LocalPosition, *, waiting: bool) -> Vector3:
        """The vehicle's position in the room; `waiting`: on the ground and not armed."""
        if self._last is not None and self._last.reset_counter != position.reset_counter:
            flown_s = position.stamp_s - self._last.stamp_s
            expected = add(self._last.position_ned_m, scale(self._last.velocity_ned_m_s, flown_s))
            jump = subtract(position.position_ned_m, expected)
            self._origin_ned_m = add(self._origin_ned_m, jump)
        self._fixed = self._fixed or (not waiting and self._last is not None)
        if not self._fixed:
            self._origin_ned_m = position.position_ned_m
        self._last = position
        return subtract(position.position_ned_m, self._origin_ned_m)


class NearMiss(msgspec.Struct, frozen=True):
    """How near the vehicle came, by its reported pose, since it was armed last.

    `least_m` is from its centre to the nearest surface, None when it did not fly or nothing was
    there; `collisions` counts how often its body began to touch something.
    """

    least_m: float | None = None
    collisions: int = 0
    touching: bool = False

    def after(self, clearance_m: float, *, touching: bool) -> "NearMiss":
        """With one more place."""
        least_m = self.least_m
        if math.isfinite(clearance_m):
            least_m = clearance_m if least_m is None else min(least_m, clearance_m)
        began = touching and not self.touching
        return NearMiss(least_m, self.collisions + began, touching)


class VirtualBeams:
    """`hal.interfaces.RangeSensor`: all beams, cast whenever a new pose was reported.

    A reading's stamp is that of the pose. Without new poses there are no readings.
    """

    def __init__(
        self,
        room: Room,
        vehicle: PoseSource,
        clock: Clock,
        *,
        teller: BeamTeller | None = None,
        new_waiter: Callable[[], Waiter] = ThreadWaiter,
    ) -> None:
        """`teller` also gets every reading, to send it to the vehicle."""
        self._room = room
        self._vehicle = vehicle
        self._clock = clock
        self._teller = teller
        self._new_waiter = new_waiter
        self._readings: deque[RangeReading] = deque(maxlen=_KEPT)
        self._thread: threading.Thread | None = None
        self._waiter: Waiter | None = None
        self._frame = TakeOffFrame()
        self._since_s = 0.0
        self._seen_s = -math.inf
        self._heard = False
        self._armed = False
        self._failure: str | None = None
        self.near_miss = NearMiss()
        """Of the flight that is flown, or was flown last."""

    async def open(self, deadline_s: float) -> None:
        """Begin to look; returns with the first readings.

        Raises SensorSilent when the vehicle reports no new pose within `deadline_s`. Cancelling
        closes it. The room's origin is found anew.
        """
        await self.close()
        self._start()
        try:
            async with asyncio.timeout(deadline_s):
                while not self._heard:
                    self._refuse_a_defect()
                    await asyncio.sleep(_POLL_S)
        except TimeoutError:
            await self.close()
            raise SensorSilent(
                f"the virtual beams {', '.join(self._room.beams)} are cast from the vehicle's "
                f"pose, and {self._missing()} within {deadline_s:g} s; "
                "check its position source and the link"
            ) from None
        except BaseException:
            await self.close()
            raise

    def _missing(self) -> str:
        if self._vehicle.local_position() is None:
            return "it told no valid local position"
        if self._vehicle.attitude() is None:
            return "it told no attitude"
        return "none came"

    def _refuse_a_defect(self) -> None:
        if self._failure is not None:
            raise SensorSilent(self._failure)

    async def close(self) -> None:
        """Stop looking. May be called twice; `near_miss` stays."""
        thread, self._thread = self._thread, None
        if self._waiter is not None:
            self._waiter.stop()
        if thread is not None:
            await asyncio.to_thread(thread.join, _JOIN_S)
        self._readings.clear()

    def take(self) -> tuple[RangeReading, ...]:
        """Readings since the last call, oldest first; at most the last 256."""
        return tuple(self._readings.popleft() for _ in range(len(self._readings)))

    # ------------------------------------------------------------------ the thread

    def _start(self) -> None:
        self._frame, self._heard, self._failure = TakeOffFrame(), False, None
        self._since_s = self._clock.now_s()
        position = self._vehicle.local_position()
        self._seen_s = position.stamp_s if position is not None else -math.inf
        self._armed, self.near_miss = False, NearMiss()
        waiter = self._waiter = self._new_waiter()
        self._thread = threading.Thread(
            target=self._serve, args=(waiter,), name="virtual beams", daemon=True
        )
        self._thread.start()

    def _serve(self, waiter: Waiter) -> None:
        try:
            while not waiter.wait(_LOOK_S):
                self._look()
        except Exception as error:  # noqa: BLE001 - a thread's last words; told by `open`
            self._failure = f"a defect of the virtual beams: {type(error).__name__}: {error}"

    def _look(self) -> None:
        """Cast, if there is a pose that was not used yet."""
        position, attitude = self._vehicle.local_position(), self._vehicle.attitude()
        if position is None or attitude is None or position.stamp_s <= self._seen_s:
            return
        since_s = position.stamp_s - attitude.stamp_s
        if abs(since_s) > _ATTITUDE_FRESH_S:
            return
        self._seen_s = position.stamp_s
        status = self._vehicle.status()
        flying = status.landed not in _NOT_FLYING
        place = self._frame.place(position, waiting=not status.armed and not flying)
        elapsed_s = position.stamp_s - self._since_s
        self._watch(elapsed_s, place, armed=status.armed, flying=flying)
        readings = self._room.sample(
            elapsed_s,
            place,
            attitude.roll_rad,
            attitude.pitch_rad,
            attitude.yaw_rad + attitude.yaw_rate_rad_s * since_s,
        )
        told = tuple(_told(reading, self._since_s) for reading in readings)
        self._readings.extend(told)
        self._heard = self._heard or bool(told)
        if self._teller is not None:
            self._teller.tell(told)

    def _watch(self, elapsed_s: float, place: Vector3, *, armed: bool, flying: bool) -> None:
        if armed and not self._armed:
            self.near_miss = NearMiss()
        self._armed = armed
        if armed and flying:
            self.near_miss = self.near_miss.after(
                self._room.clearance_m(elapsed_s, place),
                touching=self._room.touches(elapsed_s, place),
            )


def _told(reading: RangeReading, since_s: float) -> RangeReading:
    """A reading of the room in the machine's time; a limit is not a distance, as everywhere."""
    status = reading.status
    if status is RangeStatus.VALID and reading.range_m <= reading.min_m:
        status = RangeStatus.TOO_NEAR
    elif status is RangeStatus.VALID and reading.range_m >= reading.max_m:
        status = RangeStatus.OUT_OF_RANGE
    return msgspec.structs.replace(reading, stamp_s=reading.stamp_s + since_s, status=status)
