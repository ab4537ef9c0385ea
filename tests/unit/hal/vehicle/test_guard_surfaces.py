"""The guard and what beams read: beside, above and below."""

import math

import pytest

from hal.config import BeamMount
from hal.frames import Vector3
from hal.readings import RangeStatus
from hal.vehicle import guard as g
from hal.vehicle.guard import Guard
from tests.unit.hal.vehicle.guard_world import (
    CONFIG,
    HOME,
    beam,
    climb,
    effective,
    is_hold_at,
    plain,
    setpoint,
    sight,
)

# ---------------------------------------------------------------- (4) raw beams


@pytest.mark.parametrize(
    ("name", "un", "ue"),
    [("front", 1, 0), ("right", 0, 1), ("back", -1, 0), ("left", 0, -1)],
)
@pytest.mark.parametrize("status", [RangeStatus.VALID, RangeStatus.TOO_NEAR])
@pytest.mark.parametrize("yaw_rad", [0.0, 0.7])
def test_no_approach_along_a_near_beam_but_motion_beside_it(
    name: str, un: int, ue: int, status: RangeStatus, yaw_rad: float
) -> None:
    c, s = math.cos(yaw_rad), math.sin(yaw_rad)
    towards = (c * un - s * ue, s * un + c * ue)
    beside = (-towards[1], towards[0])
    velocity = (0.1 * towards[0] + 0.1 * beside[0], 0.1 * towards[1] + 0.1 * beside[1], 0.0)
    seen = sight(beams=(beam(name, 0.1, status),), yaw_rad=yaw_rad)
    verdict = Guard(CONFIG).check(setpoint(velocity=velocity), seen)
    assert verdict.limits == (g.BEAM,)
    assert effective(verdict, seen) == pytest.approx((0.1 * beside[0], 0.1 * beside[1]))


@pytest.mark.parametrize(
    ("range_m", "status", "stops"),
    [
        (0.184, RangeStatus.VALID, True),
        (0.186, RangeStatus.VALID, False),
        (0.02, RangeStatus.TOO_NEAR, True),
        (0.0, RangeStatus.NO_SIGNAL, False),
        (0.184, RangeStatus.SUSPECT, True),
        (0.186, RangeStatus.SUSPECT, False),
        (1.0, RangeStatus.OUT_OF_RANGE, False),
    ],
)
def test_what_was_measured_near_stops_even_when_it_is_doubted(
    range_m: float, status: RangeStatus, *, stops: bool
) -> None:
    seen = sight(beams=(beam("front", range_m, status),))
    verdict = Guard(CONFIG).check(setpoint(velocity=(0.1, 0.0, 0.0)), seen)
    assert (verdict.limits == (g.BEAM,)) == stops
    assert is_hold_at(verdict, HOME) == stops


@pytest.mark.parametrize(("forward_m", "stops"), [(0.04, True), (0.06, False)])
def test_a_beam_is_measured_from_the_centre(forward_m: float, *, stops: bool) -> None:
    mount = BeamMount(name="front", forward_m=forward_m)
    seen = sight(beams=(beam("front", 0.135, mount=mount),))
    verdict = Guard(CONFIG).check(setpoint(velocity=(0.1, 0.0, 0.0)), seen)
    assert (verdict.limits == (g.BEAM,)) == stops


@pytest.mark.parametrize(
    ("mount", "towards"),
    [
        (BeamMount(name="right", yaw_deg=90.0, forward_m=0.3, right_m=0.05), (0.0, 0.1, 0.0)),
        (BeamMount(name="back", yaw_deg=180.0, forward_m=-0.05), (-0.1, 0.0, 0.0)),
    ],
)
@pytest.mark.parametrize(("range_m", "stops"), [(0.134, True), (0.136, False)])
def test_only_the_offset_along_the_beam_counts(
    range_m: float, mount: BeamMount, towards: Vector3, *, stops: bool
) -> None:
    seen = sight(beams=(beam(mount.name, range_m, mount=mount),))
    verdict = Guard(CONFIG).check(setpoint(velocity=towards), seen)
    assert (verdict.limits == (g.BEAM,)) == stops


@pytest.mark.parametrize(("range_m", "stops"), [(0.19, True), (0.2, False)])
def test_a_slanted_beam_counts_by_its_horizontal_part(range_m: float, *, stops: bool) -> None:
    mount = BeamMount(name="front", pitch_deg=20.0)
    seen = sight(beams=(beam("front", range_m, mount=mount),))
    verdict = Guard(CONFIG).check(setpoint(velocity=(0.1, 0.0, 0.0)), seen)
    assert (verdict.limits == (g.BEAM,)) == stops


def test_a_mount_that_changes_under_the_same_name_is_noticed() -> None:
    guard = Guard(CONFIG)
    asked = setpoint(velocity=(0.1, 0.0, 0.0))
    guard.check(asked, sight(beams=(beam("front", 0.1),)))
    turned = BeamMount(name="front", yaw_deg=180.0)
    assert guard.check(asked, sight(beams=(beam("front", 0.1, mount=turned),))).limits == ()


def test_motion_away_from_a_near_beam_is_left_alone() -> None:
    asked = setpoint(velocity=(-0.1, 0.0, 0.0))
    verdict = Guard(CONFIG).check(asked, sight(beams=(beam("front", 0.1),)))
    assert verdict.setpoint is asked


def test_beams_that_close_a_wedge_leave_no_motion() -> None:
    spread = tuple(
        beam(f"b{yaw}", 0.1, mount=BeamMount(name=f"b{yaw}", yaw_deg=yaw))
        for yaw in (-125.0, 0.0, 125.0)
    )
    for heading in range(0, 360, 15):
        velocity = (0.2 * math.cos(heading), 0.2 * math.sin(heading), 0.0)
        seen = sight(beams=spread)
        verdict = Guard(CONFIG).check(setpoint(velocity=velocity), seen)
        n, e = effective(verdict, seen)
        for yaw in (-125.0, 0.0, 125.0):
            assert n * math.cos(math.radians(yaw)) + e * math.sin(math.radians(yaw)) < 1e-8


# ---------------------------------------------------------------- (6) altitude


@pytest.mark.parametrize(
    ("altitude_m", "up_m_s", "reason"),
    [
        (1.0, 0.5, None),
        (1.0, 0.51, g.CLIMB),
        (1.0, -0.5, None),
        (1.0, -0.51, g.CLIMB),
        (1.79, 0.2, None),
        (1.81, 0.2, g.ALTITUDE),
        (2.0, 0.2, g.ALTITUDE),
        (2.5, 0.2, g.ALTITUDE),
        (2.5, -0.2, None),
        (0.51, -0.2, None),
        (0.49, -0.2, g.ALTITUDE),
        (0.3, -0.2, g.ALTITUDE),
        (0.1, -0.2, g.ALTITUDE),
        (0.1, 0.2, None),
    ],
)
def test_climb_rate_and_altitude_band(altitude_m: float, up_m_s: float, reason: str | None) -> None:
    seen = sight((0.0, 0.0, -altitude_m))
    asked = setpoint((0.0, 0.0, -altitude_m), (0.0, 0.0, -up_m_s))
    verdict = Guard(CONFIG).check(asked, seen)
    assert verdict.limits == (() if reason is None else (reason,))
    room_m = 2.0 - altitude_m if up_m_s > 0.0 else altitude_m - 0.3
    assert abs(climb(verdict, seen)) <= max(0.0, min(0.5, room_m)) + 1e-9
    assert climb(verdict, seen) * up_m_s >= 0.0


@pytest.mark.parametrize(("asked_m", "given_m"), [(2.3, 2.0), (0.1, 0.3), (1.5, 1.5)])
def test_the_position_setpoint_stays_in_the_band(asked_m: float, given_m: float) -> None:
    altitude_m = max(0.6, asked_m - 0.5)
    seen = sight((0.0, 0.0, -altitude_m))
    verdict = Guard(CONFIG).check(setpoint((0.0, 0.0, -asked_m)), seen)
    assert -verdict.setpoint.position_ned_m[2] == pytest.approx(given_m)
    assert (g.ALTITUDE in verdict.limits) == (asked_m != given_m)


def test_a_fast_vertical_feed_forward_is_capped_even_when_the_position_error_cancels_it() -> None:
    seen = sight()
    verdict = Guard(CONFIG).check(setpoint((0.0, 0.0, -0.5), (0.0, 0.0, -0.8)), seen)
    assert verdict.limits == (g.CLIMB,)
    assert verdict.setpoint.velocity_ned_m_s[2] == pytest.approx(-0.5)
    assert climb(verdict, seen) == pytest.approx(0.3 * 0.5 / 0.8)


def test_above_the_band_the_guard_does_not_fly_down_by_itself() -> None:
    seen = sight((0.0, 0.0, -2.5))
    verdict = Guard(CONFIG).check(setpoint((0.0, 0.0, -2.7)), seen)
    assert climb(verdict, seen) == pytest.approx(0.0)


def test_a_vertical_limit_leaves_the_horizontal_flight_alone() -> None:
    seen = sight((0.0, 0.0, -2.0))
    verdict = Guard(CONFIG).check(setpoint((0.0, 0.0, -2.0), (0.1, 0.05, -0.3)), seen)
    assert effective(verdict, seen) == pytest.approx((0.1, 0.05))
    assert verdict.setpoint.velocity_ned_m_s[2] == 0.0


@pytest.mark.parametrize(
    ("name", "sign", "reason"), [("up", 1.0, g.CEILING), ("down", -1.0, g.GROUND)]
)
@pytest.mark.parametrize(
    ("range_m", "allowed"),
    [(0.02, -g.RETREAT_M_S), (0.155, -0.03), (0.185, 0.0), (0.285, 0.1), (0.5, 0.2)],
)
def test_no_climb_into_a_ceiling_and_no_descent_onto_a_table(
    range_m: float, allowed: float, name: str, sign: float, reason: str
) -> None:
    seen = sight(beams=(beam(name, range_m),))
    verdict = Guard(CONFIG).check(setpoint(velocity=(0.0, 0.0, -0.2 * sign)), seen)
    assert climb(verdict, seen) * sign == pytest.approx(allowed, abs=1e-9)
    assert verdict.limits == (() if allowed == 0.2 else (reason,))
    away = setpoint(velocity=(0.0, 0.0, 0.2 * sign))
    assert Guard(CONFIG).check(away, seen).setpoint is away


@pytest.mark.parametrize(("name", "sign"), [("up", 1.0), ("down", -1.0)])
def test_a_surface_that_is_too_near_is_left_even_when_no_motion_was_asked_for(
    name: str, sign: float
) -> None:
    seen = sight(beams=(beam(name, 0.135),))
    verdict = Guard(CONFIG).check(setpoint(), seen)
    assert is_hold_at(verdict, (0.0, 0.0, -1.0 + 0.05 * sign))


def test_between_a_ceiling_and_a_table_the_middle_is_held() -> None:
    seen = sight(beams=(beam("up", 0.1), beam("down", 0.14)))
    verdict = Guard(CONFIG).check(setpoint((0.0, 0.0, -1.3)), seen)
    assert is_hold_at(verdict, (0.0, 0.0, -0.98))


def test_a_retreat_ends_where_the_surface_on_the_other_side_is_near() -> None:
    seen = sight(beams=(beam("up", 0.125), beam("down", 0.205)))
    assert is_hold_at(Guard(CONFIG).check(setpoint(), seen), (0.0, 0.0, -0.98))


@pytest.mark.parametrize(
    ("name", "altitude_m", "held_m"),
    [("up", 0.32, 0.30), ("up", 0.25, 0.25), ("down", 1.99, 2.0), ("down", 0.05, 0.05)],
)
def test_a_retreat_stays_in_the_band_and_does_not_lift_off_the_floor(
    name: str, altitude_m: float, held_m: float
) -> None:
    place = (0.0, 0.0, -altitude_m)
    verdict = Guard(CONFIG).check(setpoint(place), sight(place, beams=(beam(name, 0.1),)))
    assert is_hold_at(verdict, (0.0, 0.0, -held_m))


@pytest.mark.parametrize(("name", "sign"), [("up", 1.0), ("down", -1.0)])
def test_a_doubted_surface_is_not_approached_and_not_fled(name: str, sign: float) -> None:
    seen = sight(beams=(beam(name, 0.1, RangeStatus.SUSPECT),))
    towards = Guard(CONFIG).check(setpoint(velocity=(0.0, 0.0, -0.2 * sign)), seen)
    assert climb(towards, seen) == 0.0
    assert Guard(CONFIG).check(setpoint(), seen).limits == ()


def test_a_retreat_keeps_the_leash() -> None:
    seen = sight(beams=(beam("up", 0.02),))
    asked = setpoint((0.6, 0.0, -1.0), (-0.4, 0.0, 0.0))
    verdict = Guard(plain(speed_max_m_s=0.6)).check(asked, seen)
    assert climb(verdict, seen) == pytest.approx(-g.RETREAT_M_S)
    assert math.hypot(*verdict.setpoint.position_ned_m[:2], 0.1) == pytest.approx(0.6)


def test_a_vertical_beam_mounted_off_centre_counts_from_the_centre() -> None:
    mount = BeamMount(name="up", pitch_deg=90.0, down_m=-0.05)
    seen = sight(beams=(beam("up", 0.2, mount=mount),))
    verdict = Guard(CONFIG).check(setpoint(velocity=(0.0, 0.0, -0.4)), seen)
    assert climb(verdict, seen) == pytest.approx(0.25 - 0.185)
