"""Where the control loop and the web meet: newest values one way, orders the other.

The control side writes from its own thread by replacing references to immutable things; it never
waits, encodes nothing and calls nobody. The web side reads whatever is newest at its own pace and
leaves orders, which the control side takes at its next tick.
"""

import threading
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any

import msgspec
import numpy as np
import numpy.typing as npt

from autonomy.config import Config
from autonomy.errors import BadInput
from autonomy.geometry import Point, distance
from autonomy.mission.sensing import Sensing
from autonomy.model import Command, Event, NoPlan, OperatorCommand, Plan
from autonomy.service.contract import EventView, MissionOrder, MissionRecord, MissionStatus, Phase
from autonomy.service.lock import utc_now
from autonomy.service.sightings import Sightings, ending_faults
from hal.drops import Dropped
from hal.readings import Attitude, LocalPosition, RangeReading, VehicleStatus

MISSIONS_KEPT = 100
EVENTS_KEPT = 300
_TRACK_STEP_M = 0.03
_NO_HITS: npt.NDArray[np.float64] = np.empty((0, 2))


class Refused(BadInput):
    """An order that cannot be taken now; the sentence says why."""


@dataclass(frozen=True, slots=True)
class Instant:
    """Everything the control side knows at one tick, by reference."""

    now_s: float
    status: VehicleStatus
    readings: dict[str, RangeReading]
    position: LocalPosition | None = None
    attitude: Attitude | None = None
    origin_ned_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """The service's frame in the autopilot's local frame; used while nothing is flown."""
    command: Command | None = None


@dataclass(frozen=True, slots=True)
class FlownMission:
    """What of a flight does not change from tick to tick."""

    id: str
    goals: tuple[Point, ...]
    offset: Point
    """The mission's origin in the service's frame: added to everything the pilot says."""


@dataclass(slots=True)
class Drawn:
    """What the page draws of one flight; versions tell what is new."""

    flown: FlownMission
    number: int
    hits_version: int = -1
    hits: npt.NDArray[np.float64] = field(default_factory=lambda: _NO_HITS)
    plan_version: int = 0
    plan: Plan | NoPlan | None = None
    plan_why: str = ""
    track: list[Point] = field(default_factory=list)
    events: list[Event] = field(default_factory=list)
    """Tracks and events only grow: another thread may read what is there."""
    faults: Sightings = field(default_factory=Sightings)


class Station:
    """The meeting place. Methods say which side calls them."""

    def __init__(
        self,
        config: Config,
        check: Callable[[MissionOrder], None],
        utc: Callable[[], str] = utc_now,
    ) -> None:
        """`check` raises BadInput for an order that must not be flown; called on the web side.
        `utc` stamps events.
        """
        self.config = config
        self._check = check
        self._utc = utc
        self.phase = Phase.WAITING
        self.why = "starting"
        self.instant: Instant | None = None
        self.dropped: Callable[[], Dropped] = dict
        """What vehicle and sensors did not believe, since they were connected."""
        self.drawn: Drawn | None = None
        self.events: tuple[EventView, ...] = ()
        self._events_told = 0
        self._missions: dict[str, MissionRecord] = {}
        self._mission_count = 0
        self._queued: deque[str] = deque()
        self._commands: deque[OperatorCommand] = deque()
        self._lock = threading.Lock()
        """Held for dictionary work on missions and events only, never while anything waits."""

    # ------------------------------------------------------------ control side: what is

    def enter(self, phase: Phase, why: str) -> None:
        """The service does something else now; `why` is a sentence for people."""
        changed = (phase, why) != (self.phase, self.why)
        self.phase, self.why = phase, why
        if changed:
            self.tell(phase.value, why)

    def tell(self, name: str, why: str) -> None:
        """One event. Either side may call it."""
        with self._lock:
            self._events_told += 1
            event = EventView(self._events_told, self._utc(), name, why)
            self.events = (*self.events[1 - EVENTS_KEPT :], event)

    def vehicle_gone(self) -> None:
        """Nothing is known of the vehicle any more."""
        self.instant = None

    def at_rest(self, instant: Instant) -> None:
        """One look at the vehicle while nothing is flown."""
        self.instant = instant

    def begin(self, flown: FlownMission) -> None:
        """A flight begins: what was drawn of the last one goes."""
        number = self.drawn.number + 1 if self.drawn is not None else 1
        self.drawn = Drawn(flown, number)

    def flight_tick(self, command: Command, status: VehicleStatus, sensing: Sensing) -> None:
        """One tick of the flight that `begin` began."""
        drawn = self.drawn
        if drawn is None:
            raise ValueError("a flight's tick before its beginning: call begin() first")
        decision = command.decision
        if sensing.map.version != drawn.hits_version:
            drawn.hits = sensing.map.hits()
            drawn.hits_version = sensing.map.version
        if decision.plan is not None:
            drawn.plan = decision.plan
            drawn.plan_why = decision.events[-1].why if decision.events else ""
            drawn.plan_version += 1
        fused = decision.fused
        if fused is not None and fused.ok and status.armed:
            point = (fused.point[0] + drawn.flown.offset[0], fused.point[1] + drawn.flown.offset[1])
            if not drawn.track or distance(drawn.track[-1], point) > _TRACK_STEP_M:
                drawn.track.append(point)
        drawn.faults.note(
            decision.now_s, (*ending_faults(decision.outcome, status), *decision.faults)
        )
        for event in decision.events:
            self.why = event.why
            drawn.events.append(event)
            self.tell(event.name, event.why)
        self.instant = Instant(decision.now_s, status, dict(sensing.newest), command=command)

    # ------------------------------------------------------------ control side: what is asked

    def take_commands(self) -> tuple[OperatorCommand, ...]:
        """Operator commands since the last call, oldest first."""
        taken = []
        while self._commands:
            taken.append(self._commands.popleft())
        return tuple(taken)

    def take_mission(self) -> MissionRecord | None:
        """The next mission to fly, now marked as flying; None when there is none."""
        with self._lock:
            if not self._queued:
                return None
            record = self._missions[self._queued.popleft()]
            record = msgspec.structs.replace(record, status=MissionStatus.FLYING)
            self._missions[record.id] = record
            return record

    def go_on(self, order: MissionOrder) -> MissionRecord:
        """A mission of this service's last life that flies on; its record, marked as flying."""
        with self._lock:
            return self._new_record(order, MissionStatus.FLYING)

    def update(self, mission_id: str, **changes: Any) -> MissionRecord:
        """Replace fields of a mission's record; returns the new one."""
        with self._lock:
            record = msgspec.structs.replace(self._missions[mission_id], **changes)
            self._missions[mission_id] = record
            return record

    # ------------------------------------------------------------ web side

    def missions(self) -> tuple[MissionRecord, ...]:
        """All that are remembered, newest first."""
        with self._lock:
            return tuple(reversed(self._missions.values()))

    def mission(self, mission_id: str) -> MissionRecord | None:
        """One mission, None when it is not known."""
        with self._lock:
            return self._missions.get(mission_id)

    def submit(self, order: MissionOrder) -> MissionRecord:
        """Queue a mission for the next look at the queue.

        Raises Refused when the service cannot fly now, BadInput (from `check`) for an order that
        must never be flown. Nothing was changed then.
        """
        self._check(order)
        with self._lock:
            self._refuse_unless_free()
            record = self._new_record(order, MissionStatus.QUEUED)
            self._queued.append(record.id)
            return record

    def _new_record(self, order: MissionOrder, status: MissionStatus) -> MissionRecord:
        """One more mission; the lock is held."""
        self._mission_count += 1
        stamp = datetime.now(UTC)
        name = f"{stamp:%Y%m%d-%H%M%S}-{self._mission_count}"
        record = MissionRecord(name, order, status, utc_now())
        self._missions[record.id] = record
        while len(self._missions) > MISSIONS_KEPT:
            self._missions.pop(next(iter(self._missions)))
        return record

    def abort(self, mission_id: str) -> MissionRecord | None:
        """Take back a queued mission, or stop the one being flown; None when it is not known.

        A mission that is over stays as it is.
        """
        with self._lock:
            record = self._missions.get(mission_id)
            if record is None or record.over:
                return record
            if record.status is MissionStatus.QUEUED:
                self._queued.remove(mission_id)
                record = msgspec.structs.replace(
                    record, status=MissionStatus.CANCELLED, why="taken back before it began"
                )
                self._missions[mission_id] = record
                return record
        self._commands.append(OperatorCommand.STOP)
        return record

    def command(self, command: OperatorCommand) -> None:
        """Queue an operator's command for the next tick. What is queued to be flown is dropped.

        Raises Refused when the service has no vehicle to command.
        """
        with self._lock:
            while self._queued:
                name = self._queued.popleft()
                self._missions[name] = msgspec.structs.replace(
                    self._missions[name],
                    status=MissionStatus.CANCELLED,
                    why=f"the operator said {command.value} before it began",
                )
        self._refuse_while_preparing()
        if self.phase is Phase.WAITING:
            raise Refused(f"there is no vehicle to command: {self.why}")
        self._commands.append(command)

    def _refuse_unless_free(self) -> None:
        """Raise Refused unless a mission could begin now; the lock is held."""
        self._refuse_while_preparing()
        if self.phase is Phase.WAITING:
            raise Refused(f"there is no vehicle to fly: {self.why}")
        if self.phase is Phase.STOPPING:
            raise Refused("the service is stopping; start it again first")
        flying = next((m for m in reversed(self._missions.values()) if not m.over), None)
        if flying is not None:
            raise Refused(f"mission {flying.id} is {flying.status.value}; stop it first")
        if self.instant is not None and self.instant.status.armed:
            raise Refused("the vehicle is armed; land it first, a mission begins on the ground")

    def _refuse_while_preparing(self) -> None:
        if self.phase is Phase.PREPARING:
            raise Refused(f"the service is not ready yet: {self.why}")
