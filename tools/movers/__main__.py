"""Fly among movers, print the table, and with --write put it into tools/movers/README.md.

python -m tools.movers [--flights N] [--first ROOM] [--speed M_S ...] [--mode stop|rolling]
                       [--look expected|default|blind] [--rows FILE] [--jobs N]
                       [--write] [--picture ROOM]
"""

import argparse
from pathlib import Path

from tools import campaign, pages
from tools.movers.campaign import Look, Row, cases, fly, table
from tools.movers.picture import draw

README = Path(__file__).with_name("README.md")


def main() -> None:
    """Parse, fly, print."""
    parser = argparse.ArgumentParser(
        prog="python -m tools.movers", description=__doc__, allow_abbrev=False
    )
    parser.add_argument("--flights", type=int, default=200, help="rooms at every speed")
    parser.add_argument("--first", type=int, default=0, help="the first room's number")
    parser.add_argument("--speed", type=float, action="append", help="m/s, may be repeated")
    parser.add_argument("--mode", choices=["stop", "rolling"], default="stop")
    parser.add_argument("--rows", type=Path, help="keep what was flown here, one JSON line each")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--look", type=Look, choices=list(Look), default=Look.EXPECTED)
    parser.add_argument("--write", action="store_true", help="renew the table in the README")
    parser.add_argument("--picture", type=int, metavar="ROOM", help="draw an evasion there instead")
    options = parser.parse_args()
    if options.picture is not None:
        speed_m_s = (options.speed or [0.2])[0]
        draw(options.picture, speed_m_s, README.with_name("evasion.png"))
        return
    if options.write:
        pages.must_have("table", README)
    rows = campaign.flown(
        cases(
            options.speed or [0.1, 0.2, 0.3],
            range(options.first, options.first + options.flights),
            options.mode,
            options.look,
        ),
        fly,
        Row,
        kept=options.rows,
        jobs=options.jobs,
        wrong=lambda row: "moved into a mover" if any(into for into, _ in row.hits) else "",
    )
    print(table(rows))
    if options.write:
        pages.renew("table", table(rows), README)


if __name__ == "__main__":
    main()
