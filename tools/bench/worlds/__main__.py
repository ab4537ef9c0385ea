"""The generated worlds: their picture, or what is known of some of them.

python -m tools.bench.worlds --picture tools/bench/worlds.png
python -m tools.bench.worlds discs:17 u-trap:3 plan:hall.png [--barn FOLDER]
python -m tools.bench.worlds discs:17 --sdf discs.sdf          for Gazebo
"""

import argparse
from collections.abc import Sequence
from pathlib import Path

from hal.errors import DocumentError
from tools.bench.worlds import World, contact_sheet, sdf, world


def main(argv: Sequence[str] | None = None) -> None:
    """Parse, measure, print."""
    parser = argparse.ArgumentParser(
        prog="python -m tools.bench.worlds",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    parser.add_argument("names", nargs="*", metavar="NAME", help="such as discs:17")
    parser.add_argument("--picture", type=Path, help="draw all families into this PNG")
    parser.add_argument("--sdf", type=Path, help="write the world named into this file")
    parser.add_argument("--barn", type=Path, help="folder with worlds.json")
    options = parser.parse_args(argv)
    if not options.names and options.picture is None:
        parser.error("name a world, such as discs:17, or --picture FILE")
    if options.sdf is not None and len(options.names) != 1:
        parser.error("--sdf writes one world: name one")
    try:
        found = [world(name, barn=options.barn) for name in options.names]
    except DocumentError as error:
        parser.error(str(error))
    if options.sdf is not None:
        sdf.write(found[0].scenario, options.sdf)
    for name, shown in zip(options.names, found, strict=True):
        print(f"{name}: {described(shown)}")
    if options.picture is not None:
        contact_sheet.draw(options.picture)


def described(shown: World) -> str:
    """A world in one line."""
    hard, told = shown.difficulty, shown.truth
    way = (
        f"{told.optimum_m:.2f} m, {hard.detour:.2f} times the straight line, "
        f"{hard.turns} turns ({hard.turning_deg:.0f} deg)"
        if told.optimum_m is not None
        else "no way"
    )
    title = f"{shown.scenario.title}; " if shown.scenario.title else ""
    return (
        f"{title}{way}; widest passage 2 x {hard.passage_m:.3f} m, "
        f"{100.0 * hard.density:.0f} % of the floor barred"
    )


if __name__ == "__main__":
    main()
