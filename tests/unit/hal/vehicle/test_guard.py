import math

import msgspec
import pytest

from hal.config import Fence
from hal.errors import ReadingRefused
from hal.frames import Vector3
from hal.vehicle import guard as g
from hal.vehicle.guard import Guard
from tests.unit.hal.vehicle.guard_world import (
    CONFIG,
    CORRIDOR_M,
    HOME,
    L_SHAPE,
    MOUNTS,
    NOW_S,
    SQUARE,
    DiscWorld,
    beam,
    effective,
    is_hold_at,
    plain,
    setpoint,
    sight,
)

# ---------------------------------------------------------------- stopping


@pytest.mark.parametrize("distance_m", [0.0, -0.0, -0.3, -math.inf])
def test_without_room_the_stopping_speed_is_zero(distance_m: float) -> None:
    assert g.stopping_speed_m_s(distance_m, 0.6, 0.5) == 0.0


# ---------------------------------------------------------------- nothing to do


@pytest.mark.parametrize(
    ("position", "velocity"),
    [
        (HOME, (0.0, 0.0, 0.0)),
        ((0.1, 0.05, -1.0), (0.1, 0.0, 0.0)),
        (HOME, (CONFIG.speed_max_m_s, 0.0, 0.0)),
        ((0.0, 0.0, -1.1), (0.0, 0.0, -0.1)),
        ((0.2, 0.0, -1.0), (-0.25, 0.0, 0.0)),
    ],
)
def test_a_setpoint_within_every_limit_comes_back_as_the_very_same_object(
    position: Vector3, velocity: Vector3
) -> None:
    asked = setpoint(position, velocity)
    beams = tuple(beam(name, 0.4) for name in MOUNTS)
    verdict = Guard(CONFIG).check(asked, sight(beams=beams, hits=((1.0, 1.0),)))
    assert verdict.setpoint is asked
    assert verdict.limits == ()
    assert verdict.speed_limit_m_s == CONFIG.speed_max_m_s


def test_another_limit_leaves_the_yaw_alone() -> None:
    asked = setpoint(velocity=(1.0, 0.0, 0.0), yaw_rad=2.5)
    verdict = Guard(CONFIG).check(asked, sight(yaw_rad=-1.0))
    assert verdict.setpoint.yaw_rad == 2.5


@pytest.mark.parametrize("field", ["now_s", "fused_stamp_s", "yaw_rad", "position_sigma_m"])
@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_a_sight_that_is_no_number_is_refused(field: str, value: float) -> None:
    with pytest.raises(ReadingRefused):
        msgspec.structs.replace(sight(), **{field: value})


def test_a_sight_with_a_position_or_velocity_that_is_no_number_is_refused() -> None:
    with pytest.raises(ReadingRefused):
        sight((math.nan, 0.0, 0.0))
    with pytest.raises(ReadingRefused):
        sight(velocity=(0.0, math.inf, 0.0))
    with pytest.raises(ReadingRefused):
        sight(sigma_m=-0.1)


# ---------------------------------------------------------------- (1) age


@pytest.mark.parametrize(
    ("age_s", "stale"), [(0.0, False), (0.19, False), (0.21, True), (-0.19, False), (-0.21, True)]
)
def test_an_old_or_future_setpoint_becomes_a_hold(age_s: float, *, stale: bool) -> None:
    asked = setpoint((0.3, 0.0, -1.0), (0.05, 0.0, 0.0), yaw_rad=1.0, stamp_s=NOW_S - age_s)
    verdict = Guard(CONFIG).check(asked, sight((0.1, 0.2, -1.1), yaw_rad=0.5))
    assert (verdict.limits == (g.SETPOINT_STALE,)) == stale
    if stale:
        assert is_hold_at(verdict, (0.1, 0.2, -1.1))
        assert verdict.setpoint.yaw_rad == 0.5
        assert verdict.setpoint.stamp_s == NOW_S
        assert verdict.speed_limit_m_s == 0.0


@pytest.mark.parametrize(("age_s", "stale"), [(0.29, False), (0.31, True)])
def test_an_old_position_holds_at_the_last_known_one(age_s: float, *, stale: bool) -> None:
    asked = setpoint((0.3, 0.0, -1.0))
    verdict = Guard(CONFIG).check(asked, sight(stamp_s=NOW_S - age_s))
    assert (verdict.limits == (g.POSITION_STALE,)) == stale
    assert is_hold_at(verdict, HOME) == stale


def test_a_position_that_the_estimator_does_not_trust_is_held() -> None:
    verdict = Guard(CONFIG).check(setpoint((0.3, 0.0, -1.0)), sight(ok=False))
    assert verdict.limits == (g.POSITION_STALE,)
    assert is_hold_at(verdict, HOME)


def test_a_hold_keeps_the_place_where_it_began() -> None:
    guard = Guard(CONFIG)
    asked = setpoint((0.3, 0.0, -1.0))
    guard.check(asked, sight((0.0, 0.0, -1.0), ok=False))
    drifted = guard.check(asked, sight((0.1, 0.05, -1.0), ok=False))
    assert is_hold_at(drifted, (0.0, 0.0, -1.0))


def test_a_hold_that_is_checked_again_goes_on() -> None:
    guard = Guard(CONFIG)
    asked = setpoint(velocity=(0.2, 0.0, 0.0))
    held = guard.check(asked, sight(space=DiscWorld(seen_m=0.0))).setpoint
    assert guard.check(held, sight(space=DiscWorld(seen_m=0.0))).setpoint is held
    drifted = guard.check(asked, sight((0.05, 0.0, -1.0), space=DiscWorld(seen_m=0.0)))
    assert is_hold_at(drifted, HOME)


def test_a_hold_for_want_of_a_position_is_the_same_object_when_checked_again() -> None:
    guard = Guard(CONFIG)
    held = guard.check(setpoint((0.3, 0.0, -1.0)), sight(ok=False)).setpoint
    again = guard.check(held, sight(ok=False))
    assert again.setpoint is held
    assert again.limits == (g.POSITION_STALE,)


def test_a_hold_begins_anew_after_motion_was_allowed() -> None:
    guard = Guard(CONFIG)
    asked = setpoint((0.3, 0.0, -1.0))
    guard.check(asked, sight((0.0, 0.0, -1.0), ok=False))
    guard.check(setpoint((0.2, 0.0, -1.0)), sight((0.1, 0.0, -1.0)))
    again = guard.check(asked, sight((0.1, 0.05, -1.0), ok=False))
    assert is_hold_at(again, (0.1, 0.05, -1.0))


@pytest.mark.parametrize(("moved_m", "kept"), [(0.29, True), (0.31, False)])
def test_a_hold_does_not_pull_from_far(moved_m: float, *, kept: bool) -> None:
    guard = Guard(plain(speed_max_m_s=1.0))
    guard.check(setpoint(), sight(ok=False))
    verdict = guard.check(setpoint(), sight((moved_m, 0.0, -1.0), ok=False))
    assert verdict.setpoint.position_ned_m[0] == (0.0 if kept else moved_m)


def test_a_hold_does_not_pull_towards_a_near_beam() -> None:
    guard = Guard(CONFIG)
    guard.check(setpoint(), sight(ok=False))
    near = (beam("front", 0.1),)
    verdict = guard.check(setpoint(), sight((-0.1, 0.0, -1.0), ok=False, beams=near))
    assert is_hold_at(verdict, (-0.1, 0.0, -1.0))


# ---------------------------------------------------------------- (2) speed and free space


def test_the_effective_velocity_is_capped_and_keeps_its_direction() -> None:
    seen = sight()
    verdict = Guard(CONFIG).check(setpoint((0.4, 0.0, -1.0), (0.1, 0.2, 0.0)), seen)
    n, e = effective(verdict, seen)
    assert verdict.limits == (g.SPEED,)
    assert math.hypot(n, e) == pytest.approx(CONFIG.speed_max_m_s)
    assert math.atan2(e, n) == pytest.approx(math.atan2(0.2, 0.1 + 0.95 * 0.4))


def test_a_fast_feed_forward_is_capped_even_when_the_position_error_cancels_it() -> None:
    verdict = Guard(CONFIG).check(setpoint((-0.5, 0.0, -1.0), (0.475, 0.0, 0.0)), sight())
    assert verdict.limits == (g.SPEED,)
    assert verdict.setpoint.velocity_ned_m_s[0] == pytest.approx(CONFIG.speed_max_m_s)


@pytest.mark.parametrize("sigma_m", [0.0, 0.02])
@pytest.mark.parametrize("free_m", [0.03, 0.1, 0.15, 0.2])
def test_the_speed_towards_a_hit_is_the_one_that_stops_before_its_corridor(
    free_m: float, sigma_m: float
) -> None:
    seen = sight(hits=((free_m + CORRIDOR_M, 0.0),), sigma_m=sigma_m)
    verdict = Guard(CONFIG).check(setpoint(velocity=(0.25, 0.0, 0.0)), seen)
    at = CONFIG.braking_m_s2 * CONFIG.reaction_s
    allowed = -at + math.sqrt(at * at + 2.0 * CONFIG.braking_m_s2 * (free_m - sigma_m))
    assert verdict.limits == (g.FREE_SPACE,)
    assert effective(verdict, seen) == pytest.approx((allowed, 0.0))
    assert verdict.speed_limit_m_s == pytest.approx(allowed)
    assert verdict.free_distance_m == pytest.approx(free_m - sigma_m)


def test_the_position_offset_is_scaled_with_the_velocity() -> None:
    seen = sight(hits=((0.05 + CORRIDOR_M, 0.0),))
    verdict = Guard(CONFIG).check(setpoint((0.1, 0.0, -1.0), (0.1, 0.0, 0.0)), seen)
    sp = verdict.setpoint
    assert sp.position_ned_m[0] == pytest.approx(sp.velocity_ned_m_s[0])
    assert sp.velocity_ned_m_s[0] < 0.1


@pytest.mark.parametrize("sigma_m", [0.051, 0.2])
def test_less_room_than_the_uncertainty_is_a_hold(sigma_m: float) -> None:
    seen = sight(hits=((0.05 + CORRIDOR_M, 0.0),), sigma_m=sigma_m)
    verdict = Guard(CONFIG).check(setpoint((0.1, 0.0, -1.0), (0.1, 0.0, 0.0)), seen)
    assert verdict.limits == (g.FREE_SPACE,)
    assert is_hold_at(verdict, HOME)
    assert verdict.free_distance_m == 0.0


def test_space_that_was_not_seen_is_not_flown_into() -> None:
    verdict = Guard(CONFIG).check(
        setpoint(velocity=(0.2, 0.0, 0.0)), sight(space=DiscWorld(seen_m=0.0))
    )
    assert is_hold_at(verdict, HOME)


def test_a_blocked_way_does_not_stop_the_climb() -> None:
    seen = sight(space=DiscWorld(seen_m=0.0))
    verdict = Guard(CONFIG).check(setpoint((0.1, 0.0, -1.1), (0.2, 0.0, -0.1)), seen)
    assert verdict.setpoint.position_ned_m == pytest.approx((0.0, 0.0, -1.1))
    assert verdict.setpoint.velocity_ned_m_s == (0.0, 0.0, -0.1)


def test_space_is_asked_no_farther_than_needed() -> None:
    world = DiscWorld()
    guard = Guard(CONFIG)
    asked = setpoint(velocity=(CONFIG.speed_max_m_s, 0.0, 0.0))
    assert guard.check(asked, sight(space=world, sigma_m=0.02)).setpoint is asked
    ((limit_m, now_s),) = world.asked
    assert limit_m == pytest.approx(guard.horizon_m + 0.02)
    assert now_s == NOW_S


# ---------------------------------------------------------------- (3) the actual velocity


def test_a_vehicle_too_fast_to_stop_is_held_where_braking_began() -> None:
    guard = Guard(CONFIG)
    world = DiscWorld(((0.1 + CORRIDOR_M, 0.0),))
    asked = setpoint(velocity=(0.2, 0.0, 0.0))
    verdict = guard.check(asked, sight(velocity=(0.2, 0.0, 0.0), space=world))
    assert verdict.limits == (g.BRAKE, g.FREE_SPACE)
    assert is_hold_at(verdict, HOME)
    later = guard.check(asked, sight((0.04, 0.0, -1.0), (0.15, 0.0, 0.0), space=world))
    assert is_hold_at(later, HOME)


@pytest.mark.parametrize(("speed_m_s", "brakes"), [(0.134, False), (0.138, True)])
def test_braking_begins_exactly_at_the_stopping_distance(speed_m_s: float, *, brakes: bool) -> None:
    world = DiscWorld(((0.1 + CORRIDOR_M, 0.0),))
    seen = sight(velocity=(speed_m_s, 0.0, 0.0), space=world)
    verdict = Guard(CONFIG).check(setpoint(velocity=(0.2, 0.0, 0.0)), seen)
    assert g.stopping_speed_m_s(0.1, CONFIG.reaction_s, CONFIG.braking_m_s2) == pytest.approx(
        0.1359, abs=1e-4
    )
    assert (g.BRAKE in verdict.limits) == brakes


@pytest.mark.parametrize("command", [(-0.1, 0.0, 0.0), (0.0, 0.1, 0.0), (0.05, 0.0, 0.0)])
def test_a_command_that_already_slows_or_turns_away_is_left_alone(command: Vector3) -> None:
    seen = sight(velocity=(0.25, 0.0, 0.0), hits=((0.1 + CORRIDOR_M, 0.0),))
    asked = setpoint(velocity=command)
    assert Guard(CONFIG).check(asked, seen).setpoint is asked


def test_even_a_slow_push_is_braked_when_the_vehicle_is_fast() -> None:
    seen = sight(velocity=(0.2, 0.0, 0.0), hits=((0.005 + CORRIDOR_M, 0.0),))
    verdict = Guard(CONFIG).check(setpoint(velocity=(0.015, 0.0, 0.0)), seen)
    assert verdict.limits == (g.BRAKE, g.FREE_SPACE)


def test_a_vehicle_that_drifts_aside_towards_a_hit_is_held() -> None:
    seen = sight(velocity=(0.0, 0.2, 0.0), hits=((0.0, 0.02 + CORRIDOR_M),))
    verdict = Guard(CONFIG).check(setpoint(velocity=(0.1, 0.1, 0.0)), seen)
    assert g.BRAKE in verdict.limits
    assert is_hold_at(verdict, HOME)


def test_velocity_noise_beside_a_wall_does_not_stop_the_flight_along_it() -> None:
    wall = tuple((n / 20.0, CORRIDOR_M) for n in range(-20, 40))
    seen = sight(velocity=(0.02, 0.02, 0.0), hits=wall)
    asked = setpoint(velocity=(0.1, 0.0, 0.0))
    assert Guard(CONFIG).check(asked, seen).setpoint is asked


# ---------------------------------------------------------------- (5) fence


@pytest.mark.parametrize("room_m", [0.02, 0.1, 0.2])
@pytest.mark.parametrize("heading", [0.0, 0.5 * math.pi, math.pi, -0.5 * math.pi])
def test_the_speed_towards_the_fence_is_the_one_that_stops_inside(
    room_m: float, heading: float
) -> None:
    un, ue = math.cos(heading), math.sin(heading)
    seen = sight(((1.0 - room_m) * un, (1.0 - room_m) * ue, -1.0))
    verdict = Guard(SQUARE).check(setpoint(seen.position_ned_m, (0.25 * un, 0.25 * ue, 0.0)), seen)
    speed = math.hypot(*effective(verdict, seen))
    assert verdict.limits == (g.FENCE,)
    assert g.stopping_distance_m(speed, SQUARE.reaction_s, SQUARE.braking_m_s2) == pytest.approx(
        room_m
    )


def test_flight_along_the_fence_is_free() -> None:
    seen = sight((0.0, 0.999, -1.0))
    asked = setpoint((0.0, 0.999, -1.0), (0.25, 0.0, 0.0))
    assert Guard(SQUARE).check(asked, seen).setpoint is asked


def test_an_edge_counts_only_where_it_is() -> None:
    seen = sight((-0.1, -0.05, -1.0))
    asked = setpoint(seen.position_ned_m, (0.0, 0.25, 0.0))
    assert Guard(L_SHAPE).check(asked, seen).setpoint is asked
    inside_the_arm = sight((0.5, -0.05, -1.0))
    verdict = Guard(L_SHAPE).check(setpoint((0.5, -0.05, -1.0), (0.0, 0.25, 0.0)), inside_the_arm)
    assert verdict.limits == (g.FENCE,)


@pytest.mark.parametrize(
    ("velocity", "passes"),
    [
        ((0.1, 0.0, 0.0), False),
        ((0.0, 0.1, 0.0), False),
        ((-0.02, 0.1, 0.0), False),
        ((-0.1, 0.1, 0.0), True),
        ((-0.2, 0.0, 0.0), True),
    ],
)
@pytest.mark.parametrize("beyond_m", [0.0, 0.001, 0.3])
def test_outside_the_fence_only_motion_that_leads_inwards_passes(
    velocity: Vector3, beyond_m: float, *, passes: bool
) -> None:
    seen = sight((1.0 + beyond_m, 0.3, -1.0))
    asked = setpoint(seen.position_ned_m, velocity)
    verdict = Guard(SQUARE).check(asked, seen)
    assert (verdict.setpoint is asked) == passes
    assert is_hold_at(verdict, seen.position_ned_m) != passes


def test_the_uncertainty_counts_at_the_fence_too() -> None:
    seen = sight((0.95, 0.0, -1.0), sigma_m=0.06)
    verdict = Guard(SQUARE).check(setpoint((0.95, 0.0, -1.0), (0.1, 0.0, 0.0)), seen)
    assert verdict.limits == (g.FENCE,)
    assert is_hold_at(verdict, seen.position_ned_m)


def test_the_fence_is_found_again_after_a_long_way() -> None:
    guard = Guard(SQUARE)
    asked = setpoint(velocity=(0.1, 0.0, 0.0))
    assert guard.check(asked, sight()).limits == ()
    outside = sight((1.5, 0.0, -1.0))
    assert guard.check(setpoint((1.5, 0.0, -1.0), (0.1, 0.0, 0.0)), outside).limits == (g.FENCE,)
    assert guard.check(asked, sight()).limits == ()


# ---------------------------------------------------------------- (7) leash


@pytest.mark.parametrize(("far_m", "limited"), [(0.599, False), (0.6, False), (0.601, True)])
def test_the_position_setpoint_is_on_a_leash(far_m: float, *, limited: bool) -> None:
    # The feed-forward keeps the effective velocity small: the leash alone is asked.
    seen = sight()
    asked = setpoint((0.6 * far_m, 0.8 * far_m, -1.0), (-0.15, -0.2, 0.0))
    config = plain(speed_max_m_s=1.0)
    verdict = Guard(config).check(asked, seen)
    assert (g.LEASH in verdict.limits) == limited
    if limited:
        assert verdict.setpoint.position_ned_m == pytest.approx((0.36, 0.48, -1.0))


# ---------------------------------------------------------------- (8) escape


def test_a_vehicle_too_near_to_a_hit_may_creep_away_from_it() -> None:
    seen = sight(hits=((0.16, 0.0),))
    verdict = Guard(CONFIG).check(setpoint(velocity=(-0.2, 0.0, 0.0)), seen)
    assert effective(verdict, seen) == pytest.approx((-g.ESCAPE_SPEED_M_S, 0.0))
    assert verdict.limits == (g.FREE_SPACE,)
    slow = setpoint(velocity=(-0.05, 0.0, 0.0))
    assert Guard(CONFIG).check(slow, seen).setpoint is slow


@pytest.mark.parametrize(
    ("off_deg", "passes"), [(0.0, True), (40.0, True), (65.0, True), (68.0, False), (90.0, False)]
)
def test_an_escape_leads_clearly_away(off_deg: float, *, passes: bool) -> None:
    angle = math.pi + math.radians(off_deg)
    asked = setpoint(velocity=(0.05 * math.cos(angle), 0.05 * math.sin(angle), 0.0))
    verdict = Guard(CONFIG).check(asked, sight(hits=((0.17, 0.0),)))
    assert (verdict.setpoint is asked) == passes


def test_an_escape_must_reach_open_space_within_a_short_step() -> None:
    asked = setpoint(velocity=(-0.05, 0.0, 0.0))
    assert Guard(CONFIG).check(asked, sight(hits=((0.086, 0.0),))).setpoint is asked
    assert is_hold_at(Guard(CONFIG).check(asked, sight(hits=((0.08, 0.0),))), HOME)
    between = sight(hits=((0.17, 0.0), (-0.2, 0.0)))
    assert is_hold_at(Guard(CONFIG).check(asked, between), HOME)


def test_nothing_escapes_into_space_that_was_not_seen() -> None:
    world = DiscWorld(((0.17, 0.0),), seen_m=0.01)
    verdict = Guard(CONFIG).check(setpoint(velocity=(-0.05, 0.0, 0.0)), sight(space=world))
    assert is_hold_at(verdict, HOME)


def test_without_a_near_hit_there_is_nothing_to_escape_from() -> None:
    world = DiscWorld(((0.4, 0.0),), seen_m=0.0)
    verdict = Guard(CONFIG).check(setpoint(velocity=(-0.05, 0.0, 0.0)), sight(space=world))
    assert is_hold_at(verdict, HOME)


def test_a_place_that_was_not_seen_is_no_reason_to_escape_from_it() -> None:
    world = DiscWorld(seen_m=1.0)
    seen = sight((1.05, 0.0, -1.0), space=world)
    verdict = Guard(CONFIG).check(setpoint((1.05, 0.0, -1.0), (-0.05, 0.0, 0.0)), seen)
    assert is_hold_at(verdict, (1.05, 0.0, -1.0))


def test_a_way_that_is_short_but_free_is_no_escape() -> None:
    # A hit behind, and one aside whose corridor begins a millimetre ahead.
    seen = sight(hits=((-0.18502, 0.0), (0.007, 0.1849)))
    verdict = Guard(CONFIG).check(setpoint(velocity=(0.05, 0.0, 0.0)), seen)
    assert math.hypot(*effective(verdict, seen)) < 0.002


def test_an_escape_respects_fence_and_beams() -> None:
    fence = plain(fence=Fence.rectangle((-0.005, 1.0), (-1.0, 1.0)))
    asked = setpoint(velocity=(-0.05, 0.0, 0.0))
    seen = sight(hits=((0.17, 0.0),))
    limited = Guard(fence).check(asked, seen)
    assert math.hypot(*effective(limited, seen)) < 0.0085
    unsure = msgspec.structs.replace(seen, position_sigma_m=0.004)
    assert math.hypot(*effective(Guard(fence).check(asked, unsure), unsure)) < 0.0018
    behind = sight(hits=((0.17, 0.0),), beams=(beam("back", 0.15),))
    assert is_hold_at(Guard(CONFIG).check(asked, behind), HOME)


def test_an_escape_is_not_braked_by_its_own_speed() -> None:
    seen = sight(velocity=(-0.06, 0.0, 0.0), hits=((0.17, 0.0),))
    asked = setpoint(velocity=(-0.06, 0.0, 0.0))
    assert Guard(CONFIG).check(asked, seen).setpoint is asked
