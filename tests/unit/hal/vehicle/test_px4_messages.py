"""Translation of PX4's messages, with the values that were measured on a real autopilot."""

import math

import pytest

from hal.errors import ReadingRefused
from hal.readings import FlightMode, LandedState, StatusText
from hal.vehicle.px4_messages import (
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
