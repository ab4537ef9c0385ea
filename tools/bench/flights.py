"""Fly scenarios in process over many seeds and print what came of it.

python -m tools.bench.flights [--scenario NAME ...] [--seeds N] [--mode stop|rolling] [--jobs N]
"""

import argparse
import statistics
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass

from autonomy.config import Config
from autonomy.simulation import Simulation, goal_of, with_scenario
from autonomy.warm import warm_up
from hal.sim.scenario import load_scenario, shipped_scenarios


@dataclass(frozen=True)
class Row:
    """One flight, small enough to travel between processes."""

    scenario: str
    seed: int
    ending: str
    collided: bool
    clearance_m: float
    length_m: float
    navigation_s: float
    stops: int
    replans: int
    error_m: float
    simulated_s: float
    wall_s: float
    planning_s: tuple[float, ...]


def fly(scenario_name: str, seed: int, mode: str) -> Row:
    """One flight of a scenario to its suggested goal."""
    scenario = load_scenario(scenario_name)
    config = with_scenario(Config.model_validate({"mission": {"replan": {"mode": mode}}}), scenario)
    flight = Simulation(scenario, config, (goal_of(scenario, config),), seed).run()
    return Row(
        scenario_name,
        seed,
        flight.outcome.ending.value,
        flight.collided,
        flight.true_clearance_m,
        flight.path_length_m,
        flight.navigation_time_s,
        flight.stops,
        flight.replans,
        flight.final_error_m,
        flight.simulated_s,
        flight.wall_s,
        tuple(r.seconds for r in flight.timing.replans) if flight.timing else (),
    )


def table(rows: list[Row]) -> str:
    """Markdown: one line per scenario."""
    lines = [
        (
            "| scenario | flights | endings | collisions | least clearance m | length m p50 "
            "| time s p50/p95 | stops p50 | replans p50 | planning ms p50/p95 | x real time |"
        ),
        "|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    for name in dict.fromkeys(row.scenario for row in rows):
        mine = [row for row in rows if row.scenario == name]
        endings = Counter(row.ending for row in mine)
        times = sorted(row.navigation_s for row in mine)
        planning = sorted(s for row in mine for s in row.planning_s) or [0.0]
        lines.append(
            f"| {name} | {len(mine)} | {', '.join(f'{n} {e}' for e, n in endings.items())} "
            f"| {sum(row.collided for row in mine)} | {min(r.clearance_m for r in mine):.3f} "
            f"| {statistics.median(r.length_m for r in mine):.2f} "
            f"| {_percentile(times, 0.5):.1f}/{_percentile(times, 0.95):.1f} "
            f"| {statistics.median(r.stops for r in mine):g} "
            f"| {statistics.median(r.replans for r in mine):g} "
            f"| {1e3 * _percentile(planning, 0.5):.2f}/{1e3 * _percentile(planning, 0.95):.2f} "
            f"| {sum(r.simulated_s for r in mine) / sum(r.wall_s for r in mine):.0f} |"
        )
    return "\n".join(lines)


def _percentile(values: list[float], fraction: float) -> float:
    return values[min(len(values) - 1, int(fraction * len(values)))]


def campaign(names: list[str], seeds: range, mode: str, jobs: int) -> list[Row]:
    """Fly every scenario with every seed; what did not reach its goal is named as it comes."""
    warm_up()
    rows = []
    with ProcessPoolExecutor(jobs) as pool:
        futures = [pool.submit(fly, name, seed, mode) for name in names for seed in seeds]
        for future in futures:
            row = future.result()
            rows.append(row)
            if row.collided or row.ending != "goal_reached":
                print(
                    f"{row.scenario} seed {row.seed}: {row.ending}, clearance {row.clearance_m:.3f}"
                )
    return rows


def main() -> None:
    """Parse, fly, print."""
    parser = argparse.ArgumentParser(description=__doc__, allow_abbrev=False)
    parser.add_argument(
        "--scenario", action="append", help="name or file; all shipped ones if absent"
    )
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--mode", choices=("stop", "rolling"), default="stop")
    parser.add_argument("--jobs", type=int, default=2)
    options = parser.parse_args()
    names = options.scenario or list(shipped_scenarios())
    seeds = range(options.first_seed, options.first_seed + options.seeds)
    print(table(campaign(names, seeds, options.mode, options.jobs)))


if __name__ == "__main__":
    main()
