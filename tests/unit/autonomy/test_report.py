"""The report tells what was measured and nothing that was not."""

import io

import pytest
from rich.console import Console

from autonomy.errors import ExitCode
from autonomy.model import Ending
from autonomy.report import EXIT_CODES, FlightReport, report_table


def told(report: FlightReport) -> str:
    out = io.StringIO()
    Console(file=out, width=120, highlight=False).print(report_table(report))
    return out.getvalue()


def test_every_ending_has_its_own_exit_code() -> None:
    assert set(EXIT_CODES) == set(Ending)
    assert len(set(EXIT_CODES.values())) == len(EXIT_CODES)
    assert [e for e, code in EXIT_CODES.items() if code == 0] == [Ending.GOAL_REACHED]
    assert EXIT_CODES[Ending.GOAL_REACHED] is ExitCode.GOAL_REACHED


@pytest.mark.parametrize("ending", list(Ending))
def test_a_flight_that_never_flew_is_told_too(ending: Ending) -> None:
    text = told(FlightReport(ending=ending, why="because", exit_code=1, route_ned_m=()))
    assert ending.value.replace("_", " ").capitalize() in text
    assert "because" in text
    assert "nothing was near" in text
    for absent in ("planning", "legs", "guard", "late", "scenario", "flight log"):
        assert absent not in text


def test_what_happened_below_the_plan_is_told() -> None:
    text = told(
        FlightReport(
            ending=Ending.ABORTED,
            why="the operator stopped it [red]now[/red]",
            exit_code=10,
            route_ned_m=((1.0, 2.0, -1.0), (0.0, 0.0, -1.0)),
            guard_limits={"speed": 3, "fence": 12},
            late_ticks=2,
            scenario="door",
            seed=4,
            log_notes=("3 ticks are missing",),
        )
    )
    assert "(1, 2, -1) -> (0, 0, -1) m" in text
    assert "fence 12, speed 3" in text
    assert "door, seed 4" in text
    assert "3 ticks are missing" in text
    assert "[red]now[/red]" in text
