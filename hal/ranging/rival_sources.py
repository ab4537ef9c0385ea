"""Several sources for one beam: which of them is believed.

A source is who measures: (component, message, sensor id). The rule, in this order:

1. PX4 repeats what a companion sends it, under its own name, later and thinned out, and makes a
   ring of all it knows. What the autopilot says is an echo, and dropped, when a source that it may
   have it from said the same within the last second. Not once it has said, several times in a
   row, what nobody else did: then it measures itself, and what it sees must not be hidden because
   another has just said the same by chance.
2. The nearest return counts, and any return more than "nothing there"; of two that see nothing,
   the one that sees farther. So no source can hide what another one sees.
3. What a source sent before what it said last is late, and so is what a leap of its clock brings
   (`hal.boot_clock`).
4. A source counts for `fresh_s` after its newest reading. One that is silent, or says that it could
   not measure, overrules nobody; "no signal" passes when no other fresh source measures.
"""

from collections import deque
from enum import StrEnum

import msgspec

from hal.boot_clock import SendingOrder
from hal.readings import RangeReading, RangeStatus

AUTOPILOT = 1  # MAV_COMP_ID_AUTOPILOT1
ECHO_S = 1.0
"""So much later an echo may come at most."""
MOST_SOURCES = 8
"""For one beam; the one heard longest ago is forgotten. Bounded against made-up ids."""
_REMEMBERED = 40
_OWN_WORDS = 5
"""Of a sensor of its own: an echo has nothing to say that was not said (lost messages apart)."""
_SAME_M = 0.015  # the echo was a float for a while, and truncated
_SAME_IN_A_RING_M = 0.05


class Source(msgspec.Struct, frozen=True):
    """Who measures; `ring` for OBSTACLE_DISTANCE, which has no sensor id."""

    component_id: int
    sensor_id: int = 0
    ring: bool = False


class Verdict(StrEnum):
    """What becomes of a reading."""

    BELIEVED = "believed"
    ECHO = "echo"
    OVERRULED = "overruled"
    LATE = "late"


class RivalSources:
    """The sources of one beam; `judge` every reading of each."""

    def __init__(self, fresh_s: float) -> None:
        self._fresh_s = fresh_s
        self._heard: dict[Source, deque[tuple[float, RangeReading]]] = {}
        """What each source said lately, with its reception; least recently heard first."""
        self._order: dict[Source, SendingOrder] = {}
        self._own_words: dict[Source, int] = {}
        """Of the autopilot's sources: how often in a row each said what nobody else did."""

    def judge(
        self, source: Source, reading: RangeReading, now_s: float, sent_s: float = 0.0
    ) -> Verdict:
        """Whether `reading`, sent at `sent_s` by the source's clock, is passed on at `now_s`."""
        if self._is_echo(source, reading, now_s):
            return Verdict.ECHO
        if not self._order.setdefault(source, SendingOrder()).keeps(now_s, sent_s):
            return Verdict.LATE
        own = self._heard.pop(source, None) or deque(maxlen=_REMEMBERED)
        own.append((now_s, reading))
        rivals = [r for r in self._newest(now_s) if r.status is not RangeStatus.NO_SIGNAL]
        self._heard[source] = own
        if len(self._heard) > MOST_SOURCES:
            forgotten = next(iter(self._heard))
            del self._heard[forgotten], self._order[forgotten]
        if any(_rank(rival) < _rank(reading) for rival in rivals):
            return Verdict.OVERRULED
        return Verdict.BELIEVED

    def _is_echo(self, source: Source, reading: RangeReading, now_s: float) -> bool:
        own_words = self._own_words.get(source, 0)
        if source.component_id != AUTOPILOT or own_words >= _OWN_WORDS:
            return False
        said = self._was_said(source, reading, now_s)
        self._own_words[source] = 0 if said else own_words + 1
        return said

    def _was_said(self, source: Source, reading: RangeReading, now_s: float) -> bool:
        """True when a source that this one may repeat said the same a moment ago."""
        same_m = _SAME_IN_A_RING_M if source.ring else _SAME_M
        return any(
            told.status is reading.status and abs(told.range_m - reading.range_m) <= same_m
            for original, said in self._heard.items()
            if original.component_id != AUTOPILOT or (source.ring and not original.ring)
            for heard_s, told in said
            if now_s - heard_s < ECHO_S
        )

    def _newest(self, now_s: float) -> list[RangeReading]:
        """The newest reading of each source that is fresh."""
        newest = [said[-1] for said in self._heard.values()]
        return [reading for heard_s, reading in newest if now_s - heard_s < self._fresh_s]


def _rank(reading: RangeReading) -> tuple[int, float]:
    """The less, the more it counts: returns by nearness, free by sight, no signal last."""
    match reading.status:
        case RangeStatus.NO_SIGNAL:
            return 2, 0.0
        case RangeStatus.OUT_OF_RANGE:
            return 1, -reading.max_m
        case _:
            return 0, reading.range_m
