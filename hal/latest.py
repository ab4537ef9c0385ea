"""A cell for the newest value: what stands between a driver and the control loop.

No queue: a slow reader never sees old news, a fast writer never fills memory.
"""

from typing import Generic, TypeVar

T = TypeVar("T")


class Latest(Generic[T]):
    """Holds the newest value and a count of how many were put.

    Safe between one writer thread and readers: each operation is a single attribute access.
    """

    def __init__(self) -> None:
        self._entry: tuple[int, T] | None = None

    def put(self, value: T) -> None:
        """Replace the value."""
        count = self._entry[0] if self._entry is not None else 0
        self._entry = (count + 1, value)

    def get(self) -> T | None:
        """The newest value, or None before the first."""
        entry = self._entry
        return entry[1] if entry is not None else None

    def newer_than(self, count: int) -> tuple[int, T] | None:
        """(count, value) when something was put after `count`, else None."""
        entry = self._entry
        return entry if entry is not None and entry[0] > count else None
