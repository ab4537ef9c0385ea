"""Faults of the mock PX4, as they look on the wire."""

import itertools
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import development as mavlink

from tests.support.mock_px4 import MockProcess
from tests.support.station import Station

pytestmark = pytest.mark.integration

ARM = mavlink.MAV_CMD_COMPONENT_ARM_DISARM


@contextmanager
def heard(folder: Path, *faults: str, options: tuple[str, ...] = ()) -> Iterator[Station]:
    """A ground station that hears an empty room's vehicle with these faults."""
    lines = [option for fault in faults for option in ("--fault", fault)]
    with (
        MockProcess(folder, "--scenario", "empty", *lines, *options) as mock,
        Station(mock.port, mock.address) as station,
    ):
        station.heartbeat()
        yield station


def until_boot_s(station: Station, boot_s: float) -> None:
    """Until the vehicle's clock shows that much."""
    for message in station.messages(60.0):
        if message.get_type() == "ATTITUDE" and message.time_boot_ms >= 1e3 * boot_s:
            return
    raise AssertionError(f"the vehicle's clock never reached {boot_s} s")


def longest_gap_ms(station: Station, seconds: float) -> int:
    """The longest silence within some seconds, on the vehicle's clock."""
    clock = [
        message.time_boot_ms
        for message in station.messages(seconds)
        if message.get_type() == "ATTITUDE"
    ]
    return max(int(after - before) for before, after in itertools.pairwise(clock))


def test_a_lost_link_is_silent_for_as_long_as_asked(tmp_path: Path) -> None:
    with heard(tmp_path, "link_loss@3/1.5") as station:
        gap_ms = longest_gap_ms(station, 8.0)
    assert 1400 < gap_ms < 2500


def test_a_late_link_acknowledges_late(tmp_path: Path) -> None:
    with heard(tmp_path, "link_delay:delay_s=0.4") as station:
        station.wait("HEARTBEAT")
        before_s = time.monotonic()
        assert station.command(mavlink.MAV_CMD_RUN_PREARM_CHECKS) == 0
        assert time.monotonic() - before_s > 0.75  # there and back


def test_a_link_that_loses_loses_about_as_much_as_asked(tmp_path: Path) -> None:
    with heard(tmp_path, "link_drop:probability=0.5,direction=down") as station:
        sequence = [m.get_seq() for m in station.messages(5.0) if m.get_srcComponent() == 1]
    missing = sum((after - before - 1) % 256 for before, after in itertools.pairwise(sequence))
    # A busy machine loses some more.
    assert 0.2 < len(sequence) / (len(sequence) + missing) < 0.6


def test_a_restart_is_silent_then_begins_at_zero_and_has_forgotten_what_was_agreed(
    tmp_path: Path,
) -> None:
    with heard(tmp_path, "reboot@6") as station:
        stop = (mavlink.MAVLINK_MSG_ID_VFR_HUD, -1.0)
        assert station.command(mavlink.MAV_CMD_SET_MESSAGE_INTERVAL, *stop) == 0
        until_boot_s(station, 5.0)
        for message in station.messages(30.0):
            if message.get_type() == "ATTITUDE" and message.time_boot_ms < 3000:
                break
            assert message.get_type() != "VFR_HUD", "it was stopped"
        assert 1300 <= message.time_boot_ms < 2000
        beat = station.wait("HEARTBEAT")
        assert beat.system_status == mavlink.MAV_STATE_UNINIT
        station.wait("VFR_HUD")
        station.heartbeat()
        assert station.command(ARM, 1.0) == mavlink.MAV_RESULT_TEMPORARILY_REJECTED
        until_boot_s(station, 4.5)
        assert station.command(ARM, 1.0) == mavlink.MAV_RESULT_ACCEPTED


def test_another_computer_on_board_is_heard(tmp_path: Path) -> None:
    with heard(tmp_path, "second_companion:rate_hz=0") as station:
        other: Any = next(
            m
            for m in station.messages(10.0)
            if m.get_type() == "HEARTBEAT" and m.get_srcComponent() != 1
        )
    assert other.type == mavlink.MAV_TYPE_ONBOARD_CONTROLLER
    assert other.get_srcSystem() == 1


def test_a_refused_arming_says_why_in_texts_and_in_the_health_report(tmp_path: Path) -> None:
    fault = "arming_refused:reason=Preflight Fail: Compass Sensor 0 missing,times=1"
    with heard(tmp_path, fault) as station:
        status = station.wait("SYS_STATUS")
        assert not status.onboard_control_sensors_health & mavlink.MAV_SYS_STATUS_PREARM_CHECK
        said: list[str] = []
        station.send(mavlink.MAVLink_command_long_message(1, 1, ARM, 0, 1, 0, 0, 0, 0, 0, 0))
        for message in station.messages(10.0):
            if message.get_type() == "STATUSTEXT":
                said.append(message.text)
            if message.get_type() == "COMMAND_ACK":
                assert message.result == mavlink.MAV_RESULT_TEMPORARILY_REJECTED
            if any(text.startswith("Arming denied") for text in said):
                break
        assert "Preflight Fail: Compass Sensor 0 missing" in said
        time.sleep(0.1)
        assert station.command(ARM, 1.0) == mavlink.MAV_RESULT_ACCEPTED


def test_a_reset_of_the_estimator_is_told_by_its_counter(tmp_path: Path) -> None:
    with heard(tmp_path, "ekf_reset@4:north_m=2,yaw_deg=30") as station:
        before = station.wait("ODOMETRY", reset_counter=0)
        after = station.wait("ODOMETRY", reset_counter=1)
        attitude = station.wait("ATTITUDE")
    assert after.x - before.x == pytest.approx(2.0, abs=0.2)
    assert attitude.yaw == pytest.approx(0.52, abs=0.12)


def test_gnss_and_battery_say_what_they_are_told_to(tmp_path: Path) -> None:
    with heard(tmp_path, "gnss_loss", "battery:remaining=0.1") as station:
        fix = station.wait("GPS_RAW_INT", fix_type=1)
        assert fix.satellites_visible == 0
        assert station.wait("SYS_STATUS", battery_remaining=10).battery_remaining == 10
