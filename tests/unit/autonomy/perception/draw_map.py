"""Draws autonomy/perception/map.png: run `python -m tests.unit.autonomy.perception.draw_map`."""

import math
from pathlib import Path

import matplotlib as mpl
import numpy as np

mpl.use("Agg")

from matplotlib import pyplot as plt
from matplotlib.patches import Circle

from autonomy.config import MapConfig
from autonomy.geometry import Point, along
from autonomy.perception.obstacle_map import ObstacleMap
from hal.config import Fence
from tests.unit.autonomy.perception.rooms import Flight, Room

ROOM = Room(
    walls=(
        ((1.5, -1.6), (1.5, -0.35)),
        ((1.5, 0.35), (1.5, 1.6)),
        ((1.5, 0.35), (2.1, 0.35)),
        ((-0.5, -1.2), (0.6, -1.4)),
    ),
    discs=(((0.75, 0.55), 0.12), ((0.1, 0.75), 0.05), ((0.55, -0.55), 0.05)),
)
BODY_M = 0.15
HEADINGS_DEG = (20.0, 95.0, -50.0, 160.0)


def path(time_s: float) -> Point:
    """At rest for one turn, then north at 0.2 m/s."""
    return (0.2 * min(max(0.0, time_s - 1.6), 4.0), 0.0)


def main() -> None:
    """Scan the room with 2 cm wandering position and 1 cm + 1 % range noise, and draw the map."""
    obstacles = ObstacleMap(MapConfig(), BODY_M, Fence.rectangle((-1.0, 2.0), (-1.5, 1.5)))
    flight = Flight(ROOM, obstacles, path, noise=np.random.default_rng(3))
    flight.fly(5.6)
    here = path(flight.now_s)

    figure, axes = plt.subplots(figsize=(6.4, 6.0), dpi=110)
    seen = obstacles.seen_cells(flight.now_s)
    axes.scatter(seen[:, 1], seen[:, 0], s=11, marker="s", c="#cfe8d5", lw=0, label="seen free")
    for (n0, e0), (n1, e1) in ROOM.walls:
        axes.plot([e0, e1], [n0, n1], c="#999999", lw=3)
    for (n, e), radius in ROOM.discs:
        axes.add_patch(Circle((e, n), radius, color="#bbbbbb"))
    hits = obstacles.hits()
    axes.scatter(hits[:, 1], hits[:, 0], s=5, c="#b3261e", zorder=3, label="hits and edges")
    times = np.linspace(0.0, flight.now_s, 100)
    axes.plot([path(t)[1] for t in times], [path(t)[0] for t in times], c="#1f4e8c", lw=1)
    axes.add_patch(Circle((here[1], here[0]), BODY_M, fill=False, ec="#1f4e8c", lw=1.5))
    for heading_deg in HEADINGS_DEG:
        heading = math.radians(heading_deg)
        free = obstacles.free_distance_m((*here, -1.0), heading, 1.0, flight.now_s)
        end = along(here, heading, free)
        axes.annotate(
            "", xy=(end[1], end[0]), xytext=(here[1], here[0]),
            arrowprops={"arrowstyle": "->", "color": "#1f4e8c", "shrinkA": 0, "shrinkB": 0},
        )  # fmt: skip
        axes.add_patch(Circle((end[1], end[0]), BODY_M, fill=False, ec="#1f4e8c", ls=":"))
        axes.text(
            end[1], end[0] - BODY_M - 0.05, f"{free:.2f} m", fontsize=8, ha="center", va="center"
        )
    axes.set_aspect("equal")
    axes.set_xlim(-1.75, 1.75)
    axes.set_ylim(-1.1, 2.2)
    axes.set_xlabel("east, m")
    axes.set_ylabel("north, m")
    axes.legend(loc="lower right", fontsize=8)
    figure.tight_layout()
    target = Path(__file__).parents[4] / "autonomy" / "perception" / "map.png"
    figure.savefig(target)


if __name__ == "__main__":
    main()
