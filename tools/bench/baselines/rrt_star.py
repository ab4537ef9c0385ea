"""RRT* (Karaman and Frazzoli, IJRR 2011) as OMPL has it."""

from typing import Any

from tools.bench.baselines.sampling import SamplingPlanner


def rrt_star(budget_s: float) -> SamplingPlanner:
    """OMPL's defaults; `budget_s` of CPU time."""

    def make(information: Any) -> Any:
        from ompl import geometric

        return geometric.RRTstar(information)

    return SamplingPlanner("RRT*", make, budget_s)
