"""One mission: planned from its order, flown, its report kept. Whatever goes wrong, the service
goes on.
"""

import logging
import traceback
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path

import msgspec

from autonomy import app, in_flight
from autonomy.errors import AutonomyError, BadInput, ExitCode
from autonomy.flight import Flight
from autonomy.flightlog.folder import host_boot
from autonomy.flightlog.recorder import FlightRecorder
from autonomy.geometry import Point
from autonomy.model import Ending, OperatorCommand, Resumed
from autonomy.report import FlightReport, FlyOptions, with_truth
from autonomy.service.contract import MissionOrder, MissionRecord, MissionStatus, Phase
from autonomy.service.station import FlownMission
from autonomy.serving.attending import Attendant
from autonomy.serving.desk import shifted
from autonomy.serving.memory import clear_up
from autonomy.serving.parts import Connected, Parts
from autonomy.serving.watch import FlightWatch, Notes
from hal.errors import HalError
from hal.frames import Vector3
from hal.vehicle.deadman import Deadman

_LOG = logging.getLogger("autonomy")


class Planned(msgspec.Struct, frozen=True):
    """A mission ready to be flown. It and its route are in the pilot's frame, which begins at
    `offset` in the service's.
    """

    mission: app.Mission
    route: tuple[Vector3, ...]
    offset: Point
    resumed: Resumed | None = None
    """Where it goes on, for one that was interrupted."""


class Missions:
    """Flies them one after another."""

    def __init__(self, parts: Parts, attendant: Attendant) -> None:
        self._parts = parts
        self._attendant = attendant
        self.flight: Flight | None = None
        """The one being flown."""

    def stop(self, *, at_once: bool) -> None:
        """The service is told to end: hold, then land what is flown; `at_once`: land now."""
        if self.flight is None:
            return
        self.flight.command(OperatorCommand.LAND if at_once else OperatorCommand.STOP)
        parts = self._parts
        parts.notifier.extend_s(parts.config.mission.land_timeout_s + 30.0)
        parts.enter(Phase.STOPPING, "told to stop: holding, then landing")

    async def fly(self, record: MissionRecord, connected: Connected) -> None:
        """Fly what was ordered."""
        station = self._parts.station
        try:
            planned = self._planned(record.order, connected)
        except (AutonomyError, HalError) as error:
            station.update(record.id, status=MissionStatus.REFUSED, why=str(error))
            station.tell("refused", str(error))
            return
        await self._fly(record, planned, connected)

    async def fly_on(
        self, interrupted: in_flight.Interrupted, resumed: Resumed, connected: Connected
    ) -> None:
        """The interrupted mission from its log, in its own frame."""
        self._attendant.ready(connected)  # systemd's watchdog counts from here
        config, route = self._parts.config, interrupted.route
        order = MissionOrder(goals=tuple(list(goal) for goal in route))
        options = FlyOptions(
            goals=route, connection=config.vehicle.connection, log_dir=config.log.directory
        )
        mission = app.Mission(options, interrupted.config, None)
        record = self._parts.station.go_on(order)
        await self._fly(record, Planned(mission, route, (0.0, 0.0), resumed), connected)

    async def _fly(self, record: MissionRecord, planned: Planned, connected: Connected) -> None:
        """A mission that was planned, or one that goes on."""
        route, offset = planned.route, planned.offset
        goals = tuple((goal[0] + offset[0], goal[1] + offset[1]) for goal in route)
        self._parts.station.begin(FlownMission(record.id, goals, offset))
        self._attendant.forget_said()
        self._parts.enter(Phase.FLYING, f"mission {record.id} begins")
        with ExitStack() as stack:
            recorder = self._recorder(planned.mission, stack)
            try:
                report = await self._flown(planned, connected, recorder)
            except Exception as error:  # noqa: BLE001 - the vehicle is down; the next mission must not be lost
                traceback.print_exception(error)
                cause = _innermost(error)
                why = f"a defect of this program: {type(cause).__name__}: {cause}"
                report = _failed(route, why)
        self._keep(record.id, report)
        clear_up()

    def _planned(self, order: MissionOrder, connected: Connected) -> Planned:
        """The order from where the vehicle stands; raises BadInput or DocumentError."""
        position, attitude = connected.vehicle.local_position(), connected.vehicle.attitude()
        if position is None or attitude is None:
            raise BadInput("the vehicle does not tell where it is yet; wait for its estimator")
        origin = self._attendant.frame.origin(position)
        offset = (
            position.position_ned_m[0] - origin[0],
            position.position_ned_m[1] - origin[1],
        )
        mission = self._parts.desk.mission(order, offset, attitude.yaw_rad)
        route = tuple(
            (goal[0] - offset[0], goal[1] - offset[1], goal[2])
            for goal in mission.route_ned_m(attitude.yaw_rad)
        )
        return Planned(shifted(mission, offset), route, offset)

    async def _flown(
        self, planned: Planned, connected: Connected, recorder: FlightRecorder | None
    ) -> FlightReport:
        """From preflight, or from where it was interrupted, to landing."""
        parts, mission, vehicle = self._parts, planned.mission, connected.vehicle
        clock = parts.drivers.clock
        deadman = Deadman(
            mission.config.deadman, vehicle.stop_now, vehicle.hold_now, clock, _marks(recorder)
        )
        watch = FlightWatch(parts.station, parts.metrics, parts.notifier, recorder)
        flight = Flight(
            mission.config,
            planned.route,
            vehicle=vehicle,
            facts=connected.facts,
            sensors=connected.sensors,
            gnss=connected.gnss,
            deadman=deadman,
            clock=clock,
            recorder=watch,
            observer=Notes(parts.station),
            resumed=planned.resumed,
        )
        watch.flight = flight
        if recorder is not None:
            recorder.route(planned.route, planned.resumed, planned.offset)
        self.flight = flight
        if parts.ending.is_set():
            flight.command(OperatorCommand.STOP)
        try:
            with deadman:
                outcome = await flight.run()
        finally:
            self.flight = None
            self._hand_back(flight, planned.offset, connected)
        report = app.report_of(
            mission,
            planned.route,
            outcome,
            flight.tally,
            recorder,
            connected.sensors,
            planned.offset,
        )
        truth = parts.true_clearance_m
        return report if truth is None else with_truth(report, truth())

    def _hand_back(self, flight: Flight, offset: Point, connected: Connected) -> None:
        """The vehicle is the attendant's again: where the frame is, and whose the vehicle."""
        vehicle = connected.vehicle
        self._attendant.frame.landed(flight.sensing.home_ned_m, offset, vehicle.local_position())
        status = vehicle.status()
        ours = status.armed and flight.custody.holds(status.mode)
        self._attendant.left.custody = flight.custody if ours else None
        if status.armed and flight.lost:
            self._attendant.left.lose()

    def _recorder(self, mission: app.Mission, stack: ExitStack) -> FlightRecorder | None:
        """The flight's log; a disk that refuses it is told, and does not keep anybody down."""
        if not mission.config.log.enabled:
            return None
        try:
            return stack.enter_context(app.flight_recorder(mission, self._tell_of_log))
        except BadInput as error:
            self._parts.station.tell("log", f"flying without a log: {error}")
            return None

    def _tell_of_log(self, text: str) -> None:
        _LOG.warning("%s", text)
        self._parts.station.tell("log", text)

    def _keep(self, mission_id: str, report: FlightReport) -> None:
        """The report into the mission's record, and beside its log."""
        station = self._parts.station
        log = Path(report.log_path) if report.log_path is not None else None
        refused = app.keep_report(report)
        if refused is not None:
            station.tell("log", refused)
        record = station.update(
            mission_id,
            status=MissionStatus.DONE,
            why=report.why,
            ending=report.ending.value,
            exit_code=report.exit_code,
            report=msgspec.to_builtins(report),
            log=log.name if log is not None else None,
        )
        self._parts.metrics.flown(record)
        station.tell(report.ending.value, report.why)


def _marks(recorder: FlightRecorder | None) -> Callable[[float], None] | None:
    """What the deadman leaves beside the flight's log; nothing for a flight without one."""
    if recorder is None:
        return None
    log, boot = recorder.path, host_boot()
    return lambda now_s: in_flight.leave_mark(log, in_flight.HoldMark(now_s, boot))


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
