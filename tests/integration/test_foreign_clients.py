"""Programs that nobody here wrote fly the mock PX4: MAVProxy, pymavlink's mavutil, MAVSDK."""

import asyncio
import contextlib
import math
import time
from collections.abc import AsyncIterator, Awaitable, Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from mavsdk.asyncio import ComponentType, Configuration, Mavsdk
from mavsdk.asyncio.plugins.action import ActionAsync
from mavsdk.asyncio.plugins.ftp import FtpAsync
from mavsdk.asyncio.plugins.info import InfoAsync
from mavsdk.asyncio.plugins.log_files import LogFilesAsync
from mavsdk.asyncio.plugins.mavlink_direct import MavlinkDirectAsync
from mavsdk.asyncio.plugins.mission import MissionAsync
from mavsdk.asyncio.plugins.param import ParamAsync
from mavsdk.asyncio.plugins.telemetry import TelemetryAsync
from mavsdk.plugins.action import ActionError
from mavsdk.plugins.ftp import FtpError
from mavsdk.plugins.log_files import LogFilesError
from mavsdk.plugins.mission import MissionItem, MissionPlan
from mavsdk.plugins.telemetry import FlightMode
from pymavlink import mavutil
from pymavlink.dialects.v20 import development as mavlink

from hal.frames import EARTH_RADIUS_M
from tests.support.flying import never_harmed, on_the_ground
from tests.support.mavproxy import MavProxy
from tests.support.mock_px4 import MockProcess

pytestmark = pytest.mark.integration

PARAMETERS = 938
LIMIT_S = 120.0
GROUND_AMSL_M = 488.0


# ---------------------------------------------------------------- MAVProxy


def modes_flown(mock: MockProcess) -> list[str]:
    """Each mode in which it was armed, in the order in which it first was."""
    return list(dict.fromkeys(state["mode"] for state in mock.truth() if state["armed"]))


def test_mavproxy_connects_downloads_everything_flies_and_lands(tmp_path: Path) -> None:
    with MockProcess(tmp_path, "--scenario", "empty") as mock, MavProxy(tmp_path, mock.port) as gcs:
        gcs.wait("online system 1")
        gcs.wait(f"Received {PARAMETERS} parameters")
        gcs.do("param show MPC_XY_VEL_MAX", "12.0")
        gcs.do("param set MPC_XY_VEL_MAX 3")
        gcs.do("param fetch MPC_XY_VEL_MAX", "MPC_XY_VEL_MAX")
        gcs.do("version", "COMMAND_ACK: REQUEST_MESSAGE: ACCEPTED")
        gcs.do("wp list", "Requesting 0 waypoints")
        gcs.do("fence list", "Requesting 0 fence items")
        gcs.do("rally list", "Requesting 0 rally items")

        gcs.do("arm throttle", "COMMAND_ACK: COMPONENT_ARM_DISARM: ACCEPTED")
        # Its take-off altitude is what PX4 reads as AMSL.
        gcs.do(f"takeoff {GROUND_AMSL_M + 1.5}", "COMMAND_ACK: NAV_TAKEOFF: ACCEPTED")
        gcs.wait("Mode TAKEOFF")
        mock.wait_for_truth(lambda state: state["position_ned_m"][2] < -1.3, LIMIT_S)
        # Its "mode" command fails in itself with PX4 (a tuple where it wants a number).
        gcs.do("long DO_SET_MODE 29 4 3", "COMMAND_ACK: DO_SET_MODE: ACCEPTED")
        mock.wait_for_truth(lambda state: state["mode"] == "hold", LIMIT_S)
        gcs.do("long NAV_LAND", "COMMAND_ACK: NAV_LAND: ACCEPTED")
        gcs.wait("Mode LAND")
        gcs.wait("DISARMED", LIMIT_S)

        gcs.do("status", "MAV Errors: 0")
        gcs.do("link", "link 1 OK")
        text = gcs.text
        truth = mock.truth()
        modes = modes_flown(mock)
    # Armed in Hold for less than a line of the truth file, it may be seen in it only later.
    assert sorted(modes) == ["hold", "land", "takeoff"]
    assert modes[-1] == "land"
    never_harmed(truth)
    assert on_the_ground(truth)
    assert max(-state["position_ned_m"][2] for state in truth) == pytest.approx(1.5, abs=0.4)
    assert "AP: " in text, "no status text arrived"
    for complaint in ("BAD_DATA", "Traceback", "FAILED", "DENIED", "UNSUPPORTED"):
        assert complaint not in text, text


def test_no_message_that_mavproxy_does_not_know_comes_often(tmp_path: Path) -> None:
    """What PX4 sends and this dialect lacks is rare, as with a real PX4 (5 such a second)."""
    with MockProcess(tmp_path, "--scenario", "empty") as mock:
        heard: dict[str, int] = {}
        with station(mock) as link:
            for message in everything(link, 6.0):
                heard[message.get_type()] = heard.get(message.get_type(), 0) + 1
    unknown = {name: n for name, n in heard.items() if name.startswith(("UNKNOWN", "BAD"))}
    assert "BAD_DATA" not in unknown
    assert sum(unknown.values()) < 0.05 * sum(heard.values()), unknown


# ---------------------------------------------------------------- mavutil


@contextlib.contextmanager
def station(mock: MockProcess) -> Iterator[Any]:
    """mavutil's connection, as a ground station that was heard."""
    link = mavutil.mavlink_connection(
        f"udpin:127.0.0.1:{mock.port}", source_system=250, dialect="development"
    )
    try:
        assert link.wait_heartbeat(timeout=LIMIT_S) is not None
        link.mav.heartbeat_send(6, 8, 0, 0, 0)
        yield link
    finally:
        link.close()


def everything(link: Any, seconds: float) -> Iterator[Any]:
    """All messages of the next seconds; the station's heartbeat goes on."""
    end_s, beat_s = time.monotonic() + seconds, 0.0
    while (now_s := time.monotonic()) < end_s:
        if now_s > beat_s:
            link.mav.heartbeat_send(6, 8, 0, 0, 0)
            beat_s = now_s + 1.0
        message = link.recv_match(blocking=True, timeout=0.2)
        if message is not None:
            yield message


def awaited(link: Any, condition: Callable[[Any], bool], what: str) -> Any:
    """The next message that fulfils `condition`."""
    for message in everything(link, LIMIT_S):
        if condition(message):
            return message
    raise AssertionError(f"no {what} in {LIMIT_S} s")


def acknowledged(link: Any, command: int) -> int:
    """The result of a command."""
    return int(
        awaited(
            link,
            lambda m: m.get_type() == "COMMAND_ACK" and m.command == command,
            f"acknowledgement of {command}",
        ).result
    )


def fetch_parameters(link: Any) -> None:
    """All of them; asked for again when a busy machine lost some."""
    for _ in range(6):
        link.param_fetch_all()
        for _ in everything(link, 10.0):
            if len(set(link.params) - {"_HASH_CHECK"}) == PARAMETERS:
                return
    raise AssertionError(f"{len(link.params)} parameters came")


def test_mavutil_fetches_parameters_switches_modes_arms_flies_and_lands(tmp_path: Path) -> None:
    with MockProcess(tmp_path, "--scenario", "empty", "--speed", "2") as mock:
        with station(mock) as link:
            assert link.target_system == 1
            fetch_parameters(link)
            assert link.params["MPC_XY_VEL_MAX"] == 12.0

            assert "LOITER" in link.mode_mapping()
            link.set_mode("LOITER")
            assert acknowledged(link, mavlink.MAV_CMD_DO_SET_MODE) == 0
            link.arducopter_arm()
            assert acknowledged(link, mavlink.MAV_CMD_COMPONENT_ARM_DISARM) == 0
            awaited(link, lambda _: link.motors_armed(), "armed heartbeat")
            nan = math.nan
            takeoff = mavlink.MAV_CMD_NAV_TAKEOFF
            link.mav.command_long_send(1, 1, takeoff, 0, nan, nan, nan, nan, nan, nan, nan)
            assert acknowledged(link, takeoff) == 0
            awaited(link, lambda _: link.flightmode == "TAKEOFF", "mode TAKEOFF")
            awaited(
                link,
                lambda m: m.get_type() == "LOCAL_POSITION_NED" and m.z < -1.6,
                "height of 1.6 m",
            )
            link.set_mode("LAND")
            assert acknowledged(link, mavlink.MAV_CMD_DO_SET_MODE) == 0
            awaited(link, lambda _: link.flightmode == "LAND", "mode LAND")
            awaited(link, lambda _: not link.motors_armed(), "disarming")
        truth = mock.truth()
    never_harmed(truth)
    assert on_the_ground(truth)


def test_mavutil_uploads_a_mission_the_old_way_in_floats_and_reads_it_back(tmp_path: Path) -> None:
    places = [(47.3977, 8.5456, 2.0), (47.39772, 8.54562, 3.0)]
    with MockProcess(tmp_path, "--scenario", "empty") as mock, station(mock) as link:
        link.waypoint_count_send(len(places))
        for number, place in enumerate(places):
            request = awaited(
                link, lambda m: m.get_type() == "MISSION_REQUEST_INT", f"request of item {number}"
            )
            assert request.seq == number
            link.mav.mission_item_send(1, 1, number, 3, 16, 0, 1, 0, 0, 0, math.nan, *place)
        ended = awaited(link, lambda m: m.get_type() == "MISSION_ACK", "MISSION_ACK")
        assert ended.type == mavlink.MAV_MISSION_ACCEPTED

        link.waypoint_request_list_send()
        count = awaited(link, lambda m: m.get_type() == "MISSION_COUNT", "MISSION_COUNT")
        assert count.count == len(places)
        for number, place in enumerate(places):
            link.waypoint_request_send(number)
            item = awaited(link, lambda m: m.get_type() == "MISSION_ITEM", "MISSION_ITEM")
            assert item.seq == number
            assert (item.x, item.y, item.z) == pytest.approx(place, rel=1e-6)
        link.waypoint_clear_all_send()
        awaited(link, lambda m: m.get_type() == "MISSION_ACK", "MISSION_ACK of the clearing")
        link.waypoint_request_list_send()
        empty = awaited(link, lambda m: m.get_type() == "MISSION_COUNT", "MISSION_COUNT")
        assert empty.count == 0


def test_an_item_that_px4_cannot_fly_refuses_the_mission_and_keeps_the_old_one(
    tmp_path: Path,
) -> None:
    with MockProcess(tmp_path, "--scenario", "empty") as mock, station(mock) as link:
        link.waypoint_count_send(1)
        awaited(link, lambda m: m.get_type() == "MISSION_REQUEST_INT", "request")
        link.mav.mission_item_int_send(1, 1, 0, 3, 31999, 0, 1, 0, 0, 0, 0, 0, 0, 1.0)
        refused = awaited(link, lambda m: m.get_type() == "MISSION_ACK", "MISSION_ACK")
        assert refused.type == mavlink.MAV_MISSION_UNSUPPORTED
        link.set_mode_auto()
        assert acknowledged(link, mavlink.MAV_CMD_MISSION_START) == mavlink.MAV_RESULT_DENIED


# ---------------------------------------------------------------- MAVSDK


class Sdk:
    """MAVSDK's plugins, as a ground station has them."""

    def __init__(self, system: Any) -> None:
        self.action = ActionAsync(system)
        self.ftp = FtpAsync(system)
        self.info = InfoAsync(system)
        self.logs = LogFilesAsync(system)
        self.direct = MavlinkDirectAsync(system)
        self.mission = MissionAsync(system)
        self.param = ParamAsync(system)
        self.telemetry = TelemetryAsync(system)


@contextlib.asynccontextmanager
async def connected(mock: MockProcess) -> AsyncIterator[Sdk]:
    configuration = Configuration.create_with_component_type(ComponentType.GROUND_STATION)
    async with Mavsdk(configuration) as mavsdk:
        await mavsdk.add_any_connection(f"udpin://127.0.0.1:{mock.port}")
        system = await mavsdk.first_autopilot(timeout_s=20.0)
        assert system is not None
        yield Sdk(system)


async def first(stream: Any, condition: Callable[[Any], bool] = lambda _: True) -> Any:
    """The first value of a subscription that fulfils `condition`."""
    async with asyncio.timeout(LIMIT_S), contextlib.aclosing(stream) as values:
        async for value in values:
            if condition(value):
                return value
    raise AssertionError("the subscription ended")


SERVED = (
    "altitude",
    "armed",
    "attitude_angular_velocity_body",
    "attitude_euler",
    "attitude_quaternion",
    "battery",
    "distance_sensor",
    "fixedwing_metrics",
    "flight_mode",
    "gps_info",
    "heading",
    "health",
    "health_all_ok",
    "home",
    "imu",
    "in_air",
    "landed_state",
    "odometry",
    "position",
    "position_velocity_ned",
    "raw_gps",
    "scaled_pressure",
    "unix_epoch_time",
    "velocity_ned",
)
"""MAVSDK's telemetry that PX4 serves on its onboard link without being asked."""


async def test_mavsdk_reads_what_it_is_and_everything_that_px4_streams(tmp_path: Path) -> None:
    with MockProcess(tmp_path, "--scenario", "empty") as mock:
        async with connected(mock) as sdk:
            version = await sdk.info.get_version()
            assert (version.flight_sw_major, version.flight_sw_minor) == (1, 19)
            assert (await sdk.info.get_identification()).legacy_uid == 0x4954414C44494E4F
            assert (await sdk.info.get_product()).vendor_id == 0

            parameters = await sdk.param.get_all_params()
            assert len(parameters.int_params) + len(parameters.float_params) == PARAMETERS
            await sdk.param.set_param_int("COM_OBL_RC_ACT", 4)
            assert await sdk.param.get_param_int("COM_OBL_RC_ACT") == 4

            streams = [getattr(sdk.telemetry, f"subscribe_{name}")() for name in SERVED]
            assert len(await asyncio.gather(*map(first, streams))) == len(SERVED)
            origin = await sdk.telemetry.get_gps_global_origin()
            assert origin.altitude_m == pytest.approx(GROUND_AMSL_M, abs=0.01)

            attitude = await first(sdk.direct.subscribe_message("ATTITUDE"))
            assert '"yaw"' in attitude.fields_json
            telling = asyncio.ensure_future(first(sdk.direct.subscribe_message("PARAM_VALUE")))  # noqa: TID251  awaited below
            await asyncio.sleep(0.2)
            attitude.message_name = "PARAM_REQUEST_READ"
            attitude.target_system_id = attitude.target_component_id = 1
            attitude.system_id, attitude.component_id = 245, 190
            attitude.fields_json = (
                '{"target_system":1,"target_component":1,"param_id":"MPC_XY_P","param_index":-1}'
            )
            await sdk.direct.send_message(attitude)
            assert "MPC_XY_P" in (await telling).fields_json


async def test_what_the_vehicle_lacks_is_refused_at_once(tmp_path: Path) -> None:
    async def refused(what: Awaitable[object], error: type[Exception]) -> None:
        async with asyncio.timeout(3.0):
            with pytest.raises(error):
                await what

    with MockProcess(tmp_path, "--scenario", "empty") as mock:
        async with connected(mock) as sdk:
            assert (await sdk.ftp.list_directory("/")).entries == []
            await refused(sdk.ftp.list_directory("/etc"), FtpError)
            await refused(sdk.ftp.create_directory("/logs"), FtpError)
            await refused(sdk.ftp.remove_file("/etc/init.d"), FtpError)
            await refused(sdk.logs.get_entries(), LogFilesError)
            await refused(sdk.action.reboot(), ActionError)
            await refused(sdk.action.transition_to_fixedwing(), ActionError)


def waypoint(home: Any, north_m: float, east_m: float, **different: Any) -> MissionItem:
    """1.5 m above home, flown through at 1 m/s."""
    north_deg, east_deg = (math.degrees(m / EARTH_RADIUS_M) for m in (north_m, east_m))
    latitude_deg = home.latitude_deg + north_deg
    item = {
        "latitude_deg": latitude_deg,
        "longitude_deg": home.longitude_deg + east_deg / math.cos(math.radians(latitude_deg)),
        "relative_altitude_m": 1.5,
        "speed_m_s": 1.0,
        "is_fly_through": True,
        "acceptance_radius_m": 0.3,
        "camera_action": MissionItem.CameraAction.NONE,
        "vehicle_action": MissionItem.VehicleAction.NONE,
    } | different
    unknown = (
        *("gimbal_pitch_deg", "gimbal_yaw_deg", "loiter_time_s", "camera_photo_interval_s"),
        *("yaw_deg", "camera_photo_distance_m"),
    )
    return MissionItem(**dict.fromkeys(unknown, math.nan), **item)


async def test_mavsdk_uploads_flies_and_downloads_a_mission(tmp_path: Path) -> None:
    with MockProcess(tmp_path, "--scenario", "empty", "--speed", "2") as mock:
        async with connected(mock) as sdk:
            home = await first(sdk.telemetry.subscribe_home())
            landing = MissionItem.VehicleAction.LAND
            plan = [
                waypoint(home, 2.0, 0.0),
                waypoint(home, 2.0, 2.0),
                waypoint(home, 0.0, 1.0, vehicle_action=landing),
            ]
            await sdk.mission.set_return_to_launch_after_mission(False)
            await sdk.mission.upload_mission(MissionPlan(plan))
            back = (await sdk.mission.download_mission()).mission_items
            assert [item.latitude_deg for item in back] == pytest.approx(
                [item.latitude_deg for item in plan], abs=1e-7
            )
            assert [item.relative_altitude_m for item in back] == pytest.approx([1.5] * 3)

            progress = asyncio.ensure_future(  # noqa: TID251  awaited below
                first(sdk.mission.subscribe_mission_progress(), lambda p: p.current == p.total == 3)
            )
            await sdk.action.arm()
            await sdk.mission.start_mission()
            await first(sdk.telemetry.subscribe_flight_mode(), lambda m: m is FlightMode.MISSION)
            await progress
            assert await sdk.mission.is_mission_finished()
            await first(sdk.telemetry.subscribe_armed(), lambda armed: not armed)
            await sdk.mission.clear_mission()
            assert (await sdk.mission.download_mission()).mission_items == []
        truth = mock.truth()
    never_harmed(truth)
    assert on_the_ground(truth)
    for north_m, east_m in ((2.0, 0.0), (2.0, 2.0), (0.0, 1.0)):
        nearest_m = min(math.dist(s["position_ned_m"][:2], (north_m, east_m)) for s in truth)
        assert nearest_m < 0.45, (north_m, east_m)
    assert truth[-1]["position_ned_m"][1] == pytest.approx(1.0, abs=0.4)


async def test_mavsdk_flies_to_a_place_holds_and_returns(tmp_path: Path) -> None:
    with MockProcess(tmp_path, "--scenario", "empty", "--speed", "2") as mock:
        async with connected(mock) as sdk:
            home = await first(sdk.telemetry.subscribe_home())
            await sdk.action.set_takeoff_altitude(1.2)
            assert await sdk.action.get_takeoff_altitude() == pytest.approx(1.2)
            await sdk.action.set_return_to_launch_altitude(2.0)
            assert await sdk.action.get_return_to_launch_altitude() == pytest.approx(2.0)
            await sdk.action.arm()
            await sdk.action.takeoff()
            await first(sdk.telemetry.subscribe_flight_mode(), lambda m: m is FlightMode.TAKEOFF)
            await first(sdk.telemetry.subscribe_flight_mode(), lambda m: m is FlightMode.HOLD)
            there = waypoint(home, 1.5, 0.0)
            amsl_m = home.absolute_altitude_m + 1.4
            await sdk.action.goto_location(
                there.latitude_deg, there.longitude_deg, amsl_m, math.nan
            )
            await first(
                sdk.telemetry.subscribe_position_velocity_ned(),
                lambda value: abs(value.position.north_m - 1.5) < 0.2,
            )
            await sdk.action.hold()
            await sdk.action.return_to_launch()
            await first(sdk.telemetry.subscribe_armed(), lambda armed: not armed)
        truth = mock.truth()
    never_harmed(truth)
    assert on_the_ground(truth)
    assert math.dist(truth[-1]["position_ned_m"][:2], (0.0, 0.0)) < 0.4
    assert [state["mode"] for state in truth if state["armed"]][-1] == "return"
