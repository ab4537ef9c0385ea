"""The VL53L0X against a chip that obeys the data sheet, register by register."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hal.clock import SimClock
from hal.config import BeamMount, Vl53l0xConfig
from hal.ranging.i2c_bus import I2cError, NotAcknowledged
from hal.ranging.ranger import ChipReset, ChipSilent, Limits, WrongChip
from hal.ranging.vl53l0x import Vl53l0x, chosen_spads, encoded_timeout, final_macros, sigma_m
from hal.readings import RangeReading, RangeStatus
from tests.support.fake_i2c import FakeBus
from tests.support.fake_tof import FakeVl53l0x, Target, still

MOUNT, LIMITS = BeamMount(name="front"), Limits(0.03, 1.0)


class Chip:
    """One chip alone on its bus, started."""

    def __init__(self, target: Target | None = None, **config: float) -> None:
        self.clock = SimClock(50.0)
        self.fake = FakeVl53l0x(self.clock, lambda _now_s: target or Target(0.5))
        self.clock.advance(0.002)
        self.bus = FakeBus()
        self.bus.devices.append(self.fake)
        settings_ = {"chip": "vl53l0x", "beam": "front", **config}
        self.ranger = Vl53l0x(self.bus, Vl53l0xConfig.model_validate(settings_))

    def start(self) -> "Chip":
        for pause_s in self.ranger.begin():
            self.clock.advance(pause_s)
        return self

    def reading(self) -> RangeReading:
        for _ in range(1000):
            measured = self.ranger.poll()
            if measured is not None:
                return measured.reading(self.clock.now_s(), MOUNT, LIMITS)
            self.clock.advance(0.001)
        raise AssertionError("it measures nothing")


def test_it_measures_what_is_there() -> None:
    chip = Chip(Target(0.437)).start()
    reading = chip.reading()
    assert reading.status is RangeStatus.VALID
    assert reading.range_m == pytest.approx(0.437)
    assert chip.clock.now_s() - reading.stamp_s == pytest.approx(0.0165)
    assert 0.002 < math.sqrt(reading.variance_m2) < 0.01


@settings(deadline=None, max_examples=25)
@given(st.floats(0.02, 0.2))
def test_the_timing_budget_is_what_the_chip_takes(budget_s: float) -> None:
    chip = Chip(budget_s=budget_s).start()
    assert chip.fake.period_s() <= budget_s * 1.001
    assert chip.fake.period_s() == pytest.approx(budget_s, rel=0.015)


def test_a_result_is_told_once_and_the_next_one_follows() -> None:
    chip = Chip().start()
    chip.reading()
    assert chip.ranger.poll() is None
    before = chip.fake.measured
    chip.reading()
    assert chip.fake.measured == before + 1


def test_it_sets_limits_reference_diodes_and_voltage() -> None:
    chip = Chip(signal_min_mcps=0.5).start()
    zero = chip.fake.pages[0]
    assert int.from_bytes(zero[0x44:0x46], "big") == 64
    assert chip.fake.spads_on() == 5
    assert zero[0x89] & 0x01
    assert chip.fake.calibrated == {0x01, 0x02}
    assert chip.fake.page == 0
    assert zero[0x80] == 0


@pytest.mark.parametrize(
    ("code", "status"),
    [
        (0, RangeStatus.NO_SIGNAL),
        (1, RangeStatus.NO_SIGNAL),
        (2, RangeStatus.NO_SIGNAL),
        (3, RangeStatus.NO_SIGNAL),
        (4, RangeStatus.OUT_OF_RANGE),
        (5, RangeStatus.NO_SIGNAL),
        (6, RangeStatus.SUSPECT),
        (7, RangeStatus.SUSPECT),
        (8, RangeStatus.TOO_NEAR),
        (9, RangeStatus.SUSPECT),
        (10, RangeStatus.TOO_NEAR),
        (11, RangeStatus.VALID),
        (12, RangeStatus.NO_SIGNAL),
        (13, RangeStatus.NO_SIGNAL),
        (14, RangeStatus.NO_SIGNAL),
        (15, RangeStatus.NO_SIGNAL),
    ],
)
def test_every_status_of_the_chip_is_kept(code: int, status: RangeStatus) -> None:
    chip = Chip(Target(0.5, code=code)).start()
    measured = None
    while measured is None:
        chip.clock.advance(0.002)
        measured = chip.ranger.poll()
    assert measured.status is status
    assert measured.hardware_fault == (code in (1, 2, 3))


@pytest.mark.parametrize("code", [4, 6, 9, 11])
@pytest.mark.parametrize("range_mm", [8190, 8191])
def test_8190_and_8191_are_never_distances(code: int, range_mm: int) -> None:
    clear = Chip(Target(0.5, code=code, range_mm=range_mm)).start().reading()
    assert (clear.status, clear.range_m) == (RangeStatus.OUT_OF_RANGE, 1.0)
    sunlit = Target(0.5, code=code, range_mm=range_mm, ambient_mcps=0.2)
    blind = Chip(sunlit).start().reading()
    assert (blind.status, blind.range_m) == (RangeStatus.NO_SIGNAL, 0.0)


def test_ambient_light_is_counted_per_diode() -> None:
    """16 diodes in the fake: 5 kcps each are 0.08 Mcps."""
    for ambient_mcps, status in ((0.07, RangeStatus.OUT_OF_RANGE), (0.09, RangeStatus.NO_SIGNAL)):
        chip = Chip(Target(0.5, code=4, ambient_mcps=ambient_mcps)).start()
        assert chip.reading().status is status


def test_a_target_beyond_the_phase_is_suspect_not_near() -> None:
    reading = Chip(Target(2.8, signal_at_1m_mcps=40.0)).start().reading()
    assert reading.status is RangeStatus.SUSPECT


def test_a_dark_target_far_away_is_no_target() -> None:
    assert Chip(Target(1.9, signal_at_1m_mcps=0.5)).start().reading().status is (
        RangeStatus.OUT_OF_RANGE
    )


def test_few_photons_make_a_reading_suspect() -> None:
    target = Target(0.8, signal_at_1m_mcps=0.2, ambient_mcps=1.0)
    assert Chip(target, sigma_max_m=0.01).start().reading().status is RangeStatus.SUSPECT
    assert Chip(target, sigma_max_m=0.2).start().reading().status is RangeStatus.VALID


def test_noise_falls_with_light_and_time_and_rises_with_ambient_light() -> None:
    base = sigma_m(1.0, 0.0, 700)
    assert base == pytest.approx(0.0041, abs=1e-4)
    assert sigma_m(4.0, 0.0, 700) == pytest.approx(base / 2.0)
    assert sigma_m(1.0, 0.0, 2800) == pytest.approx(base / 2.0)
    assert sigma_m(1.0, 2.0, 700) > 1.5 * base
    assert sigma_m(0.0, 1.0, 700) == math.inf


def test_another_chip_is_refused_before_anything_is_written() -> None:
    chip = Chip()
    chip.fake.model = 0xEACC
    chip.fake.reset()
    with pytest.raises(WrongChip, match="says eacc, a VL53L0X says eeaa"):
        chip.start()
    assert chip.fake.pages[0][0x89] == 0
    assert chip.fake.calibrated == set()


@pytest.mark.parametrize("after", range(0, 190, 7))
def test_a_start_that_was_broken_off_anywhere_is_made_good(after: int) -> None:
    chip = Chip()
    begun = chip.fake.clock.now_s()
    chip.bus.breaks_after = after
    try:
        chip.start()
    except I2cError:
        chip.clock.advance(0.002)
    chip.bus.breaks_after = None
    assert chip.start().reading().status is RangeStatus.VALID
    assert chip.clock.now_s() > begun


def test_an_address_is_given_at_the_power_up_address_only_to_the_right_chip() -> None:
    config = Vl53l0xConfig(chip="vl53l0x", beam="front", xshut="gpiochip0/4", address=0x31)
    chip = Chip()
    ranger = Vl53l0x(chip.bus, config)
    ranger.give_address()
    assert chip.fake.address == 0x31
    for pause_s in ranger.begin():
        chip.clock.advance(pause_s)
    assert chip.fake.address == 0x31
    assert chip.fake.resets == 0
    with pytest.raises(NotAcknowledged):
        chip.ranger.identify()


def test_a_lost_setting_is_recognised() -> None:
    chip = Chip().start()
    chip.ranger.check()
    chip.fake.restart()
    chip.clock.advance(0.002)
    with pytest.raises(ChipReset):
        chip.ranger.check()


def test_a_chip_that_never_boots_is_told_in_words() -> None:
    chip = Chip()
    chip.fake.memory_fails = True
    with pytest.raises(ChipSilent, match=r"within 0\.5 s"):
        chip.start()


def test_ending_stops_it() -> None:
    chip = Chip().start()
    chip.reading()
    chip.ranger.end()
    chip.clock.advance(0.1)
    before = chip.fake.measured
    chip.clock.advance(0.5)
    chip.fake.run()
    assert chip.fake.measured == before


@settings(deadline=None, max_examples=200)
@given(st.binary(min_size=12, max_size=12))
def test_whatever_the_registers_say_it_is_a_reading(block: bytes) -> None:
    ranger = Chip().ranger
    reading = ranger._measured(block).reading(1.0, MOUNT, LIMITS)
    assert reading.variance_m2 > 0.0
    if reading.status is RangeStatus.VALID:
        assert block[0] >> 3 & 0x0F == 11
        assert LIMITS.min_m < reading.range_m < LIMITS.max_m


@given(st.integers(1, 0xFFFF))
def test_an_encoded_timeout_is_never_longer_and_hardly_shorter(macros: int) -> None:
    encoded = encoded_timeout(macros)
    decoded = ((encoded & 0xFF) << (encoded >> 8)) + 1
    assert macros * (1 - 1 / 128) - 1 <= decoded <= macros


@given(st.binary(min_size=6, max_size=6), st.integers(0, 44), st.booleans())
def test_only_good_diodes_of_the_right_kind_are_chosen(
    good: bytes, count: int, aperture: bool
) -> None:
    chosen = int.from_bytes(chosen_spads(good, count, aperture=aperture), "little")
    allowed = int.from_bytes(good, "little") >> (12 if aperture else 0) << (12 if aperture else 0)
    assert chosen & ~allowed == 0
    assert chosen.bit_count() == min(count, allowed.bit_count())
    assert chosen == 0 or allowed & ((1 << chosen.bit_length()) - 1) == chosen


def test_a_longer_budget_goes_into_the_final_range() -> None:
    assert final_macros(0.033) < final_macros(0.066)
    assert still(0.3)(0.0).range_m == 0.3
