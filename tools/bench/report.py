"""The benchmark's page: tables from a campaign, between markers in tools/bench/README.md."""

import datetime
import math
import os
import platform
import statistics
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from autonomy import __version__
from tools import pages
from tools.bench import flights
from tools.bench.baselines.exact import ExactOptimum
from tools.bench.maps import RANDOM_FAMILIES, Family
from tools.bench.planners import (
    BUDGETS_S,
    LATERAL_M_S2,
    SPEEDS_M_S,
    WITHIN,
    Campaign,
    Growth,
    Reach,
    TangentRoute,
    Trial,
)
from tools.bench.steps import Step

HERE = Path(__file__).resolve().parent
README = HERE / "README.md"
TIGHT_M = 1.0
"""Wider bends are as good as straight at the speeds of the table."""
KINDS = ("discs", "walls", "walls and discs", "BARN")


def kind_of(family: str) -> str:
    """The group of maps that a family belongs to."""
    for name, _, discs, walls in RANDOM_FAMILIES:
        if name == family:
            return KINDS[2] if discs and walls else KINDS[0] if discs else KINDS[1]
    return KINDS[3]


def percentile(values: Sequence[float], percent: float) -> float:
    """Linear between neighbours; infinite values are values."""
    ordered = sorted(values)
    at = (len(ordered) - 1) * percent / 100.0
    low, high = ordered[math.floor(at)], ordered[math.ceil(at)]
    return low if low == high else low + (at - math.floor(at)) * (high - low)


def planner_section(measured: Campaign) -> str:
    """Everything between the markers, as Markdown."""
    present = [k for k in KINDS if any(kind_of(t.family) == k for t in measured.trials)]
    parts = [stamp(), *verdicts(measured)]
    for kind in present:
        parts.append(f"### {kind[0].upper()}{kind[1:]}")
        parts.append(race_table([t for t in measured.trials if kind_of(t.family) == kind]))
    parts += ["### Family by family", family_table(measured)]
    if measured.taken:
        parts += ["### One planning step in flight", step_table(measured.taken)]
    if measured.bends:
        parts += ["### Conics against arcs", bend_table(measured)]
    if measured.growth:
        parts += ["### More obstacles elsewhere", growth_table(measured.growth)]
    parts += [f"![{title}]({name}.png)" for name, title in pictures(measured)]
    return "\n\n".join(parts)


def pictures(measured: Campaign) -> list[tuple[str, str]]:
    """(file, title) of every picture that `draw_all` draws of the campaign itself."""
    found = [("length_time", "Length and time"), ("times", "Planning time"), ("success", "Success")]
    if any(not r.direct for r in measured.reaches):
        found.append(("head_start", "Head start over sampling planners"))
    if measured.growth:
        found.append(("growth", "Obstacles elsewhere"))
    return found


def stamp() -> str:
    """When and where."""
    today = datetime.datetime.now(tz=datetime.UTC).date().isoformat()
    load = os.getloadavg()[1]
    return (
        f"Measured {today}, version {__version__}, Python {platform.python_version()}, "
        f"{_processor()}, {os.cpu_count()} shared cores, load {load:.1f}. "
        "Times are CPU time of the thread."
    )


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        lines = []
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.machine()


def flight_section(rows: list[flights.Row]) -> str:
    """The flights' table with its date."""
    return f"{stamp()}\n\n{flights.table(rows)}"


# ---------------------------------------------------------------- who is first


def verdicts(measured: Campaign) -> list[str]:
    """The claims, computed, one bullet each."""
    own = [t for t in measured.trials if t.planner == TangentRoute.name]
    worst = max((t.ratio for t in own if t.ratio is not None), default=math.nan)
    solved = sum(t.ratio is not None for t in own)
    excess = 1e6 * (worst - 1.0)
    lines: list[str] = []
    lines.append(
        f"- T3DRM on known discs: {solved} of {len(own)} maps solved, longer than the optimum by "
        f"{excess:.1f} millionths at most (its arcs are measured as polylines)."
    )
    rivals = _as_fast(measured.trials)
    lines.append(
        "- As fast (median over all maps at most T3DRM's): "
        + (", ".join(rivals) if rivals else "nobody")
        + "."
    )
    lines += _against_budgets(measured.trials)
    barred = [r for r in measured.reaches if not r.direct]
    if barred:
        factors = [r.seconds / r.t3drm_seconds for r in _best_of_each_map(barred)]
        lines.append(
            "- CPU time until the quicker of RRT* and BIT* is within 1 % of the optimum, divided "
            f"by T3DRM's: median {percentile(factors, 50):.0f}, lowest tenth "
            f"{percentile(factors, 10):.0f}, least {min(factors):.0f}; at least 50 on "
            f"{sum(f >= 50 for f in factors)} of {len(factors)} maps whose straight way is barred."
        )
        direct = [r for r in measured.reaches if r.direct and r.planner == "BIT*"]
        if direct:
            seconds = percentile([r.seconds for r in direct], 50)
            ours = percentile([r.t3drm_seconds for r in direct], 50)
            lines.append(
                f"- On the {len(direct)} maps whose straight way is free BIT* tries it first and "
                f"takes {1e3 * seconds:.3f} ms, T3DRM {1e3 * ours:.3f} ms."
            )
    return ["\n".join(lines)]


def _against_budgets(trials: Sequence[Trial]) -> list[str]:
    """Per kind of map: the smallest budget that is within 1 % at the median, over T3DRM's time."""
    factors = []
    for kind in KINDS:
        mine = [t for t in trials if kind_of(t.family) == kind]
        names = dict.fromkeys(t.planner for t in mine if t.planner[:4] in ("RRT*", "BIT*"))
        budgets = [
            (percentile([t.seconds for t in _of(mine, name)], 50), name)
            for name in names
            if percentile(_endless(_of(mine, name)), 50) <= WITHIN
        ]
        if budgets:
            own = percentile([t.seconds for t in _of(mine, TangentRoute.name)], 50)
            seconds, name = min(budgets)
            factors.append(f"{kind} {seconds / own:.0f} ({name})")
    if not factors:
        return []
    line = (
        "- Time of the quickest sampling planner whose median is within 1 % of the optimum, "
        f"divided by T3DRM's median: {', '.join(factors)}."
    )
    return [line]


def _endless(trials: Sequence[Trial]) -> list[float]:
    """Length ratios, a failure counting as endless."""
    return [math.inf if t.ratio is None else t.ratio for t in trials]


def _as_fast(trials: Sequence[Trial]) -> list[str]:
    own = percentile([t.seconds for t in trials if t.planner == TangentRoute.name], 50)
    names = dict.fromkeys(t.planner for t in trials if not t.planner.startswith("T3DRM"))
    rivals = []
    for name in names:
        mine = _of(trials, name)
        if percentile([t.seconds for t in mine], 50) <= own:
            rivals.append(f"{name} ({_success(mine)}, median {median_ratio(mine):.4f})")
    return rivals


def _of(trials: Sequence[Trial], planner: str) -> list[Trial]:
    return [t for t in trials if t.planner == planner]


def _best_of_each_map(reaches: Sequence[Reach]) -> list[Reach]:
    best: dict[tuple[str, int], Reach] = {}
    for r in reaches:
        key = (r.family, r.number)
        if key not in best or r.seconds < best[key].seconds:
            best[key] = r
    return list(best.values())


def _success(trials: Sequence[Trial]) -> str:
    return f"{100.0 * sum(t.ratio is not None for t in trials) / len(trials):.0f} %"


# ---------------------------------------------------------------- tables


def race_table(trials: Sequence[Trial]) -> str:
    """Success, length / optimum and time of every planner, the shortest first."""
    lines = [
        "| planner | maps | success | length / optimum p50 | p95 | max | ms p50 | p95 | p99 |",
        "|---|--:|--:|--:|--:|--:|--:|--:|--:|",
    ]
    names = dict.fromkeys(t.planner for t in trials)
    for name in sorted(names, key=lambda name: _rank(_of(trials, name))):
        mine = _of(trials, name)
        ratios = [t.ratio for t in mine if t.ratio is not None]
        times = [1e3 * t.seconds for t in mine]
        shown = [f"{percentile(ratios, p):.4f}" if ratios else "-" for p in (50, 95, 100)]
        taken = [_ms(percentile(times, p)) for p in (50, 95, 99)]
        label = f"**{name}**" if name.startswith("T3DRM") else name
        cells = [label, str(len(mine)), _success(mine), *shown, *taken]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def _rank(trials: Sequence[Trial]) -> tuple[bool, float, float]:
    """The yardstick on top, then by median length, a failure counting as endless; then by time."""
    ratios = _endless(trials)
    quick = percentile([t.seconds for t in trials], 50)
    middle = percentile(ratios, 50)
    return trials[0].planner != ExactOptimum.name, round(middle, 5), quick


def _ms(milliseconds: float) -> str:
    return f"{milliseconds:.3f}" if milliseconds < 1.0 else f"{milliseconds:.3g}"


def family_table(measured: Campaign) -> str:
    """T3DRM's times on every family, and what the others need."""
    lines = [
        "| "
        + " | ".join(
            (
                "maps",
                "T3DRM / optimum, max",
                "T3DRM ms p50",
                "p95",
                "p99",
                "whole tangent graph, ms p50",
                "Theta*, ms p50",
                "RRT* to 1 %, ms p50",
                "BIT* to 1 %, ms p50",
                "the quicker / T3DRM, p50",
                "least",
            )
        )
        + " |",
        "|---|--:|--:|--:|--:|--:|--:|--:|--:|--:|--:|",
    ]
    for family in dict.fromkeys(t.family for t in measured.trials):
        mine = [t for t in measured.trials if t.family == family]
        own = _of(mine, TangentRoute.name)
        ratios = _endless(own)
        times = [_ms(1e3 * percentile([t.seconds for t in own], p)) for p in (50, 95, 99)]
        others = [
            _ms(1e3 * percentile([t.seconds for t in _of(mine, name)], 50))
            for name in (ExactOptimum.name, "Theta*, any angle")
        ]
        cells = [family, f"{max(ratios):.7f}", *times, *others]
        cells += _reach_cells([r for r in measured.reaches if r.family == family and not r.direct])
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def _reach_cells(reaches: Sequence[Reach]) -> list[str]:
    if not reaches:
        return ["-"] * 4
    cells = []
    for name in ("RRT*", "BIT*"):
        middle = percentile([r.seconds for r in reaches if r.planner == name], 50)
        over = f"> {1e3 * BUDGETS_S[-1]:.0f}"
        cells.append(over if math.isinf(middle) else _ms(1e3 * middle))
    factors = [r.seconds / r.t3drm_seconds for r in _best_of_each_map(reaches)]
    shown = (percentile(factors, 50), min(factors))
    return cells + [f"{f:.0f}x" if math.isfinite(f) else "never in 1 s" for f in shown]


def step_table(taken: Sequence[Step]) -> str:
    """What a planning step costs, by the sort of question."""
    lines = [
        (
            "| questions | number | hits p50 | max | ms p50 | p95 | p99 "
            "| same map again: ms p50 | p95 |"
        ),
        "|---|--:|--:|--:|--:|--:|--:|--:|--:|",
    ]
    for group in dict.fromkeys(s.group for s in taken):
        mine = [s for s in taken if s.group == group]
        cold = [_ms(1e3 * percentile([s.cold_s for s in mine], p)) for p in (50, 95, 99)]
        again = [_ms(1e3 * percentile([s.again_s for s in mine], p)) for p in (50, 95)]
        hits = [f"{percentile([s.hits for s in mine], p):.0f}" for p in (50, 100)]
        lines.append(f"| {' | '.join([group, str(len(mine)), *hits, *cold, *again])} |")
    return "\n".join(lines)


def bend_table(measured: Campaign) -> str:
    """Conic / arc: length, tightest bend, time."""
    bends = measured.bends
    rows = [
        ("length", [b.ratio for b in bends]),
        (
            f"greatest curvature, where the arc's radius is below {TIGHT_M:g} m",
            [b.radius_arc_m / b.radius_conic_m for b in bends if b.radius_arc_m < TIGHT_M] or [1.0],
        ),
    ]
    rows += [
        (f"time at {speed:g} m/s", [b.time_ratios[k] for b in bends])
        for k, speed in enumerate(SPEEDS_M_S)
    ]
    meaning = (
        f"{len(bends)} routes with at least one conic; conic / arc, bends limited to "
        f"{LATERAL_M_S2:g} m/s² (braking is free, corners may be cut by 5 mm)."
    )
    lines = [
        meaning,
        "",
        "| conic / arc | p5 | p50 | p95 | max | conic better |",
        "|---|--:|--:|--:|--:|--:|",
    ]
    for name, ratios in rows:
        shown = [f"{percentile(ratios, p):.4f}" for p in (5, 50, 95, 100)]
        better = sum(r < 1.0 - 1e-9 for r in ratios) / len(ratios)
        lines.append(f"| {name} | {' | '.join(shown)} | {100 * better:.0f} % |")
    kinks = [math.degrees(b.kink_rad) for b in bends]
    shown = [f"{percentile(kinks, p):.1f}°" for p in (5, 50, 95, 100)]
    lines.append(f"| greatest kink at a conic's end | {' | '.join(shown)} | - |")
    return "\n".join(lines)


def growth_table(growth: Sequence[Growth]) -> str:
    """Milliseconds per number of obstacles, and the slope of each curve."""
    curves = list(dict.fromkeys(g.curve for g in growth))
    counts = list(dict.fromkeys(g.count for g in growth))
    lines = [
        f"| obstacles | {' | '.join(curves)} |",
        f"|--:|{'--:|' * len(curves)}",
    ]
    for count in counts:
        row = {g.curve: g.seconds for g in growth if g.count == count}
        cells = [_ms(1e3 * row[c]) if c in row else "-" for c in curves]
        lines.append(f"| {count} | {' | '.join(cells)} |")
    slopes = [f"{slope(growth, c):.2f}" for c in curves]
    lines.append(f"| time ~ n^ | {' | '.join(slopes)} |")
    return "\n".join(lines)


def slope(growth: Sequence[Growth], curve: str) -> float:
    """The exponent of a curve from its first to its last number of obstacles."""
    mine = [g for g in growth if g.curve == curve]
    first, last = mine[0], mine[-1]
    if first.count == last.count:
        return math.nan
    return float(np.log(last.seconds / first.seconds) / np.log(last.count / first.count))


# ---------------------------------------------------------------- the page


def renew(section: str, text: str, page: Path = README) -> None:
    """Put `text` between the markers of `section`; ValueError when the page has none."""
    pages.renew(section, text, page)


def draw_all(measured: Campaign, chosen: Sequence[Family], into: Path = HERE) -> None:
    """The pictures beside the page."""
    from tools.bench import plots

    plots.draw_all(measured, chosen, into)


def median_ratio(trials: Sequence[Trial]) -> float:
    """Of the maps that were solved; nan without any."""
    ratios = [t.ratio for t in trials if t.ratio is not None]
    return statistics.median(ratios) if ratios else math.nan
