"""Writes a flight log beside the control loop, never in its way.

`FlightRecorder.tick` puts immutable records into a bounded queue; a thread encodes and writes
them, a few ticks at a time. When the queue is full the tick is dropped and counted; when the disk
refuses, recording ends with a sentence in `failure`. In neither case does the flight notice.
"""

import contextlib
import importlib.metadata
import os
import platform
import queue
import threading
import time
from collections import deque
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path
from typing import BinaryIO

import msgspec
from mcap.writer import CompressionType, Writer

from autonomy import __version__
from autonomy.errors import BadInput
from autonomy.flightlog.folder import hold_for_writing, host_boot
from autonomy.flightlog.schema import (
    METADATA,
    PROFILE,
    SUFFIX,
    TOPICS,
    FlightHeader,
    GuardRecord,
    RouteRecord,
    encode,
    json_schema,
)
from autonomy.geometry import Point
from autonomy.model import Command, Inputs, Resumed
from hal.frames import Vector3
from hal.readings import StatusText

QUEUE_TICKS = 1200
"""One minute at 20 Hz: more than any disk should be silent."""

GATHER_S = 0.2
"""Ticks are left to gather for so long: a thread woken for each costs more than what it writes."""

FLUSH_S = 0.75
"""A chunk is closed and handed to the disk this often: what a power loss costs is below 1 s."""

_S_IN_NS = 1_000_000_000

Row = tuple[str, int, float, msgspec.Struct]  # topic, sequence, time in s, record


_COMPUTING = ("msgspec", "numba", "numpy", "scipy")


def _versions() -> dict[str, str]:
    """What computes: a replay on other versions may differ in the last bit."""
    libraries = {name: importlib.metadata.version(name) for name in _COMPUTING}
    return {
        "autonomy": __version__,
        "python": platform.python_version(),
        "machine": platform.machine(),
        **libraries,
    }


class FlightRecorder:
    """Records one flight. Use from one thread; `close` it, or leave its `with` block."""

    def __init__(
        self,
        path: Path,
        header: FlightHeader,
        *,
        queue_ticks: int = QUEUE_TICKS,
        wait_when_full: bool = False,
        tell: Callable[[str], None] | None = None,
    ) -> None:
        """Create the file; raises BadInput when that is not possible.

        `tell` is called with `failure` when recording ends before its time, on another thread.

        `wait_when_full` is for simulated time, where waiting costs nothing and a lost tick would
        end the replay.
        """
        self.path = path
        self._failure: str | None = None
        self._dropped = 0
        self._next = 0
        self._wait = wait_when_full
        self._tell = tell
        # One entry a tick; None is the end.
        self._queue: queue.Queue[list[Row] | None] = queue.Queue(queue_ticks)
        self._many = max(1, queue_ticks // 2)
        self._hurry = threading.Event()
        self._hurry.set()
        self._gathered: deque[list[Row]] = deque()
        self._ended = False
        try:
            self._file: BinaryIO = path.open("xb")
        except OSError as error:
            raise BadInput(
                f"{path}: the flight log cannot be created ({error.strerror}); "
                "choose another place with --log-dir or log.directory"
            ) from None
        hold_for_writing(self._file.fileno())
        self._thread = threading.Thread(target=self._run, args=(header,), name="flight-recorder")
        self._thread.start()

    @classmethod
    def in_folder(
        cls,
        folder: Path,
        *,
        config_json: str,
        scenario: str | None = None,
        seed: int | None = None,
        wait_when_full: bool = False,
        tell: Callable[[str], None] | None = None,
    ) -> "FlightRecorder":
        """A recorder in `folder` (made when missing), in a file named for the time and the world.

        Raises BadInput when folder or file cannot be made.
        """
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise BadInput(
                f"{folder}: cannot be used for flight logs ({error.strerror}); "
                "choose another place with --log-dir or log.directory"
            ) from None
        now = datetime.now(UTC)
        world = Path(scenario).stem if scenario else ""
        header = FlightHeader(
            config_json=config_json,
            scenario=scenario or "",
            seed=seed,
            started_utc=now.isoformat(timespec="seconds"),
            versions=_versions(),
            host_boot=host_boot(),
            started_s=time.monotonic(),
        )
        stem = f"{now:%Y%m%d-%H%M%S}-{world or 'flight'}"
        number = 1
        while (path := folder / f"{stem}{f'-{number}' if number > 1 else ''}{SUFFIX}").exists():
            number += 1
        return cls(path, header, wait_when_full=wait_when_full, tell=tell)

    @property
    def failure(self) -> str | None:
        """Why recording ended before its time, as a sentence; None while all is well."""
        return self._failure

    @property
    def ticks(self) -> int:
        """How many ticks it was given."""
        return self._next

    @property
    def dropped(self) -> int:
        """How many ticks did not reach the log."""
        return self._dropped

    def notes(self) -> tuple[str, ...]:
        """What a person should know about the log, one sentence each; empty when all is well."""
        sentences = [] if self._failure is None else [self._failure]
        if self._dropped and self._failure is None:
            sentences.append(
                f"{self._dropped} ticks are missing from the flight log: the disk was too slow"
            )
        return tuple(sentences)

    def route(
        self,
        goals_ned_m: tuple[Vector3, ...],
        resumed: Resumed | None = None,
        offset_ne_m: Point = (0.0, 0.0),
    ) -> None:
        """Record where the flight goes, or goes on, and where its frame begins in a service's;
        returns at once and never raises.
        """
        self._put([("route", 0, 0.0, RouteRecord(goals_ned_m, resumed, offset_ne_m))])

    def tick(self, inputs: Inputs, command: Command, step_s: float) -> None:
        """Record one step of the control loop; returns at once and never raises."""
        index = self._next
        self._next += 1
        guarded = GuardRecord(command.setpoint, command.wire_setpoint, command.guard, step_s)
        rows: list[Row] = [
            ("inputs", index, inputs.now_s, inputs),
            ("decisions", index, inputs.now_s, command.decision),
            ("guard", index, inputs.now_s, guarded),
        ]
        if not self._put(rows):
            self._dropped += 1

    def text(self, text: StatusText) -> None:
        """Record one line that the autopilot wrote; returns at once and never raises."""
        self._put([("texts", self._next, text.stamp_s, text)])

    def close(self) -> None:
        """Write what is queued and finish the file; never raises. May be called twice."""
        if self._thread.is_alive():
            self._queue.put(None)
            self._hurry.set()
            self._thread.join()

    def __enter__(self) -> "FlightRecorder":
        """Itself."""
        return self

    def __exit__(self, *exception: object) -> None:
        """Close."""
        self.close()

    def _put(self, rows: list[Row]) -> bool:
        if self._failure is not None:
            return False
        try:
            self._queue.put(rows, block=self._wait)
        except queue.Full:
            return False
        if _ordered(rows) or self._queue.qsize() >= self._many:
            self._hurry.set()
        return True

    # ------------------------------------------------------------ the thread

    def _run(self, header: FlightHeader) -> None:
        try:
            with self._file:
                self._write(header)
        except Exception as error:  # noqa: BLE001 - a log that fails, however, never ends a flight
            reason = error.strerror if isinstance(error, OSError) else repr(error)
            self._failure = f"{self.path}: recording ended before the flight did ({reason})"
            if self._tell is not None:
                self._tell(self._failure)
            self._drain()

    def _write(self, header: FlightHeader) -> None:
        writer = Writer(self._file, compression=CompressionType.ZSTD)
        writer.start(profile=PROFILE, library=f"autonomy {header.versions.get('autonomy', '')}")
        writer.add_metadata(METADATA, {"header": encode(header).decode()})
        channels = {topic: _register(writer, topic, kind) for topic, kind in TOPICS.items()}
        flush_at = 0.0  # at once: a flight that is cut short has its header
        while not self._ended:
            self._gather()
            ordered = False
            while self._gathered:
                for topic, sequence, at_s, record in self._gathered[0]:
                    at_ns = max(0, round(at_s * _S_IN_NS))
                    writer.add_message(channels[topic], at_ns, encode(record), at_ns, sequence)
                ordered = ordered or _ordered(self._gathered[0])
                self._gathered.popleft()
            if time.monotonic() >= flush_at:
                writer.flush()
                os.fsync(self._file.fileno())
                flush_at = time.monotonic() + FLUSH_S
            elif ordered:
                writer.flush()
        writer.finish()
        self._file.flush()
        os.fsync(self._file.fileno())

    def _gather(self) -> None:
        """Take what came meanwhile, sooner when there is a hurry, and notice the end."""
        self._hurry.wait(GATHER_S)
        self._hurry.clear()  # before looking: what comes now is seen, or hurries once more
        with contextlib.suppress(queue.Empty):
            while not self._ended and len(self._gathered) < self._many:
                self._take(self._queue.get_nowait())
        if len(self._gathered) == self._many:
            self._hurry.set()

    def _take(self, entry: list[Row] | None) -> None:
        if entry is None:
            self._ended = True
        else:
            self._gathered.append(entry)

    def _drain(self) -> None:
        """Count what comes until the end, so that neither `tick` nor `close` ever waits for it."""
        while True:
            while self._gathered:
                rows = self._gathered.popleft()
                self._dropped += any(topic == "inputs" for topic, *_ in rows)
            if self._ended:
                return
            self._take(self._queue.get())


def _ordered(rows: list[Row]) -> bool:
    """True for a tick with an operator's order: who is killed next must not forget it.

    The kernel has it once it was flushed, which is enough for a process that is killed.
    """
    return any(isinstance(record, Inputs) and record.commands for *_, record in rows)


def _register(writer: Writer, topic: str, kind: type[msgspec.Struct]) -> int:
    schema = writer.register_schema(kind.__name__, "jsonschema", json_schema(kind))
    return writer.register_channel(topic, "json", schema)
