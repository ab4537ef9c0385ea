"""The table of faults and responses."""

import msgspec
import pytest

from autonomy.config import Config
from autonomy.mission.failsafe import RESPONSES, Fault, Found, Response, detect
from autonomy.model import Ending, FusedState
from hal.frames import ZERO3
from hal.readings import FlightMode, LandedState, VehicleStatus

CONFIG = Config()
LIMITS = CONFIG.failsafe
STATUS = VehicleStatus(0.0, True, FlightMode.OFFBOARD, LandedState.IN_AIR, 0.05)
FUSED = FusedState(0.0, ZERO3, ZERO3, 0.0, 0.03, 1.0, True)
LOST = msgspec.structs.replace(FUSED, ok=False, why_not_ok="stale")


def faults(
    status: VehicleStatus = STATUS,
    fused: FusedState = FUSED,
    lost_s: float = 0.0,
    silent: dict[str, float] | None = None,
    mission_s: float = 10.0,
) -> list[Fault]:
    return [f.fault for f in detect(CONFIG, status, fused, lost_s, silent or {}, mission_s)]


def test_every_fault_has_a_response() -> None:
    assert set(RESPONSES) == set(Fault)


def test_a_healthy_flight_has_no_faults() -> None:
    assert faults() == []


@pytest.mark.parametrize(
    ("just_good", "just_bad", "fault"),
    [
        (CONFIG.vehicle.link_timeout_s, CONFIG.vehicle.link_timeout_s + 0.01, Fault.LINK_LOST),
    ],
)
def test_the_link_is_lost_past_its_limit(just_good: float, just_bad: float, fault: Fault) -> None:
    assert faults(status=msgspec.structs.replace(STATUS, link_age_s=just_good)) == []
    assert faults(status=msgspec.structs.replace(STATUS, link_age_s=just_bad)) == [fault]


def test_the_battery_lands_at_its_limit() -> None:
    above = msgspec.structs.replace(STATUS, battery_remaining=LIMITS.battery_land + 0.01)
    at = msgspec.structs.replace(STATUS, battery_remaining=LIMITS.battery_land)
    assert faults(status=above) == []
    assert faults(status=at) == [Fault.BATTERY_LOW]


def test_a_lost_state_holds_first_and_lands_later() -> None:
    assert faults(fused=LOST, lost_s=LIMITS.state_loss_land_s) == [Fault.STATE_LOST]
    assert faults(fused=LOST, lost_s=LIMITS.state_loss_land_s + 0.01) == [Fault.STATE_LOST_LONG]


def test_a_silent_beam_is_forgiven_then_holds_then_lands() -> None:
    assert faults(silent={"front": LIMITS.sensor_loss_hold_s}) == []
    assert faults(silent={"front": LIMITS.sensor_loss_hold_s + 0.01}) == [Fault.BEAM_SILENT]
    long = {"left": 0.6, "front": LIMITS.sensor_loss_land_s + 0.01}
    assert faults(silent=long) == [Fault.BEAM_SILENT_LONG]


def test_the_time_limit_ends_the_mission() -> None:
    limit_s = CONFIG.mission.time_limit_s
    assert faults(mission_s=limit_s) == []
    assert faults(mission_s=limit_s + 0.01) == [Fault.TIME_OVER]


def test_the_strongest_response_comes_first() -> None:
    found = detect(CONFIG, STATUS, LOST, 0.5, {"front": 1.0}, 1e6)
    assert [f.response for f in found] == sorted((f.response for f in found), reverse=True)
    assert found[0] == Found(Fault.TIME_OVER, found[0].why)
    assert found[0].ending is Ending.BUDGET
    assert found[0].response is Response.LAND
