"""What the deadman asks PX4 for, and a library that does not take a call; nothing is connected."""

import asyncio
import json
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import pytest
from mavsdk.exceptions import MavsdkError
from mavsdk.plugins.action import ActionResult

from hal.clock import SimClock
from hal.config import BeamsConfig, VehicleConfig
from hal.interfaces import WireMessage
from hal.setpoints import Request, RequestKind
from hal.vehicle.mavsdk_vehicle import MavsdkVehicle

OFFBOARD = {"autopilot": 12, "base_mode": 128, "custom_mode": 6 << 16, "system_status": 4}


class Rig:
    """A vehicle in Offboard behind an action plugin that answers as it is told to."""

    def __init__(self, *answers: ActionResult, broken: bool = False) -> None:
        self.asked: list[str] = []
        self.clock = SimClock(10.0)
        self.vehicle = MavsdkVehicle(VehicleConfig(), self.clock, BeamsConfig())
        self._answers = list(answers)
        self._broken = broken
        action = SimpleNamespace(hold_async=self._plugin("hold"), land_async=self._plugin("land"))
        self.vehicle._link = SimpleNamespace(action=action)  # type: ignore[assignment]  # a link without a wire
        self.hear("HEARTBEAT", OFFBOARD)

    def _plugin(self, name: str) -> Callable[[Callable[..., None]], None]:
        def ask(answered: Callable[..., None]) -> None:
            if self._broken:
                raise MavsdkError("the plugin is gone")
            self.asked.append(name)
            answered(self._answers.pop(0) if self._answers else ActionResult.SUCCESS, None)

        return ask

    def hear(self, name: str, fields: dict[str, Any]) -> None:
        message = WireMessage(self.clock.now_s(), 0, 1, json.dumps(fields))
        self.vehicle._telemetry.takers[name](message)

    def with_gnss(self) -> "Rig":
        self.hear("GLOBAL_POSITION_INT", {"lat": 1, "lon": 2})
        return self


def test_a_vehicle_that_knows_where_on_earth_it_is_is_held() -> None:
    rig = Rig().with_gnss()
    assert rig.vehicle.hold_now()
    assert rig.asked == ["hold"]


def test_one_without_a_global_position_is_landed_at_once() -> None:
    rig = Rig()
    assert rig.vehicle.hold_now()
    assert rig.asked == ["land"]


@pytest.mark.parametrize("refusal", [ActionResult.COMMAND_DENIED, ActionResult.FAILED])
def test_one_that_refuses_to_hold_is_landed_the_next_time(refusal: ActionResult) -> None:
    rig = Rig(refusal).with_gnss()
    assert rig.vehicle.hold_now()
    assert rig.vehicle.hold_now()
    assert rig.asked == ["hold", "land"]


def test_one_that_did_not_answer_is_asked_to_hold_again() -> None:
    rig = Rig(ActionResult.TIMEOUT).with_gnss()
    assert rig.vehicle.hold_now()
    assert rig.vehicle.hold_now()
    assert rig.asked == ["hold", "hold"]


def test_a_call_that_the_library_does_not_take_is_told_and_nothing_waits_for_its_answer() -> None:
    rig = Rig(broken=True)
    assert not rig.vehicle.hold_now()
    reply = asyncio.run(rig.vehicle.execute(Request(RequestKind.LAND)))
    assert not reply.accepted
    assert "the plugin is gone" in reply.reason
    assert not rig.vehicle._unanswered
