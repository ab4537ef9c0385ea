"""Draws the simulated PX4 beside the measured one into hal/sim: `python -m tools.plots_px4`."""

import argparse
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl

mpl.use("Agg")
from matplotlib import pyplot as plt
from matplotlib.lines import Line2D

from tools.px4_responses import Curve, profile_curves, step_curves

_FOLDER = Path(__file__).parents[1] / "hal" / "sim"
_MEASURED, _SIMULATED = "#d95f02", "#1b6ca8"
_PANELS = {
    "forward and stop": ("fwd_", "stop_"),
    "right and stop": ("right_",),
    "up, down and stop": ("up_", "down_"),
    "yaw rate and stop": ("yaw_",),
}


def _draw(axes: Any, curve: Curve) -> None:
    axes.plot(curve.times_s, curve.measured, color=_MEASURED, linewidth=2.4, alpha=0.55)
    axes.plot(curve.times_s, curve.simulated, color=_SIMULATED, linewidth=1.1)


def _dress(axes: Any, title: str, unit: str) -> None:
    axes.set_title(title, fontsize=8)
    axes.set_ylabel(unit, fontsize=8)
    axes.set_xlabel("s", fontsize=8, labelpad=1)
    axes.tick_params(labelsize=8)
    axes.grid(visible=True, color="#dddddd", linewidth=0.6)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)


def _legend(figure: Any) -> None:
    measured = Line2D([], [], color=_MEASURED, linewidth=2.4, alpha=0.55)
    simulated = Line2D([], [], color=_SIMULATED, linewidth=1.1)
    figure.legend(
        [measured, simulated],
        ["PX4 main, SIH quadrotor, measured", "mock PX4"],
        loc="upper center",
        ncols=2,
        fontsize=9,
        frameon=False,
    )


def draw_steps(curves: Iterable[Curve], path: Path) -> None:
    """Steps and stops, one row per drag."""
    kept = list(curves)
    drags = sorted({curve.drag_per_mass_s for curve in kept}, reverse=True)
    figure, grid = plt.subplots(len(drags), len(_PANELS), figsize=(12.0, 5.4), squeeze=False)
    for row, drag in zip(grid, drags, strict=True):
        for axes, (title, starts) in zip(row, _PANELS.items(), strict=True):
            chosen = [c for c in kept if c.drag_per_mass_s == drag and c.name.startswith(starts)]
            for curve in chosen:
                _draw(axes, curve)
            worst = max(curve.rms for curve in chosen)
            label = f"{title}, drag {drag:g}/s, rms ≤ {100.0 * worst:.1f} %"
            _dress(axes, label, chosen[0].unit)
    _save(figure, path)


def draw_profiles(curves: Iterable[Curve], path: Path) -> None:
    """Take-off, landing, return, failsafe, fall: one panel each."""
    kept = list(curves)
    columns = 4
    figure, grid = plt.subplots(2, columns, figsize=(12.0, 5.4), squeeze=False)
    for axes, curve in zip(grid.flat, kept, strict=False):
        _draw(axes, curve)
        _dress(axes, f"{curve.name}, rms {100.0 * curve.rms:.0f} %", curve.unit)
    for axes in grid.flat[len(kept) :]:
        axes.set_visible(False)
    _save(figure, path)


def _save(figure: Any, path: Path) -> None:
    _legend(figure)
    figure.tight_layout(rect=(0.0, 0.0, 1.0, 0.95))
    figure.savefig(path, dpi=110)
    plt.close(figure)
    sys.stdout.write(f"{path} ({path.stat().st_size // 1000} kB)\n")


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line; returns the exit code."""
    parser = argparse.ArgumentParser(prog="python -m tools.plots_px4", description=__doc__)
    parser.add_argument("--into", type=Path, default=_FOLDER, help="folder for the pictures")
    options = parser.parse_args(arguments)
    draw_steps(step_curves(), options.into / "px4_steps.png")
    draw_profiles(profile_curves(), options.into / "px4_profiles.png")
    return 0


if __name__ == "__main__":
    sys.exit(main())
