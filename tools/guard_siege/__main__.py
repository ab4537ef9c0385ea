"""`python -m tools.guard_siege --steps 1000000`: the guard under siege, by seed and number.

Exit code 1 when anything was violated. README: hal/vehicle/guard/README.md.
"""

import argparse
import functools
import math
import sys
import time

from autonomy.config import Config
from tools.guard_siege.driver import run
from tools.guard_siege.killed import deaths_in_room


def main() -> int:
    """Run and tell."""
    parser = argparse.ArgumentParser(prog="python -m tools.guard_siege", description=__doc__)
    parser.add_argument("--steps", type=int, default=20_000, help="ticks of the guard")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--rooms", type=int, help="kill flights through so many rooms instead")
    asked = parser.parse_args()
    if asked.rooms is not None:
        return _kill_in_rooms(asked.rooms, asked.seed)
    began = time.perf_counter()
    tally = run(asked.seed, asked.steps, tell=functools.partial(print, flush=True))
    took_s = time.perf_counter() - began
    print(f"{tally.sentence()}; {took_s:.0f} s")
    print("limits: " + ", ".join(f"{name} {count}" for name, count in tally.limits.most_common()))
    return int(bool(tally.violations))


def _kill_in_rooms(rooms: int, seed: int) -> int:
    """Every flight dies again and again; 1 when a body touched anything."""
    body_m = Config().body.radius_m
    touched, deaths, least_m, longest_s = 0, 0, math.inf, 0.0
    for number in range(rooms):
        for mode in ("stop", "rolling"):
            found = deaths_in_room(number, seed, mode=mode)
            worst = min((death.clearance_m for death in found), default=math.inf)
            longest_s = max(longest_s, *(d.travelled_m / d.speed_m_s for d in found), 0.0)
            deaths += len(found)
            least_m = min(least_m, worst)
            touched += sum(death.clearance_m < body_m for death in found)
            print(f"room {number} {mode}: {len(found)} deaths, nearest {worst:.3f} m", flush=True)
    print(
        f"{deaths} deaths in {rooms} rooms: {touched} touched; least clearance {least_m:.3f} m from"
        f" the centre, body {body_m:g} m; travelled at most {longest_s:.2f} s of the speed"
    )
    return int(touched > 0)


if __name__ == "__main__":
    sys.exit(main())
