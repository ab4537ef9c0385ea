"""python -m tools.drift: fly with a drifting estimate, with known walls and without; tell it."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from tools import campaign
from tools.drift import flights, report
from tools.pages import must_have, renew


def main(argv: Sequence[str] | None = None) -> int:
    """Fly the cases that `--rows` does not have yet; print the table, or write it."""
    parser = argparse.ArgumentParser(
        prog="python -m tools.drift", description=__doc__, allow_abbrev=False
    )
    rooms = ", ".join(flights.ROOMS)
    parser.add_argument("--room", action="append", help=f"default: {rooms}")
    parser.add_argument(
        "--drift", action="append", choices=tuple(flights.LEVELS), help="default: px4"
    )
    parser.add_argument("--mode", action="append", choices=flights.MODES, help="default: both")
    parser.add_argument("--flights", type=int, default=10, help="of each room, level and mode")
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--only", choices=("with", "without"), help="fly one side alone")
    parser.add_argument("--rows", type=Path, help="keep what was flown here, one JSON line each")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--write", action="store_true", help="table and picture into the README")
    asked = parser.parse_args(argv)
    if asked.write:
        must_have("drift", report.README)
    asked_for = flights.cases(
        asked.room or flights.ROOMS,
        asked.drift or ("px4",),
        asked.mode or flights.MODES,
        asked.flights,
        asked.first_seed,
    )
    rows = campaign.flown(
        [c for c in asked_for if asked.only is None or c.fixed == (asked.only == "with")],
        flights.fly,
        flights.Row,
        kept=asked.rows,
        jobs=asked.jobs,
        wrong=lambda row: f"touched, {row.touch}" if row.collided else "",
    )
    found = report.table(rows)
    sys.stdout.write(found + "\n")
    if asked.write:
        report.draw(report.PICTURED, report.README.with_name(report.PICTURE))
        picture = f"![Position error, with known walls and without]({report.PICTURE})"
        renew("drift", f"{found}\n\n{picture}", report.README)
    return 0


if __name__ == "__main__":
    sys.exit(main())
