"""Inconsistent: what one beam says of a place contradicts what the others said of it.

The turning vehicle looks at every place with every horizontal beam. Two that contradict each
other prove only that one of them is wrong, or that something moved; a beam that contradicts two
others which agree is the one.
"""

from collections.abc import Sequence

from autonomy.model import BeamWord
from autonomy.perception.doubt import kernels
from autonomy.perception.doubt.evidence import BeamEvidence
from autonomy.perception.doubt.suspicion import Suspicion

CONTRADICTIONS_MIN = 4.0
_SHARE = 0.2
_CLEARLY = 3.0
"""The witnesses contradict each other at least so much less."""
_ALL_SHARE = 0.6
_EMPTY_SHARE, _SAME_SHARE, _RUN = 0.9, 0.6, 12
EMPTY_S = 0.8
"""So long no beam hits anything: what they contradict each other in is gone for all of them."""
ONE_WAY = 0.93
"""Mean length of unit vectors: a thing that fills less than 75 degrees of the view."""
_VANISHED_MIN, _LOOKED_PAST_MIN = 2.0, 2

Pairs = Sequence[Sequence[Sequence[float]]]


def contradict(pairs: Pairs, one: int, other: int, share: float = _SHARE) -> bool:
    """True when two beams contradict each other about more than noise explains."""
    against, in_favour = pairs[one][other]
    return against >= CONTRADICTIONS_MIN and against >= share * (against + in_favour)


def single_out(pairs: Pairs, trusted: Sequence[int]) -> tuple[int, int, int] | None:
    """(the beam, its two witnesses): contradicts two of `trusted` that bear each other out.

    The one with the most contradictions where several could be meant; None for none.
    """
    found: tuple[float, tuple[int, int, int]] | None = None
    for beam in trusted:
        others = [other for other in trusted if other != beam and contradict(pairs, beam, other)]
        for i, one in enumerate(others):
            for other in others[i + 1 :]:
                weight = min(pairs[beam][one][0], pairs[beam][other][0])
                if pairs[one][other][0] * _CLEARLY > weight:
                    continue
                if found is None or weight > found[0]:
                    found = (weight, (beam, one, other))
    return None if found is None else found[1]


def all_at_odds(pairs: Pairs, trusted: Sequence[int]) -> bool:
    """True when every two of at least three beams contradict each other about most places."""
    couples = [(a, b) for a in trusted for b in trusted if a < b]
    return len(trusted) > 2 and all(contradict(pairs, a, b, _ALL_SHARE) for a, b in couples)


def named(evidence: BeamEvidence, witnesses: str, names: Sequence[str]) -> Suspicion:
    """What kind of contradiction it is, from how the beam's values look."""
    if evidence.empty_share >= _EMPTY_SHARE:
        why = f"it says that nothing is there, where {witnesses} see something"
        return Suspicion(BeamWord.SATURATED, why)
    if evidence.run_status == kernels.VALID and evidence.run >= _RUN:
        why = f"it says {evidence.run_value_m:.2f} m everywhere, where {witnesses} see other things"
        return Suspicion(BeamWord.STUCK, why)
    if evidence.same_share >= _SAME_SHARE:
        twin = names[int(evidence.same_as)]
        return Suspicion(BeamWord.CROSS_TALK, f"it says what beam {twin} measures elsewhere")
    return Suspicion(BeamWord.INCONSISTENT, f"it contradicts {witnesses} about the same places")


def nothing_any_more(since_hit_s: float, evidence: Sequence[BeamEvidence]) -> bool:
    """True when several believed beams looked past what was seen a moment ago, and none has seen
    anything since.
    """
    looked_past = sum(one.vanished >= _VANISHED_MIN for one in evidence)
    return since_hit_s >= EMPTY_S and looked_past >= _LOOKED_PAST_MIN
