"""Draw the pictures of autonomy/t3drm/README.md: python -m tools.plots_t3drm [DIRECTORY].

Everything shown is computed by the package; nothing is drawn by hand.
"""

import math
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from numpy.typing import NDArray

from autonomy.config import Config, PlannerConfig
from autonomy.geometry import Point
from autonomy.model import Command, LegKind, MissionState, Plan
from autonomy.simulation import Simulation, goal_of, with_scenario
from autonomy.t3drm.classification import classify
from autonomy.t3drm.hyperbolic import fly_by
from autonomy.t3drm.planner import Planner
from autonomy.t3drm.speed import free_volume_m3, volume_rate_per_s
from autonomy.t3drm.spherical import Arc, Route, shortest_path
from hal.config import Fence
from hal.sim.scenario import Wall, load_scenario

mpl.use("Agg")
from matplotlib import pyplot as plt
from matplotlib.patches import Circle

Floats = NDArray[np.float64]
HERE = Path(__file__).resolve().parent.parent / "autonomy" / "t3drm"
BODY_M = 0.15
INK, SOFT, PATH, OTHER, GOOD = "#24292f", "#c9d1d9", "#0969da", "#bc4c00", "#1a7f37"
LEVELS = ((OTHER, "#f6f8fa"), ("#8250df", "#eaeef2"), (GOOD, "#dde3e9"), (PATH, "#cdd5dd"))
"""From comfort to the floor: the path's colour and the keep-out's."""
DOTS_PER_INCH = 90
RANGE_M = 1.0
"""Beyond the sensors' range the free sphere does not grow."""
FLOWN = (
    MissionState.CRUISE,
    MissionState.STOP,
    MissionState.DETECT,
    MissionState.REPLAN,
    MissionState.FOLLOW,
)


def tangent_route(axes: Any) -> None:
    """Spherical navigation: the shortest path among discs, and the discs that decided it."""
    rng = np.random.default_rng(11)
    centres, radii = rng.uniform(0.4, 5.6, (20, 2)), rng.uniform(0.28, 0.55, 20)
    start, goal = (-0.2, 0.2), (6.2, 5.9)
    route = shortest_path(start, goal, centres, radii)
    if not isinstance(route, Route):
        raise TypeError("the map of the picture has no route: choose another seed")
    for k, (centre, radius) in enumerate(zip(centres.tolist(), radii.tolist(), strict=True)):
        decided = k in route.active
        face = "#ddf4ff" if decided else "#f6f8fa"
        edge = PATH if decided else SOFT
        axes.add_patch(Circle((centre[1], centre[0]), radius, facecolor=face, edgecolor=edge))
    for piece in route.pieces:
        points = piece.polyline(1e-4) if isinstance(piece, Arc) else (piece.start, piece.end)
        _line(axes, points, OTHER if isinstance(piece, Arc) else PATH, 2.2)
    _ends(axes, start, goal)
    _titled(axes, f"Exact tangent route: {route.length_m:.2f} m, {len(route.active)} of 20 discs")


def fly_by_conic(axes: Any) -> None:
    """Hyperbolic navigation: the conic past a wall's end against tangent, arc, tangent."""
    wall = np.array([(2.0, -0.15 + 0.025 * k) for k in range(80)])
    start, goal, vertex = (0.4, 0.25), (3.8, 0.1), (2.0, -0.15)
    fence = Fence.rectangle((-1.0, 5.0), (-3.0, 3.0))
    config = PlannerConfig(levels=1)
    keep_out = BODY_M + config.comfortable_clearance_m
    tangents = Planner(config.model_copy(update={"hyperbola": "never"}), BODY_M, fence)
    plan = tangents.plan(start, goal, wall)
    conic = fly_by(start, goal, vertex, keep_out, 1)
    if not isinstance(plan, Plan) or conic is None:
        raise TypeError("the wall of the picture has no way round")
    for n, e in wall[::8].tolist():
        axes.add_patch(Circle((e, n), keep_out, facecolor="#f6f8fa", edgecolor="none"))
    axes.add_patch(
        Circle((vertex[1], vertex[0]), keep_out, fill=False, edgecolor=INK, linestyle=":")
    )
    axes.plot(wall[:, 1], wall[:, 0], ".", color=INK, markersize=3)
    _line(axes, plan.points, OTHER, 1.6, label=f"tangent, arc, tangent: {plan.length_m:.3f} m")
    label = f"conic, e = {conic.eccentricity:.1f}: {conic.length_m:.3f} m"
    _line(axes, conic.points, PATH, 2.2, label=label)
    axes.plot(conic.closest[1], conic.closest[0], "o", color=GOOD, markersize=6)
    axes.annotate("P (periapsis)", (conic.closest[1], conic.closest[0]), (-1.15, 2.05), color=GOOD)
    axes.annotate("V", (vertex[1], vertex[0]), (vertex[1] + 0.06, vertex[0] + 0.09), color=INK)
    _ends(axes, start, goal)
    axes.set_xlim(-1.3, 2.3)
    axes.legend(loc="upper right", fontsize=8, frameon=False)
    bend = conic.curvature_radius_m / keep_out
    _titled(axes, f"Fly-by at the wall's end: bends {bend:.1f} times less than the arc")


def persistence_diagram(axes: Any) -> None:
    """Classification: death radii of the hits' components, and what lives at the keep-out."""
    rng = np.random.default_rng(4)
    turn = np.linspace(0.0, math.tau, 14, endpoint=False)
    post = np.stack((1.0 + 0.12 * np.cos(turn), 1.0 + 0.12 * np.sin(turn)), axis=1)
    wall = np.stack((np.linspace(2.0, 4.5, 60), np.full(60, 3.2)), axis=1)
    single = np.array([(3.4, 1.2), (1.3, 2.4)])
    hits = np.concatenate((post, wall, single)) + rng.normal(0.0, 0.008, (76, 2))
    keep_out = BODY_M + PlannerConfig().comfortable_clearance_m
    found = classify(hits, keep_out, PlannerConfig())
    deaths = [death for death in found.persistence if math.isfinite(death)]
    colours = [GOOD if death >= keep_out else SOFT for death in deaths]
    axes.barh(range(len(deaths)), deaths, color=colours, height=1.0)
    axes.barh([len(deaths)], [1.2], color=GOOD, height=1.0)
    axes.axvline(keep_out, color=OTHER, linewidth=1.5)
    axes.annotate("keep-out radius", (keep_out + 0.015, 4), color=OTHER)
    axes.annotate("the last one never dies", (0.86, len(deaths) - 5), color=GOOD)
    axes.set_xlabel("radius at which a component merges (m)")
    axes.set_ylabel("components, one per hit at radius 0")
    axes.set_xlim(0.0, 1.2)
    inset = axes.inset_axes((0.5, 0.14, 0.47, 0.56))
    for obstacle in found.obstacles:
        colour = OTHER if obstacle.kind.value == "continuous" else PATH
        rows = np.array(obstacle.hits)
        inset.plot(rows[:, 1], rows[:, 0], ".", color=colour, markersize=4)
    inset.annotate("discrete", (1.15, 0.62), color=PATH, fontsize=9)
    inset.annotate("continuous", (2.15, 4.62), color=OTHER, fontsize=9)
    inset.set_xlim(0.3, 3.9)
    inset.set_ylim(0.3, 5.1)
    inset.set_xticks([])
    inset.set_yticks([])
    count = len(found.obstacles)
    axes.set_title(
        f"Persistence: {len(hits)} hits are {count} obstacles, {found.environment.value}"
    )


def ricci_levels(axes: Any) -> None:
    """The same door at the radii of the Ricci flow: which level passes, at which cost."""
    fence = Fence.rectangle((-1.0, 5.0), (-1.6, 2.6))
    east = [*np.linspace(-0.9, 0.285, 41), *np.linspace(0.715, 1.5, 27)]
    door = np.array([(2.0, e) for e in east])
    start, goal = (0.5, 0.5), (3.5, 0.5)
    keep_outs = Planner(PlannerConfig(), BODY_M, fence).keep_outs_m
    axes.plot(door[:, 1], door[:, 0], ".", color=INK, markersize=4, zorder=3)
    for number, (keep_out, (colour, face)) in enumerate(zip(keep_outs, LEVELS, strict=True)):
        for n, e in door.tolist():
            ring = Circle((e, n), keep_out, facecolor=face, edgecolor="none", zorder=0)
            axes.add_patch(ring)
        clearance = keep_out - BODY_M
        config = PlannerConfig(
            levels=1, comfortable_clearance_m=clearance, hard_clearance_m=min(clearance, 0.05)
        )
        plan = Planner(config, BODY_M, fence).plan(start, goal, door)
        if isinstance(plan, Plan):
            cost = plan.length_m * PlannerConfig().level_penalty ** number
            name = (
                "hyperbola" if plan.legs[0].kind is LegKind.HYPERBOLA else plan.legs[0].kind.value
            )
            label = f"r = {keep_out:.3f} m: {plan.length_m:.2f} m, cost {cost:.2f} ({name})"
            _line(axes, plan.points, colour, 2.0, label=label)
    _ends(axes, start, goal)
    axes.legend(loc="upper center", fontsize=8, frameon=False)
    axes.set_xlim(-2.0, 2.6)
    axes.set_ylim(0.1, 4.6)
    _titled(axes, "Levels of the flow: a door of 0.43 m opens at the hard floor")


def speed_rule(axes: Any) -> None:
    """Table 2 over a flight through a narrow door: free sphere, sign of its rate, speed limit."""
    room = load_scenario("door")
    door = (
        Wall(from_ne_m=(2.3, -1.5), to_ne_m=(2.3, 0.55)),
        Wall(from_ne_m=(2.3, 1.05), to_ne_m=(2.3, 4.5)),
    )
    kept = {"obstacles": (*room.obstacles[:-2], *door), "goal_ne_m": (4.2, 1.0)}
    scenario = room.model_copy(update=kept)
    config = with_scenario(Config(), scenario)
    rows: list[tuple[float, float, float, float]] = []

    def note(_: Simulation, command: Command) -> None:
        decision = command.decision
        if decision.fused is None or decision.state not in FLOWN:
            return
        speed = math.hypot(*decision.fused.velocity_ned_m_s[:2])
        row = (decision.now_s, decision.clearance_m, decision.speed_limit_m_s, speed)
        rows.append(row)

    Simulation(scenario, config, (goal_of(scenario, config),), seed=1).run(on_tick=note)
    table = np.array(rows)
    now, clearance = table[:, 0] - table[0, 0], np.minimum(table[:, 1], RANGE_M)
    volume = np.array([free_volume_m3(c, RANGE_M) for c in clearance])
    axes.fill_between(now, volume / volume.max(), color="#ddf4ff", label="V, of the full sphere")
    axes.plot(now, table[:, 2] / 0.2, color=PATH, linewidth=1.6, label="speed limit / 0.2 m/s")
    axes.plot(now, table[:, 3] / 0.2, color=INK, linewidth=0.7, label="speed flown / 0.2 m/s")
    dead_band = config.guidance.volume_rate_dead_band
    rates = _rates_per_s(now, clearance)
    for sign, colour, name in ((1, GOOD, "dV > 0"), (-1, OTHER, "dV < 0")):
        at = now[(sign * rates > dead_band)]
        axes.plot(at, np.full(at.shape, 1.12), "|", color=colour, markersize=9, label=name)
    axes.set_ylim(0.0, 1.6)
    axes.set_yticks([0.0, 0.5, 1.0])
    axes.set_xlabel("time in CRUISE, STOP, DETECT, REPLAN and FOLLOW (s)")
    axes.legend(loc="upper center", fontsize=8, frameon=False, ncols=3)
    axes.set_title("Table 2 through a door of 0.5 m: the speed falls with the free sphere")


def _rates_per_s(now: Floats, clearance: Floats) -> Floats:
    """dV/dt of the free sphere over its full volume, from clearances half a second apart."""
    lag = 10
    rates = np.zeros_like(now)
    for k in range(lag, now.shape[0]):
        rate = (clearance[k] - clearance[k - lag]) / max(now[k] - now[k - lag], 1e-9)
        rates[k] = volume_rate_per_s(float(clearance[k]), float(rate), RANGE_M)
    return rates


PICTURES: dict[str, Callable[[Any], None]] = {
    "tangents": tangent_route,
    "fly_by": fly_by_conic,
    "persistence": persistence_diagram,
    "levels": ricci_levels,
    "speed": speed_rule,
}


def _line(
    axes: Any, points: tuple[Point, ...], colour: str, width: float, label: str | None = None
) -> None:
    rows = np.array(points)
    axes.plot(rows[:, 1], rows[:, 0], color=colour, linewidth=width, label=label, zorder=4)


def _ends(axes: Any, start: Point, goal: Point) -> None:
    for name, point in (("D", start), ("G", goal)):
        axes.plot(point[1], point[0], "o", color=INK, markersize=5, zorder=5)
        axes.annotate(name, (point[1], point[0]), (7, -3), textcoords="offset points", color=INK)


def _titled(axes: Any, title: str) -> None:
    axes.set_title(title, fontsize=10)
    axes.set_aspect("equal")
    axes.set_xlabel("east (m)")
    axes.set_ylabel("north (m)")


def main(directory: Path) -> None:
    """Write every picture as a PNG into `directory`."""
    plt.rcParams.update(
        {"font.size": 9, "axes.spines.top": False, "axes.spines.right": False, "axes.titlesize": 10}
    )
    for name, draw in PICTURES.items():
        figure, axes = plt.subplots(figsize=(6.0, 5.0), layout="constrained")
        draw(axes)
        figure.savefig(directory / f"{name}.png", dpi=DOTS_PER_INCH)
        plt.close(figure)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else HERE)
