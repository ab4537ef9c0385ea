"""The paper's Tables 4 to 7 as experiments, on reconstructions of its five scenarios.

python -m tools.bench.paper [--write] [--trials 20] [--mode stop|rolling ...]
python -m tools.bench.paper --flights 20 --rows FILE [--write]     over MAVSDK too: a minute each

Flights already in the file of rows are not flown again, so that a run that was stopped goes on.
"""

import argparse
import datetime
import importlib.metadata
import os
from collections.abc import Sequence
from pathlib import Path

from tools import campaign, pages
from tools.bench.paper import report
from tools.bench.paper.compared import compare
from tools.bench.paper.flights import IDEAL, MAVSDK, MODES, SIMULATED, Row, cases, fly
from tools.bench.paper.printed import COMPARED, TRIALS

FOLDER = Path(__file__).parent
PAGE = FOLDER / "README.md"
PICTURE = FOLDER / "scenarios.png"
FRONT = FOLDER.parents[2] / "README.md"
"""Has the short table, which has a meaning only with flights over MAVSDK."""


def main(argv: Sequence[str] | None = None) -> None:
    """Parse, fly, plan, print."""
    options = parsed(argv)
    if options.write:
        pages.must_have("flown", PAGE)
        pages.must_have("compared", PAGE)
        pages.must_have("paper", FRONT)
    modes = options.mode or list(MODES)
    wanted = [*cases((IDEAL, SIMULATED), modes, options.trials)]
    wanted += cases((MAVSDK,), modes, options.flights)
    rows = campaign.flown(wanted, fly, Row, kept=options.rows, jobs=options.jobs, wrong=wrong)
    trials = list(compare([paper.scenario for paper in COMPARED], options.trials))
    flown = f"{measured()}\n\n{report.flown_table(rows)}"
    compared = f"{measured()}\n\n{report.compared_table(trials)}"
    print(f"{flown}\n\n{compared}")
    if options.write:
        pages.renew("flown", flown, PAGE)
        pages.renew("compared", compared, PAGE)
        report.draw(PICTURE, rows, trials)
        if options.flights:
            pages.renew("paper", f"{measured()}\n\n{report.in_short(rows, trials)}", FRONT)


def parsed(argv: Sequence[str] | None) -> argparse.Namespace:
    """The command line."""
    parser = argparse.ArgumentParser(
        prog="python -m tools.bench.paper",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    parser.add_argument("--trials", type=int, default=TRIALS, help="of each, in process")
    parser.add_argument("--flights", type=int, default=0, help="of each, over MAVSDK in real time")
    parser.add_argument("--mode", action="append", choices=MODES, help="both if absent")
    parser.add_argument("--rows", type=Path, help="keep what was flown here, one JSON line each")
    parser.add_argument("--jobs", type=int, default=1, help="flights at once")
    parser.add_argument("--write", action="store_true", help="renew the page and its picture")
    options = parser.parse_args(argv)
    if options.trials < 1 or options.flights < 0:
        parser.error("--trials is at least 1, --flights at least 0")
    return options


def wrong(row: Row) -> str:
    """What was not as it should be; "" if nothing was."""
    return "" if row.ending == report.REACHED else row.ending


def measured() -> str:
    """When and where."""
    version = importlib.metadata.version("autonomy")
    load = os.getloadavg()[0]
    return (
        f"Measured {datetime.datetime.now(tz=datetime.UTC):%Y-%m-%d}, version {version}, "
        f"{os.cpu_count()} cores, load {load:.1f}."
    )


if __name__ == "__main__":
    main()
