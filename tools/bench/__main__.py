"""The benchmarks, one command each: `python -m tools.bench COMMAND --help`. See README.md.

fly        a campaign in closed loop: planners x worlds x seeds x sensors x response
report     tables, plots and the worst flights of a campaign, beside an earlier one
show       one flight of a campaign again, with a picture
flights    the shipped scenarios, by T3DRM
planners   planners on known maps
ticks      what a tick costs
service    what the service costs
wide       BARN with thin and with wide beams
all        flights, ticks and planners (`make bench`)
"""

import argparse
import importlib
import sys
from collections.abc import Callable, Sequence

from hal.sim.scenario import shipped_scenarios
from tools import pages

_OWN = ("flights", "planners", "ticks", "service", "wide")


def everything(arguments: Sequence[str]) -> int:
    """Fly, time ticks, plan; print, and with --write renew the page."""
    from tools.bench import flights, planners, report, ticks

    parser = argparse.ArgumentParser(
        prog="python -m tools.bench all", description=everything.__doc__, allow_abbrev=False
    )
    planners.add_arguments(parser)
    parser.add_argument("--seeds", type=int, default=20, help="flights of every scenario")
    parser.add_argument("--jobs", type=int, default=2, help="processes that fly")
    options = parser.parse_args(arguments)
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
    return 0


def main(arguments: Sequence[str] | None = None) -> int:
    """Hand over to the command that is named; returns the exit code."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    name, rest = (given[0], given[1:]) if given else ("", [])
    if name in ("-h", "--help"):
        print(__doc__)
        return 0
    if name in _OWN:
        run: Callable[[Sequence[str]], int | None] = importlib.import_module(
            f"tools.bench.{name}"
        ).main
        return run(rest) or 0
    if name == "all":
        return everything(rest)
    if name in ("fly", "report", "show"):
        from tools.bench.campaign import commands

        return {"fly": commands.fly, "report": commands.report_on, "show": commands.show}[name](
            rest
        )
    told = f"{name!r} is no command of tools.bench" if name else "which command?"
    print(f"{told}\n{__doc__}", file=sys.stderr)
    return 2


if __name__ == "__main__":
    sys.exit(main())
