import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hal.frames import Vector3, horizontal_norm
from hal.sim.quadrotor import Command, Limits, Motors, Quadrotor, warm_up
from hal.sim.sensors import EstimateOffset
from tests.support.px4 import facts, steps

HIGH: Vector3 = (0.0, 0.0, -50.0)
# Root mean square error over the record, as a fraction of the step; the fit itself reaches 4 %.
RMS_LIMIT = {"horizontal": 0.075, "vertical": 0.03, "yaw": 0.045}


def at_rest(drag: float = 0.2, position: Vector3 = HIGH) -> Quadrotor:
    return Quadrotor(drag_per_mass_s=drag, position_ned_m=position)


def fly(quad: Quadrotor, seconds: float, command: Command) -> list[Vector3]:
    """Positions every 10 ms, the first before anything happened."""
    track = [quad.position_ned_m]
    for _ in range(round(seconds / 0.01)):
        quad.step(0.01, command)
        track.append(quad.position_ned_m)
    return track


def respond(record: dict[str, Any]) -> list[float]:
    """The model's speed (or yaw rate, deg/s) on the record's 0.1 s grid."""
    quad = at_rest(record["drag_per_mass_s"])
    place = 2 if record["axis"] == "vertical" else 0

    def command(value: float) -> Command:
        if record["axis"] == "yaw":
            return Command(yaw_rate_rad_s=math.radians(value))
        velocity = [0.0, 0.0, 0.0]
        velocity[place] = value
        return Command(velocity_ned_m_s=(velocity[0], velocity[1], velocity[2]))

    if abs(record["setpoint"]) < 1e-9:
        fly(quad, 25.0, command(record["v0"]))
    wanted, series = command(record["setpoint"]), []
    for _ in record["series"]:
        rate = math.degrees(quad.yaw_rate_rad_s)
        series.append(rate if record["axis"] == "yaw" else quad.velocity_ned_m_s[place])
        for _ in range(10):
            quad.step(0.01, wanted)
    return series


def step_size(record: dict[str, Any]) -> float:
    return float(abs(record["setpoint"]) or abs(record["v0"]))


RECORDS = {f"{r['name']} drag {r['drag_per_mass_s']}": r for r in steps()}


@pytest.mark.parametrize("name", RECORDS)
def test_step_and_stop_responses_follow_the_measured_ones(name: str) -> None:
    record = RECORDS[name]
    error = np.array(respond(record)) - np.array(record["series"])
    rms = float(np.sqrt(np.mean(error**2))) / step_size(record)
    assert rms < RMS_LIMIT[record["axis"]]
    assert float(np.abs(error).max()) / step_size(record) < 0.16


@pytest.mark.parametrize(
    "name", [n for n, r in RECORDS.items() if r["setpoint"] == 0.0 and r["axis"] == "horizontal"]
)
def test_stopping_distances_are_as_measured(name: str) -> None:
    record = RECORDS[name]
    # What matters near an obstacle is the first second and a half; later drag alone creeps.
    model, measured = (
        float(np.trapezoid(series[:16], dx=0.1)) for series in (respond(record), record["series"])
    )
    assert model == pytest.approx(measured, rel=0.15, abs=0.01)


def test_a_position_step_arrives_as_measured() -> None:
    expected = facts()["position_step_1m"]
    quad = at_rest(expected["drag_per_mass_s"])
    track = fly(quad, 8.0, Command(position_ned_m=(1.0, 0.0, HIGH[2])))
    north = np.array([p[0] for p in track])
    speed = np.diff(north) / 0.01
    assert 0.01 * int((north > 0.5).argmax()) == pytest.approx(np.mean(expected["t50_s"]), abs=0.08)
    assert 0.01 * int((north > 0.9).argmax()) == pytest.approx(np.mean(expected["t90_s"]), abs=0.1)
    assert speed.max() == pytest.approx(np.mean(expected["speed_max_m_s"]), abs=0.06)
    assert expected["overshoot_m"][0] - 0.01 < north.max() - 1.0 < expected["overshoot_m"][1]


def test_a_held_position_is_reached_and_kept() -> None:
    quad = at_rest()
    fly(quad, 40.0, Command(position_ned_m=(0.4, -0.3, -49.5), yaw_rad=1.0))
    assert quad.position_ned_m == pytest.approx((0.4, -0.3, -49.5), abs=0.01)
    assert quad.yaw_rad == pytest.approx(1.0, abs=0.01)


def test_a_turn_goes_the_short_way_round_and_hardly_overshoots() -> None:
    quad = Quadrotor(position_ned_m=HIGH, yaw_rad=math.radians(170.0))
    largest = 0.0
    for _ in range(800):
        quad.step(0.01, Command(yaw_rad=math.radians(-170.0)))
        largest = max(largest, (quad.yaw_rad - math.radians(170.0)) % (2.0 * math.pi))
    assert math.degrees(largest) == pytest.approx(20.0, abs=1.0)
    assert math.degrees(quad.yaw_rad) == pytest.approx(-170.0, abs=0.2)


def test_an_error_of_the_estimate_moves_the_truth_the_other_way() -> None:
    quad = at_rest()
    error = EstimateOffset((0.3, 0.0, 0.1), (0.0, 0.0, 0.0), 0.2)
    for _ in range(4000):
        quad.step(0.01, Command(position_ned_m=HIGH, yaw_rad=0.0), error=error)
    assert quad.position_ned_m == pytest.approx((-0.3, 0.0, HIGH[2] - 0.1), abs=0.01)
    assert quad.yaw_rad == pytest.approx(-0.2, abs=0.01)


def test_an_error_of_the_estimated_velocity_makes_it_drift() -> None:
    quad = at_rest()
    error = EstimateOffset((0.0, 0.0, 0.0), (0.05, 0.0, 0.0), 0.0)
    for _ in range(4000):
        quad.step(0.01, Command(velocity_ned_m_s=(0.2, 0.0, 0.0)), error=error)
    assert quad.velocity_ned_m_s[0] == pytest.approx(0.15, abs=0.002)


def test_a_moving_position_with_its_velocity_is_followed_without_lag() -> None:
    quad = at_rest()
    for tick in range(4000):
        target = (0.2 * 0.01 * tick, 0.0, HIGH[2])
        quad.step(0.01, Command(target, (0.2, 0.0, 0.0)))
    assert quad.position_ned_m[0] == pytest.approx(0.2 * 0.01 * 3999, abs=0.01)


def test_speed_limits_are_kept_and_the_direction_too() -> None:
    quad = Quadrotor(position_ned_m=HIGH, limits=Limits(horizontal_m_s=0.5, up_m_s=0.4))
    fly(quad, 60.0, Command(velocity_ned_m_s=(3.0, 4.0, -5.0)))
    velocity = quad.velocity_ned_m_s
    assert horizontal_norm(velocity) == pytest.approx(0.5, abs=0.01)
    assert velocity[1] / velocity[0] == pytest.approx(4.0 / 3.0, rel=1e-6)
    assert velocity[2] == pytest.approx(-0.4, abs=0.01)


def test_it_leans_into_its_acceleration() -> None:
    quad = at_rest()
    fly(quad, 0.4, Command(velocity_ned_m_s=(1.0, 0.0, 0.0)))
    assert quad.tilt_rad[1] < -0.02  # nose down to go forward
    assert quad.tilt_rad[0] == pytest.approx(0.0, abs=1e-9)
    east = Quadrotor(position_ned_m=HIGH, yaw_rad=math.pi / 2)
    fly(east, 0.4, Command(velocity_ned_m_s=(1.0, 0.0, 0.0), yaw_rad=math.pi / 2))
    assert east.tilt_rad[0] < -0.02  # north is to the left


def test_idling_motors_leave_it_standing_where_it_is() -> None:
    quad = at_rest(position=(0.0, 0.0, 0.0))
    for motors in (Motors.IDLE, Motors.STOPPED):
        for _ in range(100):
            quad.step(0.01, Command(velocity_ned_m_s=(1.0, 0.0, -1.0)), motors)
    assert quad.position_ned_m == (0.0, 0.0, 0.0)
    assert quad.on_ground


def test_without_thrust_it_falls_to_the_floor_and_stays_there() -> None:
    kill = facts()["kill"]
    quad = at_rest(1.0, (0.0, 0.0, -kill["from_m"]))
    elapsed, fastest = 0.0, 0.0
    while not quad.on_ground:
        quad.step(0.01, Command(), Motors.STOPPED)
        elapsed += 0.01
        fastest = max(fastest, quad.velocity_ned_m_s[2])
    assert elapsed == pytest.approx(kill["ground_after_s"], abs=0.15)
    assert fastest == pytest.approx(kill["impact_m_s"], abs=0.5)
    quad.step(0.01, Command(), Motors.STOPPED)
    assert quad.velocity_ned_m_s == (0.0, 0.0, 0.0)


def test_it_can_lift_off_again_after_pressing_on_the_floor() -> None:
    quad = at_rest(position=(0.0, 0.0, 0.0))
    fly(quad, 5.0, Command(velocity_ned_m_s=(0.2, 0.0, 0.5)))
    assert quad.position_ned_m == (0.0, 0.0, 0.0)
    fly(quad, 1.5, Command(velocity_ned_m_s=(0.0, 0.0, -0.5)))
    assert quad.height_m > 0.4


def test_the_same_commands_give_the_same_flight_bit_for_bit() -> None:
    def run() -> list[Vector3]:
        quad = at_rest()
        return fly(quad, 3.0, Command(velocity_ned_m_s=(0.2, 0.1, 0.05), yaw_rate_rad_s=0.3))

    assert run() == run()


def test_fifty_milliseconds_at_once_are_five_substeps() -> None:
    command = Command(velocity_ned_m_s=(0.2, 0.1, -0.1))
    coarse, fine = at_rest(), at_rest()
    for _ in range(20):
        coarse.step(0.05, command)
        for _ in range(5):
            fine.step(0.01, command)
    assert coarse.position_ned_m == pytest.approx(fine.position_ned_m, abs=1e-12)


@settings(deadline=None, max_examples=30)
@given(
    st.floats(-math.pi, math.pi),
    st.floats(0.05, 1.0),
    st.sampled_from([0.2, 1.0]),
)
def test_every_horizontal_direction_flies_alike(bearing: float, speed: float, drag: float) -> None:
    quad, north = at_rest(drag), at_rest(drag)
    c, s = math.cos(bearing), math.sin(bearing)
    fly(quad, 1.0, Command(velocity_ned_m_s=(speed * c, speed * s, 0.0)))
    fly(north, 1.0, Command(velocity_ned_m_s=(speed, 0.0, 0.0)))
    p, q = quad.position_ned_m, north.position_ned_m
    assert c * p[0] + s * p[1] == pytest.approx(q[0], abs=1e-9)
    assert c * p[1] - s * p[0] == pytest.approx(0.0, abs=1e-9)


def test_warm_up_compiles_without_flying_anything() -> None:
    warm_up()
