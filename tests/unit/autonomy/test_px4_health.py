"""PX4's health report in words."""

import json
import struct
from pathlib import Path

from autonomy.px4_health import (
    CHECKS,
    NAV_STATES,
    Event,
    SensorReport,
    event_id,
    failed_checks,
    unwell,
)

GOLDEN = Path(__file__).parents[2] / "golden" / "px4"
ALL = 0xFFFFFFFF


def failed(name: str, modes: int = ALL, level: int = 3) -> Event:
    return Event(event_id(name), level, tuple(struct.pack("<IB", modes, 0)) + (0,) * 35)


def test_ids_are_those_that_were_measured() -> None:
    names = json.loads((GOLDEN / "events.json").read_text())["names"]
    assert len(names) > 20
    for number, name in names.items():
        assert event_id(name) == int(number), name


def test_checks_that_were_measured_have_words() -> None:
    names = json.loads((GOLDEN / "events.json").read_text())["names"].values()
    assert [name for name in names if name.startswith("check_") and name not in CHECKS] == []
    assert len({event_id(name) for name in CHECKS}) == len(CHECKS)


def test_a_failed_check_counts_for_the_modes_that_it_forbids() -> None:
    hold_only = failed("check_modes_global_pos", 1 << NAV_STATES["hold"])
    assert hold_only.forbids("hold")
    assert not hold_only.forbids("takeoff")
    assert hold_only.forbids("a mode without a number"), "unknown is no reason to be silent"
    (words,) = failed_checks([hold_only, hold_only], "hold")
    assert "global position" in words
    assert failed_checks([hold_only], "takeoff") == ()


def test_warnings_and_other_events_forbid_nothing() -> None:
    assert failed_checks([failed("check_modes_manual_control", level=4)], "hold") == ()
    assert failed_checks([failed("commander_armed_by")], "hold") == ()
    assert failed_checks([Event(event_id("check_battery_low"), 2, ())], "hold") == ()


def test_the_internal_level_does_not_count() -> None:
    event = failed("check_modes_local_pos", level=0x63)
    assert event.level == 3
    assert event.forbids("takeoff")


def test_only_sensors_that_are_there_and_used_are_called_unwell() -> None:
    gyro, compass, transmitter = 0x1, 0x4, 0x1_0000
    assert unwell(SensorReport(gyro | compass, gyro | compass | transmitter, gyro)) == ("compass",)
    assert unwell(SensorReport(0x0300C02F, 0x0301C02F, 0x1320C83F)) == ()  # measured, standby
