"""What the autopilot says, kept: newest readings, its clock, and what was not believed.

Pure but for the clock that is handed in: one thread brings messages, any thread reads.
"""

import contextlib
import math
from collections import deque
from collections.abc import Callable
from typing import TypeVar

import msgspec

from hal.boot_clock import BootClock
from hal.drops import Drops
from hal.errors import ReadingRefused
from hal.interfaces import Clock, WireMessage
from hal.latest import Latest
from hal.readings import (
    Attitude,
    FlightMode,
    LandedState,
    LocalPosition,
    StatusText,
    VehicleStatus,
)
from hal.vehicle.px4_messages import (
    CRITICAL,
    PX4,
    STANDBY,
    AttitudeMessage,
    CurrentMode,
    ExtendedSysState,
    GlobalPositionInt,
    Heartbeat,
    LocalPositionNed,
    Odometry,
    RecentTexts,
    StatusTextMessage,
    SysStatus,
    TextAssembler,
)

AUTOPILOT_COMPONENT = 1  # MAV_COMP_ID_AUTOPILOT1
_TEXTS_KEPT = 128
_VALID_FOR_S = 0.3  # LOCAL_POSITION_NED comes at 30 Hz while the estimate is valid
_ODOMETRY_GONE_S = 0.5
_GLOBAL_FRESH_S = 1.0  # GLOBAL_POSITION_INT comes at 50 Hz, or at what another client asked for
_LANDED_FRESH_S = 2.5
"""EXTENDED_SYS_STATE comes at 5 Hz, or at 1 Hz where that was not granted, and one may be lost."""
_WARNINGS_COUNT_S = 15.0

T = TypeVar("T", bound=msgspec.Struct)
Take = Callable[[WireMessage], None]


class Telemetry:
    """One autopilot as it is heard; begun anew for every connection.

    Only what bears its system and component counts. A message that is no measurement, that is
    older than the newest of its kind, or whose time leapt (`BootClock`) is dropped and counted.
    """

    def __init__(
        self, clock: Clock, system_id: int, drops: Drops, restarted: Callable[[], None]
    ) -> None:
        """`restarted` is called when the autopilot's clock began anew: it has forgotten rates."""
        self._clock = clock
        self._system_id = system_id
        self._drops = drops
        self._restarted = restarted
        self._boot = BootClock()
        self._restarts_seen = 0
        self._sent_s: dict[str, float] = {}
        """Time of sending of the newest message of each kind, by the autopilot's clock."""
        self._heard_s = clock.now_s()
        self._valid_s = self._odometry_s = self._global_s = self._landed_s = -math.inf
        self._position: Latest[LocalPosition] = Latest()
        self._attitude: Latest[Attitude] = Latest()
        self._heartbeat: Latest[Heartbeat] = Latest()
        self._mode: Latest[FlightMode] = Latest()
        """By HEARTBEAT or CURRENT_MODE, whichever came last: they tell the same state."""
        self._landed: Latest[LandedState] = Latest()
        self._health: Latest[SysStatus] = Latest()
        self._assembler = TextAssembler()
        self._texts: deque[StatusText] = deque(maxlen=_TEXTS_KEPT)
        self.recent = RecentTexts()
        self.takers: dict[str, Take] = {
            "HEARTBEAT": self._taker("HEARTBEAT", Heartbeat, self._take_heartbeat),
            "CURRENT_MODE": self._taker("CURRENT_MODE", CurrentMode, self._take_mode),
            "GLOBAL_POSITION_INT": self._taker(
                "GLOBAL_POSITION_INT", GlobalPositionInt, self._take_global_position
            ),
            "EXTENDED_SYS_STATE": self._taker(
                "EXTENDED_SYS_STATE", ExtendedSysState, self._take_landed
            ),
            "SYS_STATUS": self._taker("SYS_STATUS", SysStatus, self._take_health),
            "ATTITUDE": self._taker("ATTITUDE", AttitudeMessage, self._take_attitude),
            "LOCAL_POSITION_NED": self._taker(
                "LOCAL_POSITION_NED", LocalPositionNed, self._take_local_position
            ),
            "ODOMETRY": self._taker("ODOMETRY", Odometry, self._take_odometry),
            "STATUSTEXT": self._taker("STATUSTEXT", StatusTextMessage, self._take_text),
        }
        """What to call with each message of a name: all from one thread."""

    # ---------------------------------------------------------------- what is known

    @property
    def heard_heartbeat(self) -> bool:
        """True once it said that it lives."""
        return self._heartbeat.get() is not None

    @property
    def mode(self) -> FlightMode | None:
        """The newest mode, or None before the first."""
        return self._mode.get()

    def local_position(self) -> LocalPosition | None:
        """The newest valid estimate, or None before the first."""
        return self._position.get()

    def attitude(self) -> Attitude | None:
        """The newest attitude, or None before the first."""
        return self._attitude.get()

    def status(self) -> VehicleStatus:
        """The newest status; before the first heartbeat a disarmed vehicle that is not armable."""
        heartbeat, health = self._heartbeat.get(), self._health.get()
        heard_s, now_s = self._heard_s, self._clock.now_s()
        if heartbeat is None:
            return VehicleStatus(
                stamp_s=heard_s,
                armed=False,
                mode=FlightMode.UNKNOWN,
                landed=LandedState.UNKNOWN,
                link_age_s=max(0.0, now_s - heard_s),
                armable=False,
                not_armable_because="there was no heartbeat yet",
            )
        armable = heartbeat.armed or (
            heartbeat.system_status >= STANDBY if health is None else health.prearm_ok
        )
        return VehicleStatus(
            stamp_s=heard_s,
            armed=heartbeat.armed,
            mode=self._mode.get() or heartbeat.mode,
            landed=self._landed_at(now_s),
            link_age_s=max(0.0, now_s - heard_s),
            armable=armable,
            not_armable_because="" if armable else self._why_not_armable(now_s),
            battery_remaining=health.battery if health is not None else None,
            in_failsafe=heartbeat.armed and heartbeat.system_status == CRITICAL,
            global_position=now_s - self._global_s <= _GLOBAL_FRESH_S,
        )

    def _landed_at(self, now_s: float) -> LandedState:
        """What it told lately: a vehicle that was on the ground may have been flown away since."""
        landed = self._landed.get()
        fresh = now_s - self._landed_s <= _LANDED_FRESH_S
        return landed if landed is not None and fresh else LandedState.UNKNOWN

    def why(self, asked_s: float, *, warnings_before: bool) -> str:
        """What it said about something that was asked at `asked_s`, or just before."""
        return self.recent.since(asked_s - (_WARNINGS_COUNT_S if warnings_before else 0.0))

    def _why_not_armable(self, now_s: float) -> str:
        return self.why(now_s, warnings_before=True) or (
            "its health checks fail; it does not say which"
        )

    def take_texts(self) -> tuple[StatusText, ...]:
        """Status texts since the last call, oldest first; at most the last 128."""
        texts = []
        with contextlib.suppress(IndexError):
            while True:
                texts.append(self._texts.popleft())
        return tuple(texts)

    def stamp_s(self, message: WireMessage, boot_s: float) -> float:
        """See `hal.interfaces.MessageSource`: only the autopilot's own clock is known."""
        if message.component_id != AUTOPILOT_COMPONENT:
            return message.received_s
        return self._boot.stamp_s(message.received_s, boot_s)

    # ---------------------------------------------------------------- what comes in

    def of_this_vehicle(self, name: str, take: Take) -> Take:
        """`take`, for what bears the vehicle's system id: others on the link are not aboard."""

        def taken(message: WireMessage) -> None:
            if message.system_id == self._system_id:
                take(message)
            else:
                self._drops.note(name, "another vehicle")

        return taken

    def _taker(self, name: str, kind: type[T], take: Callable[[T, float], None]) -> Take:
        """Decode the autopilot's messages of that name and pass them on with their reception."""
        decoder = msgspec.json.Decoder(kind)

        def taken(message: WireMessage) -> None:
            if message.component_id != AUTOPILOT_COMPONENT or message.system_id != self._system_id:
                self._drops.note(name, "another sender")
                return
            self._heard_s = message.received_s
            try:
                take(decoder.decode(message.fields_json), message.received_s)
            except (msgspec.DecodeError, ReadingRefused):
                self._drops.note(name, "unreadable")

        return taken

    def _take_heartbeat(self, message: Heartbeat, _now_s: float) -> None:
        if message.autopilot != PX4:
            self._drops.note("HEARTBEAT", "another sender")
            return
        self._mode.put(message.mode)
        self._heartbeat.put(message)

    def _take_mode(self, message: CurrentMode, _now_s: float) -> None:
        self._mode.put(message.mode)

    def _take_global_position(self, _message: GlobalPositionInt, now_s: float) -> None:
        self._global_s = now_s

    def _take_landed(self, message: ExtendedSysState, now_s: float) -> None:
        self._landed_s = now_s
        self._landed.put(message.landed)

    def _take_health(self, message: SysStatus, _now_s: float) -> None:
        self._health.put(message)

    def booted_s(self) -> float | None:
        """When the autopilot's clock was zero; None before a message told its time."""
        attitude = self._attitude.get()
        return None if attitude is None else self._boot.stamp_s(math.inf, 0.0)

    def _take_attitude(self, message: AttitudeMessage, now_s: float) -> None:
        stamp_s = self._noted("ATTITUDE", now_s, message.time_boot_ms * 1e-3)
        if stamp_s is not None:
            self._attitude.put(message.reading(stamp_s))

    def _take_local_position(self, message: LocalPositionNed, now_s: float) -> None:
        stamp_s = self._noted("LOCAL_POSITION_NED", now_s, message.time_boot_ms * 1e-3)
        if stamp_s is None:
            return
        last = self._position.get()
        reading = message.reading(stamp_s, last.reset_counter if last is not None else 0)
        self._valid_s = now_s
        if now_s - self._odometry_s > _ODOMETRY_GONE_S:
            self._position.put(reading)

    def _take_odometry(self, message: Odometry, now_s: float) -> None:
        stamp_s = self._noted("ODOMETRY", now_s, message.time_usec * 1e-6)
        if stamp_s is None:
            return
        reading = message.reading(stamp_s)
        if reading is None:
            self._drops.note("ODOMETRY", "another frame")
            return
        self._odometry_s = now_s
        if now_s - self._valid_s <= _VALID_FOR_S:
            self._position.put(reading)

    def _take_text(self, message: StatusTextMessage, now_s: float) -> None:
        text = self._assembler.take(message, now_s)
        if text is not None:
            self._texts.append(text)
            self.recent.put(text)

    def _noted(self, name: str, now_s: float, boot_s: float) -> float | None:
        """The stamp of a message of that time, or None for one that is not to be believed."""
        stamp_s = self._boot.note(now_s, boot_s)
        if stamp_s is None:
            self._drops.note(name, "its time leapt")
            return None
        if self._boot.restarts != self._restarts_seen:
            self._restarts_seen = self._boot.restarts
            self._sent_s.clear()
            self._restarted()
        if boot_s <= self._sent_s.get(name, -math.inf):
            self._drops.note(name, "older than the newest")
            return None
        self._sent_s[name] = boot_s
        return stamp_s
