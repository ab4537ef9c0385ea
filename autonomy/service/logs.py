"""The flight logs as the service offers them: names of one folder, and nothing beside it."""

from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import msgspec

from autonomy.service.contract import LogFile

SUFFIX = ".mcap"
EXPORT_SUFFIX = ".foxglove.mcap"
REPORT_SUFFIX = ".report.json"
LISTED_MAX = 500
_REPORT_BYTES_MAX = 1_000_000


def listed(folder: Path) -> list[LogFile]:
    """The newest logs first; an unreadable folder holds none."""
    files = []
    try:
        paths = [path for path in folder.iterdir() if _is_log(path)]
    except OSError:
        return []
    for path in paths:
        try:
            about = path.stat()
        except OSError:
            continue
        modified = datetime.fromtimestamp(about.st_mtime, UTC).isoformat(timespec="seconds")
        files.append(LogFile(path.name, about.st_size, modified, _report(path)))
    files.sort(key=lambda file: (file.modified_utc, file.name), reverse=True)
    return files[:LISTED_MAX]


def found(folder: Path, name: str) -> Path | None:
    """The log of that name, if the folder itself lists it: a name is never made into a path."""
    try:
        return next((p for p in folder.iterdir() if p.name == name and _is_log(p)), None)
    except OSError:
        return None


def report_path(log: Path) -> Path:
    """Where the report of a log lies: beside it."""
    return log.with_name(log.name + REPORT_SUFFIX)


def _is_log(path: Path) -> bool:
    named = path.name.endswith(SUFFIX) and not path.name.endswith(EXPORT_SUFFIX)
    return named and not path.is_symlink() and path.is_file()


def _report(log: Path) -> dict[str, Any] | None:
    try:
        with report_path(log).open("rb") as file:
            text = file.read(_REPORT_BYTES_MAX)
        return msgspec.json.decode(text, type=dict[str, Any])
    except (OSError, msgspec.DecodeError):
        return None
