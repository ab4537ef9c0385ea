"""How long a vehicle still moves when its computer fails: every fault in every state.

python -m tools.standstill [--fault NAME] [--state NAME] [--at-once N] [--write]
"""

import argparse
import datetime
import math
import os
import platform
import sys
import tempfile
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from autonomy.errors import ExitCode
from tools import pages
from tools.standstill.faults import FAULTS, Duty, Fault
from tools.standstill.measure import STATES, Measured, measure

README = Path(__file__).with_name("README.md")
LIVING_S = 0.5
"""Where the program lives, it has to stop the vehicle within this."""
GONE_S = 1.12 + 0.2
"""Where it does not, PX4 does: COM_OF_LOSS_T as measured, and 0.2 s."""
LEASHED_M = 0.3
"""How far PX4 flies past the place of a setpoint that is repeated for ever, from 0.2 m/s."""
GOT_ON_M = 0.3
"""So far it has to get on in the last seconds; a vehicle that holds drifts less."""
ABORTED = int(ExitCode.ABORTED)
_OURS = ("cruise", "detect", "hold")
"""States in which this program's setpoints fly the vehicle; in the others PX4 does."""


def main(arguments: list[str] | None = None) -> int:
    """Parse, fly, print; the exit code is 1 when a vehicle was harmed or stopped too late."""
    parser = argparse.ArgumentParser(
        prog="python -m tools.standstill",
        description=__doc__,
        allow_abbrev=False,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--fault", action="append", choices=[fault.name for fault in FAULTS])
    parser.add_argument("--state", action="append", choices=list(STATES))
    parser.add_argument("--at-once", type=int, default=3, help="flights beside one another")
    parser.add_argument("--write", action="store_true", help="renew tools/standstill/README.md")
    options = parser.parse_args(arguments)
    if options.write:
        pages.must_have("standstill", README)
    faults = [f for f in FAULTS if not options.fault or f.name in options.fault]
    rows = campaign(faults, options.state or list(STATES), options.at_once)
    text = section(rows)
    print(text)
    if options.write:
        pages.renew("standstill", text, README)
    return int(any(row.harmed or not bound_kept(row) for row in rows))


def campaign(faults: Sequence[Fault], states: Sequence[str], at_once: int) -> list[Measured]:
    """Every fault in every state; what starves the machine flies alone."""
    rows: list[Measured] = []
    with tempfile.TemporaryDirectory(prefix="standstill-") as folder:
        for together in (True, False):
            cases = [(f, s) for f in faults if (f.name not in _ALONE) is together for s in states]
            with ThreadPoolExecutor(at_once if together else 1) as pool:
                futures = [
                    pool.submit(measure, fault, state, Path(folder) / f"{together}{number}")
                    for number, (fault, state) in enumerate(cases)
                ]
                for future in futures:
                    rows.append(future.result())
                    print(f"{len(rows)}: {_told(rows[-1])}", file=sys.stderr, flush=True)
    return rows


_ALONE = ("two busy neighbours per core",)


def section(rows: Sequence[Measured]) -> str:
    """Markdown: a line for each fault, a column for each state."""
    when = datetime.datetime.now(tz=datetime.UTC).date().isoformat()
    states = list(dict.fromkeys(row.state for row in rows))
    lines = [
        f"Measured {when} on {platform.machine()}, {os.cpu_count()} cores, {len(rows)} flights.",
        "",
        f"| fault | {' | '.join(states)} |",
        f"|---|{'---|' * len(states)}",
    ]
    for name in dict.fromkeys(row.fault for row in rows):
        mine = {row.state: row for row in rows if row.fault == name}
        cells = [cell(mine[state]) if state in mine else "" for state in states]
        lines.append(f"| {name} | {' | '.join(cells)} |")
    harmed = [row for row in rows if row.harmed]
    clearance_m = min((row.clearance_m for row in rows), default=math.inf)
    lines += ["", f"Harmed: {len(harmed)}. Least true clearance: {clearance_m:.2f} m."]
    lines += [f"- {row.fault}, {row.state}: {row.harmed}" for row in harmed]
    late = [row for row in rows if not bound_kept(row)]
    lines += ["", f"Later than the bound: {len(late)} of {len(rows)}."]
    lines += [f"- {row.fault}, {row.state}: {cell(row)}" for row in late]
    return "\n".join(lines)


def bound_kept(row: Measured) -> bool:
    """True when what had to happen did, in time (README.md), or PX4 was flying by itself."""
    duty = _duty(row.fault)
    if row.state not in _OURS:
        return True
    if duty is Duty.FLY_ON:
        return went_on(row)
    if duty is Duty.LEASH:
        return row.moved_m <= LEASHED_M
    return row.stopped_s <= (LIVING_S if duty is Duty.STOP else GONE_S)


def went_on(row: Measured) -> bool:
    """True when the program ended well, or its vehicle was still getting on at the end."""
    if row.exit_code is None:
        return row.later_m >= GOT_ON_M
    return row.exit_code in (0, ABORTED)


def _duty(fault: str) -> Duty:
    return next(known.duty for known in FAULTS if known.name == fault)


def cell(row: Measured) -> str:
    """Seconds until zero velocity was asked for, until it stood, metres meanwhile; the end."""
    if _duty(row.fault) is Duty.FLY_ON and (row.state not in _OURS or went_on(row)):
        return "flew on"
    asked = "-" if math.isnan(row.stopped_s) else f"{row.stopped_s:.2f}"
    stood = "-" if math.isnan(row.standing_s) else f"{row.standing_s:.2f}"
    code = "" if row.exit_code is None else f", exit {row.exit_code}"
    return f"{asked} / {stood} s, {row.moved_m:.2f} m: {row.end}{code}"


def _told(row: Measured) -> str:
    return f"{row.fault} in {row.state} at {row.speed_m_s:.2f} m/s: {cell(row)} {row.harmed}"


if __name__ == "__main__":
    sys.exit(main())
