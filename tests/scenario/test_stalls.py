"""A loop that stood still did not listen: that is not the vehicle's silence."""

import msgspec

from autonomy.config import Config
from autonomy.mission.guarded import Command
from autonomy.model import Ending, MissionState
from autonomy.simulation import SimulatedFlight, Simulation, goal_of, with_scenario
from hal.setpoints import Reply, Request, RequestKind
from hal.sim.px4 import Mode
from hal.sim.scenario import load_scenario


def simulation() -> Simulation:
    scenario = load_scenario("empty")
    config = with_scenario(Config(), scenario)
    return Simulation(scenario, config, (goal_of(scenario, config),))


def test_a_stall_during_take_off_is_no_lost_link() -> None:
    stalled_s = 0.0

    def stall(simulation: Simulation, command: Command) -> None:
        nonlocal stalled_s
        if simulation.vehicle.autopilot.mode is Mode.TAKEOFF and stalled_s == 0.0:
            stalled_s = simulation.clock.now_s()
            simulation.vehicle.cut_link()
            simulation.vehicle.advance(3.0)
        elif stalled_s and simulation.clock.now_s() > stalled_s + 3.2:
            simulation.vehicle.restore_link()

    flight = simulation().run(on_tick=stall)
    assert stalled_s > 0.0
    assert flight.outcome.ending is Ending.GOAL_REACHED, flight.outcome.why


def test_a_link_that_stays_silent_after_a_stall_is_lost_in_bounded_time() -> None:
    cut_s: list[float] = []
    landing_s: list[float] = []

    def cut(simulation: Simulation, command: Command) -> None:
        now_s = simulation.clock.now_s()
        if command.decision.state is MissionState.CRUISE and not cut_s:
            simulation.vehicle.cut_link()
            simulation.vehicle.advance(3.0)
            cut_s.append(simulation.clock.now_s())
        if command.decision.state is MissionState.LAND and not landing_s:
            landing_s.append(now_s)

    flight = simulation().run(on_tick=cut)
    assert flight.outcome.ending is Ending.LINK_LOST, flight.outcome.why
    assert landing_s[0] - cut_s[0] < Config().vehicle.link_timeout_s + 0.2


def test_a_loop_that_stood_still_lets_px4_s_failsafe_have_the_vehicle() -> None:
    """As after SIGSTOP: what came meanwhile is not decoded yet when the first tick comes."""
    asked_after: list[RequestKind] = []
    stood_still = False

    def stand_still(simulation: Simulation, command: Command) -> None:
        nonlocal stood_still
        if stood_still:
            asked_after.extend(request.kind for request in command.decision.requests)
        elif command.decision.state is MissionState.CRUISE:
            stood_still = True
            vehicle = simulation.vehicle
            status, position = vehicle.status(), vehicle.local_position()
            vehicle.advance(6.0)
            old = simulation.inputs()
            old_status = msgspec.structs.replace(
                status, link_age_s=simulation.clock.now_s() - status.stamp_s
            )
            late = msgspec.structs.replace(
                old, ranges=(), local_position=position, status=old_status
            )
            first = simulation.guarded.step(late)
            asked_after.extend(request.kind for request in first.decision.requests)

    flight = simulation().run(on_tick=stand_still)
    assert stood_still
    assert flight.outcome.ending is Ending.TAKEN_OVER, flight.outcome.why
    assert "failsafe" in flight.outcome.why
    assert asked_after == []


def flown_with_refusals(refusals: int) -> tuple[SimulatedFlight, int]:
    """A flight whose first `refusals` requests for OFFBOARD are refused; how often it asked."""
    sim, asked = simulation(), 0
    execute_now = sim.vehicle.execute_now

    def refuse(request: Request) -> Reply:
        nonlocal asked
        if request.kind is not RequestKind.OFFBOARD:
            return execute_now(request)
        asked += 1
        if asked <= refusals:
            now_s = sim.clock.now_s()
            return Reply(now_s, request.kind, accepted=False, reason=f"planted {asked}")
        return execute_now(request)

    sim.vehicle.execute_now = refuse  # type: ignore[method-assign]  # a double of one method
    return sim.run(), asked


def test_a_passing_refusal_of_offboard_is_asked_again() -> None:
    flight, asked = flown_with_refusals(2)
    assert flight.outcome.ending is Ending.GOAL_REACHED, flight.outcome.why
    assert asked == 3


def test_a_lasting_refusal_of_offboard_lands_and_tells_the_last_reason() -> None:
    flight, asked = flown_with_refusals(1000)
    assert flight.outcome.ending is Ending.OFFBOARD_REFUSED
    assert flight.outcome.why == f"PX4 refused Offboard: planted {asked}"
    assert 5 <= asked <= 12
