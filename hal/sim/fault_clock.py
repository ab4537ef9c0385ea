"""When the faults of one simulation are there: each counts from its moment."""

import math
from collections.abc import Iterable
from typing import TypeVar

from hal.sim.fault_kinds import FaultWindow, Moment

F = TypeVar("F", bound=FaultWindow)


class FaultClock:
    """Knows when the simulation began, and when the vehicle was first armed and first lifted off.

    `since_s` is the time at which the simulation began, on the clock that callers tell.
    """

    def __init__(self, since_s: float = 0.0) -> None:
        self._moments_s: dict[Moment, float] = {"start": since_s}

    def note(self, now_s: float, *, armed: bool, airborne: bool) -> None:
        """What the vehicle is at `now_s`; the first time counts."""
        if armed:
            self._moments_s.setdefault("arming", now_s)
        if airborne:
            self._moments_s.setdefault("liftoff", now_s)

    def elapsed_s(self, moment: Moment, now_s: float) -> float:
        """Seconds since a moment; minus infinity before it."""
        since_s = self._moments_s.get(moment)
        return -math.inf if since_s is None else now_s - since_s

    def began_s(self, fault: FaultWindow, now_s: float) -> float:
        """How long a fault has been there; negative before it is."""
        return self.elapsed_s(fault.after, now_s) - fault.start_s

    def active(self, faults: Iterable[F], now_s: float) -> tuple[F, ...]:
        """Those of the faults that are there at `now_s`."""
        return tuple(f for f in faults if f.active(self.elapsed_s(f.after, now_s)))
