"""Stuck: the same value again and again, while the vehicle moves.

A vehicle at rest in front of a wall repeats a range rightly, with a coarse driver for minutes. So
a horizontal beam must have been turned by more than any surface keeps its distance for, an
upright one must have been moved along its axis; or it is quieter than itself has ever been.
"""

import math
from collections.abc import Sequence

from autonomy.model import BeamWord
from autonomy.perception.doubt import kernels
from autonomy.perception.doubt.evidence import BeamEvidence
from autonomy.perception.doubt.suspicion import Suspicion

_RUN_TURNING, _TURN_RAD = 16, math.radians(80.0)
"""A cone of 25 deg keeps the distance of a pillar for 65 deg of turning, a wall's for less."""
_TURN_NEAR_RAD = math.radians(120.0)
"""In a corner everything may be nearer than some sensors' least range, for a quarter of a turn."""
_RUN_MOVING, _MOVE_M = 12, 0.15
_RUN_QUIET, _TIMES_LONGEST, _FLOWN_MIN = 60, 4.0, 200
_RUN_TOO_QUIET, _NOISY_M = 200, 0.003
"""Drivers round to a centimetre: noise of 3 mm shows in so many readings."""
_LEAPS, _NO_FLOOR = 10, 10
_FROZEN_MIN, _VANISHED_MIN = 2, 2.0
_BLIND = 10
_AS_LONG = 0.9


def find_turning(evidence: BeamEvidence) -> Suspicion | None:
    """A horizontal beam that says one value all through a turn of 80 degrees; too near, of 120."""
    too_near = evidence.run_status == kernels.TOO_NEAR
    if not (too_near or evidence.run_status == kernels.VALID) or evidence.run < _RUN_TURNING:
        return None
    if evidence.run_turned_rad < (_TURN_NEAR_RAD if too_near else _TURN_RAD):
        return None
    said = "nothing but too near" if too_near else f"{evidence.run_value_m:.2f} m"
    turned_deg = math.degrees(evidence.run_turned_rad)
    return Suspicion(
        BeamWord.STUCK,
        f"it says {said} through a turn of {turned_deg:.0f} degrees",
        max(evidence.run_s, kernels.AGE_S),
    )


def frozen(evidence: Sequence[BeamEvidence]) -> bool:
    """True when beams are stuck, and all others have repeated themselves for as long.

    Nothing in range counts as repeating, too: in the open sound beams do so. Hence two must say
    a distance, or one that says nothing has looked past what was there before.
    """
    stuck = [one.run for one in evidence if find_turning(one) is not None]
    if not stuck or any(one.run < _AS_LONG * min(stuck) for one in evidence):
        return False
    return len(stuck) >= _FROZEN_MIN or any(one.vanished >= _VANISHED_MIN for one in evidence)


def floor_gone(evidence: Sequence[BeamEvidence]) -> bool:
    """True when the floor of the take-off was seen, is in reach, and is not seen any more.

    That may be the edge of a stage; with nothing in sight anywhere else it says that none sees.
    """
    return any(one.no_floor >= _NO_FLOOR for one in evidence)


def find_upright(evidence: BeamEvidence) -> Suspicion | None:
    """A beam up or down that does not follow the height, is too quiet, or misses the floor."""
    if evidence.stays >= _RUN_MOVING:
        same = evidence.run >= _RUN_MOVING
        word = BeamWord.STUCK if same else BeamWord.INCONSISTENT
        return Suspicion(word, "its range does not change when the height does")
    if evidence.blind >= _BLIND:
        return Suspicion(BeamWord.SATURATED, "it does not see the floor that the vehicle left")
    if evidence.leaps >= _LEAPS:
        why = "what it sees leapt, though the vehicle stayed where it was"
        return Suspicion(BeamWord.INCONSISTENT, why)
    return _find_too_quiet(evidence) if evidence.run_status == kernels.VALID else None


def _find_too_quiet(evidence: BeamEvidence) -> Suspicion | None:
    """The same value again, where the height changed, or its own noise should change it."""
    if evidence.run >= _RUN_MOVING and evidence.run_climbed_m >= _MOVE_M:
        moved = f"{evidence.run_climbed_m:.2f} m up or down"
        return Suspicion(BeamWord.STUCK, f"it says {evidence.run_value_m:.2f} m through {moved}")
    usual = max(_RUN_QUIET, _TIMES_LONGEST * evidence.longest_run)
    unusual = evidence.flown - evidence.run >= _FLOWN_MIN and evidence.run >= usual
    too_quiet = evidence.run >= _RUN_TOO_QUIET and evidence.claimed_m >= _NOISY_M
    if unusual or too_quiet:
        times = f"{evidence.run:.0f} times in a row"
        return Suspicion(BeamWord.STUCK, f"it says {evidence.run_value_m:.2f} m {times}")
    return None
