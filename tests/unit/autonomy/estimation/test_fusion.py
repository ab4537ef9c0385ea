import math

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from autonomy.config import EstimationConfig
from autonomy.estimation.fusion import ORIGIN_FIXES, TERRAIN_STEP_READINGS, Fusion
from autonomy.model import FusedState
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


def test_an_older_reading_that_arrives_late_is_ignored() -> None:
    estimator = fusion()
    now_s = settle(estimator)
    before = estimator.step(now_s, local(now_s), attitude(now_s), None, ())
    after = estimator.step(now_s, local(now_s - 0.5, (9.0, 9.0, 9.0)), attitude(now_s), None, ())
    assert after.position_ned_m == before.position_ned_m


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


def test_the_origin_of_gnss_is_learned_and_its_jump_is_rejected() -> None:
    estimator = fusion()
    here = (2.0, 1.0, -0.8)
    now_s = settle(estimator, 4.0, here)
    for _ in range(5):
        state = estimator.step(
            now_s,
            local(now_s, here),
            attitude(now_s),
            fix(now_s, add(here, (30.0, 0.0, 0.0))),
            (),
        )
        assert state.ok
        assert state.position_ned_m == pytest.approx(here, abs=1e-6)
        now_s += TICK_S


def test_gnss_steadies_the_position_by_its_floor_and_no_more() -> None:
    here = (0.0, 0.0, -0.8)
    with_gnss, without = fusion(), fusion()
    for estimator in (with_gnss, without):
        now_s = settle(estimator, 4.0, here)
    beside = fix(now_s, (0.5, 0.0, -0.8), FixType.RTK_FIXED, accuracy_m=0.01)
    reading = local(now_s, here)
    a = with_gnss.step(now_s, reading, attitude(now_s), beside, ())
    b = without.step(now_s, reading, attitude(now_s), None, ())
    moved_m = a.position_ned_m[0] - b.position_ned_m[0]
    assert 0.0 < moved_m < 0.5 * b.position_sigma_m**2 / CONFIG.gnss_sigma_floor_m**2
    assert a.position_sigma_m < b.position_sigma_m


def test_a_late_fix_is_moved_along_with_the_vehicle() -> None:
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
        states.append(state.position_ned_m[0])
    assert states[0] == pytest.approx(0.5 * now_s, abs=1e-5)
    assert states[1] == pytest.approx(states[0], abs=1e-5)


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


def test_a_fix_is_believed_by_the_worse_of_its_accuracies() -> None:
    moved = []
    for accuracy_m in (0.5, 3.0):
        estimator = fusion()
        now_s = settle(estimator, 4.0)
        beside = msgspec.structs.replace(
            fix(now_s, (0.5, 0.0, -0.8)), vertical_accuracy_m=accuracy_m
        )
        reading = local(now_s, (0.0, 0.0, -0.8))
        moved.append(estimator.step(now_s, reading, attitude(now_s), beside, ()).position_ned_m[0])
    assert 0.0 < moved[1] < 0.05 * moved[0]


def test_a_fix_that_comes_too_late_is_ignored() -> None:
    one, other = fusion(), fusion()
    for estimator in (one, other):
        now_s = settle(estimator, 4.0) + 1.5
        estimator.step(now_s, local(now_s, (0.0, 0.0, -0.8)), attitude(now_s), None, ())
    level, late = attitude(now_s), fix(now_s - 1.1, (0.3, 0.0, -0.8))
    assert one.step(now_s, None, level, late, ()) == other.step(now_s, None, level, None, ())


def test_gnss_is_placed_anew_only_when_the_rejections_are_in_a_row() -> None:
    estimator = fusion()
    here = (0.0, 0.0, -0.8)
    now_s = settle(estimator, 4.0, here)
    for i in range(6 * CONFIG.reset_after_rejections):
        ned = here if i % 3 == 0 else add(here, (40.0, 0.0, 0.0))
        estimator.step(now_s, local(now_s, here), attitude(now_s), fix(now_s, ned), ())
        now_s += TICK_S
    nudge = fix(now_s, add(here, (0.5, 0.0, 0.0)))
    state = estimator.step(now_s, local(now_s, here), attitude(now_s), nudge, ())
    assert state.position_ned_m[0] > 1e-6


@pytest.mark.parametrize("kind", [FixType.NO_GPS, FixType.NO_FIX, FixType.FIX_2D])
def test_a_fix_without_position_is_ignored(kind: FixType) -> None:
    one, other = fusion(), fusion()
    for estimator in (one, other):
        now_s = settle(estimator, 4.0)
    reading, level = local(now_s, (0.0, 0.0, -0.8)), attitude(now_s)
    bad = fix(now_s, (0.3, 0.0, -0.8), kind)
    assert one.step(now_s, reading, level, bad, ()) == other.step(now_s, reading, level, None, ())


def test_gnss_that_contradicts_for_long_is_placed_anew_and_never_moves_the_vehicle() -> None:
    estimator = fusion()
    here = (0.0, 0.0, -0.8)
    now_s = settle(estimator, 4.0, here)
    elsewhere = add(here, (40.0, -10.0, 3.0))
    for _ in range(CONFIG.reset_after_rejections + ORIGIN_FIXES + 20):
        state = estimator.step(
            now_s, local(now_s, here), attitude(now_s), fix(now_s, elsewhere), ()
        )
        assert state.position_ned_m == pytest.approx(here, abs=1e-6)
        now_s += TICK_S
    # Placed anew: a fix half a metre beside the new place is believed a little again.
    nudged = estimator.step(
        now_s,
        local(now_s, here),
        attitude(now_s),
        fix(now_s, add(elsewhere, (0.5, 0.0, 0.0))),
        (),
    )
    assert nudged.position_ned_m[0] > 1e-6


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
    for _ in range(TERRAIN_STEP_READINGS + 2):
        state = estimator.step(
            now_s, local(now_s, here), attitude(now_s), None, (down(now_s, 0.3),)
        )
        assert state.position_ned_m == pytest.approx(here, abs=1e-6)
        heights.append(state.height_agl_m)
        now_s += TICK_S
    assert heights[: TERRAIN_STEP_READINGS - 1] == pytest.approx([0.8, 0.8], abs=1e-6)
    assert heights[TERRAIN_STEP_READINGS - 1 :] == pytest.approx([0.3, 0.3, 0.3], abs=1e-6)


def test_a_height_counts_once() -> None:
    estimator = fusion()
    here = (0.0, 0.0, -0.8)
    now_s = settle(estimator, position=here)
    wrong = down(now_s, 0.3)
    for _ in range(2 * TERRAIN_STEP_READINGS):
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


wild = st.floats(-1e6, 1e6)
steps = st.tuples(
    st.floats(-0.2, 3.0),
    st.none() | st.tuples(st.floats(-0.5, 0.5), wild, wild, st.integers(0, 2)),
    st.none() | st.tuples(st.floats(-0.5, 0.5), st.floats(-10.0, 10.0), wild),
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
                (position[1], position[2], position[1]),
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
