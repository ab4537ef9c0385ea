import numpy as np
import pytest

from hal.clock import SimClock
from hal.errors import ConnectionFailed
from hal.frames import norm, subtract
from hal.readings import FlightMode, LandedState
from hal.setpoints import Reply, Request, RequestKind, Setpoint
from hal.sim.autopilot import Autopilot
from hal.sim.scenario import EstimatorSimulation
from hal.sim.sensors import EstimatorError
from hal.sim.vehicle import ASKED_PARAMETERS, SimVehicle
from tests.support.px4 import scenario


def make(*, boot_s: float = 0.0, noisy: bool = False) -> SimVehicle:
    clock = SimClock(100.0)
    pilot = Autopilot(scenario(0.2, COM_OBL_RC_ACT=5.0), np.random.default_rng(1), boot_s=boot_s)
    model = EstimatorSimulation(position_sigma_m=0.05)
    return SimVehicle(
        pilot, clock, EstimatorError(model, np.random.default_rng(2)) if noisy else None
    )


def ask(vehicle: SimVehicle, kind: RequestKind, altitude_m: float = 0.0) -> Reply:
    return vehicle.execute_now(Request(kind, altitude_m))


def take_off(vehicle: SimVehicle, altitude_m: float = 1.0) -> None:
    vehicle.advance(1.0)
    assert ask(vehicle, RequestKind.ARM).accepted
    assert ask(vehicle, RequestKind.TAKEOFF, altitude_m).accepted
    vehicle.advance(14.0)


def stream(vehicle: SimVehicle, setpoint: Setpoint, seconds: float) -> None:
    for _ in range(round(seconds / 0.05)):
        vehicle.send(setpoint)
        vehicle.advance(0.05)


async def test_it_tells_who_it_is_and_how_it_is_configured() -> None:
    vehicle = make()
    facts = await vehicle.open(1.0)
    assert facts.autopilot == "PX4"
    assert set(facts.parameters) == set(ASKED_PARAMETERS)
    assert facts.parameters["COM_OBL_RC_ACT"] == 5.0
    assert vehicle.facts() is facts
    vehicle.autopilot.set_parameter("COM_OF_LOSS_T", 0.5)
    assert vehicle.facts().parameters["COM_OF_LOSS_T"] == 0.5
    await vehicle.close()
    await vehicle.close()


async def test_it_takes_off_flies_to_a_point_and_lands() -> None:
    vehicle = make()
    take_off(vehicle)
    assert vehicle.truth().position_ned_m[2] == pytest.approx(-1.0, abs=0.05)
    status = vehicle.status()
    assert (status.armed, status.mode, status.landed) == (True, FlightMode.HOLD, LandedState.IN_AIR)
    target = Setpoint(0.0, (0.5, -0.3, -1.2), yaw_rad=0.4)
    vehicle.send(target)
    assert ask(vehicle, RequestKind.OFFBOARD).accepted
    stream(vehicle, target, 12.0)
    position, attitude = vehicle.local_position(), vehicle.attitude()
    assert position is not None
    assert attitude is not None
    assert position.position_ned_m == pytest.approx((0.5, -0.3, -1.2), abs=0.03)
    assert attitude.yaw_rad == pytest.approx(0.4, abs=0.02)
    assert ask(vehicle, RequestKind.HOLD).accepted
    vehicle.advance(1.0)
    assert (await vehicle.execute(Request(RequestKind.LAND))).accepted
    vehicle.advance(12.0)
    assert not vehicle.status().armed
    assert vehicle.status().landed is LandedState.ON_GROUND
    assert [t.text for t in vehicle.take_texts()][-1] == "Disarmed by landing"
    assert vehicle.take_texts() == ()


def test_a_refusal_says_what_the_autopilot_said() -> None:
    vehicle = make()
    take_off(vehicle)
    vehicle.take_texts()
    reply = ask(vehicle, RequestKind.OFFBOARD)
    assert not reply.accepted
    assert reply.reason == "Switching to Offboard is currently not available"
    assert ask(vehicle, RequestKind.DISARM).reason == "Disarming denied: not landed"
    texts = vehicle.take_texts()
    assert [t.text for t in texts] == [
        "Switching to Offboard is currently not available",
        "Disarming denied: not landed",
    ]
    for text in texts:
        assert text.stamp_s == pytest.approx(vehicle.status().stamp_s)


def test_before_it_has_booted_it_says_why_it_cannot_be_armed() -> None:
    vehicle = make(boot_s=4.0)
    assert not vehicle.status().armable
    assert vehicle.status().not_armable_because == "Preflight Fail: no heading reference"
    assert not ask(vehicle, RequestKind.ARM).accepted
    vehicle.advance(4.1)
    assert vehicle.status().armable


def test_advance_moves_the_clock_by_as_much_however_long_it_is() -> None:
    vehicle = make()
    vehicle.advance(6.0)
    position = vehicle.local_position()
    assert position is not None
    assert position.stamp_s == pytest.approx(106.0)
    assert vehicle.autopilot.now_s == pytest.approx(6.0)


def test_without_setpoints_it_falls_back_to_hold_by_itself() -> None:
    vehicle = make()
    take_off(vehicle)
    forward = Setpoint(0.0, (2.0, 0.0, -1.0))
    vehicle.send(forward)
    ask(vehicle, RequestKind.OFFBOARD)
    stream(vehicle, forward, 2.0)
    vehicle.advance(1.3)
    assert vehicle.status().in_failsafe
    assert vehicle.status().mode is FlightMode.HOLD


def test_estimate_and_truth_differ_by_the_estimators_error() -> None:
    vehicle = make(noisy=True)
    take_off(vehicle)
    position, truth = vehicle.local_position(), vehicle.truth()
    assert position is not None
    off = subtract(position.position_ned_m, truth.position_ned_m)
    assert off == pytest.approx(vehicle.autopilot.estimate_offset.position_ned_m)
    assert 0.0 < norm(off) < 0.5


def test_a_jump_of_the_estimate_is_told_by_the_counter_and_moves_the_frame() -> None:
    vehicle = make()
    take_off(vehicle)
    before = vehicle.local_position()
    vehicle.jump_estimate((0.5, 0.0, 0.0))
    vehicle.advance(0.05)
    after = vehicle.local_position()
    assert before is not None
    assert after is not None
    assert after.reset_counter == before.reset_counter + 1
    assert after.position_ned_m[0] - before.position_ned_m[0] == pytest.approx(0.5, abs=0.01)
    assert vehicle.truth().position_ned_m[0] == pytest.approx(0.0, abs=0.01)


async def test_a_cut_link_is_silence_while_the_vehicle_flies_on() -> None:
    vehicle = make()
    take_off(vehicle)
    vehicle.cut_link()
    stamp_s = vehicle.status().stamp_s
    before = vehicle.local_position()
    vehicle.send(Setpoint(0.0, (1.0, 0.0, -1.0)))
    vehicle.advance(2.0)
    assert vehicle.status().link_age_s == pytest.approx(2.0)
    assert vehicle.status().stamp_s == stamp_s
    assert vehicle.local_position() is before
    assert ask(vehicle, RequestKind.LAND).reason == "the vehicle did not answer"
    with pytest.raises(ConnectionFailed):
        await vehicle.open(1.0)
    vehicle.restore_link()
    vehicle.advance(0.05)
    assert vehicle.status().link_age_s == 0.0
    assert vehicle.status().mode is FlightMode.HOLD


def test_the_same_seeds_give_the_same_flight_bit_for_bit() -> None:
    def run() -> object:
        vehicle = make(noisy=True)
        take_off(vehicle)
        return (vehicle.truth(), vehicle.local_position(), vehicle.attitude())

    assert run() == run()
