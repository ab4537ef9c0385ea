"""Below the minimum: what is nearer than the vehicle's own skin is on the lens."""

from autonomy.model import BeamWord
from autonomy.perception.doubt.evidence import BeamEvidence
from autonomy.perception.doubt.suspicion import Suspicion

_LASTS_S = 0.5


def find(evidence: BeamEvidence) -> Suspicion | None:
    """Everything measured lies inside the body for half a second, in the air.

    On the ground a wide beam sees the floor as near.
    """
    if evidence.near_s < _LASTS_S:
        return None
    return Suspicion(BeamWord.TOO_NEAR, "it sees something nearer than the vehicle's own skin")
