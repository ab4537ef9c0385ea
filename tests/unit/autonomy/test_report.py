"""The report tells what was measured and nothing that was not."""

import io

import msgspec
import pytest
from rich.console import Console

from autonomy.errors import ExitCode
from autonomy.mission.flown import FlownLeg
from autonomy.model import Ending, FilterHealth, LegKind, SourceHealth
from autonomy.report import EXIT_CODES, FlightReport, report_table
from autonomy.t3drm.bound import PathBound
from autonomy.t3drm.timing import ComputationTime


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


def flown(**fields: object) -> str:
    base = FlightReport(ending=Ending.GOAL_REACHED, why="there", exit_code=0, route_ned_m=())
    return told(msgspec.structs.replace(base, **fields))


@pytest.mark.parametrize(("length_m", "word"), [(9.0, "kept"), (12.6, "NOT KEPT")])
def test_the_bound_on_the_path_is_told_with_what_it_is_made_of(length_m: float, word: str) -> None:
    text = flown(path_length_m=length_m, path_bound=PathBound(12.5, 5.0, 6.7, 1), side_changes=2)
    assert f"12.50 m, {word}: 5.00 m straight and 6.70 m round what was met" in text
    assert "side changes" in text
    assert ("NOT" in text) is (word == "NOT KEPT")


def test_a_flight_that_planned_nothing_has_no_bound_to_tell() -> None:
    assert "path bound" not in flown(path_bound=PathBound(0.25, 0.0, 0.0, 0))


def test_the_radii_of_the_ricci_flow_are_told_with_the_metres_flown_at_them() -> None:
    legs = (
        FlownLeg(3.0, LegKind.TANGENT, 0.23, 1.5),
        FlownLeg(9.0, LegKind.ARC, 0.2, 0.25),
        FlownLeg(12.0, LegKind.TANGENT, 0.23, 2.0),
    )
    assert "3.50 m at 0.230 m, 0.25 m at 0.200 m" in flown(legs=legs)


def test_algorithm_1_is_told_from_start_to_completion() -> None:
    record = ComputationTime(10.0)
    for stamp_s, seconds in ((11.0, 0.002), (12.0, 0.001), (13.0, 0.004)):
        record.replanned(stamp_s, seconds, 1, 0.23)
    record.completed(52.5)
    text = " ".join(flown(timing=record.record()).split())
    assert "7.0 ms in 3 plans, least 1.00, median 2.00, longest 4.00 ms" in text
    assert "completed 42.5 s after the start" in text
    assert "Eq. 8/9 radius 0.229 m" in text


def test_the_estimator_s_rejections_and_what_was_out_of_the_ordinary_are_told() -> None:
    health = FilterHealth(
        position=SourceHealth(0.1, 900, 3, 0.05),
        gnss=SourceHealth(0.2, 40, 0, 0.3),
        gnss_apart_m=4.26,
        frame_jumps=1,
        restarts=2,
    )
    report = FlightReport(Ending.ABORTED, "because", 1, (), estimator=health)
    text = " ".join(told(report).split())
    assert "position 900 fused, 3 rejected; gnss 40 fused, 0 rejected" in text
    assert "GNSS 4.3 m apart from the autopilot; frame jumps 1; filter restarts 2" in text
    assert "floor" not in text
    quiet = told(msgspec.structs.replace(report, estimator=FilterHealth()))
    assert "heard nothing" in quiet
