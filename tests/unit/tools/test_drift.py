"""The drift campaign flies what it says, and tells it in a table."""

import math

from hal.sim.scenario import load_scenario
from tools.drift.flights import Case, drifting, fly
from tools.drift.report import table


def test_the_levels_of_drift_change_the_estimate_alone() -> None:
    room = load_scenario("door")
    assert drifting(room, "default") == room
    assert drifting(room, "none").estimator.position_sigma_m == 0.0
    assert drifting(room, "px4").estimator.velocity_sigma_m_s == 0.025
    assert len(drifting(room, "steady").faults) == 1
    assert drifting(room, "px4").obstacles == room.obstacles


def test_a_drifting_flight_with_the_fix_touches_nothing_and_is_told_in_the_table() -> None:
    case = Case("default", "px4", "rolling", 1, fixed=True)
    flown = fly(case)
    assert not flown.collided
    assert flown.fused > 100
    assert flown.rejected < flown.fused / 10
    assert 0.0 < math.hypot(*flown.errors_m[:2]) < 0.3
    line = table([flown]).splitlines()[-1]
    assert line.startswith("| px4 | default | rolling | yes | 1 ")


def test_without_the_fix_no_wall_is_asked() -> None:
    flown = fly(Case("empty", "none", "rolling", 1, fixed=False))
    assert flown.fused == flown.rejected == 0
    assert max(flown.errors_m) < 0.05
