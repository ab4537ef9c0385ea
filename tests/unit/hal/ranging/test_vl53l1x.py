"""The VL53L1X against a chip that obeys the data sheet, register by register."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hal.clock import SimClock
from hal.config import BeamMount, Vl53l1xConfig
from hal.ranging.i2c_bus import I2cError
from hal.ranging.ranger import ChipReset, ChipSilent, Limits, Measured, WrongChip
from hal.ranging.vl53l1x import TIMEOUTS, Vl53l1x
from hal.readings import RangeReading, RangeStatus
from tests.support.fake_i2c import FakeBus
from tests.support.fake_tof import FakeVl53l1x, Target

MOUNT, LIMITS = BeamMount(name="front"), Limits(0.04, 1.0)


class Chip:
    """One chip alone on its bus."""

    def __init__(self, target: Target | None = None, **config: object) -> None:
        self.clock = SimClock(50.0)
        self.fake = FakeVl53l1x(self.clock, lambda _now_s: target or Target(0.5))
        self.clock.advance(0.002)
        self.bus = FakeBus()
        self.bus.devices.append(self.fake)
        settings_ = {"chip": "vl53l1x", "beam": "front", **config}
        self.ranger = Vl53l1x(self.bus, Vl53l1xConfig.model_validate(settings_))

    def start(self) -> "Chip":
        for pause_s in self.ranger.begin():
            self.clock.advance(pause_s)
        return self

    def measured(self) -> Measured:
        for _ in range(3000):
            measured = self.ranger.poll()
            if measured is not None:
                return measured
            self.clock.advance(0.001)
        raise AssertionError("it measures nothing")

    def reading(self) -> RangeReading:
        return self.measured().reading(self.clock.now_s(), MOUNT, LIMITS)


def test_the_first_range_is_not_believed_and_the_second_is() -> None:
    chip = Chip(Target(0.437, sigma_mm=4.0)).start()
    assert chip.reading().status is RangeStatus.SUSPECT
    reading = chip.reading()
    assert reading.status is RangeStatus.VALID
    assert reading.range_m == pytest.approx(0.437)
    assert math.sqrt(reading.variance_m2) == pytest.approx(0.005, abs=1e-6)  # 4 mm and 3 mm
    assert chip.clock.now_s() - reading.stamp_s == pytest.approx(0.0165)


@pytest.mark.parametrize(
    ("mode", "budget_ms"), [(mode, ms) for mode, table in TIMEOUTS.items() for ms in table]
)
def test_every_budget_is_what_the_chip_is_told(mode: str, budget_ms: int) -> None:
    chip = Chip(mode=mode, budget_ms=budget_ms).start()
    assert chip.fake.budget_ms() == budget_ms
    assert chip.fake.cells[0x4B] == (0x14 if mode == "short" else 0x0A)
    # No measurement is left out for want of time.
    assert 1e-3 * budget_ms < chip.fake.period_s() < 1e-3 * budget_ms * 1.02 + 0.005


def test_the_count_of_the_stream_may_wrap_around() -> None:
    chip = Chip().start()
    for _ in range(600):
        chip.reading()
    assert chip.fake.cells[0x8B] >= 0x80


def test_the_same_measurement_twice_is_a_fault() -> None:
    chip = Chip().start()
    chip.reading()
    chip.fake._show(ready=True)
    with pytest.raises(ChipSilent, match="same measurement"):
        chip.ranger.poll()


@pytest.mark.parametrize(("width", "height", "centre"), [(16, 16, 199), (8, 4, 60), (4, 4, 145)])
def test_the_region_of_interest_reaches_the_chip(width: int, height: int, centre: int) -> None:
    chip = Chip(roi_width=width, roi_height=height, roi_centre=centre).start()
    assert chip.fake.cells[0x7F] == centre
    assert chip.fake.cells[0x80] == (height - 1) * 16 + width - 1


def test_a_small_region_sees_less() -> None:
    far = Target(1.0, signal_at_1m_mcps=8.0, ambient_mcps=0.01)
    whole, small = Chip(far).start(), Chip(far, roi_width=4, roi_height=4).start()
    whole.reading()
    small.reading()
    assert whole.measured().status is RangeStatus.VALID
    assert small.measured().status is RangeStatus.OUT_OF_RANGE


@pytest.mark.parametrize("code", range(32))
def test_every_status_of_the_chip_is_kept(code: int) -> None:
    measured = Chip(Target(0.5, code=code)).start().measured()
    expected = {
        4: RangeStatus.OUT_OF_RANGE,
        5: RangeStatus.SUSPECT,
        6: RangeStatus.SUSPECT,
        7: RangeStatus.SUSPECT,
        8: RangeStatus.TOO_NEAR,
        9: RangeStatus.VALID,
        13: RangeStatus.TOO_NEAR,
        19: RangeStatus.SUSPECT,
        22: RangeStatus.SUSPECT,
    }
    assert measured.status is expected.get(code, RangeStatus.NO_SIGNAL)
    assert measured.hardware_fault == (code == 3)


@pytest.mark.parametrize("range_mm", [8190, 8191])
def test_8190_and_8191_are_never_distances(range_mm: int) -> None:
    for code, status in (
        (9, RangeStatus.OUT_OF_RANGE),
        (6, RangeStatus.NO_SIGNAL),
        (4, RangeStatus.OUT_OF_RANGE),
    ):
        assert Chip(Target(code=code, range_mm=range_mm)).start().reading().status is status
    sunlit = Target(code=9, range_mm=range_mm, ambient_mcps=1.0)
    assert Chip(sunlit).start().reading().status is RangeStatus.NO_SIGNAL


def test_a_wrapped_target_is_suspect() -> None:
    chip = Chip(Target(2.3, signal_at_1m_mcps=60.0)).start()
    chip.reading()
    assert chip.reading().status is RangeStatus.SUSPECT


def test_a_running_chip_is_reset_first() -> None:
    chip = Chip().start()
    chip.reading()
    chip.start()
    assert chip.fake.resets == 2
    assert chip.reading().status is RangeStatus.SUSPECT


@pytest.mark.parametrize("after", range(0, 40, 2))
def test_a_start_that_was_broken_off_anywhere_is_made_good(after: int) -> None:
    chip = Chip()
    chip.bus.breaks_after = after
    try:
        chip.start()
    except I2cError:
        chip.clock.advance(0.002)
    chip.bus.breaks_after = None
    chip.start().reading()
    assert chip.reading().status is RangeStatus.VALID


def test_another_chip_is_refused() -> None:
    chip = Chip()
    chip.fake.model = 0xEEAA
    chip.fake.reset()
    with pytest.raises(WrongChip, match="says eeaa, a VL53L1X says eacc"):
        chip.start()


def test_a_lost_setting_is_recognised() -> None:
    chip = Chip().start()
    chip.ranger.check()
    chip.fake.restart()
    chip.clock.advance(0.002)
    with pytest.raises(ChipReset):
        chip.ranger.check()


def test_ending_stops_it() -> None:
    chip = Chip().start()
    chip.ranger.end()
    chip.clock.advance(0.5)
    assert chip.ranger.poll() is None


@settings(deadline=None, max_examples=200)
@given(st.binary(min_size=17, max_size=17))
def test_whatever_the_registers_say_it_is_a_reading(block: bytes) -> None:
    reading = Chip().ranger._measured(block).reading(1.0, MOUNT, LIMITS)
    assert reading.variance_m2 > 0.0
    if reading.status is RangeStatus.VALID:
        assert block[0] & 0x1F == 9
        assert LIMITS.min_m < reading.range_m < LIMITS.max_m
