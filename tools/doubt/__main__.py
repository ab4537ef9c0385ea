"""python -m tools.doubt: fly, count, and write the tables of the doubt's README."""

import argparse
import functools
import itertools
import sys
from collections.abc import Sequence
from pathlib import Path

from tools import campaign, pages
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
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--no-doubt", action="store_true", help="doubt silent beams only")
    parser.add_argument("--write", action="store_true", help=f"into {README.name}")
    asked = parser.parse_args(argv)
    if asked.write:
        pages.must_have("tables", README)
    rows = campaign.flown(
        itertools.chain(healthy(asked.seeds), faulty(asked.flights, asked.seed)),
        functools.partial(fly, doubting=not asked.no_doubt),
        Row,
        kept=asked.rows,
        jobs=asked.jobs,
        wrong=lambda row: "touched something" if row.collided else "",
    )
    found = tables(rows)
    if asked.write:
        pages.renew("tables", found, README)
    else:
        sys.stdout.write(found + "\n")
    return 1 if any(row.collided for row in rows) else 0


if __name__ == "__main__":
    sys.exit(main())
