import math

import pytest

from autonomy.estimation.surfaces import WALK_M_PER_SQRT_S, Surface

GATE = 5.0


def test_levels_are_weighed_by_the_variances_of_surface_and_reading() -> None:
    surface, noise, variance, expected = Surface(GATE), 0.0025, 0.0025, 0.0
    surface.update(0.0, 0.0, noise)
    for tick in range(1, 4):
        variance += WALK_M_PER_SQRT_S**2
        gain = variance / (variance + noise)
        tested, step = surface.update(float(tick), 0.05, noise)
        ratio = (0.05 - expected) ** 2 / (GATE**2 * (variance + noise))
        assert (tested.fused, step) == (True, None)
        assert tested.test_ratio == pytest.approx(ratio)
        expected += gain * (0.05 - expected)
        variance *= 1.0 - gain
        assert surface.down_m == pytest.approx(expected)
        assert surface.sigma_m == pytest.approx(math.sqrt(variance))
