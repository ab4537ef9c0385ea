"""What a campaign came to, as Markdown and pictures."""

import datetime
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np

from autonomy.pictures import draw_flight, draw_scenario
from autonomy.simulation import Simulation, goal_of
from tools.bench.plots import INK, SOFT
from tools.hunt.genome import decoded
from tools.hunt.search import GOALS, goal_of_hunt
from tools.hunt.trial import Trial

mpl.use("Agg")
from matplotlib import pyplot as plt

from tools.bench.rooms import shipped_config

README = Path(__file__).with_name("README.md")
_HEADER = (
    "| rooms | flown | goal reached | unreachable | ended by a fault | collisions "
    "| no verdict | wrong verdict | raised | least clearance m | longest way / optimum "
    "| longest flight s |"
)
_COLOURS = {"random": "#57606a", "clearance": "#cf222e", "stall": "#bf8700", "detour": "#0969da"}


def kind_of(trial: Trial) -> str:
    """`random`, or what the hunt was after."""
    word, number = trial.name.split(" ")
    return word if word == "random" else goal_of_hunt(int(number.split(".")[0]))


def section(trials: Sequence[Trial], version: str) -> str:
    """The tables, as Markdown."""
    when = datetime.datetime.now(tz=datetime.UTC).date().isoformat()
    lines = [
        f"Measured {when}, commit {version}: {len(trials):,} rooms.",
        "",
        _HEADER,
        f"|---|{'--:|' * 11}",
    ]
    for kind in ("random", *GOALS):
        mine = [trial for trial in trials if kind_of(trial) == kind]
        if mine:
            lines.append(_row("random" if kind == "random" else f"hunts for {kind}", mine))
    lines.append(_row("all", trials))
    failures = [trial for trial in trials if trial.failure]
    if failures:
        lines += ["", "Failures, the first of each kind and fault:", ""]
        first = {(t.failure, t.faults, t.mode): t for t in reversed(failures)}
        lines += [
            f"- `{t.name}`: {t.failure} ({t.mode}, {', '.join(t.faults) or 'no fault'}), clearance "
            f"{t.clearance_m:.3f} m, {t.ending}"
            for t in sorted(first.values(), key=lambda t: t.name)[:30]
        ]
    return "\n".join(lines)


def _row(label: str, mine: Sequence[Trial]) -> str:
    endings = Counter(trial.ending for trial in mine)
    failures = Counter(trial.failure for trial in mine)
    ended = sum(endings.values()) - endings["goal_reached"] - endings["unreachable"]
    return (
        f"| {label} | {len(mine)} | {endings['goal_reached']} | {endings['unreachable']} "
        f"| {ended - failures['raised'] - failures['no verdict']} | {failures['collision']} "
        f"| {failures['no verdict']} | {failures['wrong verdict']} | {failures['raised']} "
        f"| {min(t.clearance_m for t in mine if t.clearance_m == t.clearance_m):.3f} "
        f"| {max(t.detour for t in mine):.2f} | {max(t.navigation_s for t in mine):.0f} |"
    )


def draw_curves(trials: Sequence[Trial], path: Path) -> None:
    """The worst found so far, against the number of rooms flown, random and hunted."""
    questions: tuple[tuple[str, Callable[[Trial], float], Any, str], ...] = (
        ("clearance", lambda t: t.clearance_m, np.fmin, "least clearance, m (body: 0.15)"),
        ("stall", lambda t: t.navigation_s, np.fmax, "longest flight, s"),
        ("detour", lambda t: t.detour, np.fmax, "longest way / optimum"),
    )
    figure, all_axes = plt.subplots(1, 3, figsize=(11.0, 3.2), layout="constrained")
    for axes, (goal, value, worse, label) in zip(all_axes, questions, strict=True):
        for kind in ("random", goal):
            mine = [value(t) for t in trials if kind_of(t) == kind]
            if mine:
                curve = np.asarray(worse.accumulate(mine))
                name = "random rooms" if kind == "random" else "hunts"
                axes.plot(np.arange(1, len(mine) + 1), curve, color=_COLOURS[kind], label=name)
        axes.set_xscale("log")
        axes.set_xlabel("rooms flown")
        axes.set_title(label, fontsize=10, color=INK)
        axes.grid(color=SOFT, lw=0.4)
        axes.legend(frameon=False, fontsize=8)
    figure.savefig(path, dpi=110, metadata={"Software": None})
    plt.close(figure)


def worst(trials: Sequence[Trial]) -> list[Trial]:
    """Two of the least clearances, two of the longest flights, two of the longest ways.

    No two from one hunt: its rooms resemble one another.
    """
    keys: tuple[Callable[[Trial], float], ...] = (
        lambda t: t.clearance_m,
        lambda t: -t.navigation_s,
        lambda t: -t.detour,
    )
    chosen: list[Trial] = []
    for key in keys:
        families = {t.name.split(".")[0] for t in chosen}
        found = 0
        for trial in sorted((t for t in trials if t.failure != "raised"), key=key):
            family = trial.name.split(".")[0]
            if family not in families:
                families.add(family)
                chosen.append(trial)
                found += 1
            if found == 2:
                break
    return chosen


def draw_worst(trials: Sequence[Trial], path: Path) -> None:
    """The worst rooms with the flights through them."""
    chosen = worst(trials)
    figure, axes = plt.subplots(2, 3, figsize=(11.0, 7.6), layout="constrained")
    for place, trial in zip(axes.T.flat, chosen, strict=False):
        draw_room(place, trial)
    figure.savefig(path, dpi=90, metadata={"Software": None})
    plt.close(figure)


def save_room(trial: Trial, path: Path) -> None:
    """One room with its flight, flown again, as a picture."""
    figure, axes = plt.subplots(figsize=(6.0, 6.4), layout="constrained")
    draw_room(axes, trial)
    figure.savefig(path, dpi=110, metadata={"Software": None})
    plt.close(figure)


def draw_room(axes: Any, trial: Trial) -> None:
    """One room with its flight, flown again."""
    scenario, mode = decoded(trial.vector, trial.name)
    config = shipped_config(scenario, mode)
    flight = Simulation(scenario, config, (goal_of(scenario, config),)).run()
    draw_scenario(axes, scenario, legend=False)
    draw_flight(axes, flight.track)
    axes.set_title(
        f"{trial.name}, {mode}: {flight.outcome.ending.value}, {flight.true_clearance_m:.2f} m, "
        f"{flight.navigation_time_s:.0f} s",
        fontsize=8,
        color=INK,
    )
    legend = axes.get_legend()
    if legend is not None:
        legend.remove()
