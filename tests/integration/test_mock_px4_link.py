"""The mock PX4 as a process, heard by pymavlink."""

import itertools
import signal
import struct
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import development as mavlink

from tests.support.mock_px4 import MockProcess
from tests.support.px4 import facts
from tests.support.station import Station

pytestmark = pytest.mark.integration


@pytest.fixture
def mock(tmp_path: Path) -> Iterator[MockProcess]:
    with MockProcess(tmp_path, "--scenario", "default", "--seed", "3") as process:
        yield process


@pytest.fixture
def station(mock: MockProcess) -> Iterator[Station]:
    client = Station(mock.port)
    yield client
    client.close()


def test_it_streams_without_having_been_asked_at_the_measured_rates(station: Station) -> None:
    counts, boot = Counter[str](), []
    for message in station.messages(3.0):
        if message.get_type().startswith("UNKNOWN"):
            continue  # PX4 sends messages that pymavlink does not know, and so does the mock
        assert (message.get_srcSystem(), message.get_srcComponent()) == (1, 1)
        counts[message.get_type()] += 1
        if message.get_type() == "ATTITUDE":
            boot.append(message.time_boot_ms)
    seconds = (boot[-1] - boot[0]) / 1e3  # rates are per second of the autopilot's time
    for name, rate_hz in facts()["streams_hz"].items():
        assert counts[name] == pytest.approx(rate_hz * seconds, rel=0.1, abs=1.5), name
    # Six beams at 20 Hz, less the dropouts.
    assert counts["DISTANCE_SENSOR"] == pytest.approx(120.0 * seconds, rel=0.15)
    assert "STATUSTEXT" not in counts


def test_beams_look_in_six_directions_and_carry_whole_centimetres(station: Station) -> None:
    seen: dict[int, tuple[int, int]] = {}
    for message in station.messages(1.5):
        if message.get_type() == "DISTANCE_SENSOR":
            seen[message.id] = (message.orientation, message.current_distance)
            assert (message.min_distance, message.max_distance) == (2, 100)
            assert 0 < message.current_distance <= 101
            assert message.signal_quality == 100
    assert {index: looks for index, (looks, _) in seen.items()} == {
        0: 0,
        1: 2,
        2: 4,
        3: 6,
        4: 24,
        5: 25,
    }


def test_status_texts_come_only_where_a_ground_station_is_heard(
    mock: MockProcess, station: Station
) -> None:
    station.wait("HEARTBEAT")
    other = Station(0, mock.address)
    try:
        other.heartbeat(mavlink.MAV_TYPE_ONBOARD_CONTROLLER)
        station.heartbeat()
        assert station.command(400, 1.0) == 0
        assert station.wait("STATUSTEXT").text == "Armed by external command\t"
        kinds = {message.get_type() for message in other.messages(1.0)}
        assert "ATTITUDE" in kinds  # whoever sends to it is answered too
        assert "STATUSTEXT" not in kinds
    finally:
        other.close()


def test_a_stream_can_be_stopped_on_one_link_only(mock: MockProcess, station: Station) -> None:
    station.wait("HEARTBEAT")
    other = Station(0, mock.address)
    try:
        other.heartbeat()
        assert station.command(511, 30.0, -1.0) == 0
        assert "ATTITUDE" not in {m.get_type() for m in station.messages(0.5)}
        assert "ATTITUDE" in {m.get_type() for m in other.messages(0.5)}
    finally:
        other.close()


def test_rubbish_on_the_wire_changes_nothing(station: Station) -> None:
    station.wait("HEARTBEAT")
    for data in (b"", b"\xfd", b"\xfd\xff" + bytes(300), bytes(range(256)) * 4, b"GET / HTTP"):
        station.send_raw(data)
    frame = bytearray(
        mavlink.MAVLink_command_long_message(1, 1, 400, 0, 1, *(0,) * 6).pack(station.codec)
    )
    frame[-1] ^= 0xFF
    station.send_raw(bytes(frame))
    assert "COMMAND_ACK" not in {m.get_type() for m in station.messages(0.5)}
    assert station.command(512, 148.0) == 0


def test_the_parameter_list_is_complete(station: Station) -> None:
    station.wait("HEARTBEAT")
    station.send(mavlink.MAVLink_param_request_list_message(1, 1))
    values: dict[int, Any] = {}
    for message in station.messages(15.0):
        if message.get_type() == "PARAM_VALUE":
            values[message.param_index] = message
            if len(values) == 939:
                break
    action = next(m for m in values.values() if m.param_id == "COM_OBL_RC_ACT")
    assert struct.unpack("<i", struct.pack("<f", action.param_value)) == (5,)
    assert len(values) == 939


def test_the_truth_is_written_line_by_line_while_it_runs(
    mock: MockProcess, station: Station
) -> None:
    station.wait("HEARTBEAT")
    list(station.messages(0.7))
    records = mock.truth()
    assert len(records) >= 5
    steps = [b["t"] - a["t"] for a, b in itertools.pairwise(records)]
    assert steps == pytest.approx([0.05] * len(steps), abs=0.011)
    assert records[-1]["armed"] is False
    assert records[-1]["in_air"] is False
    assert records[-1]["clearance_m"] > 0.15


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGINT])
def test_a_signal_ends_it_cleanly(tmp_path: Path, number: signal.Signals) -> None:
    with MockProcess(tmp_path, "--scenario", "empty") as process:
        assert process.end(number) == 0


def test_an_unknown_scenario_is_told_in_one_sentence() -> None:
    command = [sys.executable, "-m", "hal.sim.mock_px4", "--scenario", "nowhere"]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=60.0)
    assert done.returncode == 2
    assert done.stdout == ""
    assert "there is no scenario 'nowhere'" in done.stderr
    assert "Traceback" not in done.stderr


def test_it_runs_faster_than_real_time_when_told_to(tmp_path: Path) -> None:
    with MockProcess(tmp_path, "--speed", "4") as process:
        client = Station(process.port)
        first = client.wait("ATTITUDE")
        start = time.monotonic()
        last = first
        for message in client.messages(1.5):
            if message.get_type() == "ATTITUDE":
                last = message
        client.close()
        boot_s = (last.time_boot_ms - first.time_boot_ms) / 1e3
        assert boot_s > 1.3 * (time.monotonic() - start)


def test_before_it_has_booted_it_refuses_to_arm(tmp_path: Path) -> None:
    with MockProcess(tmp_path, "--boot-s", "30") as process:
        client = Station(process.port)
        assert client.wait("HEARTBEAT").system_status == 0
        client.heartbeat()
        assert client.command(400, 1.0) == 1
        texts = [m for m in client.messages(1.5) if m.get_type() == "STATUSTEXT"]
        client.close()
        assert "".join(m.text for m in texts) == (
            "Preflight Fail: no heading reference"
            "Arming denied: Resolve system health failures first\t"
        )
