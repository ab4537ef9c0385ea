"""Which discs hang together: trees worked out by hand, and squares against all pairs."""

import math

import numpy as np
import pytest
from scipy.sparse.csgraph import minimum_spanning_tree
from scipy.spatial.distance import pdist, squareform

from autonomy.t3drm import kernels
from autonomy.t3drm.kernels import Floats, Ints, Mask


def discs(*rows: tuple[float, float, float]) -> tuple[Floats, Floats]:
    table = np.array(rows, dtype=np.float64).reshape(-1, 3)
    return table[:, :2].copy(), table[:, 2].copy()


def lattices(seed: int, count: int) -> list[tuple[Floats, Floats]]:
    """Discs at few places with few radii, hence many that touch exactly; some far away."""
    rng = np.random.default_rng(seed)
    found = []
    for _ in range(count):
        size, side = rng.integers(1, 16), rng.integers(2, 9)
        spacing = rng.choice([(1.0, 1.0), (0.5, 3.0), (20.0, 0.5)])
        origin = rng.choice([0.0, -7.0, 1000.0], 2)
        centres = rng.integers(0, side, (size, 2)) * spacing + origin
        found.append((centres, rng.choice([0.25, 0.5, 0.75, 1.5], size)))
    return found


def components(centres: Floats, radii: Floats) -> list[int]:
    """By all pairs: the least number of a disc of the component, for every disc."""
    labels = list(range(len(radii)))
    for _ in labels:
        for i in range(len(radii)):
            for k in range(len(radii)):
                if math.dist(centres[i], centres[k]) < radii[i] + radii[k]:
                    labels[i] = labels[k] = min(labels[i], labels[k])
    return labels


def first_of_each(labels: Ints) -> list[int]:
    rows = labels.tolist()
    return [rows.index(label) for label in rows]


# ---------------------------------------------------------------- spanning tree


FOUR = np.array(((0.0, 0.0), (0.0, 6.0), (3.0, 0.0), (4.5, 0.0)))


def test_the_tree_of_four_points_worked_out_by_hand() -> None:
    # From point 0: 2 is the nearest (3 m), then 3 beyond it (1.5 m), then 1 (6 m).
    order, parent, gap = kernels.spanning_tree(FOUR)
    assert order.tolist() == [0, 2, 3, 1]
    assert parent.tolist() == [-1, 0, 0, 2]
    assert gap[1:].tolist() == [6.0, 3.0, 1.5]
    assert gap[0] == math.inf


def test_of_two_points_equally_near_the_one_that_came_first_is_the_parent() -> None:
    _, parent, gap = kernels.spanning_tree(np.array(((0.0, 0), (1, 0), (1, 1), (0, 1))))
    assert gap[1:].tolist() == [1.0, 1.0, 1.0]
    assert parent.tolist()[:2] == [-1, 0]
    assert parent[3] == 0


@pytest.mark.parametrize(("centres", "radii"), lattices(3, 25))
def test_no_tree_is_shorter(centres: Floats, radii: Floats) -> None:
    order, parent, gap = kernels.spanning_tree(centres)
    count = len(radii)
    assert sorted(order.tolist()) == list(range(count))
    place = {point: at for at, point in enumerate(order.tolist())}
    for point in order.tolist()[1:]:
        joined = int(parent[point])
        assert place[joined] < place[point]
        assert gap[point] == pytest.approx(math.dist(centres[point], centres[joined]))
    # scipy knows no edges of length 0: all are moved up by 100.
    gaps = squareform(pdist(centres)) + 100.0
    expected = minimum_spanning_tree(np.triu(gaps, 1)).sum()
    assert gap[np.isfinite(gap)].sum() + 100.0 * (count - 1) == pytest.approx(expected)


def test_only_gaps_below_the_threshold_join() -> None:
    tree = kernels.spanning_tree(FOUR)
    for threshold, labels in (
        (1.5, [0, 3, 1, 2]),
        (1.6, [0, 2, 1, 1]),
        (3.0, [0, 2, 1, 1]),
        (3.1, [0, 1, 0, 0]),
        (6.0, [0, 1, 0, 0]),
        (6.1, [0, 0, 0, 0]),
    ):
        found, count = kernels.cut_tree(*tree, threshold)
        assert found.tolist() == labels
        assert count == max(labels) + 1


# ---------------------------------------------------------------- squares


@pytest.mark.parametrize(("centres", "radii"), lattices(4, 60))
def test_discs_that_overlap_are_one_component_and_discs_that_touch_are_not(
    centres: Floats, radii: Floats
) -> None:
    labels, chain = kernels.join_overlapping(centres, radii)
    assert first_of_each(labels) == components(centres, radii)
    # Numbered in the order in which the discs come.
    firsts = [label for k, label in enumerate(labels.tolist()) if label not in labels[:k]]
    assert firsts == list(range(len(firsts)))
    assert_chained(centres, radii, labels, chain)


def assert_chained(centres: Floats, radii: Floats, labels: Ints, chain: Mask) -> None:
    """The chain hangs together in every component, and everything else overlaps it."""
    own = np.flatnonzero(chain == 1)
    inner = components(centres[own], radii[own])
    for label in range(labels.max() + 1):
        links = {inner[k] for k, disc in enumerate(own.tolist()) if labels[disc] == label}
        assert len(links) == 1
    for disc in np.flatnonzero(chain == 0).tolist():
        overlapped = [
            math.dist(centres[disc], centres[k]) < radii[disc] + radii[k] for k in own.tolist()
        ]
        assert any(overlapped)


def test_along_a_wall_the_chain_goes_on_with_the_farthest() -> None:
    # Every disc overlaps the next three: 0, then 3, 6, 9; the last one need not be there.
    centres, radii = discs(*((0.3 * k, 0.0, 0.5) for k in range(12)))
    labels, chain = kernels.join_overlapping(centres, radii)
    assert labels.tolist() == [0] * 12
    assert np.flatnonzero(chain).tolist() == [0, 3, 6, 9]


def test_the_chain_follows_a_wall_in_every_direction() -> None:
    for north, east in ((-0.3, 0.0), (0.0, 0.3), (0.0, -0.3), (0.18, 0.24), (-0.18, 0.24)):
        centres, radii = discs(*((north * k, east * k, 0.5) for k in range(12)))
        _, chain = kernels.join_overlapping(centres, radii)
        assert np.flatnonzero(chain).tolist() == [0, 3, 6, 9]


def test_discs_in_squares_that_only_touch_at_a_corner_are_joined() -> None:
    centres, radii = discs((0.99, 0.99, 0.5), (1.01, 1.01, 0.5), (0.0, 0.0, 0.1), (3.0, 3.0, 0.1))
    labels, _ = kernels.join_overlapping(centres, radii)
    assert labels.tolist() == [0, 0, 1, 2]


def test_the_chain_goes_on_with_the_disc_that_overlaps_least() -> None:
    # From 0: 1 overlaps it by less than 2 does, though 2 is farther; 3 overlaps both of them.
    rows = [(0.0, 0.0, 1.0), (1.5, 0.0, 1.0), (1.6, 0.0, 2.0), (2.9, 0.0, 0.5)]
    for order in ((0, 1, 2, 3), (0, 2, 1, 3)):
        _, chain = kernels.join_overlapping(*discs(*(rows[k] for k in order)))
        assert [order[k] for k in np.flatnonzero(chain)] == [0, 1]


def test_no_discs_have_no_components() -> None:
    labels, chain = kernels.join_overlapping(*discs())
    assert labels.shape == chain.shape == (0,)


def test_one_disc_is_its_own_component_and_chain() -> None:
    labels, chain = kernels.join_overlapping(*discs((5.0, -3.0, 0.2)))
    assert (labels.tolist(), chain.tolist()) == ([0], [1])


def test_points_without_extent_do_not_overlap_even_at_one_place() -> None:
    labels, chain = kernels.join_overlapping(*discs((1, 1, 0), (1, 1, 0), (2, 1, 0)))
    assert labels.tolist() == [0, 1, 2]
    assert chain.tolist() == [1, 1, 1]


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e5])
def test_squares_are_as_wide_as_the_widest_disc_and_hardly_more_than_discs(scale: float) -> None:
    """Wide enough that what overlaps is in neighbouring squares, few enough for memory."""
    rng = np.random.default_rng(5)
    centres = rng.uniform(-3.0, 5.0, (50, 2)) * scale
    radii = rng.uniform(0.05, 0.4, 50)
    box, shape, heads, following = kernels._cells(centres, radii)
    assert box[2] >= 2.0 * radii.max()
    assert shape.prod() == heads.shape[0] <= (2.0 + math.sqrt(50)) ** 2
    assert box[:2].tolist() == centres.min(axis=0).tolist()
    held = []
    for cell, head in enumerate(heads.tolist()):
        disc = head
        while disc >= 0:
            held.append(disc)
            at = ((centres[disc] - box[:2]) / box[2]).astype(np.int64)
            assert cell == at[0] * shape[1] + at[1]
            disc = int(following[disc])
    assert sorted(held) == list(range(50))


# ---------------------------------------------------------------- chain along a tree


def chain_of(more: float, *rows: tuple[float, float, float]) -> list[int]:
    """The chain when centres nearer than 2 m and `more` join."""
    centres, radii = discs(*rows)
    tree = kernels.spanning_tree(centres)
    return np.flatnonzero(kernels.sparse_chain(*tree, 2.0 + more, centres, radii)).tolist()


def test_a_chain_along_a_tree_has_one_disc_in_a_diameter() -> None:
    wall = [(0.3 * k, 0.4 * k, 0.8) for k in range(12)]
    # 0.5 m apart, 1.6 m wide: from 0 the fourth is farther than 1.52, the third is its link.
    assert chain_of(0.0, *wall) == [0, 3, 6, 9]
    assert chain_of(0.0, *((-n, -e, r) for n, e, r in wall)) == [0, 3, 6, 9]


def test_the_radii_of_both_discs_count_in_a_chain() -> None:
    assert chain_of(0.0, (0, 0, 1.0), (0.9, 0, 0.2), (1.1, 0, 0.2)) == [0]
    assert chain_of(0.0, (0, 0, 1.0), (0.9, 0, 0.2), (1.2, 0, 0.2)) == [0, 1]
    assert chain_of(0.0, (0, 0, 0.2), (0.9, 0, 1.0), (1.3, 0, 0.2)) == [0, 1]
    # Exactly 0.95 of both radii is near enough.
    assert chain_of(0.0, (0, 0, 1.0), (1.0, 0, 1.0), (1.9, 0, 1.0)) == [0]


def test_a_disc_that_joins_the_last_link_itself_needs_no_other() -> None:
    assert chain_of(0.0, (0, 0, 1.0), (1.95, 0, 1.0)) == [0]


def test_every_component_has_a_chain_of_its_own() -> None:
    wall = [(0.3 * k, 0.4 * k, 0.8) for k in range(5)]
    far = [(n + 20.0, e, r) for n, e, r in wall]
    assert chain_of(0.0, *wall, *far) == [0, 3, 5, 8]
    assert chain_of(0.0, (0, 0, 1), (2, 0, 1), (4, 0, 1)) == [0, 1, 2]
    assert chain_of(1e-9, (0, 0, 1), (2, 0, 1), (4, 0, 1)) == [0, 1]
