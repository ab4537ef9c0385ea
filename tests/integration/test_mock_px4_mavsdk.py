"""Real MAVSDK flies the mock PX4."""

import asyncio
import contextlib
from collections.abc import AsyncIterator, Callable
from pathlib import Path
from typing import Any

import pytest
from mavsdk.asyncio import ComponentType, Configuration, Mavsdk
from mavsdk.asyncio.plugins.action import ActionAsync
from mavsdk.asyncio.plugins.offboard import OffboardAsync
from mavsdk.asyncio.plugins.param import ParamAsync
from mavsdk.asyncio.plugins.telemetry import TelemetryAsync
from mavsdk.plugins.action import ActionError
from mavsdk.plugins.offboard import OffboardError, PositionNedYaw, VelocityNedYaw

from tests.support.mock_px4 import MockProcess

pytestmark = pytest.mark.integration


class Pilot:
    """MAVSDK's plugins, and what was heard of the vehicle."""

    def __init__(self, system: Any) -> None:
        self.action = ActionAsync(system)
        self.offboard = OffboardAsync(system)
        self.param = ParamAsync(system)
        self.telemetry = TelemetryAsync(system)

    async def first(self, stream: Any, condition: Callable[[Any], bool] = lambda _: True) -> Any:
        """The first value of a subscription that fulfils `condition`."""
        async with asyncio.timeout(40.0), contextlib.aclosing(stream) as values:
            async for value in values:
                if condition(value):
                    return value
        raise AssertionError("the subscription ended")

    async def position(self) -> Any:
        """(north, east, down)."""
        value = await self.first(self.telemetry.subscribe_position_velocity_ned())
        return (value.position.north_m, value.position.east_m, value.position.down_m)

    async def take_off(self, altitude_m: float) -> None:
        await self.action.set_takeoff_altitude(altitude_m)
        await self.action.arm()
        await self.action.takeoff()
        await self.first(
            self.telemetry.subscribe_position_velocity_ned(),
            lambda value: value.position.down_m < -0.8 * altitude_m,
        )


@contextlib.asynccontextmanager
async def connected(process: MockProcess) -> AsyncIterator[Pilot]:
    configuration = Configuration.create_with_component_type(ComponentType.GROUND_STATION)
    async with Mavsdk(configuration) as mavsdk:
        await mavsdk.add_any_connection(f"udpin://127.0.0.1:{process.port}")
        system = await mavsdk.first_autopilot(timeout_s=20.0)
        assert system is not None
        yield Pilot(system)


async def test_a_whole_flight_with_velocity_and_position_setpoints(tmp_path: Path) -> None:
    with MockProcess(tmp_path, "--scenario", "empty", "--speed", "2") as process:
        async with connected(process) as pilot:
            assert await pilot.param.get_param_int("COM_OBL_RC_ACT") == 5
            assert await pilot.param.get_param_float("MPC_XY_P") == pytest.approx(0.95)
            await pilot.param.set_param_float("MPC_XY_VEL_MAX", 2.0)
            assert await pilot.param.get_param_float("MPC_XY_VEL_MAX") == pytest.approx(2.0)
            health = await pilot.first(
                pilot.telemetry.subscribe_health(), lambda value: value.is_armable
            )
            assert health.is_local_position_ok
            await pilot.take_off(1.2)

            with pytest.raises(ActionError):
                await pilot.action.disarm()
            await pilot.offboard.set_velocity_ned(VelocityNedYaw(0.3, 0.0, 0.0, 0.0))
            await pilot.offboard.start()
            await pilot.first(
                pilot.telemetry.subscribe_position_velocity_ned(),
                lambda value: value.position.north_m > 0.5,
            )
            await pilot.offboard.set_position_velocity_ned(
                PositionNedYaw(0.5, 0.6, -1.2, 40.0), VelocityNedYaw(0.0, 0.0, 0.0, 40.0)
            )
            await pilot.first(
                pilot.telemetry.subscribe_position_velocity_ned(),
                lambda value: value.position.east_m > 0.5,
            )
            await pilot.offboard.stop()
            await pilot.action.land()
            await pilot.first(pilot.telemetry.subscribe_armed(), lambda armed: not armed)
        records = process.truth()
    assert max(-r["position_ned_m"][2] for r in records) == pytest.approx(1.2, abs=0.15)
    assert records[-1]["position_ned_m"][1] > 0.4
    modes = list(dict.fromkeys(r["mode"] for r in records))
    assert modes == ["hold", "takeoff", "offboard", "land"]


async def test_offboard_without_setpoints_is_refused_by_the_vehicle(tmp_path: Path) -> None:
    with MockProcess(tmp_path, "--scenario", "empty", "--speed", "2") as process:
        async with connected(process) as pilot:
            await pilot.take_off(1.0)
            with pytest.raises(OffboardError):
                await pilot.offboard.start()


@pytest.mark.parametrize(("action", "mode"), [(5, "hold"), (4, "land"), (0, "return")])
async def test_a_client_that_dies_leaves_the_vehicle_to_its_failsafe(
    tmp_path: Path, action: int, mode: str
) -> None:
    with MockProcess(tmp_path, "--scenario", "empty", "--speed", "2") as process:
        async with connected(process) as pilot:
            await pilot.param.set_param_int("COM_OBL_RC_ACT", action)
            await pilot.take_off(1.0)
            await pilot.offboard.set_velocity_ned(VelocityNedYaw(0.2, 0.0, 0.0, 0.0))
            await pilot.offboard.start()
            await asyncio.sleep(1.0)
            assert process.truth()[-1]["mode"] == "offboard"
            gone_s = process.truth()[-1]["t"]
        # The connection is closed: nothing is sent any more.
        await asyncio.to_thread(process.wait_for_truth, lambda record: record["mode"] != "offboard")
        records = process.truth()
    after_s = next(r["t"] for r in records if r["t"] > gone_s and r["mode"] != "offboard")
    assert next(r["mode"] for r in records if r["t"] == after_s) == mode
    assert 0.9 < after_s - gone_s < 4.0  # closing the client takes a while
