"""The command lines: fly, show, report."""

import argparse
import functools
import os
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import msgspec

from autonomy.errors import BadInput
from hal.sim.scenario import Scenario
from tools import pages
from tools.bench.campaign import flying, order, pictures, report
from tools.bench.campaign.arena import worlds
from tools.bench.campaign.case import Case, Row, differences, one_of
from tools.bench.campaign.cluster import cluster
from tools.bench.campaign.models import RESPONSES, SENSORS
from tools.bench.campaign.order import Order
from tools.bench.campaign.store import Store, rows_of
from tools.bench.campaign.tables import Table
from tools.bench.rivals import NAMES, config_of
from tools.campaign import Hands, ProcessDied, finished, processes

STOPPED = 130
"""Exit code after Ctrl-C, as shells have it."""


def fly(arguments: Sequence[str]) -> int:
    """Fly what is missing in a folder, then print the report's tables."""
    parser = argparse.ArgumentParser(
        prog="python -m tools.bench fly",
        description="Fly planners x worlds x seeds x sensors x response into a folder. What is "
        "there already is not flown again.",
        allow_abbrev=False,
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument(
        "--planner",
        action="extend",
        nargs="+",
        help=f"{', '.join(NAMES)}; rivals also without guard: bug2/unguarded",
    )
    parser.add_argument(
        "--world",
        action="extend",
        nargs="+",
        help="discs:0-99, room:17, barn:all, shipped:default, file:FILE.yaml ...",
    )
    parser.add_argument("--seeds", type=_count, default=1, help="flights of each combination")
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument(
        "--sensors", action="extend", nargs="+", help=f"{', '.join(SENSORS)}; default thin"
    )
    parser.add_argument(
        "--response", action="extend", nargs="+", help=f"{', '.join(RESPONSES)}; default px4"
    )
    parser.add_argument("--barn", type=Path, help="folder with the BARN worlds (worlds.json)")
    parser.add_argument("--jobs", type=_jobs, default="all", help="processes, or all (default)")
    parser.add_argument("--scheduler", help="of a Dask cluster that flies: tcp://HOST:PORT")
    parser.add_argument("--mixed", action="store_true", help="go on with rows of another commit")
    asked = parser.parse_args(arguments)
    return _said(lambda: _fly(asked, arguments))


def _fly(asked: argparse.Namespace, arguments: Sequence[str]) -> int:
    wanted = _order(asked)
    hands: Hands = cluster(asked.scheduler) if asked.scheduler else processes(asked.jobs)
    with Store(asked.folder) as store:
        if not asked.mixed:
            order.same_commit(asked.folder)
        order.record(asked.folder, wanted, arguments)
        barn = Path(wanted.barn) if wanted.barn else None
        keeper = _Keeper(store, barn)
        try:
            rows = finished(
                wanted.cases(),
                functools.partial(flying.fly, barn=barn),
                keeper,
                hands,
                wrong=_wrong,
            )
        except KeyboardInterrupt:
            sys.stderr.write(f"stopped; {asked.folder} is kept: the same command goes on\n")
            return STOPPED
    sys.stdout.write(_text(report.all_tables(rows)))
    return 0


class _Keeper:
    """The store, with each row's command and configuration."""

    def __init__(self, store: Store, barn: Path | None) -> None:
        self._store = store
        self._barn = barn

    def kept(self) -> list[Row]:
        return self._store.kept()

    def keep(self, row: Row) -> None:
        folder = self._store.folder
        order.keep_config(folder, row, self._barn)
        self._store.keep(msgspec.structs.replace(row, again=order.again(folder, row.case)))


def _order(asked: argparse.Namespace) -> Order:
    """What is asked for; raises BadInput for what nobody has."""
    if not asked.world:
        raise BadInput("no world is named: --world room:0-99, or several")
    barn = asked.barn.resolve() if asked.barn is not None else None
    planners = tuple(map(_planner, asked.planner or NAMES[:1]))
    names = [name for each in asked.world for name in worlds(each, barn)]
    return Order(
        planners,
        tuple(dict.fromkeys(names)),
        asked.seeds,
        tuple(one_of(SENSORS, each) for each in asked.sensors or ["thin"]),
        tuple(one_of(RESPONSES, each) for each in asked.response or ["px4"]),
        asked.first_seed,
        str(barn or ""),
    )


def _planner(name: str) -> str:
    """A planner that there is; raises BadInput."""
    try:
        config_of(name, Scenario(name="any"))
    except ValueError as error:
        raise BadInput(str(error)) from None
    return name


def _wrong(row: Row) -> str:
    """What is told as it comes."""
    if row.ending == flying.RAISED:
        return f"raised: {row.why}"
    return "touched something" if row.collided else ""


def show(arguments: Sequence[str]) -> int:
    """Fly one flight of a campaign again; 1 when it is not the same."""
    parser = argparse.ArgumentParser(
        prog="python -m tools.bench show",
        description="Fly one flight of a campaign again, look at it, and say whether it is the "
        "same.",
        allow_abbrev=False,
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument("row", help="as in the column `again`, or a number in the table of rows")
    parser.add_argument("--picture", type=Path, help="a PNG file to draw it into")
    parser.add_argument("--barn", type=Path, help="where the BARN worlds are now")
    asked = parser.parse_args(arguments)
    return _said(lambda: _show(asked))


def _show(asked: argparse.Namespace) -> int:
    then = _found(rows_of(asked.folder), asked.row, asked.folder)
    barn = asked.barn.resolve() if asked.barn is not None else order.barn_of(asked.folder)
    again = flying.flown(then.case, barn)
    sys.stdout.write(report.facts(then, again.row) + "\n")
    different = differences(then, again.row)
    if different:
        sys.stdout.write(f"not the same: {', '.join(different)}\n")
    else:
        sys.stdout.write("the same flight, in every figure but the computer's time\n")
    if then.commit != again.row.commit or then.config != again.row.config:
        sys.stdout.write(
            f"then commit {then.commit}, configuration {then.config}; "
            f"now {again.row.commit}, {again.row.config}\n"
        )
    if asked.picture is not None:
        pictures.save_flight(again, asked.picture)
    return int(bool(different))


def report_on(arguments: Sequence[str]) -> int:
    """Tell what a campaign says; nothing is flown but the worst flights, for their pictures."""
    parser = argparse.ArgumentParser(
        prog="python -m tools.bench report",
        description="Tables of a campaign, with plots and the worst flights in a file.",
        allow_abbrev=False,
    )
    parser.add_argument("folder", type=Path)
    parser.add_argument("--against", type=Path, help="an earlier campaign's folder")
    parser.add_argument("--html", type=Path, help="one page with everything in it")
    parser.add_argument("--markdown", type=Path, help="the same, pictures beside it")
    parser.add_argument("--barn", type=Path, help="where the BARN worlds are now")
    parser.add_argument("--page", type=Path, help="a page that gets the short table ...")
    parser.add_argument("--section", help="... between its markers <!-- SECTION: begin --> and end")
    asked = parser.parse_args(arguments)
    if (asked.page is None) != (asked.section is None):
        parser.error("--page and --section go together")
    if asked.page is not None:
        pages.must_have(asked.section, asked.page)
    return _said(lambda: _report(asked))


def _report(asked: argparse.Namespace) -> int:
    rows = rows_of(asked.folder)
    earlier = rows_of(asked.against) if asked.against is not None else None
    found = report.all_tables(rows, earlier)
    sys.stdout.write(_text(found))
    if asked.page is not None:
        short = report.short(rows, order.records(asked.folder))
        pages.renew(asked.section, short, asked.page)
    if asked.html is None and asked.markdown is None:
        return 0
    barn = asked.barn.resolve() if asked.barn is not None else order.barn_of(asked.folder)
    written = report.Page(found, report.figures(rows, barn), order.records(asked.folder))
    if asked.html is not None:
        report.write(asked.html, written.html())
    if asked.markdown is not None:
        written.write_markdown(asked.markdown)
    return 0


def _text(found: Sequence[Table]) -> str:
    return "\n\n".join(table.markdown() for table in found) + "\n"


def _found(rows: Sequence[Row], named: str, folder: Path) -> Row:
    """By number or by name; raises BadInput."""
    if named.isdecimal():
        if int(named) < len(rows):
            return rows[int(named)]
        raise BadInput(f"{folder} has {len(rows)} rows, numbered from 0: there is no {named}")
    case = Case.parsed(named)
    for row in rows:
        if row.case == case:
            return row
    raise BadInput(f"{folder} has no flight {named}: the column `again` of its rows names them")


def _said(command: Callable[[], int]) -> int:
    """Exit code 3 and a sentence for bad input, as the service's command line has it."""
    try:
        return command()
    except (BadInput, ProcessDied) as error:
        sys.stderr.write(f"{error}\n")
        return 3


def _count(text: str) -> int:
    number = int(text)
    if number < 1:
        raise argparse.ArgumentTypeError(f"{text} is no number of flights: at least 1")
    return number


def _jobs(text: str) -> int:
    return len(os.sched_getaffinity(0)) if text == "all" else _count(text)
