"""The paper's experiments: what it prints is what we calculate with, and small ones run."""

import math
from pathlib import Path

import pytest

from autonomy.simulation import goal_of
from tools import pages
from tools.bench.paper import report
from tools.bench.paper.__main__ import FRONT, PAGE, parsed, wrong
from tools.bench.paper.compared import PLANNERS, T3DRM, compare, known_map, length_m
from tools.bench.paper.flights import (
    IDEAL,
    MAVSDK,
    SCENARIOS,
    SIMULATED,
    Case,
    Row,
    cases,
    fly,
    scenario_of,
)
from tools.bench.paper.ideal import without_error
from tools.bench.paper.printed import COMPARED, FLOWN, SPEED_M_S, deviation, saved
from tools.bench.rooms import shipped_config
from tools.bench.worlds.truth import truth


def test_the_paper_s_deviations_are_of_the_flight_and_three_are_not_under_5_percent() -> None:
    of_the_simulation = []
    for row in FLOWN:
        assert deviation(row.simulated_m, row.flown_m) == pytest.approx(
            row.length_deviation, abs=1.5e-4
        )
        assert deviation(row.simulated_s, row.flown_s) == pytest.approx(
            row.time_deviation, abs=2e-4
        )
        of_the_simulation.append(row.flown_m / row.simulated_m - 1.0)
        of_the_simulation.append(row.flown_s / row.simulated_s - 1.0)
    assert sum(off >= 0.05 for off in of_the_simulation) == 3
    assert FLOWN[1].simulated_m / FLOWN[1].simulated_s > SPEED_M_S + 0.01


def test_the_paper_s_savings_are_of_its_own_length_and_scenario_5_s_of_nothing() -> None:
    for row in COMPARED[:2]:
        assert row.others / row.t3drm - 1.0 == pytest.approx(row.saved, abs=1e-4)
        assert saved(row.t3drm, row.others) < row.saved
    assert abs(saved(COMPARED[2].t3drm, COMPARED[2].others) - COMPARED[2].saved) > 0.03


@pytest.mark.parametrize("number", SCENARIOS)
def test_a_reconstruction_is_an_arena_of_6_m_in_which_there_is_a_way(number: int) -> None:
    scenario = scenario_of(number)
    ring = scenario.fence.outline_ne_m
    for axis in (0, 1):
        assert max(p[axis] for p in ring) - min(p[axis] for p in ring) == pytest.approx(5.6)
    assert "reconstruction" in scenario.title
    assert truth(scenario, shipped_config(scenario, "stop")).passage_m >= 0.3


def test_start_and_goal_are_the_paper_s_where_it_gives_them() -> None:
    for row in COMPARED:
        north, east = scenario_of(row.scenario).goal_ne_m
        (x0, y0), (x1, y1) = row.start, row.goal
        assert (north, east) == pytest.approx(((y1 - y0) * row.unit_m, (x1 - x0) * row.unit_m))


def test_without_error_the_world_is_the_same() -> None:
    exact = without_error(scenario_of(1))
    assert exact.obstacles == scenario_of(1).obstacles
    assert exact.beams.dropout_probability == exact.estimator.position_sigma_m == 0.0
    assert exact.vehicle.response == "ideal"


def test_scenario_1_is_flown_ideally_and_with_noise_and_told_beside_the_paper(
    tmp_path: Path,
) -> None:
    ideal, noisy = (fly(Case(1, how, "rolling", 0)) for how in (IDEAL, SIMULATED))
    for row in (ideal, noisy):
        assert row.ending == "goal_reached"
        assert row.length_m >= math.hypot(*scenario_of(1).goal_ne_m) - 0.3
        assert row.navigation_s * SPEED_M_S > 0.9 * row.length_m
        assert wrong(row) == ""
    assert ideal.length_m < noisy.length_m + 0.2
    told = report.flown_table([ideal, noisy])
    assert "| 1 | rolling: measured response and noise, in process | 1 of 1 |" in told
    assert "6.14" in told
    assert len({line.count("|") for line in told.splitlines()}) == 1
    trials = list(compare((5,), 1))
    report.draw(tmp_path / "five.png", [ideal, noisy], trials)
    assert (tmp_path / "five.png").stat().st_size > 10_000


def test_t3drm_loses_no_length_to_the_others_where_all_are_judged_alike() -> None:
    trials = list(compare((3, 4, 5), 1))
    for number in (3, 4, 5):
        own = length_m(trials, number, T3DRM)
        assert own is not None
        for planner in PLANNERS:
            other = length_m(trials, number, planner)
            assert other is None or other > own - 0.02
        problem = known_map(scenario_of(number))
        assert (problem.high[0] - problem.low[0]) == pytest.approx(5.6)
    told = report.compared_table(trials)
    assert len({line.count("|") for line in told.splitlines()}) == 1
    assert "| 3 | potential field |" in told


def test_a_planner_that_fails_and_a_flight_that_does_not_arrive_are_told() -> None:
    row = Row(Case(1, MAVSDK, "stop", 0), "unreachable", 3.0, 20.0, 2, 3, 0.2)
    assert wrong(row) == "unreachable"
    assert "| 1 | stop: flight over MAVSDK and the mock PX4 | 0 of 1 |" in report.flown_table([row])
    trials = list(compare((4,), 1))
    assert length_m(trials, 3, T3DRM) is None


def test_in_short_each_scenario_has_its_lines_beside_the_paper_s() -> None:
    rows = [
        Row(Case(1, IDEAL, "rolling", 0), "goal_reached", 6.0, 30.0, 0, 3, 0.2),
        Row(Case(1, MAVSDK, "rolling", 0), "goal_reached", 6.5, 33.0, 0, 3, 0.2),
        Row(Case(1, MAVSDK, "rolling", 1), "goal_reached", 6.0, 27.0, 0, 3, 0.2),
        Row(Case(1, MAVSDK, "rolling", 2), "unreachable", 3.0, 90.0, 0, 3, 0.2),
    ]
    lines = report.in_short(rows, list(compare((3,), 1))).splitlines()
    assert len({line.count("|") for line in lines}) == 1
    (flown,) = [line for line in lines if line.startswith("| 1 |")]
    assert flown.endswith("length, time (2) | +4.00%, +0.00% | +4.7%, +4.8% |")
    assert sum(line.startswith("| 3 |") for line in lines) == 1


def test_the_command_line_is_checked_and_the_page_has_its_places(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert parsed(["--flights", "2"]).flights == 2
    with pytest.raises(SystemExit):
        parsed(["--trials", "0"])
    assert "at least 1" in capsys.readouterr().err
    pages.must_have("flown", PAGE)
    pages.must_have("compared", PAGE)
    pages.must_have("paper", FRONT)
    flights = list(cases((IDEAL, SIMULATED), ("stop",), 20))
    assert len(flights) == 2 * (1 + 20)
    assert goal_of(scenario_of(5), shipped_config(scenario_of(5), "stop"))[2] == -1.0
