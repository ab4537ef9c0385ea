"""The composition root of `autonomy serve`: one vehicle, one web side, one mission after another.

The service waits for its vehicle, looks at it while it rests, flies what is queued, and waits
anew when it is gone. Everything that moves the vehicle happens in this event loop; the web side
has a thread of its own and can only leave orders in the station.

Frame: the first mission of a vehicle is armed at the origin of the service's frame, and the fence
and every goal are in that frame. Later missions begin where the vehicle landed; the pilot's frame
begins there, so fence and goals are shifted for it, and what it says is shifted back.
"""

import asyncio
import contextlib
import gc
import logging
import math
import os
import sys
import traceback
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import msgspec

from autonomy import app, in_flight
from autonomy.config import Config, load_config
from autonomy.custody import Custody
from autonomy.embedded import EmbeddedPx4
from autonomy.errors import AutonomyError, BadInput, ExitCode
from autonomy.flight import Flight, Recorder, bring_down
from autonomy.flightlog.recorder import FlightRecorder, host_boot
from autonomy.geometry import Point
from autonomy.model import Command, Ending, Inputs, OperatorCommand, Resumed
from autonomy.report import FlightReport, FlyOptions
from autonomy.service import logs
from autonomy.service.api import Api
from autonomy.service.contract import MissionOrder, MissionRecord, MissionStatus, Phase
from autonomy.service.lock import Holder, VehicleLock, utc_now
from autonomy.service.metrics import Metrics
from autonomy.service.server import WebServer, access_of, listening_socket, url_of
from autonomy.service.station import FlownMission, Instant, Station
from autonomy.service.systemd import Notifier
from autonomy.simulation import with_scenario
from autonomy.termination import termination_signals
from autonomy.virtual_world import warning
from autonomy.warm import warm_up
from hal import registry
from hal.clock import MonotonicClock
from hal.config import Fence
from hal.drops import dropped_by
from hal.errors import ConnectionFailed, HalError
from hal.frames import ZERO3, Vector3, add, ned_from_frd, subtract
from hal.interfaces import Clock
from hal.readings import (
    FlightMode,
    LandedState,
    LocalPosition,
    RangeReading,
    StatusText,
    VehicleFacts,
)
from hal.setpoints import Request, RequestKind
from hal.sim.scenario import load_scenario
from hal.vehicle.deadman import Deadman

_LOG = logging.getLogger("autonomy")
_CONNECT_S = 3.0
_RETRY_S = 0.5
_OFFBOARD_LOSS_S = 1.0
"""PX4's COM_OF_LOSS_T by default."""
_TELLS_WITHIN_S = 2.5
"""A heartbeat, and so the mode and the failsafe's flag, comes once a second."""
_SWITCH_INTERVAL_S = 0.0005
"""How long the web's thread may keep the interpreter from the control loop."""
_JUMP_M = 0.3
"""A vehicle on the ground does not move this far between two looks: its frame jumped."""


class ServeOptions(msgspec.Struct, frozen=True):
    """`autonomy serve` as it was typed. At most one of `scenario` and `connection` is given."""

    config_path: str | None = None
    scenario: str | None = None
    connection: str | None = None
    seed: int = 0
    host: str | None = None
    port: int | None = None
    log_dir: str | None = None


def serve(options: ServeOptions) -> int:
    """Run until told to stop; returns the exit code.

    Raises BadInput, DocumentError, PortInUse, VehicleHeld before anything is connected.
    """
    logging.basicConfig(stream=sys.stderr, level=logging.INFO, format="%(levelname)s %(message)s")
    logging.getLogger("uvicorn").setLevel(logging.WARNING)
    config = _effective(options)
    access = access_of(config.service, os.environ)
    notifier = Notifier(os.environ)
    with ExitStack() as stack:
        listening = listening_socket(config.service.host, config.service.port)
        stack.callback(listening.close)
        connection = options.connection or config.vehicle.connection
        if options.scenario is None:
            lock = VehicleLock(connection, Holder("autonomy serve", os.getpid(), utc_now()))
            stack.enter_context(lock)
            lock.reachable_at(url_of(listening))
        notifier.status("compiling the planner: minutes the first time, then seconds")
        _LOG.info("compiling the planner: minutes the first time, then seconds")
        warm_up(notifier.status)
        if options.scenario is not None:
            embedded = stack.enter_context(EmbeddedPx4(options.scenario, options.seed))
            connection = embedded.connection
        config = config.model_copy(
            update={"vehicle": config.vehicle.model_copy(update={"connection": connection})}
        )
        desk = Desk(config, options.scenario, options.seed)
        station = Station(config, desk.check)
        desk.station = station
        metrics = Metrics(station)
        api = Api(
            station,
            metrics,
            access,
            log_folder=Path(config.log.directory),
            scenario=options.scenario,
        )
        stack.enter_context(WebServer(api.application(), listening))
        _LOG.info("listening on %s", url_of(listening))
        sys.setswitchinterval(_SWITCH_INTERVAL_S)
        gc.freeze()
        service = Service(config, desk, station, metrics, notifier, real_drivers(config))
        asyncio.run(service.run())
    return int(ExitCode.GOAL_REACHED)


def _effective(options: ServeOptions) -> Config:
    """The configuration with what was typed laid over it; raises DocumentError or BadInput."""
    config = load_config(Path(options.config_path) if options.config_path else None)
    typed = {"host": options.host, "port": options.port}
    service = {key: value for key, value in typed.items() if value is not None}
    changes: dict[str, object] = {"service": config.service.model_copy(update=service)}
    if options.log_dir is not None:
        changes["log"] = config.log.model_copy(update={"directory": options.log_dir})
    config = config.model_copy(update=changes)
    if options.scenario is not None:
        return with_scenario(config, load_scenario(options.scenario))
    app.check_connection(options.connection or config.vehicle.connection)
    return config


# ---------------------------------------------------------------- orders


@dataclass
class Desk:
    """Turns orders into missions. `check` runs on the web side, so nothing here is changed."""

    config: Config
    scenario: str | None
    seed: int = 0
    station: Station | None = None

    def check(self, order: MissionOrder) -> None:
        """Raise BadInput or DocumentError for an order that must not be flown."""
        instant = self.station.instant if self.station is not None else None
        point, yaw_rad = (0.0, 0.0), 0.0
        if instant is not None and instant.position is not None and instant.attitude is not None:
            local, origin = instant.position.position_ned_m, instant.origin_ned_m
            point = (local[0] - origin[0], local[1] - origin[1])
            yaw_rad = instant.attitude.yaw_rad
        self.mission(order, point, yaw_rad).route_ned_m(yaw_rad)

    def mission(self, order: MissionOrder, point: Point, yaw_rad: float) -> app.Mission:
        """The order as a mission in the service's frame; the vehicle stands at `point`."""
        goals = tuple(_goal(goal) for goal in order.goals)
        frame: str = order.frame
        if frame == "body":
            goals = tuple(_from_body(goal, point, yaw_rad) for goal in goals)
            frame = "ned"
        options = FlyOptions(
            goals=goals,
            frame=frame,
            altitude_m=order.altitude_m,
            land=order.land,
            time_limit_s=order.time_limit_s,
            mode=order.mode,
            scenario=self.scenario,
            connection=None if self.scenario is not None else self.config.vehicle.connection,
            seed=self.seed,
            log_dir=self.config.log.directory,
        )
        return app.prepare_with(self.config, options)


def _goal(goal: list[float]) -> tuple[float, float, float | None]:
    return (goal[0], goal[1], goal[2] if len(goal) == 3 else None)


def _from_body(
    goal: tuple[float, float, float | None], point: Point, yaw_rad: float
) -> tuple[float, float, float | None]:
    north, east, _ = ned_from_frd((goal[0], goal[1], 0.0), yaw_rad)
    return (point[0] + north, point[1] + east, goal[2])


def shifted(mission: app.Mission, offset: Point) -> app.Mission:
    """The mission for a pilot whose frame begins at `offset`: the fence stays where it is."""
    guard = mission.config.guard
    polygon = tuple((n - offset[0], e - offset[1]) for n, e in guard.fence.outline_ne_m)
    moved = guard.model_copy(update={"fence": Fence(polygon_ne_m=polygon)})
    return app.Mission(
        mission.options, mission.config.model_copy(update={"guard": moved}), mission.scenario
    )


# ---------------------------------------------------------------- the service


@dataclass(frozen=True)
class Drivers:
    """What the service flies with; made anew for every connection."""

    vehicle: Callable[[], registry.LinkedVehicle]
    sensors: Callable[[registry.LinkedVehicle], registry.Sensors]
    gnss: Callable[[registry.LinkedVehicle], registry.Gnss]
    clock: Clock


def real_drivers(config: Config) -> Drivers:
    """The drivers that the configuration names."""
    clock = MonotonicClock()
    return Drivers(
        lambda: registry.vehicle(config.vehicle, config.beams, clock),
        lambda vehicle: registry.range_sensors(config.beams, vehicle, clock),
        lambda vehicle: registry.gnss(config.gnss, vehicle, clock),
        clock,
    )


@dataclass(frozen=True)
class Connected:
    """A vehicle that answers, with its sensors."""

    vehicle: registry.LinkedVehicle
    facts: VehicleFacts
    sensors: registry.Sensors
    gnss: registry.Gnss


class Service:
    """Waits, looks, flies; `run()` ends after a signal, with the vehicle on the ground."""

    def __init__(
        self,
        config: Config,
        desk: Desk,
        station: Station,
        metrics: Metrics,
        notifier: Notifier,
        drivers: Drivers,
    ) -> None:
        self._config = config
        self._desk = desk
        self._station = station
        self._metrics = metrics
        self._notifier = notifier
        self._drivers = drivers
        self._ending = asyncio.Event()
        self._flight: Flight | None = None
        self._origin_ned_m: Vector3 | None = None
        """The service's frame in the autopilot's local frame, once a mission was armed."""
        self._last_position: LocalPosition | None = None
        self._readings: dict[str, RangeReading] = {}
        self._left_in_air: Custody | None = None
        """The last mission's vehicle while it flies on as the mission left it; None when it landed
        or somebody else chose its mode."""
        self._proved_ours = False
        """A log proves that the vehicle in the air is this service's: it obeys an operator's order
        also where Hold may be a pilot's."""
        self._ready_told = False
        self._restart_seen_to = False
        """What becomes of a vehicle found in the air at the start is decided, and done."""

    async def run(self) -> None:
        """Serve until `stop` is called or a signal arrives."""
        with self._signals():
            async with asyncio.TaskGroup() as group:
                heart = group.create_task(self._beat())
                try:
                    while not self._ending.is_set():
                        await self._one_connection()
                finally:
                    heart.cancel()
        self._notifier.stopping()
        self._station.enter(Phase.STOPPING, "the service has stopped")

    def stop(self) -> None:
        """Stop what is flown (hold, then land), then end; called again: land at once."""
        again = self._ending.is_set()
        self._ending.set()
        if self._flight is not None:
            self._flight.command(OperatorCommand.LAND if again else OperatorCommand.STOP)
            self._notifier.extend_s(self._config.mission.land_timeout_s + 30.0)
            self._enter(Phase.STOPPING, "told to stop: holding, then landing")

    # ------------------------------------------------------------ one vehicle

    async def _one_connection(self) -> None:
        """From waiting for a vehicle to its silence, or to the service's end."""
        connection = self._config.vehicle.connection
        vehicle = self._drivers.vehicle()
        if self._station.phase is not Phase.WAITING or self._station.instant is None:
            self._enter(Phase.WAITING, f"waiting for a vehicle on {connection}")
        try:
            facts = await self._opened(vehicle)
            if facts is None:
                return
            sensors, gnss = self._drivers.sensors(vehicle), self._drivers.gnss(vehicle)
            timeout_s = self._config.vehicle.connect_timeout_s
            virtual = self._config.beams.virtual()
            if virtual is not None:
                self._station.tell("beams", warning(virtual))
            async with app.opened(
                sensors, gnss, timeout_s, lambda text: self._station.tell("gnss", text)
            ):
                self._station.tell(
                    "connected", f"{facts.autopilot} {facts.version}, system {facts.system_id}"
                )
                await self._at_vehicle(Connected(vehicle, facts, sensors, gnss))
        except HalError as error:
            self._station.vehicle_gone()
            self._enter(Phase.WAITING, f"waiting for a vehicle: {error}")
            await self._pause(_RETRY_S)
        finally:
            await vehicle.close()

    async def _opened(self, vehicle: registry.LinkedVehicle) -> VehicleFacts | None:
        """The vehicle's facts, None when the service is told to end first; raises HalError."""
        async with asyncio.TaskGroup() as group:
            opening = group.create_task(_answer(vehicle))
            ending = group.create_task(self._ending.wait())
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

    async def _at_vehicle(self, connected: Connected) -> None:
        """Look at it, fly what is queued; raises ConnectionFailed when it falls silent."""
        period_s = 1.0 / self._config.control.rate_hz
        self._origin_ned_m, self._last_position = None, None
        self._readings.clear()
        parts = (connected.vehicle, *connected.sensors, connected.gnss)
        self._station.dropped = lambda: dropped_by(parts)
        await self._after_restart(connected)
        self._ready(connected)
        while True:
            self._look(connected)
            if self._ending.is_set():
                if self._left_in_air is not None:
                    await bring_down(connected.vehicle, self._config, self._left_in_air)
                return
            record = self._station.take_mission()
            if record is not None:
                await self._fly(record, connected)
                self._look(connected)
                self._ready(connected)
            for command in self._station.take_commands():
                await self._obey_at_rest(command, connected)
            await asyncio.sleep(period_s)

    def _ready(self, connected: Connected) -> None:
        """Say that a mission may come."""
        if self._ending.is_set():
            return
        self._enter(
            Phase.READY,
            f"{connected.facts.autopilot} {connected.facts.version} is ready for a mission",
        )
        if not self._ready_told:
            self._ready_told = True
            self._notifier.ready()

    def _look(self, connected: Connected) -> None:
        """One look at a vehicle that is not flown."""
        vehicle = connected.vehicle
        status = vehicle.status()
        if status.link_age_s > self._config.service.reconnect_after_s:
            raise ConnectionFailed(
                f"the vehicle on {self._config.vehicle.connection} fell silent; check its power "
                "and its link"
            )
        for sensor in connected.sensors:
            for reading in sensor.take():
                self._readings[reading.beam] = reading
        for text in vehicle.take_texts():
            self._station.tell("px4", f"PX4: {text.text}")
        position = vehicle.local_position()
        on_ground = status.landed is LandedState.ON_GROUND or not status.armed
        self._follow_frame(position, on_ground=on_ground)
        left = self._left_in_air
        down = status.landed is LandedState.ON_GROUND and not status.armed
        if down or (left is not None and not left.holds(status.mode)):
            self._left_in_air = None
        self._proved_ours = self._proved_ours and not down
        self._station.at_rest(
            Instant(
                now_s=self._drivers.clock.now_s(),
                status=status,
                readings=dict(self._readings),
                position=position,
                attitude=vehicle.attitude(),
                origin_ned_m=self._origin(position),
            )
        )

    def _follow_frame(self, position: LocalPosition | None, *, on_ground: bool) -> None:
        """On the ground only the frame moves: where it jumps, the service's frame jumps along."""
        last, self._last_position = self._last_position, position
        if last is None or position is None or self._origin_ned_m is None:
            return
        jump = subtract(position.position_ned_m, last.position_ned_m)
        reset = position.reset_counter != last.reset_counter
        if on_ground and (reset or math.hypot(*jump) > _JUMP_M):
            self._origin_ned_m = add(self._origin_ned_m, jump)

    def _origin(self, position: LocalPosition | None) -> Vector3:
        """The service's frame; before the first mission it is where the vehicle stands."""
        if self._origin_ned_m is not None:
            return self._origin_ned_m
        return position.position_ned_m if position is not None else ZERO3

    async def _obey_at_rest(self, command: OperatorCommand, connected: Connected) -> None:
        """Commands while nothing is flown: they matter only for what this service left in the air.

        A vehicle that somebody else flies is not this service's to stop.
        """
        left = self._ordered(connected.vehicle.status().mode)
        if left is None:
            self._station.tell("refused", f"{command.value}: nothing is flown by this service")
            return
        if command is OperatorCommand.RESUME:
            self._station.tell("refused", "resume: the mission is over; begin a new one")
            return
        self._left_in_air = left
        kind = RequestKind.LAND if command is OperatorCommand.LAND else RequestKind.HOLD
        left.asked(kind)
        reply = await connected.vehicle.execute(Request(kind))
        said = "accepted" if reply.accepted else reply.reason
        self._station.tell(command.value, f"{kind.value} in Hold: {said}")

    def _ordered(self, mode: FlightMode) -> Custody | None:
        """The custody by which an order is obeyed; None where it is not this service's to obey."""
        left = self._left_in_air
        if left is not None and left.holds(mode):
            return left
        if self._proved_ours and mode in in_flight.OBEYED_IN:
            left = Custody()
            left.adopt(RequestKind.HOLD)
            return left
        return None

    # ------------------------------------------------------------ killed in flight, begun anew

    async def _after_restart(self, connected: Connected) -> None:
        """A vehicle that this service's last life left in the air: once, do what is configured.

        What neither PX4's failsafe nor that life's deadman has put into Hold is somebody's, and
        left alone. One that falls silent meanwhile (ConnectionFailed) is seen to when it is back.
        """
        if self._restart_seen_to:
            return
        await self._settled(connected)
        if in_flight.is_in_the_air(connected.vehicle.status()):
            await self._in_the_air(connected)
        self._restart_seen_to = True

    async def _in_the_air(self, connected: Connected) -> None:
        """Find out whose the vehicle is, and do what is configured with one's own."""
        vehicle = connected.vehicle
        self._enter(Phase.WAITING, "the vehicle is in the air: reading the last flight's log")
        folder = Path(self._config.log.directory)
        flight, unread = await asyncio.to_thread(in_flight.read_last_flight, folder)
        self._look(connected)
        found = in_flight.Found(
            self._drivers.clock.now_s(),
            host_boot(),
            connected.facts,
            vehicle.status(),
            vehicle.local_position(),
            self._config,
            self._world(),
        )
        why = unread or in_flight.why_not_ours(flight, found)
        if flight is None or why:
            self._station.tell("in_flight", f"the vehicle is in the air and left alone: {why}")
            return
        self._proved_ours = True
        why = in_flight.why_not_held_for_us(flight, found)
        if why is not None:
            self._station.tell(
                "in_flight",
                f"the vehicle is in the air and left alone: {why}; it was flown by this service, "
                "which lands it when ordered",
            )
            return
        await self._take_back(flight, found, connected)

    async def _settled(self, connected: Connected) -> None:
        """Until the vehicle told what it does, and PX4 what becomes of a stream that ended."""
        vehicle, clock = connected.vehicle, self._drivers.clock
        loss_s = connected.facts.parameters.get("COM_OF_LOSS_T", _OFFBOARD_LOSS_S)
        ends_s = clock.now_s() + loss_s + _TELLS_WITHIN_S
        while clock.now_s() < ends_s and not self._ending.is_set():
            self._look(connected)
            status = vehicle.status()
            unknown = status.mode is FlightMode.UNKNOWN or status.landed is LandedState.UNKNOWN
            waiting = status.mode is FlightMode.OFFBOARD or not status.in_failsafe
            down = not in_flight.is_in_the_air(status)
            if not unknown and (down or (not waiting and vehicle.local_position() is not None)):
                return
            await asyncio.sleep(1.0 / self._config.control.rate_hz)

    async def _take_back(
        self, flight: in_flight.Interrupted, found: in_flight.Found, connected: Connected
    ) -> None:
        """The vehicle is the interrupted flight's, and PX4 holds it: hold, land or resume."""
        choice = self._config.service.on_restart_in_flight
        left = Custody()
        left.adopt(RequestKind.HOLD)
        self._left_in_air = left
        if choice == "land":
            self._station.tell("in_flight", "this service was interrupted in flight; landing")
            await self._landed(left, connected)
            return
        why = in_flight.why_not_resumed(flight, found) if choice == "resume" else None
        resumed = flight.resumed
        if choice == "hold" or why is not None or resumed is None:
            refused = f"; its mission cannot go on: {why}" if why is not None else ""
            self._station.tell(
                "in_flight",
                f"this service was interrupted in flight, PX4 holds the vehicle{refused}; "
                "order it to land",
            )
            return
        self._station.tell("in_flight", "this service was interrupted in flight; going on")
        self._restart_seen_to = True  # whatever becomes of it: a mission goes on once
        await self._fly_on(flight, resumed, connected)

    async def _landed(self, left: Custody, connected: Connected) -> None:
        """Ask for landing until the vehicle is down or somebody else's; looks at it meanwhile."""
        vehicle, silent_s = connected.vehicle, 2.0 * self._config.vehicle.link_timeout_s
        while True:
            async with asyncio.TaskGroup() as group:
                landing = group.create_task(bring_down(vehicle, self._config, left))
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
                self._look(connected)
            except ConnectionFailed as error:
                return error
            await asyncio.sleep(1.0 / self._config.control.rate_hz)
        return None

    def _world(self) -> str:
        """The scenario that flight logs name; empty for a real flight."""
        virtual = self._config.beams.virtual()
        return virtual.scenario if virtual is not None else self._desk.scenario or ""

    async def _fly_on(
        self, flight: in_flight.Interrupted, resumed: Resumed, connected: Connected
    ) -> None:
        """The interrupted mission from its log, in its own frame."""
        self._ready(connected)  # systemd's watchdog counts from here
        order = MissionOrder(goals=tuple(list(goal) for goal in flight.route))
        options = FlyOptions(
            goals=flight.route,
            connection=self._config.vehicle.connection,
            log_dir=self._config.log.directory,
        )
        mission = app.Mission(options, flight.config, None)
        record = self._station.go_on(order)
        await self._fly_one(record, mission, flight.route, (0.0, 0.0), connected, resumed)

    # ------------------------------------------------------------ one mission

    async def _fly(self, record: MissionRecord, connected: Connected) -> None:
        """Fly one mission and keep its report; whatever goes wrong, the service goes on."""
        try:
            mission, route, offset = self._planned(record.order, connected)
        except (AutonomyError, HalError) as error:
            self._station.update(record.id, status=MissionStatus.REFUSED, why=str(error))
            self._station.tell("refused", str(error))
            return
        await self._fly_one(record, mission, route, offset, connected)

    async def _fly_one(
        self,
        record: MissionRecord,
        mission: app.Mission,
        route: tuple[Vector3, ...],
        offset: Point,
        connected: Connected,
        resumed: Resumed | None = None,
    ) -> None:
        """A mission that was planned, or one that goes on."""
        goals = tuple((goal[0] + offset[0], goal[1] + offset[1]) for goal in route)
        self._station.begin(FlownMission(record.id, goals, offset))
        self._enter(Phase.FLYING, f"mission {record.id} begins")
        with ExitStack() as stack:
            recorder = self._recorder(mission, stack)
            try:
                report = await self._flown(mission, route, offset, connected, recorder, resumed)
            except Exception as error:  # noqa: BLE001 - the vehicle is down; the next mission must not be lost
                traceback.print_exception(error)
                cause = _innermost(error)
                why = f"a defect of this program: {type(cause).__name__}: {cause}"
                report = _failed(route, why)
        self._keep(record.id, report)

    def _planned(
        self, order: MissionOrder, connected: Connected
    ) -> tuple[app.Mission, tuple[Vector3, ...], Point]:
        """(mission, route, offset): mission and route in the pilot's frame, which begins at
        `offset` in the service's; raises BadInput or DocumentError.
        """
        position, attitude = connected.vehicle.local_position(), connected.vehicle.attitude()
        if position is None or attitude is None:
            raise BadInput("the vehicle does not tell where it is yet; wait for its estimator")
        origin = self._origin(position)
        offset = (
            position.position_ned_m[0] - origin[0],
            position.position_ned_m[1] - origin[1],
        )
        mission = self._desk.mission(order, offset, attitude.yaw_rad)
        route = tuple(
            (goal[0] - offset[0], goal[1] - offset[1], goal[2])
            for goal in mission.route_ned_m(attitude.yaw_rad)
        )
        return shifted(mission, offset), route, offset

    async def _flown(
        self,
        mission: app.Mission,
        route: tuple[Vector3, ...],
        offset: Point,
        connected: Connected,
        recorder: FlightRecorder | None,
        resumed: Resumed | None,
    ) -> FlightReport:
        """From preflight, or from where it was interrupted, to landing."""
        vehicle, clock = connected.vehicle, self._drivers.clock
        deadman = Deadman(
            mission.config.deadman, vehicle.stop_now, vehicle.hold_now, clock, _marks(recorder)
        )
        watch = FlightWatch(self._station, self._metrics, self._notifier, recorder)
        flight = Flight(
            mission.config,
            route,
            vehicle=vehicle,
            facts=connected.facts,
            sensors=connected.sensors,
            gnss=connected.gnss,
            deadman=deadman,
            clock=clock,
            recorder=watch,
            observer=Notes(self._station),
            resumed=resumed,
        )
        watch.flight = flight
        if recorder is not None:
            recorder.route(route, resumed)
        self._flight = flight
        if self._ending.is_set():
            flight.command(OperatorCommand.STOP)
        try:
            with deadman:
                outcome = await flight.run()
        finally:
            self._flight = None
            home = flight.sensing.home_ned_m
            self._origin_ned_m = (home[0] - offset[0], home[1] - offset[1], home[2])
            self._last_position = vehicle.local_position()
            status = vehicle.status()
            ours = status.armed and flight.custody.holds(status.mode)
            self._left_in_air = flight.custody if ours else None
        return app.report_of(mission, route, outcome, flight.tally, recorder, connected.sensors)

    def _recorder(self, mission: app.Mission, stack: ExitStack) -> FlightRecorder | None:
        """The flight's log; a disk that refuses it is told, and does not keep anybody down."""
        if not mission.config.log.enabled:
            return None
        try:
            return stack.enter_context(app.flight_recorder(mission))
        except BadInput as error:
            self._station.tell("log", f"flying without a log: {error}")
            return None

    def _keep(self, mission_id: str, report: FlightReport) -> None:
        """The report into the mission's record, and beside its log."""
        encoded = msgspec.json.encode(report)
        log = Path(report.log_path) if report.log_path is not None else None
        if log is not None:
            try:
                logs.report_path(log).write_bytes(encoded)
            except OSError as error:
                self._station.tell("log", f"the report could not be kept ({error.strerror})")
        record = self._station.update(
            mission_id,
            status=MissionStatus.DONE,
            why=report.why,
            ending=report.ending.value,
            exit_code=report.exit_code,
            report=msgspec.to_builtins(report),
            log=log.name if log is not None else None,
        )
        self._metrics.flown(record)
        self._station.tell(report.ending.value, report.why)

    # ------------------------------------------------------------ life

    def _enter(self, phase: Phase, why: str) -> None:
        if phase is not self._station.phase or why != self._station.why:
            _LOG.info("%s: %s", phase.value, why)
        self._station.enter(phase, why)
        self._notifier.status(why)

    async def _beat(self) -> None:
        """Signs of life while nothing is flown; in flight only the control loop gives them.

        A loop that ended gives none, and the vehicle is brought down then: killed between Hold and
        Land it would stay in the air.
        """
        while True:
            flight, now_s = self._flight, self._drivers.clock.now_s()
            if flight is None or flight.is_closing(now_s):
                self._notifier.alive(now_s)
            await asyncio.sleep(0.25)

    async def _pause(self, seconds: float) -> None:
        """Sleep, but not through the service's end."""
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(seconds):
                await self._ending.wait()

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


def _marks(recorder: FlightRecorder | None) -> Callable[[float], None] | None:
    """What the deadman leaves beside the flight's log; nothing for a flight without one."""
    if recorder is None:
        return None
    log, boot = recorder.path, host_boot()
    return lambda now_s: in_flight.leave_mark(log, in_flight.HoldMark(now_s, boot))


async def _answer(vehicle: registry.LinkedVehicle) -> VehicleFacts | HalError:
    """The vehicle's facts, or why there is none: a task group would wrap what is raised."""
    try:
        return await vehicle.open(_CONNECT_S)
    except HalError as error:
        return error


class FlightWatch:
    """Stands where the flight log stands, so that it hears every tick: passes it on to the log,
    the station, the metrics and the watchdog, and brings the orders of the web side.
    """

    def __init__(
        self,
        station: Station,
        metrics: Metrics,
        notifier: Notifier,
        recorder: Recorder | None,
    ) -> None:
        self._station = station
        self._metrics = metrics
        self._notifier = notifier
        self._recorder = recorder
        self.flight: Flight | None = None

    def tick(self, inputs: Inputs, command: Command, step_s: float) -> None:
        """One tick of the control loop."""
        flight = self.flight
        if flight is None:
            raise ValueError("a tick without a flight: set .flight first")
        if self._recorder is not None:
            self._recorder.tick(inputs, command, step_s)
        self._station.flight_tick(command, inputs.status, flight.sensing)
        self._metrics.tick(inputs, command, step_s)
        self._notifier.alive(inputs.now_s)
        for order in self._station.take_commands():
            flight.command(order)

    def text(self, text: StatusText) -> None:
        """One line of the autopilot's."""
        if self._recorder is not None:
            self._recorder.text(text)


class Notes:
    """The flight's lines for people, as events."""

    def __init__(self, station: Station) -> None:
        self._station = station

    def tick(self, command: Command) -> None:
        """Ticks come through FlightWatch."""

    def note(self, text: str) -> None:
        """One line."""
        self._station.tell("note", text)


def _innermost(error: Exception) -> BaseException:
    """What a task group wrapped."""
    cause: BaseException = error
    while isinstance(cause, BaseExceptionGroup):
        cause = cause.exceptions[0]
    return cause


def _failed(route: tuple[Vector3, ...], why: str) -> FlightReport:
    """The report of a flight that a defect ended."""
    return FlightReport(
        ending=Ending.INTERNAL, why=why, exit_code=int(ExitCode.INTERNAL), route_ned_m=route
    )
