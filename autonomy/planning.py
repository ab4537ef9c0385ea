"""Planning on paper: through a scenario as if everything in it had been seen, without flying."""

import math
import time

import msgspec

from autonomy.config import Config
from autonomy.geometry import Point, distance
from autonomy.model import NoPlan, Plan
from autonomy.simulation import with_scenario
from hal.sim.scenario import Disc, Scenario, load_scenario

HIT_SPACING_M = 0.05
"""Outlines are sampled as finely as the beams would in slow flight."""


class PlannedScenario(msgspec.Struct, frozen=True):
    """A scenario, the outline points of its obstacles at flying height, and the plan."""

    scenario: Scenario
    goal: Point
    hits: tuple[Point, ...]
    height_m: float
    plan: Plan | NoPlan
    planning_s: float

    @property
    def reachable(self) -> bool:
        """True when there is a plan."""
        return isinstance(self.plan, Plan)


def plan_scenario(name_or_path: str, goal: Point | None, config: Config) -> PlannedScenario:
    """Plan from the take-off point to `goal` (None: the scenario's own).

    Raises DocumentError when the scenario is refused.
    """
    import numpy as np

    from autonomy.t3drm.planner import Planner, warm_up

    scenario = load_scenario(name_or_path)
    config = with_scenario(config, scenario)
    hits = outline_hits(scenario, config)
    target = goal if goal is not None else scenario.goal_ne_m
    planner = Planner(config.planner, config.body.radius_m, config.guard.fence)
    warm_up()
    points = np.array(hits, dtype=np.float64).reshape(-1, 2)
    before_s = time.perf_counter()
    plan = planner.plan((0.0, 0.0), target, points)
    planning_s = time.perf_counter() - before_s
    return PlannedScenario(scenario, target, hits, config.mission.altitude_m, plan, planning_s)


def outline_hits(
    scenario: Scenario, config: Config, spacing_m: float = HIT_SPACING_M
) -> tuple[Point, ...]:
    """Points on the outline of every obstacle that is in the way at the mission's altitude."""
    half_m = config.body.half_height_m
    low_m, high_m = config.mission.altitude_m - half_m, config.mission.altitude_m + half_m
    hits: list[Point] = []
    for obstacle in scenario.obstacles:
        if obstacle.base_m > high_m or (obstacle.height_m or math.inf) < low_m:
            continue
        if isinstance(obstacle, Disc):
            hits.extend(_circle(obstacle.centre_ne_m, obstacle.radius_m, spacing_m))
        else:
            corners = obstacle.footprint.corners()
            for a, b in zip(corners, corners[1:] + corners[:1], strict=True):
                hits.extend(_edge(a, b, spacing_m))
    return tuple(hits)


def described(planned: PlannedScenario) -> str:
    """The plan in words."""
    plan, name = planned.plan, planned.scenario.name
    milliseconds = f"{planned.planning_s * 1e3:.2f} ms"
    if isinstance(plan, NoPlan):
        return (
            f"{name}: no way to ({planned.goal[0]:g}, {planned.goal[1]:g}) "
            f"at {planned.height_m:g} m high, the only height planned at: {plan.reason}; "
            f"{len(plan.evidence)} hits bar it; found in {milliseconds}"
        )
    straight_m = distance((0.0, 0.0), planned.goal)
    counts = ", ".join(
        f"{sum(obstacle.kind == kind for obstacle in plan.obstacles)} {kind}"
        for kind in ("discrete", "continuous")
    )
    ratio = plan.length_m / straight_m if straight_m else 1.0
    place = f"({planned.goal[0]:g}, {planned.goal[1]:g})"
    lines = [
        f"{name}: {plan.length_m:.3f} m to {place}, {ratio:.3f} times the straight line",
        f"found in {milliseconds} among {len(planned.hits)} hits",
        f"environment {plan.environment.value}: {counts}; keep-out {plan.keep_out_m:.3f} m",
    ]
    lines += [
        f"  {leg.kind.value:<10} {leg.length_m:6.3f} m to "
        f"({leg.points[-1][0]:.2f}, {leg.points[-1][1]:.2f})"
        for leg in plan.legs
    ]
    return "\n".join(lines)


def _circle(centre: Point, radius_m: float, spacing_m: float) -> list[Point]:
    count = max(8, math.ceil(2.0 * math.pi * radius_m / spacing_m))
    return [
        (
            centre[0] + radius_m * math.cos(2.0 * math.pi * k / count),
            centre[1] + radius_m * math.sin(2.0 * math.pi * k / count),
        )
        for k in range(count)
    ]


def _edge(a: Point, b: Point, spacing_m: float) -> list[Point]:
    """Points from a (with it) to b (without)."""
    count = max(1, math.ceil(distance(a, b) / spacing_m))
    return [
        (a[0] + (b[0] - a[0]) * k / count, a[1] + (b[1] - a[1]) * k / count) for k in range(count)
    ]
