"""Fly the BARN worlds with thin and with wide beams, and compare.

python -m tools.bench.wide --barn FOLDER [--half-angle DEG ...] [--mode rolling|stop] [--worlds N]

FOLDER holds worlds.json: index -> list of [x, y], centres of cylinders (tools/bench/README.md).
"""

import argparse
import statistics
from collections.abc import Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path

from autonomy.config import Config
from autonomy.simulation import Simulation, goal_of, with_scenario
from autonomy.warm import warm_up
from hal.config import Fence
from hal.sim.scenario import BeamSimulation, Disc, Scenario
from tools.bench.maps import BARN_RADIUS_M, Map, barn_maps

REACHED = "goal_reached"


@dataclass(frozen=True)
class Flight:
    """One flight, small enough to travel between processes."""

    world: str
    seed: int
    half_angle_deg: float
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


def fly(scenario: Scenario, mode: str, seed: int = 0) -> Flight:
    """One flight to the scenario's goal."""
    asked = Config.model_validate({"mission": {"replan": {"mode": mode}}})
    config = with_scenario(asked, scenario)
    flight = Simulation(scenario, config, (goal_of(scenario, config),), seed).run()
    return Flight(
        scenario.name,
        seed,
        scenario.beams.half_angle_deg,
        flight.outcome.ending.value,
        flight.collided,
        flight.true_clearance_m,
        flight.path_length_m,
        flight.navigation_time_s,
        flight.replans,
        flight.wall_s,
        flight.simulated_s,
    )


def campaign(
    worlds: Sequence[Map], half_angles_deg: Iterable[float], mode: str, seeds: range, jobs: int
) -> list[Flight]:
    """Fly every world with every angle and seed; what went wrong is named as it comes."""
    warm_up()
    flights = []
    with ProcessPoolExecutor(jobs) as pool:
        futures = [
            pool.submit(fly, barn_scenario(world, angle), mode, seed)
            for angle in half_angles_deg
            for world in worlds
            for seed in seeds
        ]
        for future in futures:
            flight = future.result()
            flights.append(flight)
            if flight.collided or flight.ending != REACHED:
                print(
                    f"{flight.world}, {flight.half_angle_deg:g} deg, seed {flight.seed}: "
                    f"{flight.ending}, clearance {flight.clearance_m:.3f} m",
                    flush=True,
                )
    return flights


def table(flights: Sequence[Flight]) -> str:
    """Markdown: one line per half angle; times against the first angle's flights of a world."""
    lines = [
        (
            "| half angle | flights | reached | unreachable | collisions | least clearance m "
            "| time / thin: median, mean, p95 | replans p50 | x real time |"
        ),
        f"|{'---|' * 9}",
    ]
    angles = list(dict.fromkeys(flight.half_angle_deg for flight in flights))
    first = {(f.world, f.seed): f for f in flights if f.half_angle_deg == angles[0]}
    for angle in angles:
        mine = [flight for flight in flights if flight.half_angle_deg == angle]
        good = [flight for flight in mine if flight.ending == REACHED]
        pairs = [(f, first[f.world, f.seed]) for f in good]
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


def main() -> None:
    """Parse, fly, print."""
    parser = argparse.ArgumentParser(description=__doc__, allow_abbrev=False)
    parser.add_argument("--barn", type=Path, required=True, help="folder with worlds.json")
    parser.add_argument(
        "--half-angle", type=float, action="append", help="degrees; 0, 5 and 12.5 if absent"
    )
    parser.add_argument("--mode", choices=("stop", "rolling"), default="rolling")
    parser.add_argument("--worlds", type=int, default=1000, help="the first so many only")
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=1)
    options = parser.parse_args()
    worlds = barn_maps(options.barn)[: options.worlds]
    seeds = range(options.first_seed, options.first_seed + options.seeds)
    angles = options.half_angle or [0.0, 5.0, 12.5]
    print(table(campaign(worlds, angles, options.mode, seeds, options.jobs)))


if __name__ == "__main__":
    main()
