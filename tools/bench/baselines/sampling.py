"""What RRT* and BIT* share: the OMPL wheel (extra `bench`), one problem, a budget of CPU time.

Fair to them: motions are tested exactly (segment against discs, compiled) instead of by sampled
states, budgets count CPU time of the thread, and setting up is not timed. Sampling draws from
OMPL's own generator, seeded once per process: a run repeats only as far as time does.
"""

import time
from collections.abc import Callable
from typing import Any

import numpy as np

from tools.bench.baselines import kernels
from tools.bench.baselines.interface import Answer, Floats, discs_of
from tools.bench.maps import Map

try:
    from ompl import base, util
except ImportError:  # the extra `bench` is not installed
    base = util = None

SEED = 1
MISSING = "RRT* and BIT* are left out: install the extra 'bench' (the ompl wheel) to run them"


def available() -> bool:
    """True when the wheel is installed."""
    return base is not None


def seed(number: int) -> None:
    """Seed OMPL's generator and silence its log; once, before the first planner is made."""
    util.setLogLevel(util.LogLevel.LOG_NONE)
    util.RNG.setSeed(number)


class SamplingPlanner:
    """An asymptotically optimal planner of OMPL with its default settings and a budget."""

    def __init__(self, kind: str, make: Callable[[Any], Any], budget_s: float) -> None:
        self.kind = kind
        self._make = make
        self.budget_s = budget_s

    @property
    def name(self) -> str:
        """With the budget."""
        return f"{self.kind}, {1e3 * self.budget_s:.0f} ms"

    def plan(self, problem: Map) -> Answer:
        """The best path when the budget is spent, None when none reaches the goal exactly."""
        return self.plan_until(problem, 0.0)

    def plan_until(self, problem: Map, length_m: float) -> Answer:
        """As `plan`, ending early once a path no longer than `length_m` is found."""
        space = base.RealVectorStateSpace(2)
        bounds = base.RealVectorBounds(2)
        for axis in range(2):
            bounds.setLow(axis, problem.low[axis])
            bounds.setHigh(axis, problem.high[axis])
        space.setBounds(bounds)
        information = base.SpaceInformation(space)
        motions, states = _checks(information, discs_of(problem))
        information.setMotionValidator(motions)
        information.setStateValidityChecker(states)
        information.setup()
        definition = base.ProblemDefinition(information)
        start, goal = space.allocState(), space.allocState()
        for axis in range(2):
            start[axis], goal[axis] = problem.start[axis], problem.goal[axis]
        definition.setStartAndGoalStates(start, goal)
        objective = base.PathLengthOptimizationObjective(information)
        objective.setCostThreshold(base.Cost(length_m))
        definition.setOptimizationObjective(objective)
        planner = self._make(information)
        planner.setProblemDefinition(definition)
        planner.setup()
        begin = time.thread_time()
        end = begin + self.budget_s
        planner.solve(base.PlannerTerminationCondition(lambda: time.thread_time() > end))
        seconds = time.thread_time() - begin
        if not definition.hasExactSolution():
            return Answer(None, seconds)
        corners = definition.getSolutionPath().getStates()
        return Answer(np.array([(corner[0], corner[1]) for corner in corners]), seconds)


def _checks(information: Any, discs: Floats) -> tuple[Any, Any]:
    """The motion and the state check of a map (classes of OMPL, made when it is there)."""

    class Motions(base.MotionValidator):  # type: ignore[misc, name-defined, unused-ignore]  # no stubs
        def checkMotion(self, a: Any, b: Any, *_: Any) -> bool:
            return bool(kernels.sees(discs, a[0], a[1], b[0], b[1]))

    class States(base.StateValidityChecker):  # type: ignore[misc, name-defined, unused-ignore]  # no stubs
        def isValid(self, state: Any) -> bool:
            n, e = state[0], state[1]
            return bool(kernels.sees(discs, n, e, n, e))

    return Motions(information), States(information)
