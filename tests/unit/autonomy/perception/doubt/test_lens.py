"""What lies inside the vehicle's own body is on the lens."""

import pytest

from autonomy.perception.doubt.lens import covered
from hal.config import BeamMount
from hal.readings import RangeReading, RangeStatus

RADIUS_M = 0.2
AT_CENTRE = BeamMount(name="front", yaw_deg=0.0)
AT_THE_RIM = BeamMount(name="left", yaw_deg=270.0, right_m=-0.15)


def reading(beam: str, range_m: float, status: RangeStatus) -> RangeReading:
    return RangeReading(1.0, beam, status, range_m, 1e-4, 0.02, 1.0)


@pytest.mark.parametrize(
    ("mount", "range_m", "status", "is_covered"),
    [
        (AT_CENTRE, 0.16, RangeStatus.VALID, True),
        (AT_CENTRE, 0.18, RangeStatus.VALID, False),
        (AT_CENTRE, 0.02, RangeStatus.TOO_NEAR, True),
        (AT_CENTRE, 0.3, RangeStatus.TOO_NEAR, True),
        (AT_CENTRE, 0.02, RangeStatus.NO_SIGNAL, False),
        (AT_CENTRE, 1.0, RangeStatus.OUT_OF_RANGE, False),
        (AT_THE_RIM, 0.01, RangeStatus.VALID, True),
        (AT_THE_RIM, 0.03, RangeStatus.VALID, False),
    ],
)
def test_what_is_measured_inside_the_body_or_too_near_to_measure_covers_a_lens(
    mount: BeamMount, range_m: float, status: RangeStatus, is_covered: bool
) -> None:
    newest = {mount.name: reading(mount.name, range_m, status)}
    assert covered((mount,), newest, RADIUS_M) == ((mount.name,) if is_covered else ())


def test_a_beam_that_was_not_heard_is_not_covered() -> None:
    assert covered((AT_CENTRE,), {}, RADIUS_M) == ()
