"""Setpoints leave on a thread of their own, newest first and only."""

import threading
from collections.abc import Callable

from hal.setpoints import Setpoint


class SetpointSender:
    """A thread that puts the newest setpoint on the wire; older ones are forgotten.

    `put_on_wire` may wait for the link. It, and what is put `instead`, run one after another.
    """

    def __init__(self, put_on_wire: Callable[[Setpoint], None]) -> None:
        self._put_on_wire = put_on_wire
        self._newest: Setpoint | None = None
        self._change = threading.Condition()
        self._wire = threading.Lock()
        """Held from taking a setpoint until it has left: nothing older follows a stop."""
        self._closing = False
        self._thread = threading.Thread(target=self._run, name="setpoints", daemon=True)
        self._thread.start()

    def send(self, setpoint: Setpoint) -> None:
        """To be put on the wire; returns at once."""
        with self._change:
            self._newest = setpoint
            self._change.notify()

    def instead(self, put: Callable[[], None]) -> None:
        """`put` something else on the wire, from any thread; what has not left yet never leaves."""
        with self._wire:
            with self._change:
                self._newest = None
            put()

    def close(self) -> None:
        """End the thread; what has not left yet never leaves."""
        with self._change:
            self._closing = True
            self._change.notify()
        self._thread.join()

    def _run(self) -> None:
        while self._wait():
            with self._wire:
                with self._change:
                    setpoint, self._newest = self._newest, None
                if setpoint is not None:
                    self._put_on_wire(setpoint)

    def _wait(self) -> bool:
        """Until there is a setpoint; False when there will be none any more."""
        with self._change:
            self._change.wait_for(lambda: self._newest is not None or self._closing)
            return not self._closing
