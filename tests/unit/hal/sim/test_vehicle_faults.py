import math

import numpy as np
import pytest

from hal.documents import validate_document
from hal.frames import ZERO3, Vector3
from hal.sim.autopilot import Autopilot
from hal.sim.fault_clock import FaultClock
from hal.sim.fault_kinds import parse_fault
from hal.sim.px4 import Mode, Result, SystemStatus
from hal.sim.scenario import Scenario
from hal.sim.sensors import EstimateOffset
from hal.sim.vehicle_faults import ARMING_REFUSAL, EstimateFaults, VehicleFaults

EXACT = EstimateOffset(ZERO3, ZERO3, 0.0)
STEP_S = 0.02


class Flown:
    """An autopilot with faults, on its own time."""

    def __init__(self, *lines: str, parameters: dict[str, float] | None = None) -> None:
        document = {"name": "test", "vehicle": {"parameters": parameters or {}}}
        world = validate_document(document, Scenario, "test.yaml")
        self.pilot = Autopilot(world, np.random.default_rng(1))
        faults = tuple(map(parse_fault, lines))
        self.faults = VehicleFaults(self.pilot, faults, FaultClock())
        self.step(0.1)

    def step(self, seconds: float) -> None:
        for _ in range(round(seconds / STEP_S)):
            self.faults.step(self.pilot.now_s)
            self.pilot.step(STEP_S, EXACT)

    def take_off(self) -> None:
        assert self.pilot.arm() is Result.ACCEPTED
        self.pilot.takeoff()
        self.step(10.0)
        assert self.pilot.mode is Mode.HOLD
        assert self.pilot.airborne

    def offboard(self) -> Result:
        self.pilot.set_setpoint(velocity_ned_m_s=ZERO3)
        return self.pilot.set_mode(Mode.OFFBOARD.main)

    def silent(self) -> bool:
        return self.pilot.silent

    def mode(self) -> Mode:
        return self.pilot.mode

    @property
    def said(self) -> list[str]:
        return [text.text for text in self.pilot.texts]


def test_a_battery_is_at_what_was_asked_and_back_afterwards() -> None:
    flown = Flown("battery@1/2:remaining=0.3")
    assert flown.pilot.battery_remaining == 1.0
    flown.step(1.5)
    assert flown.pilot.battery_remaining == 0.3
    flown.step(2.0)
    assert flown.pilot.battery_remaining == 1.0


@pytest.mark.parametrize(
    ("remaining", "action", "mode"),
    [
        (0.14, 3, Mode.HOLD),
        (0.06, 3, Mode.RETURN),
        (0.06, 2, Mode.LAND),
        (0.04, 3, Mode.LAND),
        (0.04, 0, Mode.HOLD),
    ],
)
def test_px4_acts_on_a_low_battery_in_the_air(remaining: float, action: int, mode: Mode) -> None:
    line = f"battery@liftoff+8:remaining={remaining}"
    flown = Flown(line, parameters={"COM_LOW_BAT_ACT": action})
    flown.take_off()
    flown.step(2.5)
    assert flown.pilot.mode is mode
    assert flown.pilot.in_failsafe == (mode is not Mode.HOLD)


@pytest.mark.parametrize("remaining", [0.06, 0.04])
def test_what_a_pilot_chooses_after_a_battery_failsafe_stays(remaining: float) -> None:
    flown = Flown(f"battery@liftoff+8:remaining={remaining}")
    flown.take_off()
    flown.step(2.5)
    flown.pilot.set_mode(Mode.HOLD.main, Mode.HOLD.sub)
    flown.step(3.0)
    assert flown.pilot.mode is Mode.HOLD


@pytest.mark.parametrize(("times", "expected"), [("", [1, 1, 1]), (",times=2", [1, 1, 0])])
def test_offboard_is_refused_as_often_as_asked(times: str, expected: list[int]) -> None:
    flown = Flown("offboard_refused@0/900" + (":" + times[1:] if times else ""))
    flown.take_off()
    results = []
    for _ in expected:
        results.append(int(flown.offboard()))
        flown.step(0.1)
    assert results == expected
    assert "Switching to Offboard is currently not available" in flown.said


def test_a_refused_arming_gives_its_reason_and_the_health_report_says_so_before() -> None:
    flown = Flown("arming_refused@0/5:reason=Preflight Fail: no compass")
    assert flown.pilot.not_armable_because == "Preflight Fail: no compass"
    assert flown.pilot.system_status is SystemStatus.UNINIT
    assert flown.pilot.arm() is Result.TEMPORARILY_REJECTED
    assert flown.said[-2:] == ["Preflight Fail: no compass", ARMING_REFUSAL]
    flown.step(5.0)
    assert flown.pilot.not_armable_because == ""
    assert flown.pilot.arm() is Result.ACCEPTED


def test_an_unannounced_refusal_is_no_news_before_it_comes() -> None:
    flown = Flown("arming_refused:announced=false,times=1")
    assert flown.pilot.not_armable_because == ""
    assert flown.pilot.arm() is Result.TEMPORARILY_REJECTED
    flown.step(0.1)
    assert flown.pilot.arm() is Result.ACCEPTED


@pytest.mark.parametrize("mode", ["hold", "return", "land"])
def test_a_failsafe_of_px4s_own_is_not_ended_by_setpoints(mode: str) -> None:
    flown = Flown(f"px4_failsafe@liftoff+7:mode={mode}")
    flown.take_off()
    assert flown.offboard() is Result.ACCEPTED
    for _ in range(200):
        flown.pilot.set_setpoint(velocity_ned_m_s=ZERO3)
        flown.step(STEP_S)
    assert flown.pilot.in_failsafe
    assert flown.pilot.mode is Mode[mode.upper()]
    assert flown.pilot.intended_mode is Mode.OFFBOARD


def test_a_pilot_may_take_modes_that_no_command_could() -> None:
    flown = Flown("pilot_takeover@liftoff+7:mode=position")
    flown.take_off()
    assert flown.pilot.set_mode(Mode.POSITION.main) is Result.TEMPORARILY_REJECTED
    flown.step(5.0)
    assert flown.mode() is Mode.POSITION
    assert not flown.pilot.in_failsafe
    flown.pilot.set_mode(Mode.HOLD.main, Mode.HOLD.sub)
    flown.step(1.0)
    assert flown.mode() is Mode.HOLD  # it happens once


def test_a_second_companion_flies_the_vehicle_when_it_is_in_offboard() -> None:
    flown = Flown("second_companion@liftoff+12/4:east_m_s=0.5")
    flown.take_off()
    flown.offboard()
    flown.step(0.5)
    before = flown.pilot.quadrotor.position_ned_m
    while flown.pilot.now_s < 40.0 and not flown.faults.second_companion:
        flown.offboard()
        flown.step(STEP_S)
    flown.step(3.0)
    assert flown.pilot.quadrotor.position_ned_m[1] - before[1] > 0.6


def test_a_restart_cuts_the_motors_begins_anew_and_keeps_parameters() -> None:
    flown = Flown("reboot@liftoff+12:boot_s=3")
    flown.pilot.set_parameter("MPC_XY_CRUISE", 2.0)
    flown.take_off()
    flown.offboard()
    while flown.pilot.armed:
        flown.pilot.set_setpoint(velocity_ned_m_s=(0.5, 0.0, 0.0))
        flown.step(STEP_S)
        assert flown.pilot.now_s < 60.0
    pilot = flown.pilot
    assert flown.silent()
    assert pilot.uptime_s < 0.1
    height_m = pilot.quadrotor.height_m
    assert height_m > 1.0
    flown.step(1.5)
    assert not flown.silent()
    assert pilot.quadrotor.on_ground  # it fell
    assert pilot.arm() is Result.TEMPORARILY_REJECTED
    flown.step(2.0)
    assert pilot.arm() is Result.ACCEPTED
    assert pilot.parameters["MPC_XY_CRUISE"] == 2.0
    # Its frame begins where it was when it started, high in the air.
    assert pilot.estimated_position_ned_m[2] == pytest.approx(height_m, abs=0.1)
    assert math.hypot(*pilot.estimated_position_ned_m[:2]) < 0.7


# ---------------------------------------------------------------- the estimate


def spoilt(faults: EstimateFaults, now_s: float) -> tuple[Vector3, float, Vector3 | None]:
    offset, jump = faults.spoil(now_s, EXACT)
    return offset.position_ned_m, offset.yaw_rad, jump.position_ned_m if jump else None


def test_a_reset_jumps_once_tells_so_and_jumps_back() -> None:
    fault = parse_fault("ekf_reset@2/3:north_m=0.5,yaw_deg=90")
    faults = EstimateFaults([fault], FaultClock())
    assert spoilt(faults, 1.0) == (ZERO3, 0.0, None)
    assert spoilt(faults, 2.0) == ((0.5, 0.0, 0.0), math.pi / 2.0, (0.5, 0.0, 0.0))
    assert spoilt(faults, 2.1) == ((0.5, 0.0, 0.0), math.pi / 2.0, None)
    assert faults.resets == 1
    assert spoilt(faults, 5.0) == (ZERO3, 0.0, (-0.5, 0.0, 0.0))
    assert faults.resets == 2


def test_a_drift_goes_on_while_it_lasts_and_stays_where_it_got_to() -> None:
    fault = parse_fault("position_drift@2/10:east_m_s=0.1")
    faults = EstimateFaults([fault], FaultClock())
    for now_s, off_m, drifting in ((1.0, 0.0, 0.0), (7.0, 0.5, 0.1), (12.0, 1.0, 0.0), (90, 1, 0)):
        offset, jump = faults.spoil(now_s, EXACT)
        assert offset.position_ned_m == pytest.approx((0.0, off_m, 0.0))
        assert offset.velocity_ned_m_s == pytest.approx((0.0, drifting, 0.0))
        assert jump is None
    assert faults.resets == 0


def test_a_jump_of_the_frame_moves_what_px4_holds_but_not_the_vehicle() -> None:
    flown = Flown()
    flown.take_off()
    before = flown.pilot.quadrotor.position_ned_m
    faults = EstimateFaults(
        [parse_fault("ekf_reset:north_m=3,down_m=0.5,yaw_deg=40")], FaultClock()
    )
    for _ in range(400):
        offset, jump = faults.spoil(flown.pilot.now_s, EXACT)
        if jump is not None:
            flown.pilot.shift_estimate(jump.position_ned_m, jump.yaw_rad)
        flown.pilot.step(STEP_S, offset)
    after = flown.pilot.quadrotor.position_ned_m
    assert math.dist(before, after) < 0.15
    assert flown.pilot.estimated_position_ned_m[0] == pytest.approx(3.0, abs=0.15)
    assert flown.pilot.home_ned_m[0] == pytest.approx(3.0, abs=0.05)
