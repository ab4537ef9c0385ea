"""The tables of a campaign, for Markdown and for HTML alike."""

import math
from collections import Counter
from collections.abc import Callable, Sequence
from html import escape
from typing import NamedTuple

from tools.bench.campaign import summary
from tools.bench.campaign.case import Row
from tools.bench.campaign.summary import Estimate, estimated, mean, median, p95

Key = tuple[str, ...]


class Table(NamedTuple):
    """Cells are plain text; `note` says what they mean."""

    title: str
    head: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    note: str = ""

    def markdown(self) -> str:
        """With its title as a heading."""
        lines = [f"### {self.title}", ""]
        if self.note:
            lines += [self.note, ""]
        return "\n".join([*lines, self.cells()])

    def cells(self) -> str:
        """As Markdown, without title and note."""
        lines = [f"| {' | '.join(self.head)} |", f"|{'---|' * len(self.head)}"]
        lines += [f"| {' | '.join(row)} |".replace("\n", " ") for row in self.rows]
        return "\n".join(lines)

    def html(self) -> str:
        """The same as a section."""
        head = "".join(f"<th>{escape(cell)}</th>" for cell in self.head)
        body = "".join(
            f"<tr>{''.join(f'<td>{escape(cell)}</td>' for cell in row)}</tr>" for row in self.rows
        )
        note = f'<p class="quiet">{escape(self.note)}</p>' if self.note else ""
        return (
            f"<section><h2>{escape(self.title)}</h2>{note}"
            f"<table><tr>{head}</tr>{body}</table></section>"
        )


def tables(rows: Sequence[Row]) -> list[Table]:
    """All of a campaign's tables that have something to say."""
    found = [outcomes(rows), ratios(rows)]
    if len({row.family for row in rows}) > 1:
        found += [outcomes(rows, by_family=True), ratios(rows, by_family=True)]
    if any(row.family == "barn" for row in rows):
        found.append(barn([row for row in rows if row.family == "barn"]))
    return found


def groups(rows: Sequence[Row], *, by_family: bool = False) -> list[tuple[Key, list[Row]]]:
    """Rows of one planner, sensors and response (and family), in the order of their coming."""
    found: dict[Key, list[Row]] = {}
    for row in rows:
        key = (row.planner, row.sensors, row.response)
        found.setdefault((row.family, *key) if by_family else key, []).append(row)
    return sorted(found.items(), key=lambda each: each[0][:1]) if by_family else list(found.items())


_KEY = ("planner", "sensors", "response")


def _key(*, by_family: bool) -> tuple[str, ...]:
    return ("family", *_KEY) if by_family else _KEY


def _title(title: str, *, by_family: bool) -> str:
    return f"{title}, by family" if by_family else title


def outcomes(rows: Sequence[Row], *, by_family: bool = False) -> Table:
    """How flights ended, how near they came, what they cost."""
    head = (
        *_key(by_family=by_family),
        "flights",
        "success %",
        "collisions",
        "unreachable, rightly",
        "narrow",
        "falsely",
        "gave up",
        "least clearance m",
        "stops mean",
        "a tick, us",
        "x real time",
    )
    found = []
    for key, mine in groups(rows, by_family=by_family):
        gave_up = Counter(row.ending for row in mine if summary.gave_up(row))
        cells = (
            *key,
            str(len(mine)),
            estimated(mine, summary.success, mean).text(1),
            str(sum(row.collided for row in mine)),
            _count(mine, summary.rightly_unreachable),
            _count(mine, summary.narrowly_unreachable),
            _count(mine, summary.falsely_unreachable),
            ", ".join(f"{n} {ending}" for ending, n in gave_up.items()) or "0",
            _least_clearance(mine),
            f"{sum(row.stops for row in mine) / len(mine):.1f}",
            _number(_mean_step_us(mine)),
            _number(summary.times_real_time(mine)),
        )
        found.append(cells)
    return Table(
        _title("What came of it", by_family=by_family),
        head,
        tuple(found),
        "Success: at the goal without touching anything, of flights where the body has a way. "
        "Unreachable, rightly: where it has none; narrow: where its way is narrower than "
        "2 r_min + 6 cm; falsely: where it is as wide. Clearance is from the body's centre. A "
        "tick: CPU time of the planner with its guard, mean.",
    )


def ratios(rows: Sequence[Row], *, by_family: bool = False) -> Table:
    """Flown way and time against the optimum's."""
    reduced = (mean, median, p95)
    head = (
        *_key(by_family=by_family),
        "reached",
        *(f"length / optimum, {r.__name__}" for r in reduced),
        *(f"time ratio, {r.__name__}" for r in reduced),
    )
    found = []
    for key, mine in groups(rows, by_family=by_family):
        cells = [*key, str(sum(row.reached for row in mine))]
        for measure in (_length_ratio, _time_ratio):
            cells += [estimated(mine, measure, reduce).text() for reduce in reduced]
        found.append(tuple(cells))
    return Table(
        _title("How far and how long", by_family=by_family),
        head,
        tuple(found),
        "Of flights that reached the goal without touching anything. Time ratio: time from "
        "the height of flight to the goal over (optimum / greatest speed). In parentheses "
        "95 % intervals, by bootstrap over worlds.",
    )


def compact(rows: Sequence[Row]) -> Table:
    """The few columns that a README has room for; most goals first, of equals the quickest."""
    told = [n for n, name in enumerate(_KEY) if n == 0 or len({getattr(r, name) for r in rows}) > 1]
    on_barn = all(row.family == "barn" for row in rows)
    head = (
        *(_KEY[n] for n in told),
        "flights",
        "goal reached, %",
        "collisions",
        'falsely "unreachable"',
        "way / optimum",
        "time / optimum",
        "p95",
        *(("BARN score, of 0.5", "with clip(AT, OT, 8 OT)") if on_barn else ()),
        "least clearance m",
    )
    found = []
    for key, mine in groups(rows):
        success = estimated(mine, summary.success, mean)
        quick = estimated(mine, _time_ratio, mean)
        cells = (
            *(key[n] for n in told),
            str(len(mine)),
            f"{success.value:.1f}",
            str(sum(row.collided for row in mine)),
            _count(mine, summary.falsely_unreachable),
            f"{estimated(mine, _length_ratio, mean).value:.3f}",
            quick.text(),
            f"{estimated(mine, _time_ratio, p95).value:.3f}",
            *_scores(mine, on_barn=on_barn),
            _least_clearance(mine),
        )
        found.append(((-round(success.value, 1), quick.value), cells))
    rows_of_it = tuple(cells for _, cells in sorted(found, key=lambda each: each[0]))
    return Table("In short", head, rows_of_it)


def _least_clearance(rows: Sequence[Row]) -> str:
    clear = [row.clearance_m for row in rows if row.clearance_m is not None]
    return f"{min(clear):.3f}" if clear else "-"


def _scores(rows: Sequence[Row], *, on_barn: bool) -> tuple[str, ...]:
    if not on_barn:
        return ()
    return tuple(
        f"{estimated(rows, measure, mean).value:.4f}"
        for measure in (summary.score, summary.strict_score)
    )


def barn(rows: Sequence[Row]) -> Table:
    """The score of the BARN challenge, adapted."""
    head = (*_KEY, "worlds", "flights", "score, of 0.5", "score with clip(AT, OT, 8 OT), of 1")
    found = []
    for key, mine in groups(rows):
        scores: list[Estimate] = [
            estimated(mine, measure, mean) for measure in (summary.score, summary.strict_score)
        ]
        worlds = len({row.world for row in mine})
        found.append((*key, str(worlds), str(len(mine)), *(each.text(4) for each in scores)))
    return Table(
        "BARN",
        head,
        tuple(found),
        "Success x OT / clip(AT, 2 OT, 8 OT), mean; OT = optimum / greatest speed.",
    )


def _length_ratio(row: Row) -> float | None:
    return row.length_ratio


def _time_ratio(row: Row) -> float | None:
    return row.time_ratio


def _count(rows: Sequence[Row], holds: Callable[[Row], bool]) -> str:
    return str(sum(map(holds, rows)))


def _mean_step_us(rows: Sequence[Row]) -> float:
    ticks = sum(row.ticks for row in rows)
    return sum(row.step_us * row.ticks for row in rows) / ticks if ticks else math.nan


def _number(value: float) -> str:
    return "-" if math.isnan(value) else f"{value:.0f}"
