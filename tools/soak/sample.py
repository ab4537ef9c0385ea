"""What a process uses, looked at again and again, and whether that grows."""

import math
from collections.abc import Sequence

import msgspec
import numpy as np
import psutil

SETTLING = 0.2
"""This share of a record is the start: caches fill, code is loaded."""


class Sample(msgspec.Struct, frozen=True):
    """One look at a process `at_s` seconds into the soak, after so many missions.

    `rss_mb` is its resident memory; `lag_ms` how late the worst tenth of the control loop's ticks
    began since the look before, nan where no loop ran.
    """

    at_s: float
    missions: int
    rss_mb: float
    files: int
    threads: int
    lag_ms: float = math.nan


def look(process: psutil.Process, at_s: float, missions: int, lag_ms: float = math.nan) -> Sample:
    """A sample of a process now."""
    with process.oneshot():
        return Sample(
            at_s,
            missions,
            process.memory_info().rss / 1e6,
            process.num_fds(),
            process.num_threads(),
            lag_ms,
        )


def growth(samples: Sequence[Sample], what: str) -> tuple[float, float, float]:
    """(at the beginning, at the end, growth per 100 missions) of an attribute.

    Beginning and end are medians of the first and last quarter of what follows the settling;
    growth is the slope of a line through it (Theil-Sen: single outliers do not bend it).
    """
    settled = settled_part(samples)
    values = np.array([getattr(sample, what) for sample in settled])
    missions = np.array([float(sample.missions) for sample in settled])
    quarter = max(1, len(values) // 4)
    first, last = values[:quarter], values[-quarter:]
    slope = math.nan
    if np.ptp(missions) > 0.0:
        from scipy.stats import theilslopes

        known = ~np.isnan(values)
        if known.sum() > 1 and np.ptp(missions[known]) > 0.0:
            slope = 100.0 * float(theilslopes(values[known], missions[known]).slope)
    return float(np.nanmedian(first)), float(np.nanmedian(last)), slope


def settled_part(samples: Sequence[Sample]) -> Sequence[Sample]:
    """The samples after the start."""
    return samples[int(SETTLING * len(samples)) :]


def is_flat(samples: Sequence[Sample]) -> bool:
    """True when files and threads ended as they began, and memory grew by less than 2 %."""
    for what in ("files", "threads"):
        first, last, _ = growth(samples, what)
        if last > first:
            return False
    first, last, _ = growth(samples, "rss_mb")
    return last <= 1.02 * first
