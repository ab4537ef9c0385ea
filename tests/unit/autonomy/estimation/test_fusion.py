import math
from collections.abc import Callable
from typing import NamedTuple

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from autonomy.config import EstimationConfig
from autonomy.estimation.fusion import Fusion
from autonomy.estimation.surfaces import STEP_READINGS
from autonomy.model import FusedState, SourceHealth
from hal.config import BeamMount, BeamsConfig, six_beams
from hal.frames import ZERO3, Vector3, add, geodetic_from_ned
from hal.readings import Attitude, FixType, GnssFix, LocalPosition, RangeReading, RangeStatus

TICK_S = 0.05
CONFIG = EstimationConfig()
ORIGIN = (47.3977, 8.5456, 488.0)


def fusion(config: EstimationConfig = CONFIG, beams: BeamsConfig | None = None) -> Fusion:
    return Fusion(config, beams if beams is not None else BeamsConfig())


def local(
    stamp_s: float, position: Vector3 = ZERO3, velocity: Vector3 = ZERO3, counter: int = 0
) -> LocalPosition:
    return LocalPosition(stamp_s, position, velocity, counter)


def attitude(
    stamp_s: float, yaw: float = 0.0, rate: float = 0.0, roll: float = 0.0, pitch: float = 0.0
) -> Attitude:
    return Attitude(stamp_s, roll, pitch, yaw, rate)


def fix(
    stamp_s: float, ned: Vector3 = ZERO3, kind: FixType = FixType.FIX_3D, accuracy_m: float = 0.5
) -> GnssFix:
    lat, lon, amsl = geodetic_from_ned(ned, ORIGIN)
    return GnssFix(stamp_s, kind, lat, lon, amsl, accuracy_m, accuracy_m, 9)


def down(
    stamp_s: float, range_m: float, status: RangeStatus = RangeStatus.VALID, name: str = "down"
) -> RangeReading:
    return RangeReading(stamp_s, name, status, range_m, 1e-4, 0.02, 1.0)


def settle(
    estimator: Fusion,
    seconds: float = 2.0,
    position: Vector3 = (0.0, 0.0, -0.8),
    start_s: float = 0.0,
) -> float:
    """Feed a vehicle at rest, with GNSS at 5 Hz and a flat floor; returns the time after."""
    steps = round(seconds / TICK_S)
    for i in range(steps):
        now_s = start_s + i * TICK_S
        estimator.step(
            now_s,
            local(now_s, position),
            attitude(now_s),
            fix(now_s, position) if i % 4 == 0 else None,
            (down(now_s, -position[2]),),
        )
    return start_s + steps * TICK_S


# ---------------------------------------------------------------- ok, and why not


def test_before_the_first_local_position_nothing_is_known() -> None:
    state = fusion().step(5.0, None, attitude(5.0), fix(5.0), (down(5.0, 0.5),))
    assert not state.ok
    assert state.why_not_ok == "no local position yet"
    assert state.position_sigma_m > CONFIG.sigma_max_m
    assert state.height_agl_m is None
    assert msgspec.json.decode(msgspec.json.encode(state), type=FusedState) == state


def test_without_attitude_the_state_is_not_ok() -> None:
    state = fusion().step(0.0, local(0.0), None, None, ())
    assert (state.ok, state.why_not_ok) == (False, "no attitude yet")


def test_one_local_position_and_one_attitude_are_enough() -> None:
    state = fusion().step(0.0, local(0.0, (1.0, 2.0, -3.0)), attitude(0.0, yaw=1.0), None, ())
    assert state.ok
    assert state.why_not_ok == ""
    assert state.position_ned_m == (1.0, 2.0, -3.0)
    assert state.point == (1.0, 2.0)
    assert state.yaw_rad == 1.0


@pytest.mark.parametrize(("age_s", "ok"), [(0.29, True), (0.31, False), (2.0, False)])
def test_an_old_local_position_is_not_flown_by(age_s: float, *, ok: bool) -> None:
    estimator = fusion()
    now_s = settle(estimator)
    now_s += age_s - TICK_S
    state = estimator.step(now_s, local(now_s - age_s), attitude(now_s), None, ())
    assert state.ok == ok
    assert ("local position is" in state.why_not_ok) == (not ok)


def test_a_local_position_from_the_future_is_not_flown_by() -> None:
    state = fusion().step(0.0, local(0.4), attitude(0.0), None, ())
    assert "in the future" in state.why_not_ok


@pytest.mark.parametrize(("age_s", "ok"), [(0.29, True), (0.31, False)])
def test_an_old_attitude_is_not_flown_by(age_s: float, *, ok: bool) -> None:
    state = fusion().step(1.0, local(1.0), attitude(1.0 - age_s), None, ())
    assert state.ok == ok
    assert ("attitude is" in state.why_not_ok) == (not ok)


def test_an_uncertain_position_is_not_flown_by() -> None:
    config = EstimationConfig(local_position_sigma_m=0.31)
    state = fusion(config).step(0.0, local(0.0), attitude(0.0), None, ())
    assert state.why_not_ok == "position is uncertain to 0.31 m"


# ---------------------------------------------------------------- motion and delay


def test_a_vehicle_at_rest_stays_where_it_is() -> None:
    estimator = fusion()
    now_s = settle(estimator, position=(1.0, -2.0, -0.8))
    state = estimator.step(now_s, local(now_s, (1.0, -2.0, -0.8)), attitude(now_s), None, ())
    assert state.ok
    assert state.position_ned_m == pytest.approx((1.0, -2.0, -0.8), abs=1e-9)
    assert state.velocity_ned_m_s == pytest.approx(ZERO3, abs=1e-9)
    assert 0.0 < state.position_sigma_m < CONFIG.local_position_sigma_m


def test_a_delayed_position_is_carried_on_to_now() -> None:
    estimator = fusion()
    velocity = (0.2, -0.1, 0.05)
    for i in range(40):
        now_s = i * TICK_S
        stamp_s = now_s - 0.08
        position = (0.2 * stamp_s, -0.1 * stamp_s, 0.05 * stamp_s)
        state = estimator.step(now_s, local(stamp_s, position, velocity), attitude(now_s), None, ())
    assert state.stamp_s == pytest.approx(now_s)
    assert state.position_ned_m == pytest.approx(
        (0.2 * now_s, -0.1 * now_s, 0.05 * now_s), abs=1e-9
    )


def test_a_reading_counts_once() -> None:
    once, often = fusion(), fusion()
    reading = local(0.0, (0.1, 0.0, 0.0))
    later = local(0.05, (0.13, 0.0, 0.0))
    for estimator, repeats in ((once, 1), (often, 20)):
        estimator.step(0.0, reading, attitude(0.0), None, ())
        for _ in range(repeats):
            state = estimator.step(0.05, later, attitude(0.05), None, ())
        if estimator is once:
            first = state
    assert state == first


def test_without_news_the_position_goes_on_for_a_short_while_only() -> None:
    estimator = fusion()
    estimator.step(0.0, local(0.0, ZERO3, (0.2, 0.0, 0.0)), attitude(0.0), None, ())
    near = estimator.step(0.2, None, attitude(0.2), None, ())
    assert near.ok
    assert near.position_ned_m[0] == pytest.approx(0.04)
    far = estimator.step(5.0, None, attitude(5.0), None, ())
    assert not far.ok
    assert far.position_ned_m[0] == pytest.approx(0.2 * CONFIG.stale_after_s)
    assert far.stamp_s == pytest.approx(CONFIG.stale_after_s)
    assert near.position_sigma_m < far.position_sigma_m


def test_after_a_long_silence_the_next_reading_starts_anew() -> None:
    estimator = fusion()
    now_s = settle(estimator) + 5.0
    state = estimator.step(now_s, local(now_s, (3.0, 0.0, -1.0)), attitude(now_s), None, ())
    assert state.ok
    assert state.position_ned_m == (3.0, 0.0, -1.0)
    assert state.frame_shift_ned_m == ZERO3


def test_yaw_is_carried_on_by_its_rate_and_wrapped() -> None:
    state = fusion().step(0.1, local(0.1), attitude(0.0, 3.1, 1.0, 0.02, -0.03), None, ())
    assert state.yaw_rad == pytest.approx(3.2 - 2.0 * math.pi)
    assert (state.roll_rad, state.pitch_rad, state.yaw_rate_rad_s) == (0.02, -0.03, 1.0)


def test_yaw_is_not_carried_on_for_ever() -> None:
    state = fusion().step(10.0, local(10.0), attitude(0.0, 0.5, 1.0), None, ())
    assert not state.ok
    assert state.yaw_rad == pytest.approx(0.5 + CONFIG.stale_after_s)


def test_a_wrong_position_that_arrives_late_is_rejected() -> None:
    estimator = fusion()
    now_s = settle(estimator)
    before = estimator.step(now_s, local(now_s, (0.0, 0.0, -0.8)), attitude(now_s), None, ())
    after = estimator.step(now_s, local(now_s - 0.52, (9.0, 9.0, 9.0)), attitude(now_s), None, ())
    assert after.position_ned_m == pytest.approx(before.position_ned_m, abs=1e-12)
    assert after.health.position.rejected == 1


def test_a_position_of_before_a_reset_says_nothing_any_more() -> None:
    estimator = fusion()
    now_s = settle(estimator)
    moved = (0.5, 0.0, -0.8)
    before = estimator.step(now_s, local(now_s, moved, counter=1), attitude(now_s), None, ())
    old = local(now_s - 0.02, (0.0, 0.0, -0.8))
    after = estimator.step(now_s, old, attitude(now_s), None, ())
    assert after.position_ned_m == before.position_ned_m
    assert after.health.position == before.health.position


def test_a_position_that_comes_too_late_is_counted_and_no_more() -> None:
    estimator = fusion()
    now_s = settle(estimator)
    before = estimator.step(now_s, local(now_s, (0.0, 0.0, -0.8)), attitude(now_s), None, ())
    for _ in range(3):
        after = estimator.step(
            now_s, local(now_s - 1.2, (0.0, 0.0, -0.8)), attitude(now_s), None, ()
        )
    assert after.position_ned_m == before.position_ned_m
    assert after.health.position.rejected == 1


# ---------------------------------------------------------------- outliers and resets


def test_a_single_outlier_is_rejected() -> None:
    estimator = fusion()
    now_s = settle(estimator)
    state = estimator.step(now_s, local(now_s, (0.5, 0.0, -0.8)), attitude(now_s), None, ())
    assert state.ok
    assert state.position_ned_m == pytest.approx((0.0, 0.0, -0.8), abs=1e-6)
    assert state.frame_shift_ned_m == ZERO3


def test_a_jump_that_lasts_stops_the_flight_and_then_is_taken_as_a_moved_frame() -> None:
    estimator = fusion()
    now_s = settle(estimator)
    moved = (0.5, -0.4, -0.8)
    states = []
    for i in range(CONFIG.reset_after_rejections):
        at_s = now_s + i * TICK_S
        states.append(estimator.step(at_s, local(at_s, moved), attitude(at_s), None, ()))
    assert not states[-2].ok
    assert "rejected 9 times in a row" in states[-2].why_not_ok
    assert all(s.frame_shift_ned_m == ZERO3 for s in states[:-1])
    assert states[-1].ok
    assert states[-1].position_ned_m == pytest.approx(moved)
    assert states[-1].frame_shift_ned_m == pytest.approx((0.5, -0.4, 0.0), abs=1e-6)


def test_an_old_estimate_with_new_stamps_is_not_flown_by() -> None:
    """What moves is not where it was: the very same numbers again are no news."""
    estimator = fusion()
    moving, there = (0.2, 0.0, 0.0), (1.0, 2.0, -0.8)
    for i in range(21):
        now_s = i * TICK_S
        state = estimator.step(now_s, local(now_s, there, moving), attitude(now_s), None, ())
    assert not state.ok
    assert state.why_not_ok == "local position is 1.00 s old"


@pytest.mark.parametrize("velocity", [ZERO3, (0.0005, 0.0, 0.0)])
def test_a_vehicle_that_stands_may_repeat_itself(velocity: Vector3) -> None:
    estimator = fusion()
    for i in range(41):
        now_s = i * TICK_S
        state = estimator.step(now_s, local(now_s, ZERO3, velocity), attitude(now_s), None, ())
    assert state.ok


def test_rejections_must_be_in_a_row() -> None:
    estimator = fusion()
    now_s = settle(estimator)
    for i in range(60):
        position = (0.0, 0.0, -0.8) if i % 3 == 0 else (0.6, 0.0, -0.8)
        state = estimator.step(now_s, local(now_s, position), attitude(now_s), None, ())
        now_s += TICK_S
        assert state.ok
        assert state.frame_shift_ned_m == ZERO3


@pytest.mark.parametrize("jump", [(1.0, -2.0, 0.0), (0.0, 0.0, 0.4), (0.2, 0.0, -0.3)])
def test_an_ekf_reset_is_followed_at_once_and_reported_once(jump: Vector3) -> None:
    estimator = fusion()
    now_s = settle(estimator)
    moved = add((0.0, 0.0, -0.8), jump)
    state = estimator.step(now_s, local(now_s, moved, counter=1), attitude(now_s), None, ())
    assert state.ok
    assert state.position_ned_m == pytest.approx(moved)
    assert state.frame_shift_ned_m == pytest.approx(jump, abs=1e-6)
    now_s += TICK_S
    state = estimator.step(now_s, local(now_s, moved, counter=1), attitude(now_s), None, ())
    assert state.frame_shift_ned_m == ZERO3


def test_a_reset_of_the_heading_alone_shakes_nothing() -> None:
    estimator = fusion()
    now_s = settle(estimator)
    near = (0.02, 0.0, -0.81)
    state = estimator.step(now_s, local(now_s, near, counter=1), attitude(now_s), None, ())
    assert state.frame_shift_ned_m == ZERO3


def test_a_reset_in_motion_is_the_jump_without_the_motion() -> None:
    estimator = fusion()
    for i in range(40):
        at_s = i * TICK_S
        estimator.step(
            at_s, local(at_s, (0.2 * at_s, 0.0, 0.0), (0.2, 0.0, 0.0)), attitude(at_s), None, ()
        )
    at_s = 2.0
    position = (0.4 + 1.0, 0.0, 0.0)
    state = estimator.step(
        at_s, local(at_s, position, (0.2, 0.0, 0.0), counter=7), attitude(at_s), None, ()
    )
    assert state.frame_shift_ned_m == pytest.approx((1.0, 0.0, 0.0), abs=1e-6)


def test_the_first_counter_is_no_reset() -> None:
    state = fusion().step(0.0, local(0.0, (5.0, 0.0, 0.0), counter=3), attitude(0.0), None, ())
    assert state.frame_shift_ned_m == ZERO3


# ---------------------------------------------------------------- GNSS


def test_gnss_never_moves_the_state_by_more_than_its_bias_lets_it() -> None:
    here = (0.0, 0.0, -0.8)
    with_gnss, without = fusion(), fusion()
    for estimator in (with_gnss, without):
        now_s = settle(estimator, 4.0, here)
    beside = fix(now_s, (0.5, 0.0, -0.8), FixType.RTK_FIXED, accuracy_m=0.01)
    reading = local(now_s, here)
    a = with_gnss.step(now_s, reading, attitude(now_s), beside, ())
    b = without.step(now_s, reading, attitude(now_s), None, ())
    assert 0.0 < a.position_ned_m[0] - b.position_ned_m[0] < 0.001
    assert a.position_sigma_m < b.position_sigma_m


def test_a_late_fix_is_compared_with_where_the_vehicle_was() -> None:
    states = []
    for delay_s in (0.0, 0.4):
        estimator = fusion()
        for i in range(80):
            now_s = i * TICK_S
            at = (0.5 * now_s, 0.0, 0.0)
            then = (0.5 * (now_s - delay_s), 0.0, 0.0)
            gnss = fix(now_s - delay_s, then) if i % 4 == 0 else None
            reading = local(now_s, at, (0.5, 0.0, 0.0))
            state = estimator.step(now_s, reading, attitude(now_s), gnss, ())
        states.append(state)
    assert states[0].position_ned_m[0] == pytest.approx(0.5 * now_s, abs=1e-5)
    assert states[1].position_ned_m[0] == pytest.approx(states[0].position_ned_m[0], abs=1e-5)
    assert states[1].health.gnss_bias_ne_m == pytest.approx((0.0, 0.0), abs=1e-3)
    assert states[1].health.gnss.test_ratio < 1e-5
    assert states[1].health.late > 0


def test_a_fix_counts_once() -> None:
    once, often = fusion(), fusion()
    for estimator, repeats in ((once, 1), (often, 10)):
        now_s = settle(estimator, 4.0)
        beside, reading = fix(now_s, (0.5, 0.0, -0.8)), local(now_s, (0.0, 0.0, -0.8))
        for _ in range(repeats):
            state = estimator.step(now_s, reading, attitude(now_s), beside, ())
        if estimator is once:
            first = state
    assert state == first


def test_neighbouring_fixes_count_as_one() -> None:
    estimator = fusion()
    now_s = settle(estimator, 4.0)
    for i in range(40):
        at_s = now_s + i * TICK_S
        state = estimator.step(
            at_s, local(at_s, (0.0, 0.0, -0.8)), attitude(at_s), fix(at_s, (0.0, 0.0, -0.8)), ()
        )
    assert state.health.gnss.fused == pytest.approx(6.0 / CONFIG.gnss_interval_s, abs=3)
    assert state.health.gnss.rejected == 0


def test_a_fix_is_believed_by_its_horizontal_accuracy_and_never_beyond_the_floor() -> None:
    moved = []
    for horizontal_m, vertical_m in ((0.01, 0.5), (0.5, 9.0), (3.0, 0.5)):
        estimator = fusion()
        now_s = settle(estimator, 4.0)
        beside = msgspec.structs.replace(
            fix(now_s, (0.5, 0.0, -0.8)),
            horizontal_accuracy_m=horizontal_m,
            vertical_accuracy_m=vertical_m,
        )
        reading = local(now_s, (0.0, 0.0, -0.8))
        state = estimator.step(now_s, reading, attitude(now_s), beside, ())
        assert state.health.gnss_bias_ne_m is not None
        moved.append(state.health.gnss_bias_ne_m[0])
    assert moved[0] == moved[1] > 0.0
    assert 0.0 < moved[2] < 0.1 * moved[0]


def test_a_fix_that_comes_too_late_is_counted_and_no_more() -> None:
    one, other = fusion(), fusion()
    for estimator in (one, other):
        now_s = settle(estimator, 4.0)
        for i in range(30):
            at_s = now_s + i * TICK_S
            estimator.step(at_s, local(at_s, (0.0, 0.0, -0.8)), attitude(at_s), None, ())
    level, late = attitude(at_s), fix(at_s - 1.1, (0.3, 0.0, -0.8))
    a, b = one.step(at_s, None, level, late, ()), other.step(at_s, None, level, None, ())
    assert a.position_ned_m == b.position_ned_m
    assert a.health.gnss.rejected == b.health.gnss.rejected + 1


@pytest.mark.parametrize("kind", [FixType.NO_GPS, FixType.NO_FIX, FixType.FIX_2D])
def test_a_fix_without_position_is_ignored(kind: FixType) -> None:
    one, other = fusion(), fusion()
    for estimator in (one, other):
        now_s = settle(estimator, 4.0)
    reading, level = local(now_s, (0.0, 0.0, -0.8)), attitude(now_s)
    bad = fix(now_s, (0.3, 0.0, -0.8), kind)
    assert one.step(now_s, reading, level, bad, ()) == other.step(now_s, reading, level, None, ())


def test_a_fix_from_the_future_is_counted_once_and_mutes_none_that_comes_after_it() -> None:
    estimator = fusion()
    now_s = settle(estimator, 4.0)
    place = (0.0, 0.0, -0.8)
    for i in range(60):
        at_s = now_s + i * TICK_S
        told = fix(now_s + 3600.0 if 20 <= i < 24 else at_s, place)
        state = estimator.step(at_s, local(at_s, place), attitude(at_s), told, ())
    assert state.health.gnss.rejected == 1
    assert state.health.gnss.age_s is not None
    assert state.health.gnss.age_s < CONFIG.gnss_interval_s + 2.0 * TICK_S


def test_a_fix_from_the_future_is_refused() -> None:
    estimator = fusion()
    now_s = settle(estimator, 4.0)
    reading, level = local(now_s, (0.0, 0.0, -0.8)), attitude(now_s)
    state = estimator.step(now_s, reading, level, fix(now_s + 5.0, (0.0, 0.0, -0.8)), ())
    assert state.health.gnss.rejected == 1


def test_after_a_reset_gnss_belongs_to_the_new_frame() -> None:
    estimator = fusion()
    here, jump = (0.0, 0.0, -0.8), (1.5, 0.0, 0.0)
    now_s = settle(estimator, 4.0, here)
    moved = add(here, jump)
    for _ in range(20):
        state = estimator.step(
            now_s, local(now_s, moved, counter=1), attitude(now_s), fix(now_s, here), ()
        )
        now_s += TICK_S
    assert state.position_ned_m == pytest.approx(moved, abs=1e-6)
    assert state.health.gnss.rejected == 0
    assert state.health.gnss_bias_ne_m == pytest.approx((-1.5, 0.0), abs=1e-3)


# ---------------------------------------------------------------- height


def test_the_height_over_ground_follows_the_down_beam() -> None:
    estimator = fusion()
    now_s = settle(estimator, position=(0.0, 0.0, -0.8))
    state = estimator.step(
        now_s, local(now_s, (0.0, 0.0, -0.8)), attitude(now_s), None, (down(now_s, 0.8),)
    )
    assert state.height_agl_m == pytest.approx(0.8, abs=1e-6)


@pytest.mark.parametrize(("roll", "pitch"), [(0.3, 0.0), (0.0, -0.3), (0.2, 0.2)])
def test_tilt_is_taken_out_of_the_height(roll: float, pitch: float) -> None:
    slant_m = 0.8 / (math.cos(roll) * math.cos(pitch))
    state = fusion().step(
        0.0,
        local(0.0, (0.0, 0.0, -0.8)),
        attitude(0.0, roll=roll, pitch=pitch),
        None,
        (down(0.0, slant_m),),
    )
    assert state.height_agl_m == pytest.approx(0.8)


def test_a_beam_mounted_off_centre_is_taken_into_account() -> None:
    mount = BeamMount(name="down", pitch_deg=-90.0, forward_m=0.1, right_m=0.05, down_m=0.04)
    beams = BeamsConfig(mounts=(*six_beams()[:5], mount))
    level = fusion(beams=beams).step(0.0, local(0.0), attitude(0.0), None, (down(0.0, 0.5),))
    assert level.height_agl_m == pytest.approx(0.54)
    nose_up = fusion(beams=beams).step(
        0.0, local(0.0), attitude(0.0, pitch=0.2), None, (down(0.0, 0.5),)
    )
    # Nose up lifts a beam that is in front of the centre.
    assert nose_up.height_agl_m == pytest.approx(0.54 * math.cos(0.2) - 0.1 * math.sin(0.2))


@pytest.mark.parametrize(("roll", "pitch"), [(0.53, 0.0), (0.0, -0.53)])
def test_a_steep_tilt_gives_no_height(roll: float, pitch: float) -> None:
    tilted = attitude(0.0, roll=roll, pitch=pitch)
    state = fusion().step(0.0, local(0.0), tilted, None, (down(0.0, 0.5),))
    assert state.height_agl_m is None


@pytest.mark.parametrize(
    "reading",
    [
        down(0.0, 1.0, RangeStatus.OUT_OF_RANGE),
        down(0.0, 0.0, RangeStatus.NO_SIGNAL),
        down(0.0, 0.02, RangeStatus.TOO_NEAR),
        down(0.0, 0.5, RangeStatus.SUSPECT),
        down(0.0, 0.5, name="front"),
    ],
)
def test_only_a_valid_reading_of_the_down_beam_is_a_height(reading: RangeReading) -> None:
    state = fusion().step(0.0, local(0.0), attitude(0.0), None, (reading,))
    assert state.height_agl_m is None


def test_without_a_down_beam_there_is_no_height() -> None:
    estimator = fusion(beams=BeamsConfig(mounts=six_beams()[:4]))
    state = estimator.step(0.0, local(0.0), attitude(0.0), None, (down(0.0, 0.5),))
    assert state.height_agl_m is None


def test_the_height_is_gone_when_its_readings_are() -> None:
    estimator = fusion()
    now_s = settle(estimator)
    for _ in range(10):
        state = estimator.step(now_s, local(now_s, (0.0, 0.0, -0.8)), attitude(now_s), None, ())
        now_s += TICK_S
        supported = now_s - TICK_S - (2.0 - TICK_S) <= 0.3 + 1e-9
        assert (state.height_agl_m is not None) == supported


def test_over_a_table_the_height_steps_and_the_altitude_does_not() -> None:
    estimator = fusion()
    here = (0.0, 0.0, -0.8)
    now_s = settle(estimator, position=here)
    heights = []
    for _ in range(STEP_READINGS + 2):
        state = estimator.step(
            now_s, local(now_s, here), attitude(now_s), None, (down(now_s, 0.3),)
        )
        assert state.position_ned_m == pytest.approx(here, abs=1e-6)
        heights.append(state.height_agl_m)
        now_s += TICK_S
    assert heights[: STEP_READINGS - 1] == pytest.approx([0.8, 0.8], abs=1e-6)
    assert heights[STEP_READINGS - 1 :] == pytest.approx([0.3, 0.3, 0.3], abs=1e-6)


def test_a_height_counts_once() -> None:
    estimator = fusion()
    here = (0.0, 0.0, -0.8)
    now_s = settle(estimator, position=here)
    wrong = down(now_s, 0.3)
    for _ in range(2 * STEP_READINGS):
        state = estimator.step(now_s, local(now_s, here), attitude(now_s), None, (wrong,))
        assert state.height_agl_m == pytest.approx(0.8, abs=1e-6)


def test_a_noisy_height_is_believed_less() -> None:
    heights = []
    for variance_m2 in (1e-4, 0.04):
        estimator = fusion()
        here = (0.0, 0.0, -0.8)
        now_s = settle(estimator, position=here)
        reading = msgspec.structs.replace(down(now_s, 0.7), variance_m2=variance_m2)
        state = estimator.step(now_s, local(now_s, here), attitude(now_s), None, (reading,))
        assert state.height_agl_m is not None
        heights.append(state.height_agl_m)
    assert heights[0] < heights[1] - 0.005
    assert heights[1] < 0.8


def test_single_wrong_heights_are_rejected() -> None:
    estimator = fusion()
    here = (0.0, 0.0, -0.8)
    now_s = settle(estimator, position=here)
    for i in range(30):
        range_m = 0.3 if i % 3 else 0.8
        state = estimator.step(
            now_s, local(now_s, here), attitude(now_s), None, (down(now_s, range_m),)
        )
        assert state.height_agl_m == pytest.approx(0.8, abs=1e-6)
        now_s += TICK_S


def test_a_vertical_reset_moves_the_surface_with_the_frame() -> None:
    estimator = fusion()
    now_s = settle(estimator)
    state = estimator.step(
        now_s,
        local(now_s, (0.0, 0.0, -1.3), counter=1),
        attitude(now_s),
        None,
        (down(now_s, 0.8),),
    )
    assert state.height_agl_m == pytest.approx(0.8, abs=1e-6)


# ---------------------------------------------------------------- ceiling, steps, altitude


def up(stamp_s: float, range_m: float) -> RangeReading:
    return down(stamp_s, range_m, name="up")


def over(
    estimator: Fusion, start_s: float, rows: list[tuple[float, float, float]]
) -> list[FusedState]:
    """Feed (altitude, range below, range above), one row a tick."""
    states = []
    for i, (altitude_m, below_m, above_m) in enumerate(rows):
        now_s = start_s + i * TICK_S
        reading = local(now_s, (0.0, 0.0, -altitude_m))
        beams = (down(now_s, below_m), up(now_s, above_m))
        states.append(estimator.step(now_s, reading, attitude(now_s), None, beams))
    return states


def told(states: list[FusedState]) -> list[str]:
    return [event.name for state in states for event in state.news]


def test_the_room_above_is_measured_from_the_centre_and_without_tilt() -> None:
    mount = BeamMount(name="up", pitch_deg=90.0, down_m=-0.04)
    beams = BeamsConfig(mounts=(*six_beams()[:4], mount))
    state = fusion(beams=beams).step(0.0, local(0.0), attitude(0.0), None, (up(0.0, 0.5),))
    assert state.room_above_m == pytest.approx(0.54)
    assert state.height_agl_m is None
    tilted = fusion().step(0.0, local(0.0), attitude(0.0, roll=0.3), None, (up(0.0, 0.5),))
    assert tilted.room_above_m == pytest.approx(0.5 * math.cos(0.3))


def test_over_a_box_the_floor_steps_and_back_again_and_it_is_told() -> None:
    estimator = fusion()
    plain, box = [(0.8, 0.8, 0.6)] * 10, [(0.8, 0.4, 0.6)] * 10
    states = over(estimator, 0.0, [*plain, *box, *plain])
    assert told(states) == ["floor_step", "floor_step"]
    words = [event.why for state in states for event in state.news]
    assert words == ["the floor is 0.40 m higher here", "the floor is 0.40 m lower here"]
    assert all(state.position_ned_m[2] == pytest.approx(-0.8, abs=1e-6) for state in states)
    assert states[19].height_agl_m == pytest.approx(0.4, abs=1e-6)
    assert states[19].room_above_m == pytest.approx(0.6, abs=1e-6)
    assert states[-1].height_agl_m == pytest.approx(0.8, abs=1e-6)
    assert (states[-1].health.floor_steps, states[-1].health.ceiling_steps) == (2, 0)


def test_under_a_beam_the_ceiling_steps_and_the_altitude_does_not() -> None:
    estimator = fusion()
    states = over(estimator, 0.0, [*[(0.8, 0.8, 0.9)] * 10, *[(0.8, 0.8, 0.5)] * 12])
    assert [e.why for s in states for e in s.news] == ["the ceiling is 0.40 m lower here"]
    assert all(state.position_ned_m[2] == pytest.approx(-0.8, abs=1e-6) for state in states)
    assert states[-1].room_above_m == pytest.approx(0.5, abs=1e-6)


def test_climbing_is_no_step() -> None:
    estimator = fusion()
    rows = [(0.4 + 0.02 * i, 0.4 + 0.02 * i, 0.9 - 0.02 * i) for i in range(25)]
    for i, (altitude_m, _, _) in enumerate(rows):
        now_s = i * TICK_S
        reading = local(now_s, (0.0, 0.0, -altitude_m), (0.0, 0.0, -0.4))
        # The beams are late by a tick: they say what was true then.
        late = rows[max(0, i - 1)]
        beams = (down(now_s - TICK_S, late[1]), up(now_s - TICK_S, late[2]))
        state = estimator.step(now_s, reading, attitude(now_s), None, beams)
    assert state.health.floor_steps == state.health.ceiling_steps == 0
    assert state.height_agl_m == pytest.approx(rows[-1][1], abs=1e-3)
    assert state.room_above_m == pytest.approx(rows[-1][2], abs=1e-3)


def test_a_box_on_the_floor_below_a_beam_on_the_ceiling_is_two_steps() -> None:
    states = over(fusion(), 0.0, [*[(0.8, 0.8, 0.9)] * 10, *[(0.8, 0.4, 0.4)] * 12])
    assert sorted(told(states)) == ["ceiling_step", "floor_step"]


def test_an_altitude_that_jumps_against_floor_and_ceiling_is_no_two_steps() -> None:
    """A frame that jumps and does not own up to it: the altitude follows it, and it is told."""
    states = over(fusion(), 0.0, [*[(0.8, 0.8, 0.9)] * 20, *[(0.88, 0.8, 0.9)] * 60])
    assert "floor_step" not in told(states)
    assert states[-1].position_ned_m[2] == pytest.approx(-0.88, abs=0.01)
    assert states[-1].height_agl_m == pytest.approx(0.8, abs=0.02)


def test_an_altitude_that_drifts_against_floor_and_ceiling_is_told() -> None:
    rows = [(0.8 + 0.001 * i, 0.8, 0.9) for i in range(250)]
    states = over(fusion(), 0.0, rows)
    assert told(states) == ["altitude_drift"]
    why = next(event.why for state in states for event in state.news)
    assert why == "the autopilot's altitude drifted 0.15 m up against floor and ceiling"
    assert states[-1].height_agl_m == pytest.approx(0.8, abs=0.03)


def test_readings_that_fit_neither_the_floor_nor_each_other_are_no_floor() -> None:
    estimator = fusion()
    over(estimator, 0.0, [(0.8, 0.8, 0.9)] * 10)
    states = over(estimator, 0.5, [(0.8, (0.1, 0.45)[i % 2], 0.9) for i in range(20)])
    assert told(states) == []
    assert states[-1].height_agl_m is None


def test_a_vertical_jump_of_the_frame_moves_the_ceiling_too() -> None:
    estimator = fusion()
    over(estimator, 0.0, [(0.8, 0.8, 0.6)] * 10)
    reading = local(0.5, (0.0, 0.0, -1.3), counter=1)
    state = estimator.step(0.5, reading, attitude(0.5), None, (down(0.5, 0.8), up(0.5, 0.6)))
    assert state.room_above_m == pytest.approx(0.6, abs=1e-6)
    assert [event.name for event in state.news] == ["frame_jump"]


# ---------------------------------------------------------------- GNSS that errs


def with_gnss(
    estimator: Fusion,
    seconds: float,
    off: Callable[[float], Vector3 | None],
    *,
    start_s: float = 0.0,
    accuracy_m: float = 0.8,
    here: Vector3 = (1.0, 2.0, -0.8),
) -> list[FusedState]:
    """A vehicle at rest, with GNSS at 5 Hz that is `off` by so much then; None: silent."""
    states = []
    for i in range(round(seconds / TICK_S)):
        now_s = start_s + i * TICK_S
        error = off(now_s) if i % 4 == 0 else None
        gnss = fix(now_s - 0.1, add(here, error), accuracy_m=accuracy_m) if error else None
        states.append(estimator.step(now_s, local(now_s, here), attitude(now_s), gnss, ()))
    return states


def furthest_m(states: list[FusedState], here: Vector3 = (1.0, 2.0, -0.8)) -> float:
    return max(math.dist(state.position_ned_m, here) for state in states)


def test_gnss_that_is_lost_grows_old_and_changes_nothing() -> None:
    states = with_gnss(fusion(), 20.0, lambda s: ZERO3 if s < 10.0 else None)
    assert furthest_m(states) < 1e-6
    assert all(state.ok for state in states)
    assert states[-1].health.gnss.age_s == pytest.approx(10.0, abs=0.5)


def test_gnss_that_jumps_is_rejected_then_told_and_learned_anew() -> None:
    states = with_gnss(fusion(), 20.0, lambda s: (30.0, 40.0, 0.0) if s > 10.0 else ZERO3)
    assert furthest_m(states) < 1e-6
    health = states[-1].health
    assert health.gnss.rejected == CONFIG.reset_after_rejections
    assert health.gnss.test_ratio < 1.0
    assert health.gnss_apart_m == pytest.approx(50.0, abs=0.2)
    events = [event for state in states for event in state.news]
    assert [event.name for event in events] == ["gnss_jump", "gnss_drift"]
    assert "GNSS jumped by 50.0 m against the autopilot" in events[0].why
    assert 11.5 < events[0].stamp_s < 12.5


@pytest.mark.parametrize("speed_m_s", [0.05, 0.2, 1.0])
def test_gnss_that_drifts_slowly_drags_nothing_and_is_noticed(speed_m_s: float) -> None:
    """As somebody does who spoofs it: no fix is far from the one before."""
    begin_s = 10.0
    states = with_gnss(
        fusion(), 120.0, lambda s: (0.0, speed_m_s * max(0.0, s - begin_s), 0.0), accuracy_m=0.8
    )
    assert furthest_m(states) < 0.005
    assert all(state.ok for state in states)
    first = next(event for state in states for event in state.news)
    assert first.name == "gnss_drift"
    assert "drifted apart by 2." in first.why
    lag_s = 12.0
    assert first.stamp_s < begin_s + 2.5 / speed_m_s + lag_s
    bias = states[-1].health.gnss_bias_ne_m
    assert bias is not None
    assert bias[1] == pytest.approx(speed_m_s * 110.0, rel=0.08)


def test_the_drift_is_told_at_each_doubling_and_again_when_it_is_over() -> None:
    """Not at every fix."""
    states = with_gnss(
        fusion(), 200.0, lambda s: (0.2 * max(0.0, min(s, 160.0 - s)), 0.0, 0.0), accuracy_m=0.5
    )
    words = [event.why for state in states for event in state.news]
    assert 4 <= len(words) <= 6
    assert "agree again" in words[-1]
    assert all("drifted apart" in each for each in words[:-1])


def test_a_receiver_that_claims_little_may_wander_further() -> None:
    states = with_gnss(
        fusion(), 120.0, lambda s: (0.1 * max(0.0, s - 10.0), 0.0, 0.0), accuracy_m=5.0
    )
    assert told(states) == []


def test_multipath_that_wanders_within_its_accuracy_moves_nothing() -> None:
    rng = np.random.default_rng(3)
    at = [0.0, 0.0]

    def off(_: float) -> Vector3:
        for axis in (0, 1):
            at[axis] = 0.98 * at[axis] + 0.6 * float(rng.normal())
        return (at[0], at[1], 0.0)

    states = with_gnss(fusion(), 120.0, off, accuracy_m=4.0)
    assert furthest_m(states) < 0.01
    assert states[-1].health.gnss.rejected == 0


def test_a_reset_that_the_autopilot_owns_up_to_is_no_drift() -> None:
    here, moved = (1.0, 2.0, -0.8), (9.0, 2.0, -0.8)
    estimator = fusion()
    with_gnss(estimator, 10.0, lambda _: ZERO3)
    states = []
    for i in range(200):
        now_s = 10.0 + i * TICK_S
        gnss = fix(now_s, here) if i % 4 == 0 else None
        states.append(
            estimator.step(now_s, local(now_s, moved, counter=1), attitude(now_s), gnss, ())
        )
    assert told(states) == ["frame_jump"]
    assert states[0].frame_shift_ned_m == pytest.approx((8.0, 0.0, 0.0), abs=1e-6)
    assert states[-1].health.gnss_apart_m == pytest.approx(0.0, abs=0.01)
    assert states[-1].health.gnss.rejected == 0


def test_while_the_estimator_is_silent_gnss_carries_nothing() -> None:
    estimator = fusion()
    with_gnss(estimator, 10.0, lambda _: ZERO3)
    for i in range(40):
        now_s = 10.0 + i * TICK_S
        state = estimator.step(now_s, None, attitude(now_s), fix(now_s, (1.0, 2.0, -0.8)), ())
    assert not state.ok
    assert state.stamp_s < 10.0 + CONFIG.stale_after_s
    here = (1.2, 2.0, -0.8)
    state = estimator.step(12.0, local(12.0, here), attitude(12.0), None, ())
    assert state.ok
    assert state.position_ned_m == here
    assert state.health.restarts == 1
    assert (
        state.news[0].why == "the position filter began anew: local position was silent for 2.0 s"
    )


# ---------------------------------------------------------------- what is told of the filter


def test_every_source_is_counted_with_its_newest_test_ratio() -> None:
    estimator = fusion()
    now_s = settle(estimator, 2.0)
    off = (0.4, 0.0, -0.8)
    state = estimator.step(
        now_s, local(now_s, off), attitude(now_s), None, (down(now_s, 0.3), up(now_s, 0.5))
    )
    health = state.health
    assert (health.position.fused, health.position.rejected) == (40, 1)
    assert health.position.test_ratio > 1.0
    assert health.position.age_s == pytest.approx(TICK_S)
    assert (health.velocity.fused, health.velocity.rejected) == (41, 0)
    assert health.velocity.test_ratio == 0.0
    assert health.gnss.fused == 5
    assert (health.floor.fused, health.floor.rejected) == (40, 1)
    assert health.floor.test_ratio > 1.0
    assert health.ceiling == SourceHealth(0.0, 1, 0, 0.0)


def test_against_the_room_the_position_grows_uncertain_as_configured() -> None:
    config = EstimationConfig(drift_noise_m_per_sqrt_s=0.02)
    estimator = fusion(config)
    now_s = settle(estimator, 100.0)
    state = estimator.step(now_s, local(now_s, (0.0, 0.0, -0.8)), attitude(now_s), None, ())
    expected = math.hypot(0.02 * math.sqrt(100.0), state.position_sigma_m)
    assert state.health.room_sigma_m == pytest.approx(expected, abs=1e-4)
    assert state.position_sigma_m < 0.02


def test_a_filter_that_has_diverged_begins_anew_and_says_so() -> None:
    """Here its configuration makes it: a position that is good for nothing."""
    estimator = fusion(EstimationConfig(local_position_sigma_m=2000.0))
    here = (1.0, 2.0, -0.8)
    estimator.step(0.0, local(0.0, here), attitude(0.0), fix(0.0, here), ())
    there = (1.5, 2.0, -0.8)
    state = estimator.step(0.05, local(0.05, there), attitude(0.05), None, ())
    assert not state.ok
    assert state.position_ned_m == there
    assert state.health.restarts == 1
    assert state.health.gnss_bias_ne_m is None
    why = "the position filter began anew: its position is uncertain to 1414 m"
    assert [event.why for event in state.news] == [why]


# ---------------------------------------------------------------- delays


class Flown(NamedTuple):
    """What was measured on a flight, each with the time at which it was true."""

    locals: list[LocalPosition]
    fixes: list[GnssFix]


def flown(seed: int, seconds: float = 8.0) -> Flown:
    rng = np.random.default_rng(seed)
    locals_, fixes = [], []
    for i in range(round(seconds / TICK_S)):
        t = i * TICK_S
        n, e, d, vn, ve, vd = (float(v) for v in rng.normal(0.0, 0.02, 6))
        position = (0.3 * math.sin(t) + n, 0.2 * t + e, d - 0.8)
        locals_.append(local(t, position, (0.3 * math.cos(t) + vn, 0.2 + ve, vd)))
        if i % 8 == 3:
            gn, ge = (float(v) for v in rng.normal(0.0, 1.0, 2))
            fixes.append(fix(t + 0.01, (position[0] + gn, position[1] + ge, -0.8), accuracy_m=1.0))
    return Flown(locals_, fixes)


def arriving(measured: Flown, gnss_delay_s: float, late: frozenset[int]) -> FusedState:
    """The last state when fixes come so late, and some local positions after their successor."""
    estimator = fusion()
    gnss = None
    waiting = list(measured.fixes)
    order = list(range(len(measured.locals)))
    for i in sorted(late):
        order[i], order[i + 1] = order[i + 1], order[i]
    end_s = measured.locals[-1].stamp_s
    for i, index in enumerate(order):
        now_s = i * TICK_S + 0.02
        if waiting and waiting[0].stamp_s + gnss_delay_s <= now_s:
            gnss = waiting.pop(0)
        state = estimator.step(now_s, measured.locals[index], attitude(now_s), gnss, ())
    for each in waiting:
        state = estimator.step(end_s + 0.02, None, attitude(end_s), each, ())
    return state


@settings(deadline=None, max_examples=25)
@given(
    st.integers(0, 10_000),
    st.floats(0.0, 0.6),
    st.frozensets(st.integers(2, 78).map(lambda i: 2 * i), max_size=6),
)
def test_the_order_of_arrival_changes_nothing(
    seed: int, gnss_delay_s: float, late: frozenset[int]
) -> None:
    measured = flown(seed)
    prompt, delayed = (
        arriving(measured, 0.0, frozenset()),
        arriving(measured, gnss_delay_s, late),
    )
    assert delayed.position_ned_m == pytest.approx(prompt.position_ned_m, abs=1e-9)
    assert delayed.velocity_ned_m_s == pytest.approx(prompt.velocity_ned_m_s, abs=1e-9)
    assert delayed.position_sigma_m == pytest.approx(prompt.position_sigma_m, rel=1e-9)
    assert delayed.health.gnss_bias_ne_m == pytest.approx(prompt.health.gnss_bias_ne_m, abs=2e-3)
    assert delayed.health.gnss.fused == prompt.health.gnss.fused == len(measured.fixes)
    assert delayed.health.late >= len(late)


# ---------------------------------------------------------------- properties


def test_same_readings_give_bit_identical_states() -> None:
    states = []
    for _ in range(2):
        rng = np.random.default_rng(3)
        estimator, run = fusion(), []
        for i in range(200):
            now_s = i * TICK_S
            n, e, d, r = (float(v) for v in rng.normal(0.0, 0.03, 4))
            run.append(
                estimator.step(
                    now_s,
                    local(now_s - 0.01, (n, e, d - 0.8), (n, e, d)),
                    attitude(now_s, n, e),
                    fix(now_s, (n, e, d)) if i % 5 == 0 else None,
                    (down(now_s, abs(0.8 + r)),),
                )
            )
        states.append(run)
    assert states[0] == states[1]


def test_noise_is_reduced_without_a_bias() -> None:
    rng = np.random.default_rng(5)
    estimator = fusion()
    errors, sigmas = [], []
    for i in range(2000):
        now_s = i * TICK_S
        truth = 0.3 * math.sin(0.4 * now_s)
        speed = 0.12 * math.cos(0.4 * now_s)
        noise = rng.normal(0.0, 1.0, 6) * [0.03, 0.03, 0.03, 0.05, 0.05, 0.05]
        n, e, d, vn, ve, vd = (float(v) for v in noise)
        reading = local(now_s, (truth + n, e, d), (speed + vn, ve, vd))
        state = estimator.step(now_s, reading, attitude(now_s), None, ())
        errors.append(state.position_ned_m[0] - truth)
        sigmas.append(state.position_sigma_m)
    tail = np.array(errors[100:])
    assert abs(tail.mean()) < 0.003
    assert tail.std() < 0.02
    assert np.mean((tail / sigmas[100:]) ** 2) < 1.3


wild = st.floats(-1e3, 1e3)
steps = st.tuples(
    st.floats(-0.2, 3.0),
    st.none() | st.tuples(st.floats(-0.5, 0.5), wild, wild, st.integers(0, 2)),
    st.none() | st.tuples(st.floats(-0.5, 0.5), st.floats(-10.0, 10.0), st.floats(-20.0, 20.0)),
    st.none() | st.tuples(st.floats(-1.0, 0.2), st.floats(-90.0, 90.0), wild),
    st.none() | st.floats(0.0, 1e3),
)


@settings(deadline=None, max_examples=100)
@given(st.lists(steps, max_size=25))
def test_whatever_is_measured_the_state_is_made_of_numbers(
    sequence: list[
        tuple[
            float,
            tuple[float, float, float, int] | None,
            tuple[float, float, float] | None,
            tuple[float, float, float] | None,
            float | None,
        ]
    ],
) -> None:
    estimator = fusion()
    now_s = 10.0
    for dt_s, position, tilt, geodetic, range_m in sequence:
        now_s += dt_s
        state = estimator.step(
            now_s,
            position
            and local(
                now_s + position[0],
                (100.0 * position[1], position[2], position[1]),
                (position[2], 0.0, position[1]),
                position[3],
            ),
            tilt and attitude(now_s + tilt[0], tilt[2], tilt[1], tilt[1], 0.0),
            geodetic
            and GnssFix(
                now_s + geodetic[0], FixType.FIX_3D, geodetic[1], 0.0, geodetic[2], 1.0, 1.0, 8
            ),
            () if range_m is None else (down(now_s, range_m),),
        )
        numbers = (
            state.stamp_s,
            *state.position_ned_m,
            *state.velocity_ned_m_s,
            *state.frame_shift_ned_m,
            state.yaw_rad,
            state.position_sigma_m,
            state.height_agl_m or 0.0,
        )
        assert all(map(math.isfinite, numbers))
        assert state.position_sigma_m > 0.0
        assert state.ok == (state.why_not_ok == "")
