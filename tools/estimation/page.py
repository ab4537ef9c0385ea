"""What was measured as Markdown and pictures, between markers in autonomy/estimation/README.md."""

import statistics
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

import autonomy.estimation
from autonomy import pictures
from autonomy.pictures import BLUE, GREEN, INK, LOW, ORANGE, VERMILION
from tools.estimation.consistency import GNSS_TICKS, TICK_S, WITHIN, Series
from tools.estimation.flights import DISTURBED_S, Case, Flown

README = Path(autonomy.estimation.__path__[0]) / "README.md"
PICTURES = (("consistency.png", "NEES and NIS"), ("drift.png", "GNSS led astray"))


def consistency_table(series: Sequence[Series]) -> str:
    """One row a quantity."""
    runs = series[0].values.shape[0]
    lines = [
        f"| {runs} runs | expected | mean | bounds of the mean at one time | times inside |",
        "|---|--:|--:|--:|--:|",
    ]
    for each in series:
        low, high = each.bounds
        lines.append(
            f"| {each.name} | {each.degrees} | {each.mean:.3f} | {low:.2f} to {high:.2f} "
            f"| {100.0 * each.inside:.0f} % of {100.0 * WITHIN:.0f} |"
        )
    return "\n".join(lines)


def error_table(flights: Sequence[tuple[Case, Sequence[Flown]]]) -> str:
    """One row a case."""
    head = ("raw GNSS", "autopilot", "fused", "fused against the autopilot", "usable", "told")
    lines = [
        f"| cm, rms / p95 | {' | '.join(head)} |",
        "|---|--:|--:|--:|--:|--:|---|",
    ]
    for case, flown in flights:
        cells = [
            _errors([e for f in flown for e in f.raw_m]),
            _errors([e for f in flown for e in f.autopilot_m]),
            _errors([e for f in flown for e in f.fused_m]),
            _errors([e for f in flown for e in f.against_frame_m]),
            f"{100.0 * float(np.mean([u for f in flown for u in f.usable])):.1f} %",
            _told(case, flown),
        ]
        lines.append(f"| {case.name} | {' | '.join(cells)} |")
    return "\n".join(lines)


def _errors(errors_m: Sequence[float]) -> str:
    if not errors_m:
        return "-"
    squares = np.square(errors_m)
    rms_m, p95_m = float(np.sqrt(squares.mean())), float(np.percentile(errors_m, 95))
    digits = 0 if rms_m > 0.5 else 1
    return f"{100 * rms_m:.{digits}f} / {100 * p95_m:.{digits}f}"


def _told(case: Case, flown: Sequence[Flown]) -> str:
    if not case.event:
        return "-"
    times = [f.noticed_s for f in flown if f.noticed_s is not None]
    if not case.disturbed:
        return f"falsely in {len(times)} of {len(flown)}"
    after = f", after {statistics.median(times):.1f} s" if times else ""
    return f"{len(times)} of {len(flown)}{after}"


def room_words(flights: Sequence[tuple[Case, Sequence[Flown]]]) -> str:
    """What `room_sigma_m` is worth, over the flights in which nothing happens."""
    ratios = [
        r for case, flown in flights if not case.disturbed for f in flown for r in f.room_ratio
    ]
    return (
        "Squared horizontal error against the room over what `room_sigma_m` believes of it: "
        f"{float(np.mean(ratios)):.2f} (1 is right), in the rows without a disturbance."
    )


def draw_consistency(series: Sequence[Series], out: Path) -> None:
    """NEES of the state and NIS of GNSS over time, with their bounds."""
    figure, rows = pictures.new_figure(rows=2, size=(9.0, 5.0))
    steps = ((series[0], TICK_S), (series[3], GNSS_TICKS * TICK_S))
    for axes, (each, step_s) in zip(rows, steps, strict=True):
        means = each.values.mean(axis=0)
        low, high = each.bounds
        axes.axhspan(low, high, color=GREEN, alpha=0.18, lw=0, label="95 % of the means")
        axes.axhline(each.degrees, color=GREEN, lw=0.8, ls=":")
        label = f"mean of {len(each.values)} runs"
        axes.plot(step_s * np.arange(len(means)), means, color=INK, lw=0.9, label=label)
        axes.set_ylabel(each.name)
        _finish(axes)
    rows[-1].set_xlabel("s")
    figure.savefig(out, dpi=100, metadata={"Software": None})


def draw_drift(drift: Flown, out: Path) -> None:
    """A GNSS that is led astray, and what the filter makes of it."""
    figure, axes = pictures.new_figure(size=(9.0, 2.8))
    times, astray, bias, error = (np.array(each) for each in zip(*drift.trace, strict=True))
    axes.plot(times, astray, color=ORANGE, lw=1.4, label="GNSS led astray")
    axes.plot(times, bias, color=BLUE, lw=1.2, label="bias in the filter")
    axes.plot(times, error, color=INK, lw=1.2, label="error of the fused position")
    if drift.noticed_s is not None:
        at_s = DISTURBED_S + drift.noticed_s
        axes.axvline(at_s, color=VERMILION, lw=1.0, ls="--", label="told")
    axes.set_ylabel("m north")
    axes.set_xlabel("s")
    _finish(axes)
    figure.savefig(out, dpi=100, metadata={"Software": None})


def _finish(axes: Any) -> None:
    axes.grid(visible=True, color=LOW, lw=0.5)
    axes.legend(loc="upper left", fontsize=8, frameon=False, ncols=4)
    bottom, top = axes.get_ylim()
    axes.set_ylim(bottom, top + 0.25 * (top - bottom))  # room for the legend
