"""Another computer's clock: jitter falls out, drift is followed, leaps have to insist."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hal.boot_clock import BootClock


def noted(clock: BootClock, received_s: float, boot_s: float) -> float:
    """The stamp of a message that is believed."""
    stamp_s = clock.note(received_s, boot_s)
    assert stamp_s is not None
    return stamp_s


@settings(deadline=None, max_examples=60)
@given(
    st.lists(st.floats(0.0, 0.2), min_size=5, max_size=80),
    st.floats(-1e4, 1e4),
    st.floats(0.98, 1.0),
)
def test_a_stamp_is_never_after_the_reception_and_loses_the_jitter(
    jitters_s: list[float], offset_s: float, rate: float
) -> None:
    clock = BootClock()
    for n, jitter_s in enumerate(jitters_s):
        true_s = 100.0 + n / 30.0
        stamp_s = noted(clock, true_s + jitter_s, offset_s + rate * n / 30.0)
        assert stamp_s <= true_s + jitter_s + 1e-9
        # What remains: the least delay of the window, and what the slower clock lost in it.
        least_s = min(jitters_s[max(0, n - 25) : n + 1])
        assert stamp_s - true_s <= least_s + 1e-6
        assert stamp_s - true_s >= -(1.0 - rate) * 2.1 - 1e-6


def test_a_clock_that_loses_two_per_cent_is_followed_for_ever() -> None:
    clock = BootClock()
    for n in range(30 * 60):
        now_s = n / 30.0
        assert 0.0 <= now_s - noted(clock, now_s, 500.0 + 0.98 * now_s) <= 0.042


def test_a_restarted_autopilot_is_noticed_and_its_new_clock_learned() -> None:
    clock = BootClock()
    for n in range(60):
        clock.note(10.0 + n / 30.0, 500.0 + n / 30.0)
    assert [clock.note(13.0 + 0.1 * n, 2.0 + 0.1 * n) for n in range(3)] == [None] * 3
    assert clock.note(13.31, 2.31) == 13.31
    assert clock.restarts == 1
    assert clock.note(13.6, 2.4) == pytest.approx(13.4)


def test_a_reordered_message_is_not_a_restart() -> None:
    clock = BootClock()
    clock.note(10.0, 500.0)
    clock.note(10.1, 499.9)
    assert clock.restarts == 0


def test_before_anything_was_heard_a_stamp_is_the_reception() -> None:
    assert BootClock().stamp_s(7.0, 3.0) == 7.0


def learned(seconds: int = 5) -> tuple[BootClock, float]:
    """A clock that heard 30 prompt messages a second, and the time; boot time is 10 s less."""
    clock = BootClock()
    for n in range(seconds * 30):
        clock.note(n / 30.0, n / 30.0 - 10.0)
    return clock, float(seconds)


@pytest.mark.parametrize("delay_s", [0.1, 0.49, 0.56, 1.0, 3.0, 60.0])
def test_an_old_message_is_old_however_old_it_is(delay_s: float) -> None:
    clock, now_s = learned()
    assert clock.stamp_s(now_s, now_s - delay_s - 10.0) == pytest.approx(now_s - delay_s)


@settings(deadline=None, max_examples=40)
@given(st.floats(0.2, 3.0), st.floats(0.0, 6.0))
def test_a_delay_that_grows_and_stays_is_believed_but_for_the_drift(
    delay_s: float, growing_s: float
) -> None:
    """From a step (0 s) to a slow growth; 8 s are far beyond every window of forgetting."""
    clock, start_s = learned()
    for n in range(8 * 30):
        elapsed_s = n / 30.0
        late_s = delay_s * (min(1.0, elapsed_s / growing_s) if growing_s > 0.0 else 1.0)
        now_s = start_s + elapsed_s + late_s
        believed_s = now_s - noted(clock, now_s, start_s + elapsed_s - 10.0)
        # The wait for the first late message counts as time in which the clock may have drifted.
        drift_s = BootClock.DRIFT_S_PER_S * (elapsed_s + late_s + 1.0 / 30.0)
        assert late_s - drift_s - 1e-6 <= believed_s <= late_s + 1e-6


def test_a_link_that_recovers_is_believed_at_once() -> None:
    clock, now_s = learned()
    clock.note(now_s + 3.0, now_s - 10.0)
    assert clock.note(now_s + 3.1, now_s + 3.1 - 10.0) == pytest.approx(now_s + 3.1, abs=0.07)
    assert clock.restarts == 0


@pytest.mark.parametrize("leap_s", [40.0, 1e9, -100.0])
def test_a_clock_that_was_set_is_learned_when_it_insists(leap_s: float) -> None:
    clock, now_s = learned()
    for n in range(10):
        assert clock.note(now_s + n / 30.0, now_s + n / 30.0 + leap_s) is None
    assert clock.note(now_s + 0.34, now_s + 0.34 + leap_s) == pytest.approx(now_s + 0.34)
    assert noted(clock, now_s + 0.5, now_s + 0.4 + leap_s) == pytest.approx(now_s + 0.4, abs=0.01)
    assert clock.restarts == 1


@settings(deadline=None, max_examples=60)
@given(
    # Less than a leap ahead and believed, or so far that it leaps even after such a one.
    st.lists(
        st.floats(-1e4, BootClock.LEAP_S - 1e-6) | st.floats(2.0 * BootClock.LEAP_S + 1e-6, 1e13),
        max_size=40,
    ),
    st.floats(1.1, 1e3),
)
def test_times_that_are_made_up_or_repeated_do_not_shake_a_clock_that_goes_on(
    leads_s: list[float], ago_s: float
) -> None:
    """What is believed makes stamps older by at most its lead, never newer, and is forgotten."""
    clock, at_s = learned()
    worst_s = 0.0
    for lead_s in leads_s:
        if clock.note(at_s, at_s - 10.0 + lead_s) is not None:
            assert lead_s <= BootClock.LEAP_S
            worst_s = max(worst_s, lead_s)
        assert clock.note(at_s, at_s - 10.0 - ago_s) is None
        assert 0.0 <= lateness_s(clock, at_s) <= worst_s + 1e-6
        at_s += 1.0 / 30.0
    began_s, windows_s = at_s, 2.0 * BootClock.WINDOW_S + 0.4
    while worst_s > 0.0 and at_s - began_s < windows_s + worst_s / BootClock.DRIFT_S_PER_S:
        forgotten_s = BootClock.DRIFT_S_PER_S * (at_s - began_s)
        left_s = worst_s if at_s - began_s < windows_s else max(0.0, worst_s - forgotten_s)
        assert 0.0 <= lateness_s(clock, at_s) <= left_s + 1e-6
        at_s += 0.2
    assert lateness_s(clock, at_s) == pytest.approx(0.0, abs=1e-6)
    assert clock.restarts == 0


@pytest.mark.parametrize(("lead_s", "believed"), [(0.99, True), (1.01, False)])
def test_less_than_a_leap_ahead_is_believed_and_no_more(lead_s: float, believed: bool) -> None:
    clock, now_s = learned()
    assert (clock.note(now_s, now_s - 10.0 + lead_s) is not None) is believed
    assert lateness_s(clock, now_s) == pytest.approx(lead_s if believed else 0.0)


def lateness_s(clock: BootClock, at_s: float) -> float:
    """How much too old a prompt message's stamp is, were it also received a second late."""
    noted(clock, at_s, at_s - 10.0)
    return at_s - clock.stamp_s(at_s + 1.0, at_s - 10.0)


def test_who_runs_ahead_step_by_step_is_another_clock_and_the_old_one_is_learned_again() -> None:
    clock, now_s = learned()
    for n in range(1, 5):
        assert clock.note(now_s, now_s - 10.0 + 0.9 * n) is not None
    for n in range(10):
        assert clock.note(now_s + n / 30.0, now_s + n / 30.0 - 10.0) is None
    assert clock.note(now_s + 0.34, now_s + 0.34 - 10.0) == pytest.approx(now_s + 0.34)
    assert clock.restarts == 1


def test_after_a_restart_on_a_slow_link_old_is_old_again() -> None:
    clock, now_s = learned(20)
    for n in range(11):
        clock.note(now_s + 1.0 + 0.03 * n, 2.0 + 0.03 * n)
    assert clock.restarts == 1
    assert clock.note(now_s + 4.3, 3.3) == pytest.approx(now_s + 2.3, abs=0.061)
