"""Which beams are believed: detectors in, one word a beam out, and readings marked accordingly."""

import math
from collections import deque
from collections.abc import Iterable, Sequence

import msgspec

from autonomy.config import BodyConfig
from autonomy.model import BeamDoubt, BeamWord, FusedState
from autonomy.perception.doubt import constant, disagreement, kernels, lens, noise, silence
from autonomy.perception.doubt.evidence import BeamEvidence, Witness
from autonomy.perception.doubt.suspicion import Suspicion
from autonomy.perception.movers import Unrest
from hal.config import BeamMount, BeamsConfig
from hal.readings import RangeReading, RangeStatus

PERIOD_S = 0.2
"""How often the detectors look."""
_RECOVERS_S = {
    BeamWord.STALE: 0.0,
    BeamWord.NO_SIGNAL: 0.0,
    BeamWord.TOO_NEAR: 1.0,
}
_RECOVERS_LATE_S = 3.0
_AGREEMENTS, _AGAINST = 12.0, 0.05
"""About so many places it must agree with the others, and hardly contradict them."""
_AGREEMENTS_EACH, _BEAR_OUT_MIN = 4.0, 2
"""While none of the others is believed: so often with each of so many."""
_RECOVERY_MAX_S = 60.0
_UNHEARD = (BeamWord.STALE, BeamWord.NO_SIGNAL)
_PROVEN_ANEW = (BeamWord.SATURATED, BeamWord.STUCK, BeamWord.INCONSISTENT, BeamWord.CROSS_TALK)
_QUIET_ANEW = (BeamWord.JUMPING, BeamWord.CROSS_TALK)
"""They must have measured enough to show their noise."""
FLYING_M = 0.3
_NEAR_M = 0.05
_SAME_HEIGHT_M = 0.12
_TURN_S = 6.0
"""Within it every level beam has looked everywhere."""
_STALL_S = 0.5
"""A loop that comes later than this did not listen meanwhile: silence then says nothing."""


class _Beam:
    """One beam's word, and how it got it."""

    def __init__(self, index: int, mount: BeamMount) -> None:
        self.index, self.mount = index, mount
        self.doubt: BeamDoubt | None = None
        self.clean_since_s: float | None = None
        self.times = 0
        self.jumped_m: deque[float] = deque(maxlen=round(_TURN_S / PERIOD_S))
        """By how much its values jumped, look by look."""


class Doubt:
    """Owns the evidence; `judge` marks a tick's readings, `learn` takes them in as they came.

    Pure and deterministic: no clock, no randomness; same calls, same words.
    """

    def __init__(self, beams: BeamsConfig, body: BodyConfig, *, thorough: bool = True) -> None:
        """Not `thorough`: only beams that measure nothing are doubted."""
        self._config = beams
        self._thorough = thorough
        self._witness = Witness(beams, body.radius_m, body.half_height_m)
        self._listening_since_s = self._last_s = -math.inf
        self._names = [mount.name for mount in beams.mounts]
        self._beams = [_Beam(index, mount) for index, mount in enumerate(beams.mounts)]
        self._by_name = {beam.mount.name: beam for beam in self._beams}
        self._looked_s: float | None = None
        self._began_at_m: float | None = None
        self._changed_height = False
        self._denied: frozenset[str] = frozenset()
        self._moves = False
        self._near_m = body.radius_m + _NEAR_M
        self.doubts: tuple[BeamDoubt, ...] = ()
        """The beams that are not believed, in the order of their mounts."""
        self.disputed: tuple[int, ...] = ()
        """Mounts whose beams lately showed as free what another beam hits now."""
        self.lied_since_s: float | None = None
        """Set for one step: what horizontal beams showed since then may have been wrong."""

    # ------------------------------------------------------------ readings

    def judge(self, ranges: tuple[RangeReading, ...]) -> tuple[RangeReading, ...]:
        """The readings as they may be used; the very same tuple while every beam is believed.

        Of a beam that is not believed a reading is SUSPECT (not when it was only silent: what it
        measures again is true); a near one of a horizontal beam is
        NO_SIGNAL, since a doubted "near" still holds the guard back, at every bearing in turn.
        SUSPECT is, of any beam, what was learned last and looks right through what another beam
        has just hit: one "free" does not wipe out a hit, two do.
        """
        if not self.doubts and not self._denied:
            return ranges
        return tuple(self._marked(reading) for reading in ranges)

    def _marked(self, reading: RangeReading) -> RangeReading:
        beam = self._by_name.get(reading.beam)
        if reading.beam in self._denied and reading.status is not RangeStatus.NO_SIGNAL:
            return msgspec.structs.replace(reading, status=RangeStatus.SUSPECT)
        if beam is None or beam.doubt is None or beam.doubt.word in _UNHEARD:
            return reading
        if reading.status is RangeStatus.NO_SIGNAL:
            return reading
        if beam.mount.horizontal and reading.range_m < self._near_m:
            unknown_m2 = reading.max_m * reading.max_m / 12.0
            return msgspec.structs.replace(
                reading, status=RangeStatus.NO_SIGNAL, range_m=0.0, variance_m2=unknown_m2
            )
        return msgspec.structs.replace(reading, status=RangeStatus.SUSPECT)

    # ------------------------------------------------------------ words

    def learn(
        self,
        now_s: float,
        fused: FusedState,
        ranges: Iterable[RangeReading],
        moving: Sequence[Unrest] = (),
    ) -> None:
        """Take in a tick's readings as the drivers gave them; `now_s` must not run backwards.

        What the beams contradict each other in where something is `moving` accuses none of them.
        """
        self.lied_since_s = None
        if now_s - self._last_s > _STALL_S:
            self._listening_since_s = now_s
        self._last_s = now_s
        self._moves = bool(moving)
        self._witness.explain(moving)
        self._witness.take(now_s, fused, ranges)
        denied = self._witness.denied if self._thorough else ()
        self.disputed = self._witness.disputed if self._thorough else ()
        self._denied = frozenset(self._names[index] for index in denied)
        if self._looked_s is not None and now_s - self._looked_s < PERIOD_S - 1e-6:
            return
        self._looked_s = now_s
        evidence = self._witness.beams(now_s)
        flying = self._flying(fused)
        for beam in self._beams:
            beam.jumped_m.append(evidence[beam.index].noise_m)
        if self._thorough and flying and constant.frozen(evidence):
            why = "all beams repeat themselves"
            self._doubt_all(now_s, self._trusted(), Suspicion(BeamWord.STUCK, why))
        for beam in self._beams:
            self._update(beam, now_s, evidence[beam.index], flying=flying)
        if self._thorough:
            self._compare(now_s, evidence)
        doubts = tuple(beam.doubt for beam in self._beams if beam.doubt is not None)
        if doubts != self.doubts:
            self.doubts = doubts

    def _flying(self, fused: FusedState) -> bool:
        """Off the ground; notes the height that the flight began at, and when it is left.

        At another height the vehicle may be just above a wall: that ends for all beams at once.
        """
        height_m = -fused.position_ned_m[2]
        if height_m <= FLYING_M:
            return False
        if self._began_at_m is None:
            if abs(fused.velocity_ned_m_s[2]) < kernels.CLIMBING_M_S:
                self._began_at_m = height_m
        else:
            self._changed_height = abs(height_m - self._began_at_m) > _SAME_HEIGHT_M
        return True

    def _update(self, beam: _Beam, now_s: float, evidence: BeamEvidence, *, flying: bool) -> None:
        found = self._suspicion(beam, now_s, evidence, flying=flying)
        if found is not None:
            beam.clean_since_s = None
            if beam.doubt is None or _more_telling(found, beam.doubt):
                self._doubt(beam, now_s, found, self._since(now_s, found, evidence))
            return
        if beam.doubt is None:
            return
        if beam.clean_since_s is None:
            beam.clean_since_s = now_s
        if self._borne_out(beam, now_s - beam.clean_since_s, evidence):
            beam.doubt = None
            self._witness.believe(beam.index, trusted=True)

    def _suspicion(
        self, beam: _Beam, now_s: float, evidence: BeamEvidence, *, flying: bool
    ) -> Suspicion | None:
        """What the beam's own readings say against it."""
        upright = not beam.mount.horizontal
        found = silence.find(evidence, self._config.stale_after_s, now_s - self._listening_since_s)
        if not self._thorough:
            return found
        if found is None and flying:
            found = lens.find(evidence)
        if found is None and flying:
            clutter_m = 0.0 if upright else self._clutter_m(beam)
            found = noise.find(evidence, self._names, upright=upright, clutter_m=clutter_m)
        if found is None and flying:
            check = constant.find_upright if upright else constant.find_turning
            found = check(evidence)
        return found

    def _clutter_m(self, beam: _Beam) -> float:
        """The most that the values of another level beam jumped within a turn.

        Doubted ones count, too: who looked among the posts first is doubted until a second one has.
        """
        return max(
            (
                max(other.jumped_m)
                for other in self._beams
                if other is not beam and other.mount.horizontal
            ),
            default=0.0,
        )

    def _since(self, now_s: float, found: Suspicion, evidence: BeamEvidence) -> float:
        """Silence began with the last measurement, as far as this program listened since."""
        if found.word not in _UNHEARD:
            return now_s
        return max(now_s - evidence.unmeasured_s, self._listening_since_s)

    def _doubt(
        self, beam: _Beam, now_s: float, found: Suspicion, began_s: float | None = None
    ) -> None:
        since_s = now_s if began_s is None else began_s
        if beam.doubt is not None:
            since_s = beam.doubt.since_s
        if beam.doubt is None and found.word not in _UNHEARD:
            beam.times += 1
        beam.doubt = BeamDoubt(beam.mount.name, found.word, since_s, found.why)
        beam.clean_since_s = None
        self._witness.believe(beam.index, trusted=False)
        if found.word in _UNHEARD:
            return
        self._witness.forget(beam.index)
        if beam.mount.horizontal:
            lied_since_s = now_s - found.lied_s - PERIOD_S
            known_s = math.inf if self.lied_since_s is None else self.lied_since_s
            self.lied_since_s = min(lied_since_s, known_s)

    def _borne_out(self, beam: _Beam, clean_s: float, evidence: BeamEvidence) -> bool:
        """The rule of recovery: clean for a time that doubles with every doubt, and, where it had
        contradicted the others or the motion, agreeing with them again.
        """
        if beam.doubt is None:
            return True
        word = beam.doubt.word
        need_s = _RECOVERS_S.get(word, _RECOVERS_LATE_S)
        if word not in _UNHEARD:
            need_s = min(_RECOVERY_MAX_S, need_s * 2.0 ** (beam.times - 1))
        if clean_s < need_s:
            return False
        if word in _QUIET_ANEW and evidence.noise_m <= 0.0:
            return False
        if word not in _PROVEN_ANEW:
            return True
        if not beam.mount.horizontal:
            return evidence.follows > 0.0 or evidence.run < 3.0
        return self._agrees(beam)

    def _agrees(self, beam: _Beam) -> bool:
        """True when the beams that are believed bear this one out.

        Where none is believed, two of the others must, whose own readings are clean again: what
        three see alike at the same places is there, and a beam that sees nothing agrees with none.
        """
        believed = self._trusted()
        others = believed or self._clean_but(beam)
        pairs = [self._witness.pair(beam.index, other) for other in others]
        against = sum(pair[0] for pair in pairs)
        in_favour = sum(pair[1] for pair in pairs)
        bear_out = sum(pair[1] >= _AGREEMENTS_EACH for pair in pairs)
        if not believed and bear_out < _BEAR_OUT_MIN:
            return False
        return in_favour >= _AGREEMENTS and against <= _AGAINST * in_favour

    def _clean_but(self, beam: _Beam) -> list[int]:
        """Level beams that are doubted, though their own readings say nothing against them now."""
        return [
            other.index
            for other in self._beams
            if other is not beam and other.mount.horizontal and other.clean_since_s is not None
        ]

    def _trusted(self) -> list[int]:
        return [beam.index for beam in self._beams if beam.mount.horizontal and beam.doubt is None]

    # ------------------------------------------------------------ one against the others

    def _compare(self, now_s: float, evidence: tuple[BeamEvidence, ...]) -> None:
        pairs, trusted = self._witness.pairs(), self._trusted()
        heard = [evidence[index] for index in trusted]
        since_hit_s = min((one.unhit_s for one in heard), default=0.0)
        if since_hit_s >= disagreement.EMPTY_S and self._no_floor(evidence):
            why = "no beam sees anything, not even the floor that was there"
            self._doubt_all(now_s, trusted, Suspicion(BeamWord.SATURATED, why))
            return
        gone = disagreement.nothing_any_more(since_hit_s, heard)
        if gone and not self._changed_height and not self._something_left():
            why = "no beam sees anything any more, where all of them saw something"
            self._doubt_all(now_s, trusted, Suspicion(BeamWord.SATURATED, why))
            return
        if since_hit_s > disagreement.EMPTY_S:
            return
        found = disagreement.single_out(pairs, trusted)
        if found is not None:
            index, *others = found
            witnesses = " and ".join(self._names[other] for other in others)
            what = disagreement.named(evidence[index], witnesses, self._names)
            self._doubt(self._beams[index], now_s, what)
        elif disagreement.all_at_odds(pairs, trusted):
            why = "all beams contradict each other"
            self._doubt_all(now_s, trusted, Suspicion(BeamWord.INCONSISTENT, why))

    def _something_left(self) -> bool:
        """True when all that is gone was in one direction, where things move: it may have left.

        Where nothing was seen to move, what stood there stands there.
        """
        return self._moves and self._witness.gone_one_way > disagreement.ONE_WAY

    def _no_floor(self, evidence: tuple[BeamEvidence, ...]) -> bool:
        """True while a beam that looks down says that the floor it left is not there."""
        return constant.floor_gone(evidence) or any(
            beam.mount.pitch_deg < 0.0 and not beam.mount.horizontal
            for beam in self._beams
            if beam.doubt is not None and beam.doubt.word is BeamWord.SATURATED
        )

    def _doubt_all(self, now_s: float, trusted: list[int], found: Suspicion) -> None:
        for index in trusted:
            self._doubt(self._beams[index], now_s, found)


def _more_telling(found: Suspicion, doubt: BeamDoubt) -> bool:
    """A beam that lied and falls silent is silent; the other way round it is worse than silent."""
    return doubt.word in _UNHEARD and found.word is not doubt.word
