"""What the mock PX4 answers: commands, setpoints, parameters, time and pings.

Pure request and response over decoded messages; results and texts as measured on PX4 main
bb59c637cd, SIH quadrotor, 2026-11.
"""

import itertools
import math
import struct
from collections import deque
from collections.abc import Callable, Collection, Iterator, Sequence

from pymavlink.dialects.v20 import development as mavlink

from hal.frames import Vector3, ned_from_geodetic
from hal.sim.mock_px4_files import file_answer, no_logs
from hal.sim.mock_px4_housekeeping import available_modes
from hal.sim.mock_px4_mission import MissionProtocol, Transfer
from hal.sim.mock_px4_plant import Plant
from hal.sim.mock_px4_ranges import RangeEcho
from hal.sim.mock_px4_streams import ON_REQUEST, Message, Schedule
from hal.sim.px4 import AutopilotText, Mode, Result, Severity

COMPONENT_ID = 1
REFUSABLE = ("arm", "offboard")
"""What a `Protocol` can be told to refuse: arming, and switching to OFFBOARD."""
_FORCE_MAGIC = 21196.0
_CUSTOM_MODE_FLAG = 1
_TEXT_BYTES = 50
_PARAMETERS_PER_TICK = 11
_PARAMETER_ECHO_S = 0.015
_INT32, _REAL32 = 6, 9
_HASH_CHECK = 7.403997877920988e30
_POSITION_BITS, _VELOCITY_BITS = (1, 2, 4), (8, 16, 32)
_YAW_BIT, _YAW_RATE_BIT = 1024, 2048
_UNKNOWN_PARAMETER, _WRONG_TYPE = 1, 7
_WITHOUT_TAB = ("Preflight", "Cleared")
_PROGRESS_UNKNOWN = 255
_GRIPPER_S = 1.0
# REQUEST_MESSAGE accepts these, and nothing comes.
_TAKEN_BUT_NOT_SENT = frozenset(
    {mavlink.MAVLINK_MSG_ID_MANUAL_CONTROL, mavlink.MAVLINK_MSG_ID_PING}
)
_STANDARD_MODES = {5: Mode.RETURN, 6: Mode.MISSION, 7: Mode.LAND, 8: Mode.TAKEOFF}


class Conversation:
    """One peer on the link: what it said of itself, and what is still to be sent to it."""

    def __init__(self) -> None:
        self.schedule = Schedule()
        self.transfer = Transfer()
        self.gcs_heard_s = -math.inf
        self.parameter_list: Iterator[Message] = iter(())
        self.delayed: deque[tuple[float, Message]] = deque()

    def hears_texts(self, now_s: float) -> bool:
        """PX4 sends status texts only where a ground station's heartbeat arrives."""
        return now_s - self.gcs_heard_s < 3.0

    def pending(self, now_s: float) -> list[Message]:
        """What is due of the things promised earlier."""
        due = list(itertools.islice(self.parameter_list, _PARAMETERS_PER_TICK))
        while self.delayed and self.delayed[0][0] <= now_s:
            due.append(self.delayed.popleft()[1])
        return due


class Protocol:
    """Answers decoded messages of any peer for one vehicle.

    `refused` names what it refuses whatever its state: see `REFUSABLE`.
    """

    def __init__(self, plant: Plant, system_id: int, refused: Collection[str] = ()) -> None:
        self._plant = plant
        self._system_id = system_id
        self._refused = frozenset(refused)
        self.range_echo = RangeEcho(len(plant.beams_config.mounts))
        self._handlers: dict[str, Callable[[Message, Conversation], list[Message]]] = {
            "HEARTBEAT": self._heartbeat,
            "COMMAND_LONG": self._command_long,
            "COMMAND_INT": self._command_int,
            "SET_POSITION_TARGET_LOCAL_NED": self._setpoint,
            "PARAM_REQUEST_LIST": self._parameter_list,
            "PARAM_REQUEST_READ": self._parameter_read,
            "PARAM_SET": self._parameter_set,
            "TIMESYNC": self._timesync,
            "DISTANCE_SENSOR": self._distance,
            "PING": self._ping,
            "FILE_TRANSFER_PROTOCOL": lambda message, _: file_answer(message),
            "LOG_REQUEST_LIST": lambda message, _: no_logs(message),
        }
        self.missions = MissionProtocol(plant)
        for name, handler in self.missions.handlers.items():
            self._handlers[name] = self._on_transfer(handler)
        pilot = plant.autopilot
        self._commands: dict[int, Callable[[Sequence[float]], Result]] = {
            mavlink.MAV_CMD_COMPONENT_ARM_DISARM: self._arm_or_disarm,
            mavlink.MAV_CMD_NAV_TAKEOFF: lambda p: pilot.takeoff(p[6]),
            mavlink.MAV_CMD_NAV_LAND: lambda _: pilot.land(),
            mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH: lambda _: pilot.return_to_launch(),
            mavlink.MAV_CMD_DO_SET_MODE: self._set_mode,
            mavlink.MAV_CMD_DO_REPOSITION: self._reposition,
            mavlink.MAV_CMD_MISSION_START: lambda p: pilot.start_mission(_whole(p[0], 0)),
            mavlink.MAV_CMD_DO_SET_MISSION_CURRENT: self._set_mission_current,
            mavlink.MAV_CMD_PREFLIGHT_REBOOT_SHUTDOWN: lambda _: Result.DENIED,
            mavlink.MAV_CMD_PREFLIGHT_STORAGE: lambda _: Result.ACCEPTED,
            mavlink.MAV_CMD_RUN_PREARM_CHECKS: lambda _: pilot.report_health(),
            mavlink.MAV_CMD_DO_CHANGE_SPEED: lambda _: Result.ACCEPTED,
            mavlink.MAV_CMD_DO_SET_HOME: lambda _: Result.ACCEPTED,
            mavlink.MAV_CMD_DO_FLIGHTTERMINATION: self._terminate,
            mavlink.MAV_CMD_DO_GRIPPER: lambda _: Result.IN_PROGRESS,
            mavlink.MAV_CMD_DO_ORBIT: lambda _: pilot.set_mode(Mode.ORBIT.main, Mode.ORBIT.sub),
            mavlink.MAV_CMD_DO_SET_STANDARD_MODE: self._set_standard_mode,
            mavlink.MAV_CMD_INJECT_FAILURE: self._inject_failure,
        }

    def handle(self, message: Message, conversation: Conversation) -> list[Message]:
        """The answers to one message; nothing for one that is unknown or for somebody else."""
        handler = self._handlers.get(message.get_type())
        if handler is None or not self._for_me(message):
            return []
        return handler(message, conversation)

    def _for_me(self, message: Message) -> bool:
        system = getattr(message, "target_system", 0)
        component = getattr(message, "target_component", 0)
        return system in (0, self._system_id) and component in (0, COMPONENT_ID)

    @staticmethod
    def _on_transfer(
        handler: Callable[[Message, Transfer], list[Message]],
    ) -> Callable[[Message, Conversation], list[Message]]:
        return lambda message, conversation: handler(message, conversation.transfer)

    def pending(self, conversation: Conversation, now_s: float) -> list[Message]:
        """What is due to one peer of the things promised earlier."""
        return conversation.pending(now_s) + self.missions.pending(conversation.transfer)

    def _heartbeat(self, message: Message, conversation: Conversation) -> list[Message]:
        pilot = self._plant.autopilot
        if message.type == mavlink.MAV_TYPE_GCS:
            conversation.gcs_heard_s = pilot.now_s
            pilot.ground_station.hear(pilot.now_s)
        elif message.type == mavlink.MAV_TYPE_ONBOARD_CONTROLLER:
            pilot.companion.hear(pilot.now_s)
        return []

    # ------------------------------------------------------------ commands

    def _command_long(self, message: Message, conversation: Conversation) -> list[Message]:
        parameters = [getattr(message, f"param{i}") for i in range(1, 8)]
        return self._answer(message, parameters, conversation)

    def _command_int(self, message: Message, conversation: Conversation) -> list[Message]:
        parameters = [getattr(message, f"param{i}") for i in range(1, 5)]
        parameters += [message.x * 1e-7, message.y * 1e-7, message.z]
        return self._answer(message, parameters, conversation)

    def _answer(
        self, message: Message, parameters: Sequence[float], conversation: Conversation
    ) -> list[Message]:
        command = message.command
        extra: list[Message] = []
        if command == mavlink.MAV_CMD_REQUEST_MESSAGE:
            result, extra = self._request_message(parameters, conversation)
        elif command == mavlink.MAV_CMD_SET_MESSAGE_INTERVAL:
            result = self._set_interval(parameters, conversation)
        elif command == mavlink.MAV_CMD_GET_MESSAGE_INTERVAL:
            result, extra = Result.ACCEPTED, [self._interval(parameters[0], conversation)]
        elif command in self._commands:
            result = self._commands[command](parameters)
        else:
            result = Result.UNSUPPORTED
        who = (message.get_srcSystem(), message.get_srcComponent())
        if result is Result.IN_PROGRESS:
            done = mavlink.MAVLink_command_ack_message(command, int(Result.ACCEPTED), 0, 0, *who)
            conversation.delayed.append((self._plant.autopilot.now_s + _GRIPPER_S, done))
        progress = _PROGRESS_UNKNOWN if result is Result.IN_PROGRESS else 0
        acknowledgement = mavlink.MAVLink_command_ack_message(
            command, int(result), progress, 0, *who
        )
        return [acknowledgement, *extra]

    def _arm_or_disarm(self, parameters: Sequence[float]) -> Result:
        pilot = self._plant.autopilot
        if parameters[0] == 1.0:
            return self._refuse("Arming denied") if "arm" in self._refused else pilot.arm()
        if parameters[0] == 0.0:
            return pilot.disarm(force=parameters[1] == _FORCE_MAGIC)
        return Result.DENIED

    def _set_mode(self, parameters: Sequence[float]) -> Result:
        pilot = self._plant.autopilot
        base, main, sub = (_whole(value, 0) for value in parameters[:3])
        if not base & _CUSTOM_MODE_FLAG:
            pilot.say(Severity.CRITICAL, "Unsupported base mode")
            return Result.TEMPORARILY_REJECTED
        if "offboard" in self._refused and main == Mode.OFFBOARD.main:
            return self._refuse("Switching to Offboard is currently not available")
        return pilot.set_mode(main, sub)

    def _set_standard_mode(self, parameters: Sequence[float]) -> Result:
        mode = _STANDARD_MODES.get(_whole(parameters[0]))
        if mode is None:
            return Result.FAILED
        return self._plant.autopilot.set_mode(mode.main, mode.sub)

    def _terminate(self, parameters: Sequence[float]) -> Result:
        return self._plant.autopilot.terminate() if parameters[0] > 0.5 else Result.DENIED

    def _inject_failure(self, parameters: Sequence[float]) -> Result:
        """Only the end of a failure of the gyro was measured."""
        if any(parameters[:2]):
            return Result.UNSUPPORTED
        self._plant.autopilot.say(Severity.INFO, "Cleared: gyro, all instances")
        return Result.ACCEPTED

    def _refuse(self, text: str) -> Result:
        self._plant.autopilot.say(Severity.CRITICAL, text)
        return Result.TEMPORARILY_REJECTED

    def _reposition(self, parameters: Sequence[float]) -> Result:
        pilot = self._plant.autopilot
        lat, lon, amsl = parameters[4:7]
        if not (math.isfinite(lat) and math.isfinite(lon)):
            return pilot.hold_at((math.nan, math.nan, pilot.origin[2] - amsl))
        return pilot.hold_at(ned_from_geodetic(lat, lon, amsl, pilot.origin))

    def _set_mission_current(self, parameters: Sequence[float]) -> Result:
        found = self._plant.autopilot.mission.set_current(_whole(parameters[0], 0))
        return Result.ACCEPTED if found else Result.DENIED

    def _request_message(
        self, parameters: Sequence[float], conversation: Conversation
    ) -> tuple[Result, list[Message]]:
        wanted = _whole(parameters[0])
        if wanted == mavlink.MAVLINK_MSG_ID_MESSAGE_INTERVAL:
            return Result.ACCEPTED, [self._interval(parameters[1], conversation)]
        if wanted == mavlink.MAVLINK_MSG_ID_AVAILABLE_MODES:
            modes = available_modes(parameters[1])
            return (Result.ACCEPTED if modes else Result.DENIED), modes
        if wanted in _TAKEN_BUT_NOT_SENT:
            return Result.ACCEPTED, []
        build = ON_REQUEST.get(wanted)
        message = build(self._plant) if build is not None else None
        return (Result.DENIED, []) if message is None else (Result.ACCEPTED, [message])

    def _set_interval(self, parameters: Sequence[float], conversation: Conversation) -> Result:
        message_id = _whole(parameters[0])
        if not conversation.schedule.known(message_id) or not math.isfinite(parameters[1]):
            return Result.FAILED
        conversation.schedule.set_interval(message_id, parameters[1])
        return Result.ACCEPTED

    def _interval(self, message_id: float, conversation: Conversation) -> Message:
        wanted = _whole(message_id)
        return mavlink.MAVLink_message_interval_message(
            wanted, conversation.schedule.interval_us(wanted)
        )

    # ------------------------------------------------------------ setpoints

    def _setpoint(self, message: Message, _conversation: Conversation) -> list[Message]:
        pilot = self._plant.autopilot
        frame, mask = message.coordinate_frame, message.type_mask
        if frame not in (mavlink.MAV_FRAME_LOCAL_NED, mavlink.MAV_FRAME_BODY_NED):
            pilot.say(
                Severity.CRITICAL,
                f"SET_POSITION_TARGET_LOCAL_NED coordinate frame {frame} unsupported",
            )
            return []
        position = _masked((message.x, message.y, message.z), mask, _POSITION_BITS)
        velocity = _masked((message.vx, message.vy, message.vz), mask, _VELOCITY_BITS)
        yaw = math.nan if mask & _YAW_BIT else message.yaw
        rate = math.nan if mask & _YAW_RATE_BIT else message.yaw_rate
        body = frame == mavlink.MAV_FRAME_BODY_NED
        if _free(velocity) and (body or _free(position)):
            pilot.say(Severity.CRITICAL, "SET_POSITION_TARGET_LOCAL_NED invalid")
        elif body:
            pilot.set_body_setpoint(velocity, yaw, rate)
        else:
            pilot.set_setpoint(position, velocity, yaw, rate)
        return []

    # ------------------------------------------------------------ parameters

    def _parameter(self, name: str) -> Message:
        parameters = self._plant.autopilot.parameters
        value = parameters[name]
        kind = _INT32 if isinstance(value, int) else _REAL32
        return mavlink.MAVLink_param_value_message(
            name.encode(), encode_value(value), kind, len(parameters), parameters.index(name)
        )

    def _parameter_list(self, _message: Message, conversation: Conversation) -> list[Message]:
        names = self._plant.autopilot.parameters.names
        conversation.parameter_list = (self._parameter(name) for name in names)
        return [_hash_check(len(names))]

    def _parameter_read(self, message: Message, _conversation: Conversation) -> list[Message]:
        names = self._plant.autopilot.parameters.names
        name = message.param_id
        if name == "_HASH_CHECK":
            return [_hash_check(len(names))]
        if message.param_index >= 0:
            name = names[message.param_index] if message.param_index < len(names) else ""
        if name not in self._plant.autopilot.parameters:
            return [_parameter_error(message, message.param_id, _UNKNOWN_PARAMETER)]
        return [self._parameter(name)]

    def _parameter_set(self, message: Message, conversation: Conversation) -> list[Message]:
        pilot, name = self._plant.autopilot, message.param_id
        if name not in pilot.parameters:
            return [_parameter_error(message, name, _UNKNOWN_PARAMETER)]
        old = pilot.parameters[name]
        if message.param_type != (_INT32 if isinstance(old, int) else _REAL32):
            return [_parameter_error(message, name, _WRONG_TYPE)]
        new = decode_value(message.param_value, message.param_type)
        pilot.set_parameter(name, new)
        answer = self._parameter(name)
        if new != old:
            conversation.delayed.append((pilot.now_s + _PARAMETER_ECHO_S, answer))
        return [answer]

    # ------------------------------------------------------------ the rest

    def _timesync(self, message: Message, _conversation: Conversation) -> list[Message]:
        if message.tc1 != 0:
            return []
        boot_ns = round(self._plant.autopilot.uptime_s * 1e9)
        return [mavlink.MAVLink_timesync_message(boot_ns, message.ts1)]

    def _distance(self, message: Message, _conversation: Conversation) -> list[Message]:
        self.range_echo.take(message)
        return []

    def _ping(self, message: Message, _conversation: Conversation) -> list[Message]:
        if message.target_system != 0 or message.target_component != 0:
            return []
        return [
            mavlink.MAVLink_ping_message(
                message.time_usec,
                message.seq,
                message.get_srcSystem(),
                message.get_srcComponent(),
            )
        ]


def _whole(value: float, otherwise: int = -1) -> int:
    """A number that stands for an id; what is not a number stands for `otherwise` (none)."""
    return int(value) if math.isfinite(value) else otherwise


def _masked(vector: Vector3, mask: int, bits: tuple[int, int, int]) -> Vector3:
    """`vector` with the components that the mask ignores left free (NaN)."""
    x, y, z = (math.nan if mask & bit else v for v, bit in zip(vector, bits, strict=True))
    return (x, y, z)


def _free(vector: Vector3) -> bool:
    return all(math.isnan(component) for component in vector)


def _hash_check(count: int) -> Message:
    return mavlink.MAVLink_param_value_message(b"_HASH_CHECK", _HASH_CHECK, 5, count, 65535)


def _parameter_error(message: Message, name: str, error: int) -> Message:
    return mavlink.MAVLink_param_error_message(
        message.get_srcSystem(), message.get_srcComponent(), name.encode(), -1, error
    )


def encode_value(value: float) -> float:
    """A parameter as the float on the wire; integers are laid into its bytes."""
    if isinstance(value, int):
        (wire,) = struct.unpack("<f", struct.pack("<i", value))
        return float(wire)
    return value


def decode_value(wire: float, kind: int) -> int | float:
    """The inverse of `encode_value`."""
    if kind == _INT32:
        (value,) = struct.unpack("<i", struct.pack("<f", wire))
        return int(value)
    return wire


def text_messages(text: AutopilotText, identity: int) -> list[Message]:
    """STATUSTEXT as PX4 sends it: a TAB at the end, in chunks of 50 bytes."""
    words = text.text if text.text.startswith(_WITHOUT_TAB) else text.text + "\t"
    data = words.encode()
    if len(data) < _TEXT_BYTES:
        return [mavlink.MAVLink_statustext_message(int(text.severity), data, identity, 0)]
    chunks = [data[i : i + _TEXT_BYTES] for i in range(0, len(data), _TEXT_BYTES)]
    return [
        mavlink.MAVLink_statustext_message(int(text.severity), chunk, identity, number)
        for number, chunk in enumerate(chunks)
    ]


__all__ = [
    "COMPONENT_ID",
    "REFUSABLE",
    "Conversation",
    "Protocol",
    "decode_value",
    "encode_value",
    "text_messages",
]
