"""PX4's own log (ULog) laid beside a flight log: the same flight as the autopilot wrote it down.

The only door to pyulog (extra `log`). Positions are in PX4's local frame, as it told them to
this program. Times are put on the flight log's clock.
"""

from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import numpy.typing as npt

from autonomy.errors import BadInput
from autonomy.flightlog.reader import FlightLog

FloatArray = npt.NDArray[np.float64]

SAME_FLIGHT_M = 0.3
"""Where two records of one position differ by more (root mean square) they are of two flights."""
_STEP_S = 0.05
_FINE_S = 0.002
_OVERLAP_S = 5.0
_STILL_M = 0.3
"""A vehicle that moved less can be laid beside any other that stood still."""

# NAVIGATION_STATE_* of PX4's VehicleStatus.msg.
NAV_STATES = {
    0: "Manual",
    1: "Altitude",
    2: "Position",
    3: "Mission",
    4: "Hold",
    5: "Return",
    6: "Position, slow",
    8: "Altitude, cruise",
    10: "Acro",
    12: "Descend",
    13: "Termination",
    14: "Offboard",
    15: "Stabilized",
    17: "Takeoff",
    18: "Land",
    19: "Follow",
    20: "Precision land",
    21: "Orbit",
}


class Px4Record(msgspec.Struct, frozen=True):
    """What PX4 wrote. Each array is (n, 1 + columns) with the seconds since its boot in front.

    `position` and `velocity` are NED, `asked_position` and `asked_velocity` the setpoints of its
    own controllers (NaN where it had none), `attitude` roll, pitch and yaw in rad. `nav_states` are
    (seconds, word) at every change.
    """

    position: FloatArray
    velocity: FloatArray
    asked_position: FloatArray
    asked_velocity: FloatArray
    attitude: FloatArray
    nav_states: tuple[tuple[float, str], ...]


class Beside(msgspec.Struct, frozen=True):
    """The record on the flight log's clock: add `offset_s` to its times.

    `how` says by what, `apart_m` how far the two records of one position then lie apart (root mean
    square). `heard` is (n, 4): when and where this program was told that the vehicle was.
    """

    record: Px4Record
    offset_s: float
    how: str
    apart_m: float
    heard: FloatArray


def read_ulog(path: Path) -> Px4Record:
    """The record in `path`; raises BadInput for what is no ULog, or has no position in it."""
    try:
        from pyulog import ULog
    except ImportError:
        raise BadInput(
            "PX4's log is read by pyulog, which is not installed; pip install 'autonomy[log]'"
        ) from None
    names = ["vehicle_local_position", "vehicle_local_position_setpoint", "vehicle_attitude"]
    try:
        with path.open("rb") as file:
            found = ULog(file, [*names, "vehicle_status"], disable_str_exceptions=True)
    except Exception as error:  # noqa: BLE001  it raises whatever its parsing stumbles over
        raise BadInput(f"{path}: cannot be read as PX4's log ({error})") from None
    topics = {each.name: each.data for each in found.data_list if each.multi_id == 0}
    if "vehicle_local_position" not in topics:
        raise BadInput(f"{path}: holds no vehicle_local_position; nothing can be laid beside it")
    place, asked = topics["vehicle_local_position"], topics.get(names[1])
    return Px4Record(
        position=_columns(place, "x", "y", "z"),
        velocity=_columns(place, "vx", "vy", "vz"),
        asked_position=_columns(asked, "x", "y", "z"),
        asked_velocity=_columns(asked, "vx", "vy", "vz"),
        attitude=_attitude(topics.get("vehicle_attitude")),
        nav_states=_nav_states(topics.get("vehicle_status")),
    )


def lay_beside(log: FlightLog, record: Px4Record, name: str) -> Beside:
    """Find where on the flight log's clock the record belongs.

    By the autopilot's own clock where the log knows when that began, else, or where the positions
    contradict it, by where the two records of the position fit best. Raises BadInput when they fit
    nowhere.
    """
    heard, booted_s = _heard(log)
    if len(heard) < 2 or len(record.position) < 2:
        raise BadInput(f"{name}: there is too little of this flight in it to lay it beside the log")
    if booted_s is not None:
        apart_m = _apart_m(heard, record.position, booted_s)
        if apart_m <= SAME_FLIGHT_M:
            return Beside(record, booted_s, "by the autopilot's clock", apart_m, heard)
    if float(np.ptp(heard[:, 1:], axis=0).max()) < _STILL_M:
        raise BadInput(f"{name}: cannot be laid beside a log in which the vehicle never moved")
    offset_s = _best_offset_s(heard, record.position)
    apart_m = _apart_m(heard, record.position, offset_s)
    if not apart_m <= SAME_FLIGHT_M:
        raise BadInput(
            f"{name}: is not of this flight: at best its positions are {apart_m:.1f} m from those "
            "that were heard"
        )
    return Beside(record, offset_s, "by where the positions fit best", apart_m, heard)


def _heard(log: FlightLog) -> tuple[FloatArray, float | None]:
    """(stamp, position) of every new local position in the log, and when the autopilot began."""
    rows: list[tuple[float, float, float, float]] = []
    booted_s = None
    for tick in log:
        place, facts = tick.inputs.local_position, tick.inputs.facts
        if place is not None and (not rows or place.stamp_s > rows[-1][0]):
            rows.append((place.stamp_s, *place.position_ned_m))
        if facts is not None and facts.booted_s is not None:
            booted_s = facts.booted_s
    return np.array(rows, dtype=np.float64).reshape(-1, 4), booted_s


def _best_offset_s(heard: FloatArray, position: FloatArray) -> float:
    """The offset with the least distance: coarsely everywhere, then finely about the best."""
    first = heard[0, 0] - position[-1, 0] + _OVERLAP_S
    last = heard[-1, 0] - position[0, 0] - _OVERLAP_S
    thin = heard[:: max(1, len(heard) // 400)]
    coarse = np.arange(first, max(last, first) + _STEP_S, _STEP_S)
    best = min(coarse.tolist(), key=lambda offset_s: _apart_m(thin, position, offset_s))
    fine = np.arange(best - 2.0 * _STEP_S, best + 2.0 * _STEP_S, _FINE_S)
    found: float = min(fine.tolist(), key=lambda offset_s: _apart_m(heard, position, offset_s))
    return found


def _apart_m(heard: FloatArray, position: FloatArray, offset_s: float) -> float:
    """Root mean square distance where both have something; infinite for less than some seconds."""
    times = position[:, 0] + offset_s
    both = (heard[:, 0] >= times[0]) & (heard[:, 0] <= times[-1])
    known = heard[both]
    if len(known) < 2 or known[-1, 0] - known[0, 0] < _OVERLAP_S:
        return float("inf")
    gaps = [np.interp(known[:, 0], times, position[:, axis]) - known[:, axis] for axis in (1, 2, 3)]
    return float(np.sqrt(np.mean(np.square(gaps).sum(axis=0))))


def _columns(data: Any, *names: str) -> FloatArray:
    if data is None:
        return np.empty((0, 1 + len(names)))
    return np.column_stack((data["timestamp"] * 1e-6, *(data[name] for name in names)))


def _attitude(data: Any) -> FloatArray:
    if data is None:
        return np.empty((0, 4))
    w, x, y, z = (np.asarray(data[f"q[{k}]"], dtype=np.float64) for k in range(4))
    roll = np.arctan2(2.0 * (w * x + y * z), 1.0 - 2.0 * (x * x + y * y))
    pitch = np.arcsin(np.clip(2.0 * (w * y - z * x), -1.0, 1.0))
    yaw = np.arctan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))
    return np.column_stack((data["timestamp"] * 1e-6, roll, pitch, yaw))


def _nav_states(data: Any) -> tuple[tuple[float, str], ...]:
    if data is None:
        return ()
    changes: list[tuple[float, str]] = []
    for stamp_us, number in zip(
        data["timestamp"].tolist(), data["nav_state"].tolist(), strict=True
    ):
        word = NAV_STATES.get(number, f"nav_state {number}")
        if not changes or changes[-1][1] != word:
            changes.append((stamp_us * 1e-6, word))
    return tuple(changes)
