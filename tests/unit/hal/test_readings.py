"""What a vehicle's status says about asking for Offboard."""

import pytest

from hal.readings import FlightMode, LandedState, VehicleStatus


def status(mode: FlightMode, *, armed: bool = True) -> VehicleStatus:
    return VehicleStatus(1.0, armed, mode, LandedState.IN_AIR, 0.0)


@pytest.mark.parametrize("mode", [FlightMode.TAKEOFF, FlightMode.HOLD, FlightMode.OFFBOARD])
def test_nothing_speaks_against_offboard_after_a_take_off(mode: FlightMode) -> None:
    assert status(mode).against_offboard() is None


@pytest.mark.parametrize("mode", FlightMode)
def test_nobody_asks_for_offboard_disarmed(mode: FlightMode) -> None:
    assert status(mode, armed=False).against_offboard() == "the vehicle is not armed"


@pytest.mark.parametrize(
    "mode",
    [
        *(FlightMode.MANUAL, FlightMode.LAND, FlightMode.DESCEND, FlightMode.RETURN),
        *(FlightMode.MISSION, FlightMode.UNKNOWN),
    ],
)
def test_a_mode_that_another_chose_stays(mode: FlightMode) -> None:
    against = status(mode).against_offboard()
    assert against is not None
    assert mode.value in against
