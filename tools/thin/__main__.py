"""python -m tools.thin: fly at ever thinner obstacles; tell which are touched, or write it."""

import argparse
import itertools
import statistics
import sys
from collections.abc import Sequence
from pathlib import Path

import autonomy.perception
from tools import campaign, pages
from tools.thin.flights import HALF_ANGLES_DEG, THICKNESSES_M, Case, Flight, cases, fly, otherwise
from tools.thin.report import REACHED, section

README = Path(autonomy.perception.__path__[0]) / "README.md"
_THICKEST_M = 0.2


def main(argv: Sequence[str] | None = None) -> int:
    """Fly the cases that `--rows` does not have yet; print the tables, or write them."""
    parser = argparse.ArgumentParser(
        prog="python -m tools.thin", description=__doc__, allow_abbrev=False
    )
    parser.add_argument("--flights", type=int, default=120, help="of each line of the tables")
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--thickness", type=_centimetres, action="append", help="default: 0.8 to 6")
    parser.add_argument(
        "--half-angle", type=float, action="append", help="of the beams, deg; default: 0 and 12.5"
    )
    parser.add_argument("--rows", type=Path, help="keep what was flown here, one JSON line each")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--write", action="store_true", help="into autonomy/perception/README.md")
    asked = parser.parse_args(argv)
    if asked.flights < 1:
        parser.error(f"--flights {asked.flights}: fly at least one of each")
    if asked.write:
        pages.must_have("thin", README)
    flights = campaign.flown(
        _asked_for(asked), fly, Flight, kept=asked.rows, jobs=asked.jobs, wrong=_wrong
    )
    found = section(flights)
    if asked.write:
        pages.renew("thin", found, README)
    else:
        sys.stdout.write(found + "\n")
    mean_s = statistics.mean(flight.wall_s for flight in flights)
    sys.stderr.write(f"{len(flights)} flights, {mean_s:.2f} s of this computer each\n")
    return 0


def _centimetres(text: str) -> float:
    """A thickness in m; the courses have room for 20 cm."""
    thickness_m = round(float(text) / 100.0, 6)
    if not 0.0 < thickness_m <= _THICKEST_M:
        raise argparse.ArgumentTypeError(f"{text} cm: give more than 0, and at most 20")
    return thickness_m


def _asked_for(asked: argparse.Namespace) -> list[Case]:
    """Other rates and speeds are flown when no thickness and no beam was named."""
    seeds = range(asked.first_seed, asked.first_seed + asked.flights)
    wanted = cases(asked.thickness or THICKNESSES_M, asked.half_angle or HALF_ANGLES_DEG, seeds)
    if asked.thickness or asked.half_angle:
        return list(wanted)
    return list(itertools.chain(wanted, otherwise(seeds)))


def _wrong(flight: Flight) -> str:
    """A touch is what is counted here; not arriving is wrong."""
    return "" if flight.ending == REACHED else flight.ending


if __name__ == "__main__":
    sys.exit(main())
