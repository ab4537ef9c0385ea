"""What was asked of a flight, and what became of it: the two records at the ends of `app.fly`."""

from typing import TYPE_CHECKING

import msgspec

from autonomy.errors import ExitCode
from autonomy.geometry import Point
from autonomy.mission.flown import FlownLeg, by_radius
from autonomy.model import (
    SOURCES,
    Ending,
    FilterHealth,
    WallFixReport,
)
from autonomy.t3drm.bound import PathBound
from autonomy.t3drm.timing import TimingRecord
from hal.frames import Vector3

if TYPE_CHECKING:
    from rich.table import Table

EXIT_CODES: dict[Ending, ExitCode] = {
    Ending.GOAL_REACHED: ExitCode.GOAL_REACHED,
    Ending.UNREACHABLE: ExitCode.UNREACHABLE,
    Ending.ABORTED: ExitCode.ABORTED,
    Ending.PREFLIGHT_REFUSED: ExitCode.PREFLIGHT_REFUSED,
    Ending.OFFBOARD_REFUSED: ExitCode.OFFBOARD_REFUSED,
    Ending.LINK_LOST: ExitCode.LINK_LOST,
    Ending.FAILSAFE: ExitCode.FAILSAFE,
    Ending.BUDGET: ExitCode.BUDGET,
    Ending.TAKEN_OVER: ExitCode.TAKEN_OVER,
    Ending.INTERNAL: ExitCode.INTERNAL,
}


class FlyOptions(msgspec.Struct, frozen=True):
    """`autonomy fly` as it was typed. Exactly one of `scenario` and `connection` is given.

    `goals` are as typed, in `frame`; a goal without a third coordinate has None there.
    """

    goals: tuple[tuple[float, float, float | None], ...]
    frame: str = "ned"
    altitude_m: float | None = None
    land: bool | None = None
    scenario: str | None = None
    connection: str | None = None
    config_path: str | None = None
    seed: int = 0
    output: str = "auto"
    log_dir: str | None = None
    log: bool = True
    time_limit_s: float | None = None
    mode: str | None = None
    beams: str | None = None
    """Instead of the configured range sensors: `virtual:SCENARIO`."""
    send_beams: bool = False
    faults: tuple[str, ...] = ()
    """What is to go wrong in the simulation, as `hal.sim.fault_kinds.parse_fault` reads it."""


class FlightReport(msgspec.Struct, frozen=True):
    """What a flight was. Lengths in metres, times in seconds.

    `minimum_clearance_m` is from the vehicle's centre to the nearest surface: the true one from
    the simulated world when `clearance_is_true`, else the nearest mapped hit. `collisions` is how
    often the body began to touch something, None where nobody knows. With
    `clearance_by_reported_pose` both are those of a virtual room, seen from where the autopilot
    believed to be.
    `timing` is Algorithm 1's record: the computing time of each replan.
    """

    ending: Ending
    why: str
    exit_code: int
    route_ned_m: tuple[Vector3, ...]
    flight_time_s: float = 0.0
    path_length_m: float = 0.0
    straight_length_m: float = 0.0
    stops: int = 0
    replans: int = 0
    minimum_clearance_m: float | None = None
    clearance_is_true: bool = False
    clearance_by_reported_pose: bool = False
    collisions: int | None = None
    body_radius_m: float = 0.15
    max_speed_m_s: float = 0.0
    timing: TimingRecord | None = None
    path_bound: PathBound | None = None
    """What TangentBug's bound allows for the obstacles met; None: nothing was planned."""
    side_changes: int = 0
    """Replans that passed a known obstacle on its other side."""
    legs: tuple[FlownLeg, ...] = ()
    """The legs in the order flown, each with its keep-out radius (Eq. 2)."""
    leg_kinds: tuple[str, ...] = ()
    """The kinds of legs that were planned, in the order of their first use."""
    heights_m: tuple[float, ...] = ()
    """Heights above the take-off point of the stretches of way, in the order flown."""
    guard_limits: dict[str, int] = msgspec.field(default_factory=dict)
    """How many ticks each rule of the guard changed the setpoint."""
    estimator: FilterHealth | None = None
    """How the position filter had got on by the end."""
    walls: WallFixReport | None = None
    """How the drift of the autopilot's frame stood at the end; None: it was not looked at."""
    wall_offset_max_m: float = 0.0
    """The most that the drift was."""
    origin_ne_m: Point = (0.0, 0.0)
    """Where the take-off point, about which `route_ned_m` is, lies in the frame of the service that
    flew it: what its page shows. (0, 0) without a service."""
    path_to_goal_m: float | None = None
    """Of the path, what was flown before a return began; None in reports that do not know."""
    late_ticks: int = 0
    events: tuple[tuple[float, str, str], ...] = ()
    log_path: str | None = None
    log_notes: tuple[str, ...] = ()
    seed: int | None = None
    scenario: str | None = None


def with_truth(
    report: FlightReport,
    least_m: float | None,
    collisions: int | None = None,
    *,
    by_reported_pose: bool = False,
) -> FlightReport:
    """The report with the clearance that a simulated world knows; touching is never success.

    `least_m` None: it never flew, or nothing was there.
    """
    if least_m is None and not by_reported_pose:
        return report
    touched = bool(collisions) or (least_m is not None and least_m <= report.body_radius_m)
    if touched and report.ending is Ending.GOAL_REACHED:
        where = f"{least_m:.3f} m from its centre" if least_m is not None else "from below or above"
        report = msgspec.structs.replace(
            report,
            ending=Ending.INTERNAL,
            exit_code=int(EXIT_CODES[Ending.INTERNAL]),
            why=f"the vehicle touched an obstacle ({where})",
        )
    return msgspec.structs.replace(
        report,
        minimum_clearance_m=least_m,
        clearance_is_true=True,
        clearance_by_reported_pose=by_reported_pose,
        collisions=collisions,
    )


def report_table(report: FlightReport) -> "Table":
    """The report for people, as a rich table of two columns."""
    from rich.table import Table
    from rich.text import Text

    good = report.ending is Ending.GOAL_REACHED
    table = Table.grid(padding=(0, 2))
    table.add_column(style="dim", no_wrap=True)
    table.add_column()
    title = report.ending.value.replace("_", " ").capitalize()
    table.add_row("", Text(title, style="bold green" if good else "bold red"))
    for name, value in report_rows(report):
        table.add_row(name, Text(value))
    return table


def frame_words(origin_ne_m: Point) -> str:
    """The frame in which positions of a flight are told to people, as its page showed them."""
    if origin_ne_m == (0.0, 0.0):
        return "about the take-off point"
    north, east = origin_ne_m
    return f"in the service's frame, where it took off at ({north:.2f}, {east:.2f}) m"


def report_rows(report: FlightReport) -> list[tuple[str, str]]:
    """(name, value) of everything that was measured."""
    origin = report.origin_ne_m
    goals = [
        f"({round(north + origin[0], 3):g}, {round(east + origin[1], 3):g}, {down:g})"
        for north, east, down in report.route_ned_m
    ]
    rows = [
        ("", report.why),
        ("goal, NED", f"{' -> '.join(goals)} m, {frame_words(origin)}"),
        ("flight time", f"{report.flight_time_s:.1f} s"),
        ("path flown", _path(report)),
        ("clearance", _clearance(report)),
        *((("collisions", str(report.collisions)),) if report.collisions is not None else ()),
        ("top speed", f"{report.max_speed_m_s:.2f} m/s"),
        ("stops, replans", f"{report.stops}, {report.replans}"),
        ("side changes", str(report.side_changes)),
    ]
    if report.timing is not None and report.timing.replans:
        rows.append(("planning time", _planning(report.timing)))
    if report.path_bound is not None and report.path_bound.stretches:
        way_m = report.path_to_goal_m
        way_m = report.path_length_m if way_m is None else way_m
        rows.append(("path bound", _bound(report.path_bound, way_m)))
    if report.leg_kinds:
        rows.append(("legs", ", ".join(report.leg_kinds)))
    if report.legs:
        rows.append(("keep-out radii", _radii(report.legs)))
    if len(report.heights_m) > 1:
        rows.append(("heights", " -> ".join(f"{h:.2f}" for h in report.heights_m) + " m"))
    if report.guard_limits:
        limits = ", ".join(f"{name} {ticks}" for name, ticks in sorted(report.guard_limits.items()))
        rows.append(("guard, ticks", limits))
    if report.estimator is not None:
        rows.append(("estimator", _estimator(report.estimator)))
    if report.walls is not None and report.walls.fused:
        rows.append(("drift by walls", _drift(report.walls, report.wall_offset_max_m)))
    if report.late_ticks:
        rows.append(("late ticks", str(report.late_ticks)))
    if report.scenario is not None:
        rows.append(("scenario", f"{report.scenario}, seed {report.seed}"))
    if report.log_path is not None:
        rows.append(("flight log", report.log_path))
    rows.extend(("", note) for note in report.log_notes)
    return rows


def _drift(walls: WallFixReport, most_m: float) -> str:
    north_m, east_m = walls.offset_ne_m
    text = (
        f"{north_m:+.2f} m north, {east_m:+.2f} m east at the end, {most_m:.2f} m at most; "
        f"{walls.fused} rays fused, {walls.rejected} rejected"
    )
    return text + (f", {walls.forgotten} cells forgotten" if walls.forgotten else "")


def _path(report: FlightReport) -> str:
    text = f"{report.path_length_m:.2f} m"
    if report.straight_length_m > 0.0:
        ratio = report.path_length_m / report.straight_length_m
        text += f", {ratio:.2f} times the straight {report.straight_length_m:.2f} m"
    return text


def _bound(bound: PathBound, path_length_m: float) -> str:
    kept = "kept" if bound.holds(path_length_m) else "NOT KEPT"
    return (
        f"{bound.bound_m:.2f} m, {kept}: {bound.straight_m:.2f} m straight and "
        f"{bound.perimeter_m:.2f} m round what was met (TangentBug)"
    )


def _radii(legs: tuple[FlownLeg, ...]) -> str:
    """How far at which radius of the Ricci flow."""
    return ", ".join(
        f"{flown_m:.2f} m at {radius_m:.3f} m" for radius_m, flown_m in by_radius(legs)
    )


def _clearance(report: FlightReport) -> str:
    if report.minimum_clearance_m is None:
        return "nothing was near"
    kind = "true" if report.clearance_is_true else "as mapped"
    if report.clearance_by_reported_pose:
        kind = "to the virtual room, by the reported pose"
    skin_m = report.minimum_clearance_m - report.body_radius_m
    return (
        f"{report.minimum_clearance_m:.3f} m at least, from the centre ({kind}); "
        f"{skin_m:.3f} m from the body"
    )


def _estimator(health: FilterHealth) -> str:
    """What was fused and rejected; what else is out of the ordinary."""
    sources = [(name, getattr(health, name)) for name in SOURCES]
    words = [
        f"{name} {each.fused} fused, {each.rejected} rejected"
        for name, each in sources
        if each.fused or each.rejected
    ]
    if health.gnss_apart_m is not None:
        words.append(f"GNSS {health.gnss_apart_m:.1f} m apart from the autopilot")
    if health.frame_jumps:
        words.append(f"frame jumps {health.frame_jumps}")
    if health.restarts:
        words.append(f"filter restarts {health.restarts}")
    return "; ".join(words) if words else "heard nothing"


def _planning(timing: TimingRecord) -> str:
    """Algorithm 1's totals, and the last radius of Eq. 8 or 9."""
    ordered = sorted(replan.seconds for replan in timing.replans)
    text = (
        f"{timing.total_s * 1e3:.1f} ms in {len(ordered)} plans, least {ordered[0] * 1e3:.2f}, "
        f"median {ordered[len(ordered) // 2] * 1e3:.2f}, longest {ordered[-1] * 1e3:.2f} ms"
    )
    if timing.flight_s is not None:
        text += f"; completed {timing.flight_s:.1f} s after the start"
    radii = [replan.radius_m for replan in timing.replans if replan.radius_m is not None]
    return text + (f"; Eq. 8/9 radius {radii[-1]:.3f} m" if radii else "")
