"""PX4's numbers and words: modes, results, landed states, parameters, status texts.

Source: measured on PX4 main bb59c637cd, SIH quadrotor, 2026-11.
"""

from enum import IntEnum
from pathlib import Path

import msgspec

from hal.readings import FlightMode, LandedState

_PARAMETERS_FILE = Path(__file__).with_name("px4_parameters.json")


class Mode(IntEnum):
    """custom_mode of the heartbeat: sub mode << 24 | main mode << 16."""

    MANUAL = 0x00010000
    ALTITUDE = 0x00020000
    POSITION = 0x00030000
    ORBIT = 0x01030000
    ACRO = 0x00050000
    OFFBOARD = 0x00060000
    STABILIZED = 0x00070000
    TERMINATION = 0x000A0000
    TAKEOFF = 0x02040000
    HOLD = 0x03040000
    MISSION = 0x04040000
    RETURN = 0x05040000
    LAND = 0x06040000

    @property
    def main(self) -> int:
        """Main mode, as in MAV_CMD_DO_SET_MODE's second parameter."""
        return (self.value >> 16) & 0xFF

    @property
    def sub(self) -> int:
        """Sub mode, as in MAV_CMD_DO_SET_MODE's third parameter."""
        return self.value >> 24

    @property
    def base_mode(self) -> int:
        """The heartbeat's base_mode while disarmed (128 is added when armed)."""
        if self is Mode.OFFBOARD:
            return 17
        if self is Mode.TERMINATION:
            return 1
        return 29 if self.main == 4 else 81

    @property
    def flight_mode(self) -> FlightMode:
        """The project's word for the mode."""
        return _FLIGHT_MODES.get(self, FlightMode.MANUAL)

    @property
    def needs_pilot(self) -> bool:
        """True for the modes that need a remote control, which this vehicle does not have."""
        return self.main not in (4, 6, 10)


_FLIGHT_MODES = {
    Mode.TAKEOFF: FlightMode.TAKEOFF,
    Mode.HOLD: FlightMode.HOLD,
    Mode.MISSION: FlightMode.MISSION,
    Mode.RETURN: FlightMode.RETURN,
    Mode.LAND: FlightMode.LAND,
    Mode.OFFBOARD: FlightMode.OFFBOARD,
}


class Result(IntEnum):
    """MAV_RESULT, as far as PX4 was seen to use it."""

    ACCEPTED = 0
    TEMPORARILY_REJECTED = 1
    DENIED = 2
    UNSUPPORTED = 3
    FAILED = 4
    IN_PROGRESS = 5


class Landed(IntEnum):
    """EXTENDED_SYS_STATE.landed_state."""

    ON_GROUND = 1
    IN_AIR = 2
    TAKEOFF = 3
    LANDING = 4

    @property
    def landed_state(self) -> LandedState:
        """The project's word for the state."""
        return LandedState[self.name]


class SystemStatus(IntEnum):
    """HEARTBEAT.system_status."""

    UNINIT = 0
    STANDBY = 3
    ACTIVE = 4
    CRITICAL = 5
    FLIGHT_TERMINATION = 8


class Severity(IntEnum):
    """MAV_SEVERITY, as far as it was seen."""

    CRITICAL = 2
    WARNING = 4
    INFO = 6


class AutopilotText(msgspec.Struct, frozen=True):
    """A status text without the TAB that PX4 appends on the wire; `at_s` is autopilot time."""

    at_s: float
    severity: Severity
    text: str


class Parameters:
    """All parameters with their measured values; the type of a value is the parameter's type.

    Order is PX4's: alphabetical, the position is the index on the wire.
    """

    def __init__(self) -> None:
        document = msgspec.json.decode(_PARAMETERS_FILE.read_bytes())
        self._values: dict[str, int | float] = document["parameters"]
        self._names = tuple(self._values)
        self.changes = 0
        """How often a value was set: lets readers keep what they derived."""
        self._index = {name: index for index, name in enumerate(self._names)}

    def __len__(self) -> int:
        return len(self._names)

    def __contains__(self, name: str) -> bool:
        return name in self._values

    def __getitem__(self, name: str) -> int | float:
        return self._values[name]

    @property
    def names(self) -> tuple[str, ...]:
        """All names in the order of their indices."""
        return self._names

    def index(self, name: str) -> int:
        """Place of the parameter in the list."""
        return self._index[name]

    def set(self, name: str, value: float) -> bool:
        """Take a value without any range check (PX4 has none here); False for an unknown name.

        An integer parameter takes the value truncated.
        """
        if name not in self._values:
            return False
        self._values[name] = int(value) if isinstance(self._values[name], int) else float(value)
        self.changes += 1
        return True
