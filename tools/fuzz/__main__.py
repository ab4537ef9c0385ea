"""`python -m tools.fuzz [--minutes N] [--target NAME ...]`: hostile input, from every door.

Every case follows from --seed and its number. A finding is made small, saved in --save (the tests
replay what is in tests/golden/fuzz) and ends with exit code 1.
"""

import argparse
import hashlib
import signal
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from tools.fuzz.api import API
from tools.fuzz.cases import Tally, Target, shrunk
from tools.fuzz.documents import YAML
from tools.fuzz.gnss import NMEA, UBX
from tools.fuzz.i2c import I2C
from tools.fuzz.wire import MAVLINK, WIRE

TARGETS = {each.name: each for each in (WIRE, MAVLINK, NMEA, UBX, I2C, YAML, API)}
SAVED = Path("tests/golden/fuzz")
LONGEST_S = 60
"""A case that takes longer is a finding: somebody waits for it."""
_FINDINGS = 5
"""Of one target; after that it is left."""


@dataclass
class Result:
    """What became of one target."""

    target: str
    cases: int = 0
    bytes_in: int = 0
    seconds: float = 0.0
    tally: Tally = field(default_factory=Tally)
    findings: list[tuple[str, bytes]] = field(default_factory=list)


@contextmanager
def _at_most(seconds: int) -> Iterator[None]:
    """Raises TimeoutError inside after that long."""

    def late(*_: object) -> None:
        raise TimeoutError(f"it took more than {seconds} s")

    before = signal.signal(signal.SIGALRM, late)
    signal.alarm(seconds)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def problem(target: Target, case: bytes, tally: Tally | None = None) -> str | None:
    """What is wrong with how `case` is met, in words; None when all is well."""
    try:
        with _at_most(LONGEST_S):
            found = target.run(case)
    except Exception as error:  # noqa: BLE001 - whatever is raised is the finding
        return f"{type(error).__name__}: {error}"
    if tally is not None:
        tally.update(found)
    return None


def fuzz(target: Target, seed: int, seconds: float, most: int | None = None) -> Result:
    """Cases until the time is over, or `most` of them."""
    result = Result(target.name)
    began_s = time.monotonic()
    while time.monotonic() - began_s < seconds and result.cases != most:
        case = target.make(np.random.default_rng([seed, result.cases]))
        result.cases += 1
        result.bytes_in += len(case)
        said = problem(target, case, result.tally)
        if said is not None:
            small = shrunk(case, target, lambda each: problem(target, each) is not None)
            result.findings.append((said, small))
            if len(result.findings) == _FINDINGS:
                break
    result.seconds = time.monotonic() - began_s
    return result


def table(results: list[Result]) -> str:
    """The results in Markdown."""
    rows = ["| target | cases | bytes | findings | what became of it |", "|---|---|---|---|---|"]
    for r in results:
        became = ", ".join(f"{reason} {n:,}" for reason, n in r.tally.most_common() if n)
        rows.append(f"| {r.target} | {r.cases:,} | {r.bytes_in:,} | {len(r.findings)} | {became} |")
    return "\n".join(rows)


def main(arguments: list[str] | None = None) -> int:
    """Fuzz the named targets, or all, each for its part of the time."""
    parser = argparse.ArgumentParser(prog="python -m tools.fuzz", description=__doc__)
    parser.add_argument("--minutes", type=float, default=10.0, help="for all targets together")
    parser.add_argument("--target", action="append", choices=TARGETS, help="all without")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--cases", type=int, help="at most so many of each target")
    parser.add_argument("--save", type=Path, default=SAVED, help="folder for findings")
    asked = parser.parse_args(arguments)
    names = asked.target or list(TARGETS)
    results = []
    for name in names:
        target = TARGETS[name]
        result = fuzz(target, asked.seed, 60.0 * asked.minutes / len(names), asked.cases)
        results.append(result)
        told = f"{name}: {result.cases} cases in {result.seconds:.0f} s"
        print(f"{told}, {len(result.findings)} findings", file=sys.stderr, flush=True)
        for said, case in result.findings:
            asked.save.mkdir(parents=True, exist_ok=True)
            path = asked.save / f"{name}-{hashlib.sha256(case).hexdigest()[:8]}.case"
            path.write_bytes(case)
            print(f"{path}: {said[:300]}", file=sys.stderr)
    print(table(results))
    return int(any(result.findings for result in results))


if __name__ == "__main__":
    sys.exit(main())
