"""python -m tools.drift: fly with a drifting estimate, with known walls and without; tell it."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import msgspec

from autonomy.warm import warm_up
from tools.drift import flights, report
from tools.pages import renew


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
    parser.add_argument("--write", action="store_true", help="table and picture into the README")
    asked = parser.parse_args(argv)
    warm_up()
    rows = _rows(asked.rows)
    known = {row.case for row in rows}
    for case in flights.cases(
        asked.room or flights.ROOMS,
        asked.drift or ("px4",),
        asked.mode or flights.MODES,
        asked.flights,
        asked.first_seed,
    ):
        wanted = asked.only is None or case.fixed == (asked.only == "with")
        if wanted and case not in known:
            rows.append(flights.fly(case))
            _keep(asked.rows, rows[-1])
    found = report.table(rows)
    sys.stdout.write(found + "\n")
    if asked.write:
        report.draw(report.PICTURED, report.README.with_name(report.PICTURE))
        picture = f"![Position error, with known walls and without]({report.PICTURE})"
        renew("drift", f"{found}\n\n{picture}", report.README)
    return 0


def _keep(path: Path | None, row: flights.Row) -> None:
    if row.collided:
        sys.stderr.write(f"touched: {row.case}: {row.touch}\n")
    if path is not None:
        with path.open("ab") as file:
            file.write(msgspec.json.encode(row) + b"\n")


def _rows(path: Path | None) -> list[flights.Row]:
    """What was flown before."""
    if path is None or not path.exists():
        return []
    return [msgspec.json.decode(line, type=flights.Row) for line in path.read_bytes().splitlines()]


if __name__ == "__main__":
    sys.exit(main())
