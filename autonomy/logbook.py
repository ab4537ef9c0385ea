"""A recorded flight, after it: flown again, and summed up."""

import json
from pathlib import Path

from autonomy.config import Config
from autonomy.errors import NotReplayable
from autonomy.flight import Tally
from autonomy.flightlog.reader import FlightLog, ReplayResult, replay
from autonomy.geometry import polyline_length
from autonomy.mission.guarded import GuardedPilot
from autonomy.model import Ending, Outcome
from autonomy.report import EXIT_CODES, FlightReport
from hal.config import validate_document


def recorded_config(log: FlightLog) -> Config:
    """The configuration that was flown; raises DocumentError when this program refuses it."""
    try:
        data = json.loads(log.header.config_json)
    except json.JSONDecodeError:
        raise NotReplayable(f"{log.path}: the recorded configuration cannot be read") from None
    return validate_document(data, Config, f"{log.path}, configuration")


def replay_log(path: Path) -> ReplayResult:
    """Fly the recorded inputs again through the same pilot and guard.

    Raises NotReplayable when the log has no route or no ticks, DocumentError when its
    configuration is refused.
    """
    log = FlightLog.open(path)
    return replay(log, GuardedPilot(recorded_config(log), log.route()).step)


def report_of_log(path: Path) -> FlightReport:
    """What the flight was, as far as it was recorded; raises NotReplayable."""
    log = FlightLog.open(path)
    config, route = recorded_config(log), log.route()
    tally = Tally()
    outcome: Outcome | None = None
    ticks = lost = 0
    for tick in log:
        lost += tick.index - ticks - lost
        ticks += 1
        tally.note(tick.command, tick.inputs, tick.step_s)
        outcome = tick.command.decision.outcome or outcome
    if ticks == 0:
        raise NotReplayable(f"{path}: holds no complete tick; there is nothing to report")
    if outcome is None:
        outcome = Outcome(Ending.INTERNAL, "the log ends before the mission did")
    notes = [] if log.damage is None else [log.damage]
    if lost:
        notes.append(f"{lost} ticks are missing from the log")
    header = log.header
    return FlightReport(
        ending=outcome.ending,
        why=outcome.why,
        exit_code=int(EXIT_CODES[outcome.ending]),
        route_ned_m=route,
        flight_time_s=tally.flight_time_s,
        path_length_m=tally.path_length_m,
        straight_length_m=polyline_length(((0.0, 0.0), *((goal[0], goal[1]) for goal in route))),
        stops=tally.stops,
        replans=tally.replans,
        minimum_clearance_m=tally.minimum_clearance_m,
        body_radius_m=config.body.radius_m,
        max_speed_m_s=tally.max_speed_m_s,
        timing=tally.planning.record(),
        leg_kinds=tuple(tally.leg_kinds),
        guard_limits=dict(tally.guard_limits),
        events=tuple((event.stamp_s, event.name, event.why) for event in tally.events),
        log_path=str(path),
        log_notes=tuple(notes),
        seed=header.seed,
        scenario=header.scenario or None,
    )
