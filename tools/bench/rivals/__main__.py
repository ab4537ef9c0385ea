"""Every planner in a few rooms and scenarios, as a table: a first look, not a campaign.

python -m tools.bench.rivals [--rooms N] [--scenario NAME ...] [--planner NAME ...] [--seed N]

Rooms are the first N of `tools.bench.rooms` whose way is at least `--passage` of a radius wide.
Time ratio: seconds from the end of the take-off to the goal, over the shortest way of the body's
disc at top speed, of the flights that reached the goal without touching anything. That way may lead
over or under what rivals have to fly round (`tools.bench.worlds.truth`).
"""

import argparse
import itertools
import math
import statistics
import time
from dataclasses import dataclass

from autonomy.simulation import Simulation, goal_of
from autonomy.warm import warm_up
from hal.sim.scenario import Scenario, load_scenario
from tools.bench import rivals
from tools.bench.rivals import NAMES, config_of, flyer
from tools.bench.rooms import passage_m, room
from tools.bench.worlds import truth


@dataclass(frozen=True)
class Row:
    """One flight. `ratio` is NaN where the goal was not reached, or no shortest way is known."""

    planner: str
    world: str
    ending: str
    collided: bool
    clearance_m: float
    ratio: float
    stops: int
    tick_s: float
    """CPU time of a tick, the simulator's included."""

    @property
    def succeeded(self) -> bool:
        """At the goal, and nothing touched."""
        return self.ending == "goal_reached" and not self.collided


def fly(planner: str, scenario: Scenario, seed: int) -> Row:
    """One flight to the scenario's goal."""
    config = config_of(planner, scenario)
    route = (goal_of(scenario, config),)
    flying = flyer(planner, config, route)
    began_s = time.process_time()
    flight = Simulation(scenario, config, route, seed, flyer=flying).run()
    took_s = time.process_time() - began_s
    shortest_m = truth(scenario, config).optimum_m or math.nan
    fastest_s = shortest_m / config.guidance.speed_max_m_s
    reached = flight.outcome.ending.value == "goal_reached"
    return Row(
        planner,
        scenario.name,
        flight.outcome.ending.value,
        flight.collided,
        flight.true_clearance_m,
        flight.navigation_time_s / fastest_s if reached else math.nan,
        flight.stops,
        took_s / (flight.simulated_s * config.control.rate_hz),
    )


def table(rows: list[Row]) -> str:
    """Markdown: a line for each planner, the most successful first."""
    lines = [
        (
            "| planner | flights | at the goal, untouched | collisions | said unreachable "
            "| time used up | least clearance m | time ratio p50 | mean | stops | CPU ms a tick |"
        ),
        f"|---|{'--:|' * 10}",
    ]
    planners = dict.fromkeys(row.planner for row in rows)
    by_planner = {name: [row for row in rows if row.planner == name] for name in planners}

    def place(name: str) -> tuple[float, ...]:
        mine = by_planner[name]
        return (
            -sum(row.succeeded for row in mine),
            sum(row.collided for row in mine),
            statistics.fmean(_ratios(mine) or [99.0]),
        )

    for name in sorted(planners, key=place):
        mine = by_planner[name]
        ratios = _ratios(mine) or [math.nan]
        lines.append(
            f"| {name} | {len(mine)} | {sum(row.succeeded for row in mine)} "
            f"| {sum(row.collided for row in mine)} "
            f"| {sum(row.ending == 'unreachable' for row in mine)} "
            f"| {sum(row.ending == 'budget' for row in mine)} "
            f"| {min(row.clearance_m for row in mine):.3f} | {statistics.median(ratios):.2f} "
            f"| {statistics.fmean(ratios):.2f} | {statistics.fmean(r.stops for r in mine):.1f} "
            f"| {1e3 * statistics.fmean(row.tick_s for row in mine):.2f} |"
        )
    return "\n".join(lines)


def _ratios(rows: list[Row]) -> list[float]:
    return [row.ratio for row in rows if row.succeeded and row.ratio == row.ratio]


def worlds(rooms: int, passage: float, scenarios: list[str]) -> list[Scenario]:
    """The rooms that are wide enough, and the scenarios of those names."""
    found: list[Scenario] = []
    for number in itertools.count():
        if len(found) == rooms:
            break
        scenario = room(number)
        if passage_m(scenario, config_of(NAMES[0], scenario)) >= passage:
            found.append(scenario)
    return found + [load_scenario(name) for name in scenarios]


def main() -> None:
    """Parse, fly, print each flight and then the table."""
    parser = argparse.ArgumentParser(description=__doc__, allow_abbrev=False)
    parser.add_argument("--rooms", type=int, default=10)
    parser.add_argument("--passage", type=float, default=0.24, help="m, of the narrowest place")
    parser.add_argument("--scenario", action="append", default=[])
    parser.add_argument("--planner", action="append", help="all when absent")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    warm_up()
    rivals.warm_up()
    rows = []
    for scenario in worlds(options.rooms, options.passage, options.scenario):
        for planner in options.planner or NAMES:
            row = fly(planner, scenario, options.seed)
            rows.append(row)
            print(
                f"{row.world}, {row.planner}: {row.ending}{', touched' if row.collided else ''}, "
                f"clearance {row.clearance_m:.3f} m, time ratio {row.ratio:.2f}",
                flush=True,
            )
    print(f"\n{table(rows)}")


if __name__ == "__main__":
    main()
