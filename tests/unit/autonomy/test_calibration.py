"""Offset and noise from readings at a known distance; what is no calibration is refused."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from autonomy.calibration import Calibration, as_yaml, calibrate, calibrated, described
from autonomy.config import Config, load_config
from autonomy.errors import BadInput
from hal.config import BeamsConfig
from hal.readings import RangeReading, RangeStatus

BEAMS = BeamsConfig()


def readings(
    ranges: list[float], status: RangeStatus = RangeStatus.VALID, beam: str = "left"
) -> list[RangeReading]:
    return [RangeReading(k / 25.0, beam, status, r, 1e-4, 0.02, 1.0) for k, r in enumerate(ranges)]


def noisy(middle_m: float, sigma_m: float, seed: int = 1, count: int = 125) -> list[float]:
    return list(np.random.default_rng(seed).normal(middle_m, sigma_m, count).clip(0.0))


@settings(deadline=None, max_examples=30)
@given(st.floats(-0.1, 0.1), st.floats(0.002, 0.02), st.integers(0, 1000))
def test_offset_and_noise_are_found(offset_m: float, sigma_m: float, seed: int) -> None:
    result = calibrate(BEAMS, "left", 0.5, readings(noisy(0.5 + offset_m, sigma_m, seed)))
    assert result.offset_m == pytest.approx(offset_m, abs=0.6 * sigma_m + 1e-4)
    assert result.sigma_m == pytest.approx(sigma_m, rel=0.45)
    assert result.rate_hz == pytest.approx(25.0)


def test_single_leaps_do_not_count() -> None:
    ranges = noisy(0.512, 0.004)
    for at in (10, 40, 41, 77, 100):
        ranges[at] = 0.95
    result = calibrate(BEAMS, "left", 0.5, readings(ranges))
    assert result.offset_m == pytest.approx(0.012, abs=0.002)
    assert result.sigma_m < 0.006


def test_a_second_calibration_adds_to_the_first() -> None:
    first = calibrate(BEAMS, "left", 0.5, readings(noisy(0.53, 0.004)))
    after = calibrated(BEAMS, first)
    second = calibrate(after, "left", 0.5, readings(noisy(0.53 - first.offset_m, 0.004)))
    assert second.bias_m == pytest.approx(0.0, abs=1e-4)
    assert second.offset_m == pytest.approx(first.offset_m, abs=1e-3)


def test_a_perfect_sensor_is_not_told_to_be_perfect() -> None:
    assert calibrate(BEAMS, "left", 0.5, readings([0.5] * 50)).sigma_m == 0.001


@pytest.mark.parametrize(
    ("given_", "words"),
    [
        ([], "0 of 0 readings"),
        (readings([0.5] * 19), "19 of 19"),
        (readings([1.0] * 60, RangeStatus.OUT_OF_RANGE), "it told out_of_range"),
        (readings([0.5] * 40) + readings([0.0] * 20, RangeStatus.NO_SIGNAL), "no_signal, valid"),
        (readings([0.5] * 60, beam="right"), "0 of 0"),
        (readings([0.7] * 60), "reads 0.700 m, not 0.500 m"),
        (readings([0.3] * 60), "reads 0.300 m, not 0.500 m"),
        (readings(noisy(0.5, 0.09)), "scatters"),
        (readings(list(np.linspace(0.49, 0.53, 100))), r"moved by \+2.0 cm"),
    ],
)
def test_what_is_no_calibration_is_refused(given_: list[RangeReading], words: str) -> None:
    with pytest.raises(BadInput, match=words):
        calibrate(BEAMS, "left", 0.5, given_)


def test_the_document_is_a_configuration_and_changes_only_that_beam(tmp_path: Path) -> None:
    result = calibrate(BEAMS, "left", 0.5, readings(noisy(0.52, 0.004)))
    path = tmp_path / "beams.yaml"
    path.write_text(as_yaml(BEAMS, result), encoding="utf-8")
    loaded = load_config(path)
    assert loaded.beams == calibrated(BEAMS, result)
    assert loaded.beams.mount("left").offset_m == result.offset_m
    others = [mount for mount in loaded.beams.mounts if mount.name != "left"]
    assert others == [mount for mount in Config().beams.mounts if mount.name != "left"]


def test_the_result_is_a_line() -> None:
    line = described(Calibration("left", 0.5, 0.02, 0.004, 0.02, 120, 3, 25.0))
    assert line == (
        "beam left at 0.5 m: reads +20.0 mm, noise 4.0 mm, 120 readings at 25.0 Hz, "
        "3 without a distance"
    )
