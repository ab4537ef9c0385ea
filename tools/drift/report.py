"""The table and the picture of autonomy/estimation/README.md."""

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

import autonomy.estimation
from autonomy import pictures
from autonomy.pictures import GREEN, LOW, ORANGE
from tools.drift.flights import Case, Row, flown

README = Path(autonomy.estimation.__path__[0]) / "README.md"
PICTURE = "known_walls.png"
PICTURED = Case("door", "px4", "rolling", 3, fixed=True)
_HEAD = (
    "drift",
    "room",
    "mode",
    "walls",
    "flights",
    "goal reached",
    "touched flying",
    "touched landing",
    "least clearance m",
    "median m",
    "landing, least m",
    "position error cm rms",
    "time s median",
)
_RADIUS_M = 0.15


def table(rows: Sequence[Row]) -> str:
    """Markdown: one line per level, room and mode, each with the fix and without it; and all."""
    lines = [f"| {' | '.join(_HEAD)} |", f"|{'---|' * len(_HEAD)}"]
    for key in sorted({(r.case.level, r.case.room, r.case.mode) for r in rows}):
        mine = [r for r in rows if (r.case.level, r.case.room, r.case.mode) == key]
        lines += [_line(key, mine, fixed=fixed) for fixed in (False, True)]
    for level in sorted({r.case.level for r in rows}):
        mine = [r for r in rows if r.case.level == level]
        lines += [_line((level, "all", "both"), mine, fixed=fixed) for fixed in (False, True)]
    return "\n".join(line for line in lines if line)


def _line(key: tuple[str, str, str], rows: Sequence[Row], *, fixed: bool) -> str:
    """One side of the comparison; empty when it was not flown."""
    mine = [r for r in rows if r.case.fixed == fixed]
    if not mine:
        return ""
    clearances = [r.clearance_m for r in mine]
    landings = [r.landing_m for r in mine]
    rms_m = math.sqrt(float(np.mean([r.error_rms_m**2 for r in mine])))
    cells = (
        *key,
        "yes" if fixed else "no",
        str(len(mine)),
        str(sum(r.ending == "goal_reached" for r in mine)),
        str(sum(r.clearance_m <= _RADIUS_M for r in mine)),
        str(sum(r.landing_m <= _RADIUS_M for r in mine)),
        f"{min(clearances):.3f}",
        f"{float(np.median(clearances)):.3f}",
        f"{min(landings):.3f}",
        f"{100.0 * rms_m:.1f}",
        f"{float(np.median([r.navigation_s for r in mine])):.0f}",
    )
    return f"| {' | '.join(cells)} |"


def draw(case: Case, out: Path) -> None:
    """Position error over time, the same flight with the fix and without it."""
    figure, axes = pictures.new_figure(size=(9.0, 2.8))
    for fixed, colour, label in ((False, ORANGE, "without"), (True, GREEN, "with known walls")):
        side = Case(case.room, case.level, case.mode, case.seed, fixed)
        times, errors = (np.array(each) for each in zip(*flown(side)[1].errors, strict=True))
        axes.plot(times - times[0], 100.0 * errors, color=colour, lw=1.1, label=label)
    axes.set_ylabel("position error, cm")
    axes.set_xlabel("s")
    axes.set_ylim(bottom=0.0)
    axes.grid(visible=True, color=LOW, lw=0.5)
    axes.legend(loc="upper right", fontsize=8, frameon=False, ncols=2)
    figure.savefig(out, dpi=100, metadata={"Software": None})
