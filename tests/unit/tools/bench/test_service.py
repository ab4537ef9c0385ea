"""The service's benchmark, without a service: what it makes of what it saw."""

import os

import msgspec
import pytest

from tools.bench.service import Measured, Meter, Punctual, Used, missed, page, punctuality

GOOD = Measured(
    used=(Used("flying", 10.0, 0.5, 150.0, 120.0),),
    ticks=(Punctual("page open", 400, 0.0002, 0.003, 0.02, 0.0004),),
    help_s=0.15,
    stream=(900, 2_000_000),
    reports=3,
    scenario="default",
)


def test_a_tick_is_off_by_its_distance_from_the_period_early_or_late() -> None:
    times_s = [0.0, 0.05, 0.11, 0.15, 0.2]
    found = punctuality("x", times_s, [0.1, 0.3, 0.2], 0.05)
    assert found.ticks == 5
    assert found.worst_s == pytest.approx(0.01)
    assert found.p99_s == pytest.approx(0.01)
    assert found.median_s == pytest.approx(0.005, abs=0.0051)
    assert found.step_median_s == 0.2
    with pytest.raises(ValueError, match="fewer than two"):
        punctuality("x", [1.0], [], 0.05)


def test_one_tick_in_a_thousand_is_the_worst_and_not_the_hundredth() -> None:
    times_s = [0.05 * k for k in range(1000)] + [0.05 * 999 + 0.25]
    found = punctuality("x", times_s, [0.0], 0.05)
    assert found.worst_s == pytest.approx(0.2)
    assert found.p99_s < 1e-9


def test_what_is_wanted_is_compared_with_what_was_measured() -> None:
    assert missed(GOOD) == []
    fat = msgspec.structs.replace(GOOD.used[0], rss_mib=201.0)
    busy = msgspec.structs.replace(GOOD.used[0], cpu_s=1.1)
    late = msgspec.structs.replace(GOOD.ticks[0], p99_s=0.006)
    bad = msgspec.structs.replace(GOOD, used=(fat, busy), ticks=(late,), help_s=0.3)
    assert missed(bad) == [
        "flying: 11.0% of a core",
        "flying: 201 MiB",
        "page open: 0.0060 s",
        "help: 0.30 s",
    ]


def test_the_page_has_a_row_for_everything() -> None:
    text = page(GOOD)
    assert "| flying | 5.0% | 150 | 120 |" in text
    assert "| page open | 400 | 0.20 ms | 3.00 ms | 20.0 ms | 0.40 ms |" in text
    assert "`autonomy --help`: 0.15 s" in text


def test_a_process_is_metered_with_its_time_and_its_memory() -> None:
    into: list[Used] = []
    with Meter(os.getpid()).stretch("this test", into):
        sum(k * k for k in range(200_000))
    (used,) = into
    assert used.name == "this test"
    assert used.cpu_s > 0.0
    assert 10.0 < used.own_mib <= used.rss_mib
