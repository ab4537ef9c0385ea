"""The page says what was measured."""

import math
from functools import partial
from pathlib import Path

import pytest

from tools.bench import report, steps
from tools.bench.maps import families
from tools.bench.planners import Campaign, Growth, Reach, TangentRoute, Trial, campaign, race

OWN = TangentRoute.name


def test_percentiles_are_linear_between_neighbours_and_bear_infinity() -> None:
    assert report.percentile([3.0, 1.0, 2.0], 50) == 2.0
    assert report.percentile([1.0, 2.0], 25) == 1.25
    assert report.percentile([1.0, math.inf], 100) == math.inf
    assert report.percentile([1.0, 2.0, math.inf], 50) == 2.0


def test_families_belong_to_their_kind() -> None:
    assert report.kind_of("20 discs, 6 m") == "discs"
    assert report.kind_of("4 walls, 6 m") == "walls"
    assert report.kind_of("3 walls, 10 discs, 6 m") == "walls and discs"
    assert report.kind_of("BARN") == "BARN"


def test_a_failure_ranks_behind_every_length() -> None:
    trials = [
        Trial("f", 0, "exact optimum", 1.0, 0.9),
        Trial("f", 0, "lucky", None, 0.1),
        Trial("f", 0, "long", 1.5, 0.1),
        Trial("f", 0, OWN, 1.0, 0.001),
    ]
    rows = report.race_table(trials).splitlines()[2:]
    assert [row.split("|")[1].strip() for row in rows] == [
        "exact optimum",
        f"**{OWN}**",
        "long",
        "lucky",
    ]
    assert "| 0 % | - | - | - |" in rows[-1]


def test_the_head_start_counts_the_quicker_planner_of_each_barred_map() -> None:
    trials = tuple(Trial("BARN", n, OWN, 1.0, 0.001) for n in range(3))
    reaches = (
        Reach("BARN", 0, "RRT*", 0.2, 0.001, direct=False),
        Reach("BARN", 0, "BIT*", 0.054, 0.001, direct=False),
        Reach("BARN", 1, "RRT*", 0.02, 0.001, direct=False),
        Reach("BARN", 1, "BIT*", math.inf, 0.001, direct=False),
        Reach("BARN", 2, "BIT*", 0.0001, 0.001, direct=True),
    )
    said = report.verdicts(Campaign(trials, reaches, (), ()))[0]
    assert "median 37" in said
    assert "least 20" in said
    assert "at least 50 on 1 of 2 maps" in said
    assert "On the 1 maps whose straight way is free" in said


def test_a_budget_counts_only_when_its_median_is_within_one_percent() -> None:
    trials = (
        *(Trial("BARN", n, OWN, 1.0, 0.001) for n in range(3)),
        *(Trial("BARN", n, "BIT*, 10 ms", r, 0.01) for n, r in enumerate((1.0, 1.2, None))),
        *(Trial("BARN", n, "BIT*, 100 ms", r, 0.1) for n, r in enumerate((1.0, 1.009, None))),
        *(Trial("BARN", n, "RRT*, 1000 ms", 1.0, 1.0) for n in range(3)),
    )
    said = report.verdicts(Campaign(trials, (), (), ()))[0]
    assert "BARN 100 (BIT*, 100 ms)" in said


def test_the_slope_of_a_curve_is_its_exponent() -> None:
    curve = tuple(Growth(n, "square", n * n * 1e-6) for n in (10, 100, 1000))
    assert report.slope(curve, "square") == pytest.approx(2.0)


def test_only_what_is_between_the_markers_is_renewed(tmp_path: Path) -> None:
    page = tmp_path / "README.md"
    page.write_text("before\n<!-- planners: begin -->\nold\n<!-- planners: end -->\nafter\n")
    for _ in range(2):
        report.renew("planners", "new", page)
    expected = "before\n<!-- planners: begin -->\n\nnew\n\n<!-- planners: end -->\nafter\n"
    assert page.read_text() == expected
    with pytest.raises(ValueError, match="no place"):
        report.renew("flights", "new", page)


def test_a_whole_campaign_fills_the_page_and_draws_its_pictures(tmp_path: Path) -> None:
    chosen = [f for f in families(None) if f.name in ("5 discs, 6 m", "4 walls, 6 m")]
    flown = [partial(steps.measured_maps, 5)]
    measured = campaign(chosen, 2, 0, growth=(20, 50), at_once=2, flown=flown)
    page = report.planner_section(measured)
    assert "| 20 hits, 6 m | 5 | 20 | 20 |" in page
    assert "| time ~ n^ |" in page
    report.draw_all(measured, chosen, tmp_path)
    drawn = {path.name for path in tmp_path.glob("*.png")}
    assert {"length_time.png", "success.png", "times.png", "growth.png"} <= drawn


def test_a_small_campaign_makes_a_page_in_which_t3drm_is_exact() -> None:
    family = families(None)[0]
    found = [trial for trial in race(family, 2, 0) if isinstance(trial, Trial)]
    own = [trial.ratio for trial in found if trial.planner == OWN]
    assert own == pytest.approx([1.0, 1.0], abs=1e-6)
    page = report.planner_section(Campaign(tuple(found), (), (), ()))
    assert "### Discs" in page
    assert f"**{OWN}**" in page
    assert "2 of 2 maps solved" in page
