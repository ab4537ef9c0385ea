"""The drift campaign flies what it says, and tells it in a table."""

from pathlib import Path

import msgspec
import pytest

from hal.sim.scenario import load_scenario
from tools.drift import __main__ as command
from tools.drift.flights import Case, Row, cases, drifting, flown, fly
from tools.drift.report import table


def test_the_levels_of_drift_change_the_estimate_alone() -> None:
    room = load_scenario("door")
    assert drifting(room, "default") == room
    assert drifting(room, "none").estimator.position_sigma_m == 0.0
    assert drifting(room, "px4").estimator.velocity_sigma_m_s == 0.025
    assert len(drifting(room, "steady").faults) == 1
    assert drifting(room, "px4").obstacles == room.obstacles


def test_a_drifting_flight_with_the_fix_touches_nothing_and_is_told_in_the_table() -> None:
    row, book = flown(Case("default", "px4", "rolling", 1, fixed=True))
    assert not row.collided
    assert not row.touch
    assert row.clearance_m > 0.15
    assert row.landing_m > 0.15
    assert row.fused > 100
    assert row.rejected < row.fused / 10
    assert 0.0 < row.error_rms_m < 0.3
    assert min(error for _, error in book.errors) < row.error_rms_m
    lines = table([row]).splitlines()
    assert lines[2].startswith("| px4 | default | rolling | yes | 1 | 1 | 0 | 0 |")
    assert lines[3].startswith("| px4 | all | both | yes | 1 |")


def test_without_the_fix_no_wall_is_asked() -> None:
    row = fly(Case("empty", "none", "rolling", 1, fixed=False))
    assert row.fused == row.rejected == 0
    assert row.error_rms_m < 0.05


def test_the_nearest_moment_is_explained_in_one_sentence() -> None:
    case = Case("default", "px4", "rolling", 1, fixed=True)
    _, book = flown(case, explain_below_m=0.5)
    assert book.touch.startswith(("follow at", "cruise at"))
    assert "taken for" in book.touch
    assert "of which known" in book.touch
    assert "guard:" in book.touch


def test_every_case_is_flown_on_both_sides_seed_by_seed() -> None:
    found = list(cases(("door", "empty"), ("px4",), ("stop",), 2, 5))
    assert [(c.seed, c.room, c.fixed) for c in found] == [
        (seed, room, fixed)
        for seed in (5, 6)
        for room in ("door", "empty")
        for fixed in (True, False)
    ]


def test_what_was_flown_is_not_flown_again(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = tmp_path / "rows"
    kept = [
        Row(
            Case("door", "px4", "stop", 0, fixed),
            "goal_reached",
            fixed,
            0.149,
            0.3,
            0.1,
            0.03,
            60.0,
            9,
            0,
        )
        for fixed in (True, False)
    ]
    rows.write_bytes(b"".join(msgspec.json.encode(row) + b"\n" for row in kept))
    asked = ["--room", "door", "--mode", "stop", "--flights", "1", "--rows", str(rows)]
    assert command.main(asked) == 0
    assert "| px4 | door | stop | yes | 1 | 1 | 1 | 0 | 0.149 |" in capsys.readouterr().out
    assert len(rows.read_bytes().splitlines()) == 2
