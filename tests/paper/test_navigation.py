"""Figures 1 and 2, Eq. 10 and Algorithm 1 as worked examples."""

import math
from itertools import pairwise

import numpy as np
import pytest

from autonomy.config import PlannerConfig
from autonomy.geometry import bearing, distance, segment_distance
from autonomy.model import Environment, LegKind, ObstacleKind, Plan
from autonomy.t3drm.classification import classify
from autonomy.t3drm.hyperbolic import fly_by
from autonomy.t3drm.planner import Planner
from autonomy.t3drm.spherical import tangents_from, touch_angle
from autonomy.t3drm.timing import ComputationTime
from hal.config import Fence

FENCE = Fence.rectangle((-3.0, 9.0), (-6.0, 6.0))


def test_figure_1_the_tangents_of_a_sphere() -> None:
    # |DO| = 5, r = 3: tangents of length 4 at asin(3/5).
    tangents = tangents_from((0.0, 0.0), (5.0, 0.0), 3.0)
    assert touch_angle(3.0, 5.0) == pytest.approx(math.asin(0.6))
    assert tangents.length_m == pytest.approx(4.0)
    assert tangents.left == pytest.approx((3.2, -2.4))
    assert tangents.right == pytest.approx((3.2, 2.4))


def test_figure_1_a_discrete_obstacle_is_passed_by_tangent_arc_tangent() -> None:
    planner = Planner(PlannerConfig(levels=1), 0.15, FENCE)
    plan = planner.plan((0.0, 0.0), (4.0, 0.0), np.array([(2.0, 0.05)]))
    assert isinstance(plan, Plan)
    assert [leg.kind for leg in plan.legs] == [LegKind.TANGENT, LegKind.ARC, LegKind.TANGENT]
    assert plan.environment is Environment.DISCRETE
    # The cheaper tangent is the one away from the obstacle's offset: negative east.
    assert min(east for _, east in plan.points) < -0.1


def test_figure_2_a_continuous_obstacle_is_passed_on_a_hyperbola() -> None:
    planner = Planner(PlannerConfig(levels=1), 0.15, FENCE)
    wall = np.array([(2.0, -0.2 + 0.05 * k) for k in range(40)])
    plan = planner.plan((0.0, 0.0), (4.0, 0.0), wall)
    assert isinstance(plan, Plan)
    assert [leg.kind for leg in plan.legs] == [LegKind.HYPERBOLA]
    assert plan.environment is Environment.CONTINUOUS
    # P is the periapsis at the support vertex (2, -0.2).
    nearest = min(segment_distance((2.0, -0.2), a, b) for a, b in pairwise(plan.points))
    assert nearest == pytest.approx(0.30, abs=1e-3)


def test_figure_2_the_conic_is_a_hyperbola_with_its_focus_at_the_support_vertex() -> None:
    conic = fly_by((-3.0, 0.0), (3.0, 0.0), (0.0, 0.0), 0.2, 1)
    assert conic is not None
    assert conic.is_hyperbola
    # Symmetric and with the vertex on DG: cos(pi/2) = 0, so p = r at D: 0.2 (1 + e) = 3.
    assert conic.eccentricity == pytest.approx(14.0)
    assert conic.closest == pytest.approx((0.0, -0.2))


def test_equation_10_is_the_euclidean_distance_and_its_bearing() -> None:
    # The printed X_G^2 - X_D^2 would give sqrt(9 - 1 + 25 - 4) here.
    assert distance((1.0, 2.0), (4.0, 6.0)) == pytest.approx(5.0)
    assert bearing((1.0, 2.0), (4.0, 6.0)) == pytest.approx(math.atan2(4.0, 3.0))


def test_a_free_environment_is_crossed_straight() -> None:
    plan = Planner(PlannerConfig(), 0.15, FENCE).plan((0.0, 0.0), (4.0, 3.0), np.empty((0, 2)))
    assert isinstance(plan, Plan)
    assert [leg.kind for leg in plan.legs] == [LegKind.STRAIGHT]
    assert plan.length_m == pytest.approx(5.0)
    assert plan.environment is Environment.FREE


def test_a_mixed_environment_has_both_kinds_of_obstacles() -> None:
    wall = [(2.0, -1.0 + 0.05 * k) for k in range(40)]
    found = classify((*wall, (5.0, 0.0)), 0.2, PlannerConfig())
    assert found.environment is Environment.MIXED
    assert {o.kind for o in found.obstacles} == {ObstacleKind.DISCRETE, ObstacleKind.CONTINUOUS}


def test_algorithm_1_records_the_computing_time() -> None:
    times = ComputationTime(start_s=10.0)
    times.replanned(12.0, 0.004, obstacles=1, keep_out_m=0.23)
    times.replanned(15.0, 0.002, obstacles=3, keep_out_m=0.20)
    times.completed(40.0)
    record = times.record()
    assert record.start_s == 10.0
    assert record.total_s == pytest.approx(0.006)
    assert record.least_s == 0.002
    assert record.flight_s == 30.0
    # Eq. 8 at 23 cm and Eq. 9 at 20 cm.
    assert record.replans[0].radius_m == pytest.approx(math.sqrt(525.0) / 100.0)
    assert record.replans[1].radius_m == pytest.approx(math.sqrt(388.0) / 100.0)
