"""What one planning step costs in flight: `Planner.plan` as configured, all its levels, everything.

The questions are of two sorts: maps made from seeds, and the questions that simulated flights came
to, with the hits that were known then. Times are CPU time of the thread, the median of REPEATS.
"""

import dataclasses
import math
import statistics
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from autonomy.config import PlannerConfig
from autonomy.geometry import Point
from autonomy.model import Command, NoPlan, Plan
from autonomy.simulation import Simulation, goal_of
from autonomy.t3drm.planner import Planner
from hal.config import Fence
from hal.sim.scenario import Disc, Scenario, SimObstacle, Wall, load_scenario, shipped_scenarios
from tools.bench.baselines.interface import timed
from tools.bench.maps import BARN_RADIUS_M, Map
from tools.bench.rooms import shipped_config

Floats = NDArray[np.float64]

REPEATS = 5
ROOM_M = 6.0
MANY_HITS = 500
BODY_M = 0.15


@dataclass(frozen=True)
class Question:
    """Start, goal, hits (n, 2) and the fence: what a planning step is asked."""

    start: Point
    goal: Point
    hits: Floats
    fence: Fence


@dataclass(frozen=True)
class Step:
    """One question's cost: with nothing known about the map, and asked again on the same map."""

    group: str
    hits: int
    cold_s: float
    again_s: float


def random_questions(count: int) -> Iterator[tuple[str, Question]]:
    """20 single hits, 20 pillars of 8 hits each, and 500 hits strewn at random, in 6 m."""
    fence = Fence.rectangle((-1.0, ROOM_M + 1.0), (-1.0, ROOM_M + 1.0))
    start, goal = (-0.3, -0.3), (ROOM_M + 0.3, ROOM_M + 0.3)
    turn = np.linspace(0.0, math.tau, 8, endpoint=False)
    ring = 0.12 * np.stack((np.cos(turn), np.sin(turn)), axis=1)
    for number in range(count):
        rng = np.random.default_rng((17, number))
        posts = rng.uniform(0.45, ROOM_M - 0.45, (20, 2))
        pillars = (posts[:, None, :] + ring).reshape(-1, 2)
        yield "20 hits, 6 m", Question(start, goal, posts, fence)
        yield "20 pillars of 8 hits, 6 m", Question(start, goal, pillars, fence)
        if number < count // 5:
            strewn = rng.uniform(0.45, ROOM_M - 0.55, (500, 2))
            yield "500 hits strewn over 5 m", Question(start, goal, strewn, fence)


def flown_questions(scenario: Scenario, seed: int, mode: str) -> list[Question]:
    """The questions that one flight of a scenario came to."""
    config = shipped_config(scenario, mode)
    goal = goal_of(scenario, config)
    found: list[Question] = []

    def note(_: Simulation, command: Command) -> None:
        plan = command.decision.plan
        if plan is None or command.decision.fused is None:
            return
        hits = np.array([hit for obstacle in plan.obstacles for hit in obstacle.hits])
        start = plan.points[0] if isinstance(plan, Plan) else command.decision.fused.point
        fence = config.guard.fence
        found.append(Question(start, (goal[0], goal[1]), hits.reshape(-1, 2), fence))

    Simulation(scenario, config, (goal,), seed).run(on_tick=note)
    return found


def wall_world(number: int) -> Scenario:
    """16 walls of 1 to 2.4 m at random in a field of 12 m, flown from corner to corner."""
    rng = np.random.default_rng((23, number))
    walls: list[SimObstacle] = []
    for _ in range(16):
        length, angle = rng.uniform(1.0, 2.4), rng.uniform(0.0, math.pi)
        middle = rng.uniform(0.6, 11.4, 2)
        half = 0.5 * length * np.array((math.cos(angle), math.sin(angle)))
        begin, end = (middle - half).tolist(), (middle + half).tolist()
        walls.append(Wall(from_ne_m=(begin[0], begin[1]), to_ne_m=(end[0], end[1])))
    fence = Fence.rectangle((-1.5, 13.5), (-1.5, 13.5))
    return Scenario(name="walls", obstacles=tuple(walls), goal_ne_m=(12.3, 12.3), fence=fence)


def barn_world(problem: Map) -> Scenario:
    """A BARN world as a scenario: taking off where the robot starts."""
    (n0, e0), (n1, e1) = problem.start, problem.goal
    discs = tuple(
        Disc(centre_ne_m=(n - n0, e - e0), radius_m=BARN_RADIUS_M)
        for n, e in problem.centres.tolist()
    )
    fence = Fence.rectangle((-1.5, n1 - n0 + 1.5), (-3.5, 3.5))
    return Scenario(name="BARN", obstacles=discs, goal_ne_m=(n1 - n0, e1 - e0), fence=fence)


def measured(group: str, question: Question) -> Step:
    """The cost of one question."""
    planner = Planner(PlannerConfig(), BODY_M, question.fence)

    def ask() -> tuple[bool, Floats]:
        answer = planner.plan(question.start, question.goal, question.hits)
        return not isinstance(answer, NoPlan), np.empty((0, 2))

    def cold() -> tuple[bool, Floats]:
        planner.forget()
        return ask()

    first = statistics.median(timed(cold).seconds for _ in range(REPEATS))
    again = statistics.median(timed(ask).seconds for _ in range(REPEATS))
    return Step(group, question.hits.shape[0], first, again)


def measured_flight(group: str, scenario: Scenario, seed: int, mode: str) -> list[Step]:
    """All questions of one flight."""
    return [measured(group, question) for question in flown_questions(scenario, seed, mode)]


def measured_maps(count: int) -> list[Step]:
    """All seeded maps."""
    return [measured(group, question) for group, question in random_questions(count)]


def jobs(flights: int, barn: Sequence[Map]) -> list[Callable[[], list[Step]]]:
    """Seeded maps, then flights of shipped scenarios, `flights` wall and as many BARN worlds."""
    shipped = [
        partial(measured_flight, "flights: shipped scenarios", load_scenario(name), 0, "stop")
        for name in shipped_scenarios()
    ]
    walls = [
        partial(measured_flight, "flights: 16 walls, 12 m", wall_world(k), k, "rolling")
        for k in range(flights)
    ]
    chosen = barn[:: max(1, len(barn) // max(1, flights))][:flights]
    worlds = [
        partial(measured_flight, "flights: BARN", barn_world(m), 0, "rolling") for m in chosen
    ]
    return [partial(measured_maps, 10 * flights), *shipped, *walls, *worlds]


def together(groups: Sequence[Sequence[Step]]) -> tuple[Step, ...]:
    """All steps; questions of flights with many hits count in groups of their own too."""
    taken = sorted((step for group in groups for step in group), key=lambda s: s.group)
    many = [
        dataclasses.replace(step, group=f"{step.group}, {MANY_HITS} hits and more")
        for step in taken
        if step.group.startswith("flights") and step.hits >= MANY_HITS
    ]
    return (*taken, *many)
