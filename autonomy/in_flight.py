"""A service that begins anew and finds its vehicle in the air: whose it is, and what may be done.

Its last log tells what was flown: a log without an outcome is a flight that was cut off, and one
whose mission was over may have left the vehicle in Hold. The
vehicle is believed to be that flight's only where everything agrees: this computer was not started
anew since, the log's last tick is young, it is the same autopilot on the same connection, not
restarted either. The mission may go on only once, by the same limits, and only in the same frame:
no estimator reset since, the vehicle where it was, and a log that flown again gives every decision
bit for bit.

A control loop that hung is killed by the service's watchdog; the deadman has put the vehicle into
Hold by then, which looks like a pilot's. It leaves a `HoldMark` beside the log therefore.
"""

import logging
import math
import threading
from pathlib import Path

import msgspec

from autonomy.config import Config
from autonomy.errors import AutonomyError, NotReplayable
from autonomy.flightlog.folder import logs_in
from autonomy.flightlog.reader import FlightLog, compare
from autonomy.flightlog.schema import Tick
from autonomy.logbook import recorded_config
from autonomy.mission.guarded import GuardedPilot
from autonomy.mission.machine import NAVIGATING_STATES, OFFBOARD_STATES
from autonomy.model import Ending, MissionState, Outcome, Resumed
from autonomy.virtual_world import with_virtual_world
from hal.config import Fence
from hal.errors import HalError
from hal.frames import Vector3, norm, subtract
from hal.readings import FlightMode, LandedState, LocalPosition, VehicleFacts, VehicleStatus

YOUNG_S = 120.0
"""A log that ended longer ago says nothing about a vehicle in the air."""
HOVERS_S = 1800.0
"""Longer than a battery lasts: a vehicle left in the air when its mission was over is another's."""
MOVED_M = 1.0
"""A vehicle that PX4 holds since the program died is not farther from where it was."""
_CLOCK_LATE_S = 1.0
_BOOT_APART_S = 1.0
"""Two looks at when the autopilot started agree so well ..."""
_CLOCK_DRIFT = 1e-4
"""... and run apart by this since, as two computers' clocks do."""
_MARK_SUFFIX = ".hold.json"
_MARK_BYTES_MAX = 1000
_SAME_CORNER_M = 1e-6
OBEYED_IN = frozenset({FlightMode.HOLD, FlightMode.OFFBOARD, FlightMode.TAKEOFF, FlightMode.LAND})
"""Modes in which a vehicle that is provably this service's obeys an operator's order, whoever chose
the mode. In the others somebody else has it: a pilot's sticks, a mission, PX4's own way home."""
_LOG = logging.getLogger("autonomy")
_UP = OFFBOARD_STATES | {MissionState.TAKEOFF}
_FLOWN = OFFBOARD_STATES | {MissionState.TAKEOFF, MissionState.LAND}
_GOES_ON = NAVIGATING_STATES - {MissionState.HOLD, MissionState.RETURN}


class Interrupted(msgspec.Struct, frozen=True):
    """A flight whose log ends before it did, flown again to its last tick."""

    path: Path
    host_boot: str
    config: Config
    route: tuple[Vector3, ...]
    last: Tick
    resumed: Resumed | None
    """Where its mission could go on; None where the log does not prove it."""
    why_not_proved: str = ""
    scenario: str = ""
    again: bool = False
    """It had been interrupted before, and gone on."""
    held_s: float | None = None
    """When the deadman asked for Hold; None where it left no mark."""
    over: bool = False
    """It was not cut off: its mission was over, and left the vehicle in the air."""


class Found(msgspec.Struct, frozen=True):
    """What is seen of the vehicle now."""

    now_s: float
    host_boot: str
    facts: VehicleFacts
    status: VehicleStatus
    position: LocalPosition | None
    config: Config
    scenario: str = ""


class HoldMark(msgspec.Struct, frozen=True):
    """A flight's deadman asked for Hold at `asked_s`, on the clock since `host_boot`."""

    asked_s: float
    host_boot: str


def mark_path(log: Path) -> Path:
    """Where the mark of a flight lies: beside its log."""
    return log.with_name(log.name + _MARK_SUFFIX)


def leave_mark(log: Path, mark: HoldMark) -> None:
    """Write `mark` for the flight of `log`; returns at once, since a disk may hang as well."""
    args = (mark_path(log), msgspec.json.encode(mark))
    threading.Thread(target=_write_mark, args=args, name="hold-mark", daemon=True).start()


def _write_mark(path: Path, encoded: bytes) -> None:
    try:
        path.write_bytes(encoded)
    except OSError as error:
        _LOG.warning("%s: cannot be written (%s)", path, error.strerror)


def read_mark(log: Path) -> HoldMark | None:
    """The mark beside `log`; None where there is none that can be read."""
    try:
        with mark_path(log).open("rb") as file:
            return msgspec.json.decode(file.read(_MARK_BYTES_MAX), type=HoldMark)
    except (OSError, msgspec.DecodeError):
        return None


def last_flight(folder: Path) -> Interrupted | None:
    """The newest log in `folder`, when it was cut off, or ended, in flight; None when it was not.

    A log without a tick is a life that ended before it did anything: the one before counts then,
    and has been tried already. Takes as long as flying it again: a few seconds for ten minutes.
    Raises NotReplayable when it cannot be read.
    """
    logs = logs_in(folder)
    unread: NotReplayable | None = None
    for path in reversed(logs):
        try:
            flies = _has_ticks(path)
        except NotReplayable as error:
            unread = unread or error
            continue
        if flies:
            flight = _interrupted(FlightLog.open(path))
            if flight is None:
                break
            return msgspec.structs.replace(flight, again=flight.again or path is not logs[-1])
    if unread is not None:
        raise unread
    return None


def _has_ticks(path: Path) -> bool:
    """False for a log that was cut off before its first tick; raises NotReplayable for no log."""
    if path.stat().st_size == 0:
        return False
    return next(iter(FlightLog.open(path)), None) is not None


def _interrupted(log: FlightLog) -> Interrupted | None:
    """The flight of a log with ticks; None when it ended on the ground or in a pilot's hands."""
    config, route, resumed = recorded_config(log), log.route(), log.resumed()
    guarded = GuardedPilot(config, route, resumed)
    last: Tick | None = None
    why = ""
    ticks, flown = 0, False
    for tick in log:
        if not why:
            why = _difference(tick, ticks, guarded)
        ticks, last = ticks + 1, tick
        flown = flown or tick.command.decision.state in _UP
    if last is None:
        return None
    outcome = last.command.decision.outcome
    if outcome is not None:
        if not (flown and _left_flying(last.inputs.status, outcome)):
            return None
        why = "it was over"
    mark = read_mark(log.path)
    held = mark is not None and mark.host_boot == log.header.host_boot
    return Interrupted(
        path=log.path,
        host_boot=log.header.host_boot,
        config=config,
        route=route,
        last=last,
        resumed=guarded.pilot.resumed() if not why else None,
        why_not_proved=why,
        scenario=log.header.scenario,
        again=resumed is not None,
        held_s=mark.asked_s if mark is not None and held else None,
        over=outcome is not None,
    )


def _left_flying(status: VehicleStatus, outcome: Outcome) -> bool:
    """True where a mission ended in the air, and no pilot had taken the vehicle."""
    taken = outcome.ending is Ending.TAKEN_OVER and not status.in_failsafe
    return is_in_the_air(status) and not taken


def _difference(tick: Tick, expected: int, guarded: GuardedPilot) -> str:
    """Why this tick does not prove the flight; empty when it does."""
    if tick.index != expected:
        return f"ticks {expected} to {tick.index - 1} are missing from its log"
    difference = compare(tick.command, guarded.step(tick.inputs))
    return f"its log does not fly again as it was flown ({difference})" if difference else ""


def is_in_the_air(status: VehicleStatus) -> bool:
    """True for a vehicle that is armed and off the ground."""
    return status.armed and status.landed is not LandedState.ON_GROUND


def why_not_ours(flight: Interrupted | None, found: Found) -> str | None:
    """Why the vehicle in the air is not known to be the interrupted flight's; None when it is."""
    if flight is None:
        return "no flight of this service was interrupted"
    inputs, state = flight.last.inputs, flight.last.command.decision.state
    age_s = found.now_s - inputs.now_s
    if not found.host_boot or flight.host_boot != found.host_boot:
        return "this computer was started anew since the last flight"
    if not -_CLOCK_LATE_S <= age_s <= (HOVERS_S if flight.over else YOUNG_S):
        return f"the last flight {'ended' if flight.over else 'was interrupted'} {age_s:.0f} s ago"
    if state not in _FLOWN and not flight.over:
        return f"the last flight was interrupted on the ground ({state.value})"
    if flight.config.vehicle.connection != found.config.vehicle.connection:
        return f"the last flight was on {flight.config.vehicle.connection}"
    if flight.scenario != found.scenario:
        return f"the last flight was in another world ({flight.scenario or 'the real one'})"
    why = why_another(inputs.facts, inputs.now_s, found.facts, found.now_s)
    if why is None and flight.over:
        # Time enough to be landed, and flown elsewhere by somebody else.
        return _why_elsewhere(flight, found)
    return why


def why_another(
    then: VehicleFacts | None, then_s: float, now: VehicleFacts, now_s: float
) -> str | None:
    """Why the autopilot that answers `now` is not known to be the one that was heard `then`."""
    if then is None or then.system_id != now.system_id:
        return "the last flight was with another vehicle"
    if now.booted_s is None or then.booted_s is None:
        return "the autopilot does not tell when it started"
    if now.booted_s > then_s:
        return "the autopilot was started anew since the last flight"
    apart_s = abs(now.booted_s - then.booted_s)
    if not apart_s <= _BOOT_APART_S + _CLOCK_DRIFT * (now_s - now.booted_s):
        return f"the autopilot started {apart_s:.0f} s apart from the one that was flown"
    return None


def why_not_held_for_us(flight: Interrupted, found: Found) -> str | None:
    """Why PX4 does not wait for this service in Hold; None when it does.

    Its own failsafe holds it, or this flight's deadman asked for Hold and it is still there.
    """
    status = found.status
    if status.mode is not FlightMode.HOLD:
        return f"it is in {status.mode.value}, which PX4 or a pilot chose"
    if status.in_failsafe:
        return None
    if flight.over:
        return "its mission was over, and a pilot may have put it into Hold since"
    held_s = flight.held_s
    if held_s is None or not flight.last.inputs.now_s <= held_s <= found.now_s:
        return "a pilot or another program put it into Hold"
    return _why_elsewhere(flight, found)


def _why_elsewhere(flight: Interrupted, found: Found) -> str | None:
    """Why the vehicle is not known to be where it was interrupted."""
    then, now = flight.last.inputs.local_position, found.position
    if then is None or now is None:
        return "there is no position"
    if not (then.resets_told and now.resets_told):
        return "PX4 does not tell resets of its estimator (ODOMETRY does): its frame may be another"
    if then.reset_counter != now.reset_counter:
        return "PX4's estimator was reset since: its frame may be another"
    moved_m = norm(subtract(now.position_ned_m, then.position_ned_m))
    if not math.isfinite(moved_m) or moved_m > MOVED_M:
        return f"the vehicle is {moved_m:.1f} m from where it was interrupted"
    return None


def why_not_resumed(flight: Interrupted, found: Found) -> str | None:
    """Why the interrupted mission must not go on; None when it may."""
    state = flight.last.command.decision.state
    if flight.again:
        return "it has gone on once already, and was interrupted again"
    if flight.held_s is not None:
        return "its control loop stood still, and may again"
    if flight.resumed is None:
        return flight.why_not_proved or "it was interrupted before it was armed"
    if state not in _GOES_ON:
        return f"it was interrupted in {state.value}"
    section = changed_section(flight.config, found.config)
    if section is not None:
        return f"it was flown with another configuration ({section})"
    return _why_elsewhere(flight, found)


def changed_section(then: Config, now: Config) -> str | None:
    """The section of the configuration that must not change under a mission, and did.

    `then` is a mission's and `now` the service's: virtual beams' world is laid over it, and the
    fence may lie elsewhere, since a mission's frame begins where it was armed.
    """
    virtual = now.beams.virtual()
    if virtual is not None:
        now, _ = with_virtual_world(now, virtual)
    if not _same_shape(then.guard.fence, now.guard.fence):
        return "guard.fence"
    guard = then.guard.model_copy(update={"fence": now.guard.fence})
    pairs = {
        "guard": (guard, now.guard),
        "beams": (then.beams, now.beams),
        "body": (then.body, now.body),
        "failsafe": (then.failsafe, now.failsafe),
    }
    return next((name for name, (a, b) in pairs.items() if a.model_dump() != b.model_dump()), None)


def _same_shape(one: Fence, other: Fence) -> bool:
    a, b = one.outline_ne_m, other.outline_ne_m
    if len(a) != len(b):
        return False
    north, east = b[0][0] - a[0][0], b[0][1] - a[0][1]
    return all(
        math.hypot(q[0] - p[0] - north, q[1] - p[1] - east) <= _SAME_CORNER_M
        for p, q in zip(a, b, strict=True)
    )


def read_last_flight(folder: Path) -> tuple[Interrupted | None, str]:
    """`last_flight`, and a sentence instead of an error."""
    try:
        return last_flight(folder), ""
    except (NotReplayable, AutonomyError, HalError, OSError, AssertionError, ValueError) as error:
        return None, f"its last log cannot be used: {error}"
