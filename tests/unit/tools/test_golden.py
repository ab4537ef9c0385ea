"""Golden flights: replayed to the bit, and changed only with a reason."""

import shutil
from pathlib import Path

import msgspec
import pytest

from autonomy.flightlog.reader import FlightLog
from autonomy.flightlog.recorder import FlightRecorder
from autonomy.model import Command
from tools import golden
from tools.golden import Golden, Renewal, book, digest, log_of, renew, why_not_the_same


@pytest.mark.parametrize("name", book())
def test_every_decision_of_a_golden_flight_is_the_same_in_this_release(name: str) -> None:
    assert why_not_the_same(name) is None


def test_golden_flights_are_different_flights_and_every_renewal_has_its_reason() -> None:
    goldens = book().values()
    assert len({(g.scenario, g.mode, g.faults) for g in goldens}) == len(goldens) >= 3
    assert any(g.faults for g in goldens)
    assert {g.mode for g in goldens} == {"stop", "rolling"}
    for each in goldens:
        assert all(len(renewal.reason) >= golden.REASON_MIN for renewal in each.renewals)


def beginning(name: str, path: Path, ticks: int, last_m_s: float = 0.0) -> Path:
    """The first ticks of a golden flight; the last one's setpoint is `last_m_s` faster north."""
    log = FlightLog.open(log_of(name))
    with FlightRecorder(path, log.header, wait_when_full=True) as recorder:
        recorder.route(log.route())
        for tick in log:
            last = tick.index == ticks - 1
            recorder.tick(tick.inputs, faster(tick.command, last_m_s if last else 0.0), 0.0)
            if last:
                break
    return path


def faster(command: Command, by_m_s: float) -> Command:
    setpoint = command.setpoint
    if setpoint is None or by_m_s == 0.0:
        return command
    north, east, down = setpoint.velocity_ned_m_s
    changed = msgspec.structs.replace(setpoint, velocity_ned_m_s=(north + by_m_s, east, down))
    return msgspec.structs.replace(command, setpoint=changed)


def shelf(folder: Path, name: str, path: Path) -> Path:
    """A folder of golden flights with one in it."""
    shutil.copy(path, log_of(name, folder))
    renewal = Renewal("2026-11-22", "0", "made for this test", digest(path))
    goldens = {name: msgspec.structs.replace(book()[name], renewals=(renewal,))}
    (folder / "flights.json").write_bytes(msgspec.json.encode(goldens))
    return folder


def test_a_decision_that_changed_by_its_last_bit_is_noticed(tmp_path: Path) -> None:
    name = "default_rolling"
    same = shelf(tmp_path, name, beginning(name, tmp_path / "same", 500))
    assert why_not_the_same(name, same) is None
    other = shelf(tmp_path, name, beginning(name, tmp_path / "other", 500, last_m_s=1e-15))
    found = why_not_the_same(name, other)
    assert found is not None
    assert "is decided otherwise at tick 499" in found
    assert "setpoint.velocity_ned_m_s[0]" in found
    assert "--renew default_rolling --reason" in found


def test_a_golden_log_that_was_changed_without_a_reason_is_noticed(tmp_path: Path) -> None:
    name = "default_rolling"
    folder = shelf(tmp_path, name, beginning(name, tmp_path / "short", 50))
    beginning(name, tmp_path / "shorter", 40).rename(log_of(name, folder))
    found = why_not_the_same(name, folder)
    assert found is not None
    assert "was changed without a reason" in found


def test_renewing_flies_again_keeps_what_was_told_before_and_asks_for_a_reason(
    tmp_path: Path,
) -> None:
    first = Renewal("2026-11-01", "0", "the first of its kind", "0" * 64)
    short = Golden("empty", "rolling", 4, renewals=(first,))
    (tmp_path / "flights.json").write_bytes(msgspec.json.encode({"short": short}))
    with pytest.raises(ValueError, match="is no reason: say what is decided otherwise"):
        renew("short", "it broke", tmp_path)
    assert not log_of("short", tmp_path).exists()
    renew("short", "a test wants to see it renewed", tmp_path)
    assert why_not_the_same("short", tmp_path) is None
    kept, added = book(tmp_path)["short"].renewals
    assert kept == first
    assert added.reason == "a test wants to see it renewed"
    assert added.sha256 == digest(log_of("short", tmp_path))
