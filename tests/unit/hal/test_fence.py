"""The fence: polygon, cylinder, and both."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from autonomy.config import MapConfig, PlannerConfig
from autonomy.model import Plan
from autonomy.perception.obstacle_map import ObstacleMap
from autonomy.t3drm.planner import Planner
from hal.config import Fence, GuardConfig
from hal.documents import validate_document
from hal.errors import DocumentError

L_SHAPE = ((-1.0, -1.0), (1.0, -1.0), (1.0, 0.0), (0.0, 0.0), (0.0, 1.0), (-1.0, 1.0))
metres = st.floats(-2.0, 2.0)


def test_by_default_the_fence_is_a_polygon() -> None:
    fence = GuardConfig().fence
    assert fence.radius_m is None
    assert fence.outline_ne_m == fence.polygon_ne_m
    assert fence.bounds() == (-10.0, 10.0, -10.0, 10.0)


@settings(deadline=None)
@given(metres, metres)
def test_a_cylinder_is_a_radius_about_the_take_off_point(north: float, east: float) -> None:
    inside_m = Fence(radius_m=1.5).inside_distance_m(north, east)
    exact_m = 1.5 - math.hypot(north, east)
    assert exact_m - 0.0019 <= inside_m <= exact_m + 1e-9 or (
        exact_m < 0.0 and inside_m == pytest.approx(exact_m, abs=0.0019)
    )


def test_a_cylinder_has_its_corners_on_the_circle() -> None:
    fence = Fence(radius_m=2.0)
    assert len(fence.outline_ne_m) == 64
    assert all(math.hypot(*corner) == pytest.approx(2.0) for corner in fence.outline_ne_m)
    assert fence.bounds() == pytest.approx((-2.0, 2.0, -2.0, 2.0))
    assert fence.inside_distance_m(0.0, 0.0) == pytest.approx(2.0 * math.cos(math.pi / 64))


@settings(deadline=None, max_examples=300)
@given(metres, metres, st.floats(0.3, 2.0))
def test_inside_of_both_is_inside_of_each(north: float, east: float, radius_m: float) -> None:
    both = Fence(polygon_ne_m=L_SHAPE, radius_m=radius_m)
    polygon, cylinder = Fence(polygon_ne_m=L_SHAPE), Fence(radius_m=radius_m)
    least = min(f.inside_distance_m(north, east) for f in (polygon, cylinder))
    inside_m = both.inside_distance_m(north, east)
    if abs(least) > 1e-9:
        assert (inside_m > 0.0) == (least > 0.0)
    if least > 0.0:
        assert inside_m == pytest.approx(least, abs=1e-6)


def test_a_radius_that_holds_the_whole_polygon_changes_nothing() -> None:
    fence = Fence(polygon_ne_m=L_SHAPE, radius_m=5.0)
    assert set(fence.outline_ne_m) == set(L_SHAPE)


@pytest.mark.parametrize(
    ("fence", "sentence"),
    [
        ({}, "fence: a fence needs polygon_ne_m or radius_m; give one, or both"),
        ({"radius_m": 0.0}, "fence.radius_m"),
        (
            {"radius_m": 1.0, "polygon_ne_m": [[3, 3], [4, 3], [4, 4]]},
            "nothing of polygon_ne_m lies within radius_m of the take-off point; widen one",
        ),
    ],
)
def test_a_fence_that_encloses_nothing_is_refused(fence: dict[str, object], sentence: str) -> None:
    with pytest.raises(DocumentError, match=sentence):
        validate_document({"fence": fence}, GuardConfig, "it")


def test_fences_that_say_the_same_are_equal_whatever_was_asked_of_them() -> None:
    one, other = Fence(radius_m=2.0), Fence(radius_m=2.0)
    one.inside_distance_m(0.0, 0.0)
    assert one == other
    assert one != Fence(radius_m=2.5)


def test_map_and_planner_go_by_the_same_cylinder() -> None:
    fence = Fence(radius_m=1.5)
    cells = ObstacleMap(MapConfig(), 0.15, fence)
    cells.mark_seen_disc((1.4, 0.0), 0.3, 0.0)
    assert cells.free_distance_m((1.4, 0.0, -1.0), 0.0, 0.05, 0.0) == 0.05
    planner = Planner(PlannerConfig(), 0.15, fence)
    bar = np.array([(north, 0.0) for north in np.arange(-1.0, 1.2, 0.05)])
    plan = planner.plan((0.0, -0.8), (0.0, 0.8), bar)
    assert isinstance(plan, Plan)
    assert all(fence.inside_distance_m(*point) >= -1e-3 for point in plan.points)


@pytest.mark.parametrize(
    "polygon",
    [
        [[0, 0], [2, 2], [2, 0], [0, 2]],
        [[0, 0], [2, 0], [2, 2], [1, 0], [0, 2]],
        [[0, 0], [2, 0], [1, 0]],
    ],
)
def test_a_polygon_that_crosses_itself_is_refused_with_the_remedy(
    polygon: list[list[float]],
) -> None:
    with pytest.raises(ValueError, match="crosses itself; give its corners in order"):
        Fence.model_validate({"polygon_ne_m": polygon})


def test_a_ring_that_is_closed_by_its_first_corner_does_not_cross_itself() -> None:
    assert Fence(polygon_ne_m=(*L_SHAPE, L_SHAPE[0])).inside_distance_m(-0.5, -0.5) > 0.0
