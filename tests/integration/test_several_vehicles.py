"""Several mock vehicles at once, each on its own port and with its own system id."""

import socket
import time
from contextlib import ExitStack
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import development as mavlink

from autonomy.errors import ExitCode
from tests.support.flying import Flying, never_harmed, on_the_ground
from tests.support.mock_px4 import MockProcess
from tests.support.station import Station

pytestmark = pytest.mark.integration

ARM = mavlink.MAV_CMD_COMPONENT_ARM_DISARM
LIMIT_S = 240.0


def neighbouring_ports() -> int:
    """A port of which the next is free as well."""
    while True:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as first:
            first.bind(("127.0.0.1", 0))
            port: int = first.getsockname()[1]
            with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as second:
                try:
                    second.bind(("127.0.0.1", port + 1))
                except (OSError, OverflowError):
                    continue
        return port


def result_of(station: Station, system: int, command: int, *parameters: float) -> int | None:
    """What a command to `system` is answered with; None when nobody answers."""
    padded = (*parameters, *(0.0,) * (7 - len(parameters)))
    station.send(mavlink.MAVLink_command_long_message(system, 1, command, 0, *padded))
    for message in station.messages(2.0):
        if message.get_type() == "COMMAND_ACK" and message.command == command:
            return int(message.result)
    return None


def test_what_is_said_to_one_vehicle_the_other_ignores(tmp_path: Path) -> None:
    port = neighbouring_ports()
    options = ("--scenario", "empty", "--vehicles", "2", "--system-id", "7")
    with MockProcess(tmp_path, *options, port=port), ExitStack() as stack:
        stations = [stack.enter_context(Station(port + number)) for number in (0, 1)]
        for number, station in enumerate(stations):
            beat = station.wait("HEARTBEAT")
            assert beat.get_srcSystem() == 7 + number
        assert result_of(stations[0], 8, ARM, 1.0) is None
        assert result_of(stations[1], 7, ARM, 1.0) is None
        assert result_of(stations[1], 8, ARM, 1.0) == mavlink.MAV_RESULT_ACCEPTED
        stations[0].wait("HEARTBEAT", base_mode=29)
        stations[1].wait("HEARTBEAT", base_mode=157)


def test_two_vehicles_are_flown_at_the_same_time_by_two_programs(tmp_path: Path) -> None:
    port = neighbouring_ports()
    with MockProcess(tmp_path, "--scenario", "empty", "--vehicles", "2", port=port) as mock:
        flights = []
        with ExitStack() as stack:
            for number, goal in enumerate(("1.5,0", "0,1.5")):
                connection = f"udpin://127.0.0.1:{port + number}"
                folder = tmp_path / f"flight-{number}"
                options = ("--goal", goal, "--connection", connection)
                flights.append(stack.enter_context(Flying(folder, *options)))
                time.sleep(0.5)
            codes = [flying.end(LIMIT_S) for flying in flights]
            errors = [flying.errors for flying in flights]
        truths = [mock.truth(), mock.truth(2)]
    assert codes == [ExitCode.GOAL_REACHED] * 2, errors
    for truth, goal_ne_m in zip(truths, ((1.5, 0.0), (0.0, 1.5)), strict=True):
        never_harmed(truth)
        assert on_the_ground(truth)
        assert truth[-1]["position_ned_m"][:2] == pytest.approx(goal_ne_m, abs=0.4)
