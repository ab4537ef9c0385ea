"""Sharp sensors through an ADS1115: curve, noise, supply, and the branch below the minimum."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from hal.clock import SimClock
from hal.config import BeamMount, PowerCurve, SharpIrConfig, TableCurve
from hal.ranging.adc_ir import FOLD_MAX_M, LIMITS_M, REFRESH_S, SharpIr, curve_of, range_and_slope
from hal.ranging.ads1115 import Ads1115
from hal.ranging.i2c_bus import NotAcknowledged
from hal.ranging.ranger import ChipReset, ChipSilent, Limits
from hal.readings import RangeReading, RangeStatus
from tests.support.fake_adc import FakeAds1115, FakeSharp
from tests.support.fake_i2c import FakeBus

CURVE = {"kind": "power", "scale_m": 0.25, "offset_m": 0.009}
CHIPS = ("gp2y0a21", "gp2y0a02")


def config(chip: str = "gp2y0a21", **more: Any) -> SharpIrConfig:
    return SharpIrConfig.model_validate({"chip": chip, "beam": "front", **more})


class Bench:
    """One sensor on input 2 of a converter."""

    def __init__(self, volts: Callable[[float], float], **more: Any) -> None:
        self.clock = SimClock(10.0)
        self.fake = FakeAds1115(self.clock)
        self.fake.inputs[2] = volts
        self.clock.advance(0.002)
        self.bus = FakeBus()
        self.bus.devices.append(self.fake)
        settings_ = config(**{"curve": CURVE, "input": 2, **more})
        self.sensor = SharpIr(Ads1115(self.bus, 0x48, self.clock.advance), settings_)
        for pause_s in self.sensor.begin():
            self.clock.advance(pause_s)

    def reading(self) -> RangeReading:
        measured = self.sensor.poll()
        limits = Limits(self.sensor.min_m, self.sensor.max_m)
        return measured.reading(self.clock.now_s(), BeamMount(name="front"), limits)

    def readings(self, seconds: float) -> list[RangeReading]:
        taken = []
        end_s = self.clock.now_s() + seconds
        while self.clock.now_s() < end_s:
            before_s = self.clock.now_s()
            taken.append(self.reading())
            self.clock.advance(REFRESH_S - (self.clock.now_s() - before_s))
        return taken


@pytest.mark.parametrize("range_m", [0.12, 0.2, 0.35, 0.5, 0.79])
def test_it_measures_what_is_there(range_m: float) -> None:
    reading = Bench(FakeSharp(lambda _s: range_m)).reading()
    assert reading.status is RangeStatus.VALID
    assert reading.range_m == pytest.approx(range_m, rel=2e-3)


def test_noise_grows_with_the_curves_slope() -> None:
    near, far = (
        math.sqrt(Bench(FakeSharp(lambda _s, r=r: r)).reading().variance_m2)  # type: ignore[misc]  # a default binds the loop's value
        for r in (0.2, 0.7)
    )
    # d range / d volt = -(range + offset)^2 / scale, times 20 mV.
    assert near == pytest.approx(math.hypot(0.02 * 0.209**2 / 0.25, 0.003), rel=0.01)
    assert far == pytest.approx(math.hypot(0.02 * 0.709**2 / 0.25, 0.003), rel=0.01)


def test_the_told_variance_is_that_of_noisy_readings() -> None:
    rng = np.random.default_rng(3)
    sharp = FakeSharp(lambda _s: 0.45)
    bench = Bench(lambda now_s: sharp(now_s) + float(rng.normal(0.0, 0.02)))
    readings = bench.readings(40.0)
    spread = float(np.std([reading.range_m for reading in readings]))
    assert spread == pytest.approx(math.sqrt(readings[0].variance_m2), rel=0.15)


def test_a_sensor_without_supply_is_not_a_free_view() -> None:
    assert Bench(lambda _s: 0.0).reading().status is RangeStatus.NO_SIGNAL
    assert Bench(lambda _s: -0.2).reading().status is RangeStatus.NO_SIGNAL
    assert Bench(lambda _s: 0.15).reading().status is RangeStatus.OUT_OF_RANGE


def test_saturation_is_too_near() -> None:
    reading = Bench(lambda _s: 5.0).reading()
    assert (reading.status, reading.range_m) == (RangeStatus.TOO_NEAR, 0.10)


@pytest.mark.parametrize("speed_m_s", [0.05, 0.1, 0.2, 0.5, 0.9])
def test_an_object_that_comes_through_the_minimum_never_seems_far(speed_m_s: float) -> None:
    start_m = 0.6

    def range_m(now_s: float) -> float:
        return max(start_m - speed_m_s * (now_s - 10.0), 0.0)

    bench = Bench(FakeSharp(range_m))
    readings = bench.readings(start_m / speed_m_s + 2.0)
    for reading in readings:
        true_m = range_m(reading.stamp_s)
        if reading.status is RangeStatus.VALID:
            assert reading.range_m < true_m + speed_m_s * REFRESH_S + 0.01
        else:
            assert reading.status is RangeStatus.TOO_NEAR
            assert true_m < 0.10 + 2 * speed_m_s * REFRESH_S
    assert readings[-1].status is RangeStatus.TOO_NEAR


def test_without_the_rule_it_would_seem_far() -> None:
    """The object touches the lens and the bare curve says a third of a metre: that is the trap."""
    sharp = FakeSharp(lambda _s: 0.0)
    bare_m, _ = range_and_slope(curve_of(config(curve=CURVE)), sharp.volts(0.0))
    assert 0.25 < bare_m < FOLD_MAX_M["gp2y0a21"]


def test_a_leap_over_the_top_between_two_readings_is_noticed() -> None:
    """0.15 m, then at once 0.01 m: the top of the curve is never sampled."""
    seen = {"range_m": 0.25}
    bench = Bench(FakeSharp(lambda _s: seen["range_m"]), noise_v=0.005)
    for step_m in range(10):
        seen["range_m"] = 0.25 - 0.01 * step_m
        bench.readings(REFRESH_S)
    seen["range_m"] = 0.01
    late = bench.readings(1.0)[2:]
    assert {reading.status for reading in late} == {RangeStatus.TOO_NEAR}


def test_doubt_ends_when_the_object_is_out_of_the_branchs_reach() -> None:
    def range_m(now_s: float) -> float:
        return abs(0.5 - 0.5 * (now_s - 10.0)) + 0.02

    statuses = [reading.status for reading in Bench(FakeSharp(range_m)).readings(2.2)]
    assert statuses.count(RangeStatus.SUSPECT) == 2
    at = statuses.index(RangeStatus.SUSPECT)
    assert RangeStatus.TOO_NEAR in statuses[:at]
    assert set(statuses[at + 2 :]) == {RangeStatus.VALID}


def test_an_object_that_goes_away_quickly_is_believed() -> None:
    def range_m(now_s: float) -> float:
        return 0.3 if now_s < 10.5 else 0.7

    statuses = {reading.status for reading in Bench(FakeSharp(range_m)).readings(2.0)}
    assert statuses == {RangeStatus.VALID}


@pytest.mark.parametrize("chip", CHIPS)
def test_the_typical_curves_meet_the_data_sheets(chip: str) -> None:
    """0.4 V at the far end; 1.9 and 2.05 V more at the near end."""
    near_m, far_m = LIMITS_M[chip]
    curve = curve_of(config(chip))
    rise_v = {"gp2y0a21": 1.9, "gp2y0a02": 2.05}[chip]
    assert range_and_slope(curve, 0.4)[0] == pytest.approx(far_m)
    assert range_and_slope(curve, 0.4 + rise_v)[0] == pytest.approx(near_m, rel=0.01)


CURVES = st.one_of(
    st.builds(
        lambda s, e, o: PowerCurve(kind="power", scale_m=s, exponent=e, offset_m=o),
        st.floats(0.1, 0.7),
        st.floats(0.8, 1.4),
        st.floats(0.0, 0.02),
    ),
    st.sampled_from(CHIPS).map(lambda chip: curve_of(config(chip))),
)


@settings(deadline=None)
@given(CURVES, st.floats(0.2, 3.0), st.floats(0.001, 0.3))
def test_more_volts_are_nearer_and_the_slope_is_the_derivative(
    curve: PowerCurve | TableCurve, volts: float, more: float
) -> None:
    range_m, slope = range_and_slope(curve, volts)
    assert range_and_slope(curve, volts + more)[0] < range_m
    assert slope < 0.0
    step = 1e-6
    ahead, behind = (range_and_slope(curve, volts + s)[0] for s in (step, -step))
    knots = [v for _, v in curve.points] if isinstance(curve, TableCurve) else []
    if all(abs(volts - knot) > 2 * step for knot in knots):
        assert slope == pytest.approx((ahead - behind) / (2 * step), rel=1e-3)


def test_a_table_passes_through_its_points() -> None:
    points = ((0.1, 2.3), (0.3, 0.9), (0.8, 0.4))
    table = TableCurve(kind="table", points=points)
    for range_m, volts in points:
        assert range_and_slope(table, volts)[0] == pytest.approx(range_m)


def test_a_table_that_does_not_fall_is_refused() -> None:
    with pytest.raises(ValidationError, match="ranges rise, volts fall"):
        TableCurve(kind="table", points=((0.1, 1.0), (0.3, 1.2)))
    with pytest.raises(ValidationError, match="ranges rise, volts fall"):
        TableCurve(kind="table", points=((0.3, 1.0), (0.1, 0.5)))


@pytest.mark.parametrize("volts", [0.4, 1.0, 2.3, 3.9])
def test_the_converter_is_exact_to_a_step(volts: float) -> None:
    bench = Bench(lambda _s: volts)
    converter = Ads1115(bench.bus, 0x48, bench.clock.advance)
    assert converter.steps(2) * 4.096 / 32768 == pytest.approx(volts, abs=2e-4)


def test_a_converter_that_lost_its_supply_in_between_is_noticed() -> None:
    bench = Bench(lambda _s: 1.0)

    def dip(seconds: float) -> None:
        bench.clock.advance(seconds)
        bench.fake.restart()
        bench.fake.address = 0x48
        bench.clock.advance(0.002)

    with pytest.raises(ChipReset):
        Ads1115(bench.bus, 0x48, dip).steps(2)
    assert bench.reading().status is RangeStatus.VALID


def test_a_converter_that_does_not_finish_or_answer_is_told() -> None:
    bench = Bench(lambda _s: 1.0)
    bench.fake.stalled = True
    with pytest.raises(ChipSilent):
        bench.reading()
    bench.bus.dead = True
    with pytest.raises(NotAcknowledged):
        bench.sensor.check()
