"""Fly scenarios in process over many seeds, and small random rooms, and print what came of it.

python -m tools.bench.flights [--scenario NAME ...] [--seeds N] [--rooms N] [--mode stop|rolling]
"""

import argparse
import statistics
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass

from autonomy.config import Config
from autonomy.simulation import Simulation, goal_of
from autonomy.warm import warm_up
from hal.sim.scenario import Scenario, load_scenario, shipped_scenarios
from tools.bench.rooms import SENSING_M, passage_m, room, shipped_config

OPEN_ROOMS, CLOSED_ROOMS = "open rooms", "closed rooms"


@dataclass(frozen=True)
class Row:
    """One flight, small enough to travel between processes."""

    scenario: str
    seed: int
    ending: str
    collided: bool
    clearance_m: float
    length_m: float
    bound_m: float
    side_changes: int
    navigation_s: float
    stops: int
    replans: int
    error_m: float
    simulated_s: float
    wall_s: float
    planning_s: tuple[float, ...]


def scenario_of(name: str, seed: int) -> Scenario:
    """The scenario of that name; of the rooms, number `seed`."""
    if name in (OPEN_ROOMS, CLOSED_ROOMS):
        return room(seed, closed=name == CLOSED_ROOMS)
    return load_scenario(name)


def fly(scenario_name: str, seed: int, mode: str) -> Row:
    """One flight of a scenario to its suggested goal."""
    scenario = scenario_of(scenario_name, seed)
    config = shipped_config(scenario, mode)
    flight = Simulation(scenario, config, (goal_of(scenario, config),), seed).run()
    return Row(
        scenario_name,
        seed,
        flight.outcome.ending.value,
        flight.collided,
        flight.true_clearance_m,
        flight.path_length_m,
        flight.path_bound.bound_m,
        flight.side_changes,
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
            "| path/bound p50/max | side changes mean/max | time s p50/p95 | stops p50 "
            "| replans p50 | planning ms p50/p95 | x real time |"
        ),
        f"|{'---|' * 13}",
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
            f"| {statistics.median(_used(mine)):.2f}/{max(_used(mine)):.2f} "
            f"| {statistics.mean(r.side_changes for r in mine):.1f}"
            f"/{max(r.side_changes for r in mine)} "
            f"| {_percentile(times, 0.5):.1f}/{_percentile(times, 0.95):.1f} "
            f"| {statistics.median(r.stops for r in mine):g} "
            f"| {statistics.median(r.replans for r in mine):g} "
            f"| {1e3 * _percentile(planning, 0.5):.2f}/{1e3 * _percentile(planning, 0.95):.2f} "
            f"| {sum(r.simulated_s for r in mine) / sum(r.wall_s for r in mine):.0f} |"
        )
    return "\n".join(lines)


def _used(rows: list[Row]) -> list[float]:
    """How much of the bound on path length each flight used; above 1 it was not kept."""
    return [row.length_m / row.bound_m for row in rows]


def verdicts(rows: list[Row]) -> str:
    """One sentence on how right "unreachable" was in the open rooms."""
    config = Config()
    floor_m = config.body.radius_m + config.planner.hard_clearance_m
    mine = [row for row in rows if row.scenario == OPEN_ROOMS]
    gaps = {row.seed: passage_m(room(row.seed), config) for row in mine}
    said = [gaps[row.seed] for row in mine if row.ending == "unreachable"]
    wrong = [gap for gap in said if gap > floor_m]
    widest = f"; the widest such gap was {2.0 * max(wrong):.3f} m" if wrong else ""
    return (
        f"Open rooms: {sum(gap > floor_m for gap in gaps.values())} of {len(mine)} have a way at "
        f"the keep-out floor ({floor_m:.2f} m). 'Unreachable' was said in {len(said)}, wrongly in "
        f"{len(wrong)}, of which with a gap wider than 2 x ({floor_m:.2f} + {SENSING_M:.2f}) m: "
        f"{sum(gap > floor_m + SENSING_M for gap in wrong)}{widest}."
    )


def _percentile(values: list[float], fraction: float) -> float:
    return values[min(len(values) - 1, int(fraction * len(values)))]


def campaign(names: list[str], seeds: range, mode: str, jobs: int, rooms: int = 0) -> list[Row]:
    """Fly every scenario with every seed, and `rooms` open rooms and a quarter as many closed.

    What did not reach its goal is named as it comes.
    """
    warm_up()
    rows = []
    with ProcessPoolExecutor(jobs) as pool:
        cases = [(name, seed) for name in names for seed in seeds]
        cases += [(OPEN_ROOMS, number) for number in range(rooms)]
        cases += [(CLOSED_ROOMS, number) for number in range(rooms // 4)]
        futures = [pool.submit(fly, name, seed, mode) for name, seed in cases]
        for future in futures:
            row = future.result()
            rows.append(row)
            if row.collided or row.ending != "goal_reached":
                print(
                    f"{row.scenario} seed {row.seed}: {row.ending}, clearance {row.clearance_m:.3f}"
                )
    return rows


def main(arguments: Sequence[str] | None = None) -> None:
    """Parse, fly, print."""
    parser = argparse.ArgumentParser(
        prog="python -m tools.bench flights", description=__doc__, allow_abbrev=False
    )
    parser.add_argument(
        "--scenario", action="append", help="name or file; all shipped ones if absent"
    )
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--rooms", type=int, default=0, help="random rooms to fly in as well")
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--mode", choices=("stop", "rolling"), default="stop")
    parser.add_argument("--jobs", type=int, default=2)
    options = parser.parse_args(arguments)
    names = options.scenario or list(shipped_scenarios())
    seeds = range(options.first_seed, options.first_seed + options.seeds)
    rows = campaign(names, seeds, options.mode, options.jobs, options.rooms)
    print(table(rows))
    if options.rooms:
        print(f"\n{verdicts(rows)}")


if __name__ == "__main__":
    main()
