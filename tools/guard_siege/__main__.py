"""`python -m tools.guard_siege --steps 1000000`: the guard under siege, by seed and number.

Exit code 1 when anything was violated. README: hal/vehicle/guard/README.md.
"""

import argparse
import functools
import sys
import time

from tools.guard_siege.driver import run


def main() -> int:
    """Run and tell."""
    parser = argparse.ArgumentParser(prog="python -m tools.guard_siege", description=__doc__)
    parser.add_argument("--steps", type=int, default=20_000, help="ticks of the guard")
    parser.add_argument("--seed", type=int, default=0)
    asked = parser.parse_args()
    began = time.perf_counter()
    tally = run(asked.seed, asked.steps, tell=functools.partial(print, flush=True))
    took_s = time.perf_counter() - began
    print(
        f"{tally.steps} steps in {tally.sieges} sieges, {tally.kills} deaths of the program:"
        f" {len(tally.violations)} violations; {took_s:.0f} s"
    )
    print("limits: " + ", ".join(f"{name} {count}" for name, count in tally.limits.most_common()))
    return int(bool(tally.violations))


if __name__ == "__main__":
    sys.exit(main())
