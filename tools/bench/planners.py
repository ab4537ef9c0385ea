"""T3DRM against other planners on known maps: python -m tools.bench.planners [--barn FOLDER].

Every planner gets the same maps, every path the same exact check. Times are CPU time of the
planning thread. `--write` puts tables and pictures into tools/bench/README.md.
"""

import argparse
import math
import statistics
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from autonomy.config import PlannerConfig
from autonomy.geometry import bearing
from autonomy.model import LegKind, Plan
from autonomy.t3drm import planner as planning
from autonomy.t3drm.planner import Planner
from autonomy.t3drm.spherical import Arc, Discs, Route, fence_planes, route_among, shortest_path
from hal.config import Fence
from tools import pages
from tools.bench import steps
from tools.bench.baselines import sampling
from tools.bench.baselines.ant_colony import AntColony
from tools.bench.baselines.astar import AStar
from tools.bench.baselines.bit_star import bit_star
from tools.bench.baselines.exact import ExactOptimum
from tools.bench.baselines.interface import Answer, Baseline, timed
from tools.bench.baselines.potential_field import PotentialField
from tools.bench.baselines.rrt_star import rrt_star
from tools.bench.baselines.theta_star import ThetaStar
from tools.bench.maps import (
    KEEP_OUT_M,
    Family,
    Map,
    barn_maps,
    families,
    spread_map,
)
from tools.bench.scoring import Score, flight_time_s, judge, length_m, tightest_radius_m

Floats = NDArray[np.float64]

FINE_M = 1e-7
"""Sagitta of the arcs when a route's length is compared with the optimum."""
REPEATS, REPEAT_BELOW_S = 5, 0.02
"""A quick planner runs this often on every map, and its median counts."""
BUDGETS_S = (0.01, 0.1, 1.0)
WITHIN = 1.01
SPEEDS_M_S = (0.2, 0.5, 1.0)
LATERAL_M_S2 = 0.5
GROWTH_MAPS = 5
WHOLE_GRAPH_MAX = 500
GROWTH = (20, 50, 100, 200, 500, 1000, 2000, 5000, 10_000)


# ---------------------------------------------------------------- T3DRM's entries


class TangentRoute:
    """Spherical navigation on known discs: `shortest_path`, cold, everything included."""

    name = "T3DRM, known discs"

    def plan(self, problem: Map) -> Answer:
        """The route; its arcs become polylines after the clock has stopped."""
        planes = fence_planes(corners_of(problem))
        if planes is None:
            raise ValueError("a rectangle is convex")
        found: list[Route] = []

        def solve() -> tuple[bool, Floats]:
            route = shortest_path(
                problem.start, problem.goal, problem.centres, problem.reach_m, planes
            )
            if isinstance(route, Route):
                found.append(route)
            return bool(found), np.empty((0, 2))

        answer = timed(solve)
        return Answer(polyline_of(found[0]) if found else None, answer.seconds)


class PlanningStep:
    """The whole step of the flying planner: classification, spheres, conics, all checks.

    The map's obstacles must have one radius; it is added to the body's. One level at the map's
    keep-out, so that lengths compare: in flight up to four levels are solved.
    """

    def __init__(self, hyperbola: str, name: str) -> None:
        self.hyperbola = hyperbola
        self.name = name

    @staticmethod
    def suits(problem: Map) -> bool:
        """True when the hits of a map are all there is to know about it."""
        return bool(np.ptp(problem.radii_m) == 0.0)

    def plan(self, problem: Map) -> Answer:
        """The plan's polyline as it would be flown; making the planner is not timed."""
        planner = self.planner_for(problem)
        found: list[Plan] = []

        def solve() -> tuple[bool, Floats]:
            plan = planner.plan(problem.start, problem.goal, problem.centres)
            if isinstance(plan, Plan):
                found.append(plan)
            return bool(found), np.empty((0, 2))

        answer = timed(solve)
        return Answer(np.array(found[0].points) if found else None, answer.seconds)

    def planner_for(self, problem: Map) -> Planner:
        """A planner whose only level is the map's keep-out."""
        clearance = PlannerConfig().hard_clearance_m
        config = PlannerConfig.model_validate(
            {
                "levels": 1,
                "comfortable_clearance_m": clearance,
                "hard_clearance_m": clearance,
                "hyperbola": self.hyperbola,
            }
        )
        body = problem.keep_out_m - clearance + float(problem.radii_m[0])
        return Planner(config, body, Fence(polygon_ne_m=corners_of(problem)))


def corners_of(problem: Map) -> tuple[tuple[float, float], ...]:
    """The rectangle's corners in turn."""
    (n0, e0), (n1, e1) = problem.low, problem.high
    return ((n0, e0), (n1, e0), (n1, e1), (n0, e1))


def polyline_of(route: Route) -> Floats:
    """A route as a polyline that is longer than it by 1e-6 or less."""
    corners = [route.pieces[0].start]
    for piece in route.pieces:
        inner = piece.polyline(FINE_M) if isinstance(piece, Arc) else (piece.start, piece.end)
        corners.extend(inner[1:])
    return np.array(corners)


# ---------------------------------------------------------------- the campaign


@dataclass(frozen=True)
class Trial:
    """One planner on one map. `ratio`: length / optimum, None when the path did not pass."""

    family: str
    number: int
    planner: str
    ratio: float | None
    seconds: float


@dataclass(frozen=True)
class Reach:
    """CPU time after which a sampling planner is within 1 % of the optimum; inf: not in 1 s."""

    family: str
    number: int
    planner: str
    seconds: float
    t3drm_seconds: float
    direct: bool
    """The straight way is free: sampling planners try it first."""


@dataclass(frozen=True)
class Bend:
    """One map's route with arcs and with conics."""

    ratio: float
    radius_arc_m: float
    radius_conic_m: float
    time_ratios: tuple[float, ...]
    """Conic / arc, one per SPEEDS_M_S."""
    kink_rad: float
    """The greatest change of heading where a conic meets what comes before or after it."""


@dataclass(frozen=True)
class Growth:
    """Seconds at one number of obstacles."""

    count: int
    curve: str
    seconds: float


@dataclass(frozen=True)
class Campaign:
    """Everything that was measured."""

    trials: tuple[Trial, ...]
    reaches: tuple[Reach, ...]
    bends: tuple[Bend, ...]
    growth: tuple[Growth, ...]
    taken: tuple[steps.Step, ...] = ()


def repeated(planner: Baseline, problem: Map) -> Answer:
    """The planner's answer; the median of REPEATS times when it is quick."""
    answer = planner.plan(problem)
    if answer.seconds > REPEAT_BELOW_S:
        return answer
    times = [planner.plan(problem).seconds for _ in range(REPEATS)]
    return Answer(answer.path, statistics.median(times))


def optimum_of(problem: Map) -> tuple[Score, Answer]:
    """The yardstick of a map; ValueError where start and goal are parted."""
    answer = repeated(ExactOptimum(), problem)
    score = judge(answer.path, problem)
    if score is None:
        raise ValueError(f"{problem.name} has no way, or the yardstick is broken")
    return score, answer


def quick_planners(number: int) -> tuple[Baseline, ...]:
    """Those that run on every map; the ants' generator belongs to the map's number."""
    return (
        TangentRoute(),
        PlanningStep("never", "T3DRM, planning step (arcs)"),
        PlanningStep("prefer", "T3DRM, planning step (conics)"),
        ThetaStar(),
        AStar(),
        AntColony(np.random.default_rng(number)),
        PotentialField(),
    )


def race(family: Family, maps: int, sampling_maps: int) -> Iterator[Trial | Reach]:
    """All planners on the first maps of a family."""
    for number in range(min(maps, family.count)):
        yield from race_on(family, number, with_sampling=number < sampling_maps)


def race_on(family: Family, number: int, *, with_sampling: bool) -> Iterator[Trial | Reach]:
    """All planners on one map of a family."""
    problem = family.draw(number)
    best, answer = optimum_of(problem)
    yield Trial(family.name, number, ExactOptimum.name, 1.0, answer.seconds)
    own = 0.0
    for planner in quick_planners(number):
        if isinstance(planner, PlanningStep) and not planner.suits(problem):
            continue
        trial = _trial(family, number, planner, repeated(planner, problem), problem, best)
        own = trial.seconds if isinstance(planner, TangentRoute) else own
        yield trial
    if with_sampling and sampling.available():
        yield from _sample(family, number, problem, best, own)


def _sample(
    family: Family, number: int, problem: Map, best: Score, own_s: float
) -> Iterator[Trial | Reach]:
    direct = best.length_m <= math.dist(problem.start, problem.goal) * (1.0 + 1e-9)
    for make in (rrt_star, bit_star):
        for budget in BUDGETS_S:
            planner = make(budget)
            yield _trial(family, number, planner, planner.plan(problem), problem, best)
        racer = make(BUDGETS_S[-1])
        answer = racer.plan_until(problem, WITHIN * best.length_m)
        score = judge(answer.path, problem)
        near = score is not None and score.length_m <= WITHIN * best.length_m + 1e-9
        seconds = answer.seconds if near else math.inf
        yield Reach(family.name, number, racer.kind, seconds, own_s, direct)


def _trial(
    family: Family, number: int, planner: Baseline, answer: Answer, problem: Map, best: Score
) -> Trial:
    score = judge(answer.path, problem)
    ratio = None if score is None else score.length_m / best.length_m
    return Trial(family.name, number, planner.name, ratio, answer.seconds)


def bend(problem: Map) -> Bend | None:
    """Arcs against conics on one map; None where the planner takes no conic."""
    planner = PlanningStep("prefer", "").planner_for(problem)
    conics = planner.plan(problem.start, problem.goal, problem.centres)
    if not isinstance(conics, Plan):
        return None
    if all(leg.kind is not LegKind.HYPERBOLA for leg in conics.legs):
        return None
    arcs = PlanningStep("never", "").plan(problem).path
    if arcs is None:
        return None
    path = np.array(conics.points)
    times = tuple(
        flight_time_s(path, v, LATERAL_M_S2) / flight_time_s(arcs, v, LATERAL_M_S2)
        for v in SPEEDS_M_S
    )
    return Bend(
        length_m(path) / length_m(arcs),
        tightest_radius_m(arcs),
        tightest_radius_m(path),
        times,
        greatest_kink_rad(conics),
    )


def greatest_kink_rad(plan: Plan) -> float:
    """The greatest change of heading at an end of a conic inside the path; 0 without any."""
    worst = 0.0
    for before, after in pairwise(plan.legs):
        if LegKind.HYPERBOLA in (before.kind, after.kind):
            turn = bearing(*after.points[:2]) - bearing(*before.points[-2:])
            worst = max(worst, abs(math.remainder(turn, math.tau)))
    return worst


def grow(count: int, seeds: int) -> list[Growth]:
    """Median times with `count` obstacles of which 20 may be in the way."""
    _say(f"{count} obstacles")
    TangentRoute().plan(spread_map(20, np.random.default_rng(0)))
    curves: dict[str, list[float]] = {}
    for number in range(seeds):
        problem = spread_map(count, np.random.default_rng(number))
        planes = fence_planes(corners_of(problem))
        if planes is None:
            raise ValueError("a rectangle is convex")
        curves.setdefault("T3DRM, known discs, cold", []).append(
            repeated(TangentRoute(), problem).seconds
        )
        discs = Discs.of(problem.centres, problem.reach_m)

        def again(
            problem: Map = problem, discs: Discs = discs, planes: Floats = planes
        ) -> tuple[bool, Floats]:
            route_among(problem.start, problem.goal, discs, planes)
            return True, np.empty((0, 2))

        curves.setdefault("T3DRM, discs made ready", []).append(
            statistics.median(timed(again).seconds for _ in range(REPEATS))
        )
        hits = Map(
            problem.name,
            problem.start,
            problem.goal,
            problem.centres,
            np.full(count, 0.25),
            KEEP_OUT_M,
            problem.low,
            problem.high,
        )
        curves.setdefault("T3DRM, planning step, cold", []).append(
            repeated(PlanningStep("prefer", ""), hits).seconds
        )
        curves.setdefault("T3DRM, planning step, same map again", []).append(same_again(hits))
        if count <= WHOLE_GRAPH_MAX:
            curves.setdefault("whole tangent graph", []).append(
                ExactOptimum().plan(problem).seconds
            )
    return [Growth(count, curve, statistics.median(times)) for curve, times in curves.items()]


def same_again(problem: Map) -> float:
    """Seconds of a planning step on a map that the planner has just been asked about."""
    planner = PlanningStep("prefer", "").planner_for(problem)
    hits = problem.centres.copy()
    hits.setflags(write=False)  # as the obstacle map hands them out

    def solve() -> tuple[bool, Floats]:
        planner.plan(problem.start, problem.goal, hits)
        return True, np.empty((0, 2))

    solve()
    return statistics.median(timed(solve).seconds for _ in range(REPEATS))


def warm_up(problem: Map) -> None:
    """Compile everything that is timed."""
    optimum_of(problem)
    for planner in quick_planners(0):
        if not isinstance(planner, PlanningStep) or planner.suits(problem):
            planner.plan(problem)


def one_map(
    family: Family, number: int, *, with_sampling: bool
) -> tuple[list[Trial | Reach], list[Bend]]:
    """Everything about one map."""
    _say(f"{family.name}, map {number}")
    found = list(race_on(family, number, with_sampling=with_sampling))
    problem = family.draw(number)
    bent = bend(problem) if PlanningStep.suits(problem) else None
    return found, [] if bent is None else [bent]


def _done(job: Callable[[], Any]) -> Any:
    return job()


def all_done(jobs: Sequence[Callable[[], Any]], at_once: int) -> list[Any]:
    """The results of all jobs in turn; `at_once` > 1: so many processes at a time."""
    planning.warm_up()
    if at_once < 2:
        return [job() for job in jobs]
    with ProcessPoolExecutor(at_once) as pool:
        return list(pool.map(_done, jobs))


def campaign(
    chosen: Sequence[Family],
    maps: int,
    sampling_maps: int,
    growth: Iterable[int] = GROWTH,
    at_once: int = 1,
    flown: Sequence[Callable[[], list[steps.Step]]] = (),
) -> Campaign:
    """Run everything, saying what is being done. On one map all planners run in one process."""
    if sampling.available():
        sampling.seed(sampling.SEED)
    else:
        _say(sampling.MISSING)
    for family in (*chosen[:1], *chosen[-1:]):
        warm_up(family.draw(0))
    curves = [partial(grow, count, GROWTH_MAPS) for count in growth]
    races = [
        partial(one_map, family, number, with_sampling=number < sampling_maps)
        for family in chosen
        for number in range(min(maps, family.count))
    ]
    # The long ones first, so that no process works on alone at the end.
    done = all_done([*flown, *reversed(curves), *races], at_once)
    grown = done[len(flown) : len(flown) + len(curves)]
    raced = done[len(flown) + len(curves) :]
    found = [f for trials, _ in raced for f in trials]
    return Campaign(
        tuple(f for f in found if isinstance(f, Trial)),
        tuple(f for f in found if isinstance(f, Reach)),
        tuple(b for _, bends in raced for b in bends),
        tuple(g for rows in reversed(grown) for g in rows),
        steps.together(done[: len(flown)]),
    )


def _say(sentence: str) -> None:
    sys.stderr.write(sentence + "\n")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The options that `python -m tools.bench` shares."""
    parser.add_argument("--barn", type=Path, help="folder with the BARN worlds (worlds.json)")
    parser.add_argument("--maps", type=int, default=100, help="maps of every family")
    parser.add_argument(
        "--sampling-maps", type=int, default=6, help="maps of every family for RRT* and BIT*"
    )
    parser.add_argument(
        "--flights", type=int, default=12, help="wall and BARN worlds flown for planning steps"
    )
    parser.add_argument(
        "--at-once", type=int, default=1, help="processes; a map is always raced in one"
    )
    parser.add_argument("--write", action="store_true", help="renew tools/bench/README.md")


def run(options: argparse.Namespace) -> None:
    """Measure, print, and write where that is asked for."""
    from tools.bench import report

    if options.write:
        pages.must_have("planners", report.README)
    chosen = families(options.barn)
    barn = barn_maps(options.barn) if options.barn is not None else ()
    measured = campaign(
        chosen,
        options.maps,
        options.sampling_maps,
        at_once=options.at_once,
        flown=steps.jobs(options.flights, barn),
    )
    page = report.planner_section(measured)
    sys.stdout.write(page + "\n")
    if options.write:
        report.draw_all(measured, chosen)
        report.renew("planners", page)


def main(arguments: Sequence[str] | None = None) -> None:
    """The command line."""
    parser = argparse.ArgumentParser(
        prog="python -m tools.bench planners", description=__doc__, allow_abbrev=False
    )
    add_arguments(parser)
    run(parser.parse_args(arguments))


if __name__ == "__main__":
    main()
