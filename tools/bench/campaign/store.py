"""A campaign's folder: rows/*.parquet, newest.jsonl, configs/*.yaml, campaign.json.

A row is safe as a line of newest.jsonl as soon as it was flown; when there are enough lines they
become one Parquet file under rows/, which is complete as soon as it has its name. Killed anywhere,
nothing is lost but rows in flight, and nothing counts twice.
"""

import fcntl
import os
import sys
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import IO, Any, Self

import msgspec

from autonomy.errors import BadInput
from tools.bench.campaign.case import Case, Row
from tools.campaign import Lines

PART_ROWS = 1000


class Store:
    """The rows of one campaign, for one process at a time; a context manager."""

    def __init__(self, folder: Path, *, part_rows: int = PART_ROWS) -> None:
        self.folder = folder
        self._part_rows = part_rows
        self._lines = Lines(folder / "newest.jsonl", Row)
        self._newest: list[Row] = []
        self._lock: IO[bytes] | None = None

    def __enter__(self) -> Self:
        """Raises BadInput where the folder is in use, or is none, or Parquet cannot be written."""
        _arrow()
        try:
            (self.folder / "rows").mkdir(parents=True, exist_ok=True)
            self._lock = (self.folder / ".lock").open("ab")
        except OSError as error:
            raise BadInput(f"{self.folder} cannot be written ({error.strerror})") from None
        try:
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            self._lock.close()
            raise BadInput(
                f"{self.folder} is being flown into by another process: wait, or name another"
            ) from None
        return self

    def __exit__(self, *_: object) -> None:
        try:
            self.seal()
        finally:
            if self._lock is not None:
                self._lock.close()

    def kept(self) -> list[Row]:
        """Every row there is; those that were flown since the last sealing are sealed with more."""
        rows = {row.case: row for row in _parts(self.folder, set_aside=True)}
        self._newest = [row for row in self._newest_lines() if row.case not in rows]
        rows.update({row.case: row for row in self._newest})
        return list(rows.values())

    def keep(self, row: Row) -> None:
        """From now on the row survives whatever happens to this process."""
        self._lines.keep(row)
        self._newest.append(row)
        if len(self._newest) >= self._part_rows:
            self.seal()

    def seal(self) -> None:
        """What newest.jsonl has becomes the next Parquet file."""
        if not self._newest:
            return
        taken = [int(path.stem.split("-")[1]) for path in _names(self.folder)]
        number = max(taken, default=-1) + 1
        unfinished = self.folder / "unfinished.parquet"
        write_part(unfinished, self._newest)
        unfinished.rename(self.folder / "rows" / f"part-{number:05d}.parquet")
        _on_disk(self.folder / "rows")
        self._newest = []
        (self.folder / "newest.jsonl").unlink(missing_ok=True)

    def _newest_lines(self) -> list[Row]:
        try:
            return self._lines.kept()
        except ValueError as error:
            raise BadInput(str(error)) from None


def rows_of(folder: Path) -> list[Row]:
    """Every row of a campaign, in the order of cases, also while it is being flown.

    Raises BadInput where there is none.
    """
    newest = folder / "newest.jsonl"
    # Before the parts: what is sealed meanwhile is then read twice, and not never.
    try:
        lines = newest.read_bytes().split(b"\n")[:-1]
    except FileNotFoundError:
        lines = []
    rows = {row.case: row for row in _parts(folder, set_aside=False)}
    for line in lines:
        try:
            row = msgspec.json.decode(line, type=Row)
        except msgspec.DecodeError as error:
            raise BadInput(f"{newest} is of another version ({error})") from None
        rows[row.case] = row
    if not rows:
        raise BadInput(f"{folder} holds no rows of a campaign: fly one into it first")
    return [rows[case] for case in sorted(rows, key=order)]


def _on_disk(folder: Path) -> None:
    """Names in a folder survive a power cut from now on."""
    opened = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        os.fsync(opened)
    finally:
        os.close(opened)


def order(case: Case) -> tuple[str, int, str, str, str, str, int]:
    """World by world, numbers as numbers."""
    family, _, rest = case.world.partition(":")
    number = int(rest) if rest.isdecimal() else -1
    return (family, number, rest, case.planner, case.sensors, case.response, case.seed)


def _names(folder: Path) -> list[Path]:
    return sorted((folder / "rows").glob("part-*.parquet"))


def _parts(folder: Path, *, set_aside: bool) -> Iterator[Row]:
    """Rows of all readable parts. A part that is torn (by the disk: they get their name when they
    are complete) is told, and set aside if its flights are to be flown again.
    """
    for path in _names(folder):
        try:
            yield from read_part(path)
        except UnreadablePart as error:
            sys.stderr.write(f"{path}: {error}\n")
            if set_aside:
                aside = folder / f"{path.name}.torn"
                path.rename(aside)
                sys.stderr.write(f"set aside as {aside}; its flights are flown again\n")


class UnreadablePart(Exception):
    """No Parquet file, or one of another table."""


# ---------------------------------------------------------------- Parquet: the door to pyarrow


def write_part(path: Path, rows: Iterable[Row]) -> None:
    """One Parquet file; complete on the disk when this returns."""
    pa, pq = _arrow()
    table = pa.Table.from_pylist([msgspec.structs.asdict(row) for row in rows], schema=_schema(pa))
    with path.open("wb") as file:
        pq.write_table(table, file, compression="zstd")
        file.flush()
        os.fsync(file.fileno())


def read_part(path: Path) -> list[Row]:
    """Its rows; columns that it does not have yet get their defaults. Raises UnreadablePart."""
    pa, pq = _arrow()
    try:
        found = pq.ParquetFile(path).read().to_pylist()
        return [msgspec.convert(row, Row) for row in found]
    except (pa.ArrowException, OSError, msgspec.ValidationError) as error:
        raise UnreadablePart(str(error).splitlines()[0]) from None


def _schema(pa: Any) -> Any:
    """A column for every field."""
    columns = {str: pa.string(), int: pa.int64(), float: pa.float64(), bool: pa.bool_()}
    optional = float | None
    fields = msgspec.structs.fields(Row)
    return pa.schema([(f.name, columns[float if f.type == optional else f.type]) for f in fields])


def _arrow() -> tuple[Any, Any]:
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError:
        raise BadInput(
            "campaigns need pyarrow; install it with: pip install 'autonomy[campaign]'"
        ) from None
    return pyarrow, pyarrow.parquet
