"""Where a conic ends inside a path, the path bends less than on the arc that the conic replaces."""

import math

import numpy as np
import pytest

from autonomy.config import PlannerConfig
from autonomy.model import LegKind, Plan
from autonomy.t3drm.planner import Planner
from hal.config import Fence
from tools.bench.planners import greatest_kink_rad

CORNER_M = 0.005
"""How far a corner may be cut."""


@pytest.mark.parametrize("first", range(0, 60, 10))
def test_a_kink_bends_less_than_the_arc(first: int) -> None:
    planner = Planner(PlannerConfig(), 0.15, Fence.rectangle((-1.0, 7.0), (-1.0, 7.0)))
    tightest = math.inf
    conics = 0
    for seed in range(first, first + 10):
        rng = np.random.default_rng(seed)
        rows = []
        for _ in range(4):
            turn, middle = rng.uniform(0.0, math.tau), rng.uniform(1.0, 5.0, 2)
            at = np.arange(-0.8, 0.8, 0.03)
            rows.append(middle + np.outer(at, (math.cos(turn), math.sin(turn))))
        plan = planner.plan((-0.3, -0.3), (6.3, 6.3), np.concatenate(rows))
        if isinstance(plan, Plan):
            conics += sum(leg.kind is LegKind.HYPERBOLA for leg in plan.legs)
            half = 0.5 * greatest_kink_rad(plan)
            if half > 0.0:
                tightest = min(tightest, CORNER_M / (1.0 / math.cos(half) - 1.0))
    assert conics > 0
    assert tightest > planner.keep_outs_m[0]
