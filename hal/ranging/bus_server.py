"""Serves the sensors of one bus, one after another, and brings back those that were lost.

Synchronous and without a thread: `step` does what is due and says when the next thing is. What
blocks is a transfer; what waits is given back to the caller, so that one sensor's start, some
0.1 s long, does not keep the others waiting.
"""

from collections.abc import Callable, Iterator, Sequence

from hal.clock import Clock
from hal.config import BeamMount
from hal.errors import ConnectionFailed, ReadingRefused
from hal.ranging.gpio import OutputLine
from hal.ranging.i2c_bus import BusHeld, I2cBus, I2cError
from hal.ranging.quarantine import Quarantine, Segment
from hal.ranging.ranger import Addressable, ChipReset, ChipSilent, Limits, Ranger, WrongChip
from hal.readings import RangeReading

POLL_S = 0.002
"""How often a sensor is asked that should have finished."""
ERRORS_IN_A_ROW = 3
"""Transfers that may fail before the sensor is started anew."""
FAULTS_IN_A_ROW = 5
RETRY_FIRST_S, RETRY_LAST_S = 0.05, 1.0
HELD_IN_A_ROW = 3
RESCUE_EVERY_S = 0.5
_SILENT_PERIODS, _SILENT_S = 4.0, 0.1
_RESET_S = 0.002
_BOOT_S = 0.003
"""Time for XSHUT to act, and for the boot after it (both data sheets: 1.2 ms at most)."""
_IDLE_S = 0.05


class Station:
    """One sensor of the bus, and how it is."""

    def __init__(
        self,
        mount: BeamMount,
        limits: Limits,
        ranger: Ranger,
        switch: tuple[Addressable, OutputLine] | None = None,
        segment: Segment | None = None,
    ) -> None:
        """`switch` is (ranger, its XSHUT line) for a sensor that is given its address; `segment`
        the channel that it is behind.
        """
        self.mount = mount
        self.limits = limits
        self.ranger = ranger
        self.switch = switch
        self.segment = segment
        self.up = False
        self.heard = False
        """True after its first measurement."""
        self.trouble = "not started yet"
        """What is wrong with it; empty while it measures."""
        self.starts = 0
        """How often it was started."""
        self.errors = 0
        """Failed transfers."""
        self.refusals = 0
        """How often in a row another chip answered."""
        self.left_out_until_s = 0.0
        """Its channel holds the bus low and is not selected before."""
        self.starting: Iterator[float] | None = None
        self.addressing = False
        """True while it is, or may be, at the power-up address of all."""
        self.due_s = 0.0
        self.retry_s = RETRY_FIRST_S
        self.in_a_row = 0
        self.faults = 0
        self.last_data_s = 0.0

    def begin(self) -> Iterator[float]:
        """From any state to measuring, with pauses; raises I2cError, WrongChip."""
        if self.switch is not None:
            ranger, line = self.switch
            self.addressing = True
            line.set(high=False)
            yield _RESET_S
            line.set(high=True)
            yield _BOOT_S
            ranger.give_address()
            self.addressing = False
        yield from self.ranger.begin()

    def hold(self) -> None:
        """Keep it in reset, where it disturbs nobody; without XSHUT nothing happens."""
        if self.switch is not None:
            self.switch[1].set(high=False)


class BusServer:
    """The sensors of one bus."""

    def __init__(
        self,
        bus: I2cBus,
        stations: Sequence[Station],
        clock: Clock,
        give: Callable[[RangeReading], None],
        free_bus: Callable[[], bool] = lambda: False,
        culprit: Callable[[], Segment | None] = lambda: None,
    ) -> None:
        """`free_bus` resets the multiplexers, for a bus that is held low; False where they have no
        line for it. `culprit` is the channel that was connected when the bus went low.
        """
        self._bus = bus
        self._stations = tuple(stations)
        self._clock = clock
        self._give = give
        self._free_bus = free_bus
        self._culprit = culprit
        self._quarantine = Quarantine()
        self._held = 0
        self._next_rescue_s = float("-inf")
        self.rescues = 0
        """How often the whole bus was freed."""

    def step(self) -> float:
        """Do what is due; returns the seconds until something is."""
        for station in self._stations:
            if station.up and station.due_s <= self._clock.now_s():
                self._attempt(station, self._poll)
        self._start_all()
        if self._held >= HELD_IN_A_ROW:
            self._free()
        now_s = self._clock.now_s()
        waits = [station.due_s - now_s for station in self._stations if self._counts(station)]
        return min(max(min(waits, default=_IDLE_S), 0.0), _IDLE_S)

    def _counts(self, station: Station) -> bool:
        """False for what waits until another has its address."""
        if station.up or station.starting is not None or station.switch is None:
            return True
        return not self._somebody_is_addressed()

    def _somebody_is_addressed(self) -> bool:
        return any(station.addressing for station in self._stations)

    def end(self) -> None:
        """Stop all that can still be told to stop, and hold the others in reset."""
        for station in self._stations:
            if station.up:
                try:
                    station.ranger.end()
                except I2cError as error:
                    station.trouble = str(error)
            station.up, station.starting, station.addressing = False, None, False
            self._hold(station)

    # ------------------------------------------------------------------ measuring

    def _attempt(self, station: Station, act: Callable[[Station], None]) -> None:
        """`act`, and what follows when it fails."""
        try:
            act(station)
        except BusHeld as error:
            known = self._quarantine.knows(self._culprit(), self._clock.now_s())
            self._held += HELD_IN_A_ROW if known else 1
            self._failed(station, error)
        except I2cError as error:
            self._held = 0
            self._failed(station, error)
        except WrongChip as error:
            station.refusals += 1
            self._down(station, str(error))
        except (OSError, ReadingRefused) as error:  # OSError: the XSHUT line's
            self._down(station, f"{error}")
        else:
            self._held = 0

    def _poll(self, station: Station) -> None:
        now_s = self._clock.now_s()
        measured = station.ranger.poll()
        station.in_a_row = 0
        period_s = station.ranger.period_s
        if measured is None:
            station.due_s = now_s + POLL_S
            if now_s - station.last_data_s > _SILENT_PERIODS * period_s + _SILENT_S:
                station.ranger.check()
                raise ChipSilent(f"the {station.ranger.kind} stopped measuring")
            return
        station.last_data_s = now_s
        station.due_s = now_s + max(period_s - POLL_S, POLL_S)
        station.faults = station.faults + 1 if measured.hardware_fault else 0
        if station.faults >= FAULTS_IN_A_ROW:
            station.faults = 0
            self._down(station, f"the {station.ranger.kind} says that its laser fails")
            return
        self._give(measured.reading(now_s, station.mount, station.limits))
        station.heard, station.trouble = True, ""
        station.retry_s = RETRY_FIRST_S

    def _failed(self, station: Station, error: I2cError) -> None:
        """A few failed transfers are borne while it measures; a reset is not."""
        station.errors += 1
        station.in_a_row += 1
        lost = isinstance(error, ChipSilent | ChipReset)
        if station.up and station.in_a_row < ERRORS_IN_A_ROW and not lost:
            station.due_s = self._clock.now_s() + POLL_S
            station.trouble = str(error)
            return
        self._down(station, str(error))

    def _down(self, station: Station, why: str) -> None:
        station.up, station.starting, station.trouble = False, None, why
        station.addressing = False
        station.in_a_row = 0
        station.due_s = self._clock.now_s() + station.retry_s
        station.retry_s = min(2.0 * station.retry_s, RETRY_LAST_S)
        self._hold(station)

    def _hold(self, station: Station) -> None:
        try:
            station.hold()
        except OSError as error:
            station.trouble = f"the XSHUT line of {station.mount.name} fails ({error})"

    # ------------------------------------------------------------------ starting

    def _start_all(self) -> None:
        """Go on with what is being started, and begin with what is due.

        Addresses are given one at a time: two sensors would listen together.
        """
        for station in self._stations:
            if station.up or station.due_s > self._clock.now_s():
                continue
            if station.starting is None:
                if station.switch is not None and self._somebody_is_addressed():
                    continue
                self._silence_the_lost(station)
                station.starts += 1
                station.starting = station.begin()
            self._attempt(station, self._go_on)

    def _silence_the_lost(self, starting: Station) -> None:
        """After a dip of the supply several sensors are back at the power-up address, and not all
        of them were missed yet: ask, and hold those in reset that do not answer as themselves.
        """
        if starting.switch is None:
            return
        for station in self._stations:
            awake = station.up or station.starting is not None
            if station is starting or not awake or station.switch is None:
                continue
            try:
                station.switch[0].identify()
            except (I2cError, WrongChip) as error:
                self._down(station, str(error))

    def _go_on(self, station: Station) -> None:
        if station.starting is None:
            return
        now_s = self._clock.now_s()
        pause_s = next(station.starting, None)
        if pause_s is not None:
            station.due_s = self._clock.now_s() + pause_s
            return
        station.starting, station.up, station.trouble = None, True, "has not measured yet"
        station.in_a_row = station.faults = station.refusals = 0
        station.last_data_s = station.due_s = now_s

    # ------------------------------------------------------------------ the bus itself

    def _free(self) -> None:
        """A bus that is held low: leave out what holds it, else begin anew with everything."""
        now_s = self._clock.now_s()
        culprit = self._culprit()
        if culprit is not None and self._disconnected():
            self._leave_out(culprit, now_s)
        elif now_s >= self._next_rescue_s:
            self._rescue(now_s)

    def _disconnected(self) -> bool:
        """True when the multiplexers were reset by their line."""
        try:
            return self._free_bus()
        except OSError:
            return False  # `_rescue` says so

    def _leave_out(self, culprit: Segment, now_s: float) -> None:
        """Without the channel the bus is free, and what is behind the others measures on."""
        self.rescues += 1
        self._held = 0
        pause_s = self._quarantine.blame(culprit, now_s)
        address, channel = culprit
        for station in self._stations:
            if station.segment == culprit:
                self._down(
                    station,
                    f"channel {channel} of {address:#04x} holds the bus low, and is left out for "
                    f"{pause_s:g} s; look for a short circuit there",
                )
                station.left_out_until_s = now_s + pause_s
                station.due_s = now_s + max(pause_s, _RESET_S)
        self._reopen()

    def _rescue(self, now_s: float) -> None:
        """Reset multiplexers and sensors, begin anew.

        A chip that was interrupted within a byte holds the data line until it is clocked or reset.
        The kernel clocks; this resets what has a reset line.
        """
        self.rescues += 1
        self._held = 0
        self._next_rescue_s = now_s + RESCUE_EVERY_S
        for station in self._stations:
            self._down(station, "the bus was held low")
            station.due_s = max(now_s + _RESET_S, station.left_out_until_s)
            station.retry_s = RETRY_FIRST_S
        try:
            self._free_bus()
        except OSError as error:
            for station in self._stations:
                station.trouble = str(error)
            return
        self._reopen()

    def _reopen(self) -> None:
        try:
            self._bus.reopen()
        except (OSError, ConnectionFailed) as error:
            for station in self._stations:
                station.trouble = str(error)
