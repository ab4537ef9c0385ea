"""One pilot: a vehicle's endpoint is locked by whoever flies it, and the lock names its holder.

The lock is a `flock` on a file, so it ends with its process, however that ends. A user who may
only read the file can take the lock all the same; it has no name in it then.

Any user may write that file, since any may be the next pilot. So where the holder can be talked to
stands in a file of its own beside it, which only its owner can write: a token and a mission go
there.
"""

import contextlib
import fcntl
import os
import re
import stat
import tempfile
from datetime import UTC, datetime
from pathlib import Path
from types import TracebackType
from typing import Self

import msgspec

from autonomy.errors import BadInput, NotNow

SYSTEM_FOLDER = Path("/run/autonomy")
"""Made by the systemd unit (RuntimeDirectory), for all users and beyond its end; every pilot of the
machine meets here."""

_SERIAL = re.compile(r"^serial:/*(.*?)(?::\d+)?$")
_ADDRESS = re.compile(r"^(\w+?)(in|out)?://([^:/]*)(?::(\d+))?/?$")
_HOLDER_BYTES = 4096


def utc_now() -> str:
    """The wall clock's time, for people to read."""
    return datetime.now(UTC).isoformat(timespec="milliseconds")


class Holder(msgspec.Struct, frozen=True):
    """Who has the vehicle. `api` is where it can be talked to; None for one that only flies, or
    whose address is not believed.
    """

    what: str
    pid: int
    since_utc: str
    api: str | None = None

    def __str__(self) -> str:
        where = f" at {self.api}" if self.api is not None else ""
        return f"{self.what} (process {self.pid}, since {self.since_utc}){where}"


class VehicleHeld(NotNow):
    """Another process flies this vehicle; `holder` is who, None when it left no name. `doubt` is
    why its address is not believed.
    """

    def __init__(self, connection: str, holder: Holder | None, doubt: str = "") -> None:
        self.holder = holder
        who = str(holder) if holder is not None else "another process"
        super().__init__(
            f"the vehicle on {connection} is held by {who}; one pilot at a time: stop that one, "
            f"or give the mission to it{f' ({doubt})' if doubt else ''}"
        )


def endpoint(connection: str) -> str:
    """What two URLs of one endpoint have in common: the local UDP port, the host, the device.

    One vehicle that is reached over two endpoints (a serial line and a router's port) has two.
    """
    serial = _SERIAL.match(connection)
    address = _ADDRESS.match(connection)
    if serial is not None:
        name = f"serial-{serial[1]}"
    elif address is not None and (address[1], address[2]) == ("udp", "in"):
        name = f"udpin-{address[4] or '14540'}"
    else:
        name = connection
    return re.sub(r"[^A-Za-z0-9.-]+", "_", name)


def lock_folder() -> Path:
    """Where locks are: the service's runtime folder where there is one, else the temporary one."""
    return SYSTEM_FOLDER if SYSTEM_FOLDER.is_dir() else Path(tempfile.gettempdir())


class VehicleLock:
    """A context that holds the vehicle on `connection`; entering raises VehicleHeld."""

    def __init__(self, connection: str, holder: Holder, folder: Path | None = None) -> None:
        self._connection = connection
        self._holder = holder
        self.path = (folder or lock_folder()) / f"autonomy-pilot-{endpoint(connection)}.lock"
        self._descriptor: int | None = None
        self._has_address = False

    def __enter__(self) -> Self:
        """Take it. Raises VehicleHeld, or BadInput when the file cannot be used."""
        descriptor, writable = _open(self.path)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            holder, doubt = _named(descriptor, self.path)
            os.close(descriptor)
            raise VehicleHeld(self._connection, holder, doubt) from None
        self._descriptor = descriptor
        if writable:
            self._write(self._holder)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Let go. The file stays: removing it would let two processes lock two files."""
        if self._descriptor is not None:
            if self._has_address:
                with contextlib.suppress(OSError):  # it names a holder that is gone
                    address_path(self.path).unlink()
            os.close(self._descriptor)
            self._descriptor = None

    def reachable_at(self, api: str) -> None:
        """Tell others where the holder can be talked to, in a file that they cannot write.

        Where another user's file is in its place, a second pilot is refused, and not helped.
        """
        if self._descriptor is None:
            raise ValueError("the lock is not held")
        path = address_path(self.path)
        flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC
        with contextlib.suppress(OSError):
            path.unlink(missing_ok=True)
            with os.fdopen(os.open(path, flags, 0o644), "wb") as file:
                self._has_address = True
                os.fchmod(file.fileno(), 0o644)  # whatever the umask: others read it
                file.write(msgspec.json.encode(msgspec.structs.replace(self._holder, api=api)))

    def _write(self, holder: Holder) -> None:
        if self._descriptor is None:
            raise ValueError("the lock is not held")
        data = msgspec.json.encode(holder)
        try:
            os.pwrite(self._descriptor, data, 0)
            os.ftruncate(self._descriptor, len(data))
        except OSError:
            # A lock without a name in it still locks (read-only file, full disk).
            return


def holder_of(connection: str, folder: Path | None = None) -> Holder | None:
    """Who holds the vehicle on `connection` now; None when nobody does, or left no name."""
    path = (folder or lock_folder()) / f"autonomy-pilot-{endpoint(connection)}.lock"
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NOFOLLOW)
    except OSError:
        return None
    try:
        fcntl.flock(descriptor, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return _named(descriptor, path)[0]
    else:
        return None
    finally:
        os.close(descriptor)


def address_path(lock: Path) -> Path:
    """Where the address of a lock's holder stands."""
    return lock.with_suffix(".api")


def why_not_believed(owner: int, mode: int, folder: Path) -> str:
    """Why an address in a file of that owner (uid) and mode is not believed; empty when it is.

    Root's is, one's own, and in the service's runtime folder that of the service's user, to whom
    systemd gave the folder.
    """
    believed = {0, os.geteuid()}
    if folder == SYSTEM_FOLDER:
        believed.add(folder.stat().st_uid)
    if stat.S_ISREG(mode) and not mode & (stat.S_IWGRP | stat.S_IWOTH) and owner in believed:
        return ""
    return (
        f"its address was written by user {owner}, and is not believed: it might take your token; "
        "use its page"
    )


def _named(descriptor: int, path: Path) -> tuple[Holder | None, str]:
    """Who holds the open lock at `path`, and why its address is not believed.

    An address is of the holder that the lock names, not of one that was killed before.
    """
    holder = _read_holder(descriptor)
    if holder is None:
        return None, ""
    nowhere = msgspec.structs.replace(holder, api=None)
    try:
        # A pipe in its place would keep us waiting.
        flags = os.O_RDONLY | os.O_CLOEXEC | os.O_NOFOLLOW | os.O_NONBLOCK
        address = os.open(address_path(path), flags)
    except OSError:
        return nowhere, ""
    try:
        found = os.fstat(address)
        doubt = why_not_believed(found.st_uid, found.st_mode, path.parent)
        told = _read_holder(address) if not doubt else None
    except OSError:
        return nowhere, ""
    finally:
        os.close(address)
    if told is None or told != msgspec.structs.replace(nowhere, api=told.api):
        return nowhere, doubt
    return told, ""


def _open(path: Path) -> tuple[int, bool]:
    """(descriptor, writable) of the lock file, made when missing; raises BadInput."""
    flags = os.O_CLOEXEC | os.O_NOFOLLOW
    try:
        descriptor, writable = _opened_or_made(path, flags), True
    except PermissionError:
        try:
            # Somebody else's file: reading is enough.
            descriptor, writable = os.open(path, os.O_RDONLY | flags), False
        except FileNotFoundError:
            raise BadInput(
                f"{path.parent}: only the service's user may make the lock there that keeps a "
                "second pilot away; run it as that user, or: chmod 1777 there"
            ) from None
        except OSError as error:
            raise _unusable(path, error) from None
    except OSError as error:
        raise _unusable(path, error) from None
    if not stat.S_ISREG(os.fstat(descriptor).st_mode):
        os.close(descriptor)
        raise BadInput(f"{path}: is not a plain file; remove it, the pilot's lock belongs there")
    return descriptor, writable


def _opened_or_made(path: Path, flags: int) -> int:
    """The file for writing. Whoever makes it lets the next pilot, another user, write a name.

    It is opened first without O_CREAT: a kernel that protects regular files refuses that flag on
    another's file in a sticky folder.
    """
    with contextlib.suppress(FileNotFoundError):
        return os.open(path, os.O_RDWR | flags)
    descriptor = os.open(path, os.O_RDWR | os.O_CREAT | flags, 0o666)
    if os.fstat(descriptor).st_uid == os.geteuid():
        os.fchmod(descriptor, 0o666)
    return descriptor


def _unusable(path: Path, error: OSError) -> BadInput:
    return BadInput(
        f"{path}: the lock that keeps a second pilot away cannot be opened ({error.strerror})"
    )


def _read_holder(descriptor: int) -> Holder | None:
    try:
        return msgspec.json.decode(os.pread(descriptor, _HOLDER_BYTES, 0), type=Holder)
    except (msgspec.DecodeError, OSError):
        return None
