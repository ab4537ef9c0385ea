"""Pictures of flights and of campaigns, as PNG."""

import io
from collections.abc import Sequence
from itertools import cycle
from pathlib import Path
from typing import Any

import numpy as np

from autonomy.errors import BadInput
from autonomy.pictures import (
    BLUE,
    GREEN,
    INK,
    LOW,
    ORANGE,
    PURPLE,
    SKY,
    VERMILION,
    draw_flight,
    draw_scenario,
    new_figure,
)
from tools.bench.campaign import summary
from tools.bench.campaign.case import Row
from tools.bench.campaign.flying import Flown
from tools.bench.campaign.summary import estimated
from tools.bench.campaign.tables import Key, groups

BODY_RADIUS_M = 0.15
_COLOURS = (BLUE, ORANGE, GREEN, VERMILION, PURPLE, SKY, INK)
_DPI = 90


def flight_png(flown: Flown) -> bytes:
    """World, fence, goal, the way flown, and where it touched."""
    figure, axes = new_figure()
    draw_scenario(axes, flown.scenario, legend=False)
    flight = flown.flight
    if flight is not None:
        draw_flight(axes, flight.track)
        for _, contact in flight.contacts:
            north, east, _ = contact.body_ned_m
            axes.plot([east], [north], "x", color=VERMILION, ms=11, mew=2.5, zorder=8)
    row = flown.row
    time = f", {row.time_ratio:.2f} x optimum" if row.time_ratio is not None else ""
    axes.set_title(
        f"{row.planner} in {row.world}, seed {row.seed}, {row.sensors}, {row.response}\n"
        f"{row.ending}{' with a collision' if row.collided else ''}{time}",
        loc="left",
        fontsize=9,
    )
    return png(figure)


def save_flight(flown: Flown, path: Path) -> None:
    """The same in a file; raises BadInput where it cannot be written."""
    try:
        path.write_bytes(flight_png(flown))
    except OSError as error:
        raise BadInput(f"{path} cannot be written ({error.strerror})") from None


def png(figure: Any) -> bytes:
    """A figure as a file's bytes, the same for the same figure."""
    file = io.BytesIO()
    figure.savefig(file, format="png", dpi=_DPI, metadata={"Software": None})
    return file.getvalue()


# ---------------------------------------------------------------- plots of many flights


def plots(rows: Sequence[Row]) -> list[tuple[str, str, bytes]]:
    """(name, title, PNG) of what a campaign's rows look like."""
    found = [("success_time", "Success against time ratio", _success_time(rows))]
    if any(row.time_ratio is not None for row in rows):
        found.append(
            ("time", "Time ratio, share of flights", _shares(rows, "time_ratio", "time ratio"))
        )
        found.append(
            (
                "length",
                "Length / optimum, share of flights",
                _shares(rows, "length_ratio", "length / optimum"),
            )
        )
    found.append(
        ("clearance", "Least clearance, share of flights", _shares(rows, "clearance_m", "m"))
    )
    return found


def _shares(rows: Sequence[Row], column: str, label: str) -> bytes:
    """For each planner: which share of its flights has at most so much."""
    figure, axes = new_figure(size=(6.0, 3.6))
    for colour, (key, mine) in zip(cycle(_COLOURS), groups(rows), strict=False):
        found = sorted(value for row in mine if (value := getattr(row, column)) is not None)
        if found:
            share = np.arange(1, len(found) + 1) / len(mine)
            axes.step(
                found, 100.0 * share, where="post", color=colour, lw=1.4, label=_called(key, rows)
            )
    if column == "clearance_m":
        axes.axvline(BODY_RADIUS_M, color=VERMILION, lw=1.0, ls=":")
    axes.set_xlabel(label)
    axes.set_ylabel("% of flights")
    axes.set_ylim(0.0, 101.0)
    _finish(axes)
    return png(figure)


def _success_time(rows: Sequence[Row]) -> bytes:
    """Each planner as a point: up is safer and surer, left is faster."""
    figure, axes = new_figure(size=(6.0, 3.6))
    for colour, (key, mine) in zip(cycle(_COLOURS), groups(rows), strict=False):
        ratios = [row.time_ratio for row in mine if row.time_ratio is not None]
        success = estimated(mine, summary.success, summary.mean).value
        if ratios:
            axes.plot(np.mean(ratios), success, "o", color=colour, ms=8, label=_called(key, rows))
    axes.set_xlabel("time ratio, mean")
    axes.set_ylabel("success, %")
    axes.set_ylim(top=101.0)
    _finish(axes)
    return png(figure)


def _called(key: Key, rows: Sequence[Row]) -> str:
    """The planner, with sensors and response where there are several."""
    several = [len({getattr(row, name) for row in rows}) > 1 for name in ("sensors", "response")]
    return ", ".join((key[0], *(word for word, told in zip(key[1:], several, strict=True) if told)))


def _finish(axes: Any) -> None:
    axes.grid(visible=True, color=LOW, lw=0.5)
    handles, _ = axes.get_legend_handles_labels()
    if handles:
        axes.legend(fontsize=7, frameon=False, loc="best")
