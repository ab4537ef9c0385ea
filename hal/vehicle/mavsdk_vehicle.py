"""One PX4 multicopter over MAVSDK 4.x: the only module that imports `mavsdk`.

Who runs where: the native library has threads of its own and calls back on one of them; callbacks
only decode and put into cells. Requests use the library's callback form, so that nothing waits in
a thread pool and cancelling is instant. Blocking calls (connect, parameters, destroy) run one
after another on one thread of this adapter. Setpoints leave on another, newest first and only.
"""

import asyncio
import contextlib
import functools
import json
import logging
import math
import os
import socket
import threading
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from urllib.parse import urlsplit

import msgspec
from mavsdk.autopilot import Autopilot
from mavsdk.component_type import ComponentType
from mavsdk.connection_result import ConnectionResult
from mavsdk.exceptions import MavsdkError
from mavsdk.logging import LogLevel, log_subscribe
from mavsdk.mavsdk import Configuration, Mavsdk
from mavsdk.plugins.action import Action, ActionResult
from mavsdk.plugins.info import Info, InfoError
from mavsdk.plugins.mavlink_direct import MavlinkDirect, MavlinkDirectResult, MavlinkMessage
from mavsdk.plugins.offboard import (
    Offboard,
    OffboardResult,
    PositionNedYaw,
    VelocityNedYaw,
)
from mavsdk.plugins.param import Param, ParamError
from mavsdk.system import System

from hal.config import DEVICE_SCHEMES, BeamsConfig, VehicleConfig
from hal.drops import Dropped, Drops
from hal.errors import ConnectionFailed, PortInUse, WrongAutopilot
from hal.frames import ZERO3
from hal.interfaces import Clock, WireMessage
from hal.readings import (
    Attitude,
    FlightMode,
    LocalPosition,
    StatusText,
    VehicleFacts,
    VehicleStatus,
)
from hal.setpoints import Reply, Request, RequestKind, Setpoint
from hal.vehicle.native_thread import NativeThreads
from hal.vehicle.setpoint_sender import SetpointSender
from hal.vehicle.telemetry import AUTOPILOT_COMPONENT, Telemetry

_LOG = logging.getLogger(__name__)
_NATIVE_LOG = logging.getLogger("hal.mavsdk")
_LEVELS = {
    LogLevel.DEBUG: logging.DEBUG,
    LogLevel.INFO: logging.DEBUG,
    LogLevel.WARN: logging.INFO,
    LogLevel.ERROR: logging.WARNING,
}

PREFLIGHT_PARAMETERS: dict[str, type[int] | type[float]] = {
    "COM_DISARM_LAND": float,
    "COM_OBL_RC_ACT": int,
    "COM_OF_LOSS_T": float,
    "COM_RCL_EXCEPT": int,
    "GF_ACTION": int,
    "MIS_TAKEOFF_ALT": float,
    "MPC_XY_P": float,
    "MPC_XY_VEL_MAX": float,
    "NAV_DLL_ACT": int,
}
"""Parameters asked for when connecting, with their types in PX4."""

MESSAGE_INTERVALS_US = {
    245: 200_000,
    331: 33_333,
    132: 40_000,
    436: 50_000,
    30: 30_000,
    33: 200_000,
}
"""EXTENDED_SYS_STATE (MAVSDK's action plugin slows it to 1 Hz), ODOMETRY, DISTANCE_SENSOR, and
CURRENT_MODE: PX4 looks so often whether the mode has changed, and sends it then (else twice a
second). HEARTBEAT, which tells the mode as well, stays at 1 Hz: PX4 refuses another rate.
ATTITUDE and GLOBAL_POSITION_INT come at 100 and 50 Hz by themselves, which costs more than all
else that the library hears; the one is read 20 times a second, the other only for its being there.
"""

_HEARTBEATS_WAITED_FOR = 2  # one a second
_SET_MESSAGE_INTERVAL = 511
_RUN_PREARM_CHECKS = 401
_PLACE_FRESH_S = 0.5
_TEXTS_COME_LATE_S = 0.15  # a text that explains a refusal may follow the acknowledgement
_TAKEOFF_ALTITUDE_TOLERANCE_M = 1e-3
_VERSION_WAIT_S = 2.0
_POLL_S = 0.02
_ANSWERS_COME_S = 3.0  # the library gives a request up after 2 s of silence


@functools.cache
def _route_native_log() -> None:
    """The library writes to the terminal by itself; once per process, into `logging` instead."""

    def take(level: LogLevel, text: str, _file: str | None, _line: int) -> bool:
        _NATIVE_LOG.log(_LEVELS[level], text.strip())
        return True

    log_subscribe(take)


@dataclass
class _Link:
    """What exists while the link is open; destroying `mavsdk` destroys all of it."""

    mavsdk: Mavsdk
    system: System
    action: Action
    offboard: Offboard
    param: Param
    info: Info
    direct: MavlinkDirect
    parameters: dict[str, float] = field(default_factory=dict)


class MavsdkVehicle:
    """`hal.interfaces.Vehicle` over MAVSDK, and a `hal.interfaces.MessageSource` for drivers.

    Connects as a ground station: PX4 sends status texts to nobody else. Positions come from
    ODOMETRY (position, velocity and reset counter of one instant) but count only while PX4 also
    sends LOCAL_POSITION_NED, which it stops when its estimate becomes invalid; without ODOMETRY
    the latter serves alone, and jumps of the frame go unseen.
    """

    def __init__(self, config: VehicleConfig, clock: Clock, beams: BeamsConfig) -> None:
        self._config = config
        self._clock = clock
        self._beams = beams
        self._door = threading.Lock()
        """Held for every call into the library's objects, and to take them away."""
        self._mavsdk: Mavsdk | None = None
        self._link: _Link | None = None
        self._worker: ThreadPoolExecutor | None = None
        self._setpoints: SetpointSender | None = None
        self._answers = threading.Condition()
        self._unanswered: set[object] = set()
        """Requests that the library has not called back for."""
        self._listeners: list[tuple[str, Callable[[WireMessage], None]]] = []
        self._system_id = 0
        self._drops = Drops()
        self._callback_thread = NativeThreads()
        self._telemetry = self._new_telemetry()
        self._stop_place: LocalPosition | None = None
        """Where the present stop began. Touched by whoever puts a setpoint on the wire."""
        self._hold_refused = False
        """The deadman's Hold was refused: it asks for Land then."""
        self.unsent = 0
        """Setpoints and messages that met a closed link or that the library refused."""

    # ---------------------------------------------------------------- life

    async def open(self, deadline_s: float) -> VehicleFacts:
        """Connect, learn who it is, read `PREFLIGHT_PARAMETERS`.

        Never waits for a global position or a home. Raises PortInUse, ConnectionFailed (also for
        a connection that makes no sense, and when already open), WrongAutopilot. Cancelling ends
        the attempt and leaves nothing open, after at most the one parameter read under way and
        the answers to what was asked.
        """
        if self._worker is not None:
            raise ConnectionFailed("this vehicle is open already; close it first")
        _route_native_log()
        worker = ThreadPoolExecutor(1, "mavsdk-door")
        self._worker = worker
        try:
            async with asyncio.timeout(deadline_s):
                return await self._open(worker)
        except TimeoutError:
            await self._close_safely()
            raise ConnectionFailed(
                f"no vehicle answered on {self._config.connection} within {deadline_s:g} s; "
                "check that PX4 is running and sends to this address"
            ) from None
        except BaseException:
            await self._close_safely()
            raise

    async def _open(self, worker: ThreadPoolExecutor) -> VehicleFacts:
        loop = asyncio.get_running_loop()
        _refuse_a_taken_port(self._config.connection)
        _refuse_a_device_that_cannot_be_opened(self._config.connection)
        mavsdk = await loop.run_in_executor(worker, self._connect)
        system = await _first_autopilot(mavsdk)
        await _refuse_others_than_px4(system, self._config.connection)
        self._system_id = system.get_system_id()
        self._telemetry, self._stop_place = self._new_telemetry(), None
        link = await loop.run_in_executor(worker, self._plug_in, mavsdk, system)
        self._setpoints = SetpointSender(self._put_newest)
        self._ask_for_rates()
        while not self._telemetry.heard_heartbeat:  # noqa: ASYNC110 - the cell's writer knows no event loop
            await asyncio.sleep(_POLL_S)
        # What stands against arming was told before we came: it is told anew, for those who ask.
        self._command(_RUN_PREARM_CHECKS, (), lambda *_: None)
        version = await loop.run_in_executor(worker, self._read_version, link)
        for name in PREFLIGHT_PARAMETERS:
            kind = PREFLIGHT_PARAMETERS[name]
            await loop.run_in_executor(worker, _read_parameter, link, name, kind)
        return VehicleFacts(
            autopilot="PX4",
            version=version,
            system_id=self._system_id,
            parameters=dict(link.parameters),
            booted_s=self._telemetry.booted_s(),
        )

    async def close(self) -> None:
        """Let go of the link and of every thread; the vehicle stays in the mode it is in.

        What a flying PX4 does when the setpoints end is its own failsafe (COM_OBL_RC_ACT).
        Cancelling does not stop the closing.
        """
        await self._close_safely()

    async def _close_safely(self) -> None:
        worker, self._worker = self._worker, None
        if worker is None:
            return
        # Behind whatever the worker still does: nothing is destroyed under a running call.
        closing = asyncio.get_running_loop().run_in_executor(worker, self._tear_down)
        worker.shutdown(wait=False)
        await asyncio.shield(closing)

    def _connect(self) -> Mavsdk:
        mavsdk = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
        self._mavsdk = mavsdk
        result = mavsdk.add_any_connection(self._config.connection)
        if result is not ConnectionResult.SUCCESS:
            raise ConnectionFailed(f"{self._config.connection} cannot be opened: {_advice(result)}")
        return mavsdk

    def _tear_down(self) -> None:
        with self._door:
            link, self._link = self._link, None
        setpoints, self._setpoints = self._setpoints, None
        if setpoints is not None:
            setpoints.close()
        # The library's plugins are gone before its threads are: an answer that comes in between
        # would be a call into freed memory.
        with self._answers:
            self._answers.wait_for(lambda: not self._unanswered, _ANSWERS_COME_S)
            self._unanswered.clear()
        mavsdk, self._mavsdk = self._mavsdk, None
        if mavsdk is not None:
            mavsdk.destroy()
        del link  # owns the callbacks, so it must live as long as what calls them

    def _ask(
        self, call: Callable[[Callable[..., None]], object], answer: Callable[..., None]
    ) -> str | None:
        """Make one call of the library, whose answer closing the link waits for; the door is held.

        None, or why there will be no answer: the library did not take the call.
        """
        request = object()
        with self._answers:
            self._unanswered.add(request)

        def done() -> None:
            with self._answers:
                self._unanswered.discard(request)
                self._answers.notify_all()

        def answered(*values: object) -> None:
            try:
                answer(*values)
            finally:
                done()

        try:
            call(answered)
        except MavsdkError as error:
            done()
            return f"the link did not take it ({error})"
        return None

    def _new_telemetry(self) -> Telemetry:
        return Telemetry(self._clock, self._system_id, self._drops, self._ask_for_rates)

    def _plug_in(self, mavsdk: Mavsdk, system: System) -> _Link:
        direct = MavlinkDirect(system)
        link = _Link(
            mavsdk, system, Action(system), Offboard(system), Param(system), Info(system), direct
        )
        with self._door:
            self._link = link
            self._subscribe(direct)
        return link

    def _read_version(self, link: _Link) -> str:
        """The flight software's version; "unknown" when PX4 does not tell in time."""
        ends_s = self._clock.now_s() + _VERSION_WAIT_S
        waiting = threading.Event()
        while self._clock.now_s() < ends_s and self._link is link:
            with contextlib.suppress(InfoError):
                version = link.info.get_version()
                return (
                    f"{version.flight_sw_major}.{version.flight_sw_minor}.{version.flight_sw_patch}"
                )
            waiting.wait(_POLL_S)
        return "unknown"

    # ---------------------------------------------------------------- what it says

    def local_position(self) -> LocalPosition | None:
        """The newest valid estimate, or None before the first."""
        return self._telemetry.local_position()

    def attitude(self) -> Attitude | None:
        """The newest attitude, or None before the first."""
        return self._telemetry.attitude()

    def status(self) -> VehicleStatus:
        """The newest status; before the first heartbeat a disarmed vehicle that is not armable."""
        return self._telemetry.status()

    def take_texts(self) -> tuple[StatusText, ...]:
        """Status texts since the last call, oldest first; at most the last 128."""
        return self._telemetry.take_texts()

    def dropped(self) -> Dropped:
        """See `hal.drops`; what is no MAVLink, or has a wrong checksum, the library drops."""
        return self._drops.dropped()

    def listen(self, name: str, take: Callable[[WireMessage], None]) -> None:
        """See `hal.interfaces.MessageSource`."""
        self._listeners.append((name, take))
        with self._door:
            if self._link is not None:
                self._hand_out(self._link.direct, name, self._telemetry.of_this_vehicle(name, take))

    def stamp_s(self, message: WireMessage, boot_s: float) -> float:
        """See `hal.interfaces.MessageSource`: only the autopilot's own clock is known."""
        return self._telemetry.stamp_s(message, boot_s)

    def send_message(self, name: str, fields_json: str) -> None:
        """See `hal.interfaces.MessageSink`."""
        message = MavlinkMessage(name, 0, 0, 0, 0, fields_json)
        try:
            with self._door:
                if self._link is None:
                    self.unsent += 1
                    return
                self._link.direct.send_message(message)
        except MavsdkError as error:
            self.unsent += 1
            _LOG.warning("a %s was not sent: %s", name, error)

    # ---------------------------------------------------------------- what it hears

    def _subscribe(self, direct: MavlinkDirect) -> None:
        """Every callback runs on the library's one callback thread, hence one writer per cell."""
        for name, take in self._telemetry.takers.items():
            self._hand_out(direct, name, take)
        for name, take in self._listeners:
            self._hand_out(direct, name, self._telemetry.of_this_vehicle(name, take))

    def _hand_out(
        self, direct: MavlinkDirect, name: str, take: Callable[[WireMessage], None]
    ) -> None:
        def received(message: MavlinkMessage, _: object) -> None:
            self._callback_thread.keep()
            take(
                WireMessage(
                    self._clock.now_s(),
                    message.system_id,
                    message.component_id,
                    message.fields_json,
                )
            )

        direct.subscribe_message(name, received)

    # ---------------------------------------------------------------- what it is asked

    async def execute(self, request: Request) -> Reply:
        """Send one request and wait for the acknowledgement, at most `request_timeout_s`.

        TAKEOFF writes MIS_TAKEOFF_ALT first when it differs from the wanted altitude (a vehicle
        without a global position knows no other way). OFFBOARD sends a setpoint of the current
        place first and is refused without one. Never raises for what the vehicle does or does not
        answer. Cancelling stops the waiting, not the request.
        """
        asked_s = self._clock.now_s()
        try:
            async with asyncio.timeout(self._config.request_timeout_s):
                problem = await self._execute(request)
        except TimeoutError:
            problem = f"no answer within {self._config.request_timeout_s:g} s"
        if problem is None:
            return Reply(self._clock.now_s(), request.kind, accepted=True)
        await asyncio.sleep(_TEXTS_COME_LATE_S)
        said = self._telemetry.why(asked_s, warnings_before=request.kind is RequestKind.ARM)
        reason = f"{request.kind.value} was not done: {problem}" + (
            f"; the vehicle says: {said}" if said else ""
        )
        return Reply(self._clock.now_s(), request.kind, accepted=False, reason=reason)

    async def _execute(self, request: Request) -> str | None:
        """None when the vehicle accepted, else the problem."""
        match request.kind:
            case RequestKind.ARM:
                return await self._act(lambda link: link.action.arm_async)
            case RequestKind.TAKEOFF:
                return await self._take_off(request.altitude_m)
            case RequestKind.OFFBOARD:
                return await self._start_offboard()
            case RequestKind.HOLD:
                return await self._act(lambda link: link.action.hold_async)
            case RequestKind.LAND:
                return await self._act(lambda link: link.action.land_async)
            case RequestKind.DISARM:
                return await self._act(lambda link: link.action.disarm_async)

    async def _take_off(self, altitude_m: float) -> str | None:
        if not (math.isfinite(altitude_m) and altitude_m > 0.0):
            return f"{altitude_m} m is not an altitude above the take-off point"
        link = self._link
        known_m = link.parameters.get("MIS_TAKEOFF_ALT", math.nan) if link is not None else math.nan
        if not abs(known_m - altitude_m) <= _TAKEOFF_ALTITUDE_TOLERANCE_M:
            problem = await self._act(
                lambda link: functools.partial(link.action.set_takeoff_altitude_async, altitude_m)
            )
            if problem is not None:
                return problem
            if link is not None:
                link.parameters["MIS_TAKEOFF_ALT"] = altitude_m
        return await self._act(lambda link: link.action.takeoff_async)

    async def _start_offboard(self) -> str | None:
        against = self.status().against_offboard()
        if against is not None:
            return against
        setpoints, here = self._setpoints, self._here()
        if here is None or setpoints is None:
            return "its local position is not known, which OFFBOARD needs"
        setpoints.instead(lambda: self._put_newest(here[1]))
        return await self._act(lambda link: link.offboard.start_async)

    async def _act(
        self, choose: Callable[[_Link], Callable[[Callable[..., None]], object]]
    ) -> str | None:
        """Start one of the library's calls and wait for its result; None, or the problem."""
        loop = asyncio.get_running_loop()
        future: asyncio.Future[ActionResult | OffboardResult] = loop.create_future()

        def resolve(result: ActionResult | OffboardResult) -> None:
            if not future.done():
                future.set_result(result)

        def answered(result: ActionResult | OffboardResult, _: object) -> None:
            # A loop that ended in the meantime has nobody waiting any more.
            with contextlib.suppress(RuntimeError):
                loop.call_soon_threadsafe(resolve, result)

        with self._door:
            if self._link is None:
                return "the link is not open"
            problem = self._ask(choose(self._link), answered)
        if problem is not None:
            return problem
        result = await future
        return _problem(result)

    def _ask_for_rates(self) -> None:
        """Request the message rates this adapter needs; nobody waits for the answers."""
        for message_id, interval_us in MESSAGE_INTERVALS_US.items():
            self._command(_SET_MESSAGE_INTERVAL, (message_id, interval_us), lambda *_: None)

    def _command(
        self, command: int, parameters: tuple[float, ...], answered: Callable[..., None]
    ) -> bool:
        """Send a command that no plugin of the library knows; False when the link is closed."""
        values = parameters + (0,) * (7 - len(parameters))
        fields = {
            "target_system": self._system_id,
            "target_component": AUTOPILOT_COMPONENT,
            "command": command,
            "confirmation": 0,
            **{f"param{n}": value for n, value in enumerate(values, start=1)},
        }
        message = MavlinkMessage(
            "COMMAND_LONG", 0, 0, self._system_id, AUTOPILOT_COMPONENT, json.dumps(fields)
        )
        with self._door:
            if self._link is None:
                return False
            send = functools.partial(self._link.direct.send_command_async, message)
            return self._ask(send, answered) is None

    async def read_parameters(
        self, kinds: Mapping[str, type[int] | type[float]]
    ) -> dict[str, float]:
        """See `hal.interfaces.ParameterStore`."""
        link, worker = self._link, self._worker
        if link is None or worker is None:
            return {}
        loop = asyncio.get_running_loop()
        for name, kind in kinds.items():
            await loop.run_in_executor(worker, _read_parameter, link, name, kind)
        return {name: link.parameters[name] for name in kinds if name in link.parameters}

    async def write_parameter(self, name: str, value: int | float) -> float | None:
        """See `hal.interfaces.ParameterStore`."""
        link, worker = self._link, self._worker
        if link is None or worker is None:
            return None
        loop = asyncio.get_running_loop()
        await loop.run_in_executor(worker, _write_parameter, link, name, value)
        return link.parameters.get(name)

    async def report_health(self) -> bool:
        """See `hal.interfaces.ParameterStore`: MAV_CMD_RUN_PREARM_CHECKS."""
        loop = asyncio.get_running_loop()
        answer: asyncio.Future[bool] = loop.create_future()

        def resolve(accepted: bool) -> None:  # noqa: FBT001 - a callback's one value
            if not answer.done():
                answer.set_result(accepted)

        def answered(result: MavlinkDirectResult, _message: object, _data: object) -> None:
            accepted = result is MavlinkDirectResult.SUCCESS
            with contextlib.suppress(RuntimeError):
                loop.call_soon_threadsafe(resolve, accepted)

        if not self._command(_RUN_PREARM_CHECKS, (), answered):
            return False
        try:
            async with asyncio.timeout(self._config.request_timeout_s):
                return await answer
        except TimeoutError:
            return False

    # ---------------------------------------------------------------- setpoints

    def send(self, setpoint: Setpoint) -> None:
        """Hand one setpoint to the link; returns at once. One that meets a closed link is lost.

        MAVSDK repeats the last one every 50 ms until the vehicle is seen in another mode for 3 s,
        or the link is closed: hence the deadman.
        """
        setpoints = self._setpoints
        if setpoints is None:
            self.unsent += 1
            return
        setpoints.send(setpoint)

    def stop_now(self) -> None:
        """Stop and stay at the place where the vehicle is now. For the deadman: any thread.

        Called again it keeps the place of the first call, until the next `send` or until the
        autopilot's frame jumped. Without a fresh position the velocity alone becomes zero.
        """
        setpoints = self._setpoints
        if setpoints is None:
            self.unsent += 1
            return
        setpoints.instead(self._put_stop)

    def _put_stop(self) -> None:
        here, place = self._here(), self._stop_place
        if here is None:
            self._put_zero_velocity()
            return
        position, setpoint = here
        if place is None or place.reset_counter != position.reset_counter:
            place = self._stop_place = position
        self._put_on_wire(msgspec.structs.replace(setpoint, position_ned_m=place.position_ned_m))

    def hold_now(self) -> bool:
        """Ask for Hold without waiting for the answer, unless the vehicle is not in Offboard.

        PX4 does not hold without a global position: where it tells none, or refused Hold, it is
        asked for Land, which needs the local position alone.
        For the deadman: any thread. True when it was asked; whether it was granted, the heartbeat
        says. Another mode is a pilot's or PX4's choice and stays.
        """
        if self._telemetry.mode is not FlightMode.OFFBOARD:
            return False
        lands = self._hold_refused or not self._telemetry.status().global_position
        with self._door:
            if self._link is None:
                return False
            action = self._link.action
            call = action.land_async if lands else action.hold_async
            problem = self._ask(call, self._note_given)
        if problem is not None:
            _LOG.warning("neither Hold nor Land was asked for: %s", problem)
        return problem is None

    def _note_given(self, result: ActionResult, _: object) -> None:
        """The answer to a Hold or Land that nobody waits for."""
        problem = _problem(result)
        if problem is not None:
            self._hold_refused = result is not ActionResult.TIMEOUT
            _LOG.warning("the silent loop's vehicle was not given to PX4: %s", problem)

    def _here(self) -> tuple[LocalPosition, Setpoint] | None:
        """A fresh position, and a setpoint that stays there; None without one."""
        now_s = self._clock.now_s()
        position, attitude = self.local_position(), self.attitude()
        if position is None or attitude is None or now_s - position.stamp_s > _PLACE_FRESH_S:
            return None
        return position, Setpoint(now_s, position.position_ned_m, ZERO3, attitude.yaw_rad)

    def _put_newest(self, setpoint: Setpoint) -> None:
        """Somebody flies: where it once was to stop counts no more."""
        self._stop_place, self._hold_refused = None, False
        self._put_on_wire(setpoint)

    def _put_on_wire(self, setpoint: Setpoint) -> None:
        yaw_deg = math.degrees(setpoint.yaw_rad)
        position = PositionNedYaw(*setpoint.position_ned_m, yaw_deg)
        velocity = VelocityNedYaw(*setpoint.velocity_ned_m_s, yaw_deg)
        self._through_the_door(lambda o: o.set_position_velocity_ned(position, velocity))

    def _put_zero_velocity(self) -> None:
        attitude = self.attitude()
        yaw_deg = math.degrees(attitude.yaw_rad) if attitude is not None else math.nan
        velocity = VelocityNedYaw(0.0, 0.0, 0.0, yaw_deg)
        self._through_the_door(lambda o: o.set_velocity_ned(velocity))

    def _through_the_door(self, call: Callable[[Offboard], object]) -> None:
        try:
            with self._door:
                if self._link is None:
                    self.unsent += 1
                    return
                call(self._link.offboard)
        except MavsdkError as error:
            self.unsent += 1
            _LOG.warning("a setpoint was not sent: %s", error)


# -------------------------------------------------------------------- connecting


def _refuse_a_taken_port(connection: str) -> None:
    """Raise PortInUse when another process listens there.

    MAVSDK opens its sockets to be shared: a second one on a port succeeds and one of the two
    starves. Binding here without sharing, and letting go, asks the kernel.
    """
    url = urlsplit(connection)
    if url.scheme not in ("udpin", "udp", "tcpin"):
        return
    try:
        host, port = url.hostname or "", url.port or 0
    except ValueError:
        raise ConnectionFailed(f"{connection} has no usable port; write a number") from None
    stream = url.scheme == "tcpin"
    with socket.socket(
        socket.AF_INET, socket.SOCK_STREAM if stream else socket.SOCK_DGRAM
    ) as probe:
        try:
            probe.bind((host, port))
        except OSError as error:
            raise PortInUse(
                f"the port of {connection} cannot be opened ({error.strerror}); stop the program "
                "that uses it (another autonomy or a ground station), or choose another port"
            ) from None


def _refuse_a_device_that_cannot_be_opened(connection: str) -> None:
    """Raise ConnectionFailed with the cause, which the library does not tell."""
    scheme, _, rest = connection.partition("://")
    if scheme not in DEVICE_SCHEMES:
        return
    head, colon, baud = rest.rpartition(":")
    path = head if colon and baud.isdigit() else rest
    try:
        os.close(os.open(path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK))
    except OSError as error:
        raise ConnectionFailed(
            f"{connection} cannot be opened: {path}: {error.strerror}; plug the device in, name "
            "another one, or let this user use it (group dialout)"
        ) from None


async def _refuse_others_than_px4(system: System, connection: str) -> None:
    """Raise WrongAutopilot, naming what it is.

    A companion computer's heartbeat may come first, and the library then takes the vehicle for
    another one until the autopilot's own has come: two of those are waited for.
    """
    for _ in range(_HEARTBEATS_WAITED_FOR * 10):
        if system.autopilot_type() is Autopilot.PX4:
            return
        await asyncio.sleep(0.1)
    kind = system.autopilot_type()
    if kind is not Autopilot.PX4:
        raise WrongAutopilot(
            f"the autopilot on {connection} says it is {kind.name.title()}; only PX4 can be flown"
        )


def _advice(result: ConnectionResult) -> str:
    advice = {
        ConnectionResult.CONNECTION_URL_INVALID: (
            "write it like udpin://0.0.0.0:14540, tcpout://host:port or serial:///dev/tty:57600"
        ),
        ConnectionResult.BAUDRATE_UNKNOWN: "the baud rate is not one that serial ports know",
        ConnectionResult.BIND_ERROR: "the local address is not this machine's or is taken",
    }
    return advice.get(result, f"{result.name.replace('_', ' ').lower()}; check address and device")


async def _first_autopilot(mavsdk: Mavsdk) -> System:
    """The first system with an autopilot; waits until cancelled."""
    loop = asyncio.get_running_loop()
    found: asyncio.Future[System] = loop.create_future()

    def resolve(system: System) -> None:
        if not found.done():
            found.set_result(system)

    def take(system: System | None) -> None:
        if system is not None:
            with contextlib.suppress(RuntimeError):
                loop.call_soon_threadsafe(resolve, system)

    handle = mavsdk.first_autopilot_async(-1.0, take)
    try:
        return await found
    finally:
        mavsdk.cancel_first_autopilot(handle)


def _write_parameter(link: _Link, name: str, value: int | float) -> None:
    """Set it, and read what the vehicle holds then into `link.parameters`."""
    link.parameters.pop(name, None)
    try:
        if isinstance(value, int):
            link.param.set_param_int(name, value)
        else:
            link.param.set_param_float(name, value)
    except ParamError as error:
        _LOG.info("parameter %s was not set: %s", name, error.result.name)
    _read_parameter(link, name, type(value))


def _read_parameter(link: _Link, name: str, kind: type[int] | type[float]) -> None:
    """Into `link.parameters`; a name that the vehicle does not know stays absent."""
    read = link.param.get_param_int if kind is int else link.param.get_param_float
    try:
        value = float(read(name))
        if math.isfinite(value):
            link.parameters[name] = value
    except ParamError as error:
        _LOG.info("parameter %s was not read: %s", name, error.result.name)


_PROBLEMS = {
    "TIMEOUT": "the vehicle did not answer",
    "COMMAND_DENIED": "the vehicle refused",
    "BUSY": "the vehicle is busy",
    "CONNECTION_ERROR": "the link failed",
    "NO_SYSTEM": "the vehicle is gone",
    "UNSUPPORTED": "the vehicle does not know the request",
    "PARAMETER_ERROR": "a parameter could not be written",
}


def _problem(result: ActionResult | OffboardResult) -> str | None:
    """None for success, else what went wrong."""
    if result is ActionResult.SUCCESS or result is OffboardResult.SUCCESS:
        return None
    return _PROBLEMS.get(result.name, f"MAVSDK reports {result.name.replace('_', ' ').lower()}")
