"""The figures of a flight's page, as SVG text. matplotlib (extra `log`) draws them."""

import io
import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from autonomy import pictures
from autonomy.config import Config
from autonomy.geometry import moved
from autonomy.model import SOURCES, MissionState, ObstacleKind, Plan
from autonomy.pictures import BLUE, GREEN, INK, LOW, ORANGE, PURPLE, SKY, SOLID_EDGE, VERMILION
from autonomy.review.history import History, Moment, Replan
from autonomy.review.ulog import Beside, FloatArray
from hal.config import Fence
from hal.sim.scenario import Scenario, load_scenario

POINTS_MAX = 2000
"""More moments than this are thinned for the curves: a page should open on a phone."""
SILENT_S = 1.0
"""A source that was fused this long ago has no test ratio to draw."""
RATIO_SHOWN = 1e-4
"""Smaller test ratios are drawn as this: a logarithm has no zero."""
STATE_COLOURS: dict[MissionState, str] = {
    MissionState.CRUISE: "#cfe8dc",
    MissionState.FOLLOW: "#cfe3f2",
    MissionState.STOP: "#f8d9c8",
    MissionState.DETECT: "#fbeac4",
    MissionState.HOLD: "#f3d5e3",
    MissionState.RETURN: "#e5d3ee",
}


def map_svg(history: History) -> str:
    """The room from above, in the frame of the service that flew there: path, every plan's legs,
    hits, obstacles by class, stops.
    """
    figure, axes = pictures.new_figure()
    by = history.offset_ne_m
    scenario = load_scenario(history.scenario) if history.scenario else _empty(history)
    (goal,) = moved([history.route[-1][:2]], by)
    world = scenario.model_copy(update={"goal_ne_m": goal})
    pictures.draw_scenario(axes, world, legend=False)
    plans = [replan.result for replan in history.replans if isinstance(replan.result, Plan)]
    legs = [(leg.kind.value, moved(leg.points, by)) for plan in plans for leg in plan.legs]
    discs = [
        (moved([obstacle.centre], by)[0], obstacle.radius_m + plans[-1].keep_out_m)
        for obstacle in (plans[-1].obstacles if plans else ())
        if obstacle.kind is ObstacleKind.DISCRETE
    ]
    flying = [m for m in history.moments if m.known and m.altitude_m > 0.1]
    stops = [
        m.position_ned_m[:2]
        for m in history.moments
        if any(event.name == MissionState.STOP.value for event in m.events)
    ]
    pictures.draw_flight(
        axes,
        moved([m.position_ned_m[:2] for m in _thinned(flying)], by),
        legs=legs,
        hits=moved(history.hits, by),
        discs=discs,
        stops=moved(stops, by),
    )
    return _svg(figure)


def timeline_svg(history: History) -> str:
    """Speed with Table 2's limit, clearance with its floor, room ahead against stopping."""
    figure, (fast, near) = pictures.new_figure(rows=2, size=(9.0, 4.6))
    moments = _thinned(history.moments)
    times = [m.now_s - history.start_s for m in moments]
    for axes in (fast, near):
        _shade_states(axes, history)
        axes.grid(visible=True, color=LOW, lw=0.5)
    fast.plot(times, [m.speed_m_s for m in moments], color=INK, lw=1.2, label="speed")
    limit = [m.speed_limit_m_s if m.streaming and m.speed_limit_m_s else math.nan for m in moments]
    fast.plot(times, limit, color=BLUE, lw=1.2, label="Table 2's limit")
    fast.axhline(history.config.guard.speed_max_m_s, color=VERMILION, lw=0.8, ls=":")
    fast.set_ylabel("m/s")
    clearance = [m.clearance_m if m.streaming else math.nan for m in moments]
    ahead = [math.nan if m.ahead_m is None else m.ahead_m for m in moments]
    near.plot(times, clearance, color=GREEN, lw=1.2, label="nearest known hit")
    near.plot(times, ahead, color=ORANGE, lw=1.0, label="seen free ahead (as far as it matters)")
    near.axhline(history.config.body.radius_m, color=VERMILION, lw=0.8, ls=":", label="body")
    near.set_ylabel("m from the centre")
    near.set_xlabel("seconds since the first tick")
    near.set_ylim(bottom=0.0)
    for axes in (fast, near):
        low, high = axes.get_ylim()
        axes.set_ylim(low, high + 0.25 * (high - low))  # room for the legend
        axes.legend(loc="upper left", fontsize=8, frameon=False, ncols=3)
    _mark_guard(fast, history)
    return _svg(figure)


def heard(history: History) -> tuple[str, ...]:
    """The sources that the position filter heard in this flight."""
    last = history.moments[-1].health
    each = ((name, getattr(last, name)) for name in SOURCES)
    return tuple(name for name, source in each if source.fused or source.rejected)


def estimator_svg(history: History) -> str:
    """The test ratio of every source over the flight, with the gate at 1."""
    figure, axes = pictures.new_figure(size=(9.0, 2.6))
    moments = _thinned(history.moments)
    times = [m.now_s - history.start_s for m in moments]
    colours = dict(zip(SOURCES, (INK, BLUE, ORANGE, GREEN, PURPLE), strict=True))
    for name in heard(history):
        sources = [getattr(m.health, name) for m in moments]
        ratios = [
            math.nan if s.age_s is None or s.age_s > SILENT_S else max(s.test_ratio, RATIO_SHOWN)
            for s in sources
        ]
        axes.plot(times, ratios, color=colours[name], lw=0.9, label=name)
    axes.axhline(1.0, color=VERMILION, lw=0.9, ls="--")
    axes.set_yscale("log")
    axes.set_ylabel("test ratio")
    axes.set_xlabel("seconds since the first tick")
    axes.grid(visible=True, color=LOW, lw=0.5)
    axes.legend(loc="upper left", fontsize=8, frameon=False, ncols=len(SOURCES))
    low, high = axes.get_ylim()
    axes.set_ylim(low, max(high, 2.0) * 8.0)  # room for the legend
    return _svg(figure)


def px4_svg(history: History, beside: Beside) -> str:
    """PX4's own record on this log's time axis: position, speed and attitude, with its modes."""
    figure, (place, fast, turn) = pictures.new_figure(rows=3, size=(9.0, 6.6))
    record, start_s = beside.record, history.start_s
    reach = (0.0, history.moments[-1].now_s - start_s)
    heard_s = beside.heard[:, 0] - start_s

    def own(rows: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(times, columns), thinned."""
        times = rows[:, 0] + beside.offset_s - start_s
        kept = rows[(times >= reach[0]) & (times <= reach[1])]
        kept = kept[:: max(1, math.ceil(len(kept) / POINTS_MAX))]
        return kept[:, 0] + beside.offset_s - start_s, kept[:, 1:]

    times, places = own(record.position)
    asked_s, asked = own(record.asked_position)
    for axis, (name, colour) in enumerate((("north", BLUE), ("east", ORANGE), ("up", GREEN))):
        sign = -1.0 if name == "up" else 1.0
        place.plot(asked_s, sign * asked[:, axis], color=colour, lw=0.8, ls=":")
        place.plot(times, sign * places[:, axis], color=colour, lw=1.2, label=name)
        place.plot(heard_s, sign * beside.heard[:, axis + 1], color=INK, lw=0.5, ls="--")
    times, velocity = own(record.velocity)
    asked_s, asked = own(record.asked_velocity)
    fast.plot(asked_s, np.hypot(asked[:, 0], asked[:, 1]), color=SKY, lw=0.9, label="asked")
    fast.plot(times, np.hypot(velocity[:, 0], velocity[:, 1]), color=INK, lw=1.1, label="speed")
    times, angles = own(record.attitude)
    for axis, (name, colour) in enumerate((("roll", BLUE), ("pitch", ORANGE))):
        turn.plot(times, np.degrees(angles[:, axis]), color=colour, lw=0.9, label=name)
    heading = turn.twinx()
    heading.plot(times, np.degrees(angles[:, 2]), ".", color=LOW, ms=1.5)
    heading.set_ylabel("heading, deg", color=SOLID_EDGE)
    turn.set_zorder(heading.get_zorder() + 1)
    turn.patch.set_visible(False)
    for axes, unit in ((place, "m"), (fast, "m/s"), (turn, "deg")):
        _mark_modes(axes, beside, start_s, reach)
        axes.set_xlim(*reach)
        axes.set_ylabel(unit)
        axes.grid(visible=True, color=LOW, lw=0.5)
        axes.legend(loc="upper left", fontsize=8, frameon=False, ncols=3)
    turn.set_xlabel("seconds since the first tick")
    return _svg(figure)


def _mark_modes(axes: Any, beside: Beside, start_s: float, reach: tuple[float, float]) -> None:
    """A line where PX4 changed its mode; above the uppermost axes the word, where there is room."""
    modes = beside.record.nav_states
    shift_s = beside.offset_s - start_s
    for number, (since_s, word) in enumerate(modes):
        at_s = max(reach[0], since_s + shift_s)
        until_s = modes[number + 1][0] + shift_s if number + 1 < len(modes) else reach[1]
        if at_s > reach[1] or until_s < reach[0]:
            continue
        axes.axvline(at_s, color=PURPLE, lw=0.8)
        lasts_s = min(until_s, reach[1]) - at_s
        if lasts_s > 0.03 * reach[1] and axes.get_subplotspec().is_first_row():
            axes.annotate(
                word,
                (at_s, 1.0),
                xycoords=("data", "axes fraction"),
                xytext=(2, 3),
                textcoords="offset points",
                rotation=30,
                fontsize=8,
                color=PURPLE,
            )


def persistence_svg(replan: Replan, config: Config) -> str:
    """Persistence barcode of the hits of one replan, and the radius at which it was cut."""
    figure, axes = pictures.new_figure(size=(3.2, 2.0))
    finite = [death for death in replan.persistence if math.isfinite(death)]
    keep_out_m = replan.result.keep_out_m if isinstance(replan.result, Plan) else 0.0
    reach_m = 1.15 * max([*finite, 2.0 * keep_out_m, 2.0 * config.body.radius_m])
    shown = sorted(replan.persistence)[-60:]
    for row, death in enumerate(shown):
        alive = death > keep_out_m
        axes.plot([0.0, min(death, reach_m)], [row, row], color=PURPLE if alive else SKY, lw=1.4)
    axes.axvline(keep_out_m, color=VERMILION, lw=1.0, ls="--")
    axes.set_yticks([])
    axes.set_xlim(0.0, reach_m)
    axes.tick_params(labelsize=7, colors=SOLID_EDGE)
    axes.set_xlabel("radius, m", fontsize=8, color=SOLID_EDGE)
    return _svg(figure)


def _shade_states(axes: Any, history: History) -> None:
    """A band for every stretch in one state."""
    begun = history.moments[0]
    last = history.moments[-1]
    for moment in (*history.moments[1:], last):
        if moment.state is begun.state and moment is not last:
            continue
        colour = STATE_COLOURS.get(begun.state)
        if colour is not None:
            axes.axvspan(
                begun.now_s - history.start_s, moment.now_s - history.start_s, color=colour, lw=0
            )
        begun = moment


def _mark_guard(axes: Any, history: History) -> None:
    """A tick on the time axis wherever the guard changed a setpoint."""
    times = [m.now_s - history.start_s for m in history.moments if m.limits]
    if times:
        axes.plot(times, [0.0] * len(times), "|", color=VERMILION, ms=9, label="guard")


def _thinned(moments: Sequence[Moment]) -> Sequence[Moment]:
    return moments[:: max(1, math.ceil(len(moments) / POINTS_MAX))]


def _empty(history: History) -> Scenario:
    """A flight in a real room: only the fence is known."""
    fence = history.config.guard.fence
    if history.offset_ne_m != (0.0, 0.0):
        fence = Fence(polygon_ne_m=moved(fence.outline_ne_m, history.offset_ne_m))
    return Scenario(name="flight", title="Flight", goal_ne_m=(0.0, 0.0), fence=fence)


def _svg(figure: Any) -> str:
    """The figure as an SVG element, the same bytes for the same flight."""
    import matplotlib as mpl

    text = io.StringIO()
    with mpl.rc_context({"svg.hashsalt": "autonomy", "svg.fonttype": "none"}):
        figure.savefig(
            text, format="svg", bbox_inches="tight", pad_inches=0.08, metadata={"Date": None}
        )
    whole = text.getvalue()
    return whole[whole.index("<svg") :]
