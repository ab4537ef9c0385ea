"""The service's hand for what takes seconds: `python -m autonomy.review.worker reel|report LOG`.

Writes gzip to standard output, and how much of the log is read to standard error. Stands back from
whatever flies on this computer: least priority, and the first to go where memory is short.
"""

import contextlib
import gzip
import os
import sys
from pathlib import Path

import msgspec

from autonomy.errors import AutonomyError
from autonomy.logbook import report_of_log
from autonomy.review.history import history_of
from autonomy.review.page import page_of
from autonomy.review.reel import reel_of
from hal.errors import HalError

_NICE = 10
"""Where it goes, if it is not there yet; the service itself is at -5 on a drone."""


def reel(log: Path) -> bytes:
    """The flight for the page, as JSON."""
    return msgspec.json.encode(reel_of(log, Teller().tell))


def report(log: Path) -> bytes:
    """The flight's page, as HTML."""
    return page_of(history_of(log, Teller().tell), report_of_log(log)).encode()


class Teller:
    """Says on standard error how much of a log is read, at every hundredth: `share 0.42`."""

    def __init__(self) -> None:
        self._told = -1

    def tell(self, share: float) -> None:
        """`share` is read, from 0 to 1."""
        hundredths = int(100.0 * share)
        if hundredths != self._told:
            self._told = hundredths
            print(f"share {hundredths / 100.0:.2f}", file=sys.stderr, flush=True)


MADE = {"reel": reel, "report": report}


def stand_back() -> None:
    """Let everything else on this computer go first."""
    os.nice(max(0, _NICE - os.nice(0)))
    with contextlib.suppress(OSError):  # where the kernel does not let us: only a wish
        Path("/proc/self/oom_score_adj").write_text("1000", encoding="ascii")


def main(arguments: list[str]) -> int:
    """Entry point; returns the exit code."""
    if len(arguments) != 2 or arguments[0] not in MADE:
        print("usage: python -m autonomy.review.worker reel|report LOG", file=sys.stderr)
        return 2
    stand_back()
    try:
        made = MADE[arguments[0]](Path(arguments[1]))
    except (AutonomyError, HalError) as error:
        print(error, file=sys.stderr)
        return 1
    sys.stdout.buffer.write(gzip.compress(made, 6))
    return 0


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
