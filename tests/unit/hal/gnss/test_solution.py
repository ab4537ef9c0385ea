"""What is believed of a receiver, and what is refused."""

import math
from typing import Any

import pytest

from hal.gnss.solution import CLOCK_INSISTS_AFTER, Judge, Solution
from hal.readings import FixType, GnssFix
from tests.support.gnss import AMSL_M, LATITUDE_DEG, LONGITUDE_DEG

LATENCY_S = 0.1
DAY_S = 86_400.0
LOST = FixType.NO_FIX


def judge(confirm_fixes: int = 1, frozen_after_s: float = 5.0) -> Judge:
    return Judge(LATENCY_S, frozen_after_s, confirm_fixes)


def claim(step: int, **changes: Any) -> Solution:
    """The `step`th solution at 1 Hz, received punctually."""
    fields: dict[str, Any] = {
        "received_s": 100.0 + step,
        "epoch_s": 36_000.0 + step,
        "period_s": DAY_S,
        "fix_type": FixType.FIX_3D,
        "latitude_deg": LATITUDE_DEG + step * 1e-7,
        "longitude_deg": LONGITUDE_DEG,
        "amsl_m": AMSL_M,
        "horizontal_accuracy_m": 0.9,
        "vertical_accuracy_m": 1.8,
        "satellites": 12,
    } | changes
    return Solution(**fields)


def told(judging: Judge, solution: Solution) -> GnssFix:
    fix = judging.take(solution)
    assert fix is not None
    return fix


def test_a_fix_bears_what_was_claimed_and_when_it_was_true() -> None:
    fix = told(judge(), claim(0))
    assert fix == GnssFix(99.9, FixType.FIX_3D, LATITUDE_DEG, LONGITUDE_DEG, AMSL_M, 0.9, 1.8, 12)


@pytest.mark.parametrize(
    "changes",
    [
        {"latitude_deg": 91.0},
        {"latitude_deg": -90.1},
        {"longitude_deg": 180.5},
        {"latitude_deg": math.nan},
        {"longitude_deg": math.inf},
        {"latitude_deg": 0.0, "longitude_deg": 0.0},
        {"amsl_m": 10_001.0},
        {"amsl_m": -1_001.0},
        {"amsl_m": math.nan},
        {"horizontal_accuracy_m": 0.0},
        {"horizontal_accuracy_m": 1_001.0},
        {"vertical_accuracy_m": -1.0},
        {"vertical_accuracy_m": 1_001.0},
        {"vertical_accuracy_m": math.nan},
    ],
)
@pytest.mark.parametrize("fix_type", [FixType.FIX_3D, FixType.FIX_2D])
def test_the_absurd_is_refused_and_counted(changes: dict[str, float], fix_type: FixType) -> None:
    judging = judge()
    assert judging.take(claim(0, fix_type=fix_type, **changes)) is None
    assert (judging.absurd, judging.told) == (1, 0)
    assert judging.take(claim(1)) is not None


@pytest.mark.parametrize(
    "changes",
    [
        {"latitude_deg": 90.0},
        {"latitude_deg": 0.0},
        {"longitude_deg": -180.0},
        {"amsl_m": 10_000.0},
        {"amsl_m": -1_000.0},
        {"horizontal_accuracy_m": 1_000.0},
    ],
)
def test_the_ends_of_the_earth_are_on_it(changes: dict[str, float]) -> None:
    assert judge().take(claim(0, **changes)) is not None


# ---------------------------------------------------------------- the type of fix


def test_a_loss_is_told_at_once_without_a_place_and_counted() -> None:
    judging = judge(confirm_fixes=3)
    told(judging, claim(0))
    fix = told(judging, claim(1, fix_type=LOST, latitude_deg=math.nan, satellites=0))
    assert fix.fix_type is LOST
    assert (fix.latitude_deg, fix.horizontal_accuracy_m) == (0.0, 1e4)
    assert fix.stamp_s == pytest.approx(100.9)
    told(judging, claim(2, fix_type=LOST))
    assert judging.losses == 1


def test_a_fix_that_comes_back_must_hold_before_it_is_told() -> None:
    judging = judge(confirm_fixes=3)
    told(judging, claim(0, fix_type=LOST))
    types = [told(judging, claim(step)).fix_type for step in (1, 2, 3)]
    assert types == [LOST, LOST, FixType.FIX_3D]
    assert judging.leaps == 2


def test_a_leap_to_a_better_type_is_told_with_the_worse_accuracy_until_it_holds() -> None:
    judging = judge(confirm_fixes=3)
    told(judging, claim(0))
    fixed = {
        "fix_type": FixType.RTK_FIXED,
        "horizontal_accuracy_m": 0.01,
        "vertical_accuracy_m": 0.02,
    }
    fixes = [told(judging, claim(step, **fixed)) for step in (1, 2, 3)]
    assert [fix.fix_type for fix in fixes] == [FixType.FIX_3D, FixType.FIX_3D, FixType.RTK_FIXED]
    assert [fix.horizontal_accuracy_m for fix in fixes] == [0.9, 0.9, 0.01]
    assert [fix.vertical_accuracy_m for fix in fixes] == [1.8, 1.8, 0.02]
    assert fixes[0].latitude_deg == claim(1).latitude_deg
    assert judging.leaps == 2


def test_a_fall_to_a_worse_type_is_told_at_once() -> None:
    judging = judge(confirm_fixes=3)
    told(judging, claim(0, fix_type=FixType.RTK_FIXED, horizontal_accuracy_m=0.01))
    fix = told(judging, claim(1))
    assert (fix.fix_type, fix.horizontal_accuracy_m) == (FixType.FIX_3D, 0.9)
    assert judging.leaps == 0


def test_two_dimensions_are_told_and_are_no_position() -> None:
    fix = told(judge(), claim(0, fix_type=FixType.FIX_2D))
    assert fix.latitude_deg == LATITUDE_DEG
    assert not fix.fix_type.has_position


def test_a_receiver_that_was_away_starts_anew() -> None:
    judging = judge(confirm_fixes=3)
    told(judging, claim(0, fix_type=LOST))
    judging.restart()
    assert told(judging, claim(1, epoch_s=5.0)).fix_type is FixType.FIX_3D


# ---------------------------------------------------------------- time


@pytest.mark.parametrize("epoch_s", [36_003.0, 36_002.0, 36_000.0, 86_000.0, None])
def test_time_that_stands_still_or_goes_back_is_refused(epoch_s: float | None) -> None:
    judging = judge()
    for step in range(4):
        told(judging, claim(step))
    assert judging.take(claim(4, epoch_s=epoch_s)) is None
    assert judging.untimely == 1
    told(judging, claim(5))


def test_midnight_is_not_the_past() -> None:
    judging = judge()
    told(judging, claim(0, epoch_s=DAY_S - 0.5))
    fix = told(judging, claim(1, epoch_s=0.5))
    assert fix.stamp_s == pytest.approx(100.9)


def test_a_clock_that_insists_is_the_new_one() -> None:
    judging = judge()
    told(judging, claim(0))
    fixes = [judging.take(claim(step, epoch_s=30_000.0 + step)) for step in range(1, 9)]
    assert [fix is not None for fix in fixes] == CLOCK_INSISTS_AFTER * [False] + 3 * [True]
    stamps = [fix.stamp_s for fix in fixes if fix is not None]
    assert stamps == pytest.approx([105.9, 106.9, 107.9])


def test_a_clock_that_stands_still_never_insists() -> None:
    judging = judge()
    for step in range(50):
        fix = judging.take(claim(step, epoch_s=36_000.0))
        assert (fix is None) is (step > 0)


def test_a_clock_that_errs_now_and_then_never_insists() -> None:
    judging = judge()
    for step in range(0, 40, 2):
        told(judging, claim(step))
        assert judging.take(claim(step + 1, epoch_s=30_000.0 + step)) is None


def test_a_backlog_is_not_told_as_new() -> None:
    judging = judge()
    for step in range(5):
        told(judging, claim(step))
    # The process stood still; the line's buffer held four solutions.
    stamps = [told(judging, claim(step, received_s=109.5)).stamp_s for step in (5, 6, 7, 8)]
    assert stamps == pytest.approx([104.9, 105.9, 106.9, 107.9], abs=0.02)


def test_a_drifting_clock_is_followed() -> None:
    judging = judge()
    for step in range(2_000):
        fix = told(judging, claim(step, epoch_s=36_000.0 + step * (1.0 - 1e-4)))
        assert 100.0 + step - LATENCY_S - fix.stamp_s < 1e-9


def test_stamps_always_increase() -> None:
    judging = judge()
    told(judging, claim(0))
    assert judging.take(claim(1, received_s=100.0)) is None
    assert judging.take(claim(2, received_s=99.0, fix_type=LOST)) is None
    assert judging.untimely == 2


# ---------------------------------------------------------------- place


def test_a_place_that_never_moves_is_not_believed_until_it_moves() -> None:
    judging = judge(frozen_after_s=3.0)
    fixes = [judging.take(claim(step, latitude_deg=LATITUDE_DEG)) for step in range(6)]
    assert [fix is not None for fix in fixes] == [True, True, True, False, False, False]
    assert judging.frozen == 3
    told(judging, claim(6, latitude_deg=LATITUDE_DEG, amsl_m=AMSL_M + 0.001))


def test_half_a_day_in_one_place_is_still() -> None:
    judging = judge(frozen_after_s=3.0)
    steps = range(0, 90_000, 3_000)
    fixes = [judging.take(claim(step, latitude_deg=LATITUDE_DEG)) for step in steps]
    assert [fix is not None for fix in fixes] == [True] + 29 * [False]


def test_a_place_that_was_left_and_met_again_is_not_frozen() -> None:
    judging = judge(frozen_after_s=3.0)
    for step in range(20):
        told(judging, claim(step, latitude_deg=LATITUDE_DEG + (step % 2) * 1e-7))
    assert judging.frozen == 0


def test_a_place_found_again_after_a_loss_is_not_frozen() -> None:
    judging = judge(frozen_after_s=3.0)
    told(judging, claim(0, latitude_deg=LATITUDE_DEG))
    for step in range(1, 8):
        told(judging, claim(step, fix_type=LOST))
    assert told(judging, claim(8, latitude_deg=LATITUDE_DEG)).fix_type is FixType.FIX_3D
