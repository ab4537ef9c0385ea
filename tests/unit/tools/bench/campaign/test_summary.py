"""Many rows in few numbers: what counts, how sure it is, and what got worse."""

import math
from pathlib import Path

import msgspec
import pytest

from tests.unit.tools.bench.campaign.made import row
from tools.bench.campaign import against, commands, report, summary, tables
from tools.bench.campaign.case import differences
from tools.bench.campaign.report import Figure, Page
from tools.bench.campaign.store import Store
from tools.bench.campaign.summary import estimated, mean, median, p95

# optimum 5 m at 0.5 m/s: OT is 10 s.
REACHED = row("barn:0")
SLOW = row("barn:1", navigation_s=90.0)
QUICK = row("barn:2", navigation_s=11.0)
TOUCHED = row("barn:3", collided=True, clearance_m=0.14)
LOST = row("barn:4", ending="budget")
FALSE = row("barn:5", ending="unreachable", passage_m=0.24)
NARROW = row("barn:6", ending="unreachable", passage_m=0.2399)
RIGHT = row("barn:7", ending="unreachable", reachable=False, optimum_m=None, passage_m=0.1)
RAISED = row("barn:8", ending="raised", clearance_m=None, why="ValueError: no")
ALL = [REACHED, SLOW, QUICK, TOUCHED, LOST, FALSE, NARROW, RIGHT, RAISED]


def test_what_was_said_of_the_goal_is_right_narrow_or_false() -> None:
    assert [summary.rightly_unreachable(each) for each in (FALSE, NARROW, RIGHT)] == [0, 0, 1]
    assert [summary.narrowly_unreachable(each) for each in (FALSE, NARROW, RIGHT)] == [0, 1, 0]
    assert [summary.falsely_unreachable(each) for each in (FALSE, NARROW, RIGHT)] == [1, 0, 0]
    assert [each for each in ALL if summary.gave_up(each)] == [LOST, RAISED]


def test_success_is_of_worlds_with_a_way_and_touches_nothing() -> None:
    assert [summary.success(each) for each in (REACHED, TOUCHED, LOST, RIGHT)] == [100, 0, 0, None]
    assert estimated(ALL, summary.success, mean).value == pytest.approx(100.0 * 3 / 8)


def test_ratios_are_against_the_optimum_and_its_time() -> None:
    assert REACHED.length_ratio == pytest.approx(1.2)
    assert REACHED.time_ratio == pytest.approx(2.0)
    assert (TOUCHED.time_ratio, LOST.length_ratio, RIGHT.time_ratio) == (None, None, None)


@pytest.mark.parametrize(
    ("flown", "score", "strict"),
    [
        (REACHED, 0.5, 0.5),
        (QUICK, 0.5, 10.0 / 11.0),
        (row("barn:9", navigation_s=8.0), 0.5, 1.0),
        (SLOW, 0.125, 0.125),
        (row("barn:9", navigation_s=40.0), 0.25, 0.25),
        (TOUCHED, 0.0, 0.0),
        (LOST, 0.0, 0.0),
        (RIGHT, None, None),
    ],
)
def test_barn_s_score_clips_the_time(flown: object, score: float, strict: float) -> None:
    assert summary.score(flown) == pytest.approx(score)  # type: ignore[arg-type]  # a row
    assert summary.strict_score(flown) == pytest.approx(strict)  # type: ignore[arg-type]


def test_intervals_are_the_same_every_time_and_hold_the_value() -> None:
    many = [row(f"discs:{n}", s, navigation_s=15.0 + n % 7 + s) for n in range(40) for s in (0, 1)]
    first = estimated(many, lambda each: each.time_ratio, median)
    assert first == estimated(many, lambda each: each.time_ratio, median)
    assert first.low is not None
    assert first.high is not None
    assert first.low <= first.value <= first.high
    assert first.high - first.low > 0.01


def test_seeds_of_one_world_are_no_independent_samples() -> None:
    """Two worlds that differ, each flown often, tell as little as two flights."""
    twice = [row(f"discs:{n}", 0, navigation_s=10.0 + 10.0 * n) for n in (0, 1)]
    often = [row(f"discs:{n}", s, navigation_s=10.0 + 10.0 * n) for n in (0, 1) for s in range(50)]
    wide, same = (estimated(each, lambda r: r.time_ratio, mean) for each in (twice, often))
    assert wide == same
    assert (wide.low, wide.high) == (1.0, 2.0)


def test_worlds_with_fewer_flights_and_none_at_all_are_no_trouble() -> None:
    uneven = [REACHED, row("barn:0", 1, navigation_s=30.0), QUICK]
    found = estimated(uneven, lambda each: each.time_ratio, p95)
    assert found.value == pytest.approx(2.9)
    assert found.low is not None
    assert estimated([LOST], lambda each: each.time_ratio, mean).text() == "-"
    assert estimated([REACHED], lambda each: each.time_ratio, mean).text() == "2.000"
    assert math.isnan(estimated([], summary.success, mean).value)


def test_the_worst_flights_come_first() -> None:
    order = [RAISED, TOUCHED, FALSE, LOST, NARROW, SLOW, REACHED, QUICK, RIGHT]
    assert summary.worst(ALL) == order
    nearer = row("barn:9", collided=True, clearance_m=0.05)
    assert summary.worst([*ALL, nearer], 3) == [RAISED, nearer, TOUCHED]


def test_the_tables_count_what_was_flown() -> None:
    first = tables.outcomes(ALL)
    found = dict(zip(first.head, first.rows[0], strict=True))
    assert found["flights"] == "9"
    assert found["success %"].startswith("37.5 (")
    assert (found["collisions"], found["unreachable, rightly"]) == ("1", "1")
    assert (found["narrow"], found["falsely"]) == ("1", "1")
    assert found["gave up"] == "1 budget, 1 raised"
    assert found["least clearance m"] == "0.140"
    assert (found["a tick, us"], found["x real time"]) == ("300", "100")
    assert [table.title for table in tables.tables(ALL)][-1] == "BARN"
    score = dict(zip(tables.barn(ALL).head, tables.barn(ALL).rows[0], strict=True))
    assert score["score, of 0.5"].startswith(f"{(0.5 + 0.125 + 0.5) / 8:.4f}")


def test_each_planner_sensors_and_response_has_its_line_and_each_family_too() -> None:
    rows = [
        REACHED,
        row("discs:1"),
        row("discs:1", planner="bug2"),
        row("discs:1", response="ideal"),
    ]
    assert len(tables.outcomes(rows).rows) == 3
    by_family = tables.outcomes(rows, by_family=True)
    assert [line[0] for line in by_family.rows] == ["barn", "discs", "discs", "discs"]


def test_the_short_table_has_the_best_first_and_tells_only_what_differs() -> None:
    rows = [
        row("discs:1", planner="slow", navigation_s=30.0),
        row("discs:1", planner="quick", navigation_s=15.0, climb_s=2.5),
        row("discs:1", planner="fails", ending="budget"),
    ]
    short = tables.compact(rows)
    assert short.head[:2] == ("planner", "flights")
    assert [line[0] for line in short.rows] == ["quick", "slow", "fails"]
    quick = dict(zip(short.head, short.rows[0], strict=True))
    assert quick["time / optimum"] == "1.250"
    assert "BARN score, of 0.5" not in short.head
    barn = tables.compact([row("barn:1"), row("barn:1", response="ideal")])
    assert barn.head[:2] == ("planner", "response")
    scores = dict(zip(barn.head, barn.rows[0], strict=True))
    assert (scores["BARN score, of 0.5"], scores["with clip(AT, OT, 8 OT)"]) == ("0.5000", "0.5000")


def test_the_short_table_is_written_where_a_page_has_a_place_for_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with (tmp_path / "newest.jsonl").open("wb") as file:
        file.write(msgspec.json.encode(row("discs:1")) + b"\n")
    page = tmp_path / "README.md"
    page.write_text("a\n<!-- barn: begin -->\nold\n<!-- barn: end -->\nz\n", encoding="utf-8")
    asked = [str(tmp_path), "--page", str(page), "--section", "barn"]
    assert commands.report_on(asked) == 0
    assert "| t3drm-rolling | 1 | 100.0 |" in page.read_text(encoding="utf-8")
    with pytest.raises(SystemExit, match="has no place for rivals"):
        commands.report_on([*asked[:-1], "rivals"])
    with pytest.raises(SystemExit):
        commands.report_on(asked[:3])
    assert "--page and --section go together" in capsys.readouterr().err


def test_what_got_worse_is_named_by_world_the_gravest_first() -> None:
    now = [
        msgspec.structs.replace(REACHED, navigation_s=21.0),  # 5 %: not yet
        msgspec.structs.replace(SLOW, navigation_s=99.0, again="fly it"),
        msgspec.structs.replace(QUICK, collided=True, again="look"),
        msgspec.structs.replace(FALSE, ending="goal_reached"),
        msgspec.structs.replace(TOUCHED, scenario="another room"),
        row("barn:50"),
    ]
    pairs, other = against.paired(ALL, now)
    assert (len(pairs), other) == (4, 1)
    found = against.regressions(pairs)
    assert [(each.world, each.what, each.again) for each in found] == [
        ("barn:2", "collisions 0 -> 1 of 1; not reached 0 -> 1 of 1", "look"),
        ("barn:1", "time x 1.10", "fly it"),
    ]
    totals, named = against.tables(ALL, now)
    assert "1 more have the same name and another world" in totals.note
    assert named.note.startswith("2 worlds got worse")


def test_timing_and_who_flew_make_no_difference() -> None:
    other = msgspec.structs.replace(REACHED, cpu_s=9.0, step_us=1.0, commit="xyz", again="x")
    assert differences(REACHED, other) == ()
    assert differences(REACHED, msgspec.structs.replace(other, stops=7)) == ("stops",)


def test_the_page_fetches_nothing_and_markdown_has_its_pictures_beside_it(tmp_path: Path) -> None:
    figures = [Figure("a", "a <plot>", b"png"), Figure("b", "worst", b"png", "fly & see")]
    page = Page(report.all_tables(ALL, ALL), figures, [])
    html = page.html()
    assert "http" not in html
    assert "a &lt;plot&gt;" in html
    assert "<code>fly &amp; see</code>" in html
    page.write_markdown(tmp_path / "r.md")
    text = (tmp_path / "r.md").read_text()
    assert "![worst](r_pictures/b.png)" in text
    assert (tmp_path / "r_pictures" / "a.png").read_bytes() == b"png"
    assert "### Regressions" in text


def test_the_report_is_told_on_the_terminal(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with Store(tmp_path) as store:
        for each in ALL:
            store.keep(each)
    assert commands.report_on([str(tmp_path), "--against", str(tmp_path)]) == 0
    told = capsys.readouterr().out
    assert "### BARN" in told
    assert "0 worlds got worse" in told
    assert commands.report_on([str(tmp_path / "nothing")]) == 3
    assert "holds no rows of a campaign" in capsys.readouterr().err
