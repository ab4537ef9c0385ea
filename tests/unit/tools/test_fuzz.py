"""A little of every fuzzing target, whatever was found before, and the tool itself."""

import functools
import json
from pathlib import Path

import numpy as np
import pytest

from tools.fuzz import wire
from tools.fuzz.__main__ import SAVED, TARGETS, fuzz, main, problem
from tools.fuzz.cases import Broken, Tally, Target, pieces, shrunk

FOUND = sorted((Path(__file__).parents[3] / SAVED).glob("*.case"))
CASES = {"nmea": 60, "ubx": 60, "i2c": 3, "yaml": 24, "api": 15}
TICKS = 300
"""Of a flight here: armed, up, and the first metres."""


@pytest.mark.parametrize("name", CASES)
def test_hostile_input_is_dropped_and_counted(name: str) -> None:
    result = fuzz(TARGETS[name], seed=1, seconds=60.0, most=CASES[name])
    assert result.findings == []
    assert result.cases == CASES[name]
    assert sum(result.tally.values()) >= result.cases


def early(case: bytes) -> bytes:
    """The same messages within the first ticks."""
    timed = [json.loads(line) for line in case.splitlines()]
    kept = [line for line, each in zip(case.splitlines(), timed, strict=True) if each[0] < TICKS]
    return b"\n".join(kept)


def test_what_must_not_be_believed_changes_no_command_of_a_flight() -> None:
    case = b"\n".join(
        early(wire.make_harmless(np.random.default_rng([2, number]))) for number in range(6)
    )
    tally = wire.run_harmless(case, TICKS)
    assert tally["messages put in"] > 200
    reasons = ("another sender", "another vehicle", "unreadable", "its time leapt", "late")
    assert all(tally[reason] > 5 for reason in reasons), tally


def test_what_is_said_in_the_vehicles_name_makes_nothing_infinite() -> None:
    case = b"\n".join(
        early(wire.make_anything(np.random.default_rng([2, number]))) for number in range(6)
    )
    assert wire.run_anything(case, TICKS)["messages put in"] > 60


def test_a_believed_message_would_be_noticed() -> None:
    pilots = wire.TEMPLATES["HEARTBEAT"] | {"base_mode": 128}
    line = json.dumps((TICKS - 50, "HEARTBEAT", 1, 1, json.dumps(pilots)))
    with pytest.raises(Broken, match="is not what it is without"):
        wire.run_harmless(line.encode(), TICKS)


@pytest.mark.parametrize("path", FOUND, ids=lambda path: path.stem)
def test_what_was_found_once_is_found_no_more(path: Path) -> None:
    target = TARGETS[path.stem.partition("-")[0]]
    assert problem(target, path.read_bytes()) is None


def refuses(letter: bytes, case: bytes) -> Tally:
    if letter in case:
        raise Broken("there it is")
    return Tally(read=1)


SENSITIVE = Target(
    "sensitive", lambda rng: rng.bytes(200), functools.partial(refuses, b"\x07"), pieces
)


def test_a_finding_is_made_small() -> None:
    case = b"a" * 100 + b"\x07" + b"b" * 100
    small = shrunk(case, SENSITIVE, lambda each: problem(SENSITIVE, each) is not None)
    assert b"\x07" in small
    assert len(small) <= 8


def test_findings_are_saved_told_and_end_with_1(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(TARGETS, "nmea", SENSITIVE)
    code = main(["--target", "nmea", "--cases", "8", "--save", str(tmp_path)])
    saved = sorted(tmp_path.glob("nmea-*.case"))
    assert code == 1
    assert saved
    assert all(b"\x07" in path.read_bytes() for path in saved)
    told = capsys.readouterr()
    assert "Broken: there it is" in told.err
    assert f"| {len(saved)} | read" in told.out


def test_the_same_seed_makes_the_same_cases() -> None:
    for target in TARGETS.values():
        one, other = (target.make(np.random.default_rng([3, 4])) for _ in range(2))
        assert one == other
