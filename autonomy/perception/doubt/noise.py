"""Jumping, and cross-talk: values that do not fit to those beside them."""

from collections.abc import Sequence

from autonomy.model import BeamWord
from autonomy.perception.doubt.evidence import BeamEvidence
from autonomy.perception.doubt.suspicion import Suspicion

_NOISE_MIN_M = 0.1
"""What the map's means still bear."""
_TIMES_CLAIMED = 4.0
_TIMES_CLUTTER = 1.5
"""Among posts and gaps every sound beam's values jump, each when it looks there."""
_COPIES = 4.0
_SAME_SHARE, _SAME_SHARE_UPRIGHT, _SPREAD_M = 0.25, 0.9, 0.15


def find(
    evidence: BeamEvidence, names: Sequence[str], *, upright: bool, clutter_m: float
) -> Suspicion | None:
    """Half of its values jump by more than its noise; lone spikes are another beam's values.

    `clutter_m`: the most that any other level beam's values jumped within a turn.
    """
    if evidence.copies >= _COPIES:
        other = names[int(evidence.copies_of)]
        return Suspicion(BeamWord.CROSS_TALK, f"its jumps are what beam {other} measures")
    constant = evidence.same_share >= _SAME_SHARE_UPRIGHT and evidence.spread_m >= _SPREAD_M
    if upright and constant:
        return Suspicion(BeamWord.CROSS_TALK, f"it says what beam {_twin(evidence, names)} does")
    borne_m = max(_NOISE_MIN_M, _TIMES_CLAIMED * evidence.claimed_m, _TIMES_CLUTTER * clutter_m)
    if evidence.noise_m <= borne_m:
        return None
    if evidence.same_share >= _SAME_SHARE:
        twin = _twin(evidence, names)
        return Suspicion(BeamWord.CROSS_TALK, f"it jumps to what beam {twin} measures")
    noise, claimed = f"{evidence.noise_m * 100:.0f} cm", f"{evidence.claimed_m * 100:.1f} cm"
    return Suspicion(BeamWord.JUMPING, f"it jumps by {noise}, and claims {claimed}")


def _twin(evidence: BeamEvidence, names: Sequence[str]) -> str:
    return names[int(evidence.same_as)]
