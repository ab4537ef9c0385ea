"""The follower: a carrot ahead, a gentle end, a push away from what is too near."""

import math

import pytest

from autonomy.config import GuidanceConfig
from autonomy.guidance.follower import arrival_speed, carrot_direction, push_away
from autonomy.guidance.path import FlownPath

CONFIG = GuidanceConfig()


def test_on_the_path_the_direction_is_along_it() -> None:
    path = FlownPath(((0.0, 0.0), (3.0, 0.0)))
    assert carrot_direction(path, (1e-9, 0.0), (0.0, 0.0), CONFIG) == pytest.approx((1.0, 0.0))


def test_beside_the_path_the_direction_leads_back_to_it() -> None:
    path = FlownPath(((0.0, 0.0), (3.0, 0.0)))
    north, east = carrot_direction(path, (0.0, 0.1), (0.0, 0.0), CONFIG)
    assert north > 0.0 > east
    assert math.hypot(north, east) == pytest.approx(1.0)


def test_the_carrot_is_ahead_of_where_the_vehicle_will_be() -> None:
    slow = FlownPath(((0.0, 0.0), (0.2, 0.0), (0.2, 2.0)))
    fast = FlownPath(((0.0, 0.0), (0.2, 0.0), (0.2, 2.0)))
    # The faster vehicle begins to turn earlier.
    still = carrot_direction(slow, (0.09, 0.0), (0.0, 0.0), CONFIG)
    moving = carrot_direction(fast, (0.09, 0.0), (0.4, 0.0), CONFIG)
    assert moving[1] > still[1]


def test_a_path_that_folds_back_does_not_leave_the_carrot_under_the_vehicle() -> None:
    path = FlownPath(((0.0, 0.0), (0.05, 0.0), (0.0, 0.001), (-2.0, 0.001)))
    path.progress_m = 0.0
    north, east = carrot_direction(path, (0.0, 0.0), (0.0, 0.0), CONFIG)
    assert math.hypot(north, east) == pytest.approx(1.0)
    assert north < 0.0


def test_at_the_end_there_is_no_direction() -> None:
    path = FlownPath(((1.0, 1.0),))
    assert carrot_direction(path, (1.0, 1.0), (0.0, 0.0), CONFIG) == (0.0, 0.0)


def test_speed_falls_towards_the_end_but_never_to_nothing() -> None:
    assert arrival_speed(5.0, 0.2) == 0.2
    assert arrival_speed(0.1, 0.2) == pytest.approx(0.08)
    assert arrival_speed(0.0, 0.2) == 0.05


def test_far_from_everything_nothing_pushes() -> None:
    assert push_away((0.1, 0.0), None, CONFIG) == (0.1, 0.0)
    assert push_away((0.1, 0.0), (CONFIG.push_below_m, 0.0), CONFIG) == (0.1, 0.0)


def test_too_near_to_a_hit_the_velocity_leads_away() -> None:
    north, east = push_away((0.1, 0.05), (0.18, 0.0), CONFIG)
    assert north == pytest.approx(-CONFIG.push_speed_m_s * (1.0 + 0.02 / 0.03))
    assert east == pytest.approx(0.05)


@pytest.mark.parametrize(
    ("distance_m", "times"), [(0.1999999, 1.0), (0.185, 1.5), (0.14, 3.0), (0.05, 3.0)]
)
def test_the_push_grows_with_nearness_up_to_three_times(distance_m: float, times: float) -> None:
    north, _ = push_away((0.0, 0.0), (distance_m, 0.0), CONFIG)
    assert north == pytest.approx(-times * CONFIG.push_speed_m_s, rel=1e-4)


@pytest.mark.parametrize(
    ("distance_m", "flown", "along_m_s"),
    [
        (0.19, (0.04, 0.1), 0.0),  # closing in
        (0.19, (0.02, 0.1), 0.1),  # hardly
        (0.19, (-0.01, 0.1), 0.1),
        (0.17, (0.0, 0.1), 0.0),  # too near, and only passing
        (0.17, (-0.03, 0.1), 0.1),  # on its way out
        (0.17, (0.0, 0.02), 0.1),  # at rest
        (0.21, (0.1, 0.1), 0.1),  # far enough
    ],
)
def test_what_feeds_an_approach_waits_until_it_has_ended(
    distance_m: float, flown: tuple[float, float], along_m_s: float
) -> None:
    """A hit to the north, a path to the east."""
    assert push_away((0.0, 0.1), (distance_m, 0.0), CONFIG, flown)[1] == along_m_s


def test_a_velocity_that_already_leads_away_fast_enough_is_left_alone() -> None:
    assert push_away((-0.1, 0.05), (0.18, 0.0), CONFIG) == (-0.1, 0.05)
