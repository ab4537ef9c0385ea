"""The deadman: stops the vehicle when the control loop falls silent.

libmavsdk repeats the last setpoint every 50 ms on its own, so a loop that hangs keeps the vehicle
flying and PX4's own offboard-loss failsafe never fires. A thread of its own, which needs neither
the event loop nor any queue, watches that the loop still decides.
"""

import logging
import threading
from collections.abc import Callable
from enum import StrEnum
from types import TracebackType
from typing import Self

from hal.clock import Clock
from hal.config import DeadmanConfig

_LOG = logging.getLogger(__name__)
_LONGEST_PERIOD_S = 0.05
_ASK_AGAIN_S = 1.5
"""Longer than a heartbeat takes to tell the mode that was asked for."""


class Watch(StrEnum):
    """What the deadman knows of the control loop."""

    RELEASED = "released"  # the loop does not fly the vehicle: nothing to watch
    FED = "fed"  # the loop decided recently
    SILENT = "silent"  # it did not: the vehicle is being stopped
    DEAD = "dead"  # it still did not: the vehicle was given to the autopilot


class DeadmanRule:
    """The decision, without thread or clock.

    - `feed` starts or continues the watch, from every state. A loop that wakes up has the vehicle
      again (the autopilot is in Hold then, and says so in its status).
    - `release` ends the watch.
    - `poll` is FED up to and including `timeout_s` after the last feed, SILENT from then on, and
      DEAD from `hold_after_s` after it was *first polled* silent: the vehicle always gets that
      time to stop, also when the watching thread itself was held up (a stopped process that
      continues first stops the vehicle, and does not go straight to DEAD).
    """

    def __init__(self, config: DeadmanConfig) -> None:
        self._timeout_s = config.timeout_s
        self._hold_after_s = config.hold_after_s
        self._fed_s: float | None = None
        self._silent_s: float | None = None

    def feed(self, now_s: float) -> None:
        """The loop decided at `now_s`."""
        self._fed_s = now_s
        self._silent_s = None

    def release(self) -> None:
        """The loop no longer flies the vehicle."""
        self._fed_s = None

    def poll(self, now_s: float) -> Watch:
        """The state at `now_s`."""
        if self._fed_s is None:
            return Watch.RELEASED
        if now_s - self._fed_s <= self._timeout_s:
            return Watch.FED
        if self._silent_s is None:
            self._silent_s = now_s
        if now_s - self._silent_s < self._hold_after_s:
            return Watch.SILENT
        return Watch.DEAD


class Deadman:
    """A thread that stops the vehicle when it is not fed. A context: it watches inside.

    While the loop flies the vehicle it calls `feed()` at every tick; when it no longer does,
    `release()`. Unfed for `config.timeout_s`: `on_silent()` is called, again at every poll (at
    most 50 ms apart), until fed or dead. Unfed for `config.hold_after_s` more: `on_dead()`, which
    returns True when it asked for Hold and False when there was nothing to ask, because the vehicle
    is not in Offboard (it was granted, or a pilot took it). It is called again every 1.5 s after it
    asked, and at every poll after it did not, until fed or released: an answer may be lost, and a
    vehicle may come back to Offboard while nobody flies it.
    `on_handed_over(now_s)`, when given, is called once a silence, after Hold was first asked for,
    so that it is known when this process is killed.
    A new `feed()` starts over. The callables run on the deadman's thread and must not wait for
    the event loop; one that raises is logged and does not end the watch (`on_dead` is called
    again at the next poll then).

    It cannot help where Python itself stands still: a stopped or killed process (PX4's failsafe
    catches it, for MAVSDK's repeating stops as well), or native code that never lets go of the
    interpreter lock (the service's watchdog kills it).
    """

    def __init__(
        self,
        config: DeadmanConfig,
        on_silent: Callable[[], None],
        on_dead: Callable[[], bool],
        clock: Clock,
        on_handed_over: Callable[[float], None] | None = None,
    ) -> None:
        self._rule = DeadmanRule(config)
        self._period_s = min(_LONGEST_PERIOD_S, config.timeout_s / 5.0)
        self._on_silent = on_silent
        self._on_dead = on_dead
        self._on_handed_over = on_handed_over
        self._clock = clock
        self._lock = threading.Lock()
        self._closing = threading.Event()
        self._thread: threading.Thread | None = None
        self._asked_s: float | None = None
        """When Hold was asked for last, in this silence."""
        self.stops = 0
        """How often the loop fell silent."""
        self.handovers = 0
        """How often the vehicle was given to the autopilot because the loop stayed silent; it
        rises just before the autopilot is asked."""

    def __enter__(self) -> Self:
        self._closing.clear()
        self._thread = threading.Thread(target=self._watch, name="deadman", daemon=True)
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()

    def feed(self) -> None:
        """The loop is alive and flies the vehicle; returns at once."""
        with self._lock:
            self._rule.feed(self._clock.now_s())

    def release(self) -> None:
        """The loop does not fly the vehicle any more: nothing will be stopped."""
        with self._lock:
            self._rule.release()

    def close(self) -> None:
        """End the watch and its thread; changes nothing about the vehicle. May be called twice."""
        self._closing.set()
        if self._thread is not None:
            self._thread.join()
            self._thread = None

    def _watch(self) -> None:
        before = Watch.RELEASED
        while not self._closing.wait(self._period_s):
            before = self.step(before)

    def step(self, before: Watch) -> Watch:
        """One look at the loop and its consequence; returns the state (`before` of the next)."""
        now_s = self._clock.now_s()
        with self._lock:
            state = self._rule.poll(now_s)
        if state is Watch.SILENT:
            # Told last: whoever takes the words may be slow, or never take them.
            self._try(self._on_silent)
            if before is not Watch.SILENT:
                self.stops += 1
                _LOG.error("the control loop is silent: stopping the vehicle")
        if state is Watch.DEAD:
            self._hand_over(now_s)
        else:
            self._asked_s = None
        return state

    def _hand_over(self, now_s: float) -> None:
        """Ask for Hold, unless the answer to the last time may still be on its way."""
        if self._asked_s is not None and now_s - self._asked_s < _ASK_AGAIN_S:
            return
        first = self._asked_s is None
        # Counted before: a loop that wakes up just now must not take this for a pilot's switch.
        self.handovers += first
        if not self._try(self._on_dead):
            self.handovers -= first
            return
        self._asked_s = now_s
        tell = self._on_handed_over
        if first and tell is not None:
            self._try(lambda: tell(now_s))
        _LOG.error("the control loop stays silent: the vehicle was given to PX4 (Hold, else Land)")

    @staticmethod
    def _try(action: Callable[[], bool | None]) -> bool:
        """What `action` returned; False when it raised."""
        try:
            return bool(action())
        except Exception:  # noqa: BLE001 - whatever fails, the watch must go on
            _LOG.exception("the deadman's action failed; it will be tried again")
            return False
