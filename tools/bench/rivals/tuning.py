"""The search for the rivals' gains: a few values of each, on rooms that no table is made from.

python -m tools.bench.rivals.tuning [--rooms N] [RIVAL ...]

Every pair of gains flies the first open rooms of family `SEED` whose way is at least `PASSAGE_M`
wide, with the lagging vehicle of `toy.py`. Most arrivals without a touch win, of those alike the
least mean time. What won stands as the defaults of each rival's `Gains`.
"""

import argparse
import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from autonomy.config import Config
from autonomy.geometry import Point
from autonomy.planning import outline_hits
from tools.bench.rivals import (
    astar,
    bendy_ruler,
    bug2,
    dwa,
    grid,
    potential_field,
    tangent_bug,
    toy,
    vfh_plus,
)
from tools.bench.rivals.harness import fence_hits
from tools.bench.rivals.interface import Craft, Floats, Rival
from tools.bench.rooms import passage_m, room, shipped_config

SEED = 77
PASSAGE_M = 0.24
LIMIT_S = 150.0

Maker = Callable[[Craft], Rival]


def choices() -> dict[str, Iterator[tuple[str, Maker]]]:
    """By rival: what to try, as words and as what makes it. D* Lite's ways, and gains, are A*'s."""
    return {
        "bug2": _all(bug2.Bug2, bug2.Gains, margin_m=(0.0, 0.01, 0.03), side=(1, -1)),
        "tangentbug": _all(
            tangent_bug.TangentBug,
            tangent_bug.Gains,
            margin_m=(0.0, 0.01, 0.03),
            grows_m=(0.05, 0.15),
            leave_m=(0.05, 0.15),
        ),
        "vfh+": _all(
            vfh_plus.VfhPlus,
            vfh_plus.Gains,
            window_m=(0.5, 0.7, 0.9),
            margin_m=(0.0, 0.03),
            high=(0.4, 1.0),
        ),
        "bendyruler": _all(
            bendy_ruler.BendyRuler,
            bendy_ruler.Gains,
            lookahead_m=(0.2, 0.3, 0.5, 0.7),
            margin_m=(0.0, 0.01, 0.03),
        ),
        "dwa": _all(
            dwa.DynamicWindow,
            dwa.Gains,
            clearance=(0.2, 0.5, 1.0),
            speed=(0.1, 0.4),
            margin_m=(0.0, 0.03),
        ),
        "astar": _all(astar.AStar, grid.Gains, band_m=(0.03, 0.05, 0.1, 0.15), steep=(1.0, 3.0)),
        "potential-field": _all(
            potential_field.PotentialField,
            potential_field.Gains,
            strength=(0.0001, 0.0003, 0.001, 0.003),
            influence_m=(0.1, 0.2, 0.4),
        ),
    }


@dataclass(frozen=True)
class Problem:
    """A room's outlines, the fence among them, and its goal."""

    outlines: Floats
    goal: Point
    config: Config


def problems(count: int) -> list[Problem]:
    """The first `count` rooms of the family with a way that is wide enough."""
    found: list[Problem] = []
    for number in itertools.count():
        if len(found) == count:
            break
        scenario = room(number, seed=SEED)
        config = shipped_config(scenario, "rolling")
        if passage_m(scenario, config) >= PASSAGE_M:
            hits = np.array(outline_hits(scenario, config), dtype=np.float64).reshape(-1, 2)
            fence = fence_hits(config, Craft.of(config).keep_out_m)
            found.append(Problem(np.concatenate((hits, fence)), scenario.goal_ne_m, config))
    return found


def score(make: Maker, rooms: list[Problem]) -> tuple[int, int, float]:
    """(arrivals without a touch, touches, mean time of the arrivals in s)."""
    arrived, touched, seconds = 0, 0, 0.0
    for number, problem in enumerate(rooms):
        craft = Craft.of(problem.config)
        rng = np.random.default_rng((SEED, number))
        flown = toy.fly(
            make(craft),
            problem.outlines,
            problem.goal,
            limit_s=LIMIT_S,
            rng=rng,
            config=problem.config,
        )
        touched += flown.least_m < craft.body_m
        if flown.arrived and flown.least_m >= craft.body_m:
            arrived += 1
            seconds += flown.seconds
    return arrived, touched, seconds / max(1, arrived)


def main() -> None:
    """Fly, print, the best first."""
    parser = argparse.ArgumentParser(description=__doc__, allow_abbrev=False)
    parser.add_argument("rivals", nargs="*", help="all when absent")
    parser.add_argument("--rooms", type=int, default=16)
    options = parser.parse_args()
    rooms = problems(options.rooms)
    for name, tries in choices().items():
        if options.rivals and name not in options.rivals:
            continue
        rows = [(*score(make, rooms), words) for words, make in tries]
        print(f"{name}: arrivals of {len(rooms)}, touches, mean s")
        for arrived, touched, seconds, words in sorted(rows, key=lambda r: (-r[0], r[2])):
            print(f"  {arrived:3d} {touched:3d} {seconds:6.1f}  {words}", flush=True)


def _all(
    rival: Callable[[Craft, Any], Rival], gains: Callable[..., Any], **tried: tuple[float, ...]
) -> Iterator[tuple[str, Maker]]:
    """Every combination of the values tried."""
    for values in itertools.product(*tried.values()):
        named = dict(zip(tried, values, strict=True))
        words = ", ".join(f"{name} {value:g}" for name, value in named.items())
        yield words, partial(_make, rival, gains(**named))


def _make(rival: Callable[[Craft, Any], Rival], gains: Any, craft: Craft) -> Rival:
    return rival(craft, gains)


if __name__ == "__main__":
    main()
