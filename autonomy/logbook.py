"""A recorded flight, after it: flown again, and summed up."""

import json
from collections.abc import Iterator
from pathlib import Path

import msgspec

from autonomy import pictures
from autonomy.config import Config
from autonomy.errors import NotReplayable
from autonomy.flightlog.reader import FlightLog, ReplayResult, compare, replay
from autonomy.flightlog.schema import Tick
from autonomy.geometry import Point, moved
from autonomy.mission.guarded import GuardedPilot
from autonomy.model import Ending, Outcome, Plan
from autonomy.report import FlightReport, with_truth
from autonomy.service.logs import report_path
from autonomy.tally import Tally
from hal.config import Fence
from hal.documents import validate_document
from hal.sim.scenario import load_scenario


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
    return replay(log, GuardedPilot(recorded_config(log), log.route(), log.resumed()).step)


def flown_again(log: FlightLog, guarded: GuardedPilot) -> Iterator[tuple[Tick, str | None]]:
    """Every tick of the log once `guarded` has flown it, and where the two first differed so far.

    A replay stops at the first difference, or gap; this goes on, for what only wants to look.
    """
    difference: str | None = None
    index = -1
    for tick in log:
        if tick.index != index + 1 and difference is None:
            difference = f"ticks {index + 1} to {tick.index - 1} are missing"
        index = tick.index
        again = guarded.step(tick.inputs)
        if difference is None:
            found = compare(tick.command, again)
            difference = f"tick {index}: {found}" if found is not None else None
        yield tick, difference


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
    report = tally.report(
        outcome,
        route,
        config=config,
        log_path=str(path),
        log_notes=notes,
        scenario=log.header.scenario or None,
        seed=log.header.seed,
        origin_ne_m=log.offset_ne_m(),
    )
    kept = _kept_report(path)
    if kept is None or not kept.clearance_is_true:
        return report
    return with_truth(
        report,
        kept.minimum_clearance_m,
        kept.collisions,
        by_reported_pose=kept.clearance_by_reported_pose,
    )


def _kept_report(log: Path) -> FlightReport | None:
    """The report that was written beside the log after the flight; None: there is none."""
    try:
        return msgspec.json.decode(report_path(log).read_bytes(), type=FlightReport)
    except (OSError, msgspec.MsgspecError):
        return None


def draw_log(path: Path, out: Path) -> None:
    """Draw the flight recorded at `path` into a PNG: over its scenario where there was one.

    The map is not in the log: the inputs are flown again, and the maps that the pilot had at the
    end are drawn, of whatever height, in the frame of the service that flew it. Raises
    NotReplayable, DocumentError, BadInput as its parts do.
    """
    log = FlightLog.open(path)
    config, route = recorded_config(log), log.route()
    guarded = GuardedPilot(config, route, log.resumed())
    tally = Tally()
    legs: list[tuple[str, tuple[Point, ...]]] = []
    stops: list[Point] = []
    for tick in log:
        tally.note(tick.command, tick.inputs, tick.step_s)
        guarded.step(tick.inputs)
        decision = tick.command.decision
        if isinstance(decision.plan, Plan):
            legs.extend((leg.kind.value, leg.points) for leg in decision.plan.legs)
        if decision.fused is not None and any(e.name == "stop" for e in decision.events):
            stops.append(decision.fused.point)
    hits = [(north, east) for north, east in guarded.pilot.sensing.maps.all_hits().tolist()]
    wanted_m = {-goal[2] for goal in route}
    origin = log.offset_ne_m()
    elsewhere = [
        (height_m, list(moved(track, origin)))
        for height_m, track in tally.stretches
        if height_m not in wanted_m
    ]
    fence = config.guard.fence
    if origin != (0.0, 0.0):
        fence = Fence(polygon_ne_m=moved(fence.outline_ne_m, origin))
    scenario = load_scenario(log.header.scenario) if log.header.scenario else None
    pictures.save_flight(
        out,
        scenario=scenario,
        fence=fence,
        flown=moved(tally.track, origin),
        legs=[(kind, moved(points, origin)) for kind, points in legs],
        hits=moved(hits, origin),
        stops=moved(stops, origin),
        goal=moved([(route[-1][0], route[-1][1])], origin)[0],
        heights=elsewhere,
        title=f"{tally.path_length_m:.2f} m in {tally.flight_time_s:.0f} s, {tally.stops} stops",
    )
