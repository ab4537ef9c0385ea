"""Garbage on the port of the real MAVSDK: dropped, counted, and nothing moves because of it."""

import asyncio
import math
from pathlib import Path

import pytest

from autonomy.flightlog.reader import FlightLog
from hal.clock import MonotonicClock
from hal.config import BeamsConfig
from hal.drops import dropped_by
from hal.ranging.mavlink_beams import MavlinkBeams
from tests.support.airborne import until, vehicle_on
from tests.support.flying import Flying, never_harmed, on_the_ground
from tests.support.heckler import Heckler
from tests.support.mock_px4 import MockProcess, free_udp_port

pytestmark = pytest.mark.integration

LIMIT_S = 300.0


async def test_what_is_not_the_vehicles_is_counted_and_not_believed(tmp_path: Path) -> None:
    port, client_port = free_udp_port(), free_udp_port()
    with (
        Heckler(port, client_port) as heckler,
        MockProcess(tmp_path, "--scenario", "empty", port=port),
    ):
        vehicle = vehicle_on(f"udpin://127.0.0.1:{client_port}")
        beams = MavlinkBeams(vehicle, BeamsConfig())
        try:
            await vehicle.open(20.0)
            await beams.open(20.0)
            await until(lambda: vehicle.local_position() is not None, 20.0, "a position")
            heckler.begin()
            places = []
            for _ in range(120):
                await asyncio.sleep(0.05)
                position = vehicle.local_position()
                assert position is not None
                places.append(position.position_ned_m)
                assert vehicle.status().link_age_s < 3.0
            readings = beams.take()
        finally:
            await vehicle.close()
    reasons = {reason for (_, reason), count in dropped_by((vehicle, beams)).items() if count}
    assert reasons >= {"unreadable", "its time leapt", "another sender"}, (reasons, heckler.put_in)
    assert heckler.put_in.keys() == set(Heckler.KINDS)
    assert all(math.hypot(*place) < 0.5 for place in places)
    assert {reading.beam for reading in readings} == {m.name for m in BeamsConfig().mounts}
    assert max(reading.stamp_s for reading in readings) <= MonotonicClock().now_s()


def test_a_flight_among_garbage_ends_at_the_goal_or_says_why_not(tmp_path: Path) -> None:
    port, client_port = free_udp_port(), free_udp_port()
    arguments = ("--goal", "1.2,0.4", "--connection", f"udpin://127.0.0.1:{client_port}")
    with (
        Heckler(port, client_port) as heckler,
        MockProcess(tmp_path, "--scenario", "empty", port=port) as px4,
        Flying(tmp_path / "flight", *arguments) as flying,
    ):
        flying.wait_for("takeoff")
        heckler.begin()
        code = flying.end(LIMIT_S)
        heckler.end()
        report = flying.report
        px4.wait_for_truth(lambda state: not state["in_air"] and not state["armed"], 60.0)
        truth = px4.truth()
    assert sum(heckler.put_in.values()) > 500
    assert flying.errors == ""
    assert report["ending"] == "goal_reached" or report["why"], report
    assert (code == 0) == (report["ending"] == "goal_reached")
    never_harmed(truth)
    assert on_the_ground(truth)
    assert max(math.hypot(*state["velocity_ned_m_s"][:2]) for state in truth) < 0.35
    for tick in FlightLog.open(Path(report["log_path"])):
        fused = tick.command.decision.fused
        if fused is not None:
            assert all(map(math.isfinite, (*fused.position_ned_m, *fused.velocity_ned_m_s)))
