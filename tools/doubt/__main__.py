"""python -m tools.doubt: fly, count, and write the tables of the doubt's README."""

import argparse
import itertools
import sys
from collections.abc import Sequence
from pathlib import Path

import msgspec

from autonomy.warm import warm_up
from tools import pages
from tools.doubt.flights import Row, faulty, fly, healthy
from tools.doubt.report import tables

README = Path(__file__).parents[2] / "autonomy" / "perception" / "doubt" / "README.md"


def main(argv: Sequence[str] | None = None) -> int:
    """Fly the cases that `--rows` does not have yet; print the tables, or write them."""
    parser = argparse.ArgumentParser(prog="python -m tools.doubt", description=__doc__)
    parser.add_argument("--flights", type=int, default=500, help="flights with a fault")
    parser.add_argument("--seeds", type=int, default=3, help="seeds of the flights without one")
    parser.add_argument("--seed", type=int, default=0, help="which flights with a fault")
    parser.add_argument("--rows", type=Path, help="keep what was flown here, one JSON line each")
    parser.add_argument("--no-doubt", action="store_true", help="doubt silent beams only")
    parser.add_argument("--write", action="store_true", help=f"into {README.name}")
    asked = parser.parse_args(argv)
    warm_up()
    rows = _rows(asked.rows)
    known = {row.case for row in rows}
    for case in itertools.chain(healthy(asked.seeds), faulty(asked.flights, asked.seed)):
        if case in known:
            continue
        row = fly(case, doubting=not asked.no_doubt)
        rows.append(row)
        if asked.rows is not None:
            with asked.rows.open("ab") as file:
                file.write(msgspec.json.encode(row) + b"\n")
        if row.collided:
            sys.stderr.write(f"touched something: {case.room} {case.mode} {case.fault}\n")
    found = tables(rows)
    if asked.write:
        pages.renew("tables", found, README)
    else:
        sys.stdout.write(found + "\n")
    return 1 if any(row.collided for row in rows) else 0


def _rows(path: Path | None) -> list[Row]:
    """What was flown before."""
    if path is None or not path.exists():
        return []
    return [msgspec.json.decode(line, type=Row) for line in path.read_bytes().splitlines()]


if __name__ == "__main__":
    sys.exit(main())
