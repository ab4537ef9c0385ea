"""A real MAVSDK client in the air over the mock PX4, for tests that then break something."""

import asyncio
import math
from collections.abc import Callable

from hal.clock import MonotonicClock
from hal.config import BeamsConfig, VehicleConfig
from hal.readings import FlightMode, LandedState
from hal.setpoints import Request, RequestKind, Setpoint
from hal.vehicle.deadman import Deadman
from hal.vehicle.mavsdk_vehicle import MavsdkVehicle

ALTITUDE_M = 1.2
TICK_S = 0.05


def vehicle_on(connection: str) -> MavsdkVehicle:
    """A vehicle adapter for that connection; not open."""
    return MavsdkVehicle(VehicleConfig(connection=connection), MonotonicClock(), BeamsConfig())


async def until(condition: Callable[[], bool], limit_s: float, what: str) -> None:
    """Wait for `condition()`; AssertionError naming `what` when it does not come true."""
    for _ in range(math.ceil(limit_s / TICK_S)):
        if condition():
            return
        await asyncio.sleep(TICK_S)
    raise AssertionError(f"{what} did not happen within {limit_s} s")


async def ask(vehicle: MavsdkVehicle, kind: RequestKind, altitude_m: float = 0.0) -> None:
    """A request that must be accepted."""
    reply = await vehicle.execute(Request(kind, altitude_m))
    assert reply.accepted, reply.reason


def altitude_m(vehicle: MavsdkVehicle) -> float:
    """Above the frame's origin, by the vehicle's own estimate."""
    position = vehicle.local_position()
    return -position.position_ned_m[2] if position is not None else 0.0


async def take_off(vehicle: MavsdkVehicle) -> None:
    """Arm, take off and wait for the hover in Hold; then OFFBOARD."""
    await until(lambda: vehicle.status().armable, 10.0, "getting ready to arm")
    await ask(vehicle, RequestKind.ARM)
    await ask(vehicle, RequestKind.TAKEOFF, ALTITUDE_M)
    await until(
        lambda: (
            vehicle.status().landed is LandedState.IN_AIR
            and vehicle.status().mode is FlightMode.HOLD
            and altitude_m(vehicle) > 0.8 * ALTITUDE_M
        ),
        20.0,
        "the take-off",
    )
    await ask(vehicle, RequestKind.OFFBOARD)


async def cruise_north(
    vehicle: MavsdkVehicle, seconds: float, speed_m_s: float = 0.25, deadman: Deadman | None = None
) -> None:
    """Fly north at 20 Hz, feeding the deadman."""
    clock = MonotonicClock()
    position = vehicle.local_position()
    assert position is not None
    n, e, d = position.position_ned_m
    for _ in range(round(seconds / TICK_S)):
        n += speed_m_s * TICK_S
        vehicle.send(Setpoint(clock.now_s(), (n, e, d), (speed_m_s, 0.0, 0.0), 0.0))
        if deadman is not None:
            deadman.feed()
        await asyncio.sleep(TICK_S)
