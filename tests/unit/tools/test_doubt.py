"""The measuring of the doubt: which flights, what is counted, where it is written."""

from collections import Counter
from pathlib import Path

import pytest

from hal.sim.fault_kinds import parse_fault
from tools.doubt.flights import BEAMS, KINDS, Case, Row, faulty, fly, healthy
from tools.doubt.report import tables
from tools.pages import renewed


def row(case: Case, **more: object) -> Row:
    data: dict[str, object] = {
        "ending": "goal_reached",
        "why": "there",
        "on_ground": True,
        "collided": False,
        "clearance_m": 0.2,
        "airborne_s": 60.0,
        "began_s": 10.0,
        "active_s": 40.0,
        "delay_s": None,
        "word": "",
        "doubts": (),
    }
    return Row(case, **(data | more))  # type: ignore[arg-type]  # a keyword each


def test_every_kind_comes_on_every_beam_and_every_fault_is_one_that_can_be_asked_for() -> None:
    cases = list(faulty(len(KINDS) * len(BEAMS)))
    assert {(case.kind, case.beam) for case in cases} == {(k, b) for k in KINDS for b in BEAMS}
    for case in cases:
        assert parse_fault(case.fault).model_dump()["beam"] == case.beam
    assert cases == list(faulty(len(cases)))


def test_flights_without_a_fault_have_every_room_equally_often() -> None:
    assert len(set(Counter(case.room for case in healthy(2)).values())) == 1


def test_a_flight_with_a_covered_lens_is_found_and_ends_well() -> None:
    found = fly(Case("empty", "rolling", 0.0, 3, "beam_blocked", "left", 6.0))
    assert (found.ending, found.collided, found.word) == ("goal_reached", False, "too near")
    assert found.delay_s is not None
    assert 0.4 < found.delay_s < 2.0


def test_only_doubts_without_a_fault_behind_them_are_false_alarms() -> None:
    case = Case("empty", "stop", 0.0, 1, "beam_stuck", "left", 5.0)
    doubts = ((12.0, "left", "stuck"), (9.0, "left", "jumping"), (20.0, "up", "too near"))
    text = tables([row(case, doubts=doubts, delay_s=2.0, word="stuck")])
    counted = {
        line.split(" | ")[0].strip("| "): line.split(" | ")[1] for line in text.split("\n")[4:12]
    }
    assert counted["stuck"] == "0"
    assert counted["jumping"] == "1"
    assert counted["too near"] == "1"
    assert "| `beam_stuck` | 1 of 1 | 2.0, 2.0 |" in text


def test_endings_are_counted_and_a_collision_is_not_hidden() -> None:
    case = Case("empty", "stop", 0.0, 1, "beam_stuck", "left", 5.0)
    rows = [row(case), row(case, ending="failsafe", collided=True, clearance_m=0.1)]
    assert "| **all** | 2 | 1 | 1 | 0 | 1 | 0.10 m |" in tables(rows)


def test_tables_go_between_their_marks_and_nowhere_else() -> None:
    begin, end = "<!-- tables: begin -->", "<!-- tables: end -->"
    page = f"head\n{begin}\nold\n{end}\ntail\n"
    assert renewed(page, "tables", "new") == f"head\n{begin}\n\nnew\n\n{end}\ntail\n"
    with pytest.raises(ValueError, match="no place for tables: the markers <!-- tables"):
        renewed("head", "tables", "new")


def test_the_page_has_the_marks() -> None:
    page = Path(__file__).parents[3] / "autonomy" / "perception" / "doubt" / "README.md"
    renewed_page = renewed(page.read_text(encoding="utf-8"), "tables", "new")
    assert "new\n\n<!-- tables: end -->" in renewed_page
