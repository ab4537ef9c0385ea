"""What is gathered for and against each beam."""

import math
from collections.abc import Iterator

import pytest

from autonomy.config import BodyConfig
from autonomy.model import FusedState
from autonomy.perception.doubt.evidence import Witness
from hal.config import BeamsConfig
from hal.frames import wrap_pi
from hal.readings import RangeReading, RangeStatus

RATE_RAD_S = math.radians(60.0)


FREE = (RangeStatus.OUT_OF_RANGE, 1.0)


def looked_past(
    *said: tuple[RangeStatus, float], rate_hz: float = 20.0, rate_rad_s: float = RATE_RAD_S
) -> Iterator[float]:
    """The most that any beam has looked past, reading by reading of what the front beam says in
    turn; the others see nothing.
    """
    beams, body = BeamsConfig(), BodyConfig()
    witness = Witness(beams, body.radius_m, body.half_height_m)
    for tick in range(round(4.0 * rate_hz)):
        now_s = tick / rate_hz
        yaw_rad = wrap_pi(rate_rad_s * now_s)
        place = (0.0, 0.0, -1.4)
        fused = FusedState(
            now_s, place, (0.0, 0.0, 0.0), yaw_rad, 0.02, None, ok=True, yaw_rate_rad_s=rate_rad_s
        )
        front = said[tick % len(said)]
        readings = [
            RangeReading(
                now_s, mount.name, *(front if mount.name == "front" else FREE), 1e-4, 0.02, 1.0
            )
            for mount in beams.mounts
        ]
        witness.take(now_s, fused, readings)
        yield max(one.vanished for one in witness.beams(now_s))


def hit(range_m: float) -> tuple[RangeStatus, float]:
    return RangeStatus.VALID, range_m


def test_what_others_look_past_is_gone() -> None:
    *_, vanished = looked_past(hit(0.5), hit(0.51))
    assert vanished > 2.0


def test_what_a_beam_still_says_everywhere_is_not_gone_but_its_own_repetition() -> None:
    *_, vanished = looked_past(hit(0.5))
    assert vanished == 0.0


@pytest.mark.parametrize(("rate_hz", "turn_deg_s"), [(20.0, 60.0), (20.0, 40.0), (50.0, 60.0)])
def test_one_hit_is_gone_once_however_fast_the_sensor_is_for_the_turn(
    rate_hz: float, turn_deg_s: float
) -> None:
    once = [FREE] * round(4.0 * rate_hz)
    once[round(0.5 * rate_hz)] = hit(0.4)
    vanished = looked_past(*once, rate_hz=rate_hz, rate_rad_s=math.radians(turn_deg_s))
    assert max(vanished) == 1.0
