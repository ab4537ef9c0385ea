"""`make bench`: flights in process, ticks, planners on known maps. See tools/bench/README.md."""

import argparse

from hal.sim.scenario import shipped_scenarios
from tools import pages
from tools.bench import flights, planners, report, ticks


def main() -> None:
    """Parse, fly, plan, print; with --write the page is renewed as well."""
    parser = argparse.ArgumentParser(
        prog="python -m tools.bench", description=__doc__, allow_abbrev=False
    )
    planners.add_arguments(parser)
    parser.add_argument("--seeds", type=int, default=20, help="flights of every scenario")
    parser.add_argument("--jobs", type=int, default=2, help="processes that fly")
    options = parser.parse_args()
    if options.write:
        for place in ("flights", "ticks", "planners"):
            pages.must_have(place, report.README)
    names = list(shipped_scenarios())
    section = report.flight_section(
        flights.campaign(names, range(options.seeds), "stop", options.jobs)
    )
    print(section)
    tick = ticks.section(["default", "u_trap", ticks.ROOM], 0.0, passes=3)
    print(tick)
    if options.write:
        report.renew("flights", section)
        report.renew("ticks", tick)
    planners.run(options)


if __name__ == "__main__":
    main()
