"""What PX4's messages mean: pure translation from MAVLink fields to the project's readings.

Fields arrive as JSON with MAVLink's names; a number that is not finite arrives as null and makes
the message unreadable, which its reader counts. Values measured on PX4 main bb59c637cd, SIH
quadrotor, 2026-11.
"""

import math
from collections import deque

import msgspec

from hal.frames import Vector3, rotate_frd_to_ned
from hal.readings import Attitude, FlightMode, LandedState, LocalPosition, StatusText

PX4 = 12  # MAV_AUTOPILOT_PX4
ARMED = 128  # MAV_MODE_FLAG_SAFETY_ARMED in HEARTBEAT.base_mode
STANDBY = 3  # MAV_STATE: the lowest system_status of a vehicle that may be armed
CRITICAL = 5  # MAV_STATE: every failsafe in the air shows it
PREARM_CHECK = 0x1000_0000  # MAV_SYS_STATUS_PREARM_CHECK in the health bits
WARNING = 4  # MAV_SEVERITY

_LOCAL_NED = 1  # MAV_FRAME
_BODY_FRAMES = (8, 12)  # MAV_FRAME_BODY_NED, MAV_FRAME_BODY_FRD
_AUTO, _OFFBOARD = 4, 6  # PX4's main modes
_SUB_MODES = {
    2: FlightMode.TAKEOFF,
    3: FlightMode.HOLD,
    4: FlightMode.MISSION,
    5: FlightMode.RETURN,
    6: FlightMode.LAND,
    20: FlightMode.DESCEND,  # older versions tell Land
}
_LANDED = {
    1: LandedState.ON_GROUND,
    2: LandedState.IN_AIR,
    3: LandedState.TAKEOFF,
    4: LandedState.LANDING,
}
_CHUNK_LENGTH = 50  # bytes of text in one STATUSTEXT
_TEXTS_IN_PARTS = 8


def flight_mode(custom_mode: int) -> FlightMode:
    """The project's word for PX4's mode (main mode in bits 16..23, sub mode in 24..31)."""
    main, sub = (custom_mode >> 16) & 0xFF, (custom_mode >> 24) & 0xFF
    if main == _OFFBOARD:
        return FlightMode.OFFBOARD
    if main == _AUTO:
        return _SUB_MODES.get(sub, FlightMode.UNKNOWN)
    return FlightMode.MANUAL if main else FlightMode.UNKNOWN


class Heartbeat(msgspec.Struct, frozen=True):
    """HEARTBEAT of the autopilot."""

    autopilot: int
    base_mode: int
    custom_mode: int
    system_status: int

    @property
    def armed(self) -> bool:
        """True while the motors may turn."""
        return bool(self.base_mode & ARMED)

    @property
    def mode(self) -> FlightMode:
        """The project's word for PX4's mode."""
        return flight_mode(self.custom_mode)


class CurrentMode(msgspec.Struct, frozen=True):
    """CURRENT_MODE (PX4 1.15 and newer): the mode that is flown, as in HEARTBEAT."""

    custom_mode: int

    @property
    def mode(self) -> FlightMode:
        """The project's word for it."""
        return flight_mode(self.custom_mode)


class GlobalPositionInt(msgspec.Struct, frozen=True):
    """GLOBAL_POSITION_INT: PX4 sends it only while it knows where on Earth it is."""

    lat: int
    lon: int


class ExtendedSysState(msgspec.Struct, frozen=True):
    """EXTENDED_SYS_STATE."""

    landed_state: int

    @property
    def landed(self) -> LandedState:
        """The project's word for it."""
        return _LANDED.get(self.landed_state, LandedState.UNKNOWN)


class SysStatus(msgspec.Struct, frozen=True):
    """SYS_STATUS: health bits, and the battery in percent (-1: not known)."""

    onboard_control_sensors_health: int
    battery_remaining: int

    @property
    def prearm_ok(self) -> bool:
        """The autopilot's own answer to whether it could be armed now."""
        return bool(self.onboard_control_sensors_health & PREARM_CHECK)

    @property
    def battery(self) -> float | None:
        """0..1, or None when the autopilot does not know."""
        return self.battery_remaining / 100.0 if 0 <= self.battery_remaining <= 100 else None


class AttitudeMessage(msgspec.Struct, frozen=True):
    """ATTITUDE."""

    time_boot_ms: int
    roll: float
    pitch: float
    yaw: float
    yawspeed: float

    def reading(self, stamp_s: float) -> Attitude:
        """As a reading; raises ReadingRefused when it is none."""
        return Attitude(stamp_s, self.roll, self.pitch, self.yaw, self.yawspeed)


class LocalPositionNed(msgspec.Struct, frozen=True):
    """LOCAL_POSITION_NED: PX4 sends it only while its horizontal estimate is valid."""

    time_boot_ms: int
    x: float
    y: float
    z: float
    vx: float
    vy: float
    vz: float

    def reading(self, stamp_s: float, reset_counter: int) -> LocalPosition:
        """As a reading; raises ReadingRefused when it is none."""
        return LocalPosition(
            stamp_s,
            (self.x, self.y, self.z),
            (self.vx, self.vy, self.vz),
            reset_counter,
            resets_told=False,
        )


class Odometry(msgspec.Struct, frozen=True):
    """ODOMETRY: the same estimate, valid or not, with the counter of its jumps."""

    time_usec: int
    frame_id: int
    child_frame_id: int
    x: float
    y: float
    z: float
    q: tuple[float, float, float, float]
    vx: float
    vy: float
    vz: float
    reset_counter: int

    def reading(self, stamp_s: float) -> LocalPosition | None:
        """As a reading, or None for frames that are not the local one.

        Raises ReadingRefused when a component is not a number.
        """
        if self.frame_id != _LOCAL_NED:
            return None
        velocity: Vector3 = (self.vx, self.vy, self.vz)
        if self.child_frame_id in _BODY_FRAMES:
            velocity = rotate_frd_to_ned(velocity, *_euler_rad(self.q))
        elif self.child_frame_id != _LOCAL_NED:
            return None
        return LocalPosition(stamp_s, (self.x, self.y, self.z), velocity, self.reset_counter)


def _euler_rad(q: tuple[float, float, float, float]) -> tuple[float, float, float]:
    """(roll, pitch, yaw) of a rotation FRD -> NED given as a quaternion (w, x, y, z)."""
    w, x, y, z = q
    roll = math.atan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    pitch = math.asin(max(-1.0, min(1.0, 2.0 * (w * y - z * x))))
    yaw = math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    return roll, pitch, yaw


class StatusTextMessage(msgspec.Struct, frozen=True):
    """STATUSTEXT: 50 bytes of text; longer texts come in parts with one id."""

    severity: int
    text: str
    id: int = 0
    chunk_seq: int = 0


class TextAssembler:
    """Puts the parts of status texts together.

    A part shorter than 50 bytes ends its text. PX4 ends texts with a TAB, so that a text of
    exactly 50 bytes has a second part, which is the TAB alone. A text whose beginning or middle
    was lost is given out with what there is.
    """

    def __init__(self) -> None:
        self._parts: dict[int, tuple[int, str]] = {}

    def take(self, message: StatusTextMessage, now_s: float) -> StatusText | None:
        """The whole text when this part completes one, else None."""
        severity, so_far = self._parts.pop(message.id, (message.severity, ""))
        if message.chunk_seq == 0:
            severity, so_far = message.severity, ""
        text = so_far + message.text
        if message.id != 0 and len(message.text.encode()) >= _CHUNK_LENGTH:
            while len(self._parts) >= _TEXTS_IN_PARTS:
                self._parts.pop(next(iter(self._parts)))
            self._parts[message.id] = (severity, text)
            return None
        text = text.strip("\t \0")
        return StatusText(now_s, severity, text) if text else None


class RecentTexts:
    """The last status texts, for people who ask why: bounded, and by age."""

    def __init__(self, kept: int = 32) -> None:
        self._texts: deque[StatusText] = deque(maxlen=kept)

    def put(self, text: StatusText) -> None:
        """Remember one."""
        self._texts.append(text)

    def since(self, since_s: float, severity: int = WARNING) -> str:
        """Distinct texts since then, at least that severe (lower is worse), in order, or ""."""
        lines = (t.text for t in tuple(self._texts) if t.stamp_s >= since_s)
        severe = {t.text for t in tuple(self._texts) if t.severity <= severity}
        return "; ".join(dict.fromkeys(line for line in lines if line in severe))
