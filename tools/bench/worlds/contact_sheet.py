"""All families on one picture, with the shortest way of each world's body."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from autonomy.pictures import BLUE, draw_scenario
from tools.bench.worlds.catalogue import FAMILIES, World, config_in, world
from tools.bench.worlds.truth import shortest_way

NUMBERS = range(5)


def draw(path: Path, families: Sequence[str] = FAMILIES, numbers: Sequence[int] = NUMBERS) -> None:
    """A PNG with one row for each family and one column for each number."""
    from matplotlib.figure import Figure

    size = (2.6 * len(numbers), 2.8 * len(families))
    figure = Figure(figsize=size, layout="constrained")
    axes = figure.subplots(len(families), len(numbers), squeeze=False)
    for row, family in zip(axes, families, strict=True):
        for ax, number in zip(row, numbers, strict=True):
            draw_world(ax, world(f"{family}:{number}"))
    figure.savefig(path, dpi=72)


def draw_world(axes: Any, shown: World) -> None:
    """One world from above; its name and difficulty above it."""
    draw_scenario(axes, shown.scenario, legend=False)
    way = shortest_way(shown.scenario, config_in(shown.scenario))
    if way:
        axes.plot([e for _, e in way], [n for n, _ in way], color=BLUE, lw=1.3, zorder=4)
    hard = shown.difficulty
    detour = f"x{hard.detour:.2f}, {hard.turns} turns" if hard.detour is not None else "no way"
    axes.set_title(
        f"{shown.family}:{shown.number}\n{hard.density:.0%}, {hard.passage_m:.2f} m, {detour}",
        fontsize=7.5,
    )
    axes.set_xlabel("")
    axes.set_ylabel("")
    axes.tick_params(labelsize=5)
