"""Which signals end a flight tidily, in each of the places that listen for them."""

import asyncio
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest

from autonomy.app import Mission, _termination_interrupts, flight_recorder, prepare
from autonomy.report import FlyOptions
from autonomy.termination import termination_signals, termination_waits
from tests.unit.autonomy.test_serving import Stage


@pytest.fixture(autouse=True)
def _same_signals_afterwards() -> Iterator[None]:
    before = {number: signal.getsignal(number) for number in signal.Signals if number.value < 16}
    yield
    for number, handler in before.items():
        if handler is not None and number not in (signal.SIGKILL,):
            signal.signal(number, handler)


def test_a_terminal_that_goes_away_ends_the_program_unless_it_was_told_to_ignore_it() -> None:
    signal.signal(signal.SIGHUP, signal.SIG_DFL)
    assert signal.SIGHUP in termination_signals()
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    assert termination_signals() == (signal.SIGINT, signal.SIGTERM)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_before_the_flight_each_of_them_is_a_ctrl_c(number: signal.Signals) -> None:
    signal.signal(signal.SIGHUP, signal.SIG_DFL)
    with pytest.raises(KeyboardInterrupt), _termination_interrupts():
        signal.raise_signal(number)
    assert signal.getsignal(signal.SIGHUP) is signal.SIG_DFL


async def test_a_service_ends_when_its_terminal_goes_away(tmp_path: Path) -> None:
    signal.signal(signal.SIGHUP, signal.SIG_DFL)
    stage = Stage(tmp_path)
    stage.rig.vehicle.away = True
    async with asyncio.timeout(10.0):
        serving = asyncio.get_running_loop().create_task(stage.service.run())
        await stage.until_true(lambda: "nobody answered" in stage.station.why)
        signal.raise_signal(signal.SIGHUP)
        await serving


def mission(folder: Path) -> Mission:
    return prepare(FlyOptions(goals=((1.0, 0.0, None),), log_dir=str(folder), scenario="empty"))


class NoVehicle(Exception):
    """The start that fails."""


def test_a_start_that_failed_leaves_no_flight_log(tmp_path: Path) -> None:
    seen: list[Path] = []

    def start() -> None:
        with flight_recorder(mission(tmp_path), print):
            seen.extend(tmp_path.iterdir())
            raise NoVehicle

    with pytest.raises(NoVehicle):
        start()
    assert len(seen) == 1
    assert list(tmp_path.iterdir()) == []


def test_a_signal_waits_for_the_next_safe_place() -> None:
    reached: list[str] = []

    def work() -> None:
        with termination_waits() as take_effect:
            take_effect()
            signal.raise_signal(signal.SIGINT)
            reached.append("not lost, not yet raised")
            take_effect()
            reached.append("too far")

    with pytest.raises(KeyboardInterrupt):
        work()
    assert reached == ["not lost, not yet raised"]


def test_a_signal_that_met_no_safe_place_takes_effect_at_the_end() -> None:
    before = signal.getsignal(signal.SIGTERM)
    with pytest.raises(KeyboardInterrupt), termination_waits():
        signal.raise_signal(signal.SIGTERM)
    assert signal.getsignal(signal.SIGTERM) is before
