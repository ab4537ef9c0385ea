"""One vehicle on a link: brought to a known state, played a sequence, listened to."""

import math
import struct
from collections.abc import Callable
from typing import Any

from pymavlink.dialects.v20 import development as mavlink

from hal.frames import Vector3
from tests.conformance.link import COMPANION, STATION, Heard, Link, Message, MockLink
from tests.conformance.transcript import Seen, Sequence

_MODES = {
    0x00030000: "POSITION",
    0x00060000: "OFFBOARD",
    0x000A0000: "TERMINATION",
    0x02040000: "TAKEOFF",
    0x03040000: "HOLD",
    0x05040000: "RETURN",
    0x06040000: "LAND",
}
_ARMED = 128
_ARM, _TAKEOFF, _LAND, _SET_MODE, _REPOSITION = 400, 22, 21, 176, 192
_SET_INTERVAL = 511
_ARMABLE_S = 20.0
_NOT_NEEDED = (31, 36, 74, 83, 85, 87, 105, 111, 141, 290, 291, 331)
_HOLD, _OFFBOARD = (1.0, 4.0, 3.0), (1.0, 6.0, 0.0)
_VELOCITY_AND_YAW_RATE = 0x5C7
_INT32, _REAL32 = 6, 9
_WHO = {"ground station": STATION, "companion": COMPANION}
_TOLD = frozenset((0, 77, 245, 253, 410, 436))
"""What makes a transcript: HEARTBEAT, COMMAND_ACK, EXTENDED_SYS_STATE, STATUSTEXT, EVENT,
CURRENT_MODE."""


class Vehicle:
    """What a test can do with the vehicle, and what it can know."""

    def __init__(self, link: Link, event_names: dict[int, str]) -> None:
        self.link = link
        self._event_names = event_names
        self._changed: dict[str, float] = {}
        link.meet()
        link.beat(STATION)
        # PX4's simulated quadrotor stands still for 10 s a step in an Offboard that never had a
        # setpoint since the start: nothing drives its motors' outputs, on which its time waits.
        self.setpoint((0.0, 0.0, 0.0))

    # ------------------------------------------------------------ what is known

    @property
    def armed(self) -> bool:
        """As the last heartbeat says, up to a second late."""
        return bool(self._heartbeat().base_mode & _ARMED)

    @property
    def mode(self) -> str:
        """As the last heartbeat says."""
        return _mode_name(self._heartbeat().custom_mode)

    @property
    def status(self) -> int:
        """system_status of the last heartbeat."""
        return int(self._heartbeat().system_status)

    @property
    def on_ground(self) -> bool:
        """As the last EXTENDED_SYS_STATE says."""
        state = self.link.last(245)
        return state is None or state.landed_state == mavlink.MAV_LANDED_STATE_ON_GROUND

    @property
    def position_ned_m(self) -> Vector3:
        """The last LOCAL_POSITION_NED."""
        p = self._local()
        return (p.x, p.y, p.z)

    @property
    def velocity_ned_m_s(self) -> Vector3:
        """The last LOCAL_POSITION_NED."""
        p = self._local()
        return (p.vx, p.vy, p.vz)

    def _local(self) -> Message:
        position = self.link.last(32)
        assert position is not None, "the vehicle has no local position"
        return position

    def _heartbeat(self) -> Message:
        return self.link.last(0)

    # ------------------------------------------------------------ what can be asked

    def command(self, command: int, *parameters: float) -> None:
        """COMMAND_LONG as the ground station; what is not given is 0, as a plain client sends."""
        padded = (*parameters, *(0.0,) * (7 - len(parameters)))
        self.link.send(
            mavlink.MAVLink_command_long_message(self.link.system, 1, command, 0, *padded)
        )

    def ask(self, command: int, *parameters: float, limit_s: float = 3.0) -> int:
        """A command's result."""
        from_s = self.link.now_s
        self.command(command, *parameters)

        def answers() -> list[Heard]:
            acks = self.link.since(from_s, "COMMAND_ACK")
            return [a for a in acks if a.message.command == command]

        self.link.until(answers, limit_s, f"the acknowledgement of {command}")
        return int(answers()[0].message.result)

    def setpoint(self, velocity_ned_m_s: Vector3, yaw_rate_rad_s: float = 0.0) -> None:
        """One velocity setpoint in local NED with a yaw rate."""
        self.link.send(
            mavlink.MAVLink_set_position_target_local_ned_message(
                *(0, self.link.system, 1, mavlink.MAV_FRAME_LOCAL_NED, _VELOCITY_AND_YAW_RATE),
                *(0.0, 0.0, 0.0, *velocity_ned_m_s, 0.0, 0.0, 0.0, 0.0, yaw_rate_rad_s),
            )
        )

    def stream(
        self, velocity_ned_m_s: Vector3, rate_hz: float = 20.0, yaw_rate_rad_s: float = 0.0
    ) -> None:
        """Velocity setpoints from now on."""
        self.stream_of(lambda: self.setpoint(velocity_ned_m_s, yaw_rate_rad_s), rate_hz)

    def stream_of(self, send: Callable[[], None], rate_hz: float = 20.0) -> None:
        """Any setpoint, again and again."""
        self.link.repeat("setpoints", send, 1.0 / rate_hz)

    def silence(self) -> None:
        """No setpoints any more."""
        self.link.cease("setpoints")

    def parameter(self, name: str) -> float | None:
        """A parameter's value; None where the vehicle has none of that name."""
        answer = self._parameter_answer(
            mavlink.MAVLink_param_request_read_message(self.link.system, 1, name.encode(), -1), name
        )
        if answer is None or answer.get_type() == "PARAM_ERROR":
            return None
        return decoded(answer)

    def set_parameter(self, name: str, value: float) -> None:
        """Set a parameter; `restore` puts it back."""
        before = self.parameter(name)
        assert before is not None, f"the vehicle has no {name}"
        self._changed.setdefault(name, before)
        self._write_parameter(name, value, whole=isinstance(before, int))

    def _write_parameter(self, name: str, value: float, *, whole: bool) -> None:
        wire = struct.unpack("<f", struct.pack("<i", int(value)))[0] if whole else value
        kind = _INT32 if whole else _REAL32
        self._parameter_answer(
            mavlink.MAVLink_param_set_message(self.link.system, 1, name.encode(), wire, kind), name
        )

    def _parameter_answer(self, request: Message, name: str) -> Message | None:
        from_s = self.link.now_s
        self.link.send(request)

        def answers() -> list[Message]:
            heard = self.link.since(from_s, "PARAM_VALUE") + self.link.since(from_s, "PARAM_ERROR")
            return [h.message for h in heard if h.message.param_id == name]

        end_s = self.link.now_s + 1.5
        while not answers() and self.link.now_s < end_s:
            self.link.step()
        return answers()[0] if answers() else None

    # ------------------------------------------------------------ known states

    def prepare(self, start: str) -> None:
        """Bring it to a known state: "standby", "hover" (Hold, take-off height) or "offboard"."""
        self.standby()
        if start in ("hover", "offboard"):
            self.take_off()
        if start == "offboard":
            self.stream((0.0, 0.0, 0.0))
            self.link.run(0.5)
            assert self.ask(_SET_MODE, *_OFFBOARD) == 0
            self.settle("OFFBOARD")
            self.link.run(1.0)

    def thin(self) -> None:
        """Stop streams that a sequence does not need: less to carry for a simulated vehicle."""
        for message_id in _NOT_NEEDED:
            self.ask(_SET_INTERVAL, message_id, -1)

    def standby(self) -> None:
        """Disarmed on the ground in Hold, armable, nothing streamed, default parameters."""
        self.silence()
        self.link.beat(STATION)
        self.restore()
        # A companion that is gone is missed seconds later: not in the middle of what follows.
        self.link.run(8.0 if self.link.hush(COMPANION) else 1.2)
        if self.armed and not self.on_ground:
            self.ask(_LAND, 0, 0, 0, math.nan, math.nan, math.nan, math.nan)
            self.link.until(lambda: not self.armed, 120.0, "landing")
        if self.armed:
            self.ask(_ARM, 0.0)
            self.link.until(lambda: not self.armed, 5.0, "disarming")
        if self.mode != "HOLD":
            self.ask(_SET_MODE, *_HOLD)
        self.settle("HOLD")
        self.link.until(lambda: self.status == mavlink.MAV_STATE_STANDBY, 60.0, "STANDBY")
        self.link.run(1.0)

    def restore(self) -> None:
        """Put changed parameters back."""
        for name, value in self._changed.items():
            self._write_parameter(name, value, whole=isinstance(value, int))
        self._changed.clear()

    def take_off(self) -> None:
        """Arm and take off as PX4 does by default; ends in Hold, standing still."""
        end_s = self.link.now_s + _ARMABLE_S
        while self.ask(_ARM, 1.0) != 0:
            assert self.link.now_s < end_s, "it does not arm"
            self.link.run(1.0)
        assert self.ask(_TAKEOFF, 0, 0, 0, math.nan, math.nan, math.nan, math.nan) == 0
        self.link.until(lambda: self.mode == "TAKEOFF", 3.0, "take-off mode")
        self.link.until(lambda: self.mode == "HOLD", 30.0, "Hold after take-off")
        self.link.run(5.0)
        self.settle("HOLD")

    def settle(self, mode: str) -> None:
        """Wait until heartbeat and CURRENT_MODE both tell of `mode`."""
        self.link.until(lambda: self.mode == mode, 3.0, f"heartbeat in {mode}")
        if self.link.last(436) is not None:
            self.link.until(lambda: self._current_mode() == mode, 4.0, f"CURRENT_MODE {mode}")

    def _current_mode(self) -> str:
        current = self.link.last(436)
        assert current is not None
        return _mode_name(current.custom_mode)

    # ------------------------------------------------------------ sequences

    def play(self, sequence: Sequence) -> list[Seen]:
        """Play the stimulus and return the transcript, timed from the sequence's zero."""
        self.prepare(sequence.start)
        for name, value in sequence.parameters.items():
            self.set_parameter(name, value)
        baseline = len(self.link.heard)
        first_s = min(float(step[0]) for step in sequence.play)
        zero_s = self.link.now_s - min(first_s, 0.0)
        for at_s, verb, *arguments in sorted(sequence.play, key=lambda step: float(step[0])):
            self.link.run(zero_s + at_s - self.link.now_s)
            self._do(verb, arguments)
        self.link.run(zero_s + sequence.for_s - self.link.now_s)
        return self._transcript(baseline, zero_s)

    def _do(self, verb: str, arguments: list[Any]) -> None:
        if verb == "command":
            command, *parameters = arguments[0]
            self.command(int(command), *(float(p) for p in parameters))
        elif verb == "stream":
            velocity, rate_hz = arguments
            self.stream(tuple(velocity), rate_hz)
        elif verb == "setpoint":
            self.setpoint(tuple(arguments[0]))
        elif verb == "silence":
            self.silence()
        elif verb == "heartbeats":
            self.link.beat(_WHO[arguments[0]])
        elif verb == "quiet":
            self.link.hush(_WHO[arguments[0]])
        elif verb == "parameter":
            self.set_parameter(*arguments)
        elif verb == "reposition":
            self.reposition(tuple(arguments[0]))
        else:
            raise ValueError(f"no such verb: {verb}")

    def reposition(self, by_neu_m: Vector3) -> None:
        """MAV_CMD_DO_REPOSITION by COMMAND_INT, so far from where it is now."""
        here = self.link.last(33)
        assert here is not None, "the vehicle has no global position"
        north, east, up = by_neu_m
        degrees = 1e7 / 111_319.5
        cosine = math.cos(math.radians(here.lat * 1e-7))
        self.link.send(
            mavlink.MAVLink_command_int_message(
                *(
                    self.link.system,
                    1,
                    mavlink.MAV_FRAME_GLOBAL,
                    _REPOSITION,
                    0,
                    0,
                    -1.0,
                    1.0,
                    0.0,
                    math.nan,
                ),
                here.lat + round(north * degrees),
                here.lon + round(east * degrees / cosine),
                here.alt * 1e-3 + up,
            )
        )

    def _transcript(self, baseline: int, zero_s: float) -> list[Seen]:
        """What was heard since, as entries; periodic states only where they changed."""
        seen: list[Seen] = []
        states: dict[str, str] = {}
        chunks: dict[int, int] = {}
        for index, heard in enumerate(self.link.heard):
            if heard.message_id not in _TOLD:
                continue
            at_s, message = heard.at_s, heard.message
            entry = self._entry(message)
            if entry is None:
                continue
            channel, what = entry
            if channel in ("heartbeat", "mode", "landed"):
                changed = states.get(channel) != what
                states[channel] = what
                if not changed:
                    continue
            if index < baseline:
                continue
            if channel == "text" and message.chunk_seq > 0 and message.id in chunks:
                place = chunks[message.id]
                seen[place] = seen[place]._replace(what=seen[place].what + message.text)
                continue
            if channel == "text":
                chunks[message.id] = len(seen)
            seen.append(Seen(at_s - zero_s, channel, what))
        return [s for s in seen if not _of_no_concern(s)]

    def _entry(self, message: Message) -> tuple[str, str] | None:
        kind = message.get_type()
        if kind == "COMMAND_ACK":
            progress = f" progress {message.progress}" if message.progress else ""
            return "ack", f"{message.command} {message.result}{progress}"
        if kind == "STATUSTEXT":
            return "text", f"{message.severity} {message.text}"
        if kind == "EVENT":
            name = self._event_names.get(message.id, f"event {message.id}")
            return "event", f"{name} {message.log_levels >> 4}/{message.log_levels & 15}"
        if kind == "HEARTBEAT":
            mode = _mode_name(message.custom_mode)
            return "heartbeat", f"{message.base_mode} {mode} {message.system_status}"
        if kind == "CURRENT_MODE":
            modes = _mode_name(message.custom_mode), _mode_name(message.intended_custom_mode)
            return "mode", " of ".join(modes)
        if kind == "EXTENDED_SYS_STATE":
            return "landed", str(message.landed_state)
        return None


def _of_no_concern(seen: Seen) -> bool:
    """True for the logger's words, for reports on arming checks, which come as they change, and
    for events that were never measured: every version has its own.
    """
    if seen.channel == "text":
        return "[logger]" in seen.what
    return seen.channel == "event" and seen.what.startswith(
        ("event ", "logger_", "check_", "commander_arming_check", "commander_health")
    )


def _mode_name(custom_mode: int) -> str:
    return _MODES.get(custom_mode, f"{custom_mode:#010x}")


def decoded(message: Message) -> float:
    """The value in a PARAM_VALUE; an integer is laid byte by byte into the float."""
    if message.param_type == _INT32:
        (value,) = struct.unpack("<i", struct.pack("<f", message.param_value))
        return int(value)
    return float(message.param_value)


__all__ = ["MockLink", "Vehicle", "decoded"]
