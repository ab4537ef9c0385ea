"""What grows, and what only looks like it."""

import math

import pytest

from tools.soak import flying
from tools.soak.__main__ import section
from tools.soak.sample import Sample, growth, is_flat


def record(rss_mb: list[float], files: int = 10, more_files: int = 0) -> list[Sample]:
    return [
        Sample(5.0 * n, n, mb, files + (more_files if n > 60 else 0), 7)
        for n, mb in enumerate(rss_mb)
    ]


def test_what_settles_is_flat() -> None:
    start = [100.0 + 5.0 * n for n in range(15)]
    assert is_flat(record(start + [175.0] * 85))


def test_a_leak_is_found_and_measured() -> None:
    leaking = record([100.0 + 0.2 * n for n in range(100)])
    assert not is_flat(leaking)
    first, last, slope = growth(leaking, "rss_mb")
    assert last - first == pytest.approx(12.0, abs=0.5)
    assert slope == pytest.approx(20.0)


def test_one_more_file_is_a_leak() -> None:
    assert is_flat(record([100.0] * 100))
    assert not is_flat(record([100.0] * 100, more_files=1))


def test_an_outlier_does_not_bend_the_slope() -> None:
    values = [100.0] * 100
    values[70] = 400.0
    assert growth(record(values), "rss_mb")[2] == pytest.approx(0.0)
    assert is_flat(record(values))


def test_the_table_leaves_out_what_was_not_measured() -> None:
    assert "loop lag" not in section("a soak", record([100.0] * 100))
    lagging = [Sample(5.0 * n, n, 100.0, 10, 7, 2.0) for n in range(100)]
    assert "| loop lag, nine tenths below, ms | 2.0 | 2.0 | +0.000 |" in section("a soak", lagging)


def test_the_lag_between_two_looks_comes_from_the_histogram() -> None:
    before = {0.001: 10.0, 0.01: 10.0, math.inf: 10.0}
    now = {0.001: 50.0, 0.01: 108.0, math.inf: 110.0}
    assert flying._worst_tenth_ms(before, now) == pytest.approx(10.0)
    assert math.isnan(flying._worst_tenth_ms(now, now))


def test_a_short_soak_flies_and_is_looked_at_after_each_mission() -> None:
    told: list[str] = []
    samples = flying.simulated(0.01, told.append)
    assert [sample.missions for sample in samples] == list(range(1, len(samples) + 1))
    assert all(sample.rss_mb > 10.0 and sample.threads >= 1 for sample in samples)
    assert told[0].startswith("1 missions")
