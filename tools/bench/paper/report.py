"""The tables and the picture of the paper's experiments, beside what the paper prints."""

import statistics
from collections.abc import Callable, Sequence
from pathlib import Path

from autonomy.pictures import BLUE, GREEN, ORANGE, PURPLE, SKY, VERMILION, draw_scenario
from tools.bench.paper.compared import PLANNERS, T3DRM, Trial, length_m, seconds
from tools.bench.paper.flights import IDEAL, MAVSDK, SCENARIOS, SIMULATED, Row, scenario_of
from tools.bench.paper.printed import (
    ANTS,
    COMPARED,
    FIELD,
    FLOWN,
    SPEED_M_S,
    Flown,
    deviation,
    saved,
)

REACHED = "goal_reached"
_COLOURS = {T3DRM: BLUE, FIELD: VERMILION, ANTS: ORANGE}


def flown_table(rows: Sequence[Row]) -> str:
    """Tables 4 and 5: the ideal simulation against the flights, next to the paper's."""
    lines = [
        (
            "| scenario | flown by | flights, goal reached | length m, mean (std) | of the ideal "
            "| time s, mean (std) | of the ideal | least clearance m |"
        ),
        f"|{'---|' * 8}",
    ]
    for paper in FLOWN:
        lines += _paper_lines(paper)
        for mode in dict.fromkeys(row.case.mode for row in rows):
            for how in (IDEAL, SIMULATED, MAVSDK):
                mine = _of(rows, paper.scenario, mode, how)
                if mine:
                    lines.append(_flown_line(mine, _of(rows, paper.scenario, mode, IDEAL)))
    return "\n".join(lines)


def _paper_lines(paper: Flown) -> list[str]:
    first = f"| {paper.scenario} | the paper: simulation | | {paper.simulated_m:.2f} | "
    length, time = (
        deviation(paper.simulated_m, paper.flown_m),
        deviation(paper.simulated_s, paper.flown_s),
    )
    return [
        f"{first}| {paper.simulated_s:.1f} | | |",
        (
            f"| {paper.scenario} | the paper: flight | | {paper.flown_m:.2f} | {length:+.2%} "
            f"| {paper.flown_s:.1f} | {time:+.2%} | |"
        ),
    ]


def _of(rows: Sequence[Row], scenario: int, mode: str, how: str) -> list[Row]:
    return [
        row
        for row in rows
        if (row.case.scenario, row.case.mode, row.case.how) == (scenario, mode, how)
    ]


def _flown_line(mine: Sequence[Row], ideal: Sequence[Row]) -> str:
    case = mine[0].case
    good = [row for row in mine if row.ending == REACHED]
    told = {
        IDEAL: "ideal simulation",
        SIMULATED: "measured response and noise, in process",
        MAVSDK: "flight over MAVSDK and the mock PX4",
    }[case.how]
    clearances = [row.clearance_m for row in mine if row.clearance_m is not None]
    least = f"{min(clearances):.2f}" if clearances else ""
    head = f"| {case.scenario} | {case.mode}: {told} | {len(good)} of {len(mine)} | "
    if not good:
        return f"{head}| | | | {least} |"
    return (
        f"{head}{_mean(good, _length, 2)} "
        f"| {_off(good, ideal, _length)} "
        f"| {_mean(good, _time, 1)} "
        f"| {_off(good, ideal, _time)} | {least} |"
    )


def _mean(rows: Sequence[Row], value: Callable[[Row], float], digits: int) -> str:
    values = [value(row) for row in rows]
    if len(values) < 2:
        return f"{values[0]:.{digits}f}"
    return f"{statistics.mean(values):.{digits}f} ({statistics.stdev(values):.{digits}f})"


def _off(rows: Sequence[Row], ideal: Sequence[Row], value: Callable[[Row], float]) -> str:
    """How far the mean is from the ideal flight, of the mean (as the paper calculates)."""
    if not ideal or rows[0].case.how == IDEAL:
        return ""
    mean, best = statistics.mean(value(row) for row in rows), value(ideal[0])
    return f"{(mean - best) / mean:+.2%}"


def compared_table(trials: Sequence[Trial]) -> str:
    """Tables 6 and 7: lengths, times at the paper's speed, computing times, and what is saved."""
    lines = [
        (
            "| scenario | planner | length m | of the straight line | T3DRM saves | paper's ratio "
            f"| T3DRM saves, paper | time at {SPEED_M_S:g} m/s, s | paper's time s "
            "| computing ms, p50 |"
        ),
        f"|{'---|' * 10}",
    ]
    for paper in COMPARED:
        straight_m = paper.straight * paper.unit_m
        own_m = length_m(trials, paper.scenario, T3DRM)
        for planner in PLANNERS:
            mine_m = length_m(trials, paper.scenario, planner)
            ms = 1e3 * seconds(trials, paper.scenario, planner)
            printed = {T3DRM: paper.t3drm, paper.other: paper.others}.get(planner)
            printed_s = {T3DRM: paper.t3drm_s, paper.other: paper.others_s}.get(planner)
            gain = "" if planner == T3DRM else _gain(own_m, mine_m)
            told = f"{saved(paper.t3drm, paper.others):.2%}" if planner == paper.other else ""
            lines.append(
                f"| {paper.scenario} | {planner} | {_number(mine_m, 3)} "
                f"| {_number(mine_m and mine_m / straight_m, 3)} | {gain} "
                f"| {_number(printed and printed / paper.straight, 3)} | {told} "
                f"| {_number(mine_m and mine_m / SPEED_M_S, 1)} | {_number(printed_s, 2)} "
                f"| {ms:.2f} |"
            )
    return "\n".join(lines)


def _number(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}f}"


def _gain(own_m: float | None, other_m: float | None) -> str:
    if own_m is None:
        return "T3DRM found no way"
    return "no way found" if other_m is None else f"{saved(own_m, other_m):+.2%}"


def in_short(rows: Sequence[Row], trials: Sequence[Trial]) -> str:
    """The five scenarios, a line each, beside what the paper says of them."""
    lines = ["| scenario | what | here | the paper |", f"|{'---|' * 4}"]
    for flown in FLOWN:
        printed = (
            f"{deviation(flown.simulated_m, flown.flown_m):+.1%}, "
            f"{deviation(flown.simulated_s, flown.flown_s):+.1%}"
        )
        for mode in dict.fromkeys(row.case.mode for row in rows):
            ideal = _of(rows, flown.scenario, mode, IDEAL)
            good = [r for r in _of(rows, flown.scenario, mode, MAVSDK) if r.ending == REACHED]
            if good and ideal:
                here = f"{_off(good, ideal, _length)}, {_off(good, ideal, _time)}"
                what = f"{mode}: flight over MAVSDK off its ideal simulation, length, time"
                lines.append(f"| {flown.scenario} | {what} ({len(good)}) | {here} | {printed} |")
    for paper in COMPARED:
        own_m = length_m(trials, paper.scenario, T3DRM)
        gain = _gain(own_m, length_m(trials, paper.scenario, paper.other))
        told = f"{saved(paper.t3drm, paper.others):+.1%}"
        lines.append(f"| {paper.scenario} | length saved against {paper.other} | {gain} | {told} |")
    return "\n".join(lines)


def _length(row: Row) -> float:
    return row.length_m


def _time(row: Row) -> float:
    return row.navigation_s


def draw(path: Path, rows: Sequence[Row], trials: Sequence[Trial]) -> None:
    """The five reconstructions: flights in 1 and 2, planned ways in all."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(16.0, 4.4), layout="constrained")
    for ax, number in zip(figure.subplots(1, len(SCENARIOS)), SCENARIOS, strict=True):
        draw_scenario(ax, scenario_of(number), legend=False)
        ax.set_title(f"scenario {number} (reconstruction)", fontsize=9)
        if number in (flown.scenario for flown in FLOWN):
            _draw_rows(ax, [row for row in rows if row.case.scenario == number])
        else:
            _draw_trials(ax, [t for t in trials if t.scenario == number and t.trial == 0])
        if ax.lines:
            place = {"loc": "upper center", "bbox_to_anchor": (0.5, -0.16), "ncols": 2}
            ax.legend(*ax.get_legend_handles_labels(), fontsize=6, frameon=False, **place)
    figure.savefig(path, dpi=90)


def _draw_rows(ax: object, rows: Sequence[Row]) -> None:
    styles = {
        (IDEAL, "stop"): (BLUE, "-"),
        (SIMULATED, "stop"): (VERMILION, "--"),
        (MAVSDK, "stop"): (GREEN, "-"),
        (MAVSDK, "rolling"): (SKY, "-"),
        (IDEAL, "rolling"): (ORANGE, "-"),
        (SIMULATED, "rolling"): (PURPLE, "--"),
    }
    for row in rows:
        style = styles.get((row.case.how, row.case.mode))
        if row.case.seed == 0 and style is not None:
            _line(ax, row.track, style[0], style[1], f"{row.case.mode}, {row.case.how}")


def _draw_trials(ax: object, trials: Sequence[Trial]) -> None:
    for trial in trials:
        if trial.path:
            style = "--" if trial.planner == ANTS else "-"
            _line(ax, trial.path, _COLOURS[trial.planner], style, trial.planner)


def _line(
    ax: object, points: Sequence[tuple[float, float]], colour: str, style: str, label: str
) -> None:
    plot = ax.plot  # type: ignore[attr-defined]  # matplotlib is untyped here
    plot([e for _, e in points], [n for n, _ in points], style, color=colour, lw=1.4, label=label)
