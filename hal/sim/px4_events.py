"""PX4's events: what it tells beside its status texts, on every link, in MAVLink message EVENT.

Ids, log levels and arguments: measured on PX4 main bb59c637cd, SIH quadrotor, 2026-11. An id is
the component (1, the autopilot) over the low 24 bits of the name's FNV-1a hash.
"""

import struct

import msgspec

_COMPONENT = 1
_FNV_OFFSET, _FNV_PRIME = 0x811C9DC5, 0x01000193


def event_id(name: str) -> int:
    """The number of an event of that name."""
    value = _FNV_OFFSET
    for letter in name.encode():
        value = ((value ^ letter) * _FNV_PRIME) & 0xFFFFFFFF
    return _COMPONENT << 24 | value & 0xFFFFFF


class EventKind(msgspec.Struct, frozen=True):
    """A kind of event: its name, log levels (internal, external) and its arguments' layout."""

    name: str
    internal: int = 6
    external: int = 6
    layout: str = ""

    @property
    def number(self) -> int:
        """Its id on the wire."""
        return event_id(self.name)


class AutopilotEvent(msgspec.Struct, frozen=True):
    """One event; `at_s` is autopilot time, `arguments` as they lie on the wire."""

    at_s: float
    sequence: int
    kind: EventKind
    arguments: bytes = b""

    @classmethod
    def of(cls, at_s: float, sequence: int, kind: EventKind, *arguments: float) -> "AutopilotEvent":
        """An event with its arguments laid out."""
        return cls(at_s, sequence, kind, struct.pack("<" + kind.layout, *arguments))

    @property
    def log_levels(self) -> int:
        """As in EVENT: internal above external."""
        return self.kind.internal << 4 | self.kind.external


# Reasons for arming and disarming, the argument of the two events below.
COMMAND_EXTERNAL, LANDING, PREFLIGHT_INACTION = 4, 6, 7
# Failsafe actions and causes, arguments of the failsafe events.
ACTION_HOLD, ACTION_RETURN, ACTION_LAND, ACTION_TERMINATE = 5, 6, 7, 10
CAUSE_GROUND_STATION_LOST = 2

ARMED_BY = EventKind("commander_armed_by", layout="B")
DISARMED_BY = EventKind("commander_disarmed_by", layout="B")
ARMING_DENIED = EventKind("commander_arm_denied_resolve_failures", 6, 2)
DISARMING_DENIED = EventKind("commander_disarm_denied_not_landed", 6, 2)
MODE_NOT_AVAILABLE = EventKind("commander_modeswitch_not_avail", 6, 2, "IB")
TAKEOFF_ALTITUDE = EventKind("navigator_takeoff_default_alt", layout="f")
TAKEOFF_DETECTED = EventKind("commander_takeoff_detected")
LANDING_HERE = EventKind("commander_landing_current_pos")
LANDING_DETECTED = EventKind("commander_landing_detected")
RETURNING = EventKind("commander_rtl")
RETURN_AT = EventKind("vrtl_return_at", layout="ii")
RETURN_LANDS = EventKind("rtl_land_at_destination")
FAILSAFE = EventKind("commander_failsafe_enter_generic", 4, 2, "IB")
FAILSAFE_OF = EventKind("commander_failsafe_enter", 4, 2, "IBB")
FAILSAFE_HOLDS = EventKind("commander_failsafe_enter_hold", 4, 2, "IBHB")
FAILSAFE_WARNING = EventKind("commander_failsafe_enter_generic_warn", 4, 4, "I")
STATION_LOST = EventKind("commander_gcs_lost", 6, 4)
STATION_BACK = EventKind("commander_dl_regained")
COMPANION_LOST = EventKind("commander_mission_comp_lost", 2, 2)
COMPANION_BACK = EventKind("commander_onboard_ctrl_regained")
NO_GLOBAL_POSITION = EventKind("check_modes_global_pos", 6, 3, "IB")
GLOBAL_MODES = 1 << 3 | 1 << 4 | 1 << 5
"""The first argument of a failed check: the modes it forbids, here Mission, Hold and Return."""
MISSION_DENIED = EventKind("commander_mission_start_denied_no_mission", 6, 2)
