"""Faults over time: confirmation, hysteresis, flapping."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from autonomy.config import Config
from autonomy.mission.failsafe import RULES, Fault, Found, Response, found
from autonomy.mission.persistence import Persistence

DT_S = 0.05
CONFIG = Config.model_validate({"failsafe": {"flapping_holds": 4, "flapping_window_s": 10.0}})


class Fed:
    """A persistence and its clock."""

    def __init__(self) -> None:
        self.persistence = Persistence(CONFIG)
        self.now_s = 100.0

    def feed(self, *faults: Fault, seconds: float = DT_S) -> tuple[Found, ...]:
        counted: tuple[Found, ...] = ()
        for _ in range(round(seconds / DT_S)):
            self.now_s += DT_S
            present = tuple(found(CONFIG, fault, f"{fault} it is") for fault in faults)
            counted = self.persistence.step(self.now_s, present)
        return counted


def test_a_lost_position_counts_at_once_and_is_over_after_its_pause() -> None:
    fed = Fed()
    assert [f.fault for f in fed.feed(Fault.STATE_LOST)] == [Fault.STATE_LOST]
    assert fed.feed(seconds=RULES[Fault.STATE_LOST].clear_s - DT_S)
    assert not fed.feed(seconds=2.0 * DT_S)


def test_one_reading_of_an_empty_battery_is_none() -> None:
    fed = Fed()
    assert not fed.feed(Fault.BATTERY_CRITICAL, seconds=RULES[Fault.BATTERY_CRITICAL].confirm_s)
    assert fed.feed(Fault.BATTERY_CRITICAL)
    assert not fed.feed()
    assert not fed.feed(Fault.BATTERY_CRITICAL)


def test_what_comes_and_goes_too_often_has_the_next_response_for_good() -> None:
    fed = Fed()
    for _ in range(3):
        assert fed.feed(Fault.STATE_LOST)[0].response is Response.HOLD
        assert not fed.feed(seconds=1.0)
    escalated = fed.feed(Fault.STATE_LOST)[0]
    assert escalated.response is Response.LAND
    assert escalated.why == "state_lost it is, 4 times within 10 s"
    fed.feed(seconds=100.0)
    assert fed.feed(Fault.STATE_LOST)[0].response is Response.LAND


def test_the_same_often_but_slowly_does_not_flap() -> None:
    fed = Fed()
    for _ in range(12):
        assert fed.feed(Fault.STATE_LOST)[0].response is Response.HOLD
        fed.feed(seconds=4.0)
    assert fed.persistence.begun(Fault.STATE_LOST) <= 3


def test_a_fault_that_lasts_has_begun_once() -> None:
    fed = Fed()
    assert fed.feed(Fault.STATE_LOST, seconds=30.0)[0].response is Response.HOLD
    assert fed.persistence.begun(Fault.STATE_LOST) == 1


def test_each_fault_is_counted_for_itself() -> None:
    fed = Fed()
    for fault in (Fault.STATE_LOST, Fault.DRIFT, Fault.STATE_LOST, Fault.DRIFT):
        assert fed.feed(fault)[0].response is Response.HOLD
        fed.feed(seconds=1.0)


def test_what_flickers_too_fast_to_be_over_escalates_after_half_of_the_window() -> None:
    fed, held_s = Fed(), 0.0
    while (found_now := fed.feed(Fault.STATE_LOST, seconds=2.0 * DT_S))[0].response < Response.LAND:
        assert fed.feed(), "one good tick does not end it"
        held_s += 3.0 * DT_S
        assert held_s < 6.0
    assert held_s == pytest.approx(5.0, abs=0.3)
    assert found_now[0].why == "state_lost it is, on and off for 5 of 10 s"


def test_few_long_holds_escalate_by_the_time_that_they_take() -> None:
    fed = Fed()
    for _ in range(2):
        assert fed.feed(Fault.DRIFT, seconds=2.4)[0].response is Response.HOLD
        assert not fed.feed(seconds=1.0)
    assert fed.feed(Fault.DRIFT, seconds=1.0)[0].response is Response.LAND


def test_long_holds_with_more_than_as_much_flight_between_go_on_as_before() -> None:
    fed = Fed()
    for _ in range(10):
        assert fed.feed(Fault.DRIFT, seconds=2.0)[0].response is Response.HOLD
        fed.feed(seconds=4.0)


@settings(deadline=None, max_examples=60)
@given(st.lists(st.sets(st.sampled_from(list(Fault))), max_size=60))
def test_what_counts_was_seen_lately_and_is_sorted(ticks: list[set[Fault]]) -> None:
    fed = Fed()
    last_s: dict[Fault, float] = {}
    for faults in ticks:
        counted = fed.feed(*faults)
        for fault in faults:
            last_s[fault] = fed.now_s
            if RULES[fault].confirm_s == 0.0:
                assert fault in {each.fault for each in counted}
        for each in counted:
            assert fed.now_s - last_s[each.fault] <= RULES[each.fault].clear_s + 1e-6
            assert each.response >= found(CONFIG, each.fault, "").response
        responses = [each.response for each in counted]
        assert responses == sorted(responses, reverse=True)
