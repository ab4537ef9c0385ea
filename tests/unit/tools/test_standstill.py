"""How long a vehicle still moves: read from true states and from setpoints on the wire."""

import math
from typing import Any

import pytest

from tools.standstill.__main__ import bound_kept, cell, main, section
from tools.standstill.faults import FAULTS, Duty
from tools.standstill.measure import Measured, judged, standing_from, stopped_s


def states(*speeds_m_s: float, mode: str = "offboard") -> list[dict[str, Any]]:
    """20 Hz of flight north at these speeds."""
    found: list[dict[str, Any]] = []
    north = 0.0
    for index, speed in enumerate(speeds_m_s):
        north += 0.05 * speed
        found.append(
            {
                "t": 100.0 + 0.05 * index,
                "position_ned_m": [north, 0.0, -1.0],
                "velocity_ned_m_s": [speed, 0.0, 0.0],
                "clearance_m": 0.5,
                "collided": False,
                "in_air": True,
                "armed": True,
                "mode": mode,
            }
        )
    return found


def measured(fault: str, **changes: Any) -> Measured:
    values: dict[str, Any] = {
        "fault": fault,
        "state": "cruise",
        "speed_m_s": 0.2,
        "stopped_s": 0.3,
        "standing_s": 0.7,
        "moved_m": 0.1,
        "end": "landed",
        "exit_code": 1,
        "clearance_m": 0.4,
        "harmed": "",
    }
    return Measured(**(values | changes))


def test_it_stands_when_it_has_been_at_rest_for_half_a_second() -> None:
    slowing = states(0.2, 0.2, 0.1, *[0.01] * 11)
    assert standing_from(slowing) == 3
    assert standing_from(states(0.2, 0.01, 0.01, 0.2, *[0.0] * 11)) == 4
    assert standing_from(states(0.2, 0.01, 0.01)) is None
    assert standing_from(states(*[0.0] * 11)) == 0


def test_on_the_ground_it_stands_however_short_the_record_is() -> None:
    landed = states(0.2, 0.0)
    landed[-1]["in_air"] = False
    landed[0]["in_air"] = False
    assert standing_from(landed) == 1


def test_a_stop_on_the_wire_counts_when_it_stays() -> None:
    flying = states(*[0.2] * 40)
    sent = [(-0.05, 0.2), (0.0, 0.2), (0.05, 0.0), (0.1, 0.2), (0.15, 0.2)]
    sent += [(0.2 + 0.05 * n, 0.0) for n in range(10)]
    assert stopped_s(flying, sent) == pytest.approx(0.2)
    assert math.isnan(stopped_s(flying, [(0.05 * n, 0.2) for n in range(20)]))
    assert stopped_s(flying, [(-0.5, 0.2), (-0.2, 0.0), (0.3, 0.0), (0.7, 0.0)]) == 0.0


def test_a_mode_of_px4_s_own_is_a_stop_too() -> None:
    record = states(*[0.2] * 20) + states(*[0.2] * 5, mode="hold")
    for index, state in enumerate(record):
        state["t"] = 100.0 + 0.05 * index
    assert stopped_s(record, [(-0.05, 0.2)]) == pytest.approx(1.0)


def test_what_came_of_it_is_told() -> None:
    record = states(*[0.2] * 5, 0.2, 0.1, *[0.0] * 12)
    record[-1]["in_air"], record[-1]["armed"] = False, False
    row = judged("step raises", "cruise", record, 6, 1, [(0.05 + 0.05 * n, 0.0) for n in range(9)])
    assert row.speed_m_s == 0.2
    assert row.standing_s == pytest.approx(0.1)
    assert row.moved_m == pytest.approx(0.005)
    assert row.end == "landed"
    assert row.harmed == ""


def test_harm_is_told() -> None:
    record = states(0.2, 0.2)
    record[1]["collided"] = True
    assert "touched something at 100.0 s" in judged("x", "cruise", record, 1, None, []).harmed
    record = states(0.2, 0.2)
    record[1]["armed"] = False
    assert "disarmed in the air" in judged("x", "cruise", record, 1, None, []).harmed


def test_each_duty_has_its_bound() -> None:
    by_duty = {fault.duty: fault.name for fault in FAULTS}
    stop, gone, fly_on = by_duty[Duty.STOP], by_duty[Duty.GONE], by_duty[Duty.FLY_ON]
    leash = by_duty[Duty.LEASH]
    assert bound_kept(measured(stop, stopped_s=0.5))
    assert not bound_kept(measured(stop, stopped_s=0.51))
    assert not bound_kept(measured(stop, stopped_s=math.nan))
    assert bound_kept(measured(stop, stopped_s=math.nan, state="takeoff"))
    assert bound_kept(measured(gone, stopped_s=1.3))
    assert not bound_kept(measured(gone, stopped_s=1.4))
    assert bound_kept(measured(leash, stopped_s=math.nan, moved_m=0.25))
    assert not bound_kept(measured(leash, moved_m=0.31))
    assert bound_kept(measured(fly_on, exit_code=None, stopped_s=math.nan, later_m=0.3))
    assert not bound_kept(measured(fly_on, exit_code=None, stopped_s=math.nan, later_m=0.29))
    assert bound_kept(measured(fly_on, exit_code=0, later_m=0.0))
    assert bound_kept(measured(fly_on, exit_code=None, state="takeoff"))
    assert not bound_kept(measured(fly_on, exit_code=1))


def test_the_table_names_what_was_late_and_what_was_harmed() -> None:
    rows = [
        measured("step raises"),
        measured("killed (SIGKILL)", stopped_s=1.5, exit_code=-9, end="PX4 hold"),
        measured("disk full", exit_code=None, later_m=1.5, harmed="touched something at 3.0 s"),
    ]
    text = section(rows)
    assert "| step raises | 0.30 / 0.70 s, 0.10 m: landed, exit 1 |" in text
    assert "| disk full | flew on |" in text
    assert "Later than the bound: 1 of 3." in text
    assert "- killed (SIGKILL), cruise: 1.50 / 0.70 s, 0.10 m: PX4 hold, exit -9" in text
    assert "Harmed: 1." in text
    assert "- disk full, cruise: touched something at 3.0 s" in text
    assert cell(rows[2]) == "flew on"


def test_a_program_that_hangs_for_ever_did_not_go_on() -> None:
    flown = judged("disk full", "cruise", states(*[0.2] * 400), 1, None, [])
    hung = judged("disk full", "cruise", states(*[0.2] * 150, *[0.0] * 250), 1, None, [])
    assert flown.later_m == pytest.approx(2.0, abs=0.02)
    assert hung.later_m == 0.0
    assert bound_kept(flown)
    assert not bound_kept(hung)
    assert cell(flown) == "flew on"
    assert "flies on" in cell(hung)


@pytest.mark.parametrize(("stopped_s", "code"), [(0.4, 0), (0.6, 1), (math.nan, 1)])
def test_a_stop_that_comes_too_late_is_told_by_the_exit_code(
    monkeypatch: pytest.MonkeyPatch, stopped_s: float, code: int
) -> None:
    rows = [measured("step raises", stopped_s=stopped_s)]
    monkeypatch.setattr("tools.standstill.__main__.campaign", lambda *_: rows)
    assert main(["--fault", "step raises", "--state", "cruise"]) == code
