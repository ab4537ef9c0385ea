"""What every `hal.interfaces.Vehicle` promises."""

import asyncio
import math
from collections.abc import AsyncIterator, Callable

import pytest

from hal.config import GuardConfig
from hal.errors import ConnectionFailed
from hal.frames import finite3
from hal.readings import FlightMode, LandedState, LocalPosition
from hal.setpoints import Request, RequestKind, Setpoint
from hal.vehicle.guard.stopping import stopping_distance_m
from tests.contract.rigs import Rig, build, parameters

ALTITUDE_M = 1.2


@pytest.fixture(params=parameters("simulated"))
async def rig(request: pytest.FixtureRequest) -> AsyncIterator[Rig]:
    async with build(request) as built:
        yield built


async def until(rig: Rig, condition: Callable[[], bool], limit_s: float, what: str) -> None:
    for _ in range(math.ceil(limit_s / 0.1)):
        if condition():
            return
        await rig.pass_time(0.1)
    raise AssertionError(f"{what} did not happen within {limit_s} s")


def is_up(position: LocalPosition | None) -> bool:
    return position is not None and position.position_ned_m[2] < -0.8 * ALTITUDE_M


async def accepted(rig: Rig, kind: RequestKind, altitude_m: float = 0.0) -> None:
    reply = await rig.vehicle.execute(Request(kind, altitude_m))
    assert reply.accepted, reply.reason
    assert reply.kind is kind
    assert reply.reason == ""


async def refused(rig: Rig, kind: RequestKind) -> str:
    reply = await rig.vehicle.execute(Request(kind))
    assert not reply.accepted
    assert len(reply.reason) > 10
    return reply.reason


async def test_an_open_vehicle_is_a_px4_that_tells_where_it_is(rig: Rig) -> None:
    vehicle = rig.vehicle
    assert vehicle.local_position() is None
    facts = await vehicle.open(15.0)
    assert facts.autopilot == "PX4"
    assert facts.version
    assert facts.parameters["COM_OBL_RC_ACT"] == 5.0
    assert {"COM_OF_LOSS_T", "MPC_XY_P", "MIS_TAKEOFF_ALT", "GF_ACTION"} <= set(facts.parameters)
    await until(rig, lambda: vehicle.local_position() is not None, 3.0, "a position")
    await until(rig, lambda: vehicle.status().armable, 10.0, "being armable")
    status, position, attitude = vehicle.status(), vehicle.local_position(), vehicle.attitude()
    assert (status.armed, status.landed) == (False, LandedState.ON_GROUND)
    assert status.link_age_s < 0.5
    assert position is not None
    assert attitude is not None
    assert finite3(position.position_ned_m)
    assert math.hypot(*position.position_ned_m) < 1.0
    assert rig.clock.now_s() - position.stamp_s < 0.5
    await rig.pass_time(0.5)
    later = vehicle.local_position()
    assert later is not None
    assert later.stamp_s > position.stamp_s


async def test_it_flies_where_it_is_sent_and_refuses_what_would_drop_it(rig: Rig) -> None:
    vehicle = rig.vehicle
    await vehicle.open(15.0)
    await until(rig, lambda: vehicle.status().armable, 10.0, "being armable")
    assert "not armed" in await refused(rig, RequestKind.OFFBOARD)
    await accepted(rig, RequestKind.ARM)
    await accepted(rig, RequestKind.TAKEOFF, ALTITUDE_M)
    await until(
        rig,
        lambda: (
            vehicle.status().landed is LandedState.IN_AIR
            and vehicle.status().mode is FlightMode.HOLD
            and is_up(vehicle.local_position())
        ),
        20.0,
        "the take-off",
    )
    await refused(rig, RequestKind.DISARM)
    assert vehicle.status().armed
    position = vehicle.local_position()
    assert position is not None
    start = position.position_ned_m
    for step in range(50):
        north_m = start[0] + 0.2 * 0.05 * step
        setpoint = Setpoint(rig.clock.now_s(), (north_m, start[1], start[2]), (0.2, 0.0, 0.0), 0.0)
        vehicle.send(setpoint)
        if step == 2:
            await accepted(rig, RequestKind.OFFBOARD)
        await rig.pass_time(0.05)
    await until(rig, lambda: vehicle.status().mode is FlightMode.OFFBOARD, 2.0, "OFFBOARD")
    position = vehicle.local_position()
    assert position is not None
    assert position.position_ned_m[0] - start[0] > 0.2
    assert abs(position.position_ned_m[1] - start[1]) < 0.2
    vehicle.stop_now()
    await rig.pass_time(0.8)
    stopped = vehicle.local_position()
    assert stopped is not None
    assert vehicle.status().mode is FlightMode.OFFBOARD, "stopping asks for no mode"
    assert math.hypot(*stopped.velocity_ned_m_s) < 0.08
    # What the guard counts with; a busy computer begins later, and PX4 catches up faster.
    speed_m_s = math.hypot(*position.velocity_ned_m_s)
    way_m = stopping_distance_m(speed_m_s, GuardConfig().reaction_s, GuardConfig().braking_m_s2)
    assert math.dist(stopped.position_ned_m, position.position_ned_m) < way_m
    await accepted(rig, RequestKind.HOLD)
    await until(rig, lambda: vehicle.status().mode is FlightMode.HOLD, 2.0, "Hold")
    await accepted(rig, RequestKind.LAND)
    await until(rig, lambda: vehicle.status().mode is FlightMode.LAND, 2.0, "Land")
    assert "land" in await refused(rig, RequestKind.OFFBOARD)
    await until(rig, lambda: not vehicle.status().armed, 25.0, "landing and disarming")
    assert vehicle.status().landed is LandedState.ON_GROUND
    texts = vehicle.take_texts()
    stamps = [text.stamp_s for text in texts]
    assert stamps == sorted(stamps)
    assert texts
    assert vehicle.take_texts() == ()


async def test_a_silent_vehicle_is_told_by_its_age_and_by_replies_not_by_exceptions(
    rig: Rig,
) -> None:
    vehicle = rig.vehicle
    await vehicle.open(15.0)
    await rig.pass_time(0.5)
    rig.fall_silent()
    await rig.pass_time(1.0)
    young_s = vehicle.status().link_age_s
    assert young_s > 0.7
    await refused(rig, RequestKind.HOLD)
    await rig.pass_time(0.5)
    assert vehicle.status().link_age_s > young_s + 0.3
    vehicle.send(Setpoint(rig.clock.now_s(), (0.0, 0.0, -1.0)))
    rig.speak_again()
    await until(rig, lambda: vehicle.status().link_age_s < 0.5, 5.0, "hearing it again")


async def test_a_vehicle_that_never_answers_is_not_opened(rig: Rig) -> None:
    rig.fall_silent()
    with pytest.raises(ConnectionFailed):
        await rig.vehicle.open(0.5)
    rig.speak_again()
    assert (await rig.vehicle.open(15.0)).autopilot == "PX4"


async def test_closing_twice_is_harmless_and_what_was_known_stays_readable(rig: Rig) -> None:
    vehicle = rig.vehicle
    await vehicle.open(15.0)
    await vehicle.close()
    await vehicle.close()
    vehicle.send(Setpoint(rig.clock.now_s(), (0.0, 0.0, -1.0)))
    assert not vehicle.status().armed


async def test_waiting_for_an_answer_can_be_given_up(rig: Rig) -> None:
    await rig.vehicle.open(15.0)
    rig.fall_silent()
    asked = asyncio.get_running_loop().create_task(rig.vehicle.execute(Request(RequestKind.HOLD)))
    await asyncio.sleep(0.05)
    asked.cancel()
    (answer,) = await asyncio.gather(asked, return_exceptions=True)
    assert isinstance(answer, asyncio.CancelledError) or not getattr(answer, "accepted", True)
