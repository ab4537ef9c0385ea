"""The way of the data, drawn for the README: `python -m tools.plots_flow` writes autonomy/flow.svg.

An SVG with a ground of its own, that follows the reader's choice of light or dark.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple
from xml.sax.saxutils import escape

PICTURE = Path(__file__).parents[1] / "autonomy" / "flow.svg"
WIDTH, HEIGHT = 1000, 452

_STYLE = """
  .ground { fill: #ffffff; stroke: #d0d7de }
  text { font: 13px system-ui, -apple-system, "Segoe UI", "DejaVu Sans", sans-serif; fill: #57606a }
  .title { font-weight: 600; font-size: 15px; fill: #1f2328 }
  .hal { fill: #e3f4ee; stroke: #2f8f6f }
  .pure { fill: #eaf1fd; stroke: #3b6fc9 }
  .part { fill: #ffffff; stroke: #a9c2ec }
  .guard { fill: #fdecea; stroke: #c4483a }
  .other { fill: #f6f8fa; stroke: #8c959f }
  .way { fill: none; stroke: #57606a; stroke-width: 1.6 }
  .tip { fill: #57606a }
  @media (prefers-color-scheme: dark) {
    .ground { fill: #0d1117; stroke: #30363d }
    text { fill: #9aa4af }
    .title { fill: #e6edf3 }
    .hal { fill: #10302a; stroke: #3fb08c }
    .pure { fill: #13233f; stroke: #5f92e8 }
    .part { fill: #0d1117; stroke: #35558c }
    .guard { fill: #3a1715; stroke: #e0695b }
    .other { fill: #161b22; stroke: #6e7681 }
    .way { stroke: #9aa4af }
    .tip { fill: #9aa4af }
  }"""


class Box(NamedTuple):
    """A part: what it is called, and what it does in a line or two below."""

    x: float
    y: float
    width: float
    height: float
    kind: str
    title: str
    says: tuple[str, ...] = ()


class Way(NamedTuple):
    """An arrow through corners, and what goes along it."""

    corners: tuple[tuple[float, float], ...]
    says: str = ""
    at: tuple[float, float] = (0.0, 0.0)


_PARTS = (
    ("estimation", "readings to fused state: Kalman, gated"),
    ("perception", "ranges to hits and seen-free space"),
    ("t3drm", "hits to classes, sphere, hyperbola"),
    ("guidance", "path to velocity (Table 2), scan"),
    ("mission", "Algorithm 2, faults to responses"),
)

BOXES = (
    Box(20, 50, 170, 62, "hal", "range beams", ("MAVLink, I2C, virtual",)),
    Box(20, 126, 170, 62, "hal", "GNSS", ("the autopilot's, or serial",)),
    Box(20, 202, 170, 62, "hal", "vehicle", ("position, attitude, status",)),
    Box(238, 50, 130, 214, "other", "Inputs", ("the newest value", "of each, no queue")),
    Box(418, 20, 304, 284, "pure", "Pilot.step", ("pure: no clock, no chance, no I/O",)),
    *(
        Box(430, 72 + 45 * row, 280, 39, "part", name, (says,))
        for row, (name, says) in enumerate(_PARTS)
    ),
    Box(790, 50, 194, 62, "guard", "guard", ("the last word on setpoints",)),
    Box(790, 150, 194, 62, "hal", "MAVSDK", ("repeats it every 50 ms",)),
    Box(790, 250, 194, 62, "other", "PX4", ("flies; its own failsafes",)),
    Box(218, 340, 170, 62, "other", "page, commands", ("goals, stop, hold, land",)),
    Box(418, 340, 142, 62, "other", "flight log", ("replays bit for bit",)),
    Box(580, 340, 142, 62, "guard", "deadman", ("0.25 s without a tick",)),
)

WAYS = (
    Way(((190, 81), (232, 81))),
    Way(((190, 157), (232, 157))),
    Way(((190, 233), (232, 233))),
    Way(((303, 340), (303, 270))),
    Way(((368, 157), (412, 157))),
    Way(((722, 81), (784, 81)), "Decision", (755, 71)),
    Way(((887, 112), (887, 144)), "setpoint", (920, 133)),
    Way(((887, 212), (887, 244)), "MAVLink", (920, 233)),
    Way(((489, 304), (489, 334)), "all of it", (520, 324)),
    Way(((651, 304), (651, 334)), "feeds", (675, 324)),
    Way(((722, 371), (756, 371), (756, 181), (784, 181)), "stop, Hold", (798, 364)),
    Way(((887, 312), (887, 426), (105, 426), (105, 270)), "telemetry", (145, 418)),
)


def _box(box: Box) -> str:
    row = box.kind == "part"
    middle = box.x + box.width / 2
    lines = [
        _rect(box.kind, box.x, box.y, box.width, box.height),
    ]
    if row:
        lines.append(_text(box.x + 10, box.y + 16, box.title, "title", "start"))
        lines.append(_text(box.x + 10, box.y + 32, box.says[0], "", "start"))
        return "\n".join(lines)
    top = box.y + 22 if box.kind == "pure" else box.y + box.height / 2 - 9 * len(box.says) + 4
    lines.append(_text(middle, top, box.title, "title"))
    for number, said in enumerate(box.says, 1):
        lines.append(_text(middle, top + 19 * number, said, ""))
    return "\n".join(lines)


def _rect(kind: str, x: float, y: float, width: float, height: float) -> str:
    place = f'x="{x:g}" y="{y:g}" width="{width:g}" height="{height:g}"'
    return f'<rect class="{kind}" {place} rx="7"/>'


def _text(x: float, y: float, words: str, kind: str, anchor: str = "middle") -> str:
    return f'<text class="{kind}" x="{x:g}" y="{y:g}" text-anchor="{anchor}">{escape(words)}</text>'


def _way(way: Way) -> str:
    points = " ".join(f"{x:g},{y:g}" for x, y in way.corners)
    drawn = f'<polyline class="way" points="{points}" marker-end="url(#tip)"/>'
    return drawn + ("\n" + _text(*way.at, way.says, "") if way.says else "")


def picture() -> str:
    """The drawing as SVG."""
    tip = (
        '<defs><marker id="tip" viewBox="0 0 8 8" refX="4" refY="4" markerWidth="7" '
        'markerHeight="7" orient="auto"><path class="tip" d="M0,0 L8,4 L0,8 z"/></marker></defs>'
    )
    words = "Drivers fill Inputs; Pilot.step decides; the guard checks; MAVSDK tells PX4."
    return "\n".join(
        (
            f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {WIDTH} {HEIGHT}" role="img">',
            f"<title>{escape(words)}</title>",
            f"<style>{_STYLE}\n</style>",
            tip,
            _rect("ground", 0.5, 0.5, WIDTH - 1, HEIGHT - 1),
            *(_box(box) for box in BOXES),
            *(_way(way) for way in WAYS),
            "</svg>\n",
        )
    )


def main(arguments: Sequence[str] | None = None) -> None:
    """Write it."""
    argparse.ArgumentParser(description=__doc__).parse_args(arguments)
    PICTURE.write_text(picture(), encoding="utf-8")


if __name__ == "__main__":
    main()
