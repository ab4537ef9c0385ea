import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.cluster.hierarchy import fcluster, linkage
from scipy.spatial import ConvexHull

from autonomy.config import PlannerConfig
from autonomy.geometry import Point, distance
from autonomy.model import Environment, ObstacleKind
from autonomy.t3drm import kernels
from autonomy.t3drm.classification import Classification, Linkage, Outlines, classify
from autonomy.t3drm.hyperbolic import inside_hull

CONFIG = PlannerConfig()

clouds = st.tuples(st.integers(0, 2**32 - 1), st.integers(2, 60))


def cloud(seed_and_size: tuple[int, int]) -> tuple[Point, ...]:
    seed, size = seed_and_size
    rows = np.random.default_rng(seed).uniform(0.0, 4.0, (size, 2))
    return tuple((n, e) for n, e in rows.tolist())


@settings(deadline=None, max_examples=40)
@given(clouds, st.floats(0.05, 0.4))
def test_components_are_those_of_single_linkage(
    seed_and_size: tuple[int, int], keep_out: float
) -> None:
    hits = cloud(seed_and_size)
    found = classify(hits, keep_out, CONFIG)
    tree = linkage(np.array(hits), method="single")
    labels = fcluster(tree, np.nextafter(2.0 * keep_out, 0.0), criterion="distance")
    expected = {frozenset(np.flatnonzero(labels == k).tolist()) for k in set(labels.tolist())}
    number = {hit: k for k, hit in enumerate(hits)}
    assert {frozenset(number[hit] for hit in o.hits) for o in found.obstacles} == expected
    # Persistence: the merge heights of the dendrogram, halved.
    assert found.persistence[:-1] == pytest.approx(sorted(0.5 * tree[:, 2]))
    assert found.persistence[-1] == math.inf


@settings(deadline=None, max_examples=40)
@given(clouds)
def test_the_outline_holds_every_hit(seed_and_size: tuple[int, int]) -> None:
    hits = cloud(seed_and_size)
    for obstacle in classify(hits, 0.3, CONFIG).obstacles:
        assert all(distance(obstacle.centre, h) <= obstacle.radius_m + 1e-9 for h in obstacle.hits)
        # The circle is the smallest: two hits on a diameter or three around it.
        edge = [h for h in obstacle.hits if distance(obstacle.centre, h) > obstacle.radius_m - 1e-9]
        assert len(edge) >= min(2, len(obstacle.hits))
        if len(obstacle.hits) > 3:
            hull = ConvexHull(np.array(obstacle.hits))
            corners = {obstacle.hits[k] for k in hull.vertices}
            assert set(obstacle.hull) == corners
            middle = (
                sum(h[0] for h in obstacle.hits) / len(obstacle.hits),
                sum(h[1] for h in obstacle.hits) / len(obstacle.hits),
            )
            assert inside_hull(middle, obstacle.hull)


def test_no_hits_are_a_free_environment() -> None:
    found = classify((), 0.2, CONFIG)
    assert found.environment is Environment.FREE
    assert found.obstacles == ()
    assert found.persistence == ()


def test_two_hits_join_when_nothing_passes_between_them() -> None:
    def count(gap: float) -> int:
        return len(classify(((0.0, 0.0), (gap, 0.0)), 0.2, CONFIG).obstacles)

    assert count(0.399) == 1
    assert count(0.4) == 2


def test_a_small_component_is_discrete_and_a_wall_continuous() -> None:
    post = tuple((0.1 * math.cos(a), 0.1 * math.sin(a)) for a in range(6))
    wall = tuple((3.0, 0.05 * k) for k in range(30))
    found = classify(post + wall, 0.2, CONFIG)
    kinds = {o.kind: o for o in found.obstacles}
    assert found.environment is Environment.MIXED
    assert kinds[ObstacleKind.DISCRETE].radius_m == pytest.approx(0.1, abs=0.01)
    assert kinds[ObstacleKind.CONTINUOUS].radius_m == pytest.approx(0.725)


def test_a_straight_regular_wall_has_linearity_and_regularity_one() -> None:
    wall = tuple((1.0 + 0.03 * k, 2.0 + 0.04 * k) for k in range(40))
    (obstacle,) = classify(wall, 0.2, CONFIG).obstacles
    assert obstacle.linearity == pytest.approx(1.0)
    assert obstacle.regularity == pytest.approx(1.0)


def test_a_round_irregular_cluster_has_little_of_either() -> None:
    rng = np.random.default_rng(3)
    rows = rng.normal(0.0, 0.3, (80, 2))
    (obstacle,) = classify(rows, 0.4, CONFIG).obstacles
    assert obstacle.linearity < 0.6
    assert obstacle.regularity < 0.75


def test_death_is_half_the_distance_to_the_nearest_other_component() -> None:
    found = classify(((0.0, 0.0), (1.0, 0.0), (3.0, 0.0)), 0.2, CONFIG)
    assert sorted(o.death_m for o in found.obstacles) == pytest.approx([0.5, 0.5, 1.0])
    (alone,) = classify(((0.0, 0.0),), 0.2, CONFIG).obstacles
    assert alone.death_m == math.inf


def test_a_hundred_equal_hits_are_one_point() -> None:
    (obstacle,) = classify(((1.0, 1.0),) * 100, 0.2, CONFIG).obstacles
    assert obstacle.radius_m == 0.0
    assert obstacle.linearity == 0.0


@pytest.mark.parametrize("record", [Linkage, Outlines, Classification])
def test_what_was_classified_cannot_be_changed(record: Any) -> None:
    assert record.__struct_config__.frozen


def test_one_hit_lives_for_ever_and_is_discrete() -> None:
    found = classify(((3.0, 4.0),), 0.2, CONFIG)
    assert found.persistence == (math.inf,)
    assert found.environment is Environment.DISCRETE
    (only,) = found.obstacles
    assert (only.centre, only.radius_m, only.hull, only.hits) == (
        (3.0, 4.0),
        0.0,
        ((3.0, 4.0),),
        ((3.0, 4.0),),
    )
    assert only.death_m == math.inf


def test_a_component_as_wide_as_a_discrete_one_may_be_is_discrete() -> None:
    wide = 2.0 * CONFIG.discrete_radius_m
    for gap, kind, environment in (
        (wide, ObstacleKind.DISCRETE, Environment.DISCRETE),
        (math.nextafter(wide, 9.0), ObstacleKind.CONTINUOUS, Environment.CONTINUOUS),
    ):
        found = classify(((0.0, 0.0), (gap, 0.0)), 0.5, CONFIG)
        assert [o.kind for o in found.obstacles] == [kind]
        assert found.environment is environment


def test_components_come_with_their_own_hits_deaths_and_regularity() -> None:
    # Keep-out 0.2: joined below 0.4. Between the two rows 0.5, to the last hit exactly 0.4.
    first = ((0.0, 0.0), (0.3, 0.0), (0.6, 0.0))
    second = ((1.1, 0.0), (1.4, 0.0), (1.5, 0.0))
    found = classify((*first, *second, (1.5, 0.4)), 0.2, CONFIG)
    assert [o.hits for o in found.obstacles] == [first, second, ((1.5, 0.4),)]
    assert [o.death_m for o in found.obstacles] == pytest.approx([0.25, 0.2, 0.2])
    assert [o.radius_m for o in found.obstacles] == pytest.approx([0.3, 0.2, 0.0])
    # Edges 0.3, 0.3; 0.3, 0.1 (mean 0.2, deviation 0.1); none. The one of 0.5 joins nothing.
    assert [o.regularity for o in found.obstacles] == pytest.approx([1.0, 1.0 / 1.5, 0.0])
    assert found.persistence == pytest.approx((0.05, 0.15, 0.15, 0.15, 0.2, 0.25, math.inf))


def test_outlines_hold_the_corners_of_every_component() -> None:
    hits = ((0.0, 0.0), (0.2, 0.0), (0.1, 0.01), (0.1, 0.2), (5.0, 5.0), (7.0, 7.0), (7.1, 7.0))
    linkage = Linkage.of(np.array(hits))
    outlines = Outlines.of(linkage, 0.2, 0.35)
    assert outlines.count == 3
    assert [outlines.hull_of(label).tolist() for label in range(3)] == [[0, 1, 3], [4], [5, 6]]
    assert outlines.members.tolist() == [0, 1, 2, 3, 4, 5, 6]
    assert outlines.first.tolist() == [0, 4, 5, 7]
    assert outlines.corner.tolist() == [0, 3, 4, 6]
    assert outlines.rows.shape == (3, 4)


def test_hits_of_a_component_need_not_come_one_after_the_other() -> None:
    hits = ((0.0, 0.0), (5.0, 0.0), (0.1, 0.0), (5.1, 0.0), (9.0, 0.0), (0.2, 0.1))
    found = classify(hits, 0.2, CONFIG)
    assert [o.hits for o in found.obstacles] == [
        ((0.0, 0.0), (0.1, 0.0), (0.2, 0.1)),
        ((5.0, 0.0), (5.1, 0.0)),
        ((9.0, 0.0),),
    ]
    assert [o.centre[0] for o in found.obstacles] == pytest.approx([0.1, 5.05, 9.0], abs=0.02)


def test_a_map_may_grow_beyond_many_without_another_tree() -> None:
    points = np.random.default_rng(9).uniform(-20.0, 30.0, (kernels.MANY, 2))
    for count in (kernels.MANY - 1, kernels.MANY):
        found = kernels.spanning_tree(points[:count])
        for mine, prims in zip(found, kernels.prim_tree(points[:count]), strict=True):
            assert mine.tolist() == prims.tolist()


@pytest.mark.parametrize("bad", [math.nan, math.inf, 1e200])
def test_where_distances_are_not_finite_prims_tree_is_taken(bad: float) -> None:
    points = np.random.default_rng(10).uniform(-20.0, 30.0, (60, 2))
    points[17, 1] = bad
    for mine, prims in zip(kernels.boxed_tree(points), kernels.prim_tree(points), strict=True):
        np.testing.assert_array_equal(mine, prims)
