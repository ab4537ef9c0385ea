"""Where the mission frame has its origin."""

from autonomy.config import Config
from autonomy.mission.sensing import Sensing
from autonomy.model import Inputs
from hal.frames import Vector3
from hal.readings import (
    Attitude,
    FlightMode,
    LandedState,
    LocalPosition,
    VehicleStatus,
)

HERE: Vector3 = (4.0, -1.0, -1.2)


def tick(sensing: Sensing, now_s: float, at_ned_m: Vector3 = HERE) -> Vector3:
    """One step with the vehicle at rest; where the mission frame has it."""
    inputs = Inputs(
        now_s=now_s,
        ranges=(),
        local_position=LocalPosition(now_s, at_ned_m, (0.0, 0.0, 0.0)),
        attitude=Attitude(now_s, 0.0, 0.0, 0.0, 0.0),
        gnss=None,
        status=VehicleStatus(now_s, True, FlightMode.HOLD, LandedState.IN_AIR, 0.0),
    )
    return sensing.step(inputs).position_ned_m


def test_the_origin_is_where_the_vehicle_was_armed() -> None:
    sensing = Sensing(Config())
    assert tick(sensing, 0.05) == (0.0, 0.0, 0.0)
    sensing.fix_home()
    assert sensing.home_ned_m == HERE
    north, east, down = tick(sensing, 0.10, (4.1, -1.0, -1.2))
    assert abs(north) < 0.2
    assert abs(east) + abs(down) < 1e-9
    assert sensing.home_ned_m == HERE


def test_a_mission_that_goes_on_keeps_the_origin_that_it_had() -> None:
    home: Vector3 = (3.0, -2.0, 0.5)
    sensing = Sensing(Config())
    sensing.fix_home(home)
    for number in range(1, 4):
        assert tick(sensing, 0.05 * number) == (1.0, 1.0, -1.7)
        assert sensing.home_ned_m == home
