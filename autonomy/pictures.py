"""Pictures of scenarios, plans and flights, seen from above: east to the right, north up.

matplotlib (the extra `log`) is imported only when something is drawn, and never opens a window.
"""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from autonomy.errors import BadInput
from autonomy.model import NoPlan, ObstacleKind, Plan
from hal.config import Fence
from hal.sim.scenario import Box, Disc, Mover, Scenario, Wall

PointNE = tuple[float, float]

# Okabe and Ito's palette: told apart with every common colour blindness, and in grey.
BLUE, ORANGE, GREEN, VERMILION = "#0072b2", "#e69f00", "#009e73", "#d55e00"
PURPLE, SKY, INK, PAPER = "#cc79a7", "#56b4e9", "#24292f", "#ffffff"
SOLID, SOLID_EDGE, LOW, FLOOR = "#8b949e", "#57606a", "#d0d7de", "#f6f8fa"

LEG_STYLE: Mapping[str, tuple[str, str]] = {
    "straight": (BLUE, "-"),
    "tangent": (SKY, "-"),
    "arc": (GREEN, "-"),
    "hyperbola": (PURPLE, "-"),
    "geodesic": (ORANGE, "-"),
    "rejected": ("#afb8c1", "--"),
}
HEIGHTS = (ORANGE, SKY, PURPLE, GREEN)
BEAM_REACH_M = 1.0


def draw_scenario(axes: Any, scenario: Scenario, *, legend: bool = True) -> None:
    """The obstacles, fence, take-off point and goal of a scenario on matplotlib `axes`."""
    from matplotlib.patches import Circle, Polygon

    _prepare(axes)
    fence = [_en(point) for point in scenario.fence.outline_ne_m]
    axes.add_patch(
        Polygon(fence, closed=True, fill=False, ec=GREEN, ls=(0, (4, 3)), lw=1.1, zorder=2)
    )
    for obstacle in scenario.obstacles:
        for style in _solid_styles(obstacle):
            if isinstance(obstacle, Disc):
                axes.add_patch(Circle(_en(obstacle.centre_ne_m), obstacle.radius_m, **style))
            else:
                corners = [_en(corner) for corner in obstacle.footprint.corners()]
                axes.add_patch(Polygon(corners, closed=True, **style))
    for mover in scenario.movers:
        _draw_mover(axes, mover)
    _draw_start(axes, scenario)
    _draw_goal(axes, scenario.goal_ne_m, reachable=scenario.reachable)
    _frame(axes, scenario)
    if legend:
        _legend(axes, scenario)


def _draw_mover(axes: Any, mover: Mover) -> None:
    """Where it begins, and where it goes: its path dotted, the area that it wanders in tinted."""
    from matplotlib.patches import Circle, Rectangle

    path = mover.path_ne_m
    ring = (*path, path[0]) if mover.then == "circle" and mover.wander is None else path
    axes.plot(*_columns(ring), color=PURPLE, ls=(0, (1, 1.5)), lw=1.4, zorder=3.6)
    if mover.wander is not None:
        (n0, e0), (n1, e1) = mover.wander.low_ne_m, mover.wander.high_ne_m
        axes.add_patch(
            Rectangle((e0, n0), e1 - e0, n1 - n0, fc=PURPLE, ec="none", alpha=0.12, zorder=2.1)
        )
    axes.add_patch(
        Circle(_en(path[0]), mover.radius_m, fc=PURPLE, ec=PAPER, lw=1.0, alpha=0.9, zorder=5.5)
    )


def draw_trails(
    axes: Any,
    trails: Sequence[tuple[float, Sequence[PointNE]]],
    *,
    every: int = 1,
    colour: str = PURPLE,
) -> None:
    """Where movers have been: (radius_m, places oldest first) each, paler the longer ago; the last
    place is drawn full. A disc is drawn at every `every`-th place.
    """
    from matplotlib.patches import Circle

    for radius_m, places in trails:
        shown = list(places[::-1][::every])[::-1]
        for number, place in enumerate(shown, start=1):
            last = number == len(shown)
            alpha = 0.9 if last else 0.08 + 0.32 * number / len(shown)
            axes.add_patch(
                Circle(_en(place), radius_m, fc=colour, ec=PAPER, lw=0.8, alpha=alpha, zorder=4.4)
            )
        if len(places) > 1:
            axes.plot(*_columns(places), color=colour, lw=1.0, alpha=0.6, zorder=4.45)


def draw_flight(
    axes: Any,
    flown: Sequence[PointNE],
    *,
    legs: Sequence[tuple[str, Sequence[PointNE]]] = (),
    hits: Sequence[PointNE] = (),
    discs: Sequence[tuple[PointNE, float]] = (),
    stops: Sequence[PointNE] = (),
    heights: Sequence[tuple[float, Sequence[PointNE]]] = (),
    start: PointNE | None = None,
    goal: PointNE | None = None,
) -> None:
    """A flight on matplotlib `axes`, over a scenario or alone; every point is (north, east).

    `flown` is the path flown; `legs` are (kind, polyline) with the kinds of LEG_STYLE, others are
    drawn as straight ones; `hits` are range returns; `discs` are (centre, radius_m) of keep-outs;
    `stops` are where the vehicle stopped to look; `heights` are stretches (height_m, polyline) that
    were flown over or under something.
    """
    from matplotlib.patches import Circle

    _prepare(axes)
    for centre, radius_m in discs:
        axes.add_patch(
            Circle(_en(centre), radius_m, fc=VERMILION, alpha=0.10, ec="none", zorder=2.2)
        )
        axes.add_patch(
            Circle(_en(centre), radius_m, fill=False, ec=VERMILION, lw=0.8, ls=":", zorder=2.3)
        )
    for kind, points in legs:
        colour, line = LEG_STYLE.get(kind, LEG_STYLE["straight"])
        below = 3.5 if kind == "rejected" else 4.0
        axes.plot(*_columns(points), color=colour, ls=line, lw=1.6, zorder=below, label=kind)
    if hits:
        axes.scatter(*_columns(hits), s=6, color=VERMILION, lw=0, zorder=4.5, label="hits")
    for number, (height_m, points) in enumerate(heights):
        style = {"color": HEIGHTS[number % len(HEIGHTS)], "lw": 9.0, "alpha": 0.5, "zorder": 4.6}
        axes.plot(*_columns(points), label=f"at {height_m:.2f} m", **style)
    if flown:
        axes.plot(*_columns(flown), color=PAPER, lw=3.4, zorder=4.8, solid_capstyle="round")
        axes.plot(
            *_columns(flown),
            color=INK,
            lw=1.6,
            zorder=5,
            solid_capstyle="round",
            label="path flown",
        )
    if stops:
        axes.scatter(
            *_columns(stops),
            marker="s",
            s=34,
            fc=PAPER,
            ec=VERMILION,
            lw=1.4,
            zorder=6,
            label="stop",
        )
    if start is not None:
        axes.plot(*_columns([start]), "o", color=BLUE, ms=7, mec=PAPER, zorder=6)
    if goal is not None:
        _draw_goal(axes, goal, reachable=True)
    _label_once(axes)


def save_scenario(scenario: Scenario, path: Path) -> None:
    """Draw a scenario into a PNG file; raises BadInput when matplotlib is not installed."""
    figure, axes = new_figure()
    draw_scenario(axes, scenario)
    _title(axes, scenario.title)
    _save(figure, path)


def save_plan(
    scenario: Scenario, goal: PointNE, plan: Plan | NoPlan, hits: Sequence[PointNE], path: Path
) -> None:
    """Draw what was planned in a scenario into a PNG file.

    Legs by their kind, rejected candidates dashed, keep-out discs round what the planner took for
    discrete; without a plan the hits that bar the way. Raises BadInput when matplotlib is not
    installed or the file cannot be written.
    """
    figure, axes = new_figure()
    draw_scenario(axes, scenario.model_copy(update={"goal_ne_m": goal}), legend=False)
    if isinstance(plan, Plan):
        discs = [
            (obstacle.centre, obstacle.radius_m + plan.keep_out_m)
            for obstacle in plan.obstacles
            if obstacle.kind is ObstacleKind.DISCRETE
        ]
        legs = [(leg.kind.value, leg.points) for leg in plan.legs]
        legs += [("rejected", points) for points in plan.rejected]
        draw_flight(axes, (), legs=legs, hits=hits, discs=discs)
        _title(axes, f"{scenario.title}: {plan.length_m:.2f} m, {plan.environment.value}")
    else:
        draw_flight(axes, (), hits=plan.evidence)
        _title(axes, f"{scenario.title}: no way")
    _save(figure, path)


def save_flight(
    path: Path,
    *,
    scenario: Scenario | None,
    fence: Fence,
    flown: Sequence[PointNE],
    legs: Sequence[tuple[str, Sequence[PointNE]]],
    hits: Sequence[PointNE],
    stops: Sequence[PointNE],
    goal: PointNE,
    title: str,
    heights: Sequence[tuple[float, Sequence[PointNE]]] = (),
) -> None:
    """Draw a flight into a PNG file: over its scenario, or over the fence where there was none.

    `legs` are those of every plan, the last drawn on top; `stops` are marked, and so are
    `heights`, the stretches (height_m, polyline) flown over or under something. Raises BadInput
    when matplotlib is not installed or the file cannot be written.
    """
    world = scenario or Scenario(name="flight", title="Flight", goal_ne_m=goal, fence=fence)
    figure, axes = new_figure()
    draw_scenario(axes, world.model_copy(update={"goal_ne_m": goal}), legend=False)
    draw_flight(axes, flown, legs=legs, hits=hits, stops=stops, heights=heights)
    _title(axes, f"{world.title}: {title}")
    _save(figure, path)


def _title(axes: Any, text: str) -> None:
    axes.set_title(text, loc="left", fontsize=11, fontweight="bold", color=INK, pad=8)


def _save(figure: Any, path: Path) -> None:
    try:
        # "tight": with equal scales on both axes the title may reach beyond the laid-out figure.
        figure.savefig(
            path,
            dpi=110,
            facecolor=PAPER,
            bbox_inches="tight",
            pad_inches=0.12,
            metadata={"Software": None},
        )
    except OSError as error:
        raise BadInput(f"{path}: cannot be written ({error.strerror})") from None
    except ValueError as error:  # the file's suffix names a format that matplotlib does not know
        raise BadInput(f"{path}: {str(error).splitlines()[0]}; end the name in .png") from None


def new_figure(rows: int = 1, size: tuple[float, float] = (5.8, 6.6)) -> tuple[Any, Any]:
    """A figure that no window shows, with its axes (several below one another: an array of them).

    Raises BadInput when matplotlib is not installed.
    """
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError:
        raise BadInput(
            "pictures need matplotlib; install it with: pip install 'autonomy[log]'"
        ) from None

    figure = Figure(figsize=size, layout="constrained")
    FigureCanvasAgg(figure)
    return figure, figure.subplots(rows, sharex=True)


def _solid_styles(obstacle: Disc | Box | Wall) -> tuple[dict[str, Any], ...]:
    """How an obstacle is painted, one style per coat: walls that meet become one outline."""
    if obstacle.height_m is not None or obstacle.base_m > 0.0:
        return ({"fc": LOW, "ec": SOLID_EDGE, "lw": 0.8, "hatch": "////", "zorder": 3.2},)
    return (
        {"fc": SOLID_EDGE, "ec": SOLID_EDGE, "lw": 1.6, "zorder": 3.0},
        {"fc": SOLID, "ec": "none", "lw": 0.0, "zorder": 3.1},
    )


def _prepare(axes: Any) -> None:
    axes.set_aspect("equal")
    axes.set_facecolor(FLOOR)
    axes.set_axisbelow(True)
    axes.grid(visible=True, color=LOW, lw=0.5)
    axes.tick_params(length=0, labelsize=8, colors=SOLID_EDGE)
    axes.set_xlabel("east, m", fontsize=9, color=SOLID_EDGE)
    axes.set_ylabel("north, m", fontsize=9, color=SOLID_EDGE)
    for spine in axes.spines.values():
        spine.set_visible(False)


def _frame(axes: Any, scenario: Scenario) -> None:
    """Show everything there is, with whole metres on both axes."""
    points = [*scenario.fence.outline_ne_m, (0.0, 0.0), scenario.goal_ne_m]
    for obstacle in scenario.obstacles:
        if isinstance(obstacle, Disc):
            (n, e), r = obstacle.centre_ne_m, obstacle.radius_m
            points += [(n - r, e - r), (n + r, e + r)]
        else:
            points += obstacle.footprint.corners()
    east, north = _columns(points)
    margin = 0.15
    axes.set_xlim(min(east) - margin, max(east) + margin)
    axes.set_ylim(min(north) - margin, max(north) + margin)
    step = max(1, round((max(east) - min(east)) / 8))
    axes.set_xticks(range(math.ceil(min(east)), math.floor(max(east)) + 1, step))
    axes.set_yticks(range(math.ceil(min(north)), math.floor(max(north)) + 1, step))


def _draw_start(axes: Any, scenario: Scenario) -> None:
    """The vehicle at its true size, a tick for its nose, and how far its beams see."""
    from matplotlib.patches import Circle

    yaw, radius = math.radians(scenario.start_yaw_deg), scenario.vehicle.body_radius_m
    for quarter in range(4):
        n, e = (math.cos(yaw + quarter * math.pi / 2.0), math.sin(yaw + quarter * math.pi / 2.0))
        beam = [(radius * n, radius * e), (BEAM_REACH_M * n, BEAM_REACH_M * e)]
        axes.plot(*_columns(beam), color=BLUE, lw=1.0, ls=(0, (1, 2)), zorder=3.5)
    axes.plot(
        *_columns([(0.0, 0.0), scenario.goal_ne_m]), color=BLUE, lw=0.8, alpha=0.45, zorder=2.5
    )
    axes.add_patch(Circle((0.0, 0.0), radius, fc=BLUE, ec=PAPER, lw=1.0, zorder=6))
    nose = (radius * math.cos(yaw), radius * math.sin(yaw))
    axes.plot(*_columns([(0.0, 0.0), nose]), color=PAPER, lw=1.6, zorder=6.1)


def _draw_goal(axes: Any, goal: PointNE, *, reachable: bool) -> None:
    colour, marker = (ORANGE, "*") if reachable else (VERMILION, "X")
    size = 17 if reachable else 12
    axes.plot(
        *_columns([goal]), marker=marker, ms=size, mfc=colour, mec=INK, mew=0.8, ls="", zorder=6
    )


def _legend(axes: Any, scenario: Scenario) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    entries: list[Any] = [
        Line2D([], [], marker="o", color=BLUE, ls="", ms=8, mec=PAPER, label="take-off"),
        Line2D([], [], color=BLUE, ls=(0, (1, 2)), lw=1.0, label="beams, 1 m"),
        Line2D([], [], color=BLUE, alpha=0.45, lw=0.8, label="straight line"),
        Line2D([], [], color=GREEN, ls=(0, (4, 3)), lw=1.1, label="fence"),
    ]
    goal = ("*", ORANGE, 13, "goal") if scenario.reachable else ("X", VERMILION, 9, "no way here")
    entries.insert(
        1, Line2D([], [], marker=goal[0], color=goal[1], ls="", ms=goal[2], mec=INK, label=goal[3])
    )
    if scenario.movers:
        entries.append(Line2D([], [], marker="o", color=PURPLE, ls=":", ms=9, label="walks"))
    if any(o.height_m is not None or o.base_m > 0.0 for o in scenario.obstacles):
        entries.append(Patch(fc=LOW, ec=SOLID_EDGE, hatch="////", label="not full height"))
    axes.legend(
        handles=entries,
        loc="upper center",
        bbox_to_anchor=(0.5, -0.09),
        ncols=len(entries),
        frameon=False,
        fontsize=8,
        handlelength=1.6,
        columnspacing=1.4,
        handletextpad=0.5,
        labelcolor=INK,
    )


def _label_once(axes: Any) -> None:
    """A legend with each label once, however many legs share it."""
    handles, labels = axes.get_legend_handles_labels()
    unique = dict(zip(labels, handles, strict=True))
    if unique:
        axes.legend(
            unique.values(),
            unique.keys(),
            loc="upper center",
            bbox_to_anchor=(0.5, -0.09),
            ncols=min(4, len(unique)),
            frameon=False,
            fontsize=8,
            labelcolor=INK,
        )


def _en(point: PointNE) -> tuple[float, float]:
    """(north, east) as (x, y) on paper."""
    return (point[1], point[0])


def _columns(points: Sequence[PointNE]) -> tuple[list[float], list[float]]:
    return [east for _, east in points], [north for north, _ in points]
