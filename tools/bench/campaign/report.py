"""What a campaign says: on the terminal, as Markdown, and as one page of HTML."""

import base64
from collections.abc import Sequence
from html import escape
from pathlib import Path
from typing import NamedTuple

from autonomy.errors import BadInput
from tools.bench.campaign import against, flying, pictures, tables
from tools.bench.campaign.case import Row, differences
from tools.bench.campaign.order import Record
from tools.bench.campaign.summary import worst
from tools.bench.campaign.tables import Table

_STYLE = """
:root { color-scheme: light; --ink: #16191d; --quiet: #5c6672; --line: #d7dce2; }
* { box-sizing: border-box; }
body { margin: 0; background: #f4f5f7; color: var(--ink);
  font: 15px/1.5 system-ui, -apple-system, "Segoe UI", Roboto, "DejaVu Sans", sans-serif; }
main { max-width: 88rem; margin: 0 auto; padding: 1.25rem; display: grid; gap: 1rem;
  grid-template-columns: minmax(0, 1fr); }
section { background: #fff; border: 1px solid var(--line); border-radius: .6rem;
  padding: 1rem 1.2rem; overflow-x: auto; }
h1 { font-size: 1.35rem; margin: 0; } h2 { font-size: 1.05rem; margin: 0 0 .4rem; }
p { margin: .2rem 0 .6rem; max-width: 60rem; } .quiet { color: var(--quiet); }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; }
td, th { text-align: left; vertical-align: top; padding: .25rem 1rem .25rem 0;
  border-bottom: 1px solid var(--line); font-size: .9rem; }
td { white-space: nowrap; } th { color: var(--quiet); font-weight: 600; font-size: .8rem; }
.figures { display: grid; gap: 1rem;
  grid-template-columns: repeat(auto-fill, minmax(min(24rem, 100%), 1fr)); }
figure { margin: 0; } img { max-width: 100%; height: auto; }
figcaption { font-size: .85rem; } code { font-size: .8rem; overflow-wrap: anywhere; }
"""


class Figure(NamedTuple):
    """A picture; `command` flies what it shows, "" for a plot."""

    name: str
    caption: str
    png: bytes
    command: str = ""


def all_tables(rows: Sequence[Row], earlier: Sequence[Row] | None = None) -> list[Table]:
    """Of a campaign, and beside an earlier one."""
    beside = against.tables(earlier, rows) if earlier is not None else []
    return [*tables.tables(rows), *beside]


def short(rows: Sequence[Row], records: Sequence[Record]) -> str:
    """Markdown for a page of people: when, what and where, and the few columns that matter."""
    lines = []
    if records:
        last = records[-1]
        worlds, seeds = len({row.world for row in rows}), len({row.seed for row in rows})
        how_often = "one seed" if seeds == 1 else f"{seeds} seeds"
        when = f"{last.begun[:10]}, commit {last.versions.commit}, on {last.computer}"
        lines = [f"Measured {when}: {worlds} worlds, {how_often}.", ""]
    return "\n".join([*lines, tables.compact(rows).cells()])


def figures(rows: Sequence[Row], barn: Path | None) -> list[Figure]:
    """Plots of all rows, then the worst flights, flown again."""
    plots = [Figure(name, title, png) for name, title, png in pictures.plots(rows)]
    return plots + [_worst(number, row, barn) for number, row in enumerate(worst(rows), start=1)]


def _worst(number: int, row: Row, barn: Path | None) -> Figure:
    again = flying.flown(row.case, barn)
    clear = f", {row.clearance_m:.3f} m clear" if row.clearance_m is not None else ""
    caption = f"{number}. {row.case.name}: {row.ending}{clear}. {row.why}"
    if differences(row, again.row):
        caption += f" Flown by commit {row.commit}; {again.row.commit} flies it as drawn."
    return Figure(f"worst-{number:02d}", caption, pictures.flight_png(again), row.again)


class Page(NamedTuple):
    """All that is told about a campaign."""

    tables: list[Table]
    figures: list[Figure]
    records: list[Record]

    def html(self) -> str:
        """One document that fetches nothing."""
        plots = "".join(_figure(each) for each in self.figures if not each.command)
        flights = "".join(_figure(each) for each in self.figures if each.command)
        return (
            '<!doctype html><html lang="en"><head><meta charset="utf-8">'
            '<meta name="viewport" content="width=device-width, initial-scale=1">'
            f"<title>Campaign</title><style>{_STYLE}</style></head><body><main>"
            f"<section><h1>Campaign</h1>{''.join(map(_flown, self.records))}</section>"
            f"{''.join(table.html() for table in self.tables)}"
            f'<section><h2>Plots</h2><div class="figures">{plots}</div></section>'
            f'<section><h2>The worst flights</h2><div class="figures">{flights}</div></section>'
            "</main></body></html>\n"
        )

    def write_markdown(self, path: Path) -> None:
        """The same text; pictures go into a folder beside it. Raises BadInput."""
        folder = path.with_suffix("")
        folder = folder.with_name(f"{folder.name}_pictures")
        lines = ["# Campaign", *map(_sentence, self.records)]
        lines += [table.markdown() for table in self.tables]
        for title, shown in (
            ("Plots", [each for each in self.figures if not each.command]),
            ("The worst flights", [each for each in self.figures if each.command]),
        ):
            lines.append(f"### {title}")
            for each in shown:
                lines.append(f"![{each.caption}]({folder.name}/{each.name}.png)")
                lines.append(f"{each.caption}" + (f" `{each.command}`" if each.command else ""))
        write(path, "\n\n".join(lines) + "\n")
        folder.mkdir(exist_ok=True)
        for each in self.figures:
            (folder / f"{each.name}.png").write_bytes(each.png)


def _figure(figure: Figure) -> str:
    data = base64.b64encode(figure.png).decode()
    command = f"<br><code>{escape(figure.command)}</code>" if figure.command else ""
    return (
        f'<figure><img src="data:image/png;base64,{data}" alt="{escape(figure.caption)}">'
        f"<figcaption>{escape(figure.caption)}{command}</figcaption></figure>"
    )


def _sentence(record: Record) -> str:
    versions = record.versions
    return (
        f"Begun {record.begun} by `{record.command}` on {record.computer}: version "
        f"{versions.version}, commit {versions.commit}, Python {versions.python}, numpy "
        f"{versions.numpy}, numba {versions.numba}."
    )


def _flown(record: Record) -> str:
    before, command, after = _sentence(record).split("`", 2)
    return f"<p>{escape(before)}<code>{escape(command)}</code>{escape(after)}</p>"


def write(path: Path, text: str) -> None:
    """Raises BadInput where it cannot be written."""
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise BadInput(f"{path} cannot be written ({error.strerror})") from None


def facts(then: Row, now: Row) -> str:
    """Two flights of one case beside each other, in a few lines."""
    lines = [then.case.name]
    for name in ("ending", "why", "collided", "clearance_m", "length_m", "navigation_s", "stops"):
        before, after = getattr(then, name), getattr(now, name)
        told = _told(before) if before == after else f"{_told(before)} -> {_told(after)}"
        lines.append(f"{name:13s} {told}")
    return "\n".join(lines)


def _told(value: object) -> str:
    return f"{value:.3f}" if isinstance(value, float) else str(value)
