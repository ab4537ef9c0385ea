"""NMEA sentences and UBX frames out of one stream of bytes; pure, and never surprised.

NMEA 0183: `$` ... `*HH` and a line end; the checksum is the exclusive or of what stands between.
UBX: 0xB5 0x62, class, id, little-endian length, payload, 8-bit Fletcher checksum (RFC 1145) over
all but the sync characters (u-blox interface description, "UBX protocol").

The same bytes give the same frames however they are cut into chunks. Every byte is accounted for:
`bytes_taken == bytes_framed + bytes_dropped + bytes_pending`.
"""

import re
from collections import deque
from enum import Enum
from functools import reduce
from operator import xor
from typing import NamedTuple

SENTENCE_MAX = 256
"""Bytes of an NMEA sentence. The standard's 82 are exceeded by real receivers, this is not."""
PAYLOAD_MAX = 1024
"""Bytes of a UBX payload. What is larger is none of ours, and waiting for it would cost seconds."""
NAV_PVT = b"\x01\x07"
_NAV_PVT_SIZES = (84, 92)
_DOLLAR, _SYNC = 0x24, b"\xb5\x62"
_UBX_AROUND = 8  # sync, class, id, length before the payload; checksum after it
_START = re.compile(rb"[$\xb5]")
_SENTENCE = re.compile(rb"\$[ -#%-~]*")  # printable, and `$` only where a sentence begins
_CHECKED = re.compile(rb"\$([ -#%-)+-~]+)\*([0-9A-Fa-f]{2})")


class Protocol(Enum):
    """Which of the two a frame is."""

    NMEA = "nmea"
    UBX = "ubx"


class Frame(NamedTuple):
    """One frame with a correct checksum: the sentence from `$` to `*HH`, or a whole UBX frame.

    `received_s` is when its first byte came, as well as its chunk tells.
    """

    protocol: Protocol
    content: bytes
    received_s: float


class Framer:
    """Finds frames; everything else is counted and dropped."""

    def __init__(self) -> None:
        self.bytes_taken = 0
        self.bytes_framed = 0
        self.bytes_dropped = 0
        self.frames = 0
        self.checksum_errors = 0
        self.oversized = 0
        """Sentences and frames that claim to be longer than any of interest."""
        self.broken_off = 0
        """Sentences that another one or binary data cut short, and frames that silence did."""
        self._pending = bytearray()
        self._marks: deque[tuple[int, float]] = deque()
        """(number of the first byte, time) of each chunk that still has bytes pending."""
        self._line_end_due = False

    @property
    def bytes_pending(self) -> int:
        """Bytes of a frame that has not ended yet."""
        return len(self._pending)

    def feed(self, data: bytes, received_s: float) -> list[Frame]:
        """The frames that end in `data`, oldest first."""
        if not data:
            return []
        self._marks.append((self.bytes_taken, received_s))
        self.bytes_taken += len(data)
        self._pending += data
        frames = self._scan()
        self._forget_marks()
        return frames

    def gap(self) -> list[Frame]:
        """The line fell silent: what has begun will not end. Frames that hid behind it come out."""
        frames: list[Frame] = []
        while self._pending:
            self.broken_off += 1
            self._drop(1)
            frames += self._scan()
        self._marks.clear()
        return frames

    def abandon(self) -> None:
        """What is pending is not continued, and nobody wants what it may hide."""
        self.broken_off += bool(self._pending)
        self._drop(len(self._pending))
        self._marks.clear()
        self._line_end_due = False

    def _scan(self) -> list[Frame]:
        frames = []
        while self._pending:
            if self._line_end_due:
                self._line_end_due = False
                if self._pending[0] == 0x0A:
                    self._consume(1)
                    continue
            start = _START.search(self._pending)
            self._drop(start.start() if start is not None else len(self._pending))
            if not self._pending:
                break
            before = len(self._pending)
            frame = self._sentence() if self._pending[0] == _DOLLAR else self._ubx_frame()
            if frame is not None:
                self.frames += 1
                frames.append(frame)
            elif len(self._pending) == before:
                break  # it has not ended yet
        return frames

    def _sentence(self) -> Frame | None:
        """The sentence at the start, if it has ended and is right; drops it when it is wrong."""
        match = _SENTENCE.match(self._pending)
        size = match.end() if match is not None else 1
        if size > SENTENCE_MAX:
            self.oversized += 1
            self._drop(size)
            return None
        if size == len(self._pending):
            return None
        end = self._pending[size]
        if end not in b"\r\n":
            self.broken_off += 1
            self._drop(size)
            return None
        content = bytes(self._pending[:size])
        if not _sentence_is_right(content):
            self.checksum_errors += 1
            self._drop(size)
            return None
        frame = Frame(Protocol.NMEA, content, self._first_byte_s())
        self._consume(size + 1)
        self._line_end_due = end == 0x0D
        return frame

    def _ubx_frame(self) -> Frame | None:
        """The frame at the start, likewise; what a wrong one holds is searched for others."""
        pending = self._pending
        if not pending.startswith(_SYNC[: len(pending)]):
            self._drop(1)
            return None
        if len(pending) < 6:
            return None
        size = pending[4] | pending[5] << 8
        if size > PAYLOAD_MAX or (pending[2:4] == NAV_PVT and size not in _NAV_PVT_SIZES):
            self.oversized += 1
            self._drop(2)
            return None
        if len(pending) < size + _UBX_AROUND:
            return None
        content = bytes(pending[: size + _UBX_AROUND])
        if fletcher(content[2:-2]) != content[-2:]:
            self.checksum_errors += 1
            self._drop(2)
            return None
        frame = Frame(Protocol.UBX, content, self._first_byte_s())
        self._consume(len(content))
        return frame

    def _first_byte_s(self) -> float:
        """When the first pending byte came."""
        self._forget_marks()
        return self._marks[0][1]

    def _forget_marks(self) -> None:
        first = self.bytes_taken - len(self._pending)
        while len(self._marks) > 1 and self._marks[1][0] <= first:
            self._marks.popleft()

    def _drop(self, count: int) -> None:
        self.bytes_dropped += count
        del self._pending[:count]

    def _consume(self, count: int) -> None:
        self.bytes_framed += count
        del self._pending[:count]


def fletcher(content: bytes) -> bytes:
    """UBX's two checksum bytes over class, id, length and payload."""
    a = b = 0
    for byte in content:
        a = (a + byte) & 0xFF
        b = (b + a) & 0xFF
    return bytes((a, b))


def _sentence_is_right(content: bytes) -> bool:
    match = _CHECKED.fullmatch(content)
    return match is not None and reduce(xor, match[1]) == int(match[2], 16)
