import math
from collections import Counter
from typing import Any

import pytest
from pymavlink.dialects.v20 import development as mavlink

from hal.config import BeamMount, BeamsConfig
from hal.frames import geodetic_from_ned
from hal.readings import RangeReading, RangeStatus
from hal.sim.mock_px4_messages import LAYOUTS, unpack
from hal.sim.mock_px4_plant import Plant, truth_record
from hal.sim.mock_px4_protocol import (
    Conversation,
    Protocol,
    decode_value,
    encode_value,
    text_messages,
)
from hal.sim.mock_px4_ranges import BeamEncoder, orientation
from hal.sim.mock_px4_streams import STREAMS, Schedule
from hal.sim.px4 import AutopilotText, Mode, Severity
from hal.sim.scenario import Scenario, load_scenario
from tests.support.px4 import facts, scenario

FACTS = facts()
NAN = math.nan


class Client:
    """A ground station that talks to the protocol without a wire but with real frames."""

    def __init__(self, *, system_id: int = 1, refused: tuple[str, ...] = ()) -> None:
        self.plant = Plant(scenario(0.2), BeamsConfig(), seed=1)
        self.pilot = self.plant.autopilot
        self.plant.step(0.01)
        self.conversation = Conversation()
        self._protocol = Protocol(self.plant, system_id, refused)
        self._codec = mavlink.MAVLink(None, srcSystem=245, srcComponent=190)
        self._vehicle = mavlink.MAVLink(None, srcSystem=system_id, srcComponent=1)

    def send(self, message: Any) -> list[Any]:
        """The answers, each through its frame."""
        (received,) = self._codec.parse_buffer(message.pack(self._codec))
        answers = self._protocol.handle(received, self.conversation)
        return [self._vehicle.parse_buffer(a.pack(self._vehicle))[0] for a in answers]

    def command(self, command: int, *parameters: float, system: int = 1, component: int = 1) -> Any:
        """The acknowledgement and what came with it."""
        padded = (*parameters, *(NAN,) * (7 - len(parameters)))
        return self.send(
            mavlink.MAVLink_command_long_message(system, component, command, 0, *padded)
        )

    def result(self, command: int, *parameters: float) -> int:
        answers = self.command(command, *parameters)
        assert answers[0].get_type() == "COMMAND_ACK"
        assert answers[0].command == command
        assert (answers[0].target_system, answers[0].target_component) == (245, 190)
        return int(answers[0].result)

    def setpoint(self, frame: int, mask: int, *values: float) -> None:
        fields = (*values, *(0.0,) * (11 - len(values)))
        message = mavlink.MAVLink_set_position_target_local_ned_message(
            0, 1, 1, frame, mask, *fields
        )
        assert self.send(message) == []

    def fly(self, seconds: float) -> None:
        for _ in range(round(seconds / 0.01)):
            self.plant.step(0.01)

    def texts(self) -> list[str]:
        texts = [text.text for text in self.pilot.texts]
        self.pilot.texts.clear()
        return texts

    def take_off(self) -> None:
        assert self.result(400, 1.0) == 0
        assert self.result(22) == 0
        self.fly(12.0)


# ---------------------------------------------------------------- commands


@pytest.mark.parametrize(("command", "result"), FACTS["results"].items())
def test_commands_are_answered_as_measured(command: str, result: int) -> None:
    assert Client().result(int(command), 0.0) == result


def test_arm_take_off_and_land_by_commands() -> None:
    client = Client()
    client.take_off()
    assert client.pilot.mode is Mode.HOLD
    assert client.texts() == [
        "Armed by external command",
        "Using default takeoff altitude: 2.5 m",
        "Takeoff detected",
    ]
    assert client.result(400, 0.0) == 1
    assert client.result(21) == 0
    client.fly(14.0)
    assert not client.pilot.armed


def test_a_take_off_altitude_is_above_mean_sea_level() -> None:
    client = Client()
    client.result(400, 1.0)
    assert client.result(22, NAN, NAN, NAN, NAN, NAN, NAN, client.pilot.origin[2] + 1.2) == 0
    client.fly(14.0)
    assert client.pilot.quadrotor.height_m == pytest.approx(1.2, abs=0.1)


def test_it_can_be_told_to_refuse_arming() -> None:
    client = Client(refused=("arm",))
    assert client.result(400, 1.0) == 1
    assert not client.pilot.armed
    assert client.texts() == ["Arming denied"]


def test_it_can_be_told_to_refuse_offboard_and_nothing_else() -> None:
    client = Client(refused=("offboard",))
    client.take_off()
    client.texts()
    client.pilot.set_setpoint(velocity_ned_m_s=(0.0, 0.0, 0.0))
    assert client.result(176, 1.0, Mode.OFFBOARD.main) == 1
    assert client.pilot.mode is Mode.HOLD
    assert client.texts() == ["Switching to Offboard is currently not available"]
    assert client.result(176, 1.0, Mode.LAND.main, Mode.LAND.sub) == 0


def test_the_kill_needs_its_magic_number() -> None:
    client = Client()
    client.take_off()
    assert client.result(400, 0.0, 1.0) == 1
    assert client.pilot.armed
    assert client.result(400, 0.0, 21196.0) == 0
    assert not client.pilot.armed


def test_a_mode_needs_the_custom_flag() -> None:
    client = Client()
    assert client.result(176, 129.0, 6.0, 0.0) == 0
    assert client.pilot.mode is Mode.OFFBOARD
    assert client.result(176, 0.0, 4.0, 3.0) == 1
    assert client.result(176, 1.0, 77.0, 0.0) == 1
    assert client.texts() == ["Unsupported base mode", "Unsupported main mode"]


def test_repositioning_takes_geodetic_coordinates() -> None:
    client = Client()
    client.take_off()
    lat, lon, amsl = geodetic_from_ned((0.5, -0.5, -2.0), client.pilot.origin)
    message = mavlink.MAVLink_command_int_message(
        1, 1, 5, 192, 0, 0, -1, 1, 0, NAN, round(lat * 1e7), round(lon * 1e7), amsl
    )
    assert client.send(message)[0].result == 0
    client.fly(15.0)
    assert client.pilot.estimated_position_ned_m == pytest.approx((0.5, -0.5, -2.0), abs=0.08)


def test_commands_for_somebody_else_are_not_answered_at_all() -> None:
    client = Client()
    assert client.command(400, 1.0, system=9) == []
    assert client.command(400, 1.0, component=77) == []
    assert not client.pilot.armed
    assert client.command(400, 1.0, component=0)[0].result == 0


@pytest.mark.parametrize("message_id", [148, 242, 245, 49, 24, 32, 331])
def test_messages_can_be_requested(message_id: int) -> None:
    client = Client()
    client.fly(0.5)
    acknowledgement, message = client.command(512, float(message_id))
    assert acknowledgement.result == 0
    assert message.get_msgId() == message_id


@pytest.mark.parametrize("message_id", [9999.0, 340.0, 106.0, 330.0, NAN])
def test_messages_that_do_not_exist_are_denied(message_id: float) -> None:
    (acknowledgement,) = Client().command(512, message_id)
    assert acknowledgement.result == 2


def test_the_version_says_bytewise_parameters_and_local_setpoints() -> None:
    _, version = Client().command(512, 148.0)
    assert version.capabilities == 59647
    assert version.uid == 0x4954414C44494E4F


def test_intervals_are_set_read_stopped_and_restored() -> None:
    client = Client()
    assert client.result(511, 245.0, 1e6) == 0
    acknowledgement, interval = client.command(510, 245.0)
    assert acknowledgement.result == 0
    assert interval.interval_us == 1_000_000
    assert client.command(512, 244.0, 245.0)[1].interval_us == 1_000_000
    assert client.result(511, 132.0, -1.0) == 0
    assert not client.conversation.schedule.allows(132)
    assert client.result(511, 132.0, 0.0) == 0
    assert client.conversation.schedule.allows(132)
    for unavailable in (0.0, 9999.0):
        assert client.result(511, unavailable, 1e5) == 4


# ---------------------------------------------------------------- setpoints

IGNORE_POSITION, IGNORE_ACCELERATION, IGNORE_YAW, IGNORE_RATE = 7, 0x1C0, 1024, 2048
VELOCITY_ONLY = IGNORE_POSITION | IGNORE_ACCELERATION | IGNORE_RATE
EVERYTHING_IGNORED = 0x0DFF


@pytest.mark.parametrize(("frame", "result"), FACTS["setpoint_frames"].items())
def test_only_two_frames_count_as_a_setpoint(frame: str, result: int) -> None:
    client = Client()
    client.take_off()
    client.texts()
    client.setpoint(int(frame), VELOCITY_ONLY, 0, 0, 0, 0.3, 0, 0)
    expected = f"SET_POSITION_TARGET_LOCAL_NED coordinate frame {frame} unsupported"
    assert client.texts() == ([expected] if result else [])
    assert client.result(176, 1.0, 6.0, 0.0) == result


@pytest.mark.parametrize("frame", [1, 8])
@pytest.mark.parametrize("mask", [EVERYTHING_IGNORED, 0x0C3F])
def test_a_setpoint_without_position_and_velocity_is_invalid(frame: int, mask: int) -> None:
    client = Client()
    client.setpoint(frame, mask)
    assert client.texts() == ["SET_POSITION_TARGET_LOCAL_NED invalid"]


def test_a_position_in_the_body_frame_is_no_setpoint() -> None:
    client = Client()
    client.setpoint(8, 0x0DF8, 1.0, 0.0, 0.0)
    assert client.texts() == ["SET_POSITION_TARGET_LOCAL_NED invalid"]


def test_velocity_position_yaw_and_yaw_rate_are_flown() -> None:
    client = Client()
    client.take_off()

    def stream(seconds: float, frame: int, mask: int, *values: float) -> None:
        client.setpoint(frame, mask, *values)
        assert client.result(176, 1.0, 6.0, 0.0) == 0
        for _ in range(round(seconds / 0.1)):
            client.setpoint(frame, mask, *values)
            client.fly(0.1)

    stream(3.0, 1, VELOCITY_ONLY, 0, 0, 0, 0.0, 0.3, 0.0)
    assert client.pilot.quadrotor.velocity_ned_m_s[1] == pytest.approx(0.3, abs=0.05)
    both = IGNORE_ACCELERATION | IGNORE_RATE
    stream(12.0, 1, both, 0.4, 0.2, -2.0, 0, 0, 0, 0, 0, 0, 0.7)
    assert client.pilot.estimated_position_ned_m == pytest.approx((0.4, 0.2, -2.0), abs=0.08)
    assert client.pilot.estimated_yaw_rad == pytest.approx(0.7, abs=0.05)
    rate = IGNORE_POSITION | IGNORE_ACCELERATION | IGNORE_YAW
    stream(2.0, 1, rate, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0.3)
    assert client.pilot.quadrotor.yaw_rate_rad_s == pytest.approx(0.3, abs=0.02)


def test_a_body_velocity_drops_its_position_and_turns_with_the_heading() -> None:
    client = Client()
    client.take_off()
    client.pilot.set_setpoint(velocity_ned_m_s=(0.0, 0.0, 0.0), yaw_rad=math.pi / 2)
    client.result(176, 1.0, 6.0, 0.0)
    for _ in range(60):
        client.pilot.set_setpoint(velocity_ned_m_s=(0.0, 0.0, 0.0), yaw_rad=math.pi / 2)
        client.fly(0.1)
    for _ in range(30):
        client.setpoint(8, IGNORE_ACCELERATION | IGNORE_YAW, 50, 50, 50, 0.3, 0, 0)
        client.fly(0.1)
    north, east, down = client.pilot.quadrotor.velocity_ned_m_s
    assert east == pytest.approx(0.3, abs=0.05)
    assert north == pytest.approx(0.0, abs=0.05)
    assert down == pytest.approx(0.0, abs=0.05)


# ---------------------------------------------------------------- parameters


def read(client: Client, name: str, index: int = -1) -> Any:
    (answer,) = client.send(mavlink.MAVLink_param_request_read_message(1, 1, name.encode(), index))
    return answer


def write(client: Client, name: str, wire: float, kind: int) -> Any:
    (answer,) = client.send(mavlink.MAVLink_param_set_message(1, 1, name.encode(), wire, kind))
    return answer


def test_parameters_are_read_by_name_and_by_index() -> None:
    client = Client()
    by_name = read(client, "MPC_XY_P")
    assert by_name.param_value == pytest.approx(0.95)
    assert (by_name.param_type, by_name.param_count) == (9, 938)
    assert read(client, "", by_name.param_index).param_id == "MPC_XY_P"
    integer = read(client, "COM_RC_IN_MODE")
    assert integer.param_type == 6
    assert decode_value(integer.param_value, 6) == 1


def test_a_changed_parameter_is_told_twice_an_unchanged_one_once() -> None:
    client = Client()
    answer = write(client, "COM_OBL_RC_ACT", encode_value(5), 6)
    assert decode_value(answer.param_value, 6) == 5
    assert client.pilot.parameters["COM_OBL_RC_ACT"] == 5
    assert client.conversation.pending(client.pilot.now_s) == []
    client.fly(0.03)
    (echo,) = client.conversation.pending(client.pilot.now_s)
    assert echo.param_id == "COM_OBL_RC_ACT"
    write(client, "COM_OBL_RC_ACT", encode_value(5), 6)
    client.fly(0.03)
    assert client.conversation.pending(client.pilot.now_s) == []


def test_unknown_names_and_wrong_types_are_parameter_errors() -> None:
    client = Client()
    for answer, error in (
        (read(client, "NO_SUCH_PARAM"), 1),
        (read(client, "", 5000), 1),
        (write(client, "NO_SUCH_PARAM", 1.0, 9), 1),
        (write(client, "COM_OBL_RC_ACT", 5.0, 9), 7),
    ):
        assert answer.get_type() == "PARAM_ERROR"
        assert answer.error == error
    assert client.pilot.parameters["COM_OBL_RC_ACT"] == 0


def test_the_whole_list_is_sent_in_order_within_a_second() -> None:
    client = Client()
    (first,) = client.send(mavlink.MAVLink_param_request_list_message(1, 1))
    assert (first.param_id, first.param_index) == ("_HASH_CHECK", 65535)
    names: list[str] = []
    for _ in range(100):
        names += [m.param_id for m in client.conversation.pending(0.0)]
    assert tuple(names) == client.pilot.parameters.names


@pytest.mark.parametrize("value", [0, 1, -1, 5, 2**31 - 1, -(2**31), 1_000_000])
def test_integers_survive_being_laid_into_a_float(value: int) -> None:
    assert decode_value(encode_value(value), 6) == value


# ---------------------------------------------------------------- the rest


def test_time_and_pings_are_answered() -> None:
    client = Client()
    (answer,) = client.send(mavlink.MAVLink_timesync_message(0, 12345))
    assert (answer.ts1, answer.tc1) == (12345, round(client.pilot.now_s * 1e9))
    assert client.send(mavlink.MAVLink_timesync_message(7, 12345)) == []
    (pong,) = client.send(mavlink.MAVLink_ping_message(99, 4, 0, 0))
    assert (pong.time_usec, pong.seq, pong.target_system) == (99, 4, 245)
    assert client.send(mavlink.MAVLink_ping_message(99, 4, 1, 1)) == []


def test_there_is_no_mission() -> None:
    (count,) = Client().send(mavlink.MAVLink_mission_request_list_message(1, 1, 0))
    assert count.count == 0


def test_only_a_ground_stations_heartbeat_opens_the_texts() -> None:
    client = Client()
    for kind, hears in ((18, False), (6, True)):
        client.send(mavlink.MAVLink_heartbeat_message(kind, 8, 0, 0, 0, 3))
        assert client.conversation.hears_texts(client.pilot.now_s) is hears
    client.fly(4.0)
    assert not client.conversation.hears_texts(client.pilot.now_s)


def test_texts_end_in_a_tab_and_come_in_chunks_of_fifty() -> None:
    def chunks(text: str) -> list[str]:
        messages = text_messages(AutopilotText(0.0, Severity.INFO, text), 7)
        assert [m.chunk_seq for m in messages] == list(range(len(messages)))
        assert {m.id for m in messages} == {7}
        return [m.text for m in messages]

    assert chunks("Armed by external command") == ["Armed by external command\t"]
    assert chunks("Arming denied: Resolve system health failures first") == [
        "Arming denied: Resolve system health failures firs",
        "t\t",
    ]
    fifty = "RTL: start return at 496 m (7 m above destination)"
    assert chunks(fifty) == [fifty, "\t"]
    assert chunks("Preflight: GPS fix too low") == ["Preflight: GPS fix too low"]


def test_every_stream_keeps_its_rate_and_never_bursts() -> None:
    schedule, counts = Schedule(), Counter[str]()
    names = {n: m.msgname for n, m in mavlink.mavlink_map.items()}
    names |= {n: layout.name for n, layout in LAYOUTS.items()}
    for tick in range(1000):
        counts.update(names[s.message_id] for s in schedule.take_due(0.01 * tick))
    for name, rate_hz in FACTS["streams_hz"].items():
        if name != "GPS_RAW_INT":
            assert counts[name] / 10.0 == pytest.approx(rate_hz, rel=0.03)
    late = schedule.take_due(60.0)
    assert len(late) == len(STREAMS)
    assert schedule.take_due(60.005) == []


def test_every_stream_makes_a_message_that_can_be_sent() -> None:
    client = Client()
    client.take_off()
    codec = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    for stream in STREAMS:
        message = stream.build(client.plant)
        assert message is not None
        frame = bytes(message.pack(codec))
        back = unpack(frame) or codec.parse_buffer(frame)[0]
        assert back.get_msgId() == stream.message_id


@pytest.mark.parametrize(
    ("mount", "expected"),
    [
        (BeamMount(name="front"), 0),
        (BeamMount(name="front right", yaw_deg=45.0), 1),
        (BeamMount(name="right", yaw_deg=90.0), 2),
        (BeamMount(name="back", yaw_deg=180.0), 4),
        (BeamMount(name="left", yaw_deg=-90.0), 6),
        (BeamMount(name="up", pitch_deg=90.0), 24),
        (BeamMount(name="down", pitch_deg=-90.0), 25),
    ],
)
def test_beams_have_their_mavlink_orientation(mount: BeamMount, expected: int) -> None:
    assert orientation(mount) == expected


@pytest.mark.parametrize(
    ("status", "range_m", "expected_cm"),
    [
        (RangeStatus.VALID, 0.37, 37),
        (RangeStatus.VALID, 1.0, 100),
        (RangeStatus.OUT_OF_RANGE, 1.0, 101),
        (RangeStatus.TOO_NEAR, 0.02, 1),
        (RangeStatus.NO_SIGNAL, 0.0, None),
    ],
)
def test_readings_become_whole_centimetres(
    status: RangeStatus, range_m: float, expected_cm: int | None
) -> None:
    encoder = BeamEncoder(BeamsConfig().mounts, 0.0)
    message = encoder.encode(RangeReading(1.5, "left", status, range_m, 1e-4, 0.02, 1.0))
    if expected_cm is None:
        assert message is None
    else:
        assert message is not None
        assert message.current_distance == expected_cm
        assert (message.min_distance, message.max_distance) == (2, 100)
        assert (message.id, message.orientation, message.time_boot_ms) == (3, 6, 1500)
        assert message.covariance == 1


def test_the_truth_record_tells_clearance_and_who_is_in_the_air() -> None:
    plant = Plant(load_scenario("default"), BeamsConfig(), seed=1)
    plant.step(0.01)
    record = truth_record(plant)
    assert not record.in_air
    assert not record.collided
    assert record.clearance_m is not None
    assert record.clearance_m > 0.15
    empty = truth_record(Client().plant)
    assert empty.clearance_m is None


def test_a_fault_can_silence_the_position() -> None:
    silent = Scenario.model_validate(
        {"name": "silent", "faults": [{"kind": "position_silence", "start_s": 1.0}]}
    )
    plant = Plant(silent, BeamsConfig(), seed=1)
    for _ in range(200):
        plant.step(0.01)
    assert plant.position is None
    quiet = {stream.message_id for stream in STREAMS if stream.build(plant) is None}
    assert quiet == {32, 33, 331, 87}  # the last only in flight
