"""What is gathered for and against each beam."""

import math

from autonomy.config import BodyConfig
from autonomy.model import FusedState
from autonomy.perception.doubt.evidence import Witness
from hal.config import BeamsConfig
from hal.frames import wrap_pi
from hal.readings import RangeReading, RangeStatus

RATE_RAD_S = math.radians(60.0)
TICK_S = 0.05


def vanished(*said_m: float) -> float:
    """What the others looked past, of what the front beam says in turn; they see nothing."""
    beams, body = BeamsConfig(), BodyConfig()
    witness = Witness(beams, body.radius_m, body.half_height_m)
    for tick in range(80):
        now_s = tick * TICK_S
        yaw_rad = wrap_pi(RATE_RAD_S * now_s)
        place = (0.0, 0.0, -1.4)
        fused = FusedState(
            now_s, place, (0.0, 0.0, 0.0), yaw_rad, 0.02, None, ok=True, yaw_rate_rad_s=RATE_RAD_S
        )
        free = (RangeStatus.OUT_OF_RANGE, 1.0)
        hit = (RangeStatus.VALID, said_m[tick % len(said_m)])
        readings = [
            RangeReading(
                now_s, mount.name, *(hit if mount.name == "front" else free), 1e-4, 0.02, 1.0
            )
            for mount in beams.mounts
        ]
        witness.take(now_s, fused, readings)
    return max(one.vanished for one in witness.beams(now_s))


def test_what_others_look_past_is_gone() -> None:
    assert vanished(0.5, 0.51) > 2.0


def test_what_a_beam_still_says_everywhere_is_not_gone_but_its_own_repetition() -> None:
    assert vanished(0.5) == 0.0
