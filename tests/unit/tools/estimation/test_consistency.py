import numpy as np
import pytest

from tools.estimation.consistency import Series, consistency


@pytest.fixture(scope="module")
def series() -> dict[str, Series]:
    return {each.name: each for each in consistency(runs=30, seconds=6.0, seed=1)}


@pytest.mark.parametrize(
    ("name", "degrees"),
    [("NEES, state", 8), ("NIS, position", 3), ("NIS, velocity", 3), ("NIS, GNSS", 2)],
)
def test_errors_are_as_large_as_the_filter_believes(
    series: dict[str, Series], name: str, degrees: int
) -> None:
    """Means over 30 runs within the 95 % bounds of chi-square, most of the time."""
    found = series[name]
    assert found.degrees == degrees
    assert found.mean == pytest.approx(degrees, rel=0.12)
    assert found.inside >= 0.8


def test_a_filter_that_is_too_sure_of_itself_falls_out_of_the_bounds() -> None:
    values = np.random.default_rng(0).chisquare(3, (50, 200))
    assert Series("right", 3, values).inside == pytest.approx(0.95, abs=0.05)
    assert Series("too sure", 3, 1.6 * values).inside < 0.2
    assert Series("too timid", 3, values / 1.6).inside < 0.2


def test_the_bounds_close_in_with_more_runs() -> None:
    few, many = Series("few", 2, np.ones((10, 5))), Series("many", 2, np.ones((1000, 5)))
    assert few.bounds[0] < many.bounds[0] < 2.0 < many.bounds[1] < few.bounds[1]
