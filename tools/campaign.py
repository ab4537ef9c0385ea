"""Many flights: those that were flown are kept line by line, those that are missing are flown."""

import sys
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
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


C = TypeVar("C")
R = TypeVar("R", bound=Row)


def flown(
    cases: Iterable[C],
    fly: Callable[[C], R],
    row_type: type[R],
    *,
    kept: Path | None = None,
    jobs: int = 1,
    wrong: Callable[[R], str] | None = None,
) -> list[R]:
    """A row for each of `cases`, in their order, whoever flew first.

    Rows in the file `kept` (one JSON line each, as encoded by msgspec) are not flown again, and
    every new one is added there as soon as it is there: a campaign that was stopped goes on, and
    a torn last line is flown again. `fly` travels to `jobs` processes, so it has to be a function
    of a module. Progress, and what `wrong` says of a row, go to the standard error output.
    Raises ValueError, naming file and line, for a file that holds something else.
    """
    wanted = list(dict.fromkeys(cases))
    rows = {row.case: row for row in _kept(kept, row_type)}
    missing = [case for case in wanted if case not in rows]
    began_s = told_s = time.monotonic()
    for done, row in enumerate(_fly(missing, fly, jobs), start=1):
        rows[row.case] = row
        _keep(kept, row)
        if wrong is not None and (said := wrong(row)):
            _tell(f"{said}: {row.case}")
        now_s = time.monotonic()
        if now_s - told_s >= _TOLD_EVERY_S:
            left_s = (now_s - began_s) / done * (len(missing) - done)
            _tell(f"{done} of {len(missing)} flown, {left_s / 60.0:.0f} min left")
            told_s = now_s
    return [rows[case] for case in wanted]


def _fly(missing: list[C], fly: Callable[[C], R], jobs: int) -> Iterator[R]:
    """As they come; with one job in this very process."""
    if not missing:
        return
    if jobs == 1:
        warm_up()
        yield from map(fly, missing)
        return
    with ProcessPoolExecutor(min(jobs, len(missing)), initializer=warm_up) as pool:
        futures = [pool.submit(fly, case) for case in missing]
        yield from (future.result() for future in as_completed(futures))


def _tell(line: str) -> None:
    sys.stderr.write(line + "\n")
    sys.stderr.flush()


def _keep(path: Path | None, row: Row) -> None:
    if path is not None:
        with path.open("ab") as file:
            file.write(msgspec.json.encode(row) + b"\n")


def _kept(path: Path | None, row_type: type[R]) -> list[R]:
    if path is None or not path.exists():
        return []
    *lines, torn = path.read_bytes().split(b"\n")
    if torn:
        path.write_bytes(b"".join(line + b"\n" for line in lines))
    rows = []
    for number, line in enumerate(lines, start=1):
        try:
            rows.append(msgspec.json.decode(line, type=row_type))
        except msgspec.DecodeError as error:
            raise ValueError(
                f"{path}, line {number} is no row of this campaign ({error}); name another file"
            ) from error
    return rows
