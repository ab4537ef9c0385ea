"""Simulated time for a driver that waits in a thread of its own: thread and test take turns."""

import threading

from hal.clock import SimClock

_STUCK_S = 10.0
_LEAST_S = 1e-4


class LockstepWaiter:
    """`hal.ranging.waiter.Waiter` whose time is the test's."""

    def __init__(self, time: "LockstepTime") -> None:
        self._time = time
        self.until_s: float | None = None
        self.stopped = False

    def wait(self, seconds: float) -> bool:
        with self._time.turn:
            self.until_s = self._time.clock.now_s() + max(seconds, _LEAST_S)
            self._time.turn.notify_all()
            self._time.turn.wait_for(lambda: self.until_s is None or self.stopped)
            return self.stopped

    def pause(self, seconds: float) -> None:
        self._time.clock.advance(seconds)

    def stop(self) -> None:
        with self._time.turn:
            self.stopped = True
            self._time.turn.notify_all()


class LockstepTime:
    """A clock, and the one thread that waits on it."""

    def __init__(self) -> None:
        self.clock = SimClock(100.0)
        self.turn = threading.Condition()
        self._waiter: LockstepWaiter | None = None

    def new_waiter(self) -> LockstepWaiter:
        self._waiter = LockstepWaiter(self)
        return self._waiter

    def advance(self, seconds: float) -> None:
        """Let time pass; the thread does all that is due until then."""
        end_s = self.clock.now_s() + seconds
        waiter = self._waiter
        while waiter is not None and not waiter.stopped:
            with self.turn:
                if not self.turn.wait_for(
                    lambda: waiter.until_s is not None or waiter.stopped, _STUCK_S
                ):
                    raise AssertionError("the driver's thread does not come back")
                if waiter.until_s is None or waiter.until_s > end_s:
                    break
                self.clock.advance(max(waiter.until_s - self.clock.now_s(), 0.0))
                waiter.until_s = None
                self.turn.notify_all()
        self.clock.advance(max(end_s - self.clock.now_s(), 0.0))
