"""Floor plans: a PNG picture whose dark pixels are walls, and a sheet that says what it shows.

`hall.png` has its sheet beside it, `hall.yaml` (every key is a field of `Sheet`). Up is north, the
middle of the pixel `start_px` is the take-off point. The only door to Pillow.
"""

from pathlib import Path
from typing import Annotated

import numpy as np
import yaml
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError
from pydantic import Field, ValidationError

from hal.config import Fence, NonNegative, Positive
from hal.documents import Section, load_document
from hal.errors import DocumentError
from hal.sim.scenario import Box, Scenario
from tools.bench.rooms import OFF_THE_WALLS_M

PIXELS_MAX = 4_000_000
BOXES_MAX = 5000
_WHOLE = 1e-6

Pixel = tuple[Annotated[int, Field(ge=0)], Annotated[int, Field(ge=0)]]
Mask = NDArray[np.bool_]


class Sheet(Section):
    """What a floor plan's picture does not say by itself."""

    metres_per_pixel: Positive
    start_px: Pixel
    """(column, row) from the picture's upper left corner."""
    goal_px: Pixel
    dark_below: Annotated[int, Field(ge=1, le=255)] = 128
    """Pixels darker than this, of 255, are walls; what is transparent is free."""
    fence_inset_m: NonNegative = OFF_THE_WALLS_M
    """The vehicle's centre stays this far inside the picture's edges."""
    reachable: bool = True


def read(path: Path) -> Scenario:
    """The room of a floor plan. Raises DocumentError: file, what is wrong, what to do."""
    return _scenario(path, _dark_and_sheet(path))


def write(scenario: Scenario, path: Path, metres_per_pixel: float) -> None:
    """Draw a scenario's fence with everything solid in it: `path` and the sheet beside it.

    Heights are lost, and curved and slanting outlines get steps.
    """
    ring = np.array(scenario.fence.outline_ne_m)
    low, high = ring.min(axis=0) - OFF_THE_WALLS_M, ring.max(axis=0) + OFF_THE_WALLS_M
    # So that the take-off point is the middle of a pixel.
    first = np.ceil(-low / metres_per_pixel - 0.5 - _WHOLE).astype(int)
    rows, columns = first + 1 + np.ceil(high / metres_per_pixel - 0.5 - _WHOLE).astype(int)
    north = (np.arange(rows)[::-1] - first[0]) * metres_per_pixel
    east = (np.arange(columns) - first[1]) * metres_per_pixel
    dark = np.zeros((rows, columns), dtype=np.bool_)
    for obstacle in scenario.obstacles:
        dark |= np.array([[obstacle.distance_m(n, e) <= 0.0 for e in east] for n in north])
    Image.fromarray(np.where(dark, 0, 255).astype(np.uint8)).save(path)
    goal_n, goal_e = (round(x / metres_per_pixel) for x in scenario.goal_ne_m)
    sheet = {
        "metres_per_pixel": metres_per_pixel,
        "start_px": [int(first[1]), int(rows - 1 - first[0])],
        "goal_px": [int(first[1]) + goal_e, int(rows - 1 - first[0]) - goal_n],
        "reachable": scenario.reachable,
    }
    path.with_suffix(".yaml").write_text(yaml.safe_dump(sheet, sort_keys=False), encoding="utf-8")


def rectangles(dark: Mask) -> list[tuple[int, int, int, int]]:
    """Disjoint rectangles (row, column, rows, columns) that cover the dark pixels exactly."""
    found: list[tuple[int, int, int, int]] = []
    growing: dict[tuple[int, int], int] = {}
    for row in range(dark.shape[0] + 1):
        runs = _runs(dark[row]) if row < dark.shape[0] else set()
        for run in sorted(growing.keys() - runs):
            first = growing.pop(run)
            found.append((first, run[0], row - first, run[1] - run[0]))
        for run in runs - growing.keys():
            growing[run] = row
    return found


def _runs(row: Mask) -> set[tuple[int, int]]:
    """(first, after the last) of the stretches of dark pixels."""
    edges = np.flatnonzero(np.diff(np.concatenate(([False], row, [False])).astype(np.int8)))
    return {(int(a), int(b)) for a, b in edges.reshape(-1, 2)}


def _dark_and_sheet(path: Path) -> tuple[Mask, Sheet]:
    try:
        with Image.open(path) as picture:
            if picture.width * picture.height > PIXELS_MAX:
                raise DocumentError(
                    f"{path}: has {picture.width} x {picture.height} pixels; scale it down to "
                    f"{PIXELS_MAX:,} or fewer"
                )
            rgba = picture.convert("RGBA")
            paper = Image.new("RGBA", rgba.size, "white")
            grey = np.asarray(Image.alpha_composite(paper, rgba).convert("L"))
    except FileNotFoundError:
        raise DocumentError(f"{path}: there is no such file; check the path") from None
    except (OSError, UnidentifiedImageError, Image.DecompressionBombError) as error:
        raise DocumentError(
            f"{path}: is no picture that can be read ({error}); save the plan as PNG"
        ) from None
    sheet_path = path.with_suffix(".yaml")
    if not sheet_path.exists():
        raise DocumentError(
            f"{path}: has no sheet; write {sheet_path} with metres_per_pixel, start_px and "
            "goal_px ([column, row])"
        )
    sheet = load_document(sheet_path, Sheet)
    return grey < sheet.dark_below, sheet


def _scenario(path: Path, plan: tuple[Mask, Sheet]) -> Scenario:
    dark, sheet = plan
    rows, columns = dark.shape
    for key, (column, row) in (("start_px", sheet.start_px), ("goal_px", sheet.goal_px)):
        if column >= columns or row >= rows:
            raise DocumentError(
                f"{path.with_suffix('.yaml')}: {key} [{column}, {row}] lies outside the picture of "
                f"{columns} x {rows} pixels: give [column, row] from its upper left corner"
            )
    found = rectangles(dark)
    if len(found) > BOXES_MAX:
        raise DocumentError(
            f"{path}: its dark pixels make {len(found)} boxes; draw it coarser or cleaner, "
            f"{BOXES_MAX} are the most"
        )
    m, (start_column, start_row) = sheet.metres_per_pixel, sheet.start_px
    low = (m * (start_row + 0.5 - rows), m * (-0.5 - start_column))
    high = (low[0] + m * rows, low[1] + m * columns)
    inset_m = sheet.fence_inset_m
    try:
        return Scenario(
            name=path.stem,
            obstacles=tuple(
                Box(
                    centre_ne_m=(
                        m * (start_row + 0.5 - row - 0.5 * height),
                        m * (column + 0.5 * width - start_column - 0.5),
                    ),
                    size_m=(m * height, m * width),
                )
                for row, column, height, width in found
            ),
            goal_ne_m=(
                m * (start_row - sheet.goal_px[1]),
                m * (sheet.goal_px[0] - start_column),
            ),
            fence=Fence.rectangle(
                (low[0] + inset_m, high[0] - inset_m), (low[1] + inset_m, high[1] - inset_m)
            ),
            reachable=sheet.reachable,
        )
    except ValidationError as error:
        said = error.errors()[0]["msg"].removeprefix("Value error, ")
        raise DocumentError(
            f"{path.with_suffix('.yaml')}: {said} (start_px, goal_px, metres_per_pixel)"
        ) from None
