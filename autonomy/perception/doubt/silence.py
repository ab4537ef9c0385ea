"""Stale, and no signal: a beam that says nothing about space."""

from autonomy.model import BeamWord
from autonomy.perception.doubt.evidence import BeamEvidence
from autonomy.perception.doubt.suspicion import Suspicion

_LOST_SHARE = 0.6
_HEARD_MIN = 8
_HEARD_RARELY = 6
"""In the second and a half that evidence looks back."""
_WHILE_S = 1.6


def find(evidence: BeamEvidence, stale_after_s: float, listened_s: float) -> Suspicion | None:
    """Nothing heard for `stale_after_s`; nothing measured for as long, or seldom.

    `listened_s`: how long this program has been listening without a break.
    """
    if evidence.age_s > stale_after_s:
        return Suspicion(BeamWord.STALE, "nothing was heard of it")
    if min(evidence.unmeasured_s, listened_s) > stale_after_s:
        return Suspicion(BeamWord.NO_SIGNAL, "it answers, but cannot measure")
    if listened_s > _WHILE_S and evidence.heard < _HEARD_RARELY:
        return Suspicion(BeamWord.STALE, "it is hardly ever heard")
    if evidence.heard >= _HEARD_MIN and evidence.lost_share > _LOST_SHARE:
        share = f"{evidence.lost_share:.0%}"
        return Suspicion(BeamWord.NO_SIGNAL, f"{share} of its readings measure nothing")
    return None
