"""PX4's own log beside ours: read, put on our clock, and refused when it is another flight's."""

import math
from pathlib import Path

import msgspec
import numpy as np
import pytest

from autonomy.errors import BadInput
from autonomy.flightlog.reader import FlightLog
from autonomy.flightlog.recorder import FlightRecorder
from autonomy.flightlog.schema import FlightHeader
from autonomy.review.ulog import lay_beside, read_ulog
from hal.readings import LocalPosition, VehicleFacts
from tests.support.ulog_file import UlogFile
from tests.unit.autonomy.flightlog.records import plain_inputs, plain_step

LATENCY_FREE_S = 200.0
"""When, on the flight log's clock, the autopilot booted."""


def place(since_boot_s: float) -> tuple[float, float, float]:
    """A path with a corner that is found only where it belongs."""
    t = since_boot_s - 20.0
    return (0.2 * t, 0.8 * math.sin(0.21 * t), -1.0 + 0.1 * math.sin(0.5 * t))


def flight_log(path: Path, booted_s: float | None, *, moves: bool = True) -> FlightLog:
    """Forty seconds heard at 20 Hz, from 20 s after the autopilot's boot on."""
    with FlightRecorder(path, FlightHeader(config_json="{}"), wait_when_full=True) as recorder:
        for k in range(800):
            now_s = LATENCY_FREE_S + 20.0 + k / 20.0
            where = place(now_s - LATENCY_FREE_S) if moves else (1.0, 1.0, -1.0)
            inputs = msgspec.structs.replace(
                plain_inputs(now_s),
                local_position=LocalPosition(now_s, where, (0.2, 0.0, 0.0)),
                facts=VehicleFacts("PX4", "1.17.0", 1, {}, booted_s=booted_s),
            )
            recorder.tick(inputs, plain_step(inputs), 0.0)
    return FlightLog.open(path)


def px4_log(path: Path, *, apart_m: float = 0.0) -> Path:
    """The same flight as the autopilot wrote it, longer on both sides, at 10 Hz."""
    file = UlogFile()
    stamps = [k / 10.0 for k in range(50, 900)]
    floats = [("float", name) for name in ("x", "y", "z", "vx", "vy", "vz")]
    rows = [
        (t, place(t)[0], place(t)[1] + apart_m * math.sin(t), place(t)[2], 0.2, 0.0, 0.0)
        for t in stamps
    ]
    file.topic("vehicle_local_position", floats, rows)
    file.topic(
        "vehicle_local_position_setpoint",
        floats,
        [(t, *place(t + 0.1), 0.2, 0.0, 0.0) for t in stamps],
    )
    turn = [(t, math.cos(0.15), 0.0, 0.0, math.sin(0.15)) for t in stamps]
    file.topic("vehicle_attitude", [("float[4]", "q")], turn)
    modes = [(t, 4 if t < 20 else 17 if t < 25 else 14 if t < 60 else 18) for t in stamps]
    file.topic("vehicle_status", [("uint8_t", "nav_state")], modes)
    return file.save(path)


def test_what_px4_wrote_is_read_in_its_own_units_and_words(tmp_path: Path) -> None:
    record = read_ulog(px4_log(tmp_path / "a.ulg"))
    at = 150
    assert record.position[at] == pytest.approx([20.0, *place(20.0)], abs=1e-6)
    assert record.velocity[at, 1:] == pytest.approx([0.2, 0.0, 0.0])
    assert record.asked_position[at, 1:] == pytest.approx(place(20.1), abs=1e-6)
    assert record.attitude[at, 1:] == pytest.approx([0.0, 0.0, 0.3])
    assert record.nav_states == (
        (5.0, "Hold"),
        (20.0, "Takeoff"),
        (25.0, "Offboard"),
        (60.0, "Land"),
    )


def test_the_autopilots_clock_is_believed_where_the_positions_agree(tmp_path: Path) -> None:
    log = flight_log(tmp_path / "a.mcap", LATENCY_FREE_S + 0.004)
    beside = lay_beside(log, read_ulog(px4_log(tmp_path / "a.ulg")), "a.ulg")
    assert beside.how == "by the autopilot's clock"
    assert beside.offset_s == LATENCY_FREE_S + 0.004
    assert beside.apart_m < 0.01
    assert len(beside.heard) == 800


@pytest.mark.parametrize("booted_s", [None, LATENCY_FREE_S - 1700.0, LATENCY_FREE_S + 9.0])
def test_without_a_clock_or_with_a_wrong_one_the_positions_decide(
    tmp_path: Path, booted_s: float | None
) -> None:
    log = flight_log(tmp_path / "a.mcap", booted_s)
    beside = lay_beside(log, read_ulog(px4_log(tmp_path / "a.ulg")), "a.ulg")
    assert beside.how == "by where the positions fit best"
    assert beside.offset_s == pytest.approx(LATENCY_FREE_S, abs=0.01)
    assert beside.apart_m < 0.01


def test_another_flight_is_refused(tmp_path: Path) -> None:
    record = read_ulog(px4_log(tmp_path / "a.ulg", apart_m=1.5))
    with pytest.raises(BadInput, match="is not of this flight: at best"):
        lay_beside(flight_log(tmp_path / "a.mcap", LATENCY_FREE_S), record, "a.ulg")
    still = flight_log(tmp_path / "b.mcap", None, moves=False)
    with pytest.raises(BadInput, match="never moved"):
        lay_beside(still, record, "a.ulg")


def test_what_is_no_ulog_is_refused_in_a_sentence(tmp_path: Path) -> None:
    (tmp_path / "a.ulg").write_bytes(b"not a log")
    with pytest.raises(BadInput, match="cannot be read as PX4's log"):
        read_ulog(tmp_path / "a.ulg")
    with pytest.raises(BadInput, match="cannot be read as PX4's log"):
        read_ulog(tmp_path / "absent.ulg")
    empty = UlogFile()
    empty.topic("vehicle_status", [("uint8_t", "nav_state")], [(1.0, 99)])
    with pytest.raises(BadInput, match="holds no vehicle_local_position"):
        read_ulog(empty.save(tmp_path / "b.ulg"))


def test_a_log_without_setpoints_and_modes_has_none(tmp_path: Path) -> None:
    file = UlogFile()
    fields = [("float", name) for name in ("x", "y", "z", "vx", "vy", "vz")]
    file.topic("vehicle_local_position", fields, [(t / 10.0, *[0.0] * 6) for t in range(3)])
    record = read_ulog(file.save(tmp_path / "a.ulg"))
    assert record.nav_states == ()
    assert len(record.asked_position) == len(record.attitude) == 0
    assert np.all(record.position[:, 1:] == 0.0)
