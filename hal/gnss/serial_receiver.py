"""A GNSS receiver on a serial port: finds its rate, outlives its unplugging, only listens.

The bytes are understood by `stream` and the port is held by a thread, so that a stamp does not
depend on how busy the event loop is.
"""

import asyncio
import threading
from collections.abc import Callable
from enum import StrEnum

import msgspec

from hal.clock import Clock
from hal.config import SerialGnssConfig
from hal.drops import Dropped
from hal.errors import ConnectionFailed
from hal.gnss import serial_port, stream
from hal.gnss.serial_port import Port, PortGone, SerialPort
from hal.gnss.stream import GnssStream, StreamCounts
from hal.latest import Latest
from hal.readings import GnssFix

RATES = (9_600, 38_400, 115_200, 57_600, 19_200, 230_400, 460_800, 921_600)
"""Rates tried, the factory settings of u-blox and of autopilot kits first."""
LISTEN_S = 1.15
"""How long a rate is listened to: a whole epoch at 1 Hz."""
GARBAGE_BYTES = 512
"""So many bytes without a frame are enough to know a rate is wrong."""
_POLL_S = 0.02
_JOIN_S = 2.0


class PortState(StrEnum):
    """What the driver is doing."""

    CLOSED = "closed"
    GONE = "gone"  # no device; it is tried again and again
    SEARCHING = "searching"  # a device, and no frame at any rate so far
    RECEIVING = "receiving"  # frames come


class GnssHealth(msgspec.Struct, frozen=True):
    """How the receiver is doing, for people."""

    state: PortState
    baud: int
    problem: str
    """Why it is not receiving; empty when it is."""
    times_gone: int
    passes: int
    """How often all rates were tried in vain."""
    counts: StreamCounts


class BaudSearch:
    """Which rate to listen at, and when to try the next; knows no port and no clock.

    One pass tries each rate once and is bounded by `len(rates) * LISTEN_S`; passes repeat, as long
    as somebody listens, beginning with the rate that was right last.
    """

    def __init__(self, rates: tuple[int, ...], silent_after_s: float) -> None:
        self._rates = rates
        self._silent_after_s = silent_after_s
        self._index = 0
        self._tried = 0
        self._since_s = 0.0
        self._bytes = 0
        self.found = False
        """The rate is right: a frame with a correct checksum came at it."""
        self.passes = 0

    @property
    def baud(self) -> int:
        """The rate to listen at."""
        return self._rates[self._index]

    def begin(self, now_s: float) -> None:
        """The port was opened, or has got the rate, at `now_s`."""
        self._since_s = now_s
        self._bytes = 0
        self.found = False

    def hear(self, count: int, frames: int, now_s: float) -> bool:
        """`count` bytes came with `frames` whole frames in them; True when the rate has changed."""
        if frames:
            self.found = True
            self._since_s, self._bytes, self._tried = now_s, 0, 0
            return False
        self._bytes += count
        patience_s = self._silent_after_s if self.found else LISTEN_S
        wrong = not self.found and self._bytes >= GARBAGE_BYTES
        if not wrong and now_s - self._since_s < patience_s:
            return False
        was, found = self.baud, self.found
        self.begin(now_s)
        if not found:  # what was right is tried once more before others
            self._next()
        return found or self.baud != was

    def _next(self) -> None:
        self._index = (self._index + 1) % len(self._rates)
        self._tried += 1
        if self._tried == len(self._rates):
            self._tried = 0
            self.passes += 1


class BackOff:
    """Pauses that double up to a limit, and begin anew after a success."""

    def __init__(self, first_s: float, longest_s: float) -> None:
        self._first_s, self._longest_s = first_s, longest_s
        self._next_s = first_s

    def pause_s(self) -> float:
        """How long to wait this time."""
        pause_s, self._next_s = self._next_s, min(2.0 * self._next_s, self._longest_s)
        return pause_s

    def succeed(self) -> None:
        """It worked: the next failure is a new one."""
        self._next_s = self._first_s


class SerialReceiver:
    """`hal.interfaces.GnssReceiver` on a serial port.

    Whatever happens to the device, `fix` keeps its last solution with its own stamp, so that it
    goes stale; the port is opened again, and the rate searched anew, until `close`.
    """

    def __init__(
        self,
        config: SerialGnssConfig,
        clock: Clock,
        open_port: Callable[[str, int], Port] = SerialPort,
    ) -> None:
        self._config = config
        self._clock = clock
        self._open_port = open_port
        self._listener = _Listener(config, clock, open_port)
        self._thread: threading.Thread | None = None

    async def open(self, deadline_s: float) -> None:
        """Open the port, find the rate; returns with the first solution, also one without a
        position.

        Raises ConnectionFailed when none comes within `deadline_s`, when it is open already, or
        when the libraries are not installed.
        Cancelling closes it.
        """
        if self._thread is not None:
            raise ConnectionFailed(f"{self._config.port} is open already; close it first")
        _load()
        listener = self._listener = _Listener(self._config, self._clock, self._open_port)
        self._thread = threading.Thread(target=listener.run, name="gnss", daemon=True)
        self._thread.start()
        try:
            async with asyncio.timeout(deadline_s):
                while listener.fix.get() is None:  # noqa: ASYNC110 - the cell's writer knows no event loop
                    await asyncio.sleep(_POLL_S)
        except TimeoutError:
            why = listener.why_nothing()
            await self.close()
            raise ConnectionFailed(f"no GNSS solution within {deadline_s:g} s: {why}") from None
        except BaseException:
            listener.stop.set()
            self._thread = None
            raise

    async def close(self) -> None:
        """Stop receiving; the last solution stays readable. May be called twice.

        Cancelling lets the thread end by itself, within a read's time limit.
        """
        self._listener.stop.set()
        thread, self._thread = self._thread, None
        if thread is None:
            return
        async with asyncio.timeout(_JOIN_S):
            while thread.is_alive():  # noqa: ASYNC110 - the thread knows no event loop
                await asyncio.sleep(_POLL_S)

    def fix(self) -> GnssFix | None:
        """The newest solution with the stamp it came with, or None before the first."""
        return self._listener.fix.get()

    def dropped(self) -> Dropped:
        """See `hal.drops`: frames and solutions since it was opened last."""
        lost = self._listener.health.counts.lost()
        return {("serial GNSS", reason): count for reason, count in lost.items() if count}

    def health(self) -> GnssHealth:
        """How it is doing, as of the last thing that happened on the port."""
        health = self._listener.health
        if self._thread is not None:
            return health
        return msgspec.structs.replace(health, state=PortState.CLOSED, problem="it is not open")


def _load() -> None:
    """Here and not in the thread: the first fix would wait for it."""
    try:
        serial_port.load()
        stream.load()
    except ImportError as error:
        raise ConnectionFailed(
            f"gnss.driver serial needs the library {error.name}; install autonomy[hardware]"
        ) from None


class _Listener:
    """What the thread does, from one `open` to its `close`; shares nothing with the next."""

    def __init__(
        self, config: SerialGnssConfig, clock: Clock, open_port: Callable[[str, int], Port]
    ) -> None:
        self._config = config
        self._clock = clock
        self._open_port = open_port
        self._stream = GnssStream(
            latency_s=config.latency_s,
            range_error_m=config.range_error_m,
            frozen_after_s=config.frozen_after_s,
            confirm_fixes=config.confirm_fixes,
        )
        rates = RATES if config.baud == "auto" else (config.baud,)
        self._search = BaudSearch(rates, config.silent_after_s)
        self._back_off = BackOff(config.reopen_after_s, config.reopen_max_s)
        self._times_gone = 0
        self.fix: Latest[GnssFix] = Latest()
        self.stop = threading.Event()
        self.health = self._health_of(PortState.GONE, f"{config.port} was not opened yet")

    def run(self) -> None:
        """Until `stop` is set."""
        while not self.stop.is_set():
            try:
                with self._open_port(self._config.port, self._search.baud) as port:
                    self._listen(port)
            except PortGone as gone:
                self._times_gone += 1
                self.health = self._health_of(PortState.GONE, str(gone))
                self.stop.wait(self._back_off.pause_s())

    def why_nothing(self) -> str:
        """Why there is no solution, with a remedy."""
        health = self.health
        if health.state is not PortState.RECEIVING:
            return health.problem
        return (
            f"{self._config.port} speaks at {health.baud} baud, but neither UBX NAV-PVT nor "
            "NMEA GGA came; switch one of them on in the receiver"
        )

    def _listen(self, port: Port) -> None:
        """Until told to stop; raises PortGone."""
        self._stream.restart()
        self._search.begin(self._clock.now_s())
        self.health = self._listening()
        while not self.stop.is_set():
            data = port.read()
            now_s = self._clock.now_s()
            before = self._stream.frames
            for fix in self._stream.feed(data, now_s) if data else self._stream.gap():
                self.fix.put(fix)
            if self._search.hear(len(data), self._stream.frames - before, now_s):
                port.set_baud(self._search.baud)
                self._stream.restart()
            if self._search.found:
                self._back_off.succeed()
            self.health = self._listening()

    def _listening(self) -> GnssHealth:
        if self._search.found:
            return self._health_of(PortState.RECEIVING, "")
        silent = self._stream.counts().bytes_taken == 0
        what = "nothing comes from" if silent else "nothing that can be understood comes from"
        remedy = "check its power and wiring" if silent else "check gnss.baud"
        if self._config.baud == "auto":
            rates = f"any of {len(RATES)} rates" if self._search.passes else "the rates tried yet"
        else:
            rates = f"{self._config.baud} baud"
        return self._health_of(
            PortState.SEARCHING, f"{what} {self._config.port} at {rates}; {remedy}"
        )

    def _health_of(self, state: PortState, problem: str) -> GnssHealth:
        return GnssHealth(
            state=state,
            baud=self._search.baud,
            problem=problem,
            times_gone=self._times_gone,
            passes=self._search.passes,
            counts=self._stream.counts(),
        )
