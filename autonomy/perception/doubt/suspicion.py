"""What a detector says."""

import msgspec

from autonomy.model import BeamWord


class Suspicion(msgspec.Struct, frozen=True):
    """What seems to be wrong with a beam, and the sentence that tells a person."""

    word: BeamWord
    why: str
