"""Below the minimum: what is nearer than the vehicle's own skin is on the lens."""

from collections.abc import Iterable, Mapping

from autonomy.model import BeamWord
from autonomy.perception.doubt import kernels
from autonomy.perception.doubt.evidence import BeamEvidence, inside_m
from autonomy.perception.doubt.suspicion import Suspicion
from hal.config import BeamMount
from hal.readings import RangeReading, RangeStatus

_LASTS_S = 0.5


def find(evidence: BeamEvidence) -> Suspicion | None:
    """Everything measured lies inside the body for half a second, in the air.

    On the ground a wide beam sees the floor as near.
    """
    if evidence.near_s < _LASTS_S:
        return None
    return Suspicion(
        BeamWord.TOO_NEAR,
        "it sees something nearer than the vehicle's own skin",
        max(evidence.near_s, kernels.AGE_S),
    )


def covered(
    thin: Iterable[BeamMount], newest: Mapping[str, RangeReading], body_radius_m: float
) -> tuple[str, ...]:
    """The names of those `thin` level beams that now see something inside the vehicle's body, or
    nearer than they can measure.

    On the ground, too: a thin level beam passes above the floor.
    """
    return tuple(
        mount.name
        for mount in thin
        if (reading := newest.get(mount.name)) is not None
        and (
            reading.status is RangeStatus.TOO_NEAR
            or (
                reading.status is RangeStatus.VALID
                and reading.range_m < inside_m(mount, body_radius_m)
            )
        )
    )
