"""A campaign that was stopped goes on; what was flown is not flown again."""

from pathlib import Path

import msgspec
import pytest

from tools import campaign


class Case(msgspec.Struct, frozen=True):
    number: int


class Row(msgspec.Struct, frozen=True):
    case: Case
    squared: int


CASES = [Case(3), Case(1), Case(2)]


def fly(case: Case) -> Row:
    return Row(case, case.number**2)


def never(case: Case) -> Row:
    raise AssertionError(f"{case} was flown before")


@pytest.mark.parametrize("jobs", [1, 2])
def test_rows_come_in_the_order_of_the_cases_whoever_was_ready_first(jobs: int) -> None:
    rows = campaign.flown(CASES, fly, Row, jobs=jobs)
    assert [row.squared for row in rows] == [9, 1, 4]


def test_a_case_that_is_named_twice_is_flown_once() -> None:
    assert len(campaign.flown([*CASES, *CASES], fly, Row)) == len(CASES)


def test_what_was_flown_is_read_again_and_only_what_was_asked_for_counts(tmp_path: Path) -> None:
    kept = tmp_path / "rows.jsonl"
    campaign.flown(CASES, fly, Row, kept=kept)
    again = campaign.flown(CASES[:2], never, Row, kept=kept)
    assert [row.case for row in again] == CASES[:2]


def test_a_torn_last_line_is_flown_again(tmp_path: Path) -> None:
    kept = tmp_path / "rows.jsonl"
    campaign.flown(CASES, fly, Row, kept=kept)
    whole = kept.read_bytes()
    kept.write_bytes(whole[:-4])
    flown: list[Case] = []

    def count(case: Case) -> Row:
        flown.append(case)
        return fly(case)

    assert [row.squared for row in campaign.flown(CASES, count, Row, kept=kept)] == [9, 1, 4]
    assert flown == CASES[2:]
    assert kept.read_bytes() == whole


def test_a_file_of_something_else_is_refused_by_file_and_line(tmp_path: Path) -> None:
    kept = tmp_path / "rows.jsonl"
    kept.write_text('{"case": {"number": 1}, "squared": 1}\n{"other": 2}\n')
    with pytest.raises(ValueError, match=r"rows\.jsonl, line 2 is no row of this campaign"):
        campaign.flown(CASES, fly, Row, kept=kept)


def test_what_is_wrong_is_told_with_its_case(capsys: pytest.CaptureFixture[str]) -> None:
    campaign.flown(CASES, fly, Row, wrong=lambda row: "odd" if row.squared == 9 else "")
    assert capsys.readouterr().err == "odd: Case(number=3)\n"
