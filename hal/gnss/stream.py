"""Bytes of a receiver that speaks NMEA, UBX or both, to fixes; pure, nothing raises.

Every frame and every solution ends in one counter: `frames == ignored + unreadable + read`, and
`solutions == told + absurd + untimely + frozen + outranked`.
"""

import math

import msgspec

from hal.gnss import nmea, ubx
from hal.gnss.framing import Frame, Framer, Protocol
from hal.gnss.solution import Judge, Solution
from hal.readings import GnssFix

UBX_RANKS_FOR_S = 3.0
"""While NAV-PVT came within this, NMEA's view of the same epochs is not told as well."""


def load() -> None:
    """Load the libraries that read frames; raises ImportError, naming the missing one."""
    nmea.load()
    ubx.load()


class StreamCounts(msgspec.Struct, frozen=True):
    """What became of every byte, frame and solution; see `Framer` and `Judge` for the words."""

    bytes_taken: int = 0
    bytes_framed: int = 0
    bytes_dropped: int = 0
    bytes_pending: int = 0
    frames: int = 0
    checksum_errors: int = 0
    oversized: int = 0
    broken_off: int = 0
    ignored: int = 0
    """Frames of kinds that tell no position."""
    unreadable: int = 0
    """Frames with a correct checksum and a content that is not to be read."""
    read: int = 0
    solutions: int = 0
    told: int = 0
    absurd: int = 0
    untimely: int = 0
    frozen: int = 0
    outranked: int = 0
    leaps: int = 0
    losses: int = 0

    def lost(self) -> dict[str, int]:
        """How many frames and solutions were not believed, by reason."""
        return {
            "checksum": self.checksum_errors,
            "oversized": self.oversized,
            "broken off": self.broken_off,
            "unreadable": self.unreadable,
            "absurd": self.absurd,
            "untimely": self.untimely,
            "frozen": self.frozen,
            "outranked": self.outranked,
        }


class GnssStream:
    """One receiver's bytes in, fixes out."""

    def __init__(
        self, *, latency_s: float, range_error_m: float, frozen_after_s: float, confirm_fixes: int
    ) -> None:
        self._framer = Framer()
        self._range_error_m = range_error_m
        self._epochs = nmea.Epochs(range_error_m)
        self._judge = Judge(latency_s, frozen_after_s, confirm_fixes)
        self._ubx_s = -math.inf
        self._ignored = self._unreadable = self._read = 0
        self._solutions = self._outranked = 0

    @property
    def frames(self) -> int:
        """Frames with a correct checksum so far, of any kind."""
        return self._framer.frames

    def feed(self, data: bytes, received_s: float) -> list[GnssFix]:
        """The fixes that these bytes, received at monotonic `received_s`, complete."""
        return self._take(self._framer.feed(data, received_s))

    def gap(self) -> list[GnssFix]:
        """The line fell silent for longer than between two bytes of a burst: the epoch is over."""
        fixes = self._take(self._framer.gap())
        return fixes + self._told(self._nmea(self._epochs.end()))

    def restart(self) -> None:
        """The receiver was away, or spoke at another rate: nothing continues."""
        self._framer.abandon()
        self._epochs = nmea.Epochs(self._range_error_m)
        self._judge.restart()
        self._ubx_s = -math.inf

    def counts(self) -> StreamCounts:
        """The counters as they are."""
        framer, judge = self._framer, self._judge
        return StreamCounts(
            bytes_taken=framer.bytes_taken,
            bytes_framed=framer.bytes_framed,
            bytes_dropped=framer.bytes_dropped,
            bytes_pending=framer.bytes_pending,
            frames=framer.frames,
            checksum_errors=framer.checksum_errors,
            oversized=framer.oversized,
            broken_off=framer.broken_off,
            ignored=self._ignored,
            unreadable=self._unreadable,
            read=self._read,
            solutions=self._solutions,
            told=judge.told,
            absurd=judge.absurd,
            untimely=judge.untimely,
            frozen=judge.frozen,
            outranked=self._outranked,
            leaps=judge.leaps,
            losses=judge.losses,
        )

    def _take(self, frames: list[Frame]) -> list[GnssFix]:
        fixes = []
        for frame in frames:
            fixes += self._told(self._solutions_of(frame))
        return fixes

    def _solutions_of(self, frame: Frame) -> list[Solution]:
        is_nmea = frame.protocol is Protocol.NMEA
        if not (nmea.is_read(frame.content) if is_nmea else ubx.is_solution(frame.content)):
            self._ignored += 1
            return []
        solutions = self._of_sentence(frame) if is_nmea else self._of_nav_pvt(frame)
        if solutions is None:
            self._unreadable += 1
            return []
        self._read += 1
        return solutions

    def _of_sentence(self, frame: Frame) -> list[Solution] | None:
        fields = nmea.parse(frame.content)
        if fields is None:
            return None
        return self._nmea(self._epochs.take(fields, frame.received_s))

    def _of_nav_pvt(self, frame: Frame) -> list[Solution] | None:
        solution = ubx.decode(frame.content, frame.received_s)
        if solution is None:
            return None
        self._ubx_s = frame.received_s
        self._solutions += 1
        return [solution]

    def _nmea(self, solutions: list[Solution]) -> list[Solution]:
        """Those that NAV-PVT does not tell better."""
        self._solutions += len(solutions)
        heard = [s for s in solutions if s.received_s - self._ubx_s > UBX_RANKS_FOR_S]
        self._outranked += len(solutions) - len(heard)
        return heard

    def _told(self, solutions: list[Solution]) -> list[GnssFix]:
        fixes = (self._judge.take(solution) for solution in solutions)
        return [fix for fix in fixes if fix is not None]
