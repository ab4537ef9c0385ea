"""The guard exactly on its borders, and its formulas by numbers worked out by hand.

Where a limit is compared with a number that a test can hit to the last bit, the test does.
"""

import dataclasses
import itertools
import math
from typing import Any

import pytest

from hal.config import BeamMount, Fence, GuardConfig
from hal.frames import Vector3
from hal.readings import RangeStatus
from hal.vehicle import guard as g
from hal.vehicle.guard import BeamSight, Guard, GuardVerdict, Sight, room, vertical
from hal.vehicle.guard.around import Beam, Surroundings
from hal.vehicle.guard.fence_ahead import crossing_m
from tests.unit.hal.vehicle.guard_world import (
    CONFIG,
    HOME,
    MOUNTS,
    NOW_S,
    SQUARE,
    DiscWorld,
    beam,
    climb,
    effective,
    is_hold_at,
    plain,
    setpoint,
    sight,
)

FAST = plain(speed_max_m_s=2.0, climb_max_m_s=2.0)
HALVES = plain(speed_max_m_s=0.5, beam_stop_m=0.25, position_max_age_s=0.25)
"""Limits that are sums of powers of two."""
NEARLY = 1.0 + 1e-9
"""What rounding is allowed to add."""


@dataclasses.dataclass
class ToldWorld:
    """Seen space that answers what it is told, and remembers what it was asked."""

    free_m: float = 9.0
    nearest: tuple[float, float] | None = None
    free_elsewhere_m: float = 0.0
    asked: list[tuple[Vector3, float, float]] = dataclasses.field(default_factory=list)
    asked_nearest: list[tuple[Vector3, float]] = dataclasses.field(default_factory=list)

    def free_distance_m(
        self, position_ned_m: Vector3, heading_rad: float, limit_m: float, now_s: float
    ) -> float:
        assert now_s == NOW_S
        self.asked.append((position_ned_m, heading_rad, limit_m))
        told = self.free_m if len(self.asked) == 1 else self.free_elsewhere_m
        return min(limit_m, told)

    def clearance_m(self, position_ned_m: Vector3, limit_m: float) -> float:
        self.asked_nearest.append((position_ned_m, limit_m))
        return limit_m

    def nearest_hit(self, position_ned_m: Vector3, limit_m: float) -> tuple[float, float] | None:
        self.asked_nearest.append((position_ned_m, limit_m))
        return self.nearest


def told(position: Vector3 = HOME, *, world: ToldWorld, sigma_m: float = 0.0) -> Sight:
    return Sight(
        now_s=NOW_S,
        fused_stamp_s=NOW_S,
        position_ned_m=position,
        velocity_ned_m_s=(0.0, 0.0, 0.0),
        yaw_rad=0.0,
        space=world,
        position_sigma_m=sigma_m,
    )


# ---------------------------------------------------------------- records


@pytest.mark.parametrize("record", [BeamSight, Sight, GuardVerdict, Beam, Surroundings])
def test_what_the_guard_sees_and_says_cannot_be_changed(record: Any) -> None:
    assert record.__struct_config__.frozen


def test_a_sight_is_certain_and_trusted_and_without_beams_unless_told_otherwise() -> None:
    plain = Sight(NOW_S, NOW_S, HOME, (0.0, 0.0, 0.0), 0.0, DiscWorld())
    assert (plain.position_sigma_m, plain.position_ok, plain.beams) == (0.0, True, ())


# ---------------------------------------------------------------- stopping


@pytest.mark.parametrize(
    ("speed_m_s", "distance_m"), [(0.0, 0.0), (0.05, 0.0325), (0.1, 0.07), (0.2, 0.16), (0.3, 0.27)]
)
def test_the_bound_of_the_table(speed_m_s: float, distance_m: float) -> None:
    assert g.stopping_distance_m(speed_m_s, 0.6, 0.5) == pytest.approx(distance_m)
    assert g.stopping_speed_m_s(distance_m, 0.6, 0.5) == pytest.approx(speed_m_s)


def test_stopping_by_numbers_that_do_not_hide_in_each_other() -> None:
    # 3 * 0.7 + 9 / (2 * 4); at = 2.8: sqrt(7.84 + 8 * 3.225) - 2.8 = 3.
    assert g.stopping_distance_m(3.0, 0.7, 4.0) == pytest.approx(3.225)
    assert g.stopping_speed_m_s(3.225, 0.7, 4.0) == pytest.approx(3.0)


# ---------------------------------------------------------------- age


@pytest.mark.parametrize(("age_s", "stale"), [(0.25, False), (0.25 + 1e-9, True)])
def test_a_position_as_old_as_allowed_is_flown_by(age_s: float, *, stale: bool) -> None:
    verdict = Guard(HALVES).check(setpoint(), sight(stamp_s=NOW_S - age_s))
    assert (verdict.limits == (g.POSITION_STALE,)) is stale


@pytest.mark.parametrize(("age_s", "stale"), [(0.25, False), (-0.25, False), (0.25 + 1e-9, True)])
def test_a_setpoint_as_old_or_as_early_as_allowed_is_flown(age_s: float, *, stale: bool) -> None:
    config = plain(setpoint_max_age_s=0.25)
    verdict = Guard(config).check(setpoint(stamp_s=NOW_S - age_s), sight())
    assert (verdict.limits == (g.SETPOINT_STALE,)) is stale


# ---------------------------------------------------------------- what a hold is


def test_a_hold_allows_no_speed_and_knows_of_no_free_way() -> None:
    verdict = Guard(CONFIG).check(setpoint(), sight(ok=False))
    assert (verdict.speed_limit_m_s, verdict.free_distance_m) == (0.0, 0.0)


@pytest.mark.parametrize(
    ("name", "held_down_m", "reason"),
    [("up", -1.05, g.CEILING), ("down", -1.15, g.GROUND), ("front", -1.1, None)],
)
def test_a_hold_for_an_old_setpoint_keeps_off_surfaces(
    name: str, held_down_m: float, reason: str | None
) -> None:
    seen = sight((0.1, 0.2, -1.1), beams=(beam(name, 0.135),))
    verdict = Guard(CONFIG).check(setpoint(stamp_s=NOW_S - 1.0), seen)
    assert is_hold_at(verdict, (0.1, 0.2, held_down_m))
    assert verdict.limits == ((g.SETPOINT_STALE, reason) if reason else (g.SETPOINT_STALE,))


def test_a_hold_that_keeps_off_a_surface_goes_back_to_where_it_began_in_the_plane() -> None:
    guard = Guard(CONFIG)
    old = setpoint(stamp_s=NOW_S - 1.0)
    guard.check(old, sight((0.1, 0.2, -1.1)))
    drifted = sight((0.16, 0.23, -1.1), beams=(beam("up", 0.135),))
    assert is_hold_at(guard.check(old, drifted), (0.1, 0.2, -1.05))


def test_a_retreat_as_long_as_the_way_back_aside_is_one_all_the_same() -> None:
    guard = Guard(CONFIG)
    old = setpoint(stamp_s=NOW_S - 1.0)
    guard.check(old, sight((0.0, 0.1, -1.1)))
    # 0.1 m back to the east, and 0.1 m down from a ceiling.
    drifted = sight((0.0, 0.0, -1.1), beams=(beam("up", 0.02),))
    assert is_hold_at(guard.check(old, drifted), (0.0, 0.1, -1.0))


def test_a_hold_for_want_of_room_goes_back_north_and_east_but_not_up_or_down() -> None:
    guard = Guard(CONFIG)
    unseen = DiscWorld(seen_m=0.0)
    asked = setpoint(velocity=(0.2, 0.0, 0.0))
    guard.check(asked, sight((0.1, 0.2, -1.0), space=unseen))
    again = guard.check(asked, sight((0.14, 0.17, -1.06), space=unseen))
    assert is_hold_at(again, (0.1, 0.2, -1.0))
    lower = setpoint((0.1, 0.2, -1.1), (0.2, 0.0, 0.0))
    assert is_hold_at(
        guard.check(lower, sight((0.14, 0.17, -1.06), space=unseen)), (0.1, 0.2, -1.1)
    )


@pytest.mark.parametrize("name", ["up", "down"])
def test_without_a_position_a_hold_does_not_move_for_a_surface(name: str) -> None:
    seen = sight((0.1, 0.2, -1.1), ok=False, beams=(beam(name, 0.135),))
    verdict = Guard(CONFIG).check(setpoint(), seen)
    assert is_hold_at(verdict, (0.1, 0.2, -1.1))
    assert verdict.limits == (g.POSITION_STALE,)


@pytest.mark.parametrize("drift", [(0.3, 0.0, 0.0), (0.0, -0.3, 0.0), (0.0, 0.0, 0.3)])
def test_a_hold_pulls_as_far_as_its_reach_and_no_farther(drift: Vector3) -> None:
    place: Vector3 = (0.0, 0.0, 0.0)
    guard = Guard(plain(speed_max_m_s=1.0))
    guard.check(setpoint(place), sight(place, ok=False))
    verdict = guard.check(setpoint(place), sight(drift, ok=False))
    assert verdict.setpoint.position_ned_m == place
    beyond = tuple(math.nextafter(d, 9.0 * d) for d in drift)
    verdict = guard.check(setpoint(place), sight((beyond[0], beyond[1], beyond[2]), ok=False))
    assert verdict.setpoint.position_ned_m == beyond


@pytest.mark.parametrize(
    ("name", "drift"),
    [
        ("front", (-0.1, 0.0)),
        ("back", (0.1, 0.0)),
        ("right", (0.0, -0.1)),
        ("left", (0.0, 0.1)),
    ],
)
def test_a_hold_is_given_up_only_where_it_pulls_towards_a_beam(
    name: str, drift: tuple[float, float]
) -> None:
    drifted = (drift[0], drift[1], -1.0)
    for seen_by, kept in ((name, False), *((other, True) for other in MOUNTS if other != name)):
        if seen_by in ("up", "down"):
            continue
        guard = Guard(CONFIG)
        guard.check(setpoint(), sight(ok=False))
        verdict = guard.check(setpoint(), sight(drifted, ok=False, beams=(beam(seen_by, 0.1),)))
        assert is_hold_at(verdict, HOME if kept else drifted)


@pytest.mark.parametrize(
    ("flown", "kept"),
    [
        ((0.0, 0.0, -1.1), True),
        ((0.05, 0.0, -1.0), False),
        ((0.0, 0.05, -1.0), False),
    ],
)
def test_a_hold_lasts_until_another_place_in_the_plane_is_flown_to(
    flown: Vector3, *, kept: bool
) -> None:
    guard = Guard(CONFIG)
    guard.check(setpoint(), sight(ok=False))
    asked = setpoint(flown)
    assert guard.check(asked, sight()).setpoint is asked
    drifted = (0.02, 0.03, -1.0)
    assert is_hold_at(guard.check(setpoint(), sight(drifted, ok=False)), HOME if kept else drifted)


def test_a_limited_climb_to_a_place_aside_is_no_hold() -> None:
    seen = sight((0.1, 0.2, -2.0))
    verdict = Guard(CONFIG).check(setpoint((0.15, 0.17, -2.3)), seen)
    assert verdict.limits == (g.ALTITUDE,)
    assert verdict.setpoint.position_ned_m == pytest.approx((0.15, 0.17, -2.0))
    only_east = Guard(CONFIG).check(setpoint((0.1, 0.17, -2.3)), seen)
    assert only_east.setpoint.position_ned_m == pytest.approx((0.1, 0.17, -2.0))


# ---------------------------------------------------------------- leash, speed


def at_origin(position: Vector3, velocity: Vector3 = (0.0, 0.0, 0.0), **more: Any) -> Any:
    """(setpoint, sight) with the vehicle at the frame's origin, where nothing is rounded."""
    return setpoint(position, velocity), sight((0.0, 0.0, 0.0), **more)


def test_rounding_may_lengthen_the_leash() -> None:
    for far_m, limits in ((0.6 * NEARLY, ()), (math.nextafter(0.6 * NEARLY, 1.0), (g.LEASH,))):
        asked, seen = at_origin((far_m, 0.0, 0.0))
        assert Guard(FAST).check(asked, seen).limits == limits


def test_rounding_may_add_to_the_top_speed() -> None:
    top = CONFIG.speed_max_m_s * NEARLY
    for speed, limits in ((top, ()), (math.nextafter(top, 1.0), (g.SPEED,))):
        assert Guard(CONFIG).check(setpoint(velocity=(speed, 0.0, 0.0)), sight()).limits == limits


def test_too_fast_a_setpoint_is_scaled_in_the_plane_only() -> None:
    # 0.95 * (0.4, 0.2) + (0.12, 0.2) = (0.5, 0.39).
    asked = setpoint((0.4, 0.2, -1.03), (0.12, 0.2, -0.02))
    verdict = Guard(CONFIG).check(asked, sight())
    factor = 0.25 / math.hypot(0.5, 0.39)
    assert verdict.limits == (g.SPEED,)
    assert verdict.setpoint.position_ned_m == pytest.approx((0.4 * factor, 0.2 * factor, -1.03))
    assert verdict.setpoint.velocity_ned_m_s == pytest.approx((0.12 * factor, 0.2 * factor, -0.02))


def test_less_room_scales_a_setpoint_in_the_plane_only() -> None:
    world = ToldWorld(free_m=0.0325)
    asked = setpoint((0.04, 0.02, -1.03), (0.05, 0.1, -0.02))
    verdict = Guard(CONFIG).check(asked, told(world=world))
    factor = 0.05 / math.hypot(0.05 + 0.95 * 0.04, 0.1 + 0.95 * 0.02)
    assert verdict.limits == (g.FREE_SPACE,)
    assert verdict.setpoint.position_ned_m == pytest.approx((0.04 * factor, 0.02 * factor, -1.03))
    assert verdict.setpoint.velocity_ned_m_s == pytest.approx((0.05 * factor, 0.1 * factor, -0.02))
    assert world.asked[0][1] == pytest.approx(math.atan2(0.119, 0.088))


# ---------------------------------------------------------------- up and down


@pytest.mark.parametrize(
    ("rise_m", "limits"),
    [
        (2.0 + 1e-9, ()),
        (2.0 + 1.1e-9, (g.ALTITUDE,)),
        (-1e-9, ()),
        (-1.1e-9, (g.ALTITUDE,)),
    ],
)
def test_rounding_may_leave_the_altitude_band(rise_m: float, limits: tuple[str, ...]) -> None:
    config = plain(climb_max_m_s=5.0, leash_m=5.0)
    asked, seen = at_origin((0.0, 0.0, -rise_m))
    verdict = Guard(config).check(asked, seen)
    assert verdict.limits == limits
    assert (verdict.setpoint is asked) is (not limits)


def test_rounding_may_add_to_the_climb_rate() -> None:
    for sign in (1.0, -1.0):
        for rate, limits in ((0.5 + 1e-9, ()), (0.5 + 1.1e-9, (g.CLIMB,))):
            asked = setpoint(velocity=(0.0, 0.0, -sign * rate))
            assert Guard(CONFIG).check(asked, sight()).limits == limits


def test_too_fast_a_climb_is_scaled_with_its_height() -> None:
    # 0.75 + 0.5 = 1.25 m/s, of which 0.5: both by 0.4.
    asked = setpoint((0.03, 0.02, -1.5), (0.01, 0.04, -0.75))
    verdict = Guard(CONFIG).check(asked, sight())
    assert verdict.limits == (g.CLIMB,)
    assert verdict.setpoint.position_ned_m == pytest.approx((0.03, 0.02, -1.2))
    assert verdict.setpoint.velocity_ned_m_s == pytest.approx((0.01, 0.04, -0.3))


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_climb_towards_a_surface_keeps_its_shares_of_height_and_rate(sign: float) -> None:
    # 0.3 m/s, 0.1 of it by the height; 0.06 m are left.
    seen = sight(beams=(beam("up" if sign > 0.0 else "down", 0.245),))
    asked = setpoint((0.0, 0.0, -1.0 - 0.1 * sign), (0.0, 0.0, -0.2 * sign))
    verdict = Guard(CONFIG).check(asked, seen)
    assert verdict.setpoint.position_ned_m[2] == pytest.approx(-1.0 - 0.02 * sign)
    assert verdict.setpoint.velocity_ned_m_s[2] == pytest.approx(-0.04 * sign)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_climb_towards_a_surface_that_is_too_near_becomes_a_retreat_without_feed_forward(
    sign: float,
) -> None:
    seen = sight(beams=(beam("up" if sign > 0.0 else "down", 0.155),))
    for rate in (0.2, 0.01, -0.01):
        asked = setpoint((0.0, 0.0, -1.0), (0.0, 0.0, -rate * sign))
        verdict = Guard(CONFIG).check(asked, seen)
        assert verdict.setpoint.position_ned_m[2] == pytest.approx(-1.0 + 0.03 * sign)
        assert verdict.setpoint.velocity_ned_m_s[2] == 0.0


def test_the_limit_that_is_nearer_is_named_and_the_band_where_they_are_equal() -> None:
    # At 1 m: 1 m to the top of the band, 0.5 m to its bottom; beams stop at 0.25 m.
    config = plain(altitude_min_m=0.5, beam_stop_m=0.25, climb_max_m_s=2.0)
    for name, range_m, rate, reason in (
        ("up", 1.25, 1.5, g.ALTITUDE),
        ("up", 1.24, 1.5, g.CEILING),
        ("down", 0.75, -1.5, g.ALTITUDE),
        ("down", 0.74, -1.5, g.GROUND),
    ):
        seen = sight(beams=(beam(name, range_m),))
        asked = setpoint(velocity=(0.0, 0.0, -rate))
        assert Guard(config).check(asked, seen).limits == (reason,)


@pytest.mark.parametrize(("near", "far"), [("up", "down"), ("down", "up")])
def test_a_retreat_does_not_come_near_the_other_surface(near: str, far: str) -> None:
    sign = 1.0 if near == "up" else -1.0
    # 4 cm too near to one; the other is exactly at the limit: no way to go.
    seen = sight(beams=(beam(near, 0.145), beam(far, 0.185)))
    assert Guard(CONFIG).check(setpoint(), seen).limits == ()
    # Half a metre on the other side: the retreat is not a centring.
    seen = sight(beams=(beam(near, 0.135), beam(far, 0.5)))
    assert is_hold_at(Guard(CONFIG).check(setpoint(), seen), (0.0, 0.0, -1.0 + 0.05 * sign))
    # 2 cm on the other side: neither more nor less than those, whatever is asked for.
    seen = sight(beams=(beam(near, 0.125), beam(far, 0.205)))
    for rate in (0.2, 0.0, -0.2):
        verdict = Guard(CONFIG).check(setpoint(velocity=(0.0, 0.0, rate)), seen)
        assert climb(verdict, seen) == pytest.approx(-0.02 * sign)


@pytest.mark.parametrize(
    ("config", "retreat_m_s"),
    [
        (plain(climb_max_m_s=0.05), 0.05),
        (plain(leash_m=0.06), 0.06),
        (CONFIG, 0.1),
    ],
)
@pytest.mark.parametrize(("name", "sign"), [("up", 1.0), ("down", -1.0)])
def test_a_retreat_is_as_slow_as_the_slowest_of_its_limits(
    name: str, sign: float, config: GuardConfig, retreat_m_s: float
) -> None:
    seen = sight(beams=(beam(name, 0.02),))
    verdict = Guard(config).check(setpoint(), seen)
    assert climb(verdict, seen) == pytest.approx(-retreat_m_s * sign)


def test_a_height_is_approached_with_the_gain_that_px4_has(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(vertical, "HEIGHT_GAIN_PER_S", 2.0)
    # Too fast: 0.5 m of height is 1 m/s by itself, half of that is allowed.
    up = Guard(CONFIG).check(setpoint((0.0, 0.0, -1.5)), sight())
    assert up.setpoint.position_ned_m[2] == pytest.approx(-1.25)
    # 5 cm too near: back at 0.1 m/s, by 5 cm of height.
    off = Guard(CONFIG).check(setpoint(), sight(beams=(beam("up", 0.135),)))
    assert off.setpoint.position_ned_m[2] == pytest.approx(-0.95)
    # 2 cm of leash are 0.04 m/s.
    short = Guard(plain(leash_m=0.02)).check(setpoint(), sight(beams=(beam("up", 0.02),)))
    assert short.setpoint.position_ned_m[2] == pytest.approx(-0.98)


def test_a_climb_is_leashed_with_what_is_asked_for_in_the_plane() -> None:
    # 0.6 m straight ahead is as long as the leash: rounding does not shorten it, a rise does.
    asked, seen = at_origin((0.6 * NEARLY, 0.0, 0.0), (0.0, 0.0, -9.0))
    verdict = Guard(FAST).check(asked, seen)
    assert verdict.limits == (g.CLIMB,)
    assert verdict.setpoint.position_ned_m == (0.6 * NEARLY, 0.0, 0.0)
    seen = sight((0.0, 0.0, -1.0), beams=(beam("up", 0.02),))
    rising = Guard(FAST).check(setpoint((0.36, 0.48, -1.0)), seen)
    shorter = math.sqrt(0.36 - 0.01) / 0.6
    assert rising.setpoint.position_ned_m == pytest.approx((0.36 * shorter, 0.48 * shorter, -0.9))


# ---------------------------------------------------------------- beams


@pytest.mark.parametrize(
    ("mount", "range_m", "gap_m"),
    [
        # Half-way up or down: sin 45 of the way, and the mount's height above the centre.
        (BeamMount(name="b", pitch_deg=45.0, down_m=-0.05, forward_m=0.3), 0.2, 0.05),
        (BeamMount(name="b", pitch_deg=-45.0, down_m=0.05, right_m=0.3), 0.2, 0.05),
        (BeamMount(name="b", pitch_deg=-45.0, down_m=-0.05), 0.4, -0.05),
    ],
)
def test_a_steep_beam_reads_a_height(mount: BeamMount, range_m: float, gap_m: float) -> None:
    sign = 1.0 if mount.pitch_deg > 0.0 else -1.0
    room_m = range_m * math.sqrt(0.5) + gap_m - 0.185
    seen = sight(beams=(beam("b", range_m, mount=mount),))
    verdict = Guard(CONFIG).check(setpoint(velocity=(0.0, 0.0, -0.4 * sign)), seen)
    assert climb(verdict, seen) * sign == pytest.approx(room_m)


def test_a_mounts_place_counts_along_its_beam() -> None:
    # 30 degrees to the right: 0.1 cos 30 + 0.06 sin 30 before the centre.
    mount = BeamMount(name="b", yaw_deg=30.0, forward_m=0.1, right_m=0.06)
    face_m = 0.1 * math.sqrt(0.75) + 0.03
    towards = (0.1 * math.sqrt(0.75), 0.05, 0.0)
    for gap_m, stops in ((-1e-6, True), (1e-6, False)):
        seen = sight(beams=(beam("b", 0.185 - face_m + gap_m, mount=mount),))
        verdict = Guard(CONFIG).check(setpoint(velocity=towards), seen)
        assert (verdict.limits == (g.BEAM,)) is stops


@pytest.mark.parametrize(
    ("name", "velocity"), [("front", (0.1, 0.0, 0.0)), ("up", (0.0, 0.0, -0.1))]
)
@pytest.mark.parametrize("status", [RangeStatus.VALID, RangeStatus.SUSPECT])
def test_exactly_at_the_limit_a_beam_is_not_near(
    name: str, velocity: Vector3, status: RangeStatus
) -> None:
    verdict = Guard(CONFIG).check(
        setpoint(velocity=velocity), sight(beams=(beam(name, 0.185, status),))
    )
    # What is above may be approached no further; a doubted reading at the limit says nothing.
    stops = name == "up" and status is RangeStatus.VALID
    assert verdict.limits == ((g.CEILING,) if stops else ())


@pytest.mark.parametrize(
    "first",
    [
        beam("front", 0.0, RangeStatus.NO_SIGNAL),
        beam("front", 1.0, RangeStatus.OUT_OF_RANGE),
        beam("front", 0.5, RangeStatus.SUSPECT),
    ],
)
def test_a_beam_that_says_nothing_does_not_hide_the_next(first: BeamSight) -> None:
    seen = sight(beams=(first, beam("right", 0.1)))
    assert Guard(CONFIG).check(setpoint(velocity=(0.0, 0.1, 0.0)), seen).limits == (g.BEAM,)


def test_a_component_that_is_only_rounding_is_left() -> None:
    seen = sight(beams=(beam("front", 0.1), beam("right", 0.1)))
    asked = setpoint(velocity=(1e-9, 0.0, 0.0))
    assert Guard(CONFIG).check(asked, seen).setpoint is asked
    verdict = Guard(CONFIG).check(setpoint(velocity=(1e-9, 0.1, 0.0)), seen)
    assert verdict.setpoint.velocity_ned_m_s[0] == pytest.approx(1e-9, rel=1e-6)
    assert verdict.setpoint.velocity_ned_m_s[1] == pytest.approx(0.0, abs=1e-12)
    more = Guard(CONFIG).check(setpoint(velocity=(1.1e-9, 0.0, 0.0)), seen)
    assert more.limits == (g.BEAM,)


def test_taking_a_component_away_leaves_height_and_all_else() -> None:
    seen = sight(yaw_rad=math.atan2(0.6, 0.8), beams=(beam("front", 0.1),))
    asked = setpoint((0.05, 0.02, -1.02), (0.1, 0.05, -0.03))
    verdict = Guard(CONFIG).check(asked, seen)
    # Along (0.8, 0.6): 0.052 of the way and 0.11 of the velocity.
    assert verdict.setpoint.position_ned_m == pytest.approx((0.0084, -0.0112, -1.02))
    assert verdict.setpoint.velocity_ned_m_s == pytest.approx((0.012, -0.016, -0.03))


def test_beams_that_close_a_wedge_leave_the_climb() -> None:
    spread = tuple(
        beam(f"b{yaw}", 0.1, mount=BeamMount(name=f"b{yaw}", yaw_deg=yaw))
        for yaw in (-125.0, 0.0, 125.0)
    )
    asked = setpoint((0.02, 0.09, -1.05), (0.1, 0.1, -0.1))
    verdict = Guard(CONFIG).check(asked, sight(beams=spread))
    assert verdict.limits == (g.BEAM,)
    assert verdict.setpoint.position_ned_m == pytest.approx((0.0, 0.0, -1.05))
    assert verdict.setpoint.velocity_ned_m_s == pytest.approx((0.0, 0.0, -0.1))


# ---------------------------------------------------------------- room to stop


def test_where_nothing_moves_the_way_is_free_as_far_as_is_ever_asked() -> None:
    guard = Guard(CONFIG)
    verdict = guard.check(setpoint(), sight(space=DiscWorld(seen_m=0.0)))
    assert verdict.free_distance_m == guard.horizon_m == pytest.approx(0.25 * 0.6 + 0.0625)
    assert verdict.speed_limit_m_s == 0.25


@pytest.mark.parametrize("speed_m_s", [0.25, 0.3, 0.37, 0.7, 1.1])
def test_a_way_free_as_far_as_is_ever_asked_is_flown_at_exactly_top_speed(speed_m_s: float) -> None:
    guard = Guard(plain(speed_max_m_s=speed_m_s))
    verdict = guard.check(setpoint(velocity=(0.1, 0.0, 0.0)), sight())
    assert verdict.speed_limit_m_s == speed_m_s
    assert verdict.free_distance_m == guard.horizon_m


def test_rounding_may_add_to_the_speed_that_is_left() -> None:
    allowed = g.stopping_speed_m_s(0.1, CONFIG.reaction_s, CONFIG.braking_m_s2) * NEARLY
    for speed, limits in ((allowed, ()), (math.nextafter(allowed, 1.0), (g.FREE_SPACE,))):
        asked = setpoint(velocity=(speed, 0.0, 0.0))
        verdict = Guard(CONFIG).check(asked, told(world=ToldWorld(free_m=0.1)))
        assert verdict.limits == limits


def test_fence_and_space_at_the_same_distance_are_told_as_space() -> None:
    for free_m, reason in ((0.5, g.FREE_SPACE), (0.51, g.FENCE), (0.49, g.FREE_SPACE)):
        config = plain(speed_max_m_s=1.0, fence=SQUARE.fence)
        seen = told((0.5, 0.0, -1.0), world=ToldWorld(free_m=free_m))
        verdict = Guard(config).check(setpoint((0.5, 0.0, -1.0), (0.9, 0.0, 0.0)), seen)
        assert verdict.limits == (reason,)


def test_the_uncertainty_counts_against_fence_and_space_alike() -> None:
    world = ToldWorld(free_m=0.1)
    verdict = Guard(CONFIG).check(
        setpoint(velocity=(0.2, 0.0, 0.0)), told(world=world, sigma_m=0.03)
    )
    assert verdict.free_distance_m == pytest.approx(0.07)
    seen = sight((0.9, 0.0, -1.0), sigma_m=0.03)
    verdict = Guard(SQUARE).check(setpoint((0.9, 0.0, -1.0), (0.2, 0.0, 0.0)), seen)
    assert verdict.free_distance_m == pytest.approx(0.07)
    assert verdict.speed_limit_m_s == pytest.approx(0.1)


# ---------------------------------------------------------------- braking


def pushed(actual_m_s: float, command_m_s: float, free_m: float) -> tuple[str, ...]:
    """Limits of a vehicle that flies and is told to fly north, with that much room."""
    seen = flying(actual_m_s, free_m)
    return Guard(CONFIG).check(setpoint(velocity=(command_m_s, 0.0, 0.0)), seen).limits


def flying(actual_m_s: float, free_m: float) -> Sight:
    world = ToldWorld(free_m=free_m, free_elsewhere_m=free_m)
    return Sight(NOW_S, NOW_S, HOME, (actual_m_s, 0.0, 0.0), 0.0, world)


def test_what_is_no_faster_than_noise_is_not_braked() -> None:
    assert pushed(0.03, 0.2, 0.001) == (g.FREE_SPACE,)
    assert pushed(math.nextafter(0.03, 1.0), 0.2, 0.001) == (g.BRAKE, g.FREE_SPACE)


def test_what_is_as_fast_as_can_be_stopped_is_not_braked() -> None:
    allowed = g.stopping_speed_m_s(0.07, CONFIG.reaction_s, CONFIG.braking_m_s2)
    assert pushed(allowed, 0.2, 0.07) == (g.FREE_SPACE,)
    assert pushed(math.nextafter(allowed, 1.0), 0.2, 0.07) == (g.BRAKE, g.FREE_SPACE)


def test_a_command_that_can_be_stopped_from_does_not_feed_what_is_too_fast() -> None:
    allowed = g.stopping_speed_m_s(0.07, CONFIG.reaction_s, CONFIG.braking_m_s2) * NEARLY
    assert pushed(0.2, allowed, 0.07) == ()
    assert pushed(0.2, math.nextafter(allowed, 1.0), 0.07) == (g.BRAKE, g.FREE_SPACE)


@pytest.mark.parametrize(
    ("actual", "command", "brakes"),
    [
        # Towards (0.6, 0.8) at 0.2 m/s, where 0.1 m/s could be stopped from.
        ((0.12, 0.16, 0.0), (0.08, 0.08, 0.0), True),  # 0.112 along it
        ((0.12, 0.16, 0.0), (0.09, 0.05, 0.0), False),  # 0.094 along it
        ((0.12, 0.16, 0.0), (0.16, 0.01, 0.0), True),  # 0.104
        ((-0.12, 0.16, 0.0), (-0.08, 0.08, 0.0), True),
        ((0.12, 0.16, 0.0), (-0.16, 0.12, 0.0), False),  # across
        ((0.12, 0.16, 0.0), (-0.12, -0.16, 0.0), False),
    ],
)
def test_a_command_feeds_by_its_component_along_the_motion(
    actual: Vector3, command: Vector3, *, brakes: bool
) -> None:
    # The way that is commanded is free, the one that is flown is not.
    world = ToldWorld(free_m=9.0, free_elsewhere_m=0.07)
    seen = Sight(NOW_S, NOW_S, HOME, actual, 0.0, world)
    verdict = Guard(CONFIG).check(setpoint(velocity=command), seen)
    assert (verdict.limits == (g.BRAKE,)) is brakes
    assert is_hold_at(verdict, HOME) is brakes
    if len(world.asked) > 1:
        assert world.asked[1][1] == pytest.approx(math.atan2(actual[1], actual[0]))


@pytest.mark.parametrize(("left_m_s", "brakes"), [(0.025, True), (0.035, False)])
def test_what_room_leaves_of_a_command_may_say_stop(left_m_s: float, *, brakes: bool) -> None:
    room_m = g.stopping_distance_m(left_m_s, CONFIG.reaction_s, CONFIG.braking_m_s2)
    world = ToldWorld(free_m=room_m, free_elsewhere_m=0.07)
    seen = Sight(NOW_S, NOW_S, HOME, (0.0, 0.2, 0.0), 0.0, world)
    verdict = Guard(CONFIG).check(setpoint(velocity=(0.1, 0.0, 0.0)), seen)
    assert verdict.limits == ((g.BRAKE, g.FREE_SPACE) if brakes else (g.FREE_SPACE,))
    assert is_hold_at(verdict, HOME) is brakes
    assert verdict.setpoint.velocity_ned_m_s[0] == pytest.approx(0.0 if brakes else left_m_s)


# ---------------------------------------------------------------- escape


def fleeing(
    heading_rad: float, nearest: tuple[float, float] | None, **more: float
) -> tuple[GuardVerdict, ToldWorld]:
    world = ToldWorld(free_m=0.0, nearest=nearest, free_elsewhere_m=more.get("free_m", 9.0))
    velocity = (0.05 * math.cos(heading_rad), 0.05 * math.sin(heading_rad), 0.0)
    verdict = Guard(CONFIG).check(setpoint(velocity=velocity), told(world=world))
    return verdict, world


@pytest.mark.parametrize("turned_deg", [0.0, 90.0, 180.0, 217.0])
@pytest.mark.parametrize(("off_deg", "passes"), [(0.0, True), (66.0, True), (67.0, False)])
def test_an_escape_leads_away_from_the_hit_wherever_that_is(
    turned_deg: float, off_deg: float, *, passes: bool
) -> None:
    for side in (1.0, -1.0):
        bearing = math.radians(turned_deg)
        verdict, _ = fleeing(bearing + math.pi + side * math.radians(off_deg), (0.15, bearing))
        assert (verdict.limits == ()) is passes


def test_an_escape_at_exactly_the_steepest_angle_is_one(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(room, "ESCAPE_COSINE", -math.cos(2.0))
    assert fleeing(0.0, (0.15, 2.0))[0].limits == ()
    assert fleeing(0.0, (0.15, 1.999))[0].limits == (g.FREE_SPACE,)


def test_an_escape_looks_for_a_hit_and_for_open_space_within_its_longest_step() -> None:
    heading = math.atan2(0.8, -0.6)
    verdict, world = fleeing(heading, (0.15, heading + math.pi), free_m=0.0)
    assert verdict.limits == (g.FREE_SPACE,)
    assert [limit for _, limit in world.asked_nearest] == [pytest.approx(0.285)]
    place: Vector3 = (3.0, -2.0, -1.5)
    elsewhere = ToldWorld(free_m=0.0, nearest=(0.15, heading + math.pi), free_elsewhere_m=0.0)
    velocity = (-0.03, 0.04, 0.0)
    Guard(CONFIG).check(setpoint(place, velocity), told(place, world=elsewhere))
    assert [at for at, _, _ in elsewhere.asked[1:]] == [
        pytest.approx((3.0 - 0.6 * step, -2.0 + 0.8 * step, -1.5))
        for step in (0.025, 0.05, 0.075, 0.1)
    ]
    assert [at for at, _ in elsewhere.asked_nearest] == [place]
    tried = [pytest.approx((-0.6 * step, 0.8 * step, -1.0)) for step in (0.025, 0.05, 0.075, 0.1)]
    assert [place for place, _, _ in world.asked[1:]] == tried
    assert [limit for _, _, limit in world.asked[1:]] == [0.025] * 4
    assert [asked for _, asked, _ in world.asked] == [pytest.approx(heading)] * 5


def test_an_escape_is_as_slow_as_the_slowest_of_its_limits() -> None:
    for config, expected in (
        (CONFIG, 0.06),
        (plain(speed_max_m_s=0.04), 0.04),
        # 3.2 cm to the fence allow 0.05 m/s.
        (plain(fence=Fence.rectangle((-9.0, 0.0325), (-9.0, 9.0))), 0.05),
    ):
        world = ToldWorld(free_m=0.0, nearest=(0.15, math.pi), free_elsewhere_m=9.0)
        verdict = Guard(config).check(setpoint(velocity=(0.2, 0.0, 0.0)), told(world=world))
        assert verdict.speed_limit_m_s == pytest.approx(expected)
        assert verdict.free_distance_m == 0.0


# ---------------------------------------------------------------- fence


LOPSIDED = plain(fence=Fence.rectangle((-3.0, 1.0), (-5.0, 2.0)))


@pytest.mark.parametrize(
    ("before", "now", "velocity"),
    [
        ((0.0, 0.0), (0.95, 0.0), (0.2, 0.0)),
        ((-1.0, 0.0), (0.95, 0.0), (0.2, 0.0)),
        ((0.0, 0.0), (0.0, 1.95), (0.0, 0.2)),
        ((0.0, -2.0), (0.0, 1.95), (0.0, 0.2)),
        ((-1.9, -2.0), (-2.95, 0.0), (-0.2, 0.0)),
        ((-1.0, 1.0), (-1.0, -4.95), (0.0, -0.2)),
        ((-0.9, 0.9), (0.9, -0.9), (0.2, 0.0)),
    ],
)
def test_a_guard_that_was_elsewhere_decides_like_a_new_one(
    before: tuple[float, float], now: tuple[float, float], velocity: tuple[float, float]
) -> None:
    guard = Guard(LOPSIDED)
    for north, east in (before, (0.5 * before[0], 0.5 * before[1]), before, now):
        place = (north, east, -1.0)
        asked = setpoint(place, (*velocity, 0.0))
        verdict = guard.check(asked, sight(place))
        fresh = Guard(LOPSIDED).check(asked, sight(place))
        assert verdict.limits == fresh.limits
        assert verdict.free_distance_m == fresh.free_distance_m
    assert verdict.limits == (g.FENCE,)


@pytest.mark.parametrize(
    ("north", "east", "before", "now", "velocity"),
    [
        # What is remembered must be north and east of the place, not one of them twice, nor down.
        ((-5.0, 5.0), (-5.0, 2.0), (1.95, -0.5), (1.95, 1.95), (0.0, 0.2)),
        ((-5.0, 2.0), (-5.0, 5.0), (-0.5, 1.95), (1.95, 1.95), (0.2, 0.0)),
        ((-1.05, 9.0), (-9.0, 9.0), (4.0, 0.0), (-1.0, 0.0), (-0.2, 0.0)),
        ((-9.0, 9.0), (-9.0, 4.05), (4.0, 0.0), (4.0, 4.0), (0.0, 0.2)),
        ((-9.0, 4.05), (-9.0, 9.0), (0.0, 4.0), (4.0, 4.0), (0.2, 0.0)),
        ((-9.0, 9.0), (-1.05, 9.0), (4.0, 3.0), (4.0, -1.0), (0.0, -0.2)),
    ],
)
def test_the_fence_is_not_forgotten_on_the_way_to_it(
    north: tuple[float, float],
    east: tuple[float, float],
    before: tuple[float, float],
    now: tuple[float, float],
    velocity: tuple[float, float],
) -> None:
    guard = Guard(plain(fence=Fence.rectangle(north, east)))
    # Far from where it began, so that the distance is computed at `before`.
    for at in ((north[1] - 0.1, east[0] + 0.1), before, now):
        place = (*at, -1.0)
        verdict = guard.check(setpoint(place, (*velocity, 0.0)), sight(place))
    assert verdict.limits == (g.FENCE,)
    assert verdict.free_distance_m == pytest.approx(0.05)


def test_on_the_fence_exactly_the_flattest_way_inwards_is_one() -> None:
    config = plain(fence=Fence.rectangle((-5.0, 0.0), (-5.0, 5.0)))
    velocity = (-0.015030000000000002, 0.04779235399098898, 0.0)
    assert velocity[0] / math.hypot(velocity[0], velocity[1]) == -0.3
    asked = setpoint((0.0, 0.0, -1.0), velocity)
    assert Guard(config).check(asked, sight((0.0, 0.0, -1.0))).setpoint is asked


def test_beyond_the_fence_and_without_free_space_space_is_told() -> None:
    place = (1.2, 0.0, -1.0)
    seen = told(place, world=ToldWorld(free_m=0.0))
    verdict = Guard(SQUARE).check(setpoint(place, (0.1, 0.0, 0.0)), seen)
    assert verdict.limits == (g.FREE_SPACE,)


@pytest.mark.parametrize("start", [(0.0, 0.0), (-2.0, 1.0), (-1.5, -3.0)])
def test_a_way_along_all_sides_of_the_fence_is_judged_as_by_a_new_guard(
    start: tuple[float, float],
) -> None:
    guard = Guard(LOPSIDED)
    corners = [start, (0.9, 1.9), (0.9, -4.9), (-2.9, -4.9), (-2.9, 1.9), (0.9, 1.9), start]
    for (n0, e0), (n1, e1) in itertools.pairwise(corners):
        for k in range(20):
            place = (n0 + (n1 - n0) * k / 20.0, e0 + (e1 - e0) * k / 20.0, -1.0)
            for velocity in ((0.2, 0.1, 0.0), (-0.2, -0.1, 0.0)):
                asked = setpoint(place, velocity)
                fresh = Guard(LOPSIDED).check(asked, sight(place))
                assert guard.check(asked, sight(place)) == fresh


def test_a_new_guard_knows_how_far_the_fence_is() -> None:
    for north, east, velocity in (
        (0.95, 0.0, (0.2, 0.0, 0.0)),
        (-0.95, 0.0, (-0.2, 0.0, 0.0)),
        (0.0, 0.95, (0.0, 0.2, 0.0)),
        (0.0, -0.95, (0.0, -0.2, 0.0)),
    ):
        seen = sight((north, east, -1.0))
        verdict = Guard(SQUARE).check(setpoint((north, east, -1.0), velocity), seen)
        assert verdict.free_distance_m == pytest.approx(0.05)


def test_what_is_inside_by_rounding_only_is_outside() -> None:
    config = plain(fence=Fence.rectangle((-5.0, 0.0), (-5.0, 5.0)))
    for inside_m, limits in ((1e-9, (g.FENCE,)), (1.1e-9, ())):
        place = (-inside_m, 0.0, -1.0)
        asked = setpoint(place, (0.0, 0.2, 0.0))
        assert Guard(config).check(asked, sight(place)).limits == limits


@pytest.mark.parametrize(("cosine", "passes"), [(0.29, False), (0.31, True), (-0.31, False)])
def test_outside_a_way_inwards_leads_within_73_degrees_of_straight_in(
    cosine: float, *, passes: bool
) -> None:
    along = math.sqrt(1.0 - cosine * cosine)
    for place, velocity in (
        ((1.2, 0.0, -1.0), (-0.1 * cosine, 0.1 * along, 0.0)),
        ((-1.2, 0.0, -1.0), (0.1 * cosine, 0.1 * along, 0.0)),
        ((0.0, 1.2, -1.0), (0.1 * along, -0.1 * cosine, 0.0)),
        ((0.0, -1.2, -1.0), (-0.1 * along, 0.1 * cosine, 0.0)),
    ):
        verdict = Guard(SQUARE).check(setpoint(place, velocity), sight(place))
        assert (verdict.limits == ()) is passes


Point = tuple[float, float]


@pytest.mark.parametrize(
    ("place", "towards", "a", "b", "expected"),
    [
        ((0.0, 0.5), (1.0, 0.0), (2.0, 0.0), (2.0, 1.0), 2.0),
        ((0.0, 0.5), (1.0, 0.0), (2.0, 1.0), (2.0, 0.0), 2.0),
        ((0.0, 0.5), (-1.0, 0.0), (2.0, 0.0), (2.0, 1.0), math.inf),
        ((0.5, 0.5), (0.0, -1.0), (0.0, -2.5), (1.0, -2.5), 3.0),
        ((1.5, 0.5), (0.0, -1.0), (0.0, -2.5), (1.0, -2.5), math.inf),
        ((-0.5, 0.5), (0.0, -1.0), (0.0, -2.5), (1.0, -2.5), math.inf),
        # Slanted: from (1, 2) along (0.6, 0.8) 5 m to (4, 6), between (2, 5) and (6, 7).
        ((1.0, 2.0), (0.6, 0.8), (2.0, 5.0), (6.0, 7.0), 5.0),
        ((1.0, 2.0), (0.6, 0.8), (6.0, 7.0), (2.0, 5.0), 5.0),
        ((1.0, 2.0), (-0.6, -0.8), (2.0, 5.0), (6.0, 7.0), math.inf),
        # Parallel, also where it lies on the same line; behind by less than a metre.
        ((0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (3.0, 1.0), math.inf),
        ((0.0, 0.0), (1.0, 0.0), (1.0, 0.0), (3.0, 0.0), math.inf),
        ((0.0, 0.5), (1.0, 0.0), (-0.5, 0.0), (-0.5, 1.0), math.inf),
        ((0.0, 0.5), (1.0, 0.0), (0.5, 0.0), (0.5, 1.0), 0.5),
        # Its ends belong to an edge, with what rounding adds.
        ((0.0, 0.0), (1.0, 0.0), (1.0, 0.0), (1.0, 1.0), 1.0),
        ((0.0, -1e-9), (1.0, 0.0), (1.0, 0.0), (1.0, 1.0), 1.0),
        ((0.0, -1.1e-9), (1.0, 0.0), (1.0, 0.0), (1.0, 1.0), math.inf),
        ((0.0, 1.0), (1.0, 0.0), (1.0, 0.0), (1.0, 1.0), 1.0),
        ((0.0, 1.0 + 1e-9), (1.0, 0.0), (1.0, 0.0), (1.0, 1.0), 1.0),
        ((0.0, 1.0 + 1.1e-9), (1.0, 0.0), (1.0, 0.0), (1.0, 1.0), math.inf),
        # On the edge itself.
        ((1.0, 0.5), (1.0, 0.0), (1.0, 0.0), (1.0, 1.0), 0.0),
    ],
)
def test_where_a_ray_meets_an_edge(
    place: Point, towards: Point, a: Point, b: Point, expected: float
) -> None:
    assert crossing_m(*place, *towards, a, b) == pytest.approx(expected)


def test_only_velocity_and_place_in_the_plane_are_flown_with_px4s_gain() -> None:
    config = plain(position_gain_per_s=0.5, speed_max_m_s=1.0)
    seen = sight()
    verdict = Guard(config).check(setpoint((0.2, -0.4, -1.0), (0.1, 0.3, 0.0)), seen)
    assert effective(verdict, seen, config) == pytest.approx((0.2, 0.1))
    assert verdict.limits == ()
