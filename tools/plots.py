"""Draws every shipped scenario beside its YAML file: `python -m tools.plots scenarios`."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from autonomy.pictures import save_scenario
from hal.sim.scenario import load_scenario, shipped_scenarios


def main(arguments: Sequence[str] | None = None) -> int:
    """The command line; returns the exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m tools.plots",
        description=__doc__,
    )
    parser.add_argument("what", choices=["scenarios"])
    parser.add_argument(
        "--into",
        type=Path,
        default=Path(__file__).parents[1] / "configs" / "scenarios",
        help="folder for the pictures (default: beside the scenarios)",
    )
    options = parser.parse_args(arguments)
    for name in shipped_scenarios():
        path = options.into / f"{name}.png"
        save_scenario(load_scenario(name), path)
        sys.stdout.write(f"{path} ({path.stat().st_size // 1000} kB)\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
