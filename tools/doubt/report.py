"""From flights to the tables of autonomy/perception/doubt/README.md. Pure."""

import statistics
from collections import Counter
from collections.abc import Iterable, Sequence

from autonomy.model import BeamWord
from tools.doubt.flights import KINDS, Row

_JUDGED_S = 10.0
"""A fault that was there for less before the landing proves nothing about the detector."""
_ALTERED_S = 5.0
"""A beam with nothing in range says the same with a bias, noise, or stuck."""
_UPRIGHT = ("up", "down")
_DETECTABLE = tuple(word for word in BeamWord if word is not BeamWord.OK)


def tables(rows: Sequence[Row]) -> str:
    """All tables, as they stand in the README."""
    faulty = [row for row in rows if row.case.kind]
    return "\n\n".join((_false_alarms(rows), _misses(faulty), _endings(faulty)))


def _table(head: Sequence[str], lines: Iterable[Sequence[str]]) -> str:
    rows = [head, ["---"] * len(head), *lines]
    return "\n".join("| " + " | ".join(row) + " |" for row in rows)


def _false_alarms(rows: Sequence[Row]) -> str:
    hours = sum(row.airborne_s for row in rows) / 3600.0
    found = Counter(word for row in rows for word in _false(row))
    lines = [
        (word.value, str(found[word.value]), f"{found[word.value] / hours:.2f}" if hours else "-")
        for word in _DETECTABLE
    ]
    head = (
        f"False alarms: {len(rows)} flights, {hours:.2f} h in the air, six beams; doubts of beams "
        "that had no fault, or before they had it."
    )
    return f"{head}\n\n" + _table(("doubt", "false alarms", "per hour of flight"), lines)


def _false(row: Row) -> list[str]:
    """The words of doubts without a fault behind them."""
    return [word for at_s, beam, word in row.doubts if beam != row.case.beam or at_s < row.began_s]


def _misses(rows: Sequence[Row]) -> str:
    lines = []
    for kind in KINDS:
        mine = [row for row in rows if row.case.kind == kind]
        level = [row for row in mine if row.case.beam not in _UPRIGHT]
        upright = [row for row in mine if row.case.beam in _UPRIGHT]
        words = Counter(row.word for row in mine if row.word)
        named = ", ".join(f"{word} {count}" for word, count in words.most_common())
        lines.append((f"`{kind}`", *_found(level), *_found(upright), named or "-"))
    head = (
        "Found: faults that were there for at least 10 s of the flight, and changed what the beam "
        "says for at least 5 s; delay is the median and "
        "the longest, in s from the fault to the doubt."
    )
    columns = ("fault", "level: found", "delay", "up, down: found", "delay", "called")
    return f"{head}\n\n" + _table(columns, lines)


def _found(rows: Sequence[Row]) -> tuple[str, str]:
    judged = [row for row in rows if _told(row) or row.delay_s is not None]
    delays = [row.delay_s for row in judged if row.delay_s is not None]
    if not delays:
        return f"0 of {len(judged)}", "-"
    span = f"{statistics.median(delays):.1f}, {max(delays):.1f}"
    return f"{len(delays)} of {len(judged)}", span


def _told(row: Row) -> bool:
    """True for a fault that was there, and changed readings, for long enough to be found."""
    return row.active_s >= _JUDGED_S and row.altered_s >= _ALTERED_S


def _endings(rows: Sequence[Row]) -> str:
    lines = []
    for kind in KINDS:
        mine = [row for row in rows if row.case.kind == kind]
        if mine:
            lines.append((f"`{kind}`", *_ended(mine)))
    lines.append(("**all**", *_ended(rows)))
    columns = (
        *("fault", "flights", "goal", "landed, reason said", "other", "collisions"),
        "least clearance",
    )
    head = "Endings: one fault each, at a random time in the first 30 s, on all beams in turn."
    return f"{head}\n\n" + _table(columns, lines)


def _ended(rows: Sequence[Row]) -> tuple[str, ...]:
    goal = sum(row.ending == "goal_reached" and row.on_ground for row in rows)
    landed = sum(row.ending != "goal_reached" and row.on_ground and bool(row.why) for row in rows)
    least = f"{min(row.clearance_m for row in rows):.2f} m" if rows else "-"
    numbers = (len(rows), goal, landed, len(rows) - goal - landed, sum(r.collided for r in rows))
    return (*(str(number) for number in numbers), least)
