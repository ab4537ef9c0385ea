"""Many flights in few numbers, with how sure they are."""

import math
from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import bootstrap

from tools.bench.campaign.case import Row

Floats = NDArray[np.float64]
Reduce = Callable[..., Any]

CONFIDENCE = 0.95
RESAMPLES = 1000
FALSE_M = 0.03
"""A passage of 2 r_min + 6 cm is promised to be found: so much more than r_min a side."""
WORST = 10


class Estimate(NamedTuple):
    """A number and the limits of its confidence interval; None where one sample is all."""

    value: float
    low: float | None = None
    high: float | None = None

    def text(self, digits: int = 3) -> str:
        """`1.084 (1.071-1.102)`."""
        if math.isnan(self.value):
            return "-"
        if self.low is None or self.high is None or self.low == self.high:
            return f"{self.value:.{digits}f}"
        return f"{self.value:.{digits}f} ({self.low:.{digits}f}-{self.high:.{digits}f})"


def mean(values: Floats, axis: int = -1) -> Any:
    """NaN is nothing."""
    return np.nanmean(values, axis=axis)


def median(values: Floats, axis: int = -1) -> Any:
    """NaN is nothing."""
    return np.nanmedian(values, axis=axis)


def p95(values: Floats, axis: int = -1) -> Any:
    """NaN is nothing."""
    return np.nanpercentile(values, 95, axis=axis)


def estimated(
    rows: Sequence[Row], measure: Callable[[Row], float | None], reduce: Reduce, seed: int = 0
) -> Estimate:
    """`reduce` of what `measure` finds in each row (None: nothing), with a bootstrap interval.

    Worlds are drawn anew, each with all its flights: seeds of one world are no independent
    samples. Of one world alone its flights are drawn.
    """
    table = _by_world([(row.world, measure(row)) for row in rows])
    if not table.size or np.isnan(table).all():
        return Estimate(math.nan)
    value = float(reduce(table.ravel()))
    if table.shape[0] == 1:
        table = table.T
    count = table.shape[0]
    if count < 2:
        return Estimate(value)

    def of(drawn: NDArray[np.int64], axis: int = -1) -> Any:
        taken = table[drawn]
        return reduce(taken.reshape(*drawn.shape[:-1], -1), axis=axis)

    found = bootstrap(
        (np.arange(count),),
        of,
        n_resamples=RESAMPLES,
        batch=max(1, 2_000_000 // table.size),
        vectorized=True,
        confidence_level=CONFIDENCE,
        method="percentile",
        rng=np.random.default_rng(seed),
    ).confidence_interval
    return Estimate(value, float(found.low), float(found.high))


def _by_world(found: Iterable[tuple[str, float | None]]) -> Floats:
    """(worlds, flights of one), NaN where a world has fewer; worlds without any are left out."""
    values: dict[str, list[float]] = {}
    for world, value in found:
        if value is not None:
            values.setdefault(world, []).append(value)
    table = np.full((len(values), max(map(len, values.values()), default=0)), math.nan)
    for number, mine in enumerate(values.values()):
        table[number, : len(mine)] = mine
    return table


# ---------------------------------------------------------------- what counts


def success(row: Row) -> float | None:
    """100 or 0 per cent; None in a world without a way."""
    return 100.0 * row.reached if row.reachable else None


def rightly_unreachable(row: Row) -> bool:
    """Said where the body has no way."""
    return row.ending == "unreachable" and not row.reachable


def falsely_unreachable(row: Row) -> bool:
    """Said where a passage of 2 r_min + 6 cm leads to the goal."""
    return row.ending == "unreachable" and row.passage_m >= row.keep_out_m + FALSE_M


def narrowly_unreachable(row: Row) -> bool:
    """Said where the body has a way, but one narrower than what is promised."""
    return row.ending == "unreachable" and row.reachable and not falsely_unreachable(row)


def gave_up(row: Row) -> bool:
    """No verdict: out of time, a failsafe, something raised."""
    return row.ending not in ("goal_reached", "unreachable")


def score(row: Row, least: float = 2.0) -> float | None:
    """BARN's: success * OT / clip(AT, least * OT, 8 * OT); OT the optimum at the greatest speed.

    AT is the time from the height of flight to the goal. At most 1 / least; None where there is no
    way, or the row is too old to tell.
    """
    if row.optimum_s is None or row.way_s is None:
        return None
    if not row.reached:
        return 0.0
    actual_s = min(max(row.way_s, least * row.optimum_s), 8.0 * row.optimum_s)
    return row.optimum_s / actual_s


def strict_score(row: Row) -> float | None:
    """The same with clip(AT, OT, 8 * OT), which sees what is faster than twice the optimum."""
    return score(row, 1.0)


def times_real_time(rows: Sequence[Row]) -> float:
    """Simulated seconds a second of CPU time; NaN for nothing."""
    cpu_s = sum(row.cpu_s for row in rows)
    return sum(row.simulated_s for row in rows) / cpu_s if cpu_s > 0.0 else math.nan


def badness(row: Row) -> tuple[int, float]:
    """The worst flight has the greatest."""
    if row.ending == "raised":
        return (6, 0.0)
    if row.collided:
        return (5, -(row.clearance_m or 0.0))
    if falsely_unreachable(row):
        return (4, row.passage_m)
    if gave_up(row):
        return (3, row.navigation_s)
    if narrowly_unreachable(row):
        return (2, row.passage_m)
    if row.time_ratio is not None:
        return (1, row.time_ratio)
    return (0, row.navigation_s)


def worst(rows: Sequence[Row], count: int = WORST) -> list[Row]:
    """The worst flights, the worst first."""
    return sorted(rows, key=badness, reverse=True)[:count]
