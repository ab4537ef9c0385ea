"""What a detector says."""

import msgspec

from autonomy.model import BeamWord
from autonomy.perception.doubt import kernels

LIED_S = 2.0 * kernels.FADE_S + kernels.AGE_S
"""Contradictions and copies that are older than this count less than one in seven: nobody is
accused because of them."""


class Suspicion(msgspec.Struct, frozen=True):
    """What seems to be wrong with a beam, and the sentence that tells a person."""

    word: BeamWord
    why: str
    lied_s: float = LIED_S
    """What the beam has shown for so long is not believed either: from then on the detector may
    have gathered what it found."""
