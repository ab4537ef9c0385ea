"""BIT* (Gammell, Srinivasa and Barfoot, ICRA 2015) as OMPL has it."""

from typing import Any

from tools.bench.baselines.sampling import SamplingPlanner


def bit_star(budget_s: float) -> SamplingPlanner:
    """OMPL's defaults; `budget_s` of CPU time."""

    def make(information: Any) -> Any:
        from ompl import geometric

        return geometric.BITstar(information)

    return SamplingPlanner("BIT*", make, budget_s)
