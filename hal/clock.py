"""Time: one monotonic axis in seconds. Wall-clock time never enters control."""

import time
from typing import Protocol


class Clock(Protocol):
    """Where the present comes from; injected, so that a simulation owns its own time."""

    def now_s(self) -> float:
        """Monotonic seconds since an arbitrary epoch."""
        ...


class MonotonicClock:
    """The machine's monotonic clock: immune to steps of the wall clock."""

    def now_s(self) -> float:
        """Monotonic seconds since an arbitrary epoch."""
        return time.monotonic()


class SimClock:
    """A clock that moves only when told to; whole missions run on it without sleeping."""

    def __init__(self, start_s: float = 0.0) -> None:
        self._now_s = start_s

    def now_s(self) -> float:
        """Simulated seconds."""
        return self._now_s

    def advance(self, step_s: float) -> None:
        """Move forward by `step_s` >= 0; raises ValueError otherwise (time never runs back)."""
        if not step_s >= 0.0:
            raise ValueError(f"a clock cannot be advanced by {step_s} s: use a step >= 0")
        self._now_s += step_s
