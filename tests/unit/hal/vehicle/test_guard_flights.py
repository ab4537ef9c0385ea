"""The guard and a vehicle in a loop: what is limited ends where it should."""

import math

import pytest

from hal.frames import Vector3
from hal.vehicle import guard as g
from hal.vehicle.guard import Guard
from tests.unit.hal.vehicle.guard_world import (
    CONFIG,
    CORRIDOR_M,
    DiscWorld,
    beam,
    climb,
    setpoint,
    sight,
)
from tests.unit.hal.vehicle.px4_model import Px4Axis


@pytest.mark.parametrize("drag_per_s", [0.2, 1.0])
@pytest.mark.parametrize("speed_m_s", [0.05, 0.1, 0.2, 0.3])
def test_the_default_bound_holds_for_the_measured_response(
    speed_m_s: float, drag_per_s: float
) -> None:
    axis = Px4Axis(drag_per_s)
    axis.cruise(speed_m_s, 20.0)
    began_m, speed = axis.position_m, axis.velocity_m_s
    farthest_m = began_m
    axis.send(began_m, 0.0)
    for _ in range(100):
        axis.fly()
        farthest_m = max(farthest_m, axis.position_m)
    bound_m = g.stopping_distance_m(speed, CONFIG.reaction_s, CONFIG.braking_m_s2)
    assert 0.4 * bound_m < farthest_m - began_m <= bound_m


@pytest.mark.parametrize(("drag_per_s", "overrun_m"), [(0.2, 0.01), (1.0, 0.04)])
@pytest.mark.parametrize("speed_m_s", [0.1, 0.2, 0.25])
def test_a_planner_that_flies_at_a_wall_is_stopped_before_it(
    speed_m_s: float, drag_per_s: float, overrun_m: float
) -> None:
    axis = Px4Axis(drag_per_s)
    axis.cruise(speed_m_s, 20.0)
    guard = Guard(CONFIG)
    start_m = axis.position_m
    world = DiscWorld(((1.0 + CORRIDOR_M, 0.0),))
    farthest_m = 0.0
    for _ in range(500):
        along_m = axis.position_m - start_m
        farthest_m = max(farthest_m, along_m)
        seen = sight((along_m, 0.0, -1.0), (axis.velocity_m_s, 0.0, 0.0), space=world)
        verdict = guard.check(setpoint((along_m, 0.0, -1.0), (speed_m_s, 0.0, 0.0)), seen)
        axis.send(
            start_m + verdict.setpoint.position_ned_m[0], verdict.setpoint.velocity_ned_m_s[0]
        )
        axis.fly()
    # The way ends 3.5 cm before the body of a 0.15 m vehicle would touch.
    assert 0.96 < farthest_m < 1.0 + overrun_m
    assert axis.position_m - start_m == pytest.approx(1.0, abs=0.03)


@pytest.mark.parametrize("error_m", [0.03, -0.03])
@pytest.mark.parametrize("start_m", [0.6, 0.2, 0.1, 0.02])
@pytest.mark.parametrize("above", [True, False])
def test_a_wandering_estimate_does_not_ratchet_the_vehicle_into_a_surface(
    start_m: float, error_m: float, *, above: bool
) -> None:
    """A goal behind the surface; the true gap ends at the limit, whatever the estimate does."""
    guard, sign = Guard(CONFIG), 1.0 if above else -1.0
    gap_m = start_m
    for tick in range(600):
        wandered_m = error_m * math.sin(tick / 40.0) + error_m * (-1.0) ** tick / 3.0
        height_m = 1.0 + sign * (0.6 - gap_m) + wandered_m
        here: Vector3 = (0.0, 0.0, -height_m)
        seen = sight(here, beams=(beam("up" if above else "down", gap_m),))
        verdict = guard.check(setpoint((0.0, 0.0, -(1.0 + sign * 0.5))), seen)
        before_m = gap_m
        gap_m -= sign * climb(verdict, seen) * 0.05
        assert gap_m >= min(before_m, CONFIG.beam_stop_m) - 1e-9
    assert gap_m == pytest.approx(CONFIG.beam_stop_m, abs=0.005)
