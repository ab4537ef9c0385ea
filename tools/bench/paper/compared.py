"""Tables 6 and 7: T3DRM, potential field and ant colony on the same known maps, in one run."""

import statistics
from collections.abc import Iterator, Sequence

import msgspec
import numpy as np

from autonomy.geometry import Point
from autonomy.planning import HIT_SPACING_M, outline_hits
from hal.sim.scenario import Scenario
from tools.bench.baselines.ant_colony import AntColony
from tools.bench.baselines.interface import Baseline
from tools.bench.baselines.potential_field import PotentialField
from tools.bench.maps import KEEP_OUT_M, Map
from tools.bench.paper.flights import scenario_of
from tools.bench.paper.printed import ANTS, FIELD
from tools.bench.planners import PlanningStep
from tools.bench.rooms import shipped_config
from tools.bench.scoring import judge

T3DRM = "T3DRM"
PLANNERS = (T3DRM, FIELD, ANTS)


class Trial(msgspec.Struct, frozen=True):
    """One planner once on one map. `length_m` None: no path, or one that does not pass."""

    scenario: int
    planner: str
    trial: int
    length_m: float | None
    seconds: float
    """CPU time of the planning thread."""
    path: tuple[Point, ...] = ()


def known_map(scenario: Scenario) -> Map:
    """The scenario as points on all outlines, for planners that know everything.

    A path keeps KEEP_OUT_M from them and stays inside the fence, which must be a rectangle.
    """
    hits = outline_hits(scenario, shipped_config(scenario, "stop"), HIT_SPACING_M)
    ring = scenario.fence.outline_ne_m
    low = (min(n for n, _ in ring), min(e for _, e in ring))
    high = (max(n for n, _ in ring), max(e for _, e in ring))
    return Map(
        scenario.name,
        (0.0, 0.0),
        scenario.goal_ne_m,
        np.array(hits, dtype=np.float64).reshape(-1, 2),
        np.zeros(len(hits)),
        KEEP_OUT_M,
        low,
        high,
    )


def compare(scenarios: Sequence[int], trials: int) -> Iterator[Trial]:
    """Every planner `trials` times on every map; one uncounted run first compiles it."""
    for number in scenarios:
        problem = known_map(scenario_of(number))
        for name in PLANNERS:
            _planner(name, trials).plan(problem)
            for trial in range(trials):
                answer = _planner(name, trial).plan(problem)
                score = judge(answer.path, problem)
                path = answer.path if score is not None and answer.path is not None else ()
                yield Trial(
                    number,
                    name,
                    trial,
                    score.length_m if score is not None else None,
                    answer.seconds,
                    tuple((float(n), float(e)) for n, e in path),
                )


def _planner(name: str, trial: int) -> Baseline:
    """A fresh planner; chance (the ants') belongs to the trial."""
    if name == FIELD:
        return PotentialField()
    if name == ANTS:
        return AntColony(np.random.default_rng((7, trial)))
    return PlanningStep("never", T3DRM)


def length_m(trials: Sequence[Trial], scenario: int, planner: str) -> float | None:
    """The mean length over a planner's trials; None where one of them failed."""
    lengths = [t.length_m for t in trials if (t.scenario, t.planner) == (scenario, planner)]
    good = [length for length in lengths if length is not None]
    return statistics.mean(good) if lengths and len(good) == len(lengths) else None


def seconds(trials: Sequence[Trial], scenario: int, planner: str) -> float:
    """The median computing time of a planner's trials."""
    return statistics.median(
        t.seconds for t in trials if (t.scenario, t.planner) == (scenario, planner)
    )
