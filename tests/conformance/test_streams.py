"""What PX4 sends without having been asked: rates, sources, texts and to whom they go."""

import json
from typing import Any

import pytest
from pymavlink.dialects.v20 import development as mavlink

from tests.conformance.conftest import Needs
from tests.conformance.link import COMPANION, STATION, MockLink, message_name
from tests.conformance.transcript import GOLDEN
from tests.conformance.vehicle import Vehicle

MEASURED: dict[str, Any] = json.loads((GOLDEN / "protocol.json").read_text())
LOGGING = 0x01000000
STATES = {"standby": 0, "hover": 1, "offboard": 2}


@pytest.mark.parametrize("state", STATES)
def test_every_message_keeps_its_rate(vehicle: Vehicle, needs: Needs, state: str) -> None:
    if state != "standby":
        needs("flight")
    vehicle.prepare(state)
    before, from_s = vehicle.link.counts.copy(), vehicle.link.now_s
    vehicle.link.run(12.0)
    seconds = vehicle.link.now_s - from_s
    came = {message_name(n): c for n, c in (vehicle.link.counts - before).items()}
    measured = {name: rates[STATES[state]] for name, rates in MEASURED["rates_hz"].items()}
    off = {
        name: (rate_hz, came.get(name, 0) / seconds)
        for name, rate_hz in measured.items()
        if abs(came.get(name, 0) - rate_hz * seconds) > 1.5 + 0.03 * rate_hz * seconds
    }
    assert off == {}
    # EVENT and its like come when something happens; ranges depend on what is fitted.
    unmeasured = set(came) - set(measured) - {"EVENT", "STATUSTEXT", "DISTANCE_SENSOR"}
    assert unmeasured <= {"COMMAND_LONG"}


def test_the_parts_of_sys_status_are_as_measured(vehicle: Vehicle, needs: Needs) -> None:
    needs("reference")
    vehicle.standby()
    status = vehicle.link.last(1)
    assert status is not None
    measured = MEASURED["sys_status"]
    # The logger's bit comes with the first log: it says how the autopilot was started.
    assert status.onboard_control_sensors_present | LOGGING == measured["present"]
    assert status.onboard_control_sensors_enabled | LOGGING == measured["enabled"]
    assert status.onboard_control_sensors_health == measured["health"]


def test_the_battery_drains_to_a_half_while_armed_and_is_full_again(
    vehicle: Vehicle, needs: Needs
) -> None:
    needs("simulated", "flight")
    vehicle.prepare("hover")
    vehicle.link.run(30.0)
    low = vehicle.link.last(1)
    assert low is not None
    assert low.battery_remaining == pytest.approx(50, abs=2)
    assert low.voltage_battery == pytest.approx(15300, abs=30)
    assert low.current_battery == -1
    vehicle.standby()

    def left_percent() -> int:
        status = vehicle.link.last(1)
        assert status is not None
        return int(status.battery_remaining)

    vehicle.link.until(lambda: left_percent() == 100, 30.0, "full again")
    full = vehicle.link.last(1)
    assert full is not None
    assert full.voltage_battery == 16200


def texts_since(vehicle: Vehicle, at_s: float) -> list[str]:
    return [h.message.text for h in vehicle.link.since(at_s, "STATUSTEXT")]


def test_texts_go_only_where_a_ground_station_is_heard_events_everywhere(
    vehicle: Vehicle, needs: Needs
) -> None:
    needs("arm")
    vehicle.standby()
    vehicle.link.hush(STATION)
    vehicle.link.beat(COMPANION)
    vehicle.link.run(4.0)
    quiet_s = vehicle.link.now_s
    assert vehicle.ask(400, 1.0) == 0
    vehicle.link.run(1.0)
    assert vehicle.ask(400, 0.0) == 0
    vehicle.link.run(1.0)
    assert texts_since(vehicle, quiet_s) == []
    assert len(vehicle.link.since(quiet_s, "EVENT")) >= 2
    vehicle.link.beat(STATION)
    vehicle.link.run(1.0)
    late = [t for t in texts_since(vehicle, quiet_s) if "[logger]" not in t]
    assert late == ["Armed by external command\t", "Disarmed by external command\t"]


def test_texts_end_in_a_tab_and_long_ones_come_in_chunks(vehicle: Vehicle) -> None:
    vehicle.standby()
    from_s = vehicle.link.now_s
    vehicle.link.send(
        mavlink.MAVLink_set_position_target_local_ned_message(
            *(0, vehicle.link.system, 1, mavlink.MAV_FRAME_BODY_OFFSET_NED, 0x5C7, *(0.0,) * 11)
        )
    )
    vehicle.link.run(0.5)
    chunks = [h.message for h in vehicle.link.since(from_s, "STATUSTEXT")]
    assert [(c.severity, c.text, c.chunk_seq) for c in chunks] == [
        (2, "SET_POSITION_TARGET_LOCAL_NED coordinate frame 9 u", 0),
        (2, "nsupported\t", 1),
    ]
    assert chunks[0].id == chunks[1].id != 0


def test_events_are_numbered_and_the_last_number_is_told(vehicle: Vehicle, needs: Needs) -> None:
    needs("arm")
    vehicle.standby()
    from_s = vehicle.link.now_s
    assert vehicle.ask(400, 1.0) == 0
    vehicle.link.run(2.0)
    assert vehicle.ask(400, 0.0) == 0
    vehicle.link.run(4.0)
    events = [h.message for h in vehicle.link.since(from_s, "EVENT")]
    numbers = [event.sequence for event in events]
    assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))
    armed = next(e for e in events if e.id == 26266355)
    assert bytes(armed.arguments).rstrip(b"\0") == b"\x04"
    assert armed.event_time_boot_ms * 1e-3 == pytest.approx(from_s, abs=0.3)
    told = vehicle.link.since(vehicle.link.now_s - 3.2, "CURRENT_EVENT_SEQUENCE")
    assert told[-1].message.sequence == numbers[-1]


def test_home_is_where_it_was_armed_the_origin_stays(vehicle: Vehicle, needs: Needs) -> None:
    needs("flight")
    vehicle.standby()
    x, y, z = vehicle.position_ned_m
    vehicle.prepare("hover")
    vehicle.link.run(2.5)
    home = vehicle.link.last(242)
    assert home is not None
    assert (home.x, home.y) == pytest.approx((x, y), abs=0.3)
    assert home.z == pytest.approx(z, abs=0.5)
    taken_off = vehicle.link.since(0.0, "STATUSTEXT")
    at_s = [h.at_s for h in taken_off if h.message.text == "Takeoff detected\t"][-1]
    assert home.time_usec * 1e-6 == pytest.approx(at_s, abs=0.3)
    assert vehicle.ask(512, 49.0) == 0
    vehicle.link.run(0.2)
    origin = vehicle.link.last(49)
    assert origin is not None
    assert home.latitude == pytest.approx(origin.latitude + home.x * 89.8, abs=20)


def test_landing_makes_px4_look_for_a_gimbal(vehicle: Vehicle, needs: Needs) -> None:
    needs("flight")
    vehicle.prepare("hover")
    from_s = vehicle.link.now_s
    vehicle.command(21)
    vehicle.link.run(4.0)
    asked = [h.message for h in vehicle.link.since(from_s, "COMMAND_LONG")]
    assert [(a.command, a.confirmation) for a in asked] == [
        *((1001, 0), (1000, 0), (1001, 0)),
        *((1001, 1), (1001, 2), (1001, 3)),
    ]
    assert {(a.target_system, a.target_component) for a in asked} == {(vehicle.link.system, 0)}


def test_it_is_armable_only_after_four_seconds(link: MockLink, needs: Needs) -> None:
    needs("mock")
    fresh = MockLink(link.plant.scenario, boot_s=4.2)
    try:
        booting = Vehicle(fresh, {})
        tries: dict[float, int] = {}
        while fresh.now_s < 5.0:
            tries[fresh.now_s] = booting.ask(400, 1.0)
            fresh.run(0.25)
        denied = [at_s for at_s, result in tries.items() if result == 1]
        accepted = [at_s for at_s, result in tries.items() if result == 0]
        assert max(denied) < min(accepted)
        assert min(accepted) == pytest.approx(4.25, abs=0.3)
        said = [h.message.text for h in fresh.since(0.0, "STATUSTEXT")]
        assert said.count("Preflight Fail: no heading reference") == 1
    finally:
        fresh.close()
