"""Components of discs found square by square, against scipy on all their gaps."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.sparse.csgraph import connected_components

from autonomy.t3drm import kernels
from autonomy.t3drm.kernels import Floats, Ints
from autonomy.t3drm.spherical import Discs, Route, route_among, shortest_path

START, GOAL = (-3.0, -3.0), (13.0, 13.0)


def partition(labels: Ints) -> set[tuple[int, ...]]:
    return {tuple(np.flatnonzero(labels == label).tolist()) for label in np.unique(labels)}


def discs(seed: int, count: int, side_m: float, largest_m: float) -> tuple[Floats, Floats]:
    rng = np.random.default_rng(seed)
    return rng.uniform(0.0, side_m, (count, 2)), rng.uniform(0.05, largest_m, count)


@settings(deadline=None, max_examples=150)
@given(
    seed=st.integers(0, 10**6),
    count=st.integers(1, 60),
    side_m=st.floats(0.1, 30.0),
    largest_m=st.floats(0.06, 2.0),
)
def test_components_are_those_of_all_gaps(
    seed: int, count: int, side_m: float, largest_m: float
) -> None:
    centres, radii = discs(seed, count, side_m, largest_m)
    gaps = np.hypot(*(centres[:, None] - centres).T) - (radii[:, None] + radii)
    _, expected = connected_components(gaps < 0.0, directed=False)
    labels, _ = kernels.join_overlapping(centres, radii)
    assert partition(labels) == partition(expected.astype(np.int64))
    assert set(labels.tolist()) == set(range(labels.max() + 1))


@settings(deadline=None, max_examples=100)
@given(seed=st.integers(0, 10**6), count=st.integers(1, 60), side_m=st.floats(0.5, 15.0))
def test_a_chain_holds_its_component_together(seed: int, count: int, side_m: float) -> None:
    centres, radii = discs(seed, count, side_m, 0.8)
    labels, chain = kernels.join_overlapping(centres, radii)
    for label in range(labels.max() + 1):
        own = (labels == label) & (chain == 1)
        rest = (labels == label) & (chain == 0)
        links, _ = kernels.join_overlapping(centres[own], radii[own])
        assert own.any()
        assert links.max() == 0
        for k in np.flatnonzero(rest):
            away = np.hypot(*(centres[own] - centres[k]).T)
            assert (away < radii[own] + radii[k]).any()


def test_a_wall_of_hits_is_chained_at_about_a_keep_out_diameter() -> None:
    wall = np.stack((np.zeros(200), np.arange(200) * 0.025), axis=1)
    labels, chain = kernels.join_overlapping(wall, np.full(200, 0.2))
    assert labels.max() == 0
    gaps = np.diff(wall[chain == 1, 1])
    assert gaps.max() < 0.4
    assert np.median(gaps) > 0.35


def test_one_far_disc_does_not_cost_an_endless_number_of_squares() -> None:
    centres = np.array(((0.0, 0.0), (0.1, 0.0), (1e7, -1e7)))
    labels, chain = kernels.join_overlapping(centres, np.full(3, 0.2))
    assert labels.tolist() == [0, 0, 1]
    assert chain[2] == 1


def test_no_discs_have_no_components() -> None:
    labels, chain = kernels.join_overlapping(np.empty((0, 2)), np.empty(0))
    assert labels.shape == chain.shape == (0,)


@pytest.mark.parametrize("seed", range(8))
def test_discs_made_ready_give_the_same_route(seed: int) -> None:
    centres, radii = discs(seed, 80, 10.0, 0.6)
    once = shortest_path(START, GOAL, centres, radii)
    again = route_among(START, GOAL, Discs.of(centres, radii))
    assert isinstance(once, Route)
    assert once == again
