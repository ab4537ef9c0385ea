"""What came in and was not believed: counted by source and reason, for people to see."""

from collections import Counter
from collections.abc import Iterable, Mapping
from typing import Protocol, runtime_checkable

Dropped = Mapping[tuple[str, str], int]
"""(source, reason) -> how often. A source is a message's name or a device; few of both."""


@runtime_checkable
class CountsDrops(Protocol):
    """A driver that counts what it drops."""

    def dropped(self) -> Dropped:
        """Since construction; from any thread."""
        ...


class Drops:
    """The counters of one driver; one writer, any reader."""

    def __init__(self) -> None:
        self._counts: Counter[tuple[str, str]] = Counter()

    def note(self, source: str, reason: str, times: int = 1) -> None:
        """Something of `source` was dropped for `reason`."""
        self._counts[source, reason] += times

    def total(self, reason: str) -> int:
        """How often for that reason, whatever the source."""
        return sum(count for (_, why), count in self.dropped().items() if why == reason)

    def dropped(self) -> Dropped:
        """A copy."""
        return dict(self._counts)


def dropped_by(drivers: Iterable[object]) -> Dropped:
    """All that these drivers dropped; those that do not count are passed over."""
    total: Counter[tuple[str, str]] = Counter()
    for driver in drivers:
        if isinstance(driver, CountsDrops):
            total.update(driver.dropped())
    return dict(total)
