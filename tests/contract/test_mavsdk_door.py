"""What is special to the door to MAVSDK: what it refuses, what it puts on the wire, what stays."""

import asyncio
import math
import os
import signal
import socket
import threading
import time
from pathlib import Path

import pytest
from pymavlink.dialects.v20 import common as mavlink

from autonomy.embedded import EmbeddedPx4, free_udp_port
from hal.errors import ConnectionFailed, PortInUse, WrongAutopilot
from hal.readings import FlightMode
from hal.setpoints import Request, RequestKind, Setpoint
from hal.vehicle.mavsdk_vehicle import MavsdkVehicle
from tests.support.airborne import ask, until, vehicle_on
from tests.support.wire import WireTap

pytestmark = pytest.mark.integration

POSITION_AND_VELOCITY = 2496  # accelerations and yaw rate ignored
LOCAL_NED = 1


def native_threads() -> int:
    return len(list(Path("/proc/self/task").iterdir()))


async def test_nobody_there_ends_within_the_deadline_and_leaves_nothing() -> None:
    before = native_threads()
    vehicle = vehicle_on(f"udpin://127.0.0.1:{free_udp_port()}")
    began_s = time.monotonic()
    with pytest.raises(ConnectionFailed, match="no vehicle answered"):
        await vehicle.open(0.5)
    assert time.monotonic() - began_s < 3.0
    await asyncio.sleep(0.1)
    assert native_threads() <= before


async def test_giving_up_connecting_leaves_nothing() -> None:
    before = native_threads()
    vehicle = vehicle_on(f"udpin://127.0.0.1:{free_udp_port()}")
    opening = asyncio.get_running_loop().create_task(vehicle.open(30.0))
    await asyncio.sleep(0.3)
    opening.cancel()
    await asyncio.gather(opening, return_exceptions=True)
    await asyncio.sleep(0.1)
    assert native_threads() <= before


@pytest.mark.parametrize(
    "connection",
    [
        "nonsense",
        "udpin://127.0.0.1:notaport",
        "serial:///dev/does_not_exist:57600",
        "tcpout://127.0.0.1:1",
    ],
)
async def test_a_connection_that_cannot_be_is_refused_with_a_remedy(connection: str) -> None:
    with pytest.raises(ConnectionFailed) as refusal:
        await vehicle_on(connection).open(0.5)
    assert connection in str(refusal.value)


@pytest.mark.parametrize(
    "connection", ["serial:///dev/nope", "serial_flowcontrol:///dev/nope:9600"]
)
async def test_a_device_that_is_not_there_is_the_cause_that_is_told(connection: str) -> None:
    with pytest.raises(ConnectionFailed, match=r"/dev/nope: No such file or directory; plug"):
        await vehicle_on(connection).open(5.0)


@pytest.mark.parametrize("shared", [False, True])
async def test_a_taken_port_is_refused_also_when_its_owner_would_share_it(shared: bool) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as owner:
        if shared:
            owner.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        owner.bind(("127.0.0.1", 0))
        with pytest.raises(PortInUse, match="another port"):
            await vehicle_on(f"udpin://127.0.0.1:{owner.getsockname()[1]}").open(0.5)


async def test_two_vehicles_on_one_port_are_refused(px4: EmbeddedPx4) -> None:
    first = vehicle_on(px4.connection)
    await first.open(15.0)
    try:
        with pytest.raises(PortInUse):
            await vehicle_on(px4.connection).open(0.5)
        with pytest.raises(ConnectionFailed, match="open already"):
            await first.open(0.5)
        assert first.status().link_age_s < 1.0
    finally:
        await first.close()


def beat(port: int, autopilot: int, stop: threading.Event) -> None:
    """Heartbeats of another make, from a thread: the library must not wait for our loop."""
    codec = mavlink.MAVLink(None, srcSystem=7, srcComponent=1)
    heartbeat = mavlink.MAVLink_heartbeat_message(2, autopilot, 0, 0, 4, 3)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
        while not stop.wait(0.1):
            sender.sendto(heartbeat.pack(codec), ("127.0.0.1", port))


async def test_another_make_of_autopilot_is_named_and_refused() -> None:
    port, stop = free_udp_port(), threading.Event()
    thread = threading.Thread(target=beat, args=(port, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA, stop))
    thread.start()
    try:
        with pytest.raises(WrongAutopilot, match="Ardupilot"):
            await vehicle_on(f"udpin://127.0.0.1:{port}").open(5.0)
    finally:
        stop.set()
        thread.join()


async def test_a_companion_heard_before_the_autopilot_makes_no_other_vehicle_of_it() -> None:
    late = EmbeddedPx4("empty", seed=0)
    companion = mavlink.MAVLink(
        None, srcSystem=1, srcComponent=mavlink.MAV_COMP_ID_ONBOARD_COMPUTER
    )
    beat_of_it = mavlink.MAVLink_heartbeat_message(
        mavlink.MAV_TYPE_ONBOARD_CONTROLLER, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, 4, 3
    ).pack(companion)
    stop = threading.Event()

    def speak_first() -> None:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
            while not stop.wait(0.05):
                sender.sendto(beat_of_it, ("127.0.0.1", late.port))

    vehicle = vehicle_on(late.connection)
    thread = threading.Thread(target=speak_first)
    thread.start()
    try:
        async with asyncio.TaskGroup() as tasks:
            opening = tasks.create_task(vehicle.open(15.0))
            await asyncio.sleep(0.7)
            with late:
                facts = await opening
        assert facts.system_id == 1
    finally:
        stop.set()
        thread.join()
        await vehicle.close()


async def test_setpoints_reach_the_wire_whole_and_newest_first_and_end_with_the_link(
    px4: EmbeddedPx4,
) -> None:
    client_port = free_udp_port()
    with WireTap(px4.port, client_port) as tap:
        vehicle = vehicle_on(f"udpin://127.0.0.1:{client_port}")
        await vehicle.open(15.0)
        for n in range(2000):
            vehicle.send(
                Setpoint(0.0, (n * 0.001, 2.0, -1.5), (0.1, 0.2, -0.3), math.radians(-135.0))
            )
        await asyncio.sleep(0.3)
        burst = list(tap.targets)
        vehicle.stop_now()
        await asyncio.sleep(0.1)
        stopped = tap.targets[-1]
        position = vehicle.local_position()
        await vehicle.close()
        closed_s = time.monotonic()
        await asyncio.sleep(0.5)
        after_close = [target for target in tap.targets if target.at_s > closed_s + 0.02]
    last = burst[-1]
    assert (last.type_mask, last.frame) == (POSITION_AND_VELOCITY, LOCAL_NED)
    assert last.position_ned_m == pytest.approx((1.999, 2.0, -1.5), abs=1e-6)
    assert last.velocity_ned_m_s == pytest.approx((0.1, 0.2, -0.3), abs=1e-6)
    assert last.yaw_rad == pytest.approx(math.radians(-135.0), abs=1e-6)
    norths = [target.position_ned_m[0] for target in burst]
    assert norths == sorted(norths)
    assert position is not None
    assert stopped.speed_m_s == 0.0
    assert math.dist(stopped.position_ned_m, position.position_ned_m) < 0.2
    assert after_close == []


async def test_it_opens_again_after_closing_and_leaves_no_thread(px4: EmbeddedPx4) -> None:
    vehicle = vehicle_on(px4.connection)
    before = native_threads()
    for _ in range(3):
        assert (await vehicle.open(15.0)).system_id == 1
        await vehicle.close()
    await asyncio.sleep(0.1)
    assert native_threads() <= before


async def ask_and_give_up(vehicle: MavsdkVehicle) -> None:
    """Ask for Hold and do not wait for the answer."""
    asking = asyncio.get_running_loop().create_task(vehicle.execute(Request(RequestKind.HOLD)))
    await asyncio.sleep(0.0)
    asking.cancel()
    await asyncio.gather(asking, return_exceptions=True)


async def test_a_vehicle_that_is_not_in_offboard_is_not_told_to_hold(px4: EmbeddedPx4) -> None:
    vehicle = vehicle_on(px4.connection)
    assert not vehicle.hold_now()
    await vehicle.open(15.0)
    assert not vehicle.hold_now()
    await vehicle.close()


async def test_closing_waits_for_what_was_asked(px4: EmbeddedPx4) -> None:
    """An answer that came while the library took its plugins down ended the process."""
    vehicle = vehicle_on(px4.connection)
    for _ in range(4):
        await vehicle.open(15.0)
        await ask_and_give_up(vehicle)
        await ask_and_give_up(vehicle)
        await vehicle.close()
    assert (await vehicle.open(15.0)).system_id == 1
    await asyncio.to_thread(silence, px4.pid or 0)
    await ask_and_give_up(vehicle)
    closing = asyncio.get_running_loop().create_task(vehicle.close())
    # Nobody answers: the library gives the request up, and only then is the link taken down.
    early, _ = await asyncio.wait({closing}, timeout=0.5)
    os.kill(px4.pid or 0, signal.SIGCONT)
    assert not early
    await closing


def silence(pid: int) -> None:
    """Stop a process; it may still speak until the scheduler says that it is stopped."""
    os.kill(pid, signal.SIGSTOP)
    while Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "T":
        time.sleep(0.01)


async def test_requests_over_a_closed_link_are_refused_in_words() -> None:
    vehicle = vehicle_on("udpin://127.0.0.1:14540")
    for kind in RequestKind:
        reply = await vehicle.execute(Request(kind, 1.0))
        assert not reply.accepted
        assert kind.value in reply.reason


@pytest.mark.parametrize("altitude_m", [0.0, -1.0, math.nan, math.inf])
async def test_a_take_off_to_nowhere_is_refused_before_the_wire(altitude_m: float) -> None:
    reply = await vehicle_on("udpin://127.0.0.1:14540").execute(
        Request(RequestKind.TAKEOFF, altitude_m)
    )
    assert not reply.accepted
    assert "altitude" in reply.reason


async def test_a_switched_mode_is_seen_before_the_next_heartbeat(px4: EmbeddedPx4) -> None:
    """A pilot who takes the vehicle is noticed by CURRENT_MODE; the heartbeat comes once a second.

    By chance one of the switches may fall just before a heartbeat.
    """
    vehicle = vehicle_on(px4.connection)
    heartbeats: list[float] = []
    vehicle.listen("HEARTBEAT", lambda message: heartbeats.append(message.received_s))
    unaided = 0
    try:
        await vehicle.open(15.0)
        for mode in (FlightMode.LAND, FlightMode.HOLD) * 3:
            kind = RequestKind.LAND if mode is FlightMode.LAND else RequestKind.HOLD
            before = len(heartbeats)
            await ask(vehicle, kind)
            await until(lambda mode=mode: vehicle.status().mode is mode, 5.0, mode.value)  # type: ignore[misc]  # bound for this turn
            unaided += len(heartbeats) == before
            await asyncio.sleep(0.35)
    finally:
        await vehicle.close()
    assert unaided >= 3
