import inspect
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from autonomy.config import GuidanceConfig
from autonomy.t3drm.speed import (
    SpeedDecision,
    decide,
    free_volume_m3,
    speed_for_clearance,
    speed_limit_m_s,
    volume_rate_per_s,
)

CONFIG = GuidanceConfig(speed_max_m_s=0.2, speed_min_m_s=0.08, slow_below_m=0.25, slowest_at_m=0.17)


@pytest.mark.parametrize(
    ("clearance_m", "speed_m_s"),
    [(0.0, 0.08), (0.17, 0.08), (0.21, 0.14), (0.25, 0.2), (0.6, 0.2), (math.inf, 0.2)],
)
def test_the_speed_grows_with_the_clearance(clearance_m: float, speed_m_s: float) -> None:
    assert speed_for_clearance(clearance_m, CONFIG) == pytest.approx(speed_m_s)


def test_clear_by_exactly_the_slow_distance_is_the_maximum_to_the_last_bit() -> None:
    # 0.03 + (0.29 - 0.03) is not 0.29 in binary.
    config = GuidanceConfig(
        speed_max_m_s=0.29, speed_min_m_s=0.03, slow_below_m=0.25, slowest_at_m=0.17
    )
    assert speed_for_clearance(0.25, config) == 0.29


def test_two_flags_in_a_row_have_to_be_named() -> None:
    kinds = {name: p.kind for name, p in inspect.signature(speed_for_clearance).parameters.items()}
    assert kinds["receding"] is kinds["seen_free"] is inspect.Parameter.KEYWORD_ONLY


@pytest.mark.parametrize(
    ("clearance_m", "speed_m_s"), [(0.16, 0.08), (0.2, 0.125), (0.2099, 0.13985), (0.2101, 0.2)]
)
def test_receding_is_flown_at_the_maximum_where_there_is_room(
    clearance_m: float, speed_m_s: float
) -> None:
    assert speed_for_clearance(clearance_m, CONFIG, receding=True) == pytest.approx(speed_m_s)


def test_what_is_not_seen_or_not_known_is_not_flown_into() -> None:
    assert speed_for_clearance(1.0, CONFIG, receding=True, seen_free=False) == 0.0
    assert speed_for_clearance(math.nan, CONFIG) == 0.0


def test_the_dead_band_holds_a_noisy_rate_at_constant() -> None:
    assert decide(1.0, 0.02, dead_band=0.02) is SpeedDecision.ZERO
    assert decide(1.0, -0.02, dead_band=0.02) is SpeedDecision.ZERO
    assert decide(1.0, 0.021, dead_band=0.02) is SpeedDecision.MAXIMUM
    assert decide(1.0, -0.021, dead_band=0.02) is SpeedDecision.MINIMUM


def test_the_rate_decides_whether_the_drone_recedes() -> None:
    assert speed_limit_m_s(0.22, +0.3, CONFIG) == 0.2
    assert speed_limit_m_s(0.22, +0.1, CONFIG) < 0.2  # inside the dead band
    assert speed_limit_m_s(0.22, -0.3, CONFIG) == speed_for_clearance(0.22, CONFIG)


def test_the_volume_is_capped_at_the_sensors_range() -> None:
    assert free_volume_m3(5.0, 1.0) == pytest.approx(4.0 / 3.0 * math.pi)
    assert free_volume_m3(-0.1, 1.0) == 0.0
    assert volume_rate_per_s(1.0, 0.2, 1.0) == 0.0
    assert volume_rate_per_s(0.0, 0.2, 1.0) == 0.0


@pytest.mark.parametrize(
    ("clearance_m", "rate_m_s", "range_max_m", "rate_per_s"),
    [
        # 3 c^2 dc / c_max^3
        (1.0, 0.5, 2.0, 0.1875),
        (0.5, -0.2, 1.0, -0.15),
        (-0.5, 0.2, 1.0, 0.0),
        (2.0, 0.5, 2.0, 0.0),
    ],
)
def test_the_rate_is_a_share_of_the_full_volume(
    clearance_m: float, rate_m_s: float, range_max_m: float, rate_per_s: float
) -> None:
    assert volume_rate_per_s(clearance_m, rate_m_s, range_max_m) == pytest.approx(rate_per_s)


@given(st.floats(0.05, 0.95), st.floats(-1.0, 1.0))
def test_the_rate_is_the_derivative_of_the_volume(clearance_m: float, rate_m_s: float) -> None:
    dt = 1e-6
    full = free_volume_m3(1.0, 1.0)
    later, now = free_volume_m3(clearance_m + dt * rate_m_s, 1.0), free_volume_m3(clearance_m, 1.0)
    assert volume_rate_per_s(clearance_m, rate_m_s, 1.0) == pytest.approx(
        (later - now) / dt / full, abs=1e-4
    )


@given(st.floats(0.0, 3.0), st.booleans())
def test_the_speed_stays_between_its_limits(clearance_m: float, receding: bool) -> None:
    speed = speed_for_clearance(clearance_m, CONFIG, receding=receding)
    assert CONFIG.speed_min_m_s <= speed <= CONFIG.speed_max_m_s
