import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hal.frames import horizontal_norm
from hal.sim.autopilot_smoothing import Braking
from hal.sim.px4 import Landed, Mode, Parameters, Result, SystemStatus
from tests.support.px4 import Flight, facts

FACTS = facts()


def test_mode_numbers_are_px4s() -> None:
    for name, number in FACTS["mode_numbers"].items():
        assert Mode[name] == number
    for name, number in FACTS["base_modes"].items():
        assert Mode[name].base_mode == number


def test_all_measured_parameters_are_there_in_alphabetical_order() -> None:
    parameters = Parameters()
    assert len(parameters) == 938
    assert parameters["COM_OF_LOSS_T"] == 1.0
    assert parameters["COM_OBL_RC_ACT"] == 0
    assert isinstance(parameters["COM_OBL_RC_ACT"], int)
    assert parameters.index("MPC_XY_VEL_MAX") == 650
    assert list(parameters.names) == sorted(parameters.names)


def test_a_parameter_is_taken_without_range_check_and_an_unknown_one_is_not() -> None:
    flight = Flight()
    assert flight.pilot.set_parameter("MPC_XY_VEL_MAX", 1000.0) is Result.ACCEPTED
    assert flight.pilot.parameters["MPC_XY_VEL_MAX"] == 1000.0
    assert flight.pilot.set_parameter("NO_SUCH_PARAM", 1.0) is Result.DENIED


# ---------------------------------------------------------------- arming


def test_it_cannot_be_armed_before_it_has_booted() -> None:
    flight = Flight(boot_s=4.2)
    assert flight.status() is SystemStatus.UNINIT
    assert flight.pilot.arm() is Result.TEMPORARILY_REJECTED
    assert flight.texts() == [
        "Preflight Fail: no heading reference",
        "Arming denied: Resolve system health failures first",
    ]
    flight.fly(4.3)
    assert flight.status() is SystemStatus.STANDBY
    assert flight.pilot.arm() is Result.ACCEPTED
    assert flight.status() is SystemStatus.ACTIVE
    assert flight.pilot.base_mode == 157


def test_a_fault_that_forbids_arming_is_told_and_can_go_away() -> None:
    flight = Flight()
    flight.pilot.set_fault("Preflight: GPS fix too low")
    assert flight.pilot.arm() is Result.TEMPORARILY_REJECTED
    assert flight.texts()[0] == "Preflight: GPS fix too low"
    flight.pilot.set_fault("")
    assert flight.pilot.arm() is Result.ACCEPTED
    assert flight.texts()[-1] == "Armed by external command"


def test_arming_twice_and_disarming_twice_say_nothing_more() -> None:
    flight = Flight()
    assert flight.pilot.disarm() is Result.ACCEPTED
    assert flight.texts() == []
    assert flight.pilot.arm() is Result.ACCEPTED
    assert flight.pilot.arm() is Result.ACCEPTED
    assert flight.pilot.disarm() is Result.ACCEPTED
    assert flight.texts() == ["Armed by external command", "Disarmed by external command"]


def test_armed_without_take_off_it_disarms_itself() -> None:
    flight = Flight()
    flight.pilot.arm()
    took_s = flight.until(lambda: not flight.pilot.armed)
    assert took_s == pytest.approx(FACTS["preflight_disarm_s"], abs=0.06)
    assert flight.texts()[-1] == "Disarmed by auto preflight disarming"


# ---------------------------------------------------------------- take-off and landing


def test_take_off_happens_in_the_measured_steps() -> None:
    expected = FACTS["takeoff_default"]
    flight = Flight()
    flight.pilot.arm()
    assert flight.pilot.takeoff() is Result.ACCEPTED
    assert flight.texts()[-1] == expected["text"]
    pilot = flight.pilot
    flight.until(lambda: pilot.landed is Landed.TAKEOFF)
    assert expected["takeoff_detected_s"][0] < pilot.now_s < expected["takeoff_detected_s"][1]
    assert flight.texts()[-1] == "Takeoff detected"
    assert flight.height_m == 0.0
    flight.until(lambda: flight.height_m > 0.005)
    assert expected["lift_off_s"][0] < pilot.now_s < expected["lift_off_s"][1] + 0.1
    fastest = 0.0
    while pilot.mode is Mode.TAKEOFF:
        flight.fly(0.01)
        fastest = max(fastest, -pilot.quadrotor.velocity_ned_m_s[2])
    assert expected["in_air_state_s"][0] < pilot.now_s < expected["in_air_state_s"][1]
    assert fastest == pytest.approx(expected["climb_max_m_s"], abs=0.06)
    assert pilot.landed is Landed.IN_AIR
    flight.fly(12.0)
    assert flight.height_m == pytest.approx(2.5, abs=0.06)


def test_armed_long_before_the_spool_up_is_over_already() -> None:
    expected = FACTS["takeoff_armed_6_s_before"]
    flight = Flight()
    flight.pilot.arm()
    flight.fly(6.0)
    flight.pilot.takeoff()
    flight.until(lambda: flight.pilot.landed is Landed.TAKEOFF)
    assert flight.pilot.now_s - 6.0 == pytest.approx(expected["takeoff_detected_s"], abs=0.15)
    flight.until(lambda: flight.mode() is Mode.HOLD)
    assert flight.pilot.now_s - 6.0 == pytest.approx(expected["in_air_state_s"], abs=0.5)


@pytest.mark.parametrize("height_m", [0.6, 1.0, 4.0])
def test_take_off_reaches_the_altitude_that_was_asked_for(height_m: float) -> None:
    flight = Flight(0.2)
    flight.pilot.arm()
    flight.pilot.takeoff(flight.pilot.origin[2] + height_m)
    flight.fly(20.0)
    assert flight.height_m == pytest.approx(height_m, abs=0.05)
    assert "Using default takeoff altitude" not in " ".join(flight.texts())


def test_take_off_while_disarmed_changes_the_mode_only() -> None:
    flight = Flight()
    assert flight.pilot.takeoff() is Result.ACCEPTED
    flight.fly(8.0)
    assert flight.mode() is Mode.TAKEOFF
    assert not flight.pilot.armed
    assert flight.height_m == 0.0
    assert flight.texts() == []


def test_landing_happens_in_the_measured_steps() -> None:
    expected = FACTS["land"]
    flight = Flight(MIS_TAKEOFF_ALT=expected["from_m"])
    flight.take_off()
    pilot, start_s = flight.pilot, flight.pilot.now_s
    assert pilot.land() is Result.ACCEPTED
    assert flight.texts()[-1] == "Landing at current position"
    flight.fly(0.2)
    assert pilot.landed is Landed.LANDING
    flight.fly(1.5)
    assert pilot.quadrotor.velocity_ned_m_s[2] == pytest.approx(expected["descent_m_s"], abs=0.06)
    flight.until(lambda: flight.height_m < 0.3)
    assert pilot.quadrotor.velocity_ned_m_s[2] == pytest.approx(expected["crawl_m_s"], abs=0.05)
    flight.until(lambda: pilot.quadrotor.on_ground)
    assert pilot.now_s - start_s == pytest.approx(expected["touch_down_s"], abs=0.5)
    assert pilot.landed is Landed.LANDING
    flight.until(lambda: pilot.landed is Landed.ON_GROUND)
    low, high = expected["landing_detected_s"]
    assert low - 0.5 < pilot.now_s - start_s < high
    assert flight.texts()[-1] == "Landing detected"
    took_s = flight.until(lambda: not pilot.armed)
    assert took_s == pytest.approx(expected["disarm_after_s"], abs=0.03)
    assert flight.texts()[-1] == "Disarmed by landing"
    assert pilot.mode is Mode.HOLD


def test_another_mode_ends_a_landing_in_the_air() -> None:
    flight = Flight()
    flight.take_off()
    flight.pilot.land()
    flight.fly(1.5)
    assert flight.pilot.set_mode(Mode.HOLD.main, Mode.HOLD.sub) is Result.ACCEPTED
    flight.fly(0.1)
    assert flight.pilot.landed is Landed.IN_AIR
    flight.fly(5.0)
    assert flight.height_m > 0.8


def test_it_can_take_off_land_and_take_off_again() -> None:
    flight = Flight()
    for _ in range(2):
        flight.take_off()
        flight.pilot.land()
        flight.until(lambda: not flight.pilot.armed)
    assert flight.texts().count("Takeoff detected") == 2


# ---------------------------------------------------------------- what is refused in the air


def test_disarming_in_the_air_is_refused_but_a_kill_is_not() -> None:
    kill = FACTS["kill"]
    flight = Flight()
    flight.take_off()
    assert flight.pilot.disarm() is Result.TEMPORARILY_REJECTED
    assert flight.texts()[-1] == "Disarming denied: not landed"
    assert flight.pilot.armed
    assert flight.pilot.disarm(force=True) is Result.ACCEPTED
    took_s = flight.until(lambda: flight.pilot.landed is Landed.ON_GROUND)
    assert took_s == pytest.approx(kill["landed_after_s"], abs=0.05)
    flight.fly(1.0)
    assert flight.height_m == 0.0
    assert flight.pilot.arm() is Result.ACCEPTED


@pytest.mark.parametrize(
    ("mode", "name"),
    [(Mode.OFFBOARD, "Offboard"), (Mode.POSITION, "Position"), (Mode.MISSION, "Mission")],
)
def test_modes_that_cannot_be_flown_are_refused_in_the_air(mode: Mode, name: str) -> None:
    flight = Flight()
    flight.take_off()
    assert flight.pilot.set_mode(mode.main, mode.sub) is Result.TEMPORARILY_REJECTED
    assert flight.texts()[-1] == f"Switching to {name} is currently not available"
    assert flight.mode() is Mode.HOLD


@pytest.mark.parametrize("mode", [Mode.OFFBOARD, Mode.POSITION, Mode.LAND])
def test_disarmed_every_mode_is_taken(mode: Mode) -> None:
    flight = Flight()
    assert flight.pilot.set_mode(mode.main, mode.sub) is Result.ACCEPTED
    assert flight.mode() is mode


def test_an_unknown_main_mode_is_refused() -> None:
    flight = Flight()
    assert flight.pilot.set_mode(99) is Result.TEMPORARILY_REJECTED
    assert flight.texts() == ["Unsupported main mode"]


def test_offboard_without_a_stream_cannot_be_armed_with_one_it_can() -> None:
    flight = Flight()
    flight.pilot.set_mode(Mode.OFFBOARD.main)
    assert flight.status() is SystemStatus.UNINIT
    assert flight.pilot.arm() is Result.TEMPORARILY_REJECTED
    flight.velocity(0.0)()
    assert flight.status() is SystemStatus.STANDBY
    assert flight.pilot.arm() is Result.ACCEPTED


# ---------------------------------------------------------------- offboard


def test_one_fresh_setpoint_is_enough_and_an_old_one_is_not() -> None:
    flight = Flight()
    flight.take_off()
    flight.velocity(0.1)()
    flight.fly(1.2)
    assert flight.pilot.set_mode(Mode.OFFBOARD.main) is Result.TEMPORARILY_REJECTED
    flight.velocity(0.1)()
    assert flight.pilot.set_mode(Mode.OFFBOARD.main) is Result.ACCEPTED
    assert flight.mode() is Mode.OFFBOARD


def test_a_slow_stream_stays_in_offboard() -> None:
    flight = Flight()
    flight.take_off()
    flight.offboard(0.2, 1.0)
    for _ in range(10):
        flight.velocity(0.2)()
        flight.fly(1.0 / 1.5)
    assert flight.mode() is Mode.OFFBOARD


def test_position_with_velocity_is_flown_to_and_kept() -> None:
    flight = Flight(0.2)
    flight.take_off()

    def send() -> None:
        flight.pilot.set_setpoint((0.5, -0.4, -1.5), (0.0, 0.0, 0.0), yaw_rad=0.5)

    send()
    flight.pilot.set_mode(Mode.OFFBOARD.main)
    flight.fly(15.0, send)
    assert flight.position == pytest.approx((0.5, -0.4, -1.5), abs=0.05)
    assert flight.pilot.quadrotor.yaw_rad == pytest.approx(0.5, abs=0.02)


def test_a_body_velocity_is_turned_by_the_heading() -> None:
    flight = Flight(0.2, start_yaw_deg=90.0)
    flight.take_off()

    def send() -> None:
        flight.pilot.set_body_setpoint((0.3, 0.0, 0.0), math.nan, 0.0)

    send()
    flight.pilot.set_mode(Mode.OFFBOARD.main)
    flight.fly(4.0, send)
    assert flight.position[1] > 0.7
    assert abs(flight.position[0]) < 0.1


def test_offboard_can_take_off_and_land_by_velocity() -> None:
    expected = FACTS["offboard_takeoff"]
    flight = Flight()
    send = flight.velocity(0.0, down=expected["setpoint_down_m_s"])
    send()
    flight.pilot.set_mode(Mode.OFFBOARD.main)
    flight.pilot.arm()
    states = [int(flight.pilot.landed)]
    lift_off_s = None
    for _ in range(120):
        flight.fly(0.05, send)
        if int(flight.pilot.landed) != states[-1]:
            states.append(int(flight.pilot.landed))
        if lift_off_s is None and flight.height_m > 0.01:
            lift_off_s = flight.pilot.now_s
    assert states == expected["landed_states"]
    assert lift_off_s == pytest.approx(expected["lift_off_s"], abs=0.2)
    assert flight.said_at("Takeoff detected") == pytest.approx(
        expected["takeoff_detected_s"], abs=0.1
    )
    down = flight.velocity(0.0, down=0.5)
    flight.fly(12.0, down)
    assert flight.texts()[-2:] == ["Landing detected", "Disarmed by landing"]
    assert flight.pilot.base_mode == 17


@pytest.mark.parametrize(
    ("action", "mode"),
    [(0, Mode.RETURN), (1, Mode.RETURN), (4, Mode.LAND), (5, Mode.HOLD)],
)
def test_a_lost_stream_starts_the_configured_action(action: int, mode: Mode) -> None:
    flight = Flight(COM_OBL_RC_ACT=action)
    flight.take_off()
    flight.offboard(0.3, 4.0)
    took_s = flight.until(flight.in_failsafe)
    low, high = FACTS["offboard_loss_s"]
    assert low - 0.06 < took_s < high + 0.02
    assert flight.mode() is mode
    assert flight.pilot.intended_mode is Mode.OFFBOARD
    assert flight.status() is SystemStatus.CRITICAL
    assert "Failsafe activated" in flight.texts()


def test_a_resumed_stream_takes_over_again_without_a_word() -> None:
    flight = Flight(COM_OBL_RC_ACT=5)
    flight.take_off()
    flight.offboard(0.3, 2.0)
    flight.fly(3.0)
    assert flight.in_failsafe()
    said = len(flight.texts())
    flight.fly(0.25, flight.velocity(0.3))
    assert not flight.in_failsafe()
    assert flight.mode() is Mode.OFFBOARD
    assert len(flight.texts()) == said


def test_a_command_ends_a_failsafe() -> None:
    flight = Flight(COM_OBL_RC_ACT=4)
    flight.take_off()
    flight.offboard(0.3, 2.0)
    flight.fly(1.5)
    assert flight.mode() is Mode.LAND
    flight.pilot.set_mode(Mode.HOLD.main, Mode.HOLD.sub)
    flight.fly(1.0)
    assert flight.mode() is Mode.HOLD
    assert not flight.in_failsafe()
    flight.fly(3.0, flight.velocity(0.3))
    assert flight.mode() is Mode.HOLD


def test_after_a_failsafe_landing_the_mode_asked_for_shows_again() -> None:
    flight = Flight(COM_OBL_RC_ACT=4)
    flight.take_off()
    flight.offboard(0.0, 2.0)
    flight.until(lambda: not flight.pilot.armed)
    assert flight.mode() is Mode.OFFBOARD
    assert flight.status() is SystemStatus.UNINIT


def test_without_a_stream_it_flies_on_and_hold_stops_it_as_measured() -> None:
    expected = FACTS["hold_failsafe"]
    flight = Flight(expected["drag_per_mass_s"], COM_OBL_RC_ACT=5)
    flight.take_off()
    flight.offboard(expected["speed_m_s"], 12.0)
    lost_at = flight.position[0]
    flight.until(flight.in_failsafe)
    stop_at = flight.position[0]
    speed = horizontal_norm(flight.pilot.quadrotor.velocity_ned_m_s)
    assert stop_at - lost_at == pytest.approx(expected["overrun_m"], abs=0.06)
    half_s = flight.until(
        lambda: horizontal_norm(flight.pilot.quadrotor.velocity_ned_m_s) < 0.5 * speed
    )
    assert half_s == pytest.approx(expected["half_speed_s"], abs=0.1)
    flight.fly(6.0)
    assert flight.position[0] - stop_at == pytest.approx(expected["then_m"], abs=0.1)
    assert horizontal_norm(flight.pilot.quadrotor.velocity_ned_m_s) < 0.02


def test_on_the_ground_a_lost_stream_starts_nothing() -> None:
    flight = Flight(COM_OBL_RC_ACT=5)
    flight.velocity(0.0)()
    flight.pilot.set_mode(Mode.OFFBOARD.main)
    flight.pilot.arm()
    flight.fly(5.0)
    assert not flight.in_failsafe()
    assert flight.texts() == ["Armed by external command"]


def test_touching_the_floor_without_wanting_down_is_no_landing() -> None:
    flight = Flight()
    flight.take_off()
    down = flight.velocity(0.0, down=0.5)
    down()
    flight.pilot.set_mode(Mode.OFFBOARD.main)
    while not flight.pilot.quadrotor.on_ground:
        flight.fly(0.05, down)
    flight.fly(6.0, flight.velocity(0.0))
    assert flight.pilot.armed
    assert "Landing detected" not in flight.texts()


def test_a_turn_is_not_taken_back_when_hold_begins() -> None:
    flight = Flight(0.2)
    flight.take_off()
    rate = math.radians(30.0)

    def turn() -> None:
        flight.pilot.set_setpoint(velocity_ned_m_s=(0.0, 0.0, 0.0), yaw_rate_rad_s=rate)

    turn()
    flight.pilot.set_mode(Mode.OFFBOARD.main)
    flight.fly(3.0, turn)
    flight.pilot.set_mode(Mode.HOLD.main, Mode.HOLD.sub)
    before, largest = flight.pilot.quadrotor.yaw_rad, 0.0
    for _ in range(300):
        flight.fly(0.01)
        largest = max(largest, flight.pilot.quadrotor.yaw_rad - before)
    kept = flight.pilot.quadrotor.yaw_rad - before
    assert 0.0 < kept <= largest < math.radians(15.0)
    assert largest - kept < math.radians(4.0)


# ---------------------------------------------------------------- return


def test_a_return_climbs_first_and_lands_at_home() -> None:
    expected = FACTS["return_from_7m"]
    flight = Flight(0.2)
    flight.take_off()
    flight.offboard(1.0, 7.0)
    away = flight.position[0]
    start_s = flight.pilot.now_s
    assert flight.pilot.return_to_launch() is Result.ACCEPTED
    flight.fly(0.1)
    # From 1 m/s it stands half a metre farther on: that is where the height is reckoned from.
    height_m = math.sqrt(3.0) * (away + 0.5)
    assert flight.texts()[-1].endswith(f"({math.ceil(height_m)} m above destination)")
    assert flight.texts()[-2] == "Returning to launch"
    flight.until(lambda: flight.pilot.landed is Landed.LANDING)
    assert flight.height_m > height_m - 1.0
    assert flight.texts()[-1] == "RTL: land at destination"
    took_s = flight.pilot.now_s - start_s
    assert took_s == pytest.approx(expected["land_at_destination_s"], abs=1.0)
    flight.until(lambda: not flight.pilot.armed)
    assert horizontal_norm(flight.position) < 0.15
    detected_s = flight.said_at("Landing detected") - start_s
    assert detected_s == pytest.approx(expected["landing_detected_s"], abs=3.5)


def test_home_is_where_it_was_armed_last() -> None:
    flight = Flight(0.2)
    flight.take_off()
    flight.offboard(0.6, 4.0)
    flight.pilot.land()
    flight.until(lambda: not flight.pilot.armed)
    home = flight.position
    flight.pilot.set_mode(Mode.HOLD.main, Mode.HOLD.sub)
    flight.take_off()
    flight.offboard(0.6, 4.0)
    flight.pilot.return_to_launch()
    flight.until(lambda: not flight.pilot.armed)
    assert home[0] > 1.5
    assert flight.position[0] == pytest.approx(home[0], abs=0.15)


def test_a_return_at_home_lands_straight() -> None:
    flight = Flight()
    flight.take_off()
    flight.pilot.return_to_launch()
    flight.fly(0.3)
    assert flight.texts()[-1] == "RTL: land at destination"
    flight.fly(2.0)
    assert flight.height_m < 2.4


# ---------------------------------------------------------------- the rest


def test_repositioning_flies_there_and_holds() -> None:
    flight = Flight(0.2)
    flight.take_off()
    flight.pilot.hold_at((0.6, math.nan, -2.0))
    flight.fly(15.0)
    assert flight.position == pytest.approx((0.6, 0.0, -2.0), abs=0.06)
    assert flight.mode() is Mode.HOLD


def test_the_battery_drains_to_a_half_and_is_full_when_disarmed() -> None:
    flight = Flight()
    flight.take_off()
    flight.fly(25.0)
    assert flight.pilot.battery_remaining == pytest.approx(0.5)
    flight.pilot.battery_override = 0.1
    assert flight.pilot.battery_remaining == 0.1
    flight.pilot.battery_override = None
    flight.pilot.land()
    flight.until(lambda: not flight.pilot.armed)
    flight.fly(0.1)
    assert flight.pilot.battery_remaining == 1.0


def test_the_same_seed_gives_the_same_flight() -> None:
    def run(seed: int) -> tuple[object, ...]:
        flight = Flight(seed=seed, COM_OBL_RC_ACT=5)
        flight.take_off()
        flight.offboard(0.3, 2.0)
        flight.fly(4.0)
        return (flight.position, flight.said)

    assert run(3) == run(3)
    assert run(3) != run(4)


@settings(deadline=None, max_examples=50)
@given(
    st.tuples(st.floats(-2, 2), st.floats(-2, 2), st.floats(-1, 1)),
    st.floats(0.5, 8.0),
    st.floats(0.01, 1.0),
)
def test_a_braking_plan_is_continuous_and_consistent(
    velocity: tuple[float, float, float], jerk: float, share: float
) -> None:
    plan = Braking.plan(10.0, (1.0, 2.0, -3.0), velocity, jerk)
    at = 10.0 + share * plan.duration_s
    h = 1e-6
    before, here, after = plan.at(at - h), plan.at(at), plan.at(at + h)
    for axis in range(3):
        assert (after[0][axis] - before[0][axis]) / (2 * h) == pytest.approx(
            here[1][axis], abs=1e-4
        )
        assert (after[1][axis] - before[1][axis]) / (2 * h) == pytest.approx(
            here[2][axis], abs=max(1e-3, 4e-6 * jerk * 10)
        ) or share == 1.0
    end = plan.at(10.0 + plan.duration_s + 1.0)
    assert end == (plan.end_ned_m, (0.0, 0.0, 0.0), (0.0, 0.0, 0.0))


REQUESTS = {
    "arm": lambda f: f.pilot.arm(),
    "disarm": lambda f: f.pilot.disarm(),
    "takeoff": lambda f: f.pilot.takeoff(),
    "land": lambda f: f.pilot.land(),
    "rtl": lambda f: f.pilot.return_to_launch(),
    "hold": lambda f: f.pilot.set_mode(Mode.HOLD.main, Mode.HOLD.sub),
    "offboard": lambda f: f.pilot.set_mode(Mode.OFFBOARD.main),
    "setpoint": lambda f: f.velocity(0.3, 0.2, -0.1)(),
}


@settings(deadline=None, max_examples=25)
@given(st.lists(st.tuples(st.sampled_from(sorted(REQUESTS)), st.floats(0.0, 6.0)), max_size=8))
def test_no_sequence_of_requests_disarms_it_in_the_air(
    script: list[tuple[str, float]],
) -> None:
    flight = Flight(COM_OBL_RC_ACT=5)
    Flight.tick_s = 0.05
    try:
        for request, wait_s in [("arm", 0.0), ("takeoff", 5.0), *script]:
            REQUESTS[request](flight)
            was_up = flight.height_m > 0.01
            flight.fly(wait_s)
            if was_up and not flight.pilot.armed:
                assert "Disarmed by landing" in flight.texts()
            assert all(math.isfinite(v) for v in flight.position)
            if flight.height_m > 0.01:
                assert flight.pilot.armed
                assert flight.pilot.landed is not Landed.ON_GROUND
    finally:
        Flight.tick_s = 0.01


def test_a_take_off_called_off_before_it_left_the_ground_ends_disarmed() -> None:
    flight = Flight()
    assert flight.pilot.arm() == 0
    assert flight.pilot.takeoff() == 0
    flight.until(lambda: flight.pilot.landed is not Landed.ON_GROUND)
    assert flight.pilot.land() == 0
    flight.until(lambda: not flight.pilot.armed, 10.0)
    assert flight.height_m < 0.05
    assert flight.pilot.landed is Landed.ON_GROUND
