"""What forbids arming, and which goals no flight is started for."""

import math

import msgspec
import pytest

from autonomy.config import Config
from autonomy.errors import BadInput
from autonomy.mission.preflight import (
    check_route,
    findings,
    hold_keeps_down,
    parameter_findings,
)
from autonomy.model import FusedState
from hal.frames import ZERO3, Vector3
from hal.readings import FlightMode, LandedState, VehicleFacts, VehicleStatus

CONFIG = Config()
FACTS = VehicleFacts("px4", "1.16.0", 1, {"COM_OBL_RC_ACT": 5.0, "COM_OF_LOSS_T": 1.0})
STATUS = VehicleStatus(0.0, False, FlightMode.HOLD, LandedState.ON_GROUND, 0.05)
FUSED = FusedState(0.0, ZERO3, ZERO3, 0.0, 0.03, 0.0, True)


def only(found: tuple[str, ...]) -> str:
    assert len(found) == 1, found
    return found[0]


def test_a_healthy_vehicle_may_arm() -> None:
    assert findings(CONFIG, FACTS, STATUS, FUSED, ()) == ()


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ({"link_age_s": 5.0}, "silent"),
        ({"landed": LandedState.IN_AIR}, "already in the air"),
        ({"armed": True}, "already armed"),
        ({"armable": False, "not_armable_because": "no compass"}, "no compass"),
        ({"battery_remaining": 0.2}, "battery"),
    ],
)
def test_each_thing_wrong_with_the_vehicle_is_one_sentence(
    change: dict[str, object], word: str
) -> None:
    status = msgspec.structs.replace(STATUS, **change)
    assert word in only(findings(CONFIG, FACTS, status, FUSED, ()))


def test_without_position_or_beams_nothing_arms() -> None:
    lost = msgspec.structs.replace(FUSED, ok=False, why_not_ok="no GPS")
    assert "no GPS" in only(findings(CONFIG, FACTS, STATUS, lost, ()))
    assert "front, left" in only(findings(CONFIG, FACTS, STATUS, FUSED, ("front", "left")))


@pytest.mark.parametrize("action", [0.0, 1.0, 2.0, 3.0, 6.0, 7.0])
def test_px4_must_stop_when_this_program_dies(action: float) -> None:
    sentence = only(parameter_findings({"COM_OBL_RC_ACT": action}))
    assert "COM_OBL_RC_ACT" in sentence
    assert "Hold" in sentence


@pytest.mark.parametrize("action", [4.0, 5.0])
def test_hold_and_land_are_good_answers_to_a_dead_program(action: float) -> None:
    assert parameter_findings({"COM_OBL_RC_ACT": action, "COM_OF_LOSS_T": 1.0}) == ()


def test_an_unknown_or_slow_offboard_failsafe_is_found() -> None:
    assert "does not tell" in only(parameter_findings({}))
    slow = parameter_findings({"COM_OBL_RC_ACT": 5.0, "COM_OF_LOSS_T": 1.01})
    assert "COM_OF_LOSS_T" in only(slow)


@pytest.mark.parametrize("action", [2.0, 5.0, 6.0])
def test_px4_must_not_climb_when_its_ground_station_is_gone(action: float) -> None:
    parameters = {"COM_OBL_RC_ACT": 5.0, "NAV_DLL_ACT": action}
    assert "NAV_DLL_ACT" in only(parameter_findings(parameters))
    for good in (0.0, 1.0, 3.0):
        assert parameter_findings({**parameters, "NAV_DLL_ACT": good}) == ()


def test_the_guards_gain_must_be_px4s() -> None:
    parameters = {"COM_OBL_RC_ACT": 5.0, "MPC_XY_P": 2.0}
    assert "position_gain_per_s" in only(parameter_findings(parameters, 0.95))
    assert parameter_findings({**parameters, "MPC_XY_P": 1.0}, 0.95) == ()


def test_a_covered_lens_keeps_the_vehicle_on_the_ground() -> None:
    found = findings(CONFIG, FACTS, STATUS, FUSED, (), covered_beams=("front", "left"))
    assert "front, left see something inside the vehicle's own body" in only(found)


def test_there_must_be_room_above_for_the_take_off() -> None:
    needed_m = CONFIG.mission.altitude_m + CONFIG.guard.beam_stop_m
    low = findings(CONFIG, FACTS, STATUS, FUSED, (), needed_m - 0.01)
    assert "above the vehicle" in only(low)
    assert findings(CONFIG, FACTS, STATUS, FUSED, (), needed_m) == ()


def test_a_goal_in_the_room_is_accepted() -> None:
    check_route(CONFIG, ((4.0, 3.0, -1.0), (0.0, 0.0, -0.5)))


@pytest.mark.parametrize(
    ("goal", "word"),
    [
        ((11.0, 0.0, -1.0), "outside the geofence"),
        ((9.98, 0.0, -1.0), "on the geofence's edge"),
        ((math.nan, 0.0, -1.0), "not a number"),
        ((math.inf, 0.0, -1.0), "not a number"),
        ((1.0, 0.0, -5.0), "altitude band"),
        ((1.0, 0.0, -0.1), "altitude band"),
    ],
)
def test_a_goal_that_must_not_be_flown_to_is_one_sentence(goal: Vector3, word: str) -> None:
    with pytest.raises(BadInput, match=word) as error:
        check_route(CONFIG, ((1.0, 1.0, -1.0), goal))
    assert str(error.value).startswith("goal 2")


def test_no_goal_at_all_is_refused() -> None:
    with pytest.raises(BadInput, match="--goal"):
        check_route(CONFIG, ())


def test_what_a_missing_global_position_has_to_do_with_it_is_said() -> None:
    status = msgspec.structs.replace(
        STATUS, armable=False, not_armable_because="Arming denied", global_position=False
    )
    assert hold_keeps_down(status)
    sentence = only(findings(CONFIG, FACTS, status, FUSED, ()))
    assert "Arming denied; it knows no global position, which its mode hold needs" in sentence
    assert "SET_GPS_GLOBAL_ORIGIN" in sentence
    flown_by_hand = msgspec.structs.replace(status, mode=FlightMode.MANUAL)
    assert not hold_keeps_down(flown_by_hand)
    assert "global" not in only(findings(CONFIG, FACTS, flown_by_hand, FUSED, ()))


def test_a_vehicle_that_needs_no_global_position_is_not_blamed_for_it() -> None:
    status = msgspec.structs.replace(STATUS, global_position=False)
    assert findings(CONFIG, FACTS, status, FUSED, ()) == ()


def test_where_a_position_could_come_from_is_said() -> None:
    lost = msgspec.structs.replace(FUSED, ok=False, why_not_ok="no local position yet")
    status = msgspec.structs.replace(STATUS, global_position=False)
    assert "optical flow" in only(findings(CONFIG, FACTS, status, lost, ()))
    assert "optical flow" not in only(findings(CONFIG, FACTS, STATUS, lost, ()))
