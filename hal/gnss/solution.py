"""What a receiver claims, whatever its protocol, and the judgement that makes a fix of it.

A claim becomes a `GnssFix` or is refused and counted; nothing raises.
"""

import math
from collections import deque
from typing import NamedTuple

from hal.errors import ReadingRefused
from hal.gnss.autopilot_gnss import HIGHEST_M, LOWEST_M, NO_POSITION_ACCURACY_M, WORST_ACCURACY_M
from hal.readings import FixType, GnssFix

CLOCK_INSISTS_AFTER = 5
"""A clock that was refused this often in a row, and runs evenly, is the receiver's new one."""
LAG_CREEP_S_PER_S = 1e-3
"""How fast the least transmission delay is forgotten: the companion's clock drifts slower."""
_ORDER = tuple(FixType)


class Solution(NamedTuple):
    """One epoch as claimed; coordinates mean nothing below FIX_2D.

    `epoch_s` is the receiver's own time within `period_s` (a day, a week), None when it tells none.
    """

    received_s: float
    epoch_s: float | None
    period_s: float
    fix_type: FixType
    latitude_deg: float
    longitude_deg: float
    amsl_m: float
    horizontal_accuracy_m: float
    vertical_accuracy_m: float
    satellites: int

    @property
    def place(self) -> tuple[float, float, float]:
        """Latitude, longitude and altitude, to be compared."""
        return (self.latitude_deg, self.longitude_deg, self.amsl_m)


class Judge:
    """Believes a solution when time, place and type of fix bear it out."""

    def __init__(self, latency_s: float, frozen_after_s: float, confirm_fixes: int) -> None:
        self._latency_s = latency_s
        self._frozen_after_s = frozen_after_s
        self.told = 0
        self.absurd = 0
        """Not on Earth, no altitude of a multicopter, exactly 0, 0, or no usable accuracy."""
        self.untimely = 0
        """The receiver's time stood still, went back, or was not told."""
        self.frozen = 0
        """The time advanced and the place did not, by not the least digit, for too long."""
        self.leaps = 0
        """Solutions told with a lesser type of fix than they claim, until it is confirmed."""
        self.losses = 0
        """How often a fix was lost."""
        self._recent: deque[Solution] = deque(maxlen=confirm_fixes)
        self._restart_clock()
        self._stamp_s = -math.inf
        self._place: tuple[float, float, float] | None = None
        self._placed_s = 0.0
        self._still_for_s = 0.0

    def restart(self) -> None:
        """The receiver was away: its past says nothing about its present."""
        self._recent.clear()
        self._restart_clock()
        self._place = None

    def take(self, solution: Solution) -> GnssFix | None:
        """The fix to be told, or None for what is refused."""
        if solution.fix_type in (FixType.NO_GPS, FixType.NO_FIX):
            return self._no_fix(solution)
        if not _is_possible(solution):
            self.absurd += 1
            return None
        lag_s = self._punctual_lag_s(solution)
        if lag_s is None:
            self.untimely += 1
            return None
        if self._is_frozen(solution):
            self.frozen += 1
            return None
        self._recent.append(solution)
        return self._fix(solution, solution.received_s - lag_s)

    def _no_fix(self, solution: Solution) -> GnssFix | None:
        """A loss is believed at once."""
        if self._recent and self._recent[-1].fix_type.has_position:
            self.losses += 1
        self._recent.append(solution)
        self._place = None
        return self._fix(solution, solution.received_s)

    # ------------------------------------------------------------ time

    def _restart_clock(self) -> None:
        self._epoch_s: float | None = None
        self._least_lag_s = math.inf
        self._refused_epoch_s: float | None = None
        self._refused_in_a_row = 0

    def _punctual_lag_s(self, solution: Solution) -> float | None:
        """How much later than the most punctual solution this one came; None to refuse it.

        A backlog that is read after a pause would else look new.
        """
        epoch_s = solution.epoch_s
        if epoch_s is None:
            return None
        if self._epoch_s is not None:
            step_s = _wrapped_s(epoch_s - self._epoch_s, solution.period_s)
            if step_s <= 0.0:
                if not self._clock_insists(epoch_s, solution.period_s):
                    return None
                self._restart_clock()
            else:
                self._least_lag_s += LAG_CREEP_S_PER_S * step_s
        self._epoch_s = epoch_s
        self._refused_epoch_s, self._refused_in_a_row = None, 0
        return self._lag_s(solution.received_s - epoch_s, solution.period_s)

    def _lag_s(self, lag_s: float, period_s: float) -> float:
        if self._least_lag_s == math.inf:
            self._least_lag_s = lag_s
        late_s = _wrapped_s(lag_s - self._least_lag_s, period_s)
        if late_s < 0.0:
            self._least_lag_s = lag_s
            return 0.0
        return late_s

    def _clock_insists(self, epoch_s: float, period_s: float) -> bool:
        """True when refused times have advanced often enough to be a new clock."""
        before_s, self._refused_epoch_s = self._refused_epoch_s, epoch_s
        advances = before_s is None or _wrapped_s(epoch_s - before_s, period_s) > 0.0
        self._refused_in_a_row = self._refused_in_a_row + 1 if advances else 0
        return self._refused_in_a_row > CLOCK_INSISTS_AFTER

    # ------------------------------------------------------------ place

    def _is_frozen(self, solution: Solution) -> bool:
        before_s, self._placed_s = self._placed_s, solution.epoch_s or 0.0
        if solution.place != self._place:
            self._place, self._still_for_s = solution.place, 0.0
            return False
        # Summed up: still for half a day is still, whatever the clock's period.
        self._still_for_s += _wrapped_s(self._placed_s - before_s, solution.period_s)
        return self._still_for_s >= self._frozen_after_s

    # ------------------------------------------------------------ type of fix

    def _fix(self, solution: Solution, received_s: float) -> GnssFix | None:
        """The worst type and accuracy of the last solutions: better ones must first hold."""
        stamp_s = received_s - self._latency_s
        if stamp_s <= self._stamp_s:
            self.untimely += 1
            return None
        fix_type = min((s.fix_type for s in self._recent), key=_ORDER.index)
        self.leaps += fix_type is not solution.fix_type
        placed = _ORDER.index(fix_type) >= _ORDER.index(FixType.FIX_2D)
        useless = NO_POSITION_ACCURACY_M
        try:
            fix = GnssFix(
                stamp_s=stamp_s,
                fix_type=fix_type,
                latitude_deg=solution.latitude_deg if placed else 0.0,
                longitude_deg=solution.longitude_deg if placed else 0.0,
                amsl_m=solution.amsl_m if placed else 0.0,
                horizontal_accuracy_m=max(s.horizontal_accuracy_m for s in self._recent)
                if placed
                else useless,
                vertical_accuracy_m=max(s.vertical_accuracy_m for s in self._recent)
                if placed
                else useless,
                satellites=solution.satellites,
            )
        except ReadingRefused:
            self.absurd += 1
            return None
        self._stamp_s = stamp_s
        self.told += 1
        return fix


def _is_possible(solution: Solution) -> bool:
    """False for what no multicopter on Earth can measure; NaN is never possible."""
    latitude_deg, longitude_deg, amsl_m = solution.place
    horizontal_m, vertical_m = solution.horizontal_accuracy_m, solution.vertical_accuracy_m
    return (
        abs(latitude_deg) <= 90.0
        and abs(longitude_deg) <= 180.0
        and (latitude_deg, longitude_deg) != (0.0, 0.0)
        and LOWEST_M <= amsl_m <= HIGHEST_M
        and 0.0 < horizontal_m <= WORST_ACCURACY_M
        and 0.0 < vertical_m <= WORST_ACCURACY_M
    )


def _wrapped_s(step_s: float, period_s: float) -> float:
    """A step of a clock that starts anew every `period_s`: in [-period / 2, period / 2)."""
    return (step_s + 0.5 * period_s) % period_s - 0.5 * period_s
