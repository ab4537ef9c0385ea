"""A link that is lost, late, loses single packets, doubles and reorders them; it knows no socket.

One channel is one direction. What is put in comes out when it is due, in the order of arrival;
without a fault that is at once.
"""

import heapq
import itertools
from collections.abc import Iterable
from typing import Generic, Literal, TypeVar

import numpy as np

from hal.sim.fault_clock import FaultClock
from hal.sim.fault_kinds import FaultWindow, LinkDelay, LinkLoss, LinkPackets

T = TypeVar("T")


class FaultyChannel(Generic[T]):
    """One direction of a link with those of `faults` that concern it."""

    def __init__(
        self,
        faults: Iterable[FaultWindow],
        direction: Literal["up", "down"],
        rng: np.random.Generator,
        clock: FaultClock,
    ) -> None:
        kinds = LinkLoss | LinkDelay | LinkPackets
        self._faults = tuple(
            fault
            for fault in faults
            if isinstance(fault, kinds) and fault.direction in ("both", direction)
        )
        self._rng = rng
        self._clock = clock
        self._waiting: list[tuple[float, int, T]] = []
        self._count = itertools.count()

    @property
    def sound(self) -> bool:
        """True when no fault will ever concern it."""
        return not self._faults

    def lost(self, now_s: float) -> bool:
        """True while nothing comes through at all."""
        return any(isinstance(f, LinkLoss) for f in self._clock.active(self._faults, now_s))

    def put(self, now_s: float, item: T) -> None:
        """Send `item` at `now_s`."""
        if self.sound:
            self._arrive(now_s, item)
            return
        late_s, copies = 0.0, 1
        for fault in self._clock.active(self._faults, now_s):
            if isinstance(fault, LinkLoss):
                return
            if isinstance(fault, LinkDelay):
                late_s += fault.delay_s + fault.jitter_s * self._rng.random()
            elif self._rng.random() < fault.probability:
                if fault.kind == "link_drop":
                    return
                copies += fault.kind == "link_duplicate"
                late_s += fault.by_s if fault.kind == "link_reorder" else 0.0
        for _ in range(copies):
            self._arrive(now_s + late_s, item)

    def take(self, now_s: float) -> list[T]:
        """What has arrived by `now_s`."""
        arrived = []
        while self._waiting and self._waiting[0][0] <= now_s + 1e-9:
            arrived.append(heapq.heappop(self._waiting)[2])
        return arrived

    def clear(self) -> None:
        """Forget what is still on its way."""
        self._waiting.clear()

    def _arrive(self, at_s: float, item: T) -> None:
        heapq.heappush(self._waiting, (at_s, next(self._count), item))
