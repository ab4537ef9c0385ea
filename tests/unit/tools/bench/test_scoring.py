"""The judge lets nothing through, and measures what it lets through right."""

import math

import numpy as np
import pytest

from tools.bench.maps import Map
from tools.bench.scoring import (
    bends,
    flight_time_s,
    judge,
    length_m,
    spare_m,
    tightest_radius_m,
)

PROBLEM = Map(
    "one disc",
    (0.0, 0.0),
    (4.0, 0.0),
    np.array(((2.0, 0.0),)),
    np.array((0.3,)),
    0.2,
    (-1.0, -1.0),
    (5.0, 1.0),
)


def over(height: float) -> np.ndarray:
    return np.array(((0.0, 0.0), (1.0, height), (3.0, height), (4.0, 0.0)))


def arc(radius_m: float, turn_rad: float, step_rad: float) -> np.ndarray:
    """Straight, a circumscribed arc, straight."""
    steps = round(turn_rad / step_rad)
    angles = (np.arange(steps) + 0.5) * turn_rad / steps
    outer = radius_m / math.cos(0.5 * turn_rad / steps)
    corners = np.stack((outer * np.sin(angles), radius_m - outer * np.cos(angles)), axis=1)
    end = np.array((radius_m * math.sin(turn_rad), radius_m * (1.0 - math.cos(turn_rad))))
    ahead = np.array((math.cos(turn_rad), math.sin(turn_rad)))
    return np.concatenate((((-1.0, 0.0), (0.0, 0.0)), corners, (end, end + ahead)))


def test_a_free_path_is_scored_with_its_length_and_what_it_has_to_spare() -> None:
    score = judge(over(0.6), PROBLEM)
    assert score is not None
    assert score.length_m == pytest.approx(2.0 + 2.0 * math.hypot(1.0, 0.6))
    assert score.spare_m == pytest.approx(0.1)


def test_a_path_may_take_a_millimetre_and_no_more() -> None:
    assert judge(over(0.4995), PROBLEM) is not None
    assert judge(over(0.4985), PROBLEM) is None


def test_a_segment_that_cuts_a_disc_between_two_free_corners_is_seen() -> None:
    assert judge(np.array(((0.0, 0.0), (4.0, 0.0))), PROBLEM) is None


@pytest.mark.parametrize("end", [0, 3])
def test_a_path_that_is_elsewhere_at_one_end_does_not_count(end: int) -> None:
    path = over(0.6)
    path[end, 1] += 1e-3
    assert judge(path, PROBLEM) is None


def test_a_path_that_leaves_the_rectangle_does_not_count() -> None:
    assert judge(over(0.99), PROBLEM) is not None
    assert judge(over(-1.01), PROBLEM) is None
    assert judge(over(1.01), PROBLEM) is None


def test_no_path_and_a_path_with_nan_do_not_count() -> None:
    broken = over(0.6)
    broken[1, 0] = np.nan
    assert judge(None, PROBLEM) is None
    assert judge(broken, PROBLEM) is None
    assert judge(broken[:1], PROBLEM) is None


def test_what_is_spared_is_measured_on_every_one_of_many_segments() -> None:
    line = np.stack((np.linspace(0.0, 4.0, 2000), np.full(2000, 0.9)), axis=1)
    assert spare_m(line, PROBLEM.centres, PROBLEM.reach_m) == pytest.approx(0.4)
    far = np.array(((3.999, 0.0),))
    assert spare_m(line, far, np.array((0.5,))) == pytest.approx(0.4)
    assert spare_m(line, np.empty((0, 2)), np.empty(0)) == math.inf


def test_repeated_points_change_nothing() -> None:
    path = over(0.6)
    twice = np.repeat(path, 2, axis=0)
    assert length_m(twice) == length_m(path)
    assert judge(twice, PROBLEM) == judge(path, PROBLEM)
    assert tightest_radius_m(twice) == tightest_radius_m(path)


@pytest.mark.parametrize("step_rad", [0.02, 0.1])
def test_a_sampled_arc_bends_with_its_own_radius(step_rad: float) -> None:
    assert tightest_radius_m(arc(0.2, 1.2, step_rad)) == pytest.approx(0.2, rel=1e-6)


def test_a_straight_path_has_no_bend_even_with_points_on_it() -> None:
    path = np.array(((0.0, 0.0), (1.0, 0.0), (2.0, 0.0), (4.0, 0.0)))
    assert tightest_radius_m(path) == math.inf
    assert bends(path)[0].shape == (0,)
    assert flight_time_s(path, 0.5, 0.5) == pytest.approx(8.0)


def test_a_corner_is_cut_by_five_millimetres() -> None:
    corner = np.array(((0.0, 0.0), (2.0, 0.0), (2.0, 2.0)))
    turn, radius = bends(corner)
    assert turn[0] == pytest.approx(0.5 * math.pi)
    assert radius[0] == pytest.approx(0.005 / (math.sqrt(2.0) - 1.0))


def test_an_arc_is_flown_at_the_speed_that_its_radius_allows() -> None:
    path = arc(0.2, 1.2, 0.01)
    slow = math.sqrt(0.5 * 0.2)
    assert flight_time_s(path, 0.2, 0.5) == pytest.approx(length_m(path) / 0.2, rel=1e-4)
    expected = 2.0 / 1.0 + 0.2 * 1.2 / slow
    assert flight_time_s(path, 1.0, 0.5) == pytest.approx(expected, rel=1e-3)


def test_a_path_that_turns_back_has_a_time() -> None:
    back = np.array(((0.0, 0.0), (1.0, 0.0), (0.0, 0.0)))
    assert flight_time_s(back, 1.0, 0.5) == pytest.approx(2.0, rel=0.01)
