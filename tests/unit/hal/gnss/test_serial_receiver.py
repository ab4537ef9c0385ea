"""The shell round the stream: searching the rate, giving up, coming back; on scripted ports."""

import asyncio
import errno
import sys
import threading
from collections.abc import Callable, Iterator
from types import TracebackType
from typing import Self

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hal.clock import SimClock
from hal.config import SerialGnssConfig
from hal.errors import ConnectionFailed
from hal.gnss.serial_port import PortGone, SerialPort, what_to_do
from hal.gnss.serial_receiver import (
    GARBAGE_BYTES,
    LISTEN_S,
    RATES,
    BackOff,
    BaudSearch,
    PortState,
    SerialReceiver,
)
from tests.support.gnss import gga, gsa, moved_deg, nav_pvt, rmc

# ---------------------------------------------------------------- the search


def test_a_search_tries_every_rate_once_a_pass_and_bounds_each_by_time() -> None:
    search = BaudSearch(RATES, 3.0)
    search.begin(0.0)
    tried, now_s = [search.baud], 0.0
    while not search.passes:
        now_s += 0.1
        if search.hear(0, 0, now_s):
            tried.append(search.baud)
    assert tried == [*RATES, RATES[0]]
    assert now_s <= len(RATES) * (LISTEN_S + 0.1) + 0.1


def test_garbage_ends_a_rate_before_its_time() -> None:
    search = BaudSearch((9_600, 38_400), 3.0)
    search.begin(0.0)
    assert not search.hear(GARBAGE_BYTES - 1, 0, 0.1)
    assert search.hear(1, 0, 0.2)
    assert search.baud == 38_400


def test_a_frame_ends_the_search_and_silence_begins_it_with_the_same_rate() -> None:
    search = BaudSearch((9_600, 38_400), 3.0)
    search.begin(0.0)
    assert not search.hear(100, 1, 1.0)
    assert search.found
    assert not search.hear(10 * GARBAGE_BYTES, 0, 3.9)
    assert search.hear(0, 0, 4.0)
    assert (search.baud, search.found, search.passes) == (9_600, False, 0)
    assert search.hear(0, 0, 4.0 + LISTEN_S)
    assert search.baud == 38_400


def test_a_pass_counts_from_the_last_frame() -> None:
    search = BaudSearch((9_600, 38_400, 115_200), 3.0)
    search.begin(0.0)
    search.hear(GARBAGE_BYTES, 0, 0.1)
    search.hear(100, 1, 0.2)
    search.hear(0, 0, 3.3)
    passes = []
    for step in range(3):
        assert search.hear(GARBAGE_BYTES, 0, 3.4 + 0.1 * step)
        passes.append(search.passes)
    assert passes == [0, 0, 1]
    assert search.baud == 38_400


def test_a_fixed_rate_is_never_changed() -> None:
    search = BaudSearch((57_600,), 3.0)
    search.begin(0.0)
    for step in range(100):
        assert not search.hear(GARBAGE_BYTES, 0, step * 1.0)
    assert search.baud == 57_600
    assert search.passes == 100


@settings(deadline=None, max_examples=60)
@given(
    st.lists(
        st.tuples(st.integers(0, 2_000), st.sampled_from([0, 0, 0, 1]), st.floats(0.0, 4.0)),
        max_size=80,
    )
)
def test_whatever_is_heard_the_rate_changes_only_by_saying_so(
    heard: list[tuple[int, int, float]],
) -> None:
    search = BaudSearch(RATES, 3.0)
    search.begin(0.0)
    now_s, before = 0.0, search.baud
    for count, frames, step_s in heard:
        now_s += step_s
        changed = search.hear(count, frames, now_s)
        assert search.baud in RATES
        assert changed or search.baud == before
        assert not (changed and frames)
        before = search.baud


def test_pauses_double_up_to_a_limit_and_begin_anew_after_a_success() -> None:
    back_off = BackOff(0.2, 1.0)
    assert [back_off.pause_s() for _ in range(5)] == [0.2, 0.4, 0.8, 1.0, 1.0]
    back_off.succeed()
    assert back_off.pause_s() == 0.2


# ---------------------------------------------------------------- the receiver

Script = Iterator[tuple[float, bytes | PortGone]]


class ScriptedPort:
    """Says what its script says, and lets time pass; at the script's end it waits in silence."""

    def __init__(self, script: Script, clock: SimClock, done: threading.Event) -> None:
        self._script = script
        self._clock = clock
        self._done = done
        self.rates: list[int] = []

    def read(self) -> bytes:
        entry = next(self._script, None)
        if entry is None:
            self._done.set()
            threading.Event().wait(0.001)
            return b""
        self._clock.advance(entry[0])
        if isinstance(entry[1], PortGone):
            raise entry[1]
        return entry[1]

    def set_baud(self, baud: int) -> None:
        self.rates.append(baud)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        pass


class Bench:
    """A receiver on scripted ports; each opening of the port takes the next script."""

    def __init__(self, *scripts: Script | PortGone, **config: float | str) -> None:
        self.clock = SimClock(100.0)
        self.done = threading.Event()
        self.opened_at: list[int] = []
        self.ports: list[ScriptedPort] = []
        self._scripts = iter(scripts)
        settings = {"port": "/dev/receiver", "baud": 38_400, "reopen_after_s": 1e-3} | config
        self.receiver = SerialReceiver(
            SerialGnssConfig.model_validate(settings), self.clock, self._open
        )

    def _open(self, path: str, baud: int) -> ScriptedPort:
        assert path == "/dev/receiver"
        self.opened_at.append(baud)
        script = next(self._scripts, iter(()))
        if isinstance(script, PortGone):
            raise script
        self.ports.append(ScriptedPort(script, self.clock, self.done))
        return self.ports[-1]

    async def until_done(self) -> None:
        assert await asyncio.to_thread(self.done.wait, 10.0)


def epochs(first: int, last: int, **fields: int) -> Script:
    """NAV-PVT at 1 Hz, with silence after each."""
    for step in range(first, last):
        yield 0.9, nav_pvt(step, latitude_deg=moved_deg(step), **fields)
        yield 0.1, b""


async def test_it_opens_with_the_first_solution_and_keeps_the_last_after_closing() -> None:
    bench = Bench(epochs(0, 5))
    receiver = bench.receiver
    assert receiver.fix() is None
    assert receiver.health().state is PortState.CLOSED
    await receiver.open(10.0)
    await bench.until_done()
    fix = receiver.fix()
    assert fix is not None
    assert fix.stamp_s == pytest.approx(104.8)
    assert receiver.health().state is PortState.RECEIVING
    assert receiver.health().counts.told == 5
    await receiver.close()
    await receiver.close()
    assert receiver.fix() == fix
    assert receiver.health().state is PortState.CLOSED
    assert not [thread for thread in threading.enumerate() if thread.name == "gnss"]


async def test_a_device_that_vanishes_leaves_its_last_fix_with_its_own_stamp() -> None:
    gone = PortGone("/dev/receiver does not answer")
    bench = Bench(
        iter([*epochs(0, 3), (0.5, gone)]), PortGone("still away"), PortGone("still away")
    )
    await bench.receiver.open(10.0)
    await bench.until_done()
    fix = bench.receiver.fix()
    assert fix is not None
    assert fix.stamp_s == pytest.approx(102.8)
    assert bench.receiver.health().times_gone == 3
    assert bench.receiver.health().state is PortState.SEARCHING
    await bench.receiver.close()


async def test_a_device_that_returns_is_heard_again_also_with_another_time() -> None:
    gone = PortGone("/dev/receiver does not answer")
    bench = Bench(iter([*epochs(100, 103), (0.5, gone)]), epochs(0, 4))
    await bench.receiver.open(10.0)
    await bench.until_done()
    fix = bench.receiver.fix()
    assert fix is not None
    assert fix.stamp_s == pytest.approx(100.0 + 3.0 + 0.5 + 4.0 - 0.1 - 0.1)
    assert bench.receiver.health().counts.told == 7
    await bench.receiver.close()


async def test_a_port_that_stays_open_and_silent_is_searched_anew_and_tells_nothing_new() -> None:
    silence = [(0.1, b"") for _ in range(200)]
    bench = Bench(iter([*epochs(0, 3), *silence]), baud="auto")
    await bench.receiver.open(10.0)
    await bench.until_done()
    fix = bench.receiver.fix()
    assert fix is not None
    assert fix.stamp_s == pytest.approx(102.8)
    assert bench.receiver.health().state is PortState.SEARCHING
    assert bench.receiver.health().passes >= 1
    assert set(bench.ports[0].rates) == set(RATES)
    await bench.receiver.close()


async def test_silence_after_a_burst_ends_its_epoch() -> None:
    bench = Bench(iter([(0.5, gga(1.0) + rmc(1.0)), (0.1, b"")]))
    await bench.receiver.open(10.0)
    fix = bench.receiver.fix()
    assert fix is not None
    assert fix.stamp_s == pytest.approx(100.4)
    await bench.receiver.close()


async def test_a_device_with_a_loose_contact_is_not_waited_for_longer_and_longer() -> None:
    gone = PortGone("/dev/receiver does not answer")
    contacts = [iter([*epochs(10 * n, 10 * n + 1), (0.1, gone)]) for n in range(16)]
    bench = Bench(*contacts, reopen_max_s=60.0)
    await bench.receiver.open(10.0)
    await bench.until_done()
    assert bench.receiver.health().times_gone == 16
    await bench.receiver.close()


async def test_it_is_opened_again_at_the_rate_that_was_right() -> None:
    garbage = [(0.1, b"\xff" * GARBAGE_BYTES)] * 2
    gone = PortGone("/dev/receiver does not answer")
    bench = Bench(iter([*garbage, *epochs(0, 3), (0.1, gone)]), baud="auto")
    await bench.receiver.open(10.0)
    await bench.until_done()
    assert bench.ports[0].rates == list(RATES[1:3])
    assert bench.opened_at == [RATES[0], RATES[2]]
    await bench.receiver.close()


@pytest.mark.parametrize(
    ("script", "baud", "words"),
    [
        (lambda: PortGone("/dev/receiver is not there; plug it in"), 9600, "plug"),
        (lambda: iter(()), 9600, "nothing comes from /dev/receiver at 9600 baud; .*power"),
        (lambda: iter([(0.1, b"\xff" * 600)]), 9600, "understood .* gnss.baud"),
        (
            lambda: iter([(1.2, b"\xff")] * (len(RATES) + 1)),
            "auto",
            f"any of {len(RATES)} rates",
        ),
        (lambda: iter([(0.1, gsa())]), 9600, "speaks at 9600 baud, but neither .* switch one"),
    ],
)
async def test_a_failure_to_open_says_why_and_leaves_no_thread(
    script: Callable[[], Script | PortGone], baud: int | str, words: str
) -> None:
    bench = Bench(*[script() for _ in range(500)], baud=baud)
    with pytest.raises(ConnectionFailed, match=words):
        await bench.receiver.open(0.1)
    assert not [thread for thread in threading.enumerate() if thread.name == "gnss"]
    assert bench.receiver.fix() is None


async def test_it_opens_after_a_failure_and_never_twice() -> None:
    bench = Bench(iter(()), epochs(0, 3))
    with pytest.raises(ConnectionFailed):
        await bench.receiver.open(0.05)
    await bench.receiver.open(10.0)
    with pytest.raises(ConnectionFailed, match="open already"):
        await bench.receiver.open(10.0)
    assert bench.receiver.fix() is not None
    await bench.receiver.close()


async def test_opening_can_be_given_up() -> None:
    bench = Bench(iter(()))
    opening = asyncio.get_running_loop().create_task(bench.receiver.open(60.0))
    await bench.until_done()
    opening.cancel()
    (answer,) = await asyncio.gather(opening, return_exceptions=True)
    assert isinstance(answer, asyncio.CancelledError)
    for thread in [t for t in threading.enumerate() if t.name == "gnss"]:
        await asyncio.to_thread(thread.join, 5.0)
        assert not thread.is_alive()


@pytest.mark.parametrize("library", ["serial", "pynmeagps.exceptions", "pyubx2.exceptions"])
async def test_a_missing_library_is_named_with_what_to_install(
    monkeypatch: pytest.MonkeyPatch, library: str
) -> None:
    monkeypatch.setitem(sys.modules, library, None)
    with pytest.raises(ConnectionFailed, match=rf"{library}; install autonomy\[hardware\]"):
        await Bench(epochs(0, 3)).receiver.open(1.0)


# ---------------------------------------------------------------- the port's words


@pytest.mark.parametrize(
    ("path", "words"),
    [
        ("/dev/there_is_none", "is not there; plug the receiver in"),
        ("/dev/null", "not a serial port; correct gnss.port"),
        (".", "does not answer|not a serial port"),
    ],
)
def test_a_port_that_cannot_be_opened_says_what_to_do(path: str, words: str) -> None:
    with pytest.raises(PortGone, match=words):
        SerialPort(path, 9_600)


def test_errors_of_permission_name_the_group() -> None:
    assert "dialout" in what_to_do("/dev/ttyACM0", PermissionError(errno.EACCES, "denied"))
    assert "another program" in what_to_do("/dev/ttyACM0", OSError(errno.EBUSY, "busy"))
