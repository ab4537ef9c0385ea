"""What PX4 watches while it flies: who is on the link, and whether the position is good.

Intervals: measured on PX4 main bb59c637cd, SIH quadrotor, 2026-11.
"""

import math
from enum import Enum, auto

# From the last heartbeat to the loss, beyond COM_DL_LOSS_T or COM_OBC_LOSS_T.
_LOSS_NOTICED_S = 1.6
# From the last GNSS fix: first complaint, position given up, and from the fix's return, taken back.
_GNSS_TEXTS_S = (1.1, 5.1, 7.2)
_POSITION_LOST_S = 5.1
_POSITION_BACK_S = 2.5


class Change(Enum):
    """What a watch noticed."""

    LOST = auto()
    BACK = auto()


class HeartbeatWatch:
    """One kind of partner on the link: heard first, lost after a time, back again."""

    def __init__(self) -> None:
        self._heard_s = -math.inf
        self._known = False
        self.lost = True
        """True while nobody of this kind is there, also before the first was."""

    def hear(self, now_s: float) -> None:
        """A heartbeat arrived."""
        self._heard_s = now_s

    def step(self, now_s: float, limit_s: float) -> Change | None:
        """What changed by now; the first appearance is no change."""
        silent = now_s - self._heard_s > limit_s + _LOSS_NOTICED_S
        if silent and not self.lost:
            self.lost = True
            return Change.LOST
        if not silent and self.lost:
            first = not self._known
            self._known = True
            self.lost = False
            return None if first else Change.BACK
        return None


class GnssWatch:
    """The position that rests on GNSS: complaints, then given up, then taken back."""

    def __init__(self) -> None:
        self._gone_s: float | None = None
        self._back_s = -math.inf
        self._said = 0
        self.position_valid = True
        """False while PX4 has no global position, and does not arm."""

    def step(self, now_s: float, *, fix: bool) -> tuple[bool, Change | None]:
        """(complain now, what became of the position)."""
        if fix:
            return False, self._recover(now_s)
        if self._gone_s is None:
            self._gone_s, self._said = now_s, 0
        self._back_s = math.inf
        gone_s = now_s - self._gone_s
        complain = self._said < len(_GNSS_TEXTS_S) and gone_s >= _GNSS_TEXTS_S[self._said]
        self._said += complain
        if self.position_valid and gone_s >= _POSITION_LOST_S:
            self.position_valid = False
            return complain, Change.LOST
        return complain, None

    def _recover(self, now_s: float) -> Change | None:
        if self._gone_s is not None:
            self._gone_s, self._back_s = None, now_s
        if self.position_valid or now_s - self._back_s < _POSITION_BACK_S:
            return None
        self.position_valid = True
        return Change.BACK
