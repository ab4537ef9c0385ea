"""A room without GNSS: PX4 knows its local position only, does not hold, and flies all the same."""

from autonomy.config import Config
from autonomy.model import Ending, MissionState
from autonomy.simulation import SimulatedFlight, Simulation, goal_of, with_scenario
from hal.readings import FlightMode
from hal.setpoints import RequestKind
from hal.sim.px4 import Landed, Mode
from hal.sim.scenario import Scenario


def scenario(**more: object) -> Scenario:
    return Scenario.model_validate(
        {
            "name": "no_gnss",
            "gnss": {"present": False},
            "obstacles": [{"kind": "disc", "centre_ne_m": (1.5, 0.6), "radius_m": 0.2}],
            "goal_ne_m": (2.5, 1.0),
            "vehicle": {"parameters": {"COM_OBL_RC_ACT": 5, "SYS_HAS_GPS": 0}},
        }
        | more
    )


def simulation(world: Scenario, **mission: object) -> Simulation:
    config = with_scenario(Config.model_validate({"mission": mission}), world)
    return Simulation(world, config, (goal_of(world, config),))


def asked(flight: SimulatedFlight) -> list[RequestKind]:
    return [r.kind for command in flight.commands for r in command.decision.requests]


def test_the_goal_is_reached_by_the_local_position_alone() -> None:
    flight = simulation(scenario()).run(keep_commands=True)
    assert flight.outcome.ending is Ending.GOAL_REACHED, flight.outcome.why
    assert not flight.collided
    requests = asked(flight)
    # In Hold, PX4 would not arm; nor would it take off into Hold.
    assert requests[:2] == [RequestKind.TAKEOFF, RequestKind.ARM]
    assert requests.count(RequestKind.TAKEOFF) == 1
    assert RequestKind.HOLD not in requests


def test_where_px4_refuses_hold_the_end_is_a_landing() -> None:
    flight = simulation(scenario(), land_at_end=False).run(keep_commands=True)
    assert flight.outcome.ending is Ending.GOAL_REACHED
    requests = asked(flight)
    assert RequestKind.HOLD in requests
    assert RequestKind.LAND in requests
    assert flight.commands[-1].decision.state is MissionState.DONE


def test_with_gnss_nothing_is_selected_before_arming() -> None:
    flight = simulation(scenario(gnss={"present": True})).run(keep_commands=True)
    assert asked(flight)[:2] == [RequestKind.ARM, RequestKind.TAKEOFF]


def test_without_any_position_it_says_what_is_missing() -> None:
    fault = {"kind": "position_silence", "start_s": 0.0}
    flight = simulation(scenario(faults=[fault])).run(keep_commands=True)
    assert flight.outcome.ending is Ending.PREFLIGHT_REFUSED
    assert "no usable position" in flight.outcome.why
    assert "optical flow" in flight.outcome.why
    assert RequestKind.ARM not in asked(flight)


def test_a_vehicle_that_does_not_fly_in_the_end_is_left_in_hold_and_not_in_takeoff() -> None:
    world = scenario()
    tried = simulation(world, preflight_timeout_s=4.0)

    def spoil(_: Simulation, __: object) -> None:
        if tried.vehicle.autopilot.mode is Mode.TAKEOFF:
            tried.vehicle.autopilot.set_fault("Preflight Fail: compass not calibrated")

    flight = tried.run(on_tick=spoil, keep_commands=True)
    assert flight.outcome.ending is Ending.PREFLIGHT_REFUSED
    assert "compass" in flight.outcome.why
    assert asked(flight) == [RequestKind.TAKEOFF, RequestKind.ARM, RequestKind.HOLD]
    assert tried.vehicle.status().mode is FlightMode.HOLD
    assert tried.vehicle.autopilot.landed is Landed.ON_GROUND
