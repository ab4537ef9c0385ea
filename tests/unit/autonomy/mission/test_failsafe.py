"""The table of faults and responses."""

import msgspec
import pytest

from autonomy.config import Config
from autonomy.mission.failsafe import (
    RULES,
    UNCERTAIN,
    Fault,
    Found,
    Response,
    Situation,
    detect,
    response_to,
)
from autonomy.model import Ending, FusedState
from hal.documents import validate_document
from hal.errors import DocumentError
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
    beams_lost: tuple[float, str] | None = None,
    mission_s: float = 10.0,
    config: Config = CONFIG,
    **rest: float | bool,
) -> list[Fault]:
    known = Situation(status, fused, lost_s, beams_lost, mission_s=mission_s)
    return [f.fault for f in detect(config, msgspec.structs.replace(known, **rest))]


def test_every_fault_has_a_response() -> None:
    assert set(RULES) == set(Fault)


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


def test_the_battery_returns_at_its_first_limit_and_lands_at_its_second() -> None:
    def at(left: float) -> list[Fault]:
        return faults(status=msgspec.structs.replace(STATUS, battery_remaining=left))

    assert at(LIMITS.battery_return + 0.01) == []
    assert at(LIMITS.battery_return) == [Fault.BATTERY_LOW]
    assert at(LIMITS.battery_land + 0.01) == [Fault.BATTERY_LOW]
    assert at(LIMITS.battery_land) == [Fault.BATTERY_CRITICAL, Fault.BATTERY_LOW]


def test_a_lost_state_holds_first_and_lands_later() -> None:
    assert faults(fused=LOST, lost_s=LIMITS.state_loss_land_s) == [Fault.STATE_LOST]
    assert faults(fused=LOST, lost_s=LIMITS.state_loss_land_s + 0.01) == [Fault.STATE_LOST_LONG]


def test_too_few_beams_hold_first_and_land_later() -> None:
    limit_s = LIMITS.sensor_loss_land_s
    assert faults(beams_lost=None) == []
    assert faults(beams_lost=(limit_s, "front, left")) == [Fault.BEAMS_LOST]
    assert faults(beams_lost=(limit_s + 0.01, "front, left")) == [Fault.BEAMS_LOST_LONG]


def test_one_beam_lost_stops_to_look_and_more_of_them_do_more() -> None:
    one = Situation(STATUS, FUSED, beam_lost_now="lost: beam front")
    (found,) = detect(CONFIG, one)
    assert (found.fault, found.response) == (Fault.BEAM_DOUBTED, Response.STOP)
    two = msgspec.structs.replace(one, beams_lost=(0.0, "front, left"))
    assert [item.fault for item in detect(CONFIG, two)] == [Fault.BEAMS_LOST]


def test_the_time_limit_ends_the_mission() -> None:
    limit_s = CONFIG.mission.time_limit_s
    assert faults(mission_s=limit_s) == []
    assert faults(mission_s=limit_s + 0.01) == [Fault.TIME_OVER]


def test_the_way_has_a_limit_where_one_is_set() -> None:
    short = Config.model_validate({"mission": {"path_limit_m": 12.0}})
    assert faults(path_m=1e6) == []
    assert faults(config=short, path_m=12.0) == []
    assert faults(config=short, path_m=12.1) == [Fault.PATH_OVER]


def test_uncertainty_slows_before_it_holds() -> None:
    limit_m = CONFIG.estimation.sigma_max_m

    def at(sigma_m: float) -> list[Fault]:
        return faults(
            fused=msgspec.structs.replace(
                FUSED, position_sigma_m=sigma_m, ok=sigma_m <= limit_m, why_not_ok="uncertain"
            )
        )

    assert at(UNCERTAIN * limit_m) == []
    assert at(UNCERTAIN * limit_m + 0.01) == [Fault.POSITION_UNCERTAIN]
    assert at(limit_m + 0.01) == [Fault.ESTIMATOR_DIVERGED]


def test_a_jump_of_the_frame_stops_from_its_limit_on() -> None:
    assert faults(jump_m=LIMITS.jump_stop_m - 0.01) == []
    assert faults(jump_m=LIMITS.jump_stop_m) == [Fault.POSITION_JUMPED]


def test_outside_the_fence_is_to_return_and_far_outside_to_land() -> None:
    assert faults(outside_m=LIMITS.fence_return_m) == []
    assert faults(outside_m=LIMITS.fence_return_m + 0.01) == [Fault.FENCE_LEFT]
    assert faults(outside_m=LIMITS.fence_land_m + 0.01) == [
        Fault.FENCE_LEFT_FAR,
        Fault.FENCE_LEFT,
    ]
    assert faults(fused=LOST, outside_m=9.0) == [Fault.STATE_LOST]


def test_a_drift_holds_first_and_lands_when_it_lasts_or_leads_to_something() -> None:
    def over(seconds: float) -> list[Fault]:
        return faults(drift_m=0.26, drift_limit_m=0.25, drift_s=seconds)

    assert faults(drift_m=0.25, drift_limit_m=0.25) == []
    assert over(LIMITS.drift_land_s) == [Fault.DRIFT]
    assert over(LIMITS.drift_land_s + 0.01) == [Fault.DRIFT_LONG]
    assert faults(drift_m=0.16, drift_limit_m=0.25, drift_near=True) == [Fault.DRIFT_LONG]


def test_the_strongest_response_comes_first() -> None:
    found = detect(CONFIG, Situation(STATUS, LOST, 0.5, (1.0, "front, left"), mission_s=1e6))
    assert [f.response for f in found] == sorted((f.response for f in found), reverse=True)
    assert found[0] == Found(Fault.TIME_OVER, found[0].why, Response.LAND)
    assert found[0].ending is Ending.BUDGET


@pytest.mark.parametrize(
    ("fault", "key"), [(fault, rule.key) for fault, rule in RULES.items() if rule.key]
)
def test_what_is_chosen_by_a_key_has_that_key(fault: Fault, key: str) -> None:
    section, name = key.split(".")
    assert name in type(getattr(CONFIG, section)).model_fields
    if section != "failsafe":
        return
    for word, response in (("land", Response.LAND), ("return", Response.RETURN)):
        config = Config.model_validate({section: {name: word}})
        flapping = RULES[fault].flapping is not None
        assert response_to(config, fault, flapping=flapping) is response
        assert not flapping or response_to(config, fault) is RULES[fault].response


def test_each_step_of_the_escalation_is_stronger_than_what_flaps() -> None:
    for rule in RULES.values():
        assert rule.flapping is None or rule.flapping > rule.response
        assert rule.words


@pytest.mark.parametrize(
    "wrong",
    [
        {"battery_land": 0.3},
        {"battery_return": 0.5},
        {"fence_return_m": 2.0},
        {"sensor_loss": "hover"},
    ],
)
def test_limits_that_make_no_sense_are_refused(wrong: dict[str, object]) -> None:
    with pytest.raises(DocumentError):
        validate_document({"failsafe": wrong}, Config, "test")


def test_a_return_has_a_time_limit_of_its_own_and_no_budget() -> None:
    late = CONFIG.mission.time_limit_s + 1.0
    assert faults(mission_s=late, returning=True) == []
