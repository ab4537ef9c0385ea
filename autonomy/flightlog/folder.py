"""The folder of flight logs: which of its files are logs, and how old flights make room for new.

A flight is its log and what lies beside it under the log's name (report, mark, export). A log that
is being written is locked by its recorder, for as long as that process lives.
"""

import fcntl
import time
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from glob import escape
from pathlib import Path
from typing import NamedTuple

from autonomy.config import LogConfig
from autonomy.errors import NotReplayable
from autonomy.flightlog.reader import FlightLog, is_ours
from autonomy.flightlog.schema import EXPORT_SUFFIX, SUFFIX

_MB = 1_000_000
_CLOCK_WAS_SET = datetime(2024, 1, 1, tzinfo=UTC).timestamp()
"""A computer without a battery for its clock starts in 1970: an older date is not a date."""


def host_boot() -> str:
    """Which start of this computer; empty where the system does not tell."""
    try:
        return Path("/proc/sys/kernel/random/boot_id").read_text(encoding="ascii").strip()
    except OSError:
        return ""


def is_log(path: Path) -> bool:
    """True for a file that is named like a flight log; exports and links are not."""
    named = path.name.endswith(SUFFIX) and not path.name.endswith(EXPORT_SUFFIX)
    return named and not path.is_symlink() and path.is_file()


def logs_in(folder: Path) -> list[Path]:
    """The flight logs of a folder, oldest first; none where there is no folder.

    Those of this start of the computer come last, by its monotonic clock: a date that is set back
    between two flights makes no older one the newest. Among the others the date decides.
    Raises OSError for one that cannot be read.
    """
    try:
        return [path for _, path in sorted(_dated(folder))]
    except FileNotFoundError:
        return []


class _Flight(NamedTuple):
    log: Path
    files: tuple[Path, ...]
    size_bytes: int
    written_s: float


_Age = tuple[bool, float]
"""Of this start of the computer or not, and when: on its monotonic clock, else since 1970."""


def _dated(folder: Path) -> Iterator[tuple[_Age, Path]]:
    boot = host_boot()
    booted_s = datetime.now(UTC).timestamp() - time.monotonic()
    for path in folder.iterdir():
        try:
            if is_log(path):
                yield _age(path, boot, booted_s), path
        except FileNotFoundError:  # deleted meanwhile
            continue


def _age(path: Path, boot: str, booted_s: float) -> _Age:
    """Where a log stands; one that does not tell its own time, by the date of its file."""
    written_s = path.stat().st_mtime
    try:
        header = FlightLog.open(path).header
    except NotReplayable:
        header = None
    if header is not None and header.host_boot and header.host_boot != boot:
        return False, written_s
    if header is not None and header.host_boot and header.started_s is not None:
        return True, header.started_s
    return (True, written_s - booted_s) if written_s >= booted_s else (False, written_s)


def make_room(folder: Path, keep: LogConfig, now_s: float) -> tuple[str, ...]:
    """Delete the oldest flights beyond `keep`; returns what a person should know, as sentences.

    `now_s` is the time since 1970. Never deleted are the newest flight, a log that is being
    written, and files that this program did not write. Never raises: a folder that cannot be
    tidied is told.
    """
    try:
        flights = [_flight(log) for log in logs_in(folder)]
    except OSError as error:
        return (f"{folder}: old flights cannot be looked through ({error.strerror})",)
    excess_bytes = sum(flight.size_bytes for flight in flights) - keep.keep_mb * _MB
    told = []
    for flight in flights[:-1]:
        too_much = keep.keep_mb > 0 and excess_bytes > 0
        if not (too_much or _too_old(flight, keep.keep_days, now_s)) or not _may_go(flight.log):
            continue
        try:
            for path in flight.files:
                path.unlink(missing_ok=True)
        except OSError as error:
            told.append(f"{flight.log}: cannot be deleted to make room ({error.strerror})")
            continue
        excess_bytes -= flight.size_bytes
        reason = (
            f"log.keep_mb is {keep.keep_mb:g}" if too_much else f"log.keep_days is {keep.keep_days}"
        )
        told.append(
            f"deleted the flight {flight.log.name} ({flight.size_bytes / _MB:.1f} MB): {reason}"
        )
    return tuple(told)


def hold_for_writing(descriptor: int) -> None:
    """Lock an open log as one that is being written, until it is closed or the process ends."""
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return  # a file system without locks: then the newest flight alone is safe


def _flight(log: Path) -> _Flight:
    named = log.parent.glob(f"{escape(log.stem)}.*")
    beside = [path for path in named if path.is_file() and not is_log(path)]
    files = (*beside, log)  # the log last: what is left of a deletion that failed is still a flight
    sizes = [path.stat().st_size for path in files if path.exists()]
    return _Flight(log, files, sum(sizes), log.stat().st_mtime if log.exists() else 0.0)


def _too_old(flight: _Flight, keep_days: float | None, now_s: float) -> bool:
    if keep_days is None or flight.written_s < _CLOCK_WAS_SET:
        return False
    return now_s - flight.written_s > timedelta(days=keep_days).total_seconds()


def _may_go(log: Path) -> bool:
    """True for a log of this program that nobody writes."""
    try:
        with log.open("rb") as file:
            fcntl.flock(file.fileno(), fcntl.LOCK_EX | fcntl.LOCK_NB)
        return is_ours(log)
    except OSError:
        return False
