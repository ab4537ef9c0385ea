"""What the guard promises in every situation."""

import math

import msgspec
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from hal.config import GuardConfig
from hal.frames import add
from hal.readings import RangeStatus
from hal.setpoints import Setpoint
from hal.vehicle import guard as g
from hal.vehicle.guard import Guard, Sight
from tests.unit.hal.vehicle.guard_world import (
    L_SHAPE,
    MOUNTS,
    NOW_S,
    SQUARE,
    DiscWorld,
    beam,
    climb,
    effective,
    setpoint,
    sight,
)

# ---------------------------------------------------------------- properties

metres = st.floats(-1.2, 1.2)
small = st.floats(-0.6, 0.6)
hits_near = st.lists(st.tuples(small, small), max_size=6).map(tuple)
readings = st.lists(
    st.tuples(
        st.sampled_from(sorted(MOUNTS)), st.floats(0.02, 0.9), st.sampled_from(list(RangeStatus))
    ),
    max_size=6,
).map(lambda entries: tuple(beam(*entry) for entry in entries))


vectors = st.tuples(small, small, small)


@st.composite
def situations(draw: st.DrawFn) -> tuple[Setpoint, Sight]:
    position = (draw(metres), draw(metres), -draw(st.floats(0.0, 2.5)))
    seen = sight(
        position,
        draw(vectors),
        hits=tuple((position[0] + n, position[1] + e) for n, e in draw(hits_near)),
        beams=draw(readings),
        yaw_rad=draw(st.floats(-4.0, 4.0)),
        sigma_m=draw(st.floats(0.0, 0.1)),
    )
    age_s = draw(st.sampled_from([0.0, 0.1, 0.15, 1.0]))
    return setpoint(add(position, draw(vectors)), draw(vectors), stamp_s=NOW_S - age_s), seen


@settings(deadline=None, max_examples=300)
@given(situations())
def test_no_approach_is_faster_than_can_be_stopped(situation: tuple[Setpoint, Sight]) -> None:
    asked, seen = situation
    n, e = effective(Guard(SQUARE).check(asked, seen), seen)
    speed = math.hypot(n, e)
    assert speed <= SQUARE.speed_max_m_s + 1e-9
    heading = math.atan2(e, n)
    free_m = seen.space.free_distance_m(seen.position_ned_m, heading, 10.0, NOW_S)
    needs_m = g.stopping_distance_m(speed, SQUARE.reaction_s, SQUARE.braking_m_s2)
    nearest = seen.space.nearest_hit(seen.position_ned_m, 1.0)
    if speed > 1e-6 and free_m == 0.0:
        assert speed <= g.ESCAPE_SPEED_M_S + 1e-9
        assert nearest is not None
        assert math.cos(heading - nearest[1]) <= -g.ESCAPE_COSINE + 1e-6
    elif speed > 1e-6:
        assert needs_m <= free_m - seen.position_sigma_m + 1e-6


@settings(deadline=None, max_examples=300)
@given(situations(), st.sampled_from([SQUARE, L_SHAPE]))
def test_the_fence_is_never_left_nor_left_further(
    situation: tuple[Setpoint, Sight], config: GuardConfig
) -> None:
    asked, seen = situation
    seen = msgspec.structs.replace(seen, space=DiscWorld(), beams=())
    n, e = effective(Guard(config).check(asked, seen), seen, config)
    speed = max(math.hypot(n, e), 1e-9)
    north, east, _ = seen.position_ned_m
    inside_m = config.fence.inside_distance_m(north, east)
    if inside_m > 1e-6:
        needs_m = g.stopping_distance_m(speed, config.reaction_s, config.braking_m_s2)
        for part in (0.25, 0.5, 0.75, 1.0):
            s = part * needs_m / speed
            assert config.fence.inside_distance_m(north + n * s, east + e * s) >= -1e-6
    elif inside_m < -1e-6 and speed > 1e-6:
        ahead_m = config.fence.inside_distance_m(north + n / speed * 0.01, east + e / speed * 0.01)
        assert ahead_m > inside_m


@settings(deadline=None, max_examples=300)
@given(situations())
@example((setpoint((0.0, 0.0, -1.0)), sight()))
@example((setpoint((0.453, 0.0, -1.0)), sight((-0.047, 0.0, -1.0), (0.0, 0.5, 0.0), sigma_m=0.031)))
def test_a_second_check_changes_nothing(situation: tuple[Setpoint, Sight]) -> None:
    asked, seen = situation
    guard = Guard(L_SHAPE)
    first = guard.check(asked, seen)
    if not first.limits:
        assert first.setpoint is asked
    second = guard.check(first.setpoint, seen)
    assert second.setpoint.position_ned_m == pytest.approx(first.setpoint.position_ned_m, abs=1e-7)
    assert second.setpoint.velocity_ned_m_s == pytest.approx(
        first.setpoint.velocity_ned_m_s, abs=1e-7
    )
    third = guard.check(asked, seen)
    assert third.setpoint.position_ned_m == pytest.approx(first.setpoint.position_ned_m, abs=1e-7)


@settings(deadline=None, max_examples=300)
@given(situations())
def test_the_vertical_limits_always_hold(situation: tuple[Setpoint, Sight]) -> None:
    asked, seen = situation
    verdict = Guard(SQUARE).check(asked, seen)
    altitude_m = -seen.position_ned_m[2]
    up = climb(verdict, seen)
    assert -SQUARE.climb_max_m_s - 1e-9 <= up <= SQUARE.climb_max_m_s + 1e-9
    assert up <= max(0.0, SQUARE.altitude_max_m - altitude_m) + 1e-8
    assert up >= -max(0.0, altitude_m - SQUARE.altitude_min_m) - 1e-8
    offset = [
        a - b for a, b in zip(verdict.setpoint.position_ned_m, seen.position_ned_m, strict=True)
    ]
    assert math.hypot(*offset) <= SQUARE.leash_m + 1e-9


def surface_m(seen: Sight, name: str) -> float:
    """The nearest surface that a vertical beam is sure of; a doubted one that is too near ends the
    approach, and is no reason to leave.
    """
    stop_m = SQUARE.beam_stop_m
    nearest_m = math.inf
    for reading in (b.reading for b in seen.beams if b.mount.name == name):
        if reading.status in (RangeStatus.VALID, RangeStatus.TOO_NEAR):
            nearest_m = min(nearest_m, reading.range_m)
        elif reading.status is RangeStatus.SUSPECT and reading.range_m < stop_m:
            nearest_m = min(nearest_m, stop_m)
    return nearest_m


@settings(deadline=None, max_examples=300)
@given(situations())
def test_a_surface_is_approached_to_the_limit_only_and_left_within_it(
    situation: tuple[Setpoint, Sight],
) -> None:
    asked, seen = situation
    verdict = Guard(SQUARE).check(asked, seen)
    up = climb(verdict, seen)
    altitude_m = -seen.position_ned_m[2]
    above_m = surface_m(seen, "up") - SQUARE.beam_stop_m
    below_m = surface_m(seen, "down") - SQUARE.beam_stop_m
    lower_m = altitude_m - SQUARE.altitude_min_m
    higher_m = SQUARE.altitude_max_m - altitude_m
    if above_m >= 0.0 and below_m >= 0.0:
        assert -below_m - 1e-8 <= up <= above_m + 1e-8
    elif above_m < 0.0 and below_m > 0.0 and lower_m > 0.0:
        assert up <= -min(-above_m, below_m, lower_m, g.RETREAT_M_S) + 1e-8
    elif below_m < 0.0 and above_m > 0.0 and lower_m > 0.0 and higher_m > 0.0:
        assert up >= min(-below_m, above_m, higher_m, g.RETREAT_M_S) - 1e-8


@settings(deadline=None, max_examples=200)
@given(situations())
def test_no_component_leads_towards_a_near_beam(situation: tuple[Setpoint, Sight]) -> None:
    asked, seen = situation
    n, e = effective(Guard(SQUARE).check(asked, seen), seen)
    for entry in seen.beams:
        reading = entry.reading
        if (
            entry.mount.horizontal
            and reading.status not in (RangeStatus.NO_SIGNAL, RangeStatus.OUT_OF_RANGE)
            and reading.range_m < SQUARE.beam_stop_m
        ):
            bearing = seen.yaw_rad + math.radians(entry.mount.yaw_deg)
            assert n * math.cos(bearing) + e * math.sin(bearing) <= 1e-8


@given(st.floats(0.0, 5.0), st.floats(0.0, 2.0), st.floats(0.05, 10.0))
def test_stopping_speed_is_the_inverse_of_stopping_distance(
    distance_m: float, reaction_s: float, braking: float
) -> None:
    speed = g.stopping_speed_m_s(distance_m, reaction_s, braking)
    assert g.stopping_distance_m(speed, reaction_s, braking) == pytest.approx(distance_m, abs=1e-9)
