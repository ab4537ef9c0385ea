"""Many flights: those that were flown are kept as they come, those that are missing are flown.

A campaign has cases, a function that flies one, a keeper of its rows, and hands that fly: this
process, several of this computer, or others'.
"""

import multiprocessing
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Generator, Hashable, Iterable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import closing
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, Protocol, TypeVar

import msgspec

from autonomy.warm import warm_up

_TOLD_EVERY_S = 20.0


class Row(Protocol):
    """What came of one case; a msgspec Struct."""

    @property
    def case(self) -> Any:
        """What was flown: hashable, a msgspec Struct."""


C = TypeVar("C", bound=Hashable)
R = TypeVar("R", bound=Row)

Wrong = Callable[[R], str]


class Keeper(Protocol[R]):
    """Where rows are kept."""

    def kept(self) -> Iterable[R]:
        """Every row that was flown before."""

    def keep(self, row: R) -> None:
        """From now on `row` is safe."""


class Hands(Protocol):
    """Whoever flies."""

    def __call__(self, missing: Sequence[C], fly: Callable[[C], R]) -> Generator[R, None, None]:
        """A row for each case, as they come; closing the generator ends what flies."""


class ProcessDied(Exception):
    """One sentence: a process that flew is gone, and what to do."""


def flown(
    cases: Iterable[C],
    fly: Callable[[C], R],
    row_type: type[R],
    *,
    kept: Path | None = None,
    jobs: int = 1,
    wrong: Wrong[R] | None = None,
) -> list[R]:
    """A row for each of `cases`, in their order, whoever flew first.

    Rows in the file `kept` (one JSON line each, as encoded by msgspec) are not flown again, and
    every new one is added there as soon as it is there: a campaign that was stopped goes on, and
    a torn last line is flown again. `fly` travels to `jobs` processes, so it has to be a function
    of a module. Progress, and what `wrong` says of a row, go to the standard error output.
    Raises ValueError, naming file and line, for a file that holds something else.
    """
    return finished(cases, fly, Lines(kept, row_type), processes(jobs), wrong=wrong)


def finished(
    cases: Iterable[C],
    fly: Callable[[C], R],
    keeper: Keeper[R],
    hands: Hands,
    *,
    wrong: Wrong[R] | None = None,
) -> list[R]:
    """As `flown`, with rows kept anywhere and flown by anybody."""
    wanted = list(dict.fromkeys(cases))
    rows = {row.case: row for row in keeper.kept()}
    missing = [case for case in wanted if case not in rows]
    if 0 < len(missing) < len(wanted):
        _tell(f"{len(wanted) - len(missing)} of {len(wanted)} were flown before")
    began_s = told_s = time.monotonic()
    # Closed by name: whoever flies is to be ended before the exception is told.
    with closing(hands(missing, fly)) as coming:
        for done, row in enumerate(coming, start=1):
            rows[row.case] = row
            keeper.keep(row)
            if wrong is not None and (said := wrong(row)):
                _tell(f"{said}: {row.case}")
            now_s = time.monotonic()
            if now_s - told_s >= _TOLD_EVERY_S:
                left_s = (now_s - began_s) / done * (len(missing) - done)
                _tell(f"{done} of {len(missing)} flown, {duration(left_s)} left")
                told_s = now_s
    return [rows[case] for case in wanted]


def duration(seconds: float) -> str:
    """As people say it: `40 s`, `12 min`, `3 h 20 min`."""
    minutes = round(seconds / 60.0)
    if seconds < 90.0:
        return f"{seconds:.0f} s"
    return f"{minutes} min" if minutes < 90 else f"{minutes // 60} h {minutes % 60} min"


def processes(jobs: int) -> Hands:
    """`jobs` processes of this computer; with one job it is this very process."""

    def fly_all(missing: Sequence[C], fly: Callable[[C], R]) -> Generator[R, None, None]:
        if missing:
            yield from _here(missing, fly) if jobs == 1 else _beside(missing, fly, jobs)

    return fly_all


def _here(missing: Sequence[C], fly: Callable[[C], R]) -> Generator[R, None, None]:
    warm_up()
    yield from map(fly, missing)


def _beside(missing: Sequence[C], fly: Callable[[C], R], jobs: int) -> Generator[R, None, None]:
    """On processes that hang on a leash: it ends with this process, however that ends."""
    theirs, ours = multiprocessing.Pipe(duplex=False)
    jobs = min(jobs, len(missing))
    pool = ProcessPoolExecutor(jobs, initializer=_on_the_leash, initargs=(theirs, ours))
    try:
        futures = [pool.submit(fly, case) for case in missing]
        theirs.close()
        yield from (future.result() for future in as_completed(futures))
        pool.shutdown()
    except BrokenProcessPool:
        raise ProcessDied(
            "a process that flew died (killed? no memory left?); what was flown is kept: begin "
            "again to go on, with fewer jobs where memory was short"
        ) from None
    finally:
        ours.close()  # who still flies ends here
        pool.shutdown(wait=True, cancel_futures=True)


def _on_the_leash(theirs: Connection, ours: Connection) -> None:
    """In a new process: ready to fly, and gone when nobody holds the other end any more.

    Without, processes whose parent was killed would wait for work for ever.
    """
    ours.close()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the parent, which lets go
    threading.Thread(target=_end_with, args=(theirs,), daemon=True).start()
    warm_up()


def _end_with(theirs: Connection) -> None:
    try:
        theirs.recv_bytes()
    except EOFError:
        os._exit(1)


def _tell(line: str) -> None:
    sys.stderr.write(line + "\n")
    sys.stderr.flush()


class Lines(Keeper[R]):
    """Rows in a file, a JSON line each; without a path they are not kept."""

    def __init__(self, path: Path | None, row_type: type[R]) -> None:
        self._path = path
        self._row_type = row_type

    def keep(self, row: R) -> None:
        """Add a line, and have it on the disk."""
        if self._path is not None:
            with self._path.open("ab") as file:
                file.write(msgspec.json.encode(row) + b"\n")
                file.flush()
                os.fsync(file.fileno())

    def kept(self) -> list[R]:
        """Every row; a torn last line is taken off. ValueError names what is no row."""
        if self._path is None or not self._path.exists():
            return []
        *lines, torn = self._path.read_bytes().split(b"\n")
        if torn:
            with self._path.open("r+b") as file:
                file.truncate(sum(len(line) + 1 for line in lines))
        return [self._decoded(line, number) for number, line in enumerate(lines, start=1)]

    def _decoded(self, line: bytes, number: int) -> R:
        try:
            return msgspec.json.decode(line, type=self._row_type)
        except msgspec.DecodeError as error:
            raise ValueError(
                f"{self._path}, line {number} is no row of this campaign ({error}); "
                "name another file"
            ) from error
