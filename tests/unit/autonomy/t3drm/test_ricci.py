from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from autonomy.t3drm import ricci

radii = st.floats(0.05, 2.0)


@given(radii, st.floats(0.1, 1.0), st.integers(1, 8))
def test_levels_fall_along_the_flow_from_comfort_to_the_floor(
    r0: float, share: float, count: int
) -> None:
    r_min = share * r0
    found = ricci.levels(r0, r_min, count)
    assert found[0] == r0
    assert list(found) == sorted(found, reverse=True)
    if len(found) > 1:
        assert found[-1] == r_min
    # Equal steps of flow time: the squares fall evenly.
    squares = [r * r for r in found]
    steps = [a - b for a, b in pairwise(squares)]
    assert all(step == pytest.approx(steps[0], abs=1e-9) for step in steps)


def test_one_level_is_the_comfortable_one() -> None:
    assert ricci.levels(0.23, 0.2, 1) == (0.23,)
    assert ricci.levels(0.2, 0.2, 3) == (0.2,)


@pytest.mark.parametrize(("r0", "r_min", "count"), [(0.2, 0.3, 3), (0.2, 0.0, 3), (0.2, 0.1, 0)])
def test_levels_that_do_not_flow_down_are_refused(r0: float, r_min: float, count: int) -> None:
    with pytest.raises(ValueError, match=r"r_min|level"):
        ricci.levels(r0, r_min, count)


@given(radii, st.floats(0.0, 1.0), st.sampled_from([2, 3]))
def test_shrinking_undoes_growing(r0: float, t: float, n: int) -> None:
    grown = ricci.growing_radius(r0, t, n)
    assert grown >= r0
    assert ricci.shrinking_radius(grown, t, n) == pytest.approx(r0, rel=1e-9)
    assert ricci.time_to_radius(grown, r0, n) == pytest.approx(t, abs=1e-9)


def test_growing_cannot_be_run_back_beyond_its_beginning() -> None:
    with pytest.raises(ricci.ExtinctSphere, match="before the beginning"):
        ricci.growing_radius(0.1, -1.0)
