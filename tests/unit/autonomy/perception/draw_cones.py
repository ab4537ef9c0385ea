"""Draws autonomy/perception/cones.png: `python -m tests.unit.autonomy.perception.draw_cones`."""

from pathlib import Path

import matplotlib as mpl
import numpy as np

mpl.use("Agg")

from matplotlib import pyplot as plt
from matplotlib.axes import Axes
from matplotlib.patches import Circle

from autonomy.config import MapConfig
from autonomy.perception.obstacle_map import FloatArray, ObstacleMap
from hal.config import BeamsConfig, Fence, six_beams
from tests.unit.autonomy.perception.draw_map import BODY_M, ROOM, path
from tests.unit.autonomy.perception.rooms import Flight

HALF_ANGLE_DEG = 12.5
PANELS = (
    (0.05, "one reading of each beam"),
    (0.9, "54 degrees of the scan"),
    (2.1, "126 degrees: every direction was seen"),
    (5.6, "0.8 m farther on"),
)


def main() -> None:
    """Scan the room of map.png with wide beams, and draw the map at four moments."""
    mounts = tuple(m.model_copy(update={"half_angle_deg": HALF_ANGLE_DEG}) for m in six_beams())
    obstacles = ObstacleMap(MapConfig(), BODY_M, Fence.rectangle((-1.0, 2.0), (-1.5, 1.5)))
    noise = np.random.default_rng(3)
    flight = Flight(ROOM, obstacles, path, beams=BeamsConfig(mounts=mounts), noise=noise)
    figure, axes = plt.subplots(2, 2, figsize=(9.6, 9.0), dpi=90)
    for panel, (until_s, title) in zip(axes.flat, PANELS, strict=True):
        flight.fly(until_s - flight.now_s)
        draw(panel, obstacles, flight.now_s)
        panel.set_title(title, fontsize=10)
    axes[0, 0].legend(loc="lower right", fontsize=8, markerscale=2.5)
    figure.tight_layout()
    figure.savefig(Path(__file__).parents[4] / "autonomy" / "perception" / "cones.png")


def draw(panel: Axes, obstacles: ObstacleMap, now_s: float) -> None:
    """Truth, seen space, what is left of open arcs, and hits."""
    dots(panel, obstacles.seen_cells(now_s), "#cfe8d5", 7.0, "seen free")
    for (n0, e0), (n1, e1) in ROOM.walls:
        panel.plot([e0, e1], [n0, n1], c="#999999", lw=3)
    for (n, e), radius in ROOM.discs:
        panel.add_patch(Circle((e, n), radius, color="#bbbbbb"))
    arcs = obstacles.open_arcs()
    dots(panel, np.concatenate([np.empty((0, 2)), *arcs]), "#e08a00", 2.0, "arcs, still open")
    dots(panel, obstacles.hits(), "#b3261e", 5.0, "hits")
    north, east = path(now_s)
    panel.add_patch(Circle((east, north), BODY_M, fill=False, ec="#1f4e8c", lw=1.5))
    panel.set_aspect("equal")
    panel.set_xlim(-1.75, 1.75)
    panel.set_ylim(-1.1, 2.2)


def dots(panel: Axes, points: FloatArray, colour: str, size: float, label: str) -> None:
    """Points (n, 2) in north and east."""
    panel.scatter(points[:, 1], points[:, 0], s=size, marker="s", c=colour, lw=0, label=label)


if __name__ == "__main__":
    main()
