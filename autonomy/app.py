"""The composition root: options to configuration, drivers and components; then one flight.

The only module that knows the registry. `fly` is what `autonomy fly` calls.
"""

import asyncio
import contextlib
import logging
import math
import os
import signal
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import ExitStack, asynccontextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from urllib.parse import urlsplit

import msgspec

from autonomy.config import Config, load_config
from autonomy.embedded import EmbeddedPx4
from autonomy.errors import BadInput
from autonomy.flight import Flight
from autonomy.flightlog.folder import make_room
from autonomy.flightlog.recorder import FlightRecorder
from autonomy.geometry import Point
from autonomy.handover import hand_over
from autonomy.mission.preflight import check_route
from autonomy.model import OperatorCommand, Outcome
from autonomy.progress import Progress
from autonomy.report import FlightReport, FlyOptions, with_truth
from autonomy.service.lock import Holder, VehicleHeld, VehicleLock, utc_now
from autonomy.service.logs import report_path
from autonomy.simulation import with_scenario
from autonomy.tally import Tally
from autonomy.termination import termination_signals, termination_waits
from autonomy.virtual_world import near_miss, typed_driver, warning, with_virtual_world
from autonomy.warm import warm_up
from hal import registry
from hal.clock import MonotonicClock
from hal.config import CONNECTION_SCHEMES, DEVICE_SCHEMES
from hal.documents import validate_document
from hal.errors import ConnectionFailed
from hal.frames import Vector3, ned_from_enu, ned_from_frd
from hal.gnss.autopilot_gnss import AutopilotGnss
from hal.interfaces import Vehicle
from hal.sim.faults import check_beams
from hal.sim.scenario import Scenario, load_scenario, with_faults
from hal.vehicle.deadman import Deadman

_POLL_S = 0.05
_GNSS_TOLD_WITHIN_S = 2.0
"""PX4 sends GPS_RAW_INT at 1 Hz at least, once it has heard of a receiver (its source)."""
_SAME_TEXT_S = 5.0
_TEXTS_REMEMBERED = 100


@dataclass(frozen=True)
class Mission:
    """Options made whole: what will be flown, where, and with which configuration."""

    options: FlyOptions
    config: Config
    scenario: Scenario | None
    """The simulated world that the vehicle is really in."""
    virtual: Scenario | None = None
    """The world that its beams alone look into."""

    def route_ned_m(self, start_yaw_rad: float) -> tuple[Vector3, ...]:
        """The goals in NED about the take-off point; the heading matters for frame `body` only.

        Raises BadInput for a goal that must not be flown to.
        """
        route = tuple(
            _goal_ned(goal, self.options.frame, self.config.mission.altitude_m, start_yaw_rad)
            for goal in self.options.goals
        )
        check_route(self.config, route)
        for world in (self.scenario, self.virtual):
            if world is not None:
                _check_goals_are_free(self.config, world, route)
        return route


def prepare(options: FlyOptions) -> Mission:
    """Everything that can be refused before anything moves; raises BadInput or DocumentError."""
    return prepare_with(
        load_config(Path(options.config_path) if options.config_path else None), options
    )


def prepare_with(config: Config, options: FlyOptions) -> Mission:
    """As `prepare`, with a loaded configuration; `options.config_path` is not read."""
    config = _with_options(config, options)
    scenario = load_scenario(options.scenario) if options.scenario is not None else None
    virtual = None
    if scenario is not None:
        scenario = with_faults(scenario, options.faults)
        check_beams(scenario.faults, [mount.name for mount in config.beams.mounts])
        config = with_scenario(config, scenario)
    else:
        driver = typed_driver(options, config.beams.virtual())
        if driver is not None:
            config, virtual = with_virtual_world(config, driver)
    mission = Mission(options, config, scenario, virtual)
    if scenario is not None:
        mission.route_ned_m(math.radians(scenario.start_yaw_deg))
    else:
        check_connection(options.connection or config.vehicle.connection)
        if options.frame != "body":
            mission.route_ned_m(0.0)
    return mission


def fly(options: FlyOptions) -> FlightReport:
    """One mission from preflight to landing; the report says how it ended.

    A service that holds the vehicle is given the mission. Raises BadInput (VehicleHeld for another
    pilot), DocumentError, ConnectionFailed, WrongAutopilot before anything moved.
    """
    mission = prepare(options)
    progress = Progress.create(options.output)
    with ExitStack() as stack:
        stack.enter_context(_termination_interrupts())
        stack.enter_context(progress)
        stack.enter_context(_warnings_noted(progress))
        connection = options.connection or mission.config.vehicle.connection
        if options.scenario is None:
            try:
                stack.enter_context(_pilot_lock(connection))
            except VehicleHeld as held:
                if held.holder is None or held.holder.api is None:
                    raise
                report = hand_over(options, held.holder, progress)
                progress.report(report)
                return report
        recorder: FlightRecorder | None = None
        if options.log and mission.config.log.enabled:
            recorder = stack.enter_context(flight_recorder(mission, progress.note))
        progress.note("warming up the planner")
        _warm_up(progress)
        embedded: EmbeddedPx4 | None = None
        if options.scenario is not None:
            progress.note(f"starting the embedded PX4 in scenario {options.scenario}")
            embedded = stack.enter_context(
                EmbeddedPx4(options.scenario, options.seed, options.faults)
            )
            connection = embedded.connection
        report = asyncio.run(_fly(mission, connection, recorder, progress))
        if embedded is not None:
            report = with_truth(report, embedded.true_clearance_m())
        refused = keep_report(report)
        if refused is not None:
            progress.note(refused)
        progress.report(report)
    return report


def _warm_up(progress: Progress) -> None:
    """Compile what flies; Ctrl-C ends it at its next sentence, within five seconds."""
    with termination_waits() as take_effect:

        def note(text: str) -> None:
            progress.note(text)
            take_effect()

        warm_up(note)


async def _fly(
    mission: Mission, connection: str, recorder: FlightRecorder | None, progress: Progress
) -> FlightReport:
    """Connect, fly, disconnect."""
    config = mission.config
    clock = MonotonicClock()
    vehicle_config = config.vehicle.model_copy(update={"connection": connection})
    vehicle = registry.vehicle(vehicle_config, config.beams, clock)
    progress.note(f"waiting for a vehicle on {connection}")
    try:
        facts = await vehicle.open(config.vehicle.connect_timeout_s)
        progress.note(f"connected to {facts.autopilot} {facts.version}, system {facts.system_id}")
        route = mission.route_ned_m(await start_yaw_rad(mission, vehicle))
        if recorder is not None:
            recorder.route(route)
        sensors = registry.range_sensors(config.beams, vehicle, clock)
        gnss = registry.gnss(config.gnss, vehicle, clock)
        driver = config.beams.virtual()
        if driver is not None:
            progress.note(warning(driver))
        deadman = Deadman(config.deadman, vehicle.stop_now, vehicle.hold_now, clock)
        flight = Flight(
            config,
            route,
            vehicle=vehicle,
            facts=facts,
            sensors=sensors,
            gnss=gnss,
            deadman=deadman,
            clock=clock,
            recorder=recorder,
            observer=progress,
        )
        async with opened(sensors, gnss, config.vehicle.connect_timeout_s, progress.note):
            with deadman, _operator_signals(flight, progress):
                outcome = await flight.run()
    finally:
        await vehicle.close()
    return report_of(mission, route, outcome, flight.tally, recorder, sensors)


# ---------------------------------------------------------------- before the flight


def _pilot_lock(connection: str) -> VehicleLock:
    """The lock that keeps a second pilot from this vehicle."""
    return VehicleLock(connection, Holder("autonomy fly", os.getpid(), utc_now()))


def _with_options(config: Config, options: FlyOptions) -> Config:
    """The configuration with what was typed laid over it; raises DocumentError."""
    data = config.model_dump()
    typed = {
        "altitude_m": options.altitude_m,
        "land_at_end": options.land,
        "time_limit_s": options.time_limit_s,
    }
    data["mission"].update({key: value for key, value in typed.items() if value is not None})
    if options.mode is not None:
        data["mission"]["replan"]["mode"] = options.mode
    return validate_document(data, Config, "command line")


def check_connection(connection: str) -> None:
    """Raise BadInput for what is not the URL of a connection."""
    scheme, colon, rest = connection.partition("://")
    if scheme not in CONNECTION_SCHEMES or not colon or not rest:
        raise BadInput(
            f"the connection {connection!r} is not understood; write it like "
            "udpin://0.0.0.0:14540, tcpout://host:port or serial:///dev/ttyAMA0:921600"
        )
    if scheme in DEVICE_SCHEMES:
        return
    try:
        port = urlsplit(connection).port
    except ValueError:
        port = 0
    if port == 0:
        raise BadInput(f"the port of the connection {connection!r} is not a number from 1 to 65535")


def _goal_ned(
    goal: tuple[float, float, float | None], frame: str, altitude_m: float, yaw_rad: float
) -> Vector3:
    """One goal as typed, in NED about the take-off point. Heights up in ENU, down in the others."""
    x, y, z = goal
    if frame == "enu":
        return ned_from_enu((x, y, altitude_m if z is None else z))
    down_m = -altitude_m if z is None else z
    if frame == "body":
        return ned_from_frd((x, y, down_m), yaw_rad)
    return (x, y, down_m)


def _check_goals_are_free(config: Config, scenario: Scenario, route: tuple[Vector3, ...]) -> None:
    """Raise BadInput for a goal in, or too near to, an obstacle of a known world."""
    keep_out_m = config.body.radius_m + config.planner.hard_clearance_m
    for goal in route:
        for index, obstacle in enumerate(scenario.obstacles):
            gap_m = obstacle.distance_m(goal[0], goal[1])
            if gap_m < keep_out_m:
                name = obstacle.label or f"{obstacle.kind} {index}"
                place = "inside" if gap_m < 0 else f"{gap_m:.2f} m from"
                raise BadInput(
                    f"the goal ({goal[0]:g}, {goal[1]:g}) is {place} the obstacle '{name}' of "
                    f"scenario {scenario.name}; keep it {keep_out_m:.2f} m away"
                )


async def start_yaw_rad(mission: Mission, vehicle: Vehicle) -> float:
    """The heading at the start, waited for only where goals depend on it."""
    if mission.options.frame != "body":
        return 0.0
    for _ in range(int(mission.config.vehicle.connect_timeout_s / _POLL_S)):
        attitude = vehicle.attitude()
        if attitude is not None:
            return attitude.yaw_rad
        await asyncio.sleep(_POLL_S)
    raise BadInput("the vehicle does not tell its heading, so --frame body has no meaning; use ned")


@contextlib.contextmanager
def flight_recorder(mission: Mission, tell: Callable[[str], None]) -> Iterator[FlightRecorder]:
    """The flight log, with what a stranger needs to understand and repeat the flight.

    Old flights make room first; `tell` hears which, and when recording ends before its time (on
    another thread). A start that failed before the first tick leaves no file. Raises BadInput when
    none can be made.
    """
    options, config = mission.options, mission.config
    virtual = config.beams.virtual()
    folder = Path(options.log_dir or config.log.directory)
    for sentence in make_room(folder, config.log, datetime.now(UTC).timestamp()):
        tell(sentence)
    recorder = FlightRecorder.in_folder(
        folder,
        config_json=config.model_dump_json(),
        scenario=virtual.scenario if virtual is not None else options.scenario,
        seed=virtual.seed if virtual else options.seed if options.scenario is not None else None,
        tell=tell,
    )
    try:
        with recorder:
            yield recorder
    finally:
        if recorder.ticks == 0:
            with contextlib.suppress(OSError):  # a disk that refuses this keeps an empty log
                recorder.path.unlink()


# ---------------------------------------------------------------- during the flight


@asynccontextmanager
async def opened(
    sensors: registry.Sensors,
    gnss: registry.Gnss,
    deadline_s: float,
    note: Callable[[str], None] = lambda _: None,
) -> AsyncIterator[None]:
    """Sensors open inside, closed after, whatever happens.

    An autopilot that tells nothing of a GNSS receiver may have none: it is flown by its local
    position, and `note` says so. A receiver that is configured here must be there.
    """
    try:
        for sensor in sensors:
            await sensor.open(deadline_s)
        if isinstance(gnss, AutopilotGnss):
            await _open_if_there(gnss, min(deadline_s, _GNSS_TOLD_WITHIN_S), note)
        elif gnss is not None:
            await gnss.open(deadline_s)
        yield
    finally:
        for sensor in sensors:
            await sensor.close()
        if gnss is not None:
            await gnss.close()


async def _open_if_there(
    gnss: AutopilotGnss, deadline_s: float, note: Callable[[str], None]
) -> None:
    try:
        await gnss.open(deadline_s)
    except ConnectionFailed:
        note("the autopilot tells of no GNSS receiver: flying by its local position alone")


class _Notes(logging.Handler):
    """Log records as notes; the same text again within five seconds is left out."""

    def __init__(self, progress: Progress) -> None:
        super().__init__(logging.WARNING)
        self._progress = progress
        self._said_s: dict[str, float] = {}

    def emit(self, record: logging.LogRecord) -> None:
        """Called on whichever thread has something to say; never blocks."""
        text = record.getMessage()
        if record.created - self._said_s.get(text, -math.inf) < _SAME_TEXT_S:
            return
        if len(self._said_s) >= _TEXTS_REMEMBERED:
            self._said_s.clear()
        self._said_s[text] = record.created
        self._progress.note(text)


@contextlib.contextmanager
def _warnings_noted(progress: Progress) -> Iterator[None]:
    """What is warned of is shown with the flight, not over it.

    All of it: what nobody took would be written to stderr by whoever warns, and a terminal that was
    stopped would stop that thread.
    """
    handler, root = _Notes(progress), logging.getLogger()
    root.addHandler(handler)
    try:
        yield
    finally:
        root.removeHandler(handler)


@contextlib.contextmanager
def _termination_interrupts() -> Iterator[None]:
    """Every `termination_signals` ends as Ctrl-C does; in flight `_operator_signals` has them."""
    handler = signal.default_int_handler
    before = {number: signal.signal(number, handler) for number in termination_signals()}
    try:
        yield
    finally:
        for number, previous in before.items():
            signal.signal(number, previous)


@contextlib.contextmanager
def _operator_signals(flight: Flight, progress: Progress) -> Iterator[None]:
    """Each of `termination_signals` stops, holds and then lands; a second one lands at once."""
    loop = asyncio.get_running_loop()

    def stop() -> None:
        progress.note("stopping: hold, then land; once more to land at once")
        flight.command(OperatorCommand.STOP)

    signals = termination_signals()
    for number in signals:
        loop.add_signal_handler(number, stop)
    try:
        yield
    finally:
        for number in signals:
            loop.remove_signal_handler(number)
            signal.signal(number, signal.default_int_handler)


# ---------------------------------------------------------------- after the flight


def keep_report(report: FlightReport) -> str | None:
    """Write the report beside its log, if it has one; why that was refused, as a sentence.

    It knows what a log cannot: the true clearance of a simulated flight.
    """
    if report.log_path is None:
        return None
    path = report_path(Path(report.log_path))
    try:
        path.write_bytes(msgspec.json.encode(report))
    except OSError as error:
        return f"the report could not be kept ({error.strerror})"
    return None


def report_of(
    mission: Mission,
    route: tuple[Vector3, ...],
    outcome: Outcome,
    tally: Tally,
    recorder: FlightRecorder | None,
    sensors: registry.Sensors,
    origin_ne_m: Point = (0.0, 0.0),
) -> FlightReport:
    """What the flight was; where beams were virtual, with what they know of it.

    `origin_ne_m`: the take-off point in the frame of the service that flies.
    """
    virtual = mission.config.beams.virtual()
    simulated = mission.scenario is not None
    report = tally.report(
        outcome,
        route,
        config=mission.config,
        log_path=str(recorder.path) if recorder is not None else None,
        log_notes=recorder.notes() if recorder is not None else (),
        scenario=virtual.scenario if virtual is not None else mission.options.scenario,
        seed=virtual.seed if virtual else mission.options.seed if simulated else None,
        origin_ne_m=origin_ne_m,
    )
    missed = near_miss(sensors)
    if missed is None:
        return report
    return with_truth(report, missed.least_m, missed.collisions, by_reported_pose=True)
