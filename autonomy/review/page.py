"""One flight as one self-contained HTML page: nothing is fetched, it opens from a memory stick."""

import re
from collections.abc import Callable, Iterable, Sequence
from html import escape
from itertools import pairwise
from pathlib import Path
from string import Template

from autonomy import __version__
from autonomy.errors import BadInput
from autonomy.model import SOURCES
from autonomy.report import FlightReport, frame_words, report_rows
from autonomy.review.explain import DOING, SPEED_ROWS, plan_words, speed_row
from autonomy.review.figures import (
    estimator_svg,
    heard,
    map_svg,
    persistence_svg,
    px4_svg,
    timeline_svg,
)
from autonomy.review.history import History, Moment, history_of
from autonomy.review.invariants import PATH_STATES, Verdict, check
from autonomy.review.ulog import Beside
from hal.vehicle.guard import WORDS

_STYLE = """
:root { color-scheme: light dark; --ink: #16191d; --quiet: #5c6672; --line: #d7dce2;
  --good: #187a3f; --bad: #c0261c; --panel: #ffffff; --ground: #f4f5f7; }
@media screen and (prefers-color-scheme: dark) {
  :root { --ink: #e8ebef; --quiet: #98a3b0; --line: #2c333c; --good: #4cc27c; --bad: #ff6b5e;
    --panel: #181c22; --ground: #101317; }
}
* { box-sizing: border-box; }
body { margin: 0; background: var(--ground); color: var(--ink);
  font: 15px/1.5 system-ui, -apple-system, "Segoe UI", Roboto, "DejaVu Sans", sans-serif; }
main { max-width: 72rem; margin: 0 auto; padding: 1.25rem; display: grid;
  grid-template-columns: minmax(0, 1fr); gap: 1rem; }
section { background: var(--panel); border: 1px solid var(--line); border-radius: .6rem;
  padding: 1rem 1.2rem; overflow-x: auto; }
h1 { font-size: 1.35rem; margin: 0; } h2 { font-size: 1.05rem; margin: 0 0 .6rem; }
p { margin: .2rem 0 .6rem; } .quiet { color: var(--quiet); }
.good { color: var(--good); } .bad { color: var(--bad); } .word { font-weight: 700; }
table { border-collapse: collapse; width: 100%; font-variant-numeric: tabular-nums; }
td { overflow-wrap: break-word; } td.number { white-space: nowrap; }
td, th { text-align: left; vertical-align: top; padding: .25rem .8rem .25rem 0;
  border-bottom: 1px solid var(--line); }
th { color: var(--quiet); font-weight: 600; font-size: .85rem; }
.two { display: grid; gap: 1rem;
  grid-template-columns: repeat(auto-fit, minmax(min(20rem, 100%), 1fr)); }
.barcodes { display: flex; flex-wrap: wrap; gap: 1rem; } figure { margin: 0; }
figcaption { font-size: .85rem; color: var(--quiet); max-width: 16rem; }
svg { max-width: 100%; height: auto; background: #ffffff; border-radius: .3rem; }
@media (max-width: 40rem) {
  main { padding: .6rem; } section { padding: .8rem; } td, th { padding-right: .5rem; }
}
"""

_NUMBER = re.compile(r"[-+.\d]+(e[-+]?\d+)?( to [.\d]+)?( [^\s\d]{1,5})?")
"""A quantity with its unit, or a stretch of time: torn apart it would be read wrong."""

_PAGE = Template("""<!doctype html>
<html lang="en"><head><meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>$title</title><style>$style</style></head><body><main>
<header><h1>$heading</h1><p>$why</p></header>
<div class="two"><section><h2>From above</h2><p class="quiet">North and east $frame.</p>
$map</section>
<section><h2>In numbers</h2>$numbers</section></div>
<section><h2>What had to be true</h2>$invariants</section>
<section><h2>Speed and distance</h2>
<p class="quiet">Bands: green straight at the goal, blue following a plan, orange stopping, yellow
looking round, pink holding. Red ticks: the guard changed the setpoint.</p>$timeline
$table2</section>
<section><h2>The position filter</h2>
<p class="quiet">Innovation squared against its gate: what is over the dashed line was
rejected.</p>$estimator</section>
<section><h2>Every plan</h2>
<p class="quiet">Each bar is a hit's component: it is born at radius 0 and ends where it merges with
a neighbour. What reaches over the dashed line, the keep-out radius, is an obstacle of its own
(purple).</p><div class="barcodes">$barcodes</div>$plans</section>
<section><h2>What happened</h2>$events</section>
<section><h2>What was wrong</h2>$faults</section>
<section><h2>The guard</h2>$guard</section>
<section><h2>What PX4 wrote</h2>$texts</section>
$px4
<footer class="quiet">$footer</footer>
</main></body></html>
""")


def write(
    log: Path, report: FlightReport, out: Path, beside: Beside | None = None
) -> tuple[Verdict, ...]:
    """Write the page of the flight recorded at `log`; returns the promises that it broke.

    `beside` is PX4's own record of it.

    Raises NotReplayable when the log cannot be flown again, BadInput when the page cannot be made.
    """
    history = history_of(log)
    text = page_of(history, report, beside)
    try:
        out.write_text(text, encoding="utf-8")
    except OSError as error:
        raise BadInput(f"{out}: cannot be written ({error.strerror})") from None
    return tuple(verdict for verdict in check(history) if not verdict.kept)


def page_of(history: History, report: FlightReport, beside: Beside | None = None) -> str:
    """The page as HTML text; raises BadInput when matplotlib is not installed."""
    verdicts = check(history)
    title = f"Flight {history.path.stem}"
    numbers = [(name, value) for name, value in report_rows(report) if name]
    good = report.exit_code == 0
    word = report.ending.value.replace("_", " ")
    return _PAGE.substitute(
        title=escape(title),
        style=_STYLE,
        heading=f'{escape(title)}: <span class="{"good" if good else "bad"}">{escape(word)}</span>',
        why=escape(report.why),
        frame=escape(frame_words(history.offset_ne_m)),
        map=map_svg(history),
        numbers=_table((), numbers),
        invariants=_invariants(verdicts),
        timeline=timeline_svg(history),
        estimator=_estimator(history),
        barcodes="".join(_barcode(history, number) for number in range(len(history.replans))),
        plans=_plans(history, report),
        events=_events(history),
        table2=_table2(history),
        faults=_faults(history),
        guard=_guard(history),
        texts=_texts(history),
        px4="" if beside is None else _px4(history, beside),
        footer=_footer(history),
    )


def _invariants(verdicts: Sequence[Verdict]) -> str:
    rows = []
    for verdict in verdicts:
        if verdict.broken_s is not None:
            word = f'<span class="bad word">broken at {verdict.broken_s:.2f} s</span>'
        elif verdict.worst is None:
            word = '<span class="quiet">not tried</span>'
            if verdict.why_not:
                word = f'<span class="quiet">not judged: {escape(verdict.why_not)}</span>'
        else:
            word = '<span class="good word">kept</span>'
        left = "" if verdict.worst is None else f"{verdict.worst:.3g} {verdict.unit}"
        when = "" if verdict.at_s is None else f"{verdict.at_s:.2f} s"
        rows.append((word, escape(verdict.promise), left, when))
    return _html_table(("", "promise", "least left", "at"), rows)


def _estimator(history: History) -> str:
    """Test ratios over the flight, and what came of every source."""
    names = heard(history)
    if not names:
        return "<p>The log says nothing of it.</p>"
    last = history.moments[-1].health
    rows = []
    for name in SOURCES:
        source = getattr(last, name)
        if name in names:
            worst = max(getattr(m.health, name).test_ratio for m in history.moments)
            rows.append((name, str(source.fused), str(source.rejected), f"{worst:.3g}"))
    table = _table(("source", "fused", "rejected", "largest test ratio"), rows)
    words = [f"the floor stepped {last.floor_steps}, the ceiling {last.ceiling_steps} times"]
    words.append(
        f"the frame jumped {last.frame_jumps}, the filter began anew {last.restarts} times"
    )
    if last.gnss_apart_m is not None:
        words.append(f"at the end GNSS was {last.gnss_apart_m:.2f} m off where it had been")
    return f"{estimator_svg(history)}{table}<p>{escape('; '.join(words))}.</p>"


def _barcode(history: History, number: int) -> str:
    replan = history.replans[number]
    at_s = replan.now_s - history.start_s
    return (
        f"<figure>{persistence_svg(replan, history.config)}<figcaption>plan {number + 1}, "
        f"{at_s:.1f} s: {len(replan.hits)} hits</figcaption></figure>"
    )


def _plans(history: History, report: FlightReport) -> str:
    """Algorithm 1's table: when, how long, what."""
    radii = [t.radius_m for t in report.timing.replans] if report.timing is not None else []
    rows = []
    for number, replan in enumerate(history.replans):
        radius_m = radii[number] if number < len(radii) else None
        rows.append(
            (
                str(number + 1),
                f"{replan.now_s - history.start_s:.2f} s",
                f"{replan.seconds * 1e3:.2f} ms",
                "" if radius_m is None else f"{radius_m:.3f} m",
                plan_words(replan),
            )
        )
    return _table(("plan", "at", "computing time", "Eq. 8/9 radius", "result"), rows)


def _events(history: History) -> str:
    rows = (
        (f"{event.stamp_s - history.start_s:.2f} s", event.name, event.why)
        for event in history.events
    )
    return _table(("at", "", "why"), rows)


def _guard(history: History) -> str:
    """Stretches of time in which a rule changed setpoints."""
    rows = [
        (f"{begin:.2f} to {end:.2f} s", rule, WORDS.get(rule, rule))
        for begin, end, rule in guard_stretches(history)
    ]
    return _table(("when", "rule", ""), rows) if rows else "<p>It changed nothing.</p>"


def _faults(history: History) -> str:
    """Stretches of time in which something counted as wrong, and the beams that were doubted."""
    rows = [
        (f"{begin:.2f} to {end:.2f} s", fault.replace("_", " "))
        for begin, end, fault in _stretches(history, lambda moment: moment.faults)
    ]
    why = {f"beam {d.beam} {d.word}": d.why for m in history.moments for d in m.doubts}
    rows += [
        (f"{begin:.2f} to {end:.2f} s", f"{doubt}: {why[doubt]}")
        for begin, end, doubt in _stretches(
            history, lambda moment: [f"beam {d.beam} {d.word}" for d in moment.doubts]
        )
    ]
    return _table(("when", ""), rows) if rows else "<p>Nothing.</p>"


def _table2(history: History) -> str:
    """How long the vehicle flew by each row of Table 2."""
    spent: dict[str, float] = {}
    for moment, after in pairwise(history.moments):
        if moment.streaming and moment.state in PATH_STATES:
            row = speed_row(moment, history.config)
            spent[row] = spent.get(row, 0.0) + after.now_s - moment.now_s
    whole_s = sum(spent.values())
    if whole_s <= 0.0:
        return ""
    rows = [
        (row, f"{spent[row]:.1f} s", f"{100.0 * spent[row] / whole_s:.0f} %")
        for row in SPEED_ROWS
        if row in spent
    ]
    return _table(("row of Table 2", "flown by", "of the way's time"), rows)


def guard_stretches(history: History) -> list[tuple[float, float, str]]:
    """(begin, end, rule): consecutive ticks on which a rule of the guard changed the setpoint."""
    return _stretches(history, lambda moment: moment.limits)


def _stretches(
    history: History, words: Callable[[Moment], Sequence[str]]
) -> list[tuple[float, float, str]]:
    """(begin, end, word): consecutive ticks of which a word holds."""
    open_since: dict[str, float] = {}
    found: list[tuple[float, float, str]] = []
    before_s = 0.0
    for moment in history.moments:
        at_s = moment.now_s - history.start_s
        now = words(moment)
        ended = [rule for rule in open_since if rule not in now]
        found.extend((open_since.pop(rule), before_s, rule) for rule in ended)
        for rule in now:
            open_since.setdefault(rule, at_s)
        before_s = at_s
    found.extend((begin, before_s, rule) for rule, begin in open_since.items())
    return sorted(found)


def _texts(history: History) -> str:
    rows = [(f"{t.stamp_s - history.start_s:.2f} s", t.text.strip()) for t in history.texts]
    return _table((), rows) if rows else "<p>Nothing.</p>"


def _px4(history: History, beside: Beside) -> str:
    """PX4's own log, on the time axis of this one."""
    rows = [
        (f"{since_s + beside.offset_s - history.start_s:.2f} s", word)
        for since_s, word in beside.record.nav_states
    ]
    return (
        "<section><h2>PX4's own log</h2>"
        f'<p class="quiet">{escape(beside_words(beside))} Solid: PX4\'s estimate; dotted: what its '
        "controllers asked for; dashed: what this program heard. Purple: its mode. Positions "
        "are in PX4's local frame.</p>"
        f"{px4_svg(history, beside)}{_table(('since', 'mode'), rows)}</section>"
    )


def beside_words(beside: Beside) -> str:
    """How the two logs were brought to one time, in one sentence."""
    return (
        f"Laid beside this log {beside.how}: the positions of both are then "
        f"{beside.apart_m * 100.0:.1f} cm apart (root mean square)."
    )


def _footer(history: History) -> str:
    told = [f"made by autonomy {__version__} from {history.path.name}"]
    told.append(
        "flown again with the same decisions, bit for bit"
        if history.difference is None
        else f"flown again, decisions differ: {history.difference}"
    )
    if history.damage is not None:
        told.append(history.damage)
    states = {moment.state for moment in history.moments}
    words = "; ".join(f"{state.value}: {DOING[state]}" for state in DOING if state in states)
    return f"<p>{escape('; '.join(told))}</p><p>{escape(words)}</p>"


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table of plain text."""
    return _html_table(head, [[escape(cell) for cell in row] for row in rows])


def _html_table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = ["<table>"]
    if head:
        lines.append("<tr>" + "".join(f"<th>{escape(cell)}</th>" for cell in head) + "</tr>")
    lines.extend("<tr>" + "".join(map(_cell, row)) + "</tr>" for row in rows)
    return "".join((*lines, "</table>"))


def _cell(cell: str) -> str:
    return f'<td class="number">{cell}</td>' if _NUMBER.fullmatch(cell) else f"<td>{cell}</td>"
