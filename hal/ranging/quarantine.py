"""Which multiplexer channels held the bus low, and for how long each is left alone for it."""

Segment = tuple[int, int]
"""(address of the multiplexer, channel)."""

FIRST_S, LAST_S = 4.0, 300.0
"""How long a channel is not selected after its second offence, and at most; the first may have been
a chip that was interrupted within a byte, and is forgiven."""
_FACTOR = 4.0
FORGIVEN_AFTER_S = 60.0
"""Of good behaviour."""


class Quarantine:
    """The offences of channels."""

    def __init__(self) -> None:
        self._pause_s: dict[Segment, float] = {}
        self._free_from_s: dict[Segment, float] = {}

    def knows(self, segment: Segment | None, now_s: float) -> bool:
        """True for a channel whose last offence is not forgotten."""
        if segment is None or segment not in self._free_from_s:
            return False
        return now_s - self._free_from_s[segment] < FORGIVEN_AFTER_S

    def blame(self, segment: Segment, now_s: float) -> float:
        """Seconds for which it must not be selected: none, then more and more."""
        pause_s = 0.0
        if self.knows(segment, now_s):
            pause_s = min(max(_FACTOR * self._pause_s[segment], FIRST_S), LAST_S)
        self._pause_s[segment] = pause_s
        self._free_from_s[segment] = now_s + pause_s
        return pause_s
