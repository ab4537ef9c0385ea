"""Draws one evasion: where the vehicle and the movers were, from its beginning to its end."""

from pathlib import Path

from autonomy.geometry import Point, distance
from autonomy.model import Command
from autonomy.pictures import draw_flight, draw_scenario, draw_trails, new_figure
from autonomy.simulation import Simulation, goal_of, with_scenario
from tools.movers.campaign import configuration
from tools.movers.worlds import world

BEFORE_S, AFTER_S = 1.0, 4.0
MARGIN_M = 1.25
PLACES = 6
"""How many discs show where a mover has been."""


def draw(number: int, speed_m_s: float, path: Path) -> None:
    """The longest way that was made in room `number`, into a PNG file.

    Raises ValueError when nobody made way, BadInput without matplotlib.
    """
    scenario = world(number, speed_m_s)
    config = with_scenario(configuration(scenario, "stop"), scenario)
    ticks: list[tuple[float, Point, tuple[Point, ...]]] = []
    said: list[tuple[float, str]] = []

    def note(simulation: Simulation, command: Command) -> None:
        truth = simulation.vehicle.truth()
        places = tuple(walker.place_ne_m for walker in simulation.world.walkers)
        ticks.append((command.decision.now_s, truth.position_ned_m[:2], places))
        events = command.decision.events
        said.extend((e.stamp_s, e.why) for e in events if e.name == "make_way")

    Simulation(scenario, config, (goal_of(scenario, config),), number).run(on_tick=note)
    when = {stamp_s: place for stamp_s, place, _ in ticks}
    stamps = sorted(when)

    def moved_m(begin_s: float) -> float:
        until_s = min((t for t in stamps if t >= begin_s + AFTER_S), default=stamps[-1])
        return distance(when[begin_s], when[until_s])

    coming = [(begin_s, why) for begin_s, why in said if "making way" in why]
    if not coming:
        raise ValueError(f"nobody made way in room {number}: draw another one")
    begin_s, why = max(coming, key=lambda one: moved_m(one[0]))
    shown = [one for one in ticks if begin_s - BEFORE_S <= one[0] <= begin_s + AFTER_S]
    figure, axes = new_figure(size=(5.4, 5.8))
    draw_scenario(axes, scenario.model_copy(update={"movers": ()}), legend=False)
    every = max(1, len(shown) // PLACES)
    trails = [
        (mover.radius_m, [places[k] for _, _, places in shown])
        for k, mover in enumerate(scenario.movers)
    ]
    draw_trails(axes, trails, every=every)
    flown = [place for _, place, _ in shown]
    draw_flight(axes, flown, stops=[when[begin_s]])
    draw_trails(axes, [(scenario.vehicle.body_radius_m, flown[-1:])], colour="#0072b2")
    north, east = when[begin_s]
    axes.set_xlim(east - MARGIN_M, east + MARGIN_M)
    axes.set_ylim(north - MARGIN_M, north + MARGIN_M)
    axes.set_title(f"room {number}, movers at {speed_m_s:g} m/s:\n{why}", loc="left", fontsize=9)
    figure.savefig(path, dpi=110, bbox_inches="tight", metadata={"Software": None})
