"""The pictures of tools/bench/README.md, drawn from a campaign."""

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np

from tools.bench.baselines.ant_colony import AntColony
from tools.bench.baselines.astar import AStar
from tools.bench.baselines.interface import Floats
from tools.bench.baselines.potential_field import PotentialField
from tools.bench.baselines.theta_star import ThetaStar
from tools.bench.maps import Family, Map
from tools.bench.planners import Campaign, Growth, TangentRoute, Trial
from tools.bench.report import KINDS, kind_of, percentile, slope

mpl.use("Agg")
from matplotlib import pyplot as plt
from matplotlib.collections import PatchCollection
from matplotlib.patches import Circle

INK, SOFT, FAINT = "#24292f", "#c9d1d9", "#f0f3f6"
COLOURS = {
    "T3DRM": "#0969da",
    "exact optimum": "#57606a",
    "Theta*": "#8250df",
    "A*": "#bf8700",
    "ant colony": "#1a7f37",
    "potential field": "#cf222e",
    "RRT*": "#bc4c00",
    "BIT*": "#bf3989",
}
LEAST_EXCESS = 1e-5
"""Excess lengths below this are drawn at it: the axis is logarithmic."""
GALLERY = ("20 discs, 6 m", "80 discs, 12 m", "16 walls, 12 m", "BARN")


def colour_of(planner: str) -> str:
    """By the name's beginning."""
    return next((c for name, c in COLOURS.items() if planner.startswith(name)), INK)


def draw_all(measured: Campaign, chosen: Sequence[Family], into: Path) -> None:
    """Every picture as a PNG into a folder."""
    plt.rcParams.update(
        {"font.size": 9, "axes.spines.top": False, "axes.spines.right": False, "axes.titlesize": 10}
    )
    length_against_time(measured.trials, into / "length_time.png")
    success(measured.trials, into / "success.png")
    times(measured.trials, into / "times.png")
    head_start(measured, into / "head_start.png")
    if measured.growth:
        growth_curves(measured.growth, into / "growth.png")
    gallery([f for f in chosen if f.name in GALLERY], into / "gallery.png")


def length_against_time(trials: Sequence[Trial], path: Path) -> None:
    """Excess length over planning time: medians, with bars from p5 to p95."""
    kinds = [k for k in KINDS if any(kind_of(t.family) == k for t in trials)]
    figure, grid = plt.subplots(
        2, math.ceil(len(kinds) / 2), figsize=(10, 7.6), sharex=True, sharey=True, squeeze=False,
        layout="constrained",
    )  # fmt: skip
    for axes, kind in zip(grid.flat, kinds, strict=False):
        mine = [t for t in trials if kind_of(t.family) == kind]
        for name in dict.fromkeys(t.planner for t in mine):
            _one_planner(axes, name, [t for t in mine if t.planner == name])
        _budget_lines(axes, mine)
        axes.set(xscale="log", yscale="log", title=kind, ylim=(0.6 * LEAST_EXCESS, 0.8))
        axes.axhline(0.01, color=SOFT, linewidth=0.8, linestyle=(0, (4, 3)), zorder=0)
        axes.grid(color=FAINT, zorder=-1)
    for axes in grid[:, 0]:
        axes.set_yticks([1e-5, 1e-4, 1e-3, 1e-2, 1e-1])
        axes.set_yticklabels(["exact", "0.01 %", "0.1 %", "1 %", "10 %"])
        axes.set_ylabel("longer than the optimum")
    for axes in grid[-1]:
        axes.set_xticks([1e-2, 1e-1, 1, 10, 100, 1000])
        axes.set_xticklabels(["0.01", "0.1", "1", "10", "100", "1000"])
        axes.set_xlabel("planning time (ms of CPU)")
    marks = [_mark(name) for name in COLOURS]
    figure.legend(
        marks, COLOURS, loc="outside lower center", ncols=len(COLOURS), frameon=False,
        handletextpad=0.2, columnspacing=1.2,
    )  # fmt: skip
    figure.suptitle("Length and time: median, bars from the 5th to the 95th percentile")
    figure.savefig(path, dpi=110)
    plt.close(figure)


def _mark(name: str) -> Any:
    return mpl.lines.Line2D([], [], marker=_shape(name), linestyle="", color=COLOURS[name])


def _shape(planner: str) -> str:
    return "D" if planner.startswith("T3DRM") else "s" if planner.startswith("exact") else "o"


def _one_planner(axes: Any, name: str, trials: Sequence[Trial]) -> None:
    excess = [max(LEAST_EXCESS, t.ratio - 1.0) for t in trials if t.ratio is not None]
    if not excess:
        return
    times = [1e3 * t.seconds for t in trials]
    x, y = percentile(times, 50), percentile(excess, 50)
    across = [[x - percentile(times, 5)], [percentile(times, 95) - x]]
    up = [[y - percentile(excess, 5)], [percentile(excess, 95) - y]]
    own = name.startswith("T3DRM")
    axes.errorbar(
        x, y, xerr=across, yerr=up, fmt=_shape(name), color=colour_of(name), clip_on=False,
        markersize=9 if own else 6.5, markeredgecolor="white", markeredgewidth=0.8,
        elinewidth=1.0, ecolor=(*mpl.colors.to_rgb(colour_of(name)), 0.45), zorder=5 if own else 3,
    )  # fmt: skip
    note = {
        "known discs": "discs",
        "planning step (arcs)": "step",
        "planning step (conics)": "step, conics",
    }
    if own:
        axes.annotate(
            note[name.split(", ", 1)[1]], (x, y), (6, -13 if name.endswith("(conics)") else 8),
            textcoords="offset points", fontsize=7.5, color=colour_of(name),
        )  # fmt: skip


def _budget_lines(axes: Any, trials: Sequence[Trial]) -> None:
    """A thin line through the budgets of one sampling planner."""
    for kind in ("RRT*", "BIT*"):
        points = []
        for name in dict.fromkeys(t.planner for t in trials if t.planner.startswith(kind)):
            mine = [t for t in trials if t.planner == name]
            excess = [max(LEAST_EXCESS, t.ratio - 1.0) for t in mine if t.ratio is not None]
            if excess:
                times = [1e3 * t.seconds for t in mine]
                points.append((percentile(times, 50), percentile(excess, 50)))
        if points:
            axes.plot(*zip(*points, strict=True), color=COLOURS[kind], linewidth=1.2, zorder=2)


def times(trials: Sequence[Trial], path: Path) -> None:
    """Planning time of every planner: p50, p95 and p99."""
    kinds = [k for k in KINDS if any(kind_of(t.family) == k for t in trials)]
    names = list(dict.fromkeys(t.planner for t in trials))
    names.sort(key=lambda n: percentile([t.seconds for t in trials if t.planner == n], 50))
    figure, grid = plt.subplots(
        1, len(kinds), figsize=(11, 0.3 * len(names) + 1.4), sharex=True, sharey=True,
        squeeze=False, layout="constrained",
    )  # fmt: skip
    for axes, kind in zip(grid.flat, kinds, strict=True):
        for row, name in enumerate(reversed(names)):
            taken = [
                1e3 * t.seconds for t in trials if t.planner == name and kind_of(t.family) == kind
            ]
            if not taken:
                continue
            ranks = [percentile(taken, p) for p in (50, 95, 99)]
            axes.plot(ranks, [row] * 3, color=colour_of(name), linewidth=1.4, zorder=2)
            for mark, at in zip("o|x", ranks, strict=True):
                axes.plot(at, row, mark, color=colour_of(name), markersize=5.5, zorder=3)
        axes.set(xscale="log", title=kind, xlabel="ms of CPU: o p50, | p95, x p99")
        axes.set_yticks(range(len(names)), reversed(names))
        axes.grid(color=FAINT, zorder=-1)
    figure.savefig(path, dpi=110)
    plt.close(figure)


def success(trials: Sequence[Trial], path: Path) -> None:
    """Bars: the share of maps on which a path passed the check."""
    names = [n for n in dict.fromkeys(t.planner for t in trials) if n != "exact optimum"]
    names.sort(key=lambda n: not n.startswith("T3DRM"))
    kinds = [k for k in KINDS if any(kind_of(t.family) == k for t in trials)]
    figure, axes = plt.subplots(figsize=(7.6, 0.42 * len(names) + 1.2), layout="constrained")
    for row, name in enumerate(reversed(names)):
        for column, kind in enumerate(kinds):
            mine = [t for t in trials if t.planner == name and kind_of(t.family) == kind]
            if not mine:
                axes.annotate("-", (column + 0.45, row), ha="center", va="center", color=SOFT)
                continue
            share = sum(t.ratio is not None for t in mine) / len(mine)
            axes.barh(row, 0.9, left=column, height=0.62, color=FAINT)
            axes.barh(row, 0.9 * share, left=column, height=0.62, color=colour_of(name), alpha=0.85)
            axes.annotate(
                f"{100 * share:.0f} %", (column + 0.04, row), va="center", fontsize=8,
                color="white" if share > 0.2 else INK,
            )  # fmt: skip
    axes.set_yticks(range(len(names)), reversed(names))
    axes.set_xticks([c + 0.45 for c in range(len(kinds))], kinds)
    axes.tick_params(length=0)
    for side in ("left", "bottom"):
        axes.spines[side].set_visible(False)
    axes.set_title("Maps with a path that passed the exact check")
    figure.savefig(path, dpi=110)
    plt.close(figure)


def head_start(measured: Campaign, path: Path) -> None:
    """How many times longer sampling takes to come within 1 %, over maps in order."""
    barred = [r for r in measured.reaches if not r.direct]
    if not barred:
        return
    figure, axes = plt.subplots(figsize=(7.6, 4.2), layout="constrained")
    for kind in ("RRT*", "BIT*"):
        factors = sorted(r.seconds / r.t3drm_seconds for r in barred if r.planner == kind)
        share = (np.arange(len(factors)) + 0.5) / len(factors)
        axes.plot(
            [f for f in factors if math.isfinite(f)], share[: sum(map(math.isfinite, factors))],
            drawstyle="steps-mid", color=COLOURS[kind], linewidth=2, label=kind,
        )  # fmt: skip
    axes.axvline(50, color=INK, linewidth=0.8, linestyle=(0, (4, 3)))
    axes.set(
        xscale="log", ylim=(0, 1), xlabel="time to within 1 % of the optimum / T3DRM's time to it",
        ylabel="share of the maps", title="Head start (a curve ends where 1 s was not enough)",
    )  # fmt: skip
    axes.set_xticks([10, 50, 100, 1000], ["10", "50", "100", "1000"])
    axes.set_yticks([0, 0.25, 0.5, 0.75, 1], ["0", "25 %", "50 %", "75 %", "100 %"])
    axes.grid(color=FAINT)
    axes.legend(frameon=False, loc="center right")
    figure.savefig(path, dpi=110)
    plt.close(figure)


def growth_curves(growth: Sequence[Growth], path: Path) -> None:
    """Time over the number of obstacles, both logarithmic."""
    figure, axes = plt.subplots(figsize=(7.6, 4.4), layout="constrained")
    colours = ("#0969da", "#54aeff", "#1a7f37", "#8250df", "#57606a")
    curves = list(dict.fromkeys(g.curve for g in growth))
    for curve, colour in zip(curves, colours, strict=False):
        mine = [g for g in growth if g.curve == curve]
        axes.plot(
            [g.count for g in mine], [1e3 * g.seconds for g in mine], "o-", color=colour,
            markersize=4.5, linewidth=1.8, label=f"{curve}  ~ n^{slope(growth, curve):.2f}",
        )  # fmt: skip
    first = min(g.count for g in growth)
    last = max(g.count for g in growth)
    base = min(1e3 * g.seconds for g in growth if g.count == first)
    axes.plot([first, last], [base, base * last / first], color=SOFT, linestyle=":", zorder=0)
    axes.annotate("linear", (last / 6, base * last / first / 6), (-6, 6), color="#8c959f",
                  textcoords="offset points", ha="right", fontsize=8)  # fmt: skip
    axes.set(
        xscale="log", yscale="log", xlabel="obstacles on the map, of which 20 may be in the way",
        ylabel="planning time (ms of CPU)", title="Obstacles elsewhere",
    )  # fmt: skip
    axes.set_xticks([20, 100, 1000, 10_000], ["20", "100", "1000", "10 000"])
    axes.set_yticks([0.1, 1, 10, 100], ["0.1", "1", "10", "100"])
    axes.grid(color=FAINT)
    axes.legend(frameon=False, loc="upper left", fontsize=8)
    figure.savefig(path, dpi=110)
    plt.close(figure)


def gallery(chosen: Sequence[Family], path: Path) -> None:
    """A few maps with the paths of the quick planners."""
    if not chosen:
        return
    problems = [family.draw(_telling(family)) for family in chosen]
    shapes = [(p.high[1] - p.low[1]) / (p.high[0] - p.low[0]) for p in problems]
    figure, grid = plt.subplots(
        1, len(chosen), figsize=(4.0 * sum(shapes), 4.6), squeeze=False, layout="constrained",
        width_ratios=shapes,
    )  # fmt: skip
    used: dict[str, Any] = {}
    for axes, family, problem in zip(grid.flat, chosen, problems, strict=True):
        _map(axes, problem)
        for planner in (
            TangentRoute(),
            ThetaStar(),
            AStar(),
            AntColony(np.random.default_rng(0)),
            PotentialField(),
        ):
            route = planner.plan(problem).path
            if route is not None:
                name = next(n for n in COLOURS if planner.name.startswith(n))
                used[name] = _route(axes, route, name)
        axes.set_title(family.name)
    figure.legend(
        used.values(), used.keys(), loc="outside lower center", ncols=len(used), frameon=False
    )
    figure.savefig(path, dpi=110)
    plt.close(figure)


def _telling(family: Family) -> int:
    """The map, of the first 30, whose best way bends most."""
    planner = TangentRoute()
    detours = []
    for problem in family.maps(30):
        route = planner.plan(problem).path
        length = 0.0 if route is None else float(np.hypot(*np.diff(route, axis=0).T).sum())
        detours.append(length / math.dist(problem.start, problem.goal))
    return int(np.argmax(detours))


def _map(axes: Any, problem: Map) -> None:
    for radii, colour in ((problem.reach_m, FAINT), (np.maximum(problem.radii_m, 0.03), SOFT)):
        discs = [
            Circle((e, n), r)
            for (n, e), r in zip(problem.centres.tolist(), radii.tolist(), strict=True)
        ]
        axes.add_collection(PatchCollection(discs, facecolor=colour, edgecolor="none", zorder=0))
    for n, e in (problem.start, problem.goal):
        axes.plot(e, n, "o", color=INK, markersize=5, zorder=9)
    axes.set_xlim(problem.low[1], problem.high[1])
    axes.set_ylim(problem.low[0], problem.high[0])
    axes.set_aspect("equal")
    axes.set_xticks([])
    axes.set_yticks([])
    for side in ("left", "bottom"):
        axes.spines[side].set_visible(False)


def _route(axes: Any, route: Floats, name: str) -> Any:
    own = name == "T3DRM"
    return axes.plot(
        route[:, 1], route[:, 0], color=COLOURS[name], linewidth=4.5 if own else 1.2,
        alpha=0.75 if own else 1.0, zorder=4 if own else 6, solid_capstyle="round",
    )[0]  # fmt: skip
