"""What is wrong with single sensors of a driver that goes on with the others."""

from collections.abc import Iterable
from typing import Protocol, runtime_checkable


@runtime_checkable
class TellsTroubles(Protocol):
    """A driver of several sensors that knows how each of them is."""

    def troubles(self) -> dict[str, str]:
        """By beam, what is wrong with those that do not measure."""
        ...


def troubles_of(drivers: Iterable[object]) -> dict[str, str]:
    """Of all these drivers; those that tell none are passed over."""
    told: dict[str, str] = {}
    for driver in drivers:
        if isinstance(driver, TellsTroubles):
            told |= driver.troubles()
    return told
