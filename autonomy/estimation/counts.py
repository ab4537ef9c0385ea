"""How the estimator gets on with each source: newest test ratio, counts, age."""

import math

from autonomy.estimation.kalman import Tested
from autonomy.model import UNHEARD, SourceHealth

RATIO_MAX = 1e6
"""Written for a test ratio beyond it, or of what is no number: a log has no infinity."""


class Count:
    """One source."""

    def __init__(self) -> None:
        self._ratio = 0.0
        self._fused = 0
        self._rejected = 0
        self._fused_s = -math.inf
        self.rejected_in_a_row = 0

    @property
    def fused_s(self) -> float:
        """Stamp of the newest measurement that was fused; -inf before the first."""
        return self._fused_s

    def note(self, tested: Tested, stamp_s: float) -> None:
        """One measurement was tested."""
        self._ratio = min(tested.test_ratio, RATIO_MAX)
        if tested.fused:
            self._fused += 1
            self._fused_s = max(self._fused_s, stamp_s)
            self.rejected_in_a_row = 0
        else:
            self._rejected += 1
            self.rejected_in_a_row += 1

    def began(self, stamp_s: float) -> None:
        """A measurement was taken as it is, for a beginning."""
        self._ratio = 0.0
        self._fused += 1
        self._fused_s = stamp_s
        self.rejected_in_a_row = 0

    def refused(self) -> None:
        """One measurement came too late, or was none."""
        self._rejected += 1

    def health(self, now_s: float) -> SourceHealth:
        """For people: rounded, so that logs stay small."""
        if not self._fused and not self._rejected:
            return UNHEARD
        age_s = round(max(0.0, now_s - self._fused_s), 3) if self._fused else None
        return SourceHealth(round(self._ratio, 4), self._fused, self._rejected, age_s)
