"""Where the time of a tick goes: the pilot's step and the simulator, part by part.

python -m tools.bench.ticks [--scenario NAME ...] [--half-angle DEG] [--passes N] [--write]
"""

import argparse
import statistics
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from autonomy.config import Config
from autonomy.estimation.fusion import Fusion
from autonomy.mission.guarded import GuardedPilot
from autonomy.mission.navigation import Navigation
from autonomy.mission.pilot import Pilot
from autonomy.mission.responding import Responding
from autonomy.mission.sensing import Sensing
from autonomy.perception.doubt.doubter import Doubt
from autonomy.perception.movers import MoverTracker
from autonomy.perception.obstacle_map import ObstacleMap
from autonomy.perception.projection import Projector
from autonomy.simulation import Simulation, goal_of, with_scenario
from autonomy.warm import warm_up
from hal.sim.quadrotor import Quadrotor
from hal.sim.scenario import Scenario, load_scenario
from hal.sim.sensors import SimulatedBeams
from hal.sim.vehicle import SimVehicle
from hal.vehicle.guard import Guard
from tools import pages
from tools.bench import report
from tools.bench.rooms import room

ROOM = "open room 3"
PARTS: tuple[tuple[str, type, str], ...] = (
    ("**the pilot's step with the guard**", GuardedPilot, "step"),
    ("pilot", Pilot, "step"),
    ("&ensp;sensing", Sensing, "step"),
    ("&ensp;&ensp;estimation", Fusion, "step"),
    ("&ensp;&ensp;projection", Projector, "step"),
    ("&ensp;&ensp;map", ObstacleMap, "update"),
    ("&ensp;&ensp;doubt", Doubt, "learn"),
    ("&ensp;&ensp;movers", MoverTracker, "step"),
    ("&ensp;faults", Responding, "listen"),
    ("&ensp;follow (a new plan too)", Navigation, "follow"),
    ("guard", Guard, "check"),
    ("**the simulated inputs**", Simulation, "inputs"),
    ("beams", SimulatedBeams, "sample"),
    ("**the simulated vehicle**", SimVehicle, "advance"),
    ("quadrotor", Quadrotor, "step"),
)
"""Name, class and method; what is indented is within what is above it."""


@dataclass(frozen=True)
class Ticks:
    """Flights of one scenario: medians of every part in microseconds per call, and calls a tick."""

    scenario: str
    parts: dict[str, tuple[float, float]]
    tick_us: float
    times_real_time: float


@contextmanager
def stopwatches(seconds: dict[str, list[float]]) -> Iterator[None]:
    """While it lasts every call of a part adds its duration to `seconds`."""
    before = [(owner, method, getattr(owner, method)) for _, owner, method in PARTS]
    try:
        for (name, owner, method), (_, _, function) in zip(PARTS, before, strict=True):
            setattr(owner, method, _timed(function, seconds.setdefault(name, [])))
        yield
    finally:
        for owner, method, function in before:
            setattr(owner, method, function)


def _timed(function: Callable[..., Any], into: list[float]) -> Callable[..., Any]:
    def timed(*arguments: Any, **named: Any) -> Any:
        began = time.thread_time()
        result = function(*arguments, **named)
        into.append(time.thread_time() - began)
        return result

    return timed


def scenario_of(name: str, half_angle_deg: float) -> Scenario:
    """The scenario of that name, or the random room, with beams as wide."""
    scenario = room(3) if name == ROOM else load_scenario(name)
    beams = scenario.beams.model_copy(update={"half_angle_deg": half_angle_deg})
    return scenario.model_copy(update={"beams": beams})


def measure(scenario: Scenario, passes: int, limit_s: float = 3600.0) -> Ticks:
    """Fly it `passes` times whole and as often with stopwatches; the best pass counts.

    TimeoutError when a flight takes longer than `limit_s` of simulated time.
    """
    config = with_scenario(Config(), scenario)
    whole: list[tuple[float, float]] = []
    medians: dict[str, list[tuple[float, float]]] = {name: [] for name, _, _ in PARTS}
    for _ in range(passes):
        flight = Simulation(scenario, config, (goal_of(scenario, config),))
        began = time.thread_time()
        simulated_s = flight.run(limit_s=limit_s).simulated_s
        spent_s = time.thread_time() - began
        seconds: dict[str, list[float]] = {}
        with stopwatches(seconds):
            Simulation(scenario, config, (goal_of(scenario, config),)).run(limit_s=limit_s)
        ticks = len(seconds[PARTS[0][0]])
        whole.append((spent_s / ticks, simulated_s / spent_s))
        for name, durations in seconds.items():
            median_s = statistics.median(durations) if durations else 0.0
            medians[name].append((1e6 * median_s, len(durations) / ticks))
    tick_s, times = min(whole)
    parts = {name: min(found) for name, found in medians.items()}
    return Ticks(scenario.name, parts, 1e6 * tick_s, times)


def table(measured: list[Ticks]) -> str:
    """Markdown: a column per scenario."""
    lines = [
        f"| us | {' | '.join(each.scenario for each in measured)} |",
        f"|---|{'--:|' * len(measured)}",
        f"| **a tick, all in all, mean** | {_row([f'{each.tick_us:.0f}' for each in measured])} |",
        f"| x real time | {_row([f'{each.times_real_time:.0f}' for each in measured])} |",
    ]
    for name, _, _ in PARTS:
        cells = [f"{us:.1f} x {calls:.2g}" for us, calls in (each.parts[name] for each in measured)]
        lines.append(f"| {name} | {_row(cells)} |")
    return "\n".join(lines)


def _row(cells: list[str]) -> str:
    return " | ".join(cells)


def section(names: list[str], half_angle_deg: float, passes: int) -> str:
    """The table with its date."""
    warm_up()
    measured = [measure(scenario_of(name, half_angle_deg), passes) for name in names]
    return f"{report.stamp()}\n\n{table(measured)}"


def main(arguments: Sequence[str] | None = None) -> None:
    """Parse, fly, print; with --write the page is renewed as well."""
    parser = argparse.ArgumentParser(
        prog="python -m tools.bench ticks", description=__doc__, allow_abbrev=False
    )
    parser.add_argument("--scenario", action="append", help=f"name, file or '{ROOM}'")
    parser.add_argument("--half-angle", type=float, default=0.0, help="degrees")
    parser.add_argument("--passes", type=int, default=3)
    parser.add_argument("--write", action="store_true", help="renew tools/bench/README.md")
    options = parser.parse_args(arguments)
    if options.write:
        pages.must_have("ticks", report.README)
    names = options.scenario or ["default", "u_trap", ROOM]
    text = section(names, options.half_angle, options.passes)
    print(text)
    if options.write:
        report.renew("ticks", text)


if __name__ == "__main__":
    main()
