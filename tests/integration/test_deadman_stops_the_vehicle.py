"""Real MAVSDK, real MAVLink, the mock PX4: whatever freezes or dies, the drone stops."""

import asyncio
import math
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from autonomy.embedded import EmbeddedPx4, free_udp_port
from hal.clock import MonotonicClock
from hal.config import DeadmanConfig
from hal.readings import FlightMode
from hal.vehicle.deadman import Deadman
from tests.support.airborne import cruise_north, take_off, until, vehicle_on
from tests.support.wire import WireTap

pytestmark = pytest.mark.integration

BLOCK_S = 5.0
STOPPED_M_S = 0.05
ROOT = Path(__file__).parents[2]


def speeds(px4: EmbeddedPx4) -> list[tuple[float, float]]:
    """(simulated time, true horizontal speed) so far."""
    out = []
    for state in px4.truth():
        t, velocity = state["t"], state["velocity_ned_m_s"]
        assert isinstance(t, float)
        assert isinstance(velocity, list)
        out.append((t, math.hypot(velocity[0], velocity[1])))
    return out


async def test_a_blocked_event_loop_stops_the_vehicle_and_then_gives_it_to_hold() -> None:
    with EmbeddedPx4("empty", 3) as px4:
        client_port = free_udp_port()
        with WireTap(px4.port, client_port) as tap:
            vehicle = vehicle_on(f"udpin://127.0.0.1:{client_port}")
            deadman = Deadman(DeadmanConfig(), vehicle.stop_now, vehicle.hold_now, MonotonicClock())
            await vehicle.open(15.0)
            try:
                with deadman:
                    await take_off(vehicle)
                    await cruise_north(vehicle, 4.0, deadman=deadman)
                    blocked_s, blocked_sim_s = time.monotonic(), speeds(px4)[-1][0]
                    time.sleep(BLOCK_S)  # noqa: ASYNC251 - the defect under test
                    deadman.release()
                    await asyncio.sleep(0.3)
                    assert deadman.stops == 1
                    assert vehicle.status().mode is FlightMode.HOLD
                    assert vehicle.status().armed
            finally:
                await vehicle.close()
            first_stop_s = min(
                target.at_s
                for target in tap.targets
                if target.at_s > blocked_s and target.speed_m_s == 0.0
            )
        course = speeds(px4)
    assert first_stop_s - blocked_s < 0.5
    assert max(v for t, v in course if t <= blocked_sim_s) > 0.18, "it never flew"
    after = [(t - blocked_sim_s, v) for t, v in course if t > blocked_sim_s]
    assert min(v for t, v in after if t < 1.5) < STOPPED_M_S, after
    later = [v for t, v in after if 1.5 <= t <= BLOCK_S]
    assert later
    assert max(later) < 2.0 * STOPPED_M_S, after
    assert max(v for t, v in after if 3.0 <= t <= BLOCK_S) < STOPPED_M_S, after


FLYING_PROCESS = """
import asyncio, sys
from hal.clock import MonotonicClock
from hal.config import DeadmanConfig
from hal.vehicle.deadman import Deadman
from tests.support.airborne import cruise_north, take_off, vehicle_on

async def main():
    vehicle = vehicle_on(sys.argv[1])
    await vehicle.open(15.0)
    await take_off(vehicle)
    with Deadman(DeadmanConfig(), vehicle.stop_now, vehicle.hold_now, MonotonicClock()) as deadman:
        await cruise_north(vehicle, 3.0, deadman=deadman)
        print("cruising", flush=True)
        await cruise_north(vehicle, 30.0, deadman=deadman)

asyncio.run(main())
"""


@pytest.mark.parametrize("blow", [signal.SIGKILL, signal.SIGSTOP])
def test_a_process_that_dies_leaves_the_stop_to_the_autopilots_failsafe(
    blow: signal.Signals,
) -> None:
    with EmbeddedPx4("empty", 3) as px4:
        with subprocess.Popen(
            [sys.executable, "-c", FLYING_PROCESS, px4.connection],
            cwd=ROOT,
            stdout=subprocess.PIPE,
            text=True,
        ) as flying:
            try:
                assert flying.stdout is not None
                assert flying.stdout.readline() == "cruising\n"
                struck_sim_s = speeds(px4)[-1][0]
                os.kill(flying.pid, blow)
                time.sleep(5.0)
            finally:
                flying.kill()
        states = px4.truth()
        course = speeds(px4)
    assert max(v for t, v in course if t <= struck_sim_s) > 0.18, "it never flew"
    after = [(t - struck_sim_s, v) for t, v in course if t > struck_sim_s]
    assert max(v for t, v in after if t >= 4.0) < 1.5 * STOPPED_M_S, after
    assert states[-1]["mode"] == FlightMode.HOLD.value
    assert states[-1]["armed"] is True
    assert states[-1]["collided"] is False


async def test_a_slow_loop_that_still_feeds_is_left_alone() -> None:
    with EmbeddedPx4("empty", 4) as px4:
        vehicle = vehicle_on(px4.connection)
        deadman = Deadman(DeadmanConfig(), vehicle.stop_now, vehicle.hold_now, MonotonicClock())
        await vehicle.open(15.0)
        try:
            with deadman:
                await take_off(vehicle)
                for _ in range(10):
                    await cruise_north(vehicle, 0.1, deadman=deadman)
                    time.sleep(0.1)  # noqa: ASYNC251 - a tick that is late, but comes
                assert vehicle.status().mode is FlightMode.OFFBOARD
                deadman.release()
                await until(lambda: vehicle.status().link_age_s < 0.2, 1.0, "a live link")
            assert deadman.stops == 0
        finally:
            await vehicle.close()
