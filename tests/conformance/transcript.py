"""What a vehicle said and did in a sequence, beside what PX4 was measured to say and do.

The golden transcripts are tests/golden/px4/sequences.json. Each entry of `seen` is
`[time, channel, what, options]`; time is the autopilot's, counted from the sequence's zero, and
within each channel the order counts. Whole numbers that depend on the place are `#`.
"""

import json
import math
import re
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

GOLDEN = Path(__file__).parents[1] / "golden" / "px4"

CHANNELS = ("ack", "text", "event", "heartbeat", "mode", "landed")
TOLERANCE_S = {
    "ack": 0.06,  # measured 1-16 ms
    "text": 0.25,  # one text per 50 ms on the wire
    "event": 0.15,
    "heartbeat": 1.15,  # strictly 1 Hz, its phase is chance
    "mode": 2.3,  # CURRENT_MODE, 0.5 Hz
    "landed": 0.35,  # EXTENDED_SYS_STATE, 5 Hz
}
"""How far the time of an entry may be off when it does not say otherwise."""


class Options(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How strictly an entry is taken."""

    tolerance: float | None = None
    brief: bool = False
    """A state too short to be seen for certain in a periodic message."""
    since: str = ""
    """Timed against the text or event with these words, not against zero."""


_PLAIN = Options()


class Expected(msgspec.Struct, frozen=True, array_like=True):
    """One line of a golden transcript."""

    at_s: float
    channel: str
    what: str
    options: Options = _PLAIN

    @property
    def tolerance_s(self) -> float:
        """How far the time may be off."""
        given = self.options.tolerance
        return TOLERANCE_S[self.channel] if given is None else given

    def matches(self, what: str) -> bool:
        """True for the same words, whatever the numbers."""
        pattern = re.escape(self.what).replace(r"\#", r"\d+")
        return re.fullmatch(pattern, what) is not None


class Sequence(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A stimulus and what follows. `play` is a list of [time, verb, arguments ...]."""

    name: str
    start: str
    for_s: float
    play: list[list[Any]]
    seen: list[Expected]
    about: str = ""
    needs: list[str] = []
    parameters: dict[str, float] = {}


class Seen(NamedTuple):
    """One thing the vehicle said or did."""

    at_s: float
    channel: str
    what: str


class Row(NamedTuple):
    """One comparison; `measured_s` or `seen_s` is NaN for what was missing or surplus."""

    channel: str
    what: str
    measured_s: float
    seen_s: float
    tolerance_s: float

    @property
    def share(self) -> float:
        """How much of the tolerance was used; inf for missing or surplus."""
        off = abs(self.seen_s - self.measured_s)
        return math.inf if math.isnan(off) else off / self.tolerance_s

    def __str__(self) -> str:
        if math.isnan(self.seen_s):
            return f"{self.measured_s:8.2f}        -  {self.channel:9} {self.what!r} did not come"
        if math.isnan(self.measured_s):
            return f"       - {self.seen_s:8.2f}  {self.channel:9} {self.what!r} was not measured"
        return (
            f"{self.measured_s:8.2f} {self.seen_s:8.2f}  {self.channel:9} {self.what!r}"
            f" (within {self.tolerance_s:g} s)"
        )


def sequences() -> list[Sequence]:
    """Every golden sequence."""
    text = (GOLDEN / "sequences.json").read_text()
    return msgspec.convert(json.loads(text)["sequences"], list[Sequence])


def compare(expected: list[Expected], seen: list[Seen]) -> list[Row]:
    """Every golden entry beside what was seen of it, channel by channel, in order."""
    rows: list[Row] = []
    for channel in CHANNELS:
        theirs = [e for e in expected if e.channel == channel]
        ours = [s for s in seen if s.channel == channel]
        rows += _align(theirs, ours, expected, seen)
    return rows


def _align(
    theirs: list[Expected], ours: list[Seen], expected: list[Expected], seen: list[Seen]
) -> list[Row]:
    rows, next_ours = [], 0
    for entry in theirs:
        shift_s = _shift(entry.options.since, expected, seen)
        found = next(
            (i for i in range(next_ours, len(ours)) if _is_it(entry, ours[i], shift_s)), None
        )
        if found is None:
            if not entry.options.brief:
                rows.append(Row(entry.channel, entry.what, entry.at_s, math.nan, entry.tolerance_s))
            continue
        rows += [_surplus(s) for s in ours[next_ours:found]]
        next_ours = found + 1
        at_s = ours[found].at_s - shift_s
        rows.append(Row(entry.channel, ours[found].what, entry.at_s, at_s, entry.tolerance_s))
    return rows + [_surplus(s) for s in ours[next_ours:]]


def _is_it(entry: Expected, seen: Seen, shift_s: float) -> bool:
    """What may be missing is only itself at its time; else the same words could come later."""
    near = abs(seen.at_s - shift_s - entry.at_s) <= entry.tolerance_s
    return entry.matches(seen.what) and (near or not entry.options.brief)


def _surplus(seen: Seen) -> Row:
    return Row(seen.channel, seen.what, math.nan, seen.at_s, math.inf)


def _shift(anchor: str, expected: list[Expected], seen: list[Seen]) -> float:
    """How much later than measured the anchor came."""
    if not anchor:
        return 0.0
    measured = next(e.at_s for e in expected if anchor in e.what)
    came = next((s.at_s for s in seen if anchor in s.what), measured)
    return came - measured
