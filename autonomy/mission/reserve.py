"""How long the battery lasts at the rate at which it went down so far. Pure."""

import math


class Reserve:
    """Fed with what the battery says; fractions 0..1."""

    def __init__(self) -> None:
        self._first: tuple[float, float] | None = None
        self._newest: tuple[float, float] | None = None

    def note(self, now_s: float, remaining: float | None) -> None:
        """One reading; None says nothing."""
        if remaining is None:
            return
        self._newest = (now_s, remaining)
        if self._first is None:
            self._first = self._newest

    def lasts_s(self, down_to: float) -> float:
        """Seconds until only `down_to` is left; infinite while the battery does not go down."""
        if self._first is None or self._newest is None:
            return math.inf
        used, for_s = self._first[1] - self._newest[1], self._newest[0] - self._first[0]
        if used <= 0.0:
            return math.inf
        return max(0.0, self._newest[1] - down_to) / used * for_s
