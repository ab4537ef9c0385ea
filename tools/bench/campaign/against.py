"""A campaign beside an earlier one: world by world, what got worse."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from tools.bench.campaign import summary
from tools.bench.campaign.case import Row
from tools.bench.campaign.summary import estimated, mean
from tools.bench.campaign.tables import Key, Table, groups

SLOWER = 1.05
"""By more than this a world's mean time counts as worse."""
_NAMED = 30

Pair = tuple[Row, Row]


class Regression(NamedTuple):
    """What got worse in one world, the gravest first."""

    gravity: tuple[int, float]
    key: Key
    world: str
    what: str
    again: str
    """The command that flies the worst of its flights."""


def tables(earlier: Sequence[Row], rows: Sequence[Row]) -> list[Table]:
    """Totals of what both flew, and the worlds that got worse."""
    pairs, other = paired(earlier, rows)
    return [_totals(pairs, other, len(rows)), _regressions(regressions(pairs))]


def paired(earlier: Sequence[Row], rows: Sequence[Row]) -> tuple[list[Pair], int]:
    """(before, now) of every case that both flew, and how many cases have another world by now."""
    before = {row.case: row for row in earlier}
    both = [(before[row.case], row) for row in rows if row.case in before]
    same = [pair for pair in both if pair[0].scenario == pair[1].scenario]
    return same, len(both) - len(same)


def regressions(pairs: Sequence[Pair]) -> list[Regression]:
    """By planner, sensors, response and world."""
    found: dict[tuple[Key, str], list[Pair]] = {}
    for before, row in pairs:
        found.setdefault(((row.planner, row.sensors, row.response), row.world), []).append(
            (before, row)
        )
    judged = (_judged(key, world, mine) for (key, world), mine in found.items())
    return sorted(
        (each for each in judged if each is not None), key=lambda r: r.gravity, reverse=True
    )


def _judged(key: Key, world: str, mine: Sequence[Pair]) -> Regression | None:
    """None where nothing got worse."""
    then, now = [before for before, _ in mine], [row for _, row in mine]
    worst = summary.worst(now, 1)[0]
    said: list[str] = []
    gravity = (0, 0.0)
    for grave, word, holds in (
        (4, "collisions", _collided),
        (3, "falsely unreachable", summary.falsely_unreachable),
        (2, "without a verdict", summary.gave_up),
        (1, "not reached", _missed),
    ):
        before, after = sum(map(holds, then)), sum(map(holds, now))
        if after > before:
            said.append(f"{word} {before} -> {after} of {len(mine)}")
            gravity = max(gravity, (grave, float(after - before)))
    slower = _slower(mine)
    if slower > SLOWER:
        said.append(f"time x {slower:.2f}")
        gravity = max(gravity, (0, slower))
    return Regression(gravity, key, world, "; ".join(said), worst.again) if said else None


def _collided(row: Row) -> bool:
    return row.collided


def _missed(row: Row) -> bool:
    return row.reachable and not row.reached


def _slower(mine: Sequence[Pair]) -> float:
    """Mean time now over then, of flights that reached the goal both times; 1 without any."""
    both = [(a.navigation_s, b.navigation_s) for a, b in mine if a.reached and b.reached]
    if not both:
        return 1.0
    then, now = np.mean(both, axis=0).tolist()
    return float(now / then) if then > 0.0 else 1.0


def _totals(pairs: Sequence[Pair], other: int, flown: int) -> Table:
    head = (
        "planner",
        "sensors",
        "response",
        "flights",
        "success %",
        "collisions",
        "falsely unreachable",
        "gave up",
        "time, mean ratio",
    )
    found = []
    before_of = {row.case: before for before, row in pairs}
    for key, now in groups([row for _, row in pairs]):
        then = [before_of[row.case] for row in now]
        cells = [*key, str(len(now))]
        cells.append(
            " -> ".join(estimated(each, summary.success, mean).text(1) for each in (then, now))
        )
        cells += [
            f"{sum(map(holds, then))} -> {sum(map(holds, now))}"
            for holds in (_collided, summary.falsely_unreachable, summary.gave_up)
        ]
        ratio = estimated(now, lambda row: _ratio(before_of[row.case], row), mean)
        found.append((*cells, ratio.text()))
    note = f"Of {flown} flights {len(pairs)} were flown in the earlier campaign, too."
    if other:
        note += f" {other} more have the same name and another world: they are left out."
    return Table("Beside the earlier campaign", head, tuple(found), note)


def _ratio(before: Row, row: Row) -> float | None:
    if not (before.reached and row.reached) or before.navigation_s <= 0.0:
        return None
    return row.navigation_s / before.navigation_s


def _regressions(found: Sequence[Regression]) -> Table:
    note = f"{len(found)} worlds got worse; slower counts from {100.0 * (SLOWER - 1.0):.0f} % on."
    if len(found) > _NAMED:
        note += f" The {_NAMED} gravest are named."
    return Table(
        "Regressions",
        ("planner", "sensors", "response", "world", "what", "look at it"),
        tuple((*r.key, r.world, r.what, r.again) for r in found[:_NAMED]),
        note,
    )
