"""Fly the BARN worlds with thin and with wide beams, and compare.

python -m tools.bench.wide --barn FOLDER [--half-angle DEG ...] [--mode rolling|stop] [--worlds N]
                           [--seeds N] [--rows FILE] [--jobs N] [--write]

FOLDER holds worlds.json: index -> list of [x, y], centres of cylinders (tools/bench/README.md).
"""

import argparse
import functools
import statistics
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path

import msgspec

from autonomy.simulation import Simulation, goal_of
from hal.config import Fence
from hal.sim.scenario import BeamSimulation, Disc, Scenario
from tools import campaign, pages
from tools.bench.maps import BARN_RADIUS_M, Map, barn_maps
from tools.bench.rooms import shipped_config

README = Path(__file__).parents[2] / "autonomy" / "perception" / "README.md"
REACHED = "goal_reached"


class Case(msgspec.Struct, frozen=True):
    """One flight to be flown."""

    world: str
    seed: int
    half_angle_deg: float
    mode: str


class Flight(msgspec.Struct, frozen=True):
    """What came of it."""

    case: Case
    ending: str
    collided: bool
    clearance_m: float
    length_m: float
    navigation_s: float
    replans: int
    wall_s: float
    simulated_s: float


def barn_scenario(world: Map, half_angle_deg: float) -> Scenario:
    """A BARN world to fly in, moved so that the take-off point is the origin."""
    north, east = world.start
    return Scenario(
        name=world.name,
        obstacles=tuple(
            Disc(centre_ne_m=(float(n) - north, float(e) - east), radius_m=BARN_RADIUS_M)
            for n, e in world.centres
        ),
        goal_ne_m=(world.goal[0] - north, world.goal[1] - east),
        fence=Fence.rectangle(
            (world.low[0] - north, world.high[0] - north),
            (world.low[1] - east, world.high[1] - east),
        ),
        beams=BeamSimulation(half_angle_deg=half_angle_deg),
    )


def fly(case: Case, worlds: Mapping[str, Map]) -> Flight:
    """One flight to the goal of one of `worlds`, by their names; deterministic."""
    scenario = barn_scenario(worlds[case.world], case.half_angle_deg)
    config = shipped_config(scenario, case.mode)
    flight = Simulation(scenario, config, (goal_of(scenario, config),), case.seed).run()
    return Flight(
        case,
        flight.outcome.ending.value,
        flight.collided,
        flight.true_clearance_m,
        flight.path_length_m,
        flight.navigation_time_s,
        flight.replans,
        flight.wall_s,
        flight.simulated_s,
    )


def cases(
    worlds: Iterable[str], half_angles_deg: Sequence[float], mode: str, seeds: range
) -> Iterator[Case]:
    """Every world with every seed and angle."""
    for world in worlds:
        for seed in seeds:
            for angle in half_angles_deg:
                yield Case(world, seed, angle, mode)


def wrong(flight: Flight) -> str:
    """What was not as it should be; "" if nothing was."""
    if flight.collided or flight.ending != REACHED:
        return f"{flight.ending}, clearance {flight.clearance_m:.3f} m"
    return ""


def table(flights: Sequence[Flight]) -> str:
    """Markdown: one line per half angle; times against the first angle's flights of a world."""
    lines = [
        (
            "| half angle | flights | reached | unreachable | collisions | least clearance m "
            "| time / thin: median, mean, p95 | replans p50 | x real time |"
        ),
        f"|{'---|' * 9}",
    ]
    angles = list(dict.fromkeys(flight.case.half_angle_deg for flight in flights))
    first = {(f.case.world, f.case.seed): f for f in flights if f.case.half_angle_deg == angles[0]}
    for angle in angles:
        mine = [flight for flight in flights if flight.case.half_angle_deg == angle]
        good = [flight for flight in mine if flight.ending == REACHED]
        pairs = [(f, first[f.case.world, f.case.seed]) for f in good]
        ratios = sorted(
            f.navigation_s / thin.navigation_s for f, thin in pairs if thin.ending == REACHED
        ) or [float("nan")]
        lines.append(
            f"| {angle:g} deg | {len(mine)} | {100.0 * len(good) / len(mine):.1f} % "
            f"| {sum(f.ending == 'unreachable' for f in mine)} "
            f"| {sum(f.collided for f in mine)} | {min(f.clearance_m for f in mine):.3f} "
            f"| {statistics.median(ratios):.3f}, {statistics.mean(ratios):.3f}, "
            f"{ratios[min(len(ratios) - 1, int(0.95 * len(ratios)))]:.2f} "
            f"| {statistics.median(f.replans for f in mine):g} "
            f"| {sum(f.simulated_s for f in mine) / sum(f.wall_s for f in mine):.0f} |"
        )
    return "\n".join(lines)


def main(argv: Sequence[str] | None = None) -> None:
    """Parse, fly, print."""
    parser = argparse.ArgumentParser(
        prog="python -m tools.bench wide", description=__doc__, allow_abbrev=False
    )
    parser.add_argument("--barn", type=Path, required=True, help="folder with worlds.json")
    parser.add_argument(
        "--half-angle", type=float, action="append", help="degrees; 0, 5 and 12.5 if absent"
    )
    parser.add_argument("--mode", choices=("stop", "rolling"), default="rolling")
    parser.add_argument("--worlds", type=int, default=1000, help="the first so many only")
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--rows", type=Path, help="keep what was flown here, one JSON line each")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--write", action="store_true", help="into autonomy/perception/README.md")
    options = parser.parse_args(argv)
    if options.write:
        pages.must_have(f"wide {options.mode}", README)
    worlds = {world.name: world for world in barn_maps(options.barn)[: options.worlds]}
    seeds = range(options.first_seed, options.first_seed + options.seeds)
    flights = campaign.flown(
        cases(worlds, options.half_angle or [0.0, 5.0, 12.5], options.mode, seeds),
        functools.partial(fly, worlds=worlds),
        Flight,
        kept=options.rows,
        jobs=options.jobs,
        wrong=wrong,
    )
    found = table(flights)
    print(found)
    if options.write:
        pages.renew(f"wide {options.mode}", found, README)


if __name__ == "__main__":
    main()
