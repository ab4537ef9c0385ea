"""What one setpoint may differ by from the one before, and what a dead program may have sent."""

import itertools
import math

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hal.config import Fence, GuardConfig
from hal.frames import Vector3, wrap_pi
from hal.setpoints import Setpoint
from hal.vehicle import guard as g
from hal.vehicle.guard import Guard, Sight
from tests.unit.hal.vehicle.guard_world import (
    HOME,
    NOW_S,
    DiscWorld,
    beam,
    effective,
    is_hold_at,
    plain,
    setpoint,
    sight,
)

TICK_S = 0.0625
"""A power of two: times and limits are exact."""
SLOW = plain(acceleration_max_m_s2=1.0)
TURNING = plain(yaw_rate_max_deg_s=math.degrees(1.0))


def later(seen: Sight, ticks: float) -> Sight:
    now_s = NOW_S + ticks * TICK_S
    return msgspec.structs.replace(seen, now_s=now_s, fused_stamp_s=now_s)


def flown(
    config: GuardConfig, *velocities: tuple[float, float]
) -> list[tuple[tuple[float, float], tuple[str, ...]]]:
    """The effective velocities and limits of setpoints that come one a tick."""
    guard, found = Guard(config), []
    for tick, (north, east) in enumerate(velocities):
        seen = later(sight(), tick)
        asked = setpoint(velocity=(north, east, 0.0), yaw_rad=0.001 * tick, stamp_s=seen.now_s)
        verdict = guard.check(asked, seen)
        found.append((effective(verdict, seen, config), verdict.limits))
    return found


# ---------------------------------------------------------------- acceleration


def test_a_first_setpoint_may_be_as_fast_as_a_pause_allows() -> None:
    config = plain(acceleration_max_m_s2=1.0, setpoint_max_age_s=0.125, speed_max_m_s=1.0)
    assert flown(config, (0.125, 0.0))[0] == ((0.125, 0.0), ())
    ((first, limits),) = flown(config, (0.126, 0.0))
    assert first == pytest.approx((0.125, 0.0))
    assert limits == (g.ACCELERATION,)


def test_speed_grows_by_the_acceleration_times_the_time_that_passed() -> None:
    found = flown(SLOW, (0.0, 0.0), (0.25, 0.0), (0.25, 0.0), (0.25, 0.0), (0.25, 0.0), (0.25, 0.0))
    speeds = [n for (n, _), _ in found]
    assert speeds == pytest.approx([0.0, TICK_S, 2 * TICK_S, 3 * TICK_S, 0.25, 0.25])
    assert [bool(limits) for _, limits in found] == [False, True, True, True, False, False]


@pytest.mark.parametrize("slower", [(0.2, 0.0), (0.1, 0.0), (0.0, 0.0), (0.0001, 0.0)])
def test_slowing_down_is_never_limited(slower: tuple[float, float]) -> None:
    assert flown(SLOW, (0.2, 0.0), slower)[1] == (slower, ())


def test_exactly_the_acceleration_is_free() -> None:
    assert flown(SLOW, (0.125, 0.0), (0.1875, 0.0))[1][1] == ()
    assert flown(SLOW, (0.125, 0.0), (0.1875 + 2e-9, 0.0))[1][1] == (g.ACCELERATION,)
    assert flown(SLOW, (0.125, 0.0), (0.125, TICK_S))[1][1] == ()
    assert flown(SLOW, (0.125, 0.0), (0.125, -TICK_S - 2e-9))[1][1] == (g.ACCELERATION,)


@pytest.mark.parametrize(
    ("asked", "sent"),
    [
        ((0.0, 0.2), (0.0, TICK_S)),  # across: the old motion ends at once
        ((0.1, 0.2), (0.1, TICK_S)),  # what is kept of the old motion is what was asked of it
        ((-0.2, 0.0), (-TICK_S, 0.0)),
        ((0.2, -0.1), (0.2, -TICK_S)),
        ((-0.12, -0.16), (-0.6 * TICK_S, -0.8 * TICK_S)),
    ],
)
def test_another_direction_is_reached_by_braking_and_a_little_more(
    asked: tuple[float, float], sent: tuple[float, float]
) -> None:
    velocity, limits = flown(SLOW, (0.2, 0.0), asked)[1]
    assert velocity == pytest.approx(sent)
    assert limits == (g.ACCELERATION,)


@pytest.mark.parametrize(
    ("before", "asked", "sent"),
    [
        ((0.12, 0.16), (0.06, 0.08), (0.06, 0.08)),
        ((0.12, 0.16), (0.15, 0.2), (0.15, 0.2)),
        ((0.12, 0.16), (-0.16, 0.12), (-0.8 * TICK_S, 0.6 * TICK_S)),
        ((0.12, 0.16), (0.16, -0.12), (0.8 * TICK_S, -0.6 * TICK_S)),
        ((0.0, 0.2), (0.2, 0.1), (TICK_S, 0.1)),
        ((0.0, -0.2), (0.2, -0.1), (TICK_S, -0.1)),
        ((-0.2, 0.0), (-0.1, 0.2), (-0.1, TICK_S)),
        ((0.0, 0.1), (0.0, 0.25), (0.0, 0.1 + TICK_S)),
        ((0.03, 0.04), (0.15, 0.2), (0.03 + 0.6 * TICK_S, 0.04 + 0.8 * TICK_S)),
    ],
)
def test_every_direction_is_braked_and_accelerated_alike(
    before: tuple[float, float], asked: tuple[float, float], sent: tuple[float, float]
) -> None:
    velocity, limits = flown(SLOW, before, asked)[1]
    assert velocity == pytest.approx(sent)
    assert (limits == ()) == (sent == asked)


def test_rounding_may_add_to_the_acceleration() -> None:
    most = TICK_S + 1e-9
    assert flown(SLOW, (0.0, 0.0), (most, 0.0))[1][1] == ()
    assert flown(SLOW, (0.0, 0.0), (math.nextafter(most, 1.0), 0.0))[1][1] == (g.ACCELERATION,)


def test_what_was_sent_counts_and_not_what_was_asked() -> None:
    found = flown(SLOW, (0.0, 0.0), (9.0, 0.0), (9.0, 0.0))
    assert found[2][0] == pytest.approx((2 * TICK_S, 0.0))


def test_the_pull_of_a_position_is_accelerated_like_a_velocity() -> None:
    guard = Guard(SLOW)
    guard.check(setpoint(), sight())
    seen = later(sight(), 1)
    verdict = guard.check(setpoint((0.2, 0.0, -1.1), stamp_s=seen.now_s), seen)
    assert effective(verdict, seen, SLOW) == pytest.approx((TICK_S, 0.0))
    assert verdict.setpoint.position_ned_m == pytest.approx((0.0, 0.0, -1.1))
    assert verdict.limits == (g.ACCELERATION,)


def test_too_quick_a_start_leaves_the_climb_alone() -> None:
    guard = Guard(SLOW)
    guard.check(setpoint(), sight())
    seen = later(sight(), 1)
    verdict = guard.check(setpoint(HOME, (0.2, 0.05, -0.1), stamp_s=seen.now_s), seen)
    assert verdict.setpoint.velocity_ned_m_s[2] == -0.1
    assert verdict.limits == (g.ACCELERATION,)


def test_checking_twice_at_one_instant_gains_nothing() -> None:
    guard, asked = Guard(SLOW), setpoint(velocity=(0.25, 0.0, 0.0), stamp_s=NOW_S)
    guard.check(setpoint(), sight())
    seen = later(sight(), 1)
    first = guard.check(asked, seen)
    assert guard.check(asked, seen) == first
    assert guard.check(first.setpoint, seen).setpoint is first.setpoint


@pytest.mark.parametrize("towards", [(1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)])
def test_after_a_pause_the_vehicle_counts_as_being_at_rest(towards: tuple[float, float]) -> None:
    config = plain(acceleration_max_m_s2=0.5, setpoint_max_age_s=0.25, position_max_age_s=9.0)
    north, east = towards
    for ticks, limited in ((4, False), (4.1, True)):
        guard = Guard(config)
        guard.check(setpoint(velocity=(0.125 * north, 0.125 * east, 0.0)), sight())
        seen = later(sight(), ticks)
        asked = setpoint(velocity=(0.2 * north, 0.2 * east, 0.0), stamp_s=seen.now_s)
        verdict = guard.check(asked, seen)
        assert (verdict.limits == (g.ACCELERATION,)) == limited
        if limited:
            assert effective(verdict, seen) == pytest.approx((0.125 * north, 0.125 * east))


def test_where_time_runs_back_nothing_grows() -> None:
    guard = Guard(SLOW)
    for tick in (1, 2):
        seen = later(sight(), tick)
        guard.check(setpoint(velocity=(0.1, 0.0, 0.0), stamp_s=seen.now_s), seen)
    verdict = guard.check(setpoint(velocity=(0.2, 0.0, 0.0)), sight())
    assert effective(verdict, sight()) == pytest.approx((0.1, 0.0))


def test_a_beam_takes_its_component_away_at_once() -> None:
    guard = Guard(SLOW)
    guard.check(setpoint(velocity=(0.2, 0.0, 0.0)), sight())
    seen = later(sight(beams=(beam("front", 0.1),)), 1)
    asked = setpoint(velocity=(0.2, 0.03, 0.0), stamp_s=seen.now_s)
    verdict = guard.check(asked, seen)
    assert effective(verdict, seen) == pytest.approx((0.0, 0.03))
    assert verdict.limits == (g.BEAM,)


speeds = st.floats(-0.4, 0.4)


@settings(deadline=None, max_examples=200)
@given(st.lists(st.tuples(speeds, speeds), min_size=2, max_size=5))
def test_no_velocity_comes_from_nowhere(velocities: list[tuple[float, float]]) -> None:
    sent = [velocity for velocity, _ in flown(SLOW, *velocities)]
    for before, after in itertools.pairwise(sent):
        parts = [k / 64 for k in range(65)]
        gap = min(math.dist(after, (part * before[0], part * before[1])) for part in parts)
        assert gap <= TICK_S + 0.4 / 128
        assert math.hypot(*after) <= math.hypot(*before) + TICK_S + 1e-8


# ---------------------------------------------------------------- turning


def turned(
    config: GuardConfig, *yaws: tuple[float, float], step: float = 1.0
) -> list[tuple[float, tuple[str, ...]]]:
    """What was sent for (asked heading, the vehicle's heading), one a tick."""
    guard, found = Guard(config), []
    for tick, (asked, vehicle) in enumerate(yaws):
        seen = later(sight(yaw_rad=vehicle), tick * step)
        verdict = guard.check(setpoint(yaw_rad=asked, stamp_s=seen.now_s), seen)
        found.append((verdict.setpoint.yaw_rad, verdict.limits))
    return found


def test_a_first_heading_may_be_as_far_round_as_a_pause_allows() -> None:
    config = plain(yaw_rate_max_deg_s=math.degrees(1.0), setpoint_max_age_s=0.125)
    assert turned(config, (0.125, 0.0)) == [(0.125, ())]
    assert turned(config, (0.875, 1.0)) == [(0.875, ())]
    for sign in (1.0, -1.0):
        ((sent, limits),) = turned(config, (sign * 0.126, 0.0))
        assert sent == pytest.approx(sign * 0.125)
        assert limits == (g.YAW_RATE,)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("vehicle", [0.0, 3.0, -3.1])
def test_a_heading_runs_on_by_the_yaw_rate(sign: float, vehicle: float) -> None:
    far = vehicle + 2.0 * sign
    found = turned(TURNING, (vehicle, vehicle), (far, vehicle), (far, vehicle))
    assert wrap_pi(found[1][0] - vehicle) == pytest.approx(sign * TICK_S)
    assert wrap_pi(found[2][0] - vehicle) == pytest.approx(2.0 * sign * TICK_S)
    assert found[2][1] == (g.YAW_RATE,)
    assert -math.pi <= found[2][0] < math.pi


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_between_the_vehicles_heading_and_what_was_sent_every_heading_is_free(sign: float) -> None:
    ahead = 0.15 * sign
    for back, free in ((0.15, True), (0.1, True), (0.0, True), (-0.06, True), (-0.07, False)):
        found = turned(TURNING, (ahead, 0.0), (back * sign, 0.0))
        assert (found[1][1] == ()) == free
    assert turned(TURNING, (ahead, 0.0), (0.22 * sign, 0.0))[1][1] == (g.YAW_RATE,)
    assert turned(TURNING, (ahead, 0.0), (0.21 * sign, 0.0))[1][1] == ()


def test_a_vehicle_that_has_overtaken_its_setpoint_may_stop_where_it_is() -> None:
    assert turned(TURNING, (0.1, 0.0), (0.5, 0.5))[1] == (0.5, ())


def test_after_a_pause_the_heading_begins_at_the_vehicles() -> None:
    config = plain(yaw_rate_max_deg_s=math.degrees(0.5), setpoint_max_age_s=0.25)
    assert turned(config, (0.12, 0.0), (0.24, 0.0), step=4.0)[1] == (0.24, ())
    assert turned(config, (0.12, 0.0), (0.24, 0.0), step=4.1)[1][1] == (g.YAW_RATE,)


def test_rounding_may_add_to_the_turn() -> None:
    assert turned(TURNING, (0.0, 0.0), (TICK_S + 5e-10, 0.0))[1][1] == ()
    assert turned(TURNING, (0.0, 0.0), (TICK_S + 2e-9, 0.0))[1][1] == (g.YAW_RATE,)


def test_too_quick_a_turn_leaves_the_flight_alone() -> None:
    asked = setpoint((0.1, 0.0, -1.1), (0.1, 0.05, -0.1), yaw_rad=2.0)
    verdict = Guard(TURNING).check(asked, sight())
    assert verdict.setpoint.position_ned_m == pytest.approx(asked.position_ned_m)
    assert verdict.setpoint.velocity_ned_m_s == asked.velocity_ned_m_s
    assert verdict.limits == (g.YAW_RATE,)


# ---------------------------------------------------------------- repeated


OTHERS = {
    "position_ned_m": (0.0, 0.0, -1.001),
    "velocity_ned_m_s": (0.0, 0.101, 0.0),
    "yaw_rad": 0.01,
}


def repeated(
    ticks: int, velocity: Vector3 = (0.0, 0.1, 0.0), change: int = -1, field: str = ""
) -> tuple[str, ...]:
    """The limits of the last of several equal setpoints with fresh stamps, one a tick."""
    guard = Guard(plain(setpoint_max_age_s=0.25))
    limits: tuple[str, ...] = ()
    for tick in range(ticks + 1):
        now_s = NOW_S + tick * TICK_S
        asked = Setpoint(now_s, HOME, velocity)
        if tick == change:
            asked = msgspec.structs.replace(asked, **{field: OTHERS[field]})
        limits = guard.check(asked, later(sight(), tick)).limits
    return limits


def test_the_same_motion_again_and_again_is_nobodys() -> None:
    assert repeated(4) == ()
    assert repeated(5) == (g.SETPOINT_REPEATED,)
    assert repeated(5, (0.1, 0.0, 0.0)) == (g.SETPOINT_REPEATED,)
    assert repeated(5, (0.0, 0.0, -0.1)) == (g.SETPOINT_REPEATED,)


def test_the_same_place_again_and_again_is_a_hold() -> None:
    assert repeated(50, (0.0, 0.0, 0.0)) == ()


@pytest.mark.parametrize("field", ["position_ned_m", "velocity_ned_m_s", "yaw_rad"])
def test_whatever_changes_shows_that_somebody_flies(field: str) -> None:
    assert repeated(5, change=1, field=field) == ()
    assert repeated(7, change=1, field=field) == (g.SETPOINT_REPEATED,)


def test_a_motion_that_is_repeated_becomes_a_hold_with_the_vehicles_heading() -> None:
    guard = Guard(plain())
    for tick in range(9):
        seen = later(sight((0.01 * tick, 0.0, -1.0), yaw_rad=0.5), tick)
        asked = setpoint(HOME, (0.1, 0.0, 0.0), stamp_s=seen.now_s)
        verdict = guard.check(asked, seen)
    assert verdict.limits == (g.SETPOINT_REPEATED,)
    assert is_hold_at(verdict, (0.04, 0.0, -1.0))
    assert verdict.setpoint.yaw_rad == 0.5


# ---------------------------------------------------------------- a program that dies


def test_a_setpoint_that_is_flown_on_blindly_ends_before_what_is_ahead() -> None:
    config = plain(blind_s=1.4)
    for free_m, speed in ((0.07, 0.05), (0.14, 0.1), (0.28, 0.2), (0.35, 0.25), (0.5, 0.25)):
        seen = sight(hits=((free_m + 0.185, 0.0),))
        verdict = Guard(config).check(setpoint(velocity=(0.3, 0.0, 0.0)), seen)
        assert effective(verdict, seen, config)[0] == pytest.approx(speed)


def test_the_longer_of_stop_and_blind_flight_counts() -> None:
    config = plain(blind_s=1.0, speed_max_m_s=2.0)
    for speed in (0.1, 0.3, 0.399, 0.401, 0.6, 2.0):
        needed = max(speed, 0.6 * speed + speed * speed)
        assert g.needed_distance_m(speed, config) == pytest.approx(needed)
        assert g.allowed_speed_m_s(needed, config) == pytest.approx(speed)
    assert Guard(config).horizon_m == pytest.approx(5.2)
    assert Guard(plain(blind_s=1.4)).horizon_m == pytest.approx(0.35)
    assert g.allowed_speed_m_s(99.0, config) == 2.0


@pytest.mark.parametrize("blind_s", [0.0, 1.4])
@pytest.mark.parametrize("distance_m", [0.0, -0.1])
def test_without_room_no_speed_is_allowed(distance_m: float, blind_s: float) -> None:
    assert g.allowed_speed_m_s(distance_m, plain(blind_s=blind_s)) == 0.0


def test_a_vehicle_that_hears_is_braked_by_what_stops_it_only() -> None:
    # 0.2 m/s stop in 0.16 m and are flown on blindly for 0.28 m.
    config = plain(blind_s=1.4)
    seen = sight(velocity=(0.2, 0.0, 0.0), hits=((0.17 + 0.185, 0.0),))
    verdict = Guard(config).check(setpoint(velocity=(0.2, 0.0, 0.0)), seen)
    assert verdict.limits == (g.FREE_SPACE,)
    assert effective(verdict, seen, config)[0] == pytest.approx(0.17 / 1.4)


def test_an_escape_is_flown_on_blindly_to_the_fence_at_most() -> None:
    config = plain(blind_s=1.4, fence=Fence.rectangle((-0.05, 1.0), (-1.0, 1.0)))
    seen = sight(hits=((0.17, 0.0),))
    verdict = Guard(config).check(setpoint(velocity=(-0.1, 0.0, 0.0)), seen)
    assert effective(verdict, seen, config)[0] == pytest.approx(-0.05 / 1.4)


# ---------------------------------------------------------------- the width of the corridor


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize(("sigma_m", "limited"), [(0.02, False), (0.029, False), (0.031, True)])
def test_an_uncertain_position_widens_the_corridor_beyond_what_it_has_room_for(
    sigma_m: float, side: float, *, limited: bool
) -> None:
    config = plain(corridor_sigma_m=0.02)
    for heading in (0.0, 2.0):
        c, s = math.cos(heading), math.sin(heading)
        ahead, aside = 0.2, side * 0.195
        hit = (c * ahead - s * aside, s * ahead + c * aside)
        asked = setpoint(velocity=(0.2 * c, 0.2 * s, 0.0))
        verdict = Guard(config).check(asked, sight(hits=(hit,), sigma_m=sigma_m))
        assert (verdict.limits == (g.FREE_SPACE,)) == limited


def test_the_nearest_of_the_three_corridors_counts() -> None:
    config = plain(corridor_sigma_m=0.0)
    for aside in (0.25, -0.25):
        hits = ((0.35, 0.0), (0.25, aside))
        seen = sight(hits=hits, sigma_m=0.1)
        verdict = Guard(config).check(setpoint(velocity=(0.2, 0.0, 0.0)), seen)
        expected = 0.25 - math.sqrt(0.185**2 - 0.15**2) - 0.1
        assert verdict.free_distance_m == pytest.approx(expected)


def test_between_corridors_far_aside_the_middle_one_counts() -> None:
    seen = sight(hits=((0.5, 0.0),), sigma_m=0.25)
    config = plain(corridor_sigma_m=0.0, blind_s=1.4)
    verdict = Guard(config).check(setpoint(velocity=(0.2, 0.0, 0.0)), seen)
    assert verdict.free_distance_m == pytest.approx(0.5 - 0.185 - 0.25)


class BrokenWorld(DiscWorld):
    """Seen space that answers with what is no number."""

    def free_distance_m(self, *_: object) -> float:
        return math.nan

    def nearest_hit(self, *_: object) -> tuple[float, float]:
        return (0.1, math.nan)


def test_what_is_no_number_is_no_free_space() -> None:
    verdict = Guard(plain()).check(setpoint(velocity=(0.1, 0.0, 0.0)), sight(space=BrokenWorld()))
    assert verdict.limits == (g.FREE_SPACE,)
    assert is_hold_at(verdict, HOME)


def test_a_setpoint_beyond_all_numbers_is_leashed_to_here() -> None:
    asked = setpoint((1.7e308, 0.0, -1.0))
    verdict = Guard(plain()).check(asked, sight((-1.7e308, 0.0, -1.0)))
    assert verdict.setpoint.position_ned_m == (-1.7e308, 0.0, -1.0)
    assert g.LEASH in verdict.limits


# ---------------------------------------------------------------- holds


@pytest.mark.parametrize(
    ("config", "reach_m"),
    [
        (plain(speed_max_m_s=0.19), 0.2),
        (plain(speed_max_m_s=1.0, leash_m=0.25), 0.25),
        (plain(speed_max_m_s=1.0), 0.3),
        (plain(speed_max_m_s=0.1, position_gain_per_s=0.0), 0.3),
    ],
)
def test_a_hold_pulls_no_faster_and_no_farther_than_a_setpoint_may(
    config: GuardConfig, reach_m: float
) -> None:
    for moved_m, kept in ((reach_m - 1e-6, True), (reach_m + 1e-6, False)):
        guard = Guard(config)
        guard.check(setpoint(), sight(ok=False))
        verdict = guard.check(setpoint(), sight((moved_m, 0.0, -1.0), ok=False))
        assert (verdict.setpoint.position_ned_m[0] == 0.0) == kept


@pytest.mark.parametrize(
    ("command_m_s", "free_m", "held"),
    [
        (0.0, 0.1, True),
        (0.03, 0.1, True),
        (0.031, 0.1, False),
        (-0.02, 0.1, True),
        (0.0, 0.17, False),
    ],
)
def test_a_command_to_stop_holds_a_vehicle_that_is_faster_than_stops_in_time(
    command_m_s: float, free_m: float, *, held: bool
) -> None:
    # "Zero velocity, wherever you are by now" follows the vehicle; a hold does not.
    guard = Guard(plain())
    for north in (0.0, 0.01):
        velocity = (0.2, 0.0, 0.0)
        seen = sight((north, 0.0, -1.0), velocity, hits=((north + free_m + 0.185, 0.0),))
        asked = setpoint(seen.position_ned_m, (command_m_s, 0.0, 0.0))
        verdict = guard.check(asked, seen)
        assert (verdict.limits == (g.BRAKE,)) == held
    assert is_hold_at(verdict, HOME) == held


def test_a_command_to_stop_where_the_feed_forward_cancels_the_position_holds_too() -> None:
    seen = sight(velocity=(0.2, 0.0, 0.0), hits=((0.285, 0.0),))
    config = plain(position_gain_per_s=0.5)
    asked = setpoint((0.125, 0.0, -1.0), (-0.0625, 0.0, 0.0))
    verdict = Guard(config).check(asked, seen)
    assert verdict.limits == (g.BRAKE,)
    assert is_hold_at(verdict, HOME)
