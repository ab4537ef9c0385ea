"""Requests, intervals, parameters, time: what PX4 answers to a client that asks."""

import itertools
import json
import math
import struct
from typing import Any

import pytest
from pymavlink.dialects.v20 import development as mavlink

from tests.conformance.conftest import Needs
from tests.conformance.link import Heard, message_name
from tests.conformance.transcript import GOLDEN
from tests.conformance.vehicle import Vehicle, decoded

MEASURED: dict[str, Any] = json.loads((GOLDEN / "protocol.json").read_text())
REQUEST, SET_INTERVAL, GET_INTERVAL = 512, 511, 510
ANSWER_S = 0.06


def heard_after(vehicle: Vehicle, kind: str, seconds: float = 0.3) -> list[Any]:
    """Messages of a kind within `seconds` from now."""
    from_s = vehicle.link.now_s
    vehicle.link.run(seconds)
    return [heard.message for heard in vehicle.link.since(from_s, kind)]


def results(vehicle: Vehicle, from_s: float) -> list[tuple[int, int]]:
    acks = vehicle.link.since(from_s, "COMMAND_ACK")
    return [(a.message.command, a.message.result) for a in acks]


# ---------------------------------------------------------------- commands


@pytest.mark.parametrize(("command", "result", "_mode"), MEASURED["commands"])
def test_a_command_on_the_ground_has_its_result(
    vehicle: Vehicle, command: list[float], result: int, _mode: str
) -> None:
    vehicle.standby()
    assert vehicle.ask(int(command[0]), *command[1:]) == result


@pytest.mark.parametrize(("other", "component"), [(77, 1), (0, 77)])
def test_commands_for_somebody_else_are_not_answered(
    vehicle: Vehicle, other: int, component: int
) -> None:
    vehicle.link.run(0.1)
    message = mavlink.MAVLink_command_long_message(
        vehicle.link.system + other, component, 512, 0, 148, *(0.0,) * 6
    )
    vehicle.link.send(message)
    assert heard_after(vehicle, "COMMAND_ACK", 1.0) == []


def test_an_acknowledgement_goes_to_who_asked(vehicle: Vehicle) -> None:
    vehicle.link.run(0.1)
    vehicle.command(512, 148.0)
    (ack,) = heard_after(vehicle, "COMMAND_ACK")
    assert (ack.target_system, ack.target_component) == (245, 190)
    assert (ack.progress, ack.result_param2) == (0, 0)
    assert (ack.get_srcSystem(), ack.get_srcComponent()) == (vehicle.link.system, 1)


# ---------------------------------------------------------------- messages on request


@pytest.mark.parametrize(("parameters", "result", "kind"), MEASURED["requests"])
def test_a_message_can_be_requested_or_not(
    vehicle: Vehicle, parameters: list[float], result: int, kind: str
) -> None:
    vehicle.link.run(1.2)
    from_s = vehicle.link.now_s
    before = vehicle.link.counts.copy()
    assert vehicle.ask(REQUEST, *parameters) == result
    vehicle.link.run(0.2)
    if kind:
        names = {message_name(n) for n, count in (vehicle.link.counts - before).items() if count}
        assert kind in names
        first = vehicle.link.since(from_s, kind)
        assert not first or first[0].at_s - from_s < ANSWER_S


def test_the_version_says_what_the_autopilot_can_do(vehicle: Vehicle, needs: Needs) -> None:
    needs("reference")
    vehicle.link.run(0.1)
    vehicle.command(REQUEST, 148.0)
    (version,) = heard_after(vehicle, "AUTOPILOT_VERSION")
    for field, value in MEASURED["version"].items():
        assert getattr(version, field) == value, field


def test_the_protocol_version_is_two(vehicle: Vehicle) -> None:
    vehicle.link.run(0.1)
    vehicle.command(REQUEST, 300.0)
    (version,) = heard_after(vehicle, "PROTOCOL_VERSION")
    for field, value in MEASURED["protocol_version"].items():
        assert getattr(version, field) == value, field


def test_all_modes_are_listed_or_one_by_its_index(vehicle: Vehicle, needs: Needs) -> None:
    needs("reference")
    vehicle.link.run(0.1)

    def listed() -> list[list[object]]:
        return [
            [m.mode_index, m.standard_mode, m.custom_mode, m.properties, m.mode_name]
            for m in heard_after(vehicle, "AVAILABLE_MODES", 1.0)
        ]

    measured = MEASURED["available_modes"]
    vehicle.command(REQUEST, 435.0, 0.0)
    all_listed = listed()
    assert all_listed[: len(measured)] == measured[: len(all_listed)]
    vehicle.command(REQUEST, 435.0, 5.0)
    assert listed() == [measured[4]]


# ---------------------------------------------------------------- intervals


@pytest.mark.parametrize(("message_id", "interval_us", "result"), MEASURED["set_interval"])
def test_an_interval_can_be_set_or_not(
    vehicle: Vehicle, message_id: int, interval_us: float, result: int
) -> None:
    vehicle.link.run(0.1)
    assert vehicle.ask(SET_INTERVAL, message_id, interval_us) == result
    vehicle.ask(SET_INTERVAL, message_id, 0)


def test_a_stream_follows_its_interval(vehicle: Vehicle) -> None:
    def rate_hz(interval_us: float) -> float:
        assert vehicle.ask(SET_INTERVAL, 32, interval_us) == 0
        vehicle.link.run(0.2)
        before, from_s = vehicle.link.counts[32], vehicle.link.now_s
        vehicle.link.run(2.0)
        return (vehicle.link.counts[32] - before) / (vehicle.link.now_s - from_s)

    def told_us() -> float:
        assert vehicle.ask(GET_INTERVAL, 32) == 0
        intervals = heard_after(vehicle, "MESSAGE_INTERVAL")
        intervals += [h.message for h in vehicle.link.since(0.0, "MESSAGE_INTERVAL")]
        return float(intervals[-1].interval_us)

    vehicle.link.run(0.1)
    assert rate_hz(20_000) == pytest.approx(MEASURED["interval_rates_hz"]["32 at 20000 us"], abs=2)
    assert told_us() == 20_000
    # The mock's tick is 10 ms: no stream is faster than 100 Hz. PX4 sent 125 a second.
    fastest_hz = MEASURED["interval_rates_hz"]["32 at 5000 us"]
    assert 0.75 * fastest_hz < rate_hz(5_000) < 1.05 * fastest_hz
    assert rate_hz(-1) == 0.0
    assert told_us() == -1
    assert rate_hz(0) == pytest.approx(30.0, abs=2)
    assert told_us() == 33_333


# ---------------------------------------------------------------- parameters


def read(vehicle: Vehicle, name: str, index: int = -1, system: int | None = None) -> list[Heard]:
    from_s = vehicle.link.now_s
    vehicle.link.send(
        mavlink.MAVLink_param_request_read_message(
            system or vehicle.link.system, 1, name.encode(), index
        )
    )
    vehicle.link.run(0.2)
    return vehicle.link.since(from_s, "PARAM_VALUE") + vehicle.link.since(from_s, "PARAM_ERROR")


def write(vehicle: Vehicle, name: str, wire: float, kind: int, component: int = 1) -> list[Heard]:
    from_s = vehicle.link.now_s
    message = mavlink.MAVLink_param_set_message(
        vehicle.link.system, component, name.encode(), wire, kind
    )
    vehicle.link.send(message)
    vehicle.link.run(0.2)
    return vehicle.link.since(from_s, "PARAM_VALUE") + vehicle.link.since(from_s, "PARAM_ERROR")


def bytewise(value: int) -> float:
    wire: float = struct.unpack("<f", struct.pack("<i", value))[0]
    return wire


def test_the_list_is_alphabetical_complete_and_begins_with_the_hash(vehicle: Vehicle) -> None:
    vehicle.link.run(0.1)
    from_s = vehicle.link.now_s
    vehicle.link.send(mavlink.MAVLink_param_request_list_message(vehicle.link.system, 1))
    vehicle.link.run(3.0)
    answers = vehicle.link.since(from_s, "PARAM_VALUE")
    first, *rest = [answer.message for answer in answers]
    assert (first.param_id, first.param_index, first.param_type) == ("_HASH_CHECK", 65535, 5)
    assert [m.param_index for m in rest] == list(range(first.param_count))
    assert [m.param_id for m in rest] == sorted(m.param_id for m in rest)
    assert {m.param_type for m in rest} == {6, 9}
    assert answers[-1].at_s - from_s < 1.0 + MEASURED["parameters"]["list_within_s"]


def test_parameters_are_read_by_name_and_index_integers_byte_by_byte(vehicle: Vehicle) -> None:
    vehicle.link.run(0.1)
    (speed,) = read(vehicle, "MPC_XY_VEL_MAX")
    assert speed.message.param_type == 9
    (again,) = read(vehicle, "", speed.message.param_index)
    assert again.message.param_id == "MPC_XY_VEL_MAX"
    (whole,) = read(vehicle, "MAV_TYPE")
    assert whole.message.param_type == 6
    assert decoded(whole.message) == 2
    (hashed,) = read(vehicle, "_HASH_CHECK")
    assert hashed.message.param_index == 65535


def test_a_changed_parameter_is_told_twice_an_unchanged_one_once(
    vehicle: Vehicle, needs: Needs
) -> None:
    needs("parameters")
    vehicle.link.run(0.1)
    before = read(vehicle, "MPC_XY_VEL_MAX")[0].message.param_value
    changed = write(vehicle, "MPC_XY_VEL_MAX", before - 1.0, 9)
    assert [c.message.param_value for c in changed] == [before - 1.0] * 2
    assert changed[1].at_s - changed[0].at_s < 0.06
    back = write(vehicle, "MPC_XY_VEL_MAX", before, 9, component=0)
    assert [b.message.param_value for b in back] == [before] * 2
    assert len(write(vehicle, "MPC_XY_VEL_MAX", before, 9)) == 1


def test_no_value_is_out_of_range(vehicle: Vehicle, needs: Needs) -> None:
    needs("parameters")
    vehicle.link.run(0.1)
    before = read(vehicle, "MPC_XY_VEL_MAX")[0].message.param_value
    assert write(vehicle, "MPC_XY_VEL_MAX", 1000.0, 9)[0].message.param_value == 1000.0
    write(vehicle, "MPC_XY_VEL_MAX", before, 9)


def test_unknown_names_and_wrong_types_are_parameter_errors(vehicle: Vehicle) -> None:
    vehicle.link.run(0.1)
    for (answer,), error in (
        (read(vehicle, "NO_SUCH_PARAM"), 1),
        (read(vehicle, "", 9999), 1),
        (write(vehicle, "NO_SUCH_PARAM", 1.0, 9), 1),
        (write(vehicle, "COM_RC_IN_MODE", 4.0, 9), 7),
    ):
        assert message_name(answer.message_id) == "PARAM_ERROR"
        assert answer.message.error == error
        assert (answer.message.target_system, answer.message.target_component) == (245, 190)
    assert read(vehicle, "MPC_XY_VEL_MAX", system=77) == []


# ---------------------------------------------------------------- time and missions


def test_time_is_synchronised_to_the_boot_clock(vehicle: Vehicle) -> None:
    vehicle.link.run(0.5)
    vehicle.link.send(mavlink.MAVLink_timesync_message(0, 1_795_314_010_501_929_472))
    answers = [m for m in heard_after(vehicle, "TIMESYNC") if m.tc1 != 0]
    assert [a.ts1 for a in answers] == [1_795_314_010_501_929_472]
    assert answers[0].tc1 * 1e-9 == pytest.approx(vehicle.link.now_s, abs=0.5)
    asked = [m for m in heard_after(vehicle, "TIMESYNC", 1.0) if m.tc1 == 0]
    assert asked[-1].ts1 * 1e-9 == pytest.approx(vehicle.link.now_s, abs=0.3)


def test_a_ping_to_nobody_is_echoed_an_addressed_one_is_not(vehicle: Vehicle) -> None:
    vehicle.link.run(0.1)
    vehicle.link.send(mavlink.MAVLink_ping_message(123_456_789, 7, 0, 0))
    pongs = [m for m in heard_after(vehicle, "PING") if m.target_system == 245]
    assert [(p.time_usec, p.seq, p.target_component) for p in pongs] == [(123_456_789, 7, 190)]
    vehicle.link.send(mavlink.MAVLink_ping_message(1, 8, vehicle.link.system, 1))
    assert [m for m in heard_after(vehicle, "PING", 1.0) if m.target_system == 245] == []


def test_system_time_is_the_calendar_beside_the_boot_clock(vehicle: Vehicle) -> None:
    told = heard_after(vehicle, "SYSTEM_TIME", 2.2)
    assert len(told) >= 2
    assert told[-1].time_unix_usec > 1.6e15
    assert told[-1].time_boot_ms * 1e-3 == pytest.approx(vehicle.link.now_s, abs=1.2)


def test_an_empty_mission_is_told_again_until_it_is_acknowledged(vehicle: Vehicle) -> None:
    vehicle.link.run(0.1)
    from_s = vehicle.link.now_s
    vehicle.link.send(mavlink.MAVLink_mission_request_list_message(vehicle.link.system, 1, 0))
    vehicle.link.run(0.9)
    counts = vehicle.link.since(from_s, "MISSION_COUNT")
    measured = MEASURED["mission_count"]
    assert [c.message.count for c in counts] == [0] * measured["times"]
    steps = [b.at_s - a.at_s for a, b in itertools.pairwise(counts)]
    assert steps == pytest.approx([measured["again_s"]] * len(steps), abs=0.05)


# ---------------------------------------------------------------- setpoints

FRAMES = {
    "frame1_LOCAL_NED": (1, 1),
    "frame8_BODY_NED": (8, 1),
    "frame9_BODY_OFFSET_NED": (9, 1),
    "frame12_BODY_FRD": (12, 1),
    "frame7_LOCAL_OFFSET_NED": (7, 1),
    "frame20_LOCAL_FRD": (20, 1),
    "wrong_target_sysid": (1, 77),
    "target_sysid0": (1, 0),
    "nan_velocity": (1, 1),
    "all_ignored_mask": (1, 1),
}


@pytest.mark.parametrize("name", MEASURED["setpoints"])
def test_only_some_setpoints_count(vehicle: Vehicle, needs: Needs, name: str) -> None:
    needs("flight")
    frame, target = FRAMES[name]
    system = vehicle.link.system if target == 1 else target
    mask = 0xDFF if name == "all_ignored_mask" else 0x5C7
    north = math.nan if name == "nan_velocity" else 0.4
    result, mode, velocity, texts = MEASURED["setpoints"][name]

    def send() -> None:
        vehicle.link.send(
            mavlink.MAVLink_set_position_target_local_ned_message(
                *(0, system, 1, frame, mask, 0.0, 0.0, 0.0, north, 0.0, 0.0),
                *(0.0, 0.0, 0.0, 0.0, 0.0),
            )
        )

    vehicle.prepare("hover")
    from_s = vehicle.link.now_s
    vehicle.stream_of(send, 16.0)
    vehicle.link.run(1.0)
    assert vehicle.ask(176, 1.0, 6.0, 0.0) == result
    vehicle.link.run(3.5)
    said = {h.message.text for h in vehicle.link.since(from_s, "STATUSTEXT")}
    assert said == set(texts)
    assert vehicle.mode == ("OFFBOARD" if mode == "OFFBOARD" else "HOLD")
    assert math.hypot(*vehicle.velocity_ned_m_s[:2]) == pytest.approx(
        math.hypot(*velocity[:2]), abs=0.1
    )


# ---------------------------------------------------------------- ranges of a companion


def test_a_companions_range_comes_back_as_the_autopilots_own(vehicle: Vehicle) -> None:
    def send(looks: int, distance_cm: int) -> None:
        vehicle.link.send(
            mavlink.MAVLink_distance_sensor_message(
                *(0, 20, 500, distance_cm, 0, 7, looks, 255, 0.05, 0.05, [0.0] * 4, 80)
            ),
            (1, 158),
        )

    vehicle.link.run(0.1)
    vehicle.link.repeat("range", lambda: send(0, 123), 0.05)
    echoes = [m for m in heard_after(vehicle, "DISTANCE_SENSOR", 4.0) if m.orientation == 0]
    assert len(echoes) == pytest.approx(40, abs=4)
    echo = echoes[-1]
    assert (echo.current_distance, echo.max_distance) == (123, 500)
    assert (echo.min_distance, echo.signal_quality) == (19, 79)
    assert (echo.id, echo.type, echo.covariance) == (1, 0, 255)
    assert echo.horizontal_fov == pytest.approx(0.05)
    assert echo.time_boot_ms * 1e-3 == pytest.approx(vehicle.link.now_s, abs=0.3)


def test_three_ranges_of_one_companion_share_ten_a_second(vehicle: Vehicle) -> None:
    looks = iter([(0, 123), (2, 200), (6, 300)] * 200)

    def send() -> None:
        orientation, distance_cm = next(looks)
        vehicle.link.send(
            mavlink.MAVLink_distance_sensor_message(
                *(0, 20, 500, distance_cm, 0, 7, orientation, 255, 0.05, 0.05, [0.0] * 4, 80)
            ),
            (1, 158),
        )

    vehicle.link.run(0.1)
    vehicle.link.repeat("range", send, 0.05)
    echoes = [m for m in heard_after(vehicle, "DISTANCE_SENSOR", 6.0) if m.orientation != 25]
    assert len(echoes) == pytest.approx(60, abs=6)
    assert {m.id for m in echoes} == {1}
    for orientation in (0, 2, 6):
        assert sum(m.orientation == orientation for m in echoes) == pytest.approx(20, abs=5)
