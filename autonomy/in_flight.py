"""A service that begins anew and finds its vehicle in the air: whose it is, and what may be done.

Its last log tells what was flown: a log without an outcome is a flight that was cut off. The
vehicle is believed to be that flight's only where everything agrees: this computer was not started
anew since, the log's last tick is young, it is the same autopilot, not restarted either. The
mission may go on only in the same frame: no estimator reset since, the vehicle where it was, and a
log that flown again gives every decision bit for bit.
"""

import math
from pathlib import Path

import msgspec

from autonomy.config import Config
from autonomy.errors import AutonomyError, NotReplayable
from autonomy.flightlog.reader import FlightLog, compare
from autonomy.flightlog.schema import Tick
from autonomy.logbook import recorded_config
from autonomy.mission.guarded import GuardedPilot
from autonomy.mission.machine import NAVIGATING_STATES, OFFBOARD_STATES
from autonomy.model import MissionState, Resumed
from hal.errors import HalError
from hal.frames import Vector3, norm, subtract
from hal.readings import FlightMode, LandedState, LocalPosition, VehicleFacts, VehicleStatus

YOUNG_S = 120.0
"""A log that ended longer ago says nothing about a vehicle in the air."""
MOVED_M = 1.0
"""A vehicle that PX4 holds since the program died is not farther from where it was."""
_CLOCK_LATE_S = 1.0
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


class Found(msgspec.Struct, frozen=True):
    """What is seen of the vehicle now."""

    now_s: float
    host_boot: str
    facts: VehicleFacts
    status: VehicleStatus
    position: LocalPosition | None


def last_flight(folder: Path) -> Interrupted | None:
    """The newest log in `folder`, when it was cut off in flight; None when it was not.

    Takes as long as flying it again: a few seconds for ten minutes. Raises NotReplayable when it
    cannot be read.
    """
    logs = sorted(folder.glob("*.mcap"), key=lambda path: (path.stat().st_mtime_ns, path.name))
    if not logs:
        return None
    log = FlightLog.open(logs[-1])
    config, route, resumed = recorded_config(log), log.route(), log.resumed()
    guarded = GuardedPilot(config, route, resumed)
    last: Tick | None = None
    why = ""
    ticks = 0
    for tick in log:
        if not why:
            why = _difference(tick, ticks, guarded)
        ticks, last = ticks + 1, tick
    if last is None or last.command.decision.outcome is not None:
        return None
    where = guarded.pilot.resumed() if not why else None
    return Interrupted(log.path, log.header.host_boot, config, route, last, where, why)


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
    then, now = inputs.facts, found.facts
    if not found.host_boot or flight.host_boot != found.host_boot:
        return "this computer was started anew since the last flight"
    if not -_CLOCK_LATE_S <= age_s <= YOUNG_S:
        return f"the last flight was interrupted {age_s:.0f} s ago"
    if state not in _FLOWN:
        return f"the last flight was interrupted on the ground ({state.value})"
    if then is None or then.system_id != now.system_id:
        return "the last flight was with another vehicle"
    if now.booted_s is None:
        return "the autopilot does not tell when it started"
    if now.booted_s > inputs.now_s:
        return "the autopilot was started anew since the last flight"
    return None


def why_not_failsafe(status: VehicleStatus) -> str | None:
    """Why PX4 does not wait for this service in its own failsafe's Hold; None when it does."""
    if status.mode is not FlightMode.HOLD:
        return f"it is in {status.mode.value}, which PX4 or a pilot chose"
    if not status.in_failsafe:
        return "a pilot or another program put it into Hold"
    return None


def why_not_resumed(flight: Interrupted, found: Found) -> str | None:
    """Why the interrupted mission must not go on; None when it may."""
    then, now = flight.last.inputs.local_position, found.position
    state = flight.last.command.decision.state
    if flight.resumed is None:
        return flight.why_not_proved or "it was interrupted before it was armed"
    if state not in _GOES_ON:
        return f"it was interrupted in {state.value}"
    if then is None or now is None:
        return "there is no position"
    if then.reset_counter != now.reset_counter:
        return "PX4's estimator was reset since: its frame may be another"
    moved_m = norm(subtract(now.position_ned_m, then.position_ned_m))
    if not math.isfinite(moved_m) or moved_m > MOVED_M:
        return f"the vehicle is {moved_m:.1f} m from where it was interrupted"
    return None


def read_last_flight(folder: Path) -> tuple[Interrupted | None, str]:
    """`last_flight`, and a sentence instead of an error."""
    try:
        return last_flight(folder), ""
    except (NotReplayable, AutonomyError, HalError, OSError, AssertionError, ValueError) as error:
        return None, f"its last log cannot be used: {error}"
