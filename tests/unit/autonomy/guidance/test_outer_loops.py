"""Table 3's outer loops: nothing by default, a bounded help where gains are given."""

import pytest

from autonomy.config import GuidanceConfig
from autonomy.guidance.outer_loops import ADDED_MAX_M_S, OuterLoops


def loops(**gains: dict[str, float]) -> OuterLoops:
    return OuterLoops(GuidanceConfig.model_validate(gains))


def test_by_default_px4s_own_loops_are_left_alone() -> None:
    assert loops().hold((1.0, 2.0), (0.0, 0.0), 0.05) == (0.0, 0.0)
    assert loops().track((0.1, -0.2), (0.0, 0.0), 0.05) == (0.1, -0.2)


def test_the_position_loop_pulls_towards_the_target_but_not_too_hard() -> None:
    loop = loops(position={"kp": 0.5, "ki": 0.0, "kd": 0.0})
    assert loop.hold((0.1, 0.0), (0.0, 0.1), 0.05) == pytest.approx((0.05, -0.05))
    assert loop.hold((9.0, -9.0), (0.0, 0.0), 0.05) == (ADDED_MAX_M_S, -ADDED_MAX_M_S)


def test_the_velocity_loop_asks_for_more_where_less_is_flown() -> None:
    loop = loops(velocity={"kp": 0.5, "ki": 0.0, "kd": 0.0})
    assert loop.track((0.2, 0.0), (0.1, 0.02), 0.05) == pytest.approx((0.25, -0.01))


def test_a_loop_that_rests_forgets_what_it_had_integrated() -> None:
    loop = loops(velocity={"kp": 0.0, "ki": 1.0, "kd": 0.0})
    for _ in range(20):
        more = loop.track((0.1, 0.0), (0.0, 0.0), 0.05)
    assert more[0] > 0.15
    loop.hold((0.0, 0.0), (0.0, 0.0), 0.05)
    assert loop.track((0.1, 0.0), (0.1, 0.0), 0.05) == (0.1, 0.0)
