"""Every fault of the table, in every state of the mission, on the real pilot and guard.

One simulated flight is copied where it enters each state; each copy meets one fault. Looked at:
the response, its sentence, that the stream of setpoints never stops while Offboard is this
service's, and that nothing is disarmed in the air.
"""

import copy
import functools
from collections.abc import Callable

import msgspec
import pytest

from autonomy.config import Config
from autonomy.mission.failsafe import RULES, Fault, Response, response_to
from autonomy.mission.machine import OFFBOARD_STATES, PATH_STATES
from autonomy.mission.sensing import Sensing
from autonomy.model import Command, FusedState, Inputs, MissionState, OperatorCommand
from autonomy.simulation import Simulation, goal_of, with_scenario
from hal.readings import FlightMode, LocalPosition
from hal.setpoints import RequestKind, Setpoint
from hal.sim.scenario import load_scenario

S = MissionState
CONFIG = Config.model_validate(
    {
        "failsafe": {"battery_land": 0.01, "battery_return": 0.2},
        "mission": {"path_limit_m": 500.0},
    }
)
BACK = Config.model_validate(
    {"failsafe": {"budget": "return"}, "mission": {"path_limit_m": 1.0, "time_limit_s": 300.0}}
)
WATCHED_TICKS = 40
ON_THE_GROUND = (S.PREFLIGHT, S.ARM)
IN_THE_AIR = tuple(state for state in S if state not in (*ON_THE_GROUND, S.YIELDED, S.DONE))


class Tampered(Simulation):
    """A simulation between whose vehicle and pilot something is wrong."""

    tamper: Callable[[Inputs], Inputs] | None = None

    def inputs(self) -> Inputs:
        inputs = super().inputs()
        return inputs if self.tamper is None else self.tamper(inputs)


def flight(config: Config) -> Tampered:
    world = load_scenario("default")
    full = with_scenario(config, world)
    simulation = Tampered(world, full, (goal_of(world, full),))
    simulation.vehicle.autopilot.battery_override = 0.251
    simulation.vehicle.advance(6.0)
    return simulation


def is_there(simulation: Simulation, state: MissionState) -> bool:
    """Takeoff in the air, and a landing that PX4 flies: the other states are there at once."""
    status = simulation.vehicle.status()
    if state is S.TAKEOFF:
        return (
            status.mode is FlightMode.TAKEOFF
            and simulation.vehicle.truth().position_ned_m[2] < -0.1
        )
    return state is not S.LAND or status.mode is FlightMode.LAND


@functools.cache
def entering(state: MissionState) -> Tampered:
    """The flight in `state`, still undisturbed."""
    simulation = flight(BACK if state is S.RETURN else CONFIG)
    order = {S.HOLD: OperatorCommand.HOLD, S.LAND: OperatorCommand.LAND}.get(state)
    if state is S.PREFLIGHT:
        return simulation
    for _ in range(2000):
        command = simulation.tick()
        if command.decision.state is state and is_there(simulation, state):
            simulation.tick()
            return simulation
        if order is not None and command.decision.state is S.CRUISE:
            simulation.pending.append(order)
            order = None
    raise AssertionError(f"the flight never came to {state}")


def copied(state: MissionState) -> Tampered:
    known = entering(state)
    shared = (known.world, known._scenario, known._config)
    return copy.deepcopy(known, {id(each): each for each in shared})


# ---------------------------------------------------------------- what goes wrong


def status(**changes: object) -> Callable[[Tampered], None]:
    def inject(simulation: Tampered) -> None:
        def tamper(inputs: Inputs) -> Inputs:
            changed = msgspec.structs.replace(inputs.status, **changes)
            return msgspec.structs.replace(inputs, status=changed)

        simulation.tamper = tamper

    return inject


def position_gone(simulation: Tampered) -> None:
    last: list[LocalPosition | None] = []

    def tamper(inputs: Inputs) -> Inputs:
        last.append(inputs.local_position)
        return msgspec.structs.replace(inputs, local_position=last[0])

    simulation.tamper = tamper


def gone(*beams: str) -> Callable[[Tampered], None]:
    def inject(simulation: Tampered) -> None:
        def tamper(inputs: Inputs) -> Inputs:
            left = tuple(reading for reading in inputs.ranges if reading.beam not in beams)
            return msgspec.structs.replace(inputs, ranges=left)

        simulation.tamper = tamper

    return inject


def sensed(change: Callable[[FusedState], FusedState]) -> Callable[[Tampered], None]:
    """What the estimator says is changed."""

    def inject(simulation: Tampered) -> None:
        sensing = simulation.guarded.pilot.sensing
        step = functools.partial(Sensing.step, sensing)
        sensing.step = lambda inputs: change(step(inputs))  # type: ignore[method-assign]

    return inject


def uncertain(sigma_m: float, *, ok: bool) -> Callable[[Tampered], None]:
    why = "" if ok else f"position is uncertain to {sigma_m:.2f} m"
    return sensed(
        lambda fused: msgspec.structs.replace(
            fused, position_sigma_m=sigma_m, ok=ok, why_not_ok=why
        )
    )


def outside(by_m: float) -> Callable[[Tampered], None]:
    """As far outside as no flight under the guard comes by itself."""

    def inject(simulation: Tampered) -> None:
        responding = simulation.guarded.pilot._responding
        responding._outside_m = lambda _: by_m  # type: ignore[method-assign, assignment]

    return inject


def jumped(simulation: Tampered) -> None:
    simulation.vehicle.jump_estimate((0.5, -0.3, 0.0))


def pulled(simulation: Tampered) -> None:
    """Another computer's setpoints are heard, and none of ours."""
    send = simulation.vehicle.send

    def instead(setpoint: Setpoint) -> None:
        here = simulation.vehicle.local_position()
        place = setpoint.position_ned_m if here is None else here.position_ned_m
        send(
            msgspec.structs.replace(
                setpoint, position_ned_m=place, velocity_ned_m_s=(-0.3, -0.3, 0.0)
            )
        )

    simulation.vehicle.send = instead  # type: ignore[method-assign]


def long_ago(simulation: Tampered) -> None:
    simulation.guarded.pilot._responding.armed(simulation.clock.now_s() - 1e4)


def far_flown(simulation: Tampered) -> None:
    simulation.guarded.pilot._trail.flown_m = 1e4


INJECTED: dict[Fault, tuple[Callable[[Tampered], None], str]] = {
    Fault.PILOT_TAKEOVER: (status(mode=FlightMode.MANUAL), "a pilot or PX4 switched"),
    Fault.OFFBOARD_LOST: (
        status(mode=FlightMode.RETURN, in_failsafe=True),
        "PX4's failsafe switched the vehicle to return",
    ),
    Fault.DISARMED: (status(armed=False), "disarmed the vehicle"),
    Fault.LINK_LOST: (status(link_age_s=2.0), "silent for 2.0 s"),
    Fault.BATTERY_CRITICAL: (status(battery_remaining=0.005), "the battery is at"),
    Fault.BATTERY_LOW: (status(battery_remaining=0.2), "the battery is at 20%"),
    Fault.STATE_LOST: (position_gone, "no usable position"),
    Fault.STATE_LOST_LONG: (position_gone, "no usable position for"),
    Fault.ESTIMATOR_DIVERGED: (uncertain(0.5, ok=False), "uncertain to 0.50 m"),
    Fault.POSITION_UNCERTAIN: (uncertain(0.25, ok=True), "uncertain to 0.25 m"),
    Fault.POSITION_JUMPED: (jumped, "PX4's frame jumped by 0.5"),
    Fault.BEAM_DOUBTED: (gone("front"), "lost: beam front"),
    Fault.BEAMS_LOST: (gone("front", "left"), "lost: front (stale), left (stale), for"),
    Fault.BEAMS_LOST_LONG: (gone("front", "left"), "lost: front (stale), left (stale), for 5"),
    Fault.FENCE_LEFT: (outside(0.3), "0.30 m outside the geofence"),
    Fault.FENCE_LEFT_FAR: (outside(0.9), "0.90 m outside the geofence"),
    Fault.DRIFT: (pulled, "elsewhere than asked for"),
    Fault.DRIFT_LONG: (pulled, "elsewhere than asked for"),
    Fault.TIME_OVER: (long_ago, "the time limit of"),
    Fault.PATH_OVER: (far_flown, "m of way is flown"),
}
FOUND_ELSEWHERE = {
    Fault.UNREACHABLE,  # by the ladder: tests/scenario/test_returns.py
}
NEEDS_TICKS = {
    Fault.STATE_LOST_LONG: 60,
    Fault.BEAMS_LOST_LONG: 120,
    Fault.DRIFT: 60,
    Fault.DRIFT_LONG: 60,
}


def test_every_fault_is_injected_here_or_has_an_owner() -> None:
    assert set(INJECTED) | FOUND_ELSEWHERE == set(Fault) == set(RULES)
    assert not set(INJECTED) & FOUND_ELSEWHERE


# ---------------------------------------------------------------- what is done about it


def expected(state: MissionState, fault: Fault, config: Config) -> MissionState | None:
    """Where the fault leads; None for what goes on as if nothing was."""
    response = response_to(config, fault)
    # The first two end in the third, where what is wrong is wrong, too; the fourth lasts a tick.
    at = {S.TAKEOFF: S.DETECT, S.OFFBOARD: S.DETECT, S.REPLAN: S.CRUISE}.get(state, state)
    if response is Response.LET_GO:
        return None if at is S.LAND and fault is Fault.DISARMED else S.DONE
    if at is S.LAND:
        return None
    leads_to = {
        Response.LAND: S.LAND,
        # The operator's HOLD puts it off: tests/unit/autonomy/mission/test_orders.py
        Response.RETURN: S.RETURN if at is not S.HOLD else None,
        Response.HOLD: S.HOLD,
        Response.STOP: S.STOP if at in PATH_STATES else None,
        Response.SLOW: None,
    }[response]
    return None if leads_to is at else leads_to


WAITED_FOR = {(S.TAKEOFF, Fault.STATE_LOST), (S.TAKEOFF, Fault.ESTIMATOR_DIVERGED)}
WAITED_FOR |= {(S.OFFBOARD, Fault.STATE_LOST), (S.OFFBOARD, Fault.ESTIMATOR_DIVERGED)}
"""Offboard is not asked for before there is a position."""


def watched(simulation: Tampered, fault: Fault) -> list[Command]:
    landing = simulation.vehicle.status().mode is FlightMode.LAND
    ticks = WATCHED_TICKS if landing else NEEDS_TICKS.get(fault, WATCHED_TICKS)
    seen: list[Command] = []
    for _ in range(ticks):
        seen.append(simulation.tick())
        if seen[-1].decision.outcome is not None:
            break
    return seen


def nothing_unsafe_in(commands: list[Command], simulation: Tampered) -> None:
    """Streaming while Offboard is ours; no disarming in the air; nothing after letting go."""
    for command in commands:
        decision = command.decision
        if decision.state in OFFBOARD_STATES:
            assert command.wire_setpoint is not None, f"no setpoint in {decision.state}"
        asked = [request.kind for request in decision.requests]
        assert RequestKind.DISARM not in asked
        if decision.state in (S.YIELDED, S.DONE):
            assert command.wire_setpoint is None
            assert not asked
    truth = simulation.vehicle.truth()
    assert truth.armed or truth.on_ground


@pytest.mark.parametrize("fault", list(INJECTED))
@pytest.mark.parametrize("state", IN_THE_AIR)
def test_what_is_done_about_it_in_the_air(state: MissionState, fault: Fault) -> None:
    simulation = copied(state)
    inject, sentence = INJECTED[fault]
    inject(simulation)
    commands = watched(simulation, fault)
    entered = [event.name for command in commands for event in command.decision.events]
    said = [event.why for command in commands for event in command.decision.events]
    config = BACK if state is S.RETURN else CONFIG
    leads_to = expected(state, fault, config)
    if (state, fault) not in WAITED_FOR:
        told = any(sentence in why for why in said)
        put_off = state is S.HOLD and response_to(config, fault) is Response.RETURN
        assert told is (leads_to is not None or put_off) or fault is Fault.DRIFT, said
    if leads_to is not None and (state, fault) not in WAITED_FOR:
        # A drift that leads to something lands at once.
        wanted = {leads_to.value} | ({S.LAND.value} if fault is Fault.DRIFT else set())
        assert wanted & set(entered), said
    nothing_unsafe_in(commands, simulation)


@pytest.mark.parametrize("fault", list(INJECTED))
@pytest.mark.parametrize("state", ON_THE_GROUND)
def test_on_the_ground_nothing_is_flown_because_of_it(state: MissionState, fault: Fault) -> None:
    simulation = copied(state)
    INJECTED[fault][0](simulation)
    for _ in range(10):
        command = simulation.tick()
        if command.decision.state not in ON_THE_GROUND:
            break
        assert command.wire_setpoint is None
        assert not command.decision.faults


def test_uncertainty_slows_the_flight_to_table_2s_least() -> None:
    simulation = copied(S.CRUISE)
    uncertain(0.25, ok=True)(simulation)
    for _ in range(10):
        command = simulation.tick()
    assert command.decision.state is S.CRUISE
    assert command.decision.speed_limit_m_s == pytest.approx(CONFIG.guidance.speed_min_m_s)
    assert command.decision.faults == (Fault.POSITION_UNCERTAIN.value,)
