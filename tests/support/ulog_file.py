"""Writes ULog files as PX4's file format description says, for tests of what reads them."""

import math
import struct
from collections.abc import Sequence
from pathlib import Path

from autonomy.flightlog.reader import FlightLog
from hal.readings import FlightMode

Row = tuple[float, ...]
"""Seconds since the autopilot's boot, then the fields."""


class UlogFile:
    """Collects topics; `save` writes the file."""

    def __init__(self) -> None:
        self._formats: list[tuple[str, str]] = []
        self._rows: list[tuple[int, int, bytes]] = []

    def topic(self, name: str, fields: Sequence[tuple[str, str]], rows: Sequence[Row]) -> None:
        """`fields` are (type, name) after the timestamp: float, uint8_t, or float[4]."""
        declared = "".join(f"{kind} {field};" for kind, field in fields)
        number = len(self._formats)
        self._formats.append((name, f"{name}:uint64_t timestamp;{declared}"))
        packing = "<Q" + "".join(
            {"float": "f", "uint8_t": "B", "float[4]": "4f"}[k] for k, _ in fields
        )
        for row in rows:
            stamp_us = round(row[0] * 1e6)
            self._rows.append((stamp_us, number, struct.pack(packing, stamp_us, *row[1:])))

    def save(self, path: Path) -> Path:
        """Header, definitions, then data in the order of time."""
        file = bytearray(b"ULog\x01\x12\x35\x01" + struct.pack("<Q", 0))
        file += _message(b"B", bytes(40))
        for _, text in self._formats:
            file += _message(b"F", text.encode())
        for number, (name, _) in enumerate(self._formats):
            file += _message(b"A", struct.pack("<BH", 0, number) + name.encode())
        for _, number, packed in sorted(self._rows):
            file += _message(b"D", struct.pack("<H", number) + packed)
        path.write_bytes(file)
        return path


def _message(kind: bytes, content: bytes) -> bytes:
    return struct.pack("<H", len(content)) + kind + content


def as_px4_saw_it(log: FlightLog, path: Path, *, boot_s: float) -> Path:
    """The flight of a log as PX4 would have written it, booted at `boot_s` on the log's clock."""
    file = UlogFile()
    places: list[Row] = []
    asked: list[Row] = []
    turns: list[Row] = []
    modes: list[Row] = []
    for tick in log:
        place, attitude = tick.inputs.local_position, tick.inputs.attitude
        if place is None or attitude is None:
            continue
        since_s = place.stamp_s - boot_s
        places.append((since_s, *place.position_ned_m, *place.velocity_ned_m_s))
        wire = tick.command.wire_setpoint
        if wire is not None:
            asked.append((since_s, *wire.position_ned_m, *wire.velocity_ned_m_s))
        half = attitude.yaw_rad / 2.0
        turns.append((since_s, math.cos(half), 0.0, 0.0, math.sin(half)))
        modes.append((since_s, _NAV_STATE[tick.inputs.status.mode]))
    floats = [("float", name) for name in ("x", "y", "z", "vx", "vy", "vz")]
    file.topic("vehicle_local_position", floats, places)
    file.topic("vehicle_local_position_setpoint", floats, asked)
    file.topic("vehicle_attitude", [("float[4]", "q")], turns)
    file.topic("vehicle_status", [("uint8_t", "nav_state")], modes)
    return file.save(path)


_NAV_STATE = {
    FlightMode.UNKNOWN: 0,
    FlightMode.MANUAL: 0,
    FlightMode.MISSION: 3,
    FlightMode.HOLD: 4,
    FlightMode.RETURN: 5,
    FlightMode.DESCEND: 12,
    FlightMode.OFFBOARD: 14,
    FlightMode.TAKEOFF: 17,
    FlightMode.LAND: 18,
}
