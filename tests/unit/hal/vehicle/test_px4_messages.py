"""Translation of PX4's messages, with the values that were measured on a real autopilot."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hal.errors import ReadingRefused
from hal.readings import FlightMode, LandedState, StatusText
from hal.vehicle.px4_messages import (
    BootClock,
    CurrentMode,
    ExtendedSysState,
    Heartbeat,
    Odometry,
    RecentTexts,
    StatusTextMessage,
    SysStatus,
    TextAssembler,
)


@pytest.mark.parametrize(
    ("base_mode", "custom_mode", "armed", "mode"),
    [
        (29, 50593792, False, FlightMode.HOLD),
        (157, 33816576, True, FlightMode.TAKEOFF),
        (157, 50593792, True, FlightMode.HOLD),
        (145, 393216, True, FlightMode.OFFBOARD),
        (17, 393216, False, FlightMode.OFFBOARD),
        (157, 84148224, True, FlightMode.RETURN),
        (157, 100925440, True, FlightMode.LAND),
        (157, 0x14040000, True, FlightMode.DESCEND),
        (157, 0x04040000, True, FlightMode.MISSION),
        (81, 196608, False, FlightMode.MANUAL),
        (129, 0x01030000, True, FlightMode.MANUAL),
        (157, 0x63040000, True, FlightMode.UNKNOWN),
        (0, 0, False, FlightMode.UNKNOWN),
    ],
)
def test_a_heartbeat_tells_mode_and_arming(
    base_mode: int, custom_mode: int, armed: bool, mode: FlightMode
) -> None:
    heartbeat = Heartbeat(12, base_mode, custom_mode, 4)
    assert (heartbeat.armed, heartbeat.mode) == (armed, mode)


@pytest.mark.parametrize("custom_mode", [0x03040000, 0x00060000, 0x00030000, 0x05040000, 0])
def test_the_current_mode_is_the_heartbeat_s(custom_mode: int) -> None:
    assert CurrentMode(custom_mode).mode is Heartbeat(12, 0, custom_mode, 4).mode


def test_landed_states_are_translated_and_unknown_ones_stay_unknown() -> None:
    states = [ExtendedSysState(n).landed for n in range(6)]
    assert states == [
        LandedState.UNKNOWN,
        LandedState.ON_GROUND,
        LandedState.IN_AIR,
        LandedState.TAKEOFF,
        LandedState.LANDING,
        LandedState.UNKNOWN,
    ]


def test_the_prearm_bit_says_whether_it_can_be_armed() -> None:
    assert SysStatus(320915519, 100).prearm_ok
    assert not SysStatus(320915519 & ~0x1000_0000, 100).prearm_ok


@pytest.mark.parametrize(("percent", "remaining"), [(-1, None), (0, 0.0), (73, 0.73), (101, None)])
def test_an_unknown_battery_is_not_an_empty_one(percent: int, remaining: float | None) -> None:
    assert SysStatus(0, percent).battery == remaining


def odometry(frame: int = 1, child: int = 1, yaw_rad: float = 0.0, x: float = 1.0) -> Odometry:
    q = (math.cos(yaw_rad / 2), 0.0, 0.0, math.sin(yaw_rad / 2))
    return Odometry(2_000_000, frame, child, x, 2.0, -3.0, q, 0.5, 0.0, 0.0, 11)


def test_odometry_in_the_local_frame_is_taken_as_it_is() -> None:
    reading = odometry().reading(5.0)
    assert reading is not None
    assert reading.position_ned_m == (1.0, 2.0, -3.0)
    assert reading.velocity_ned_m_s == (0.5, 0.0, 0.0)
    assert (reading.stamp_s, reading.reset_counter) == (5.0, 11)


@pytest.mark.parametrize("child", [8, 12])
def test_odometry_with_a_body_velocity_is_turned_to_the_local_frame(child: int) -> None:
    reading = odometry(child=child, yaw_rad=math.radians(90.0)).reading(5.0)
    assert reading is not None
    assert reading.velocity_ned_m_s == pytest.approx((0.0, 0.5, 0.0), abs=1e-12)


@pytest.mark.parametrize(("frame", "child"), [(20, 1), (1, 20), (4, 12)])
def test_odometry_in_other_frames_is_no_position(frame: int, child: int) -> None:
    assert odometry(frame, child).reading(5.0) is None


def test_odometry_that_is_not_a_number_is_refused() -> None:
    with pytest.raises(ReadingRefused):
        odometry(x=math.nan).reading(5.0)


def said(*messages: StatusTextMessage) -> list[str]:
    assembler = TextAssembler()
    texts = [assembler.take(message, 1.0) for message in messages]
    return [text.text for text in texts if text is not None]


def test_a_short_text_loses_only_its_tab() -> None:
    assert said(StatusTextMessage(6, "Takeoff detected\t", 68, 0)) == ["Takeoff detected"]


def test_a_text_in_two_parts_is_put_together() -> None:
    first = "Arming denied: Resolve system health failures firs"
    parts = (StatusTextMessage(2, first, 7, 0), StatusTextMessage(2, "t\t", 7, 1))
    assert said(*parts) == ["Arming denied: Resolve system health failures first"]


def test_a_text_of_fifty_bytes_waits_for_the_part_that_is_only_a_tab() -> None:
    text = "RTL: start return at 496 m (7 m above destination)"
    assert len(text) == 50
    parts = (StatusTextMessage(6, text, 3, 0), StatusTextMessage(6, "\t", 3, 1))
    assert said(*parts) == [text]


def test_interleaved_texts_are_told_apart_by_their_id() -> None:
    a, b = "a" * 50, "b" * 50
    assert said(
        StatusTextMessage(6, a, 1, 0),
        StatusTextMessage(6, b, 2, 0),
        StatusTextMessage(6, "1", 1, 1),
        StatusTextMessage(6, "2", 2, 1),
    ) == [a + "1", b + "2"]


def test_a_repeated_first_part_begins_its_text_anew() -> None:
    a = "a" * 50
    first = StatusTextMessage(6, a, 1, 0)
    assert said(first, first, StatusTextMessage(6, "!", 1, 1)) == [a + "!"]


def test_a_last_part_alone_is_still_told() -> None:
    assert said(StatusTextMessage(6, "t\t", 7, 1)) == ["t"]


def test_unfinished_texts_do_not_pile_up() -> None:
    assembler = TextAssembler()
    for identity in range(1, 500):
        assembler.take(StatusTextMessage(6, "x" * 50, identity, 0), 0.0)
    last = assembler.take(StatusTextMessage(6, "end", 499, 1), 0.0)
    first = assembler.take(StatusTextMessage(6, "end", 1, 1), 0.0)
    assert last is not None
    assert first is not None
    assert (len(last.text), first.text) == (53, "end")


def test_recent_texts_answer_why_with_the_severe_and_new_ones_once() -> None:
    recent = RecentTexts()
    for stamp_s, severity, text in [
        (1.0, 2, "old"),
        (5.0, 6, "chatter"),
        (6.0, 4, "compass"),
        (7.0, 2, "denied"),
        (8.0, 4, "compass"),
    ]:
        recent.put(StatusText(stamp_s, severity, text))
    assert recent.since(4.0) == "compass; denied"
    assert recent.since(9.0) == ""


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
@given(st.lists(st.floats(-1e4, 1e13), max_size=40), st.floats(1.1, 1e3))
def test_times_that_are_made_up_or_repeated_do_not_shake_a_clock_that_goes_on(
    made_up_s: list[float], ago_s: float
) -> None:
    clock, now_s = learned()
    for n, boot_s in enumerate(made_up_s):
        at_s = now_s + n / 30.0
        clock.note(at_s, boot_s)
        assert clock.note(at_s, at_s - 10.0 - ago_s) is None
        assert noted(clock, at_s, at_s - 10.0) == pytest.approx(at_s, abs=0.01)
    assert clock.restarts == 0


def test_after_a_restart_on_a_slow_link_old_is_old_again() -> None:
    clock, now_s = learned(20)
    for n in range(11):
        clock.note(now_s + 1.0 + 0.03 * n, 2.0 + 0.03 * n)
    assert clock.restarts == 1
    assert clock.note(now_s + 4.3, 3.3) == pytest.approx(now_s + 2.3, abs=0.061)
