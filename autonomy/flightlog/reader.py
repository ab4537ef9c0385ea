"""Reads flight logs, whole or cut off, and flies them again.

The file is read from its beginning without its summary, so that a log which ends in the middle of
a record (power loss, kill, full disk) is good up to there.
"""

import math
import struct
from collections.abc import Callable, Iterator
from pathlib import Path

import msgspec
import zstandard
from mcap.exceptions import EndOfFile, McapError
from mcap.records import Channel, Footer, Header, McapRecord, Message, Metadata
from mcap.stream_reader import CRCValidationError, StreamReader

from autonomy.errors import NotReplayable
from autonomy.flightlog.schema import (
    FORMAT,
    METADATA,
    PROFILE,
    TOPICS,
    FlightHeader,
    GuardRecord,
    RouteRecord,
    Tick,
    decode,
)
from autonomy.geometry import Point
from autonomy.model import Command, Decision, Inputs, Resumed
from hal.frames import Vector3
from hal.readings import StatusText

# What the mcap library raises on bytes that are not, or no longer, what they should be.
_DAMAGE = (
    McapError,
    CRCValidationError,
    zstandard.ZstdError,
    struct.error,
    UnicodeDecodeError,
    MemoryError,
    OverflowError,
)


class FlightLog:
    """One flight log. Iterating reads the file anew each time; nothing is kept in memory."""

    def __init__(self, path: Path, header: FlightHeader) -> None:
        """Use `FlightLog.open`."""
        self.path = path
        self.header = header
        self.damage: str | None = None
        """After reading: why the log ends before its end, None when it was finished properly."""
        self.share_read = 0.0
        """While reading: how much of the file was read, from 0 to 1, a piece of it at a time."""

    @classmethod
    def open(cls, path: Path) -> "FlightLog":
        """The log at `path`, with its header read.

        Raises NotReplayable, with a sentence, when it cannot be read or is not a flight log.
        """
        profile = None
        try:
            for record in _records(path):
                if isinstance(record, Header):
                    profile = record.profile
                elif isinstance(record, Metadata) and record.name == METADATA:
                    return cls(path, _header(path, record.metadata.get("header", "")))
                elif not isinstance(record, Metadata):
                    break
        except OSError as error:
            raise NotReplayable(f"{path}: cannot be read ({error.strerror})") from None
        except _DAMAGE:
            if profile == PROFILE:
                raise NotReplayable(
                    f"{path}: was cut off before its header was written; nothing can be read"
                ) from None
        raise NotReplayable(f"{path}: is not a flight log of this program")

    def __iter__(self) -> Iterator[Tick]:
        """All complete ticks in order.

        Sets `damage` when the file ends early. Raises NotReplayable when a record does not fit
        this version of the program.
        """
        parts: dict[str, msgspec.Struct] = {}
        index = -1
        for topic, sequence, record in self._messages():
            if topic in ("texts", "route"):
                continue
            if sequence != index:
                parts, index = {}, sequence
            parts[topic] = record
            inputs, decision = parts.get("inputs"), parts.get("decisions")
            guarded = parts.get("guard")
            if (
                isinstance(inputs, Inputs)
                and isinstance(decision, Decision)
                and isinstance(guarded, GuardRecord)
            ):
                command = Command(decision, guarded.setpoint, guarded.wire_setpoint, guarded.guard)
                yield Tick(index, inputs, command, guarded.step_s)

    def route(self) -> tuple[Vector3, ...]:
        """The goals; raises NotReplayable when the flight ended before it had any."""
        for _, _, record in self._messages():
            if isinstance(record, RouteRecord):
                return record.goals_ned_m
        raise NotReplayable(f"{self.path}: no route was recorded; there is nothing to replay")

    def resumed(self) -> Resumed | None:
        """Where the flight went on, None for one that began on the ground."""
        for _, _, record in self._messages():
            if isinstance(record, RouteRecord):
                return record.resumed
        return None

    def offset_ne_m(self) -> Point:
        """Where the take-off point lies in the frame of the service that flew it; (0, 0) without
        a service, and in logs from before it was recorded.
        """
        for _, _, record in self._messages():
            if isinstance(record, RouteRecord):
                return record.offset_ne_m
        return (0.0, 0.0)

    def texts(self) -> Iterator[StatusText]:
        """What the autopilot wrote during the flight, oldest first."""
        for _, _, record in self._messages():
            if isinstance(record, StatusText):
                yield record

    def _messages(self) -> Iterator[tuple[str, int, msgspec.Struct]]:
        """(topic, sequence, record) of every message up to the end or the cut."""
        topics: dict[int, str] = {}
        self.damage = None
        try:
            for record in _records(self.path, self._heard):
                if isinstance(record, Channel) and record.topic in TOPICS:
                    topics[record.id] = record.topic
                elif isinstance(record, Message) and record.channel_id in topics:
                    topic = topics[record.channel_id]
                    yield topic, record.sequence, self._decoded(record, topic)
                elif isinstance(record, Footer):
                    break
        except EndOfFile:
            self.damage = f"{self.path}: the log was cut off; it is read up to there"
        except _DAMAGE as error:
            self.damage = f"{self.path}: the log is damaged and is read up to there ({error})"

    def _heard(self, share: float) -> None:
        self.share_read = share

    def _decoded(self, message: Message, topic: str) -> msgspec.Struct:
        try:
            return decode(message.data, TOPICS[topic])
        except msgspec.MsgspecError as error:
            raise NotReplayable(
                f"{self.path}: tick {message.sequence}, {topic}: was written by another version "
                f"of this program ({error})"
            ) from None


def is_ours(path: Path) -> bool:
    """True for a log that this program began to write; raises OSError when it cannot be read."""
    try:
        first = next(_records(path), None)
    except _DAMAGE:
        return False
    return isinstance(first, Header) and first.profile == PROFILE


def _records(
    path: Path, tell_share: Callable[[float], None] = lambda _: None
) -> Iterator[McapRecord]:
    with path.open("rb") as file:
        limit = path.stat().st_size  # no record is larger than its file, whatever its length says
        for record in StreamReader(file, validate_crcs=True, record_size_limit=limit).records:
            tell_share(file.tell() / limit)
            yield record


def _header(path: Path, text: str) -> FlightHeader:
    try:
        header = decode(text.encode(), FlightHeader)
    except msgspec.MsgspecError as error:
        raise NotReplayable(f"{path}: its header cannot be read ({error})") from None
    if header.format != FORMAT:
        raise NotReplayable(
            f"{path}: has format {header.format}, this program reads format {FORMAT}; "
            "use the version of the program that wrote it"
        )
    return header


# ---------------------------------------------------------------- flying it again


class ReplayResult(msgspec.Struct, frozen=True):
    """What came of a replay. It proved the flight when `exact` is True.

    `ticks` were compared; `first_difference` says where and how the first one differs;
    `gap` says which ticks the log lacks (a replay cannot go on after that).
    """

    ticks: int
    first_difference: str | None = None
    gap: str | None = None

    @property
    def exact(self) -> bool:
        """True when every tick of a log without gaps gave the same decision."""
        return self.ticks > 0 and self.first_difference is None and self.gap is None


def replay(log: FlightLog, step: Callable[[Inputs], Command]) -> ReplayResult:
    """Feed the recorded inputs to `step` and compare every command, up to the first difference.

    Raises NotReplayable when the log has no complete tick.
    """
    ticks = 0
    for tick in log:
        if tick.index != ticks:
            return ReplayResult(ticks, gap=f"ticks {ticks} to {tick.index - 1} were not recorded")
        difference = compare(tick.command, step(tick.inputs))
        ticks += 1
        if difference is not None:
            where = f"tick {tick.index} at {tick.inputs.now_s:.3f} s: {difference}"
            return ReplayResult(ticks, first_difference=where)
    if ticks == 0:
        raise NotReplayable(f"{log.path}: holds no complete tick; there is nothing to replay")
    return ReplayResult(ticks)


def compare(recorded: msgspec.Struct, recomputed: msgspec.Struct) -> str | None:
    """The first field in which two records differ, or None when they are the same bit for bit.

    For example `setpoint.velocity_ned_m_s[1]: 0.2 != 0.19`, the recorded value first.
    """
    return _difference(recorded, recomputed, "")


def _difference(a: object, b: object, path: str) -> str | None:
    if isinstance(a, msgspec.Struct) and type(a) is type(b):
        for name in a.__struct_fields__:
            below = f"{path}.{name}" if path else name
            found = _difference(getattr(a, name), getattr(b, name), below)
            if found is not None:
                return found
        return None
    if isinstance(a, tuple) and isinstance(b, tuple):
        for index, (left, right) in enumerate(zip(a, b, strict=False)):
            found = _difference(left, right, f"{path}[{index}]")
            if found is not None:
                return found
        return None if len(a) == len(b) else f"{path}: {len(a)} items != {len(b)} items"
    if isinstance(a, dict) and isinstance(b, dict) and a.keys() == b.keys():
        for key, left in a.items():
            found = _difference(left, b[key], f"{path}[{key!r}]")
            if found is not None:
                return found
        return None
    return None if _same(a, b) else f"{path}: {_shown(a)} != {_shown(b)}"


def _same(a: object, b: object) -> bool:
    """Equal, and for numbers also of the same sign of zero; NaN is the same as NaN."""
    if isinstance(a, float) and isinstance(b, float):
        if math.isnan(a) or math.isnan(b):
            return math.isnan(a) and math.isnan(b)
        return a == b and math.copysign(1.0, a) == math.copysign(1.0, b)
    return type(a) is type(b) and a == b


def _shown(value: object) -> str:
    """A value as short as it can be told: records by their name."""
    return f"a {type(value).__name__}" if isinstance(value, msgspec.Struct) else repr(value)
