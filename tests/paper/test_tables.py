"""Tables 1, 2 and 3, row by row."""

import math
from typing import Any

import pytest
from pydantic import ValidationError

from autonomy.config import AltitudeGains, PositionGains, VelocityGains
from autonomy.t3drm.direction import Direction, direction_of, pair_of
from autonomy.t3drm.ricci import normalised_flow_signs
from autonomy.t3drm.speed import SpeedDecision, decide, free_volume_m3

TABLE_1 = [
    # direction, displacement (forward, right, down), printed pair of signs
    (Direction.FRONT, (1.0, 0.0, 0.0), (1, 1)),
    (Direction.BACK, (-1.0, 0.0, 0.0), (-1, -1)),
    (Direction.RIGHT, (0.0, 1.0, 0.0), (1, -1)),
    (Direction.LEFT, (0.0, -1.0, 0.0), (-1, 1)),
    (Direction.UP, (0.0, 0.0, -1.0), (0, 1)),
    (Direction.DOWN, (0.0, 0.0, 1.0), (0, -1)),
]


@pytest.mark.parametrize(("direction", "displacement", "signs"), TABLE_1)
def test_table_1(
    direction: Direction, displacement: tuple[float, float, float], signs: tuple[int, int]
) -> None:
    assert pair_of(displacement).signs == signs
    assert direction_of(displacement) is direction


TABLE_2 = [
    # dV, sign pair of Eq. 7, speed
    (+0.1, (-1.0, -1.0), SpeedDecision.MAXIMUM),
    (-0.1, (1.0, 1.0), SpeedDecision.MINIMUM),
    (0.0, (0.0, 0.0), SpeedDecision.ZERO),
]


@pytest.mark.parametrize(("rate", "signs", "decision"), TABLE_2)
def test_table_2(rate: float, signs: tuple[float, float], decision: SpeedDecision) -> None:
    assert normalised_flow_signs(0.5, rate, 3) == signs
    assert decide(free_volume_m3(0.5, 1.0), rate) is decision


@pytest.mark.parametrize(
    ("volume", "rate"), [(0.0, 1.0), (-1.0, 1.0), (math.nan, 1.0), (1.0, math.nan), (1.0, math.inf)]
)
def test_table_2_everything_else_is_zero(volume: float, rate: float) -> None:
    assert decide(volume, rate) is SpeedDecision.ZERO


TABLE_3 = [
    (PositionGains, "kp", 100.0),
    (PositionGains, "ki", 1.0),
    (PositionGains, "kd", 10.0),
    (AltitudeGains, "kp", 10.0),
    (AltitudeGains, "ki", 1.0),
    (AltitudeGains, "kd", 10.0),
    (VelocityGains, "kp", 10.0),
    (VelocityGains, "ki", 1.0),
    (VelocityGains, "kd", 10.0),
]


@pytest.mark.parametrize(("gains", "name", "highest"), TABLE_3)
def test_table_3(gains: Any, name: str, highest: float) -> None:
    for allowed in (0.0, highest):
        assert getattr(gains(**{name: allowed}), name) == allowed
    for refused in (math.nextafter(highest, math.inf), -1e-9):
        with pytest.raises(ValidationError):
            gains(**{name: refused})
