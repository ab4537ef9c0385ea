"""The yaw scan turns all the time, and counts what the vehicle turned."""

import math

import pytest

from autonomy.guidance.yaw_scan import YawScan
from hal.frames import wrap_pi


def test_the_command_turns_at_the_rate() -> None:
    scan = YawScan(math.radians(60.0))
    yaw = 0.0
    for _ in range(30):
        yaw = scan.step(yaw, 0.05)
    assert yaw == pytest.approx(math.radians(90.0))
    # The first step has nothing to compare with.
    assert scan.turned_rad == pytest.approx(math.radians(87.0))


def test_turning_is_counted_across_the_wrap() -> None:
    scan = YawScan(math.radians(60.0))
    yaw = math.radians(170.0)
    for _ in range(20):
        yaw = scan.step(yaw, 0.1)
    assert scan.turned_rad == pytest.approx(math.radians(114.0))
    assert -math.pi <= yaw < math.pi


def test_a_vehicle_that_does_not_turn_is_led_by_a_bounded_angle() -> None:
    scan = YawScan(math.radians(60.0))
    commanded = 0.0
    for _ in range(200):
        commanded = scan.step(1.0, 0.05)
    assert wrap_pi(commanded - 1.0) == pytest.approx(math.radians(60.0))
    assert scan.turned_rad == 0.0


def test_a_sweep_is_counted_from_its_restart() -> None:
    scan = YawScan(math.radians(60.0))
    yaw = scan.step(0.0, 1.0)
    scan.step(yaw, 1.0)
    assert scan.turned_rad > 0.5
    scan.restart()
    assert scan.turned_rad == 0.0
