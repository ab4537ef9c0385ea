"""The service with everything but the vehicle: waiting, flying, frames, ends."""

import asyncio
import functools
import math
from collections.abc import Callable
from pathlib import Path

import msgspec
import pytest

from autonomy.config import Config
from autonomy.errors import BadInput
from autonomy.model import MissionState, OperatorCommand
from autonomy.service.contract import MissionOrder, MissionRecord, MissionStatus, Phase
from autonomy.service.metrics import Metrics
from autonomy.service.station import Refused, Station
from autonomy.service.systemd import Notifier
from autonomy.serving.desk import Desk, shifted
from autonomy.serving.parts import Parts, Prepare
from autonomy.serving.service import Service
from autonomy.simulation import with_scenario
from hal.readings import FlightMode, LandedState
from hal.setpoints import Reply, Request, RequestKind, Setpoint
from hal.sim.px4 import Mode
from hal.sim.scenario import load_scenario
from tests.support.simulated_drivers import Rig

TURNS = 40_000
"""Turns of the event loop after which a test gives up; simulated time does not wait."""

_POINTS_UNDER_WAY = 12
"""Of the flown track, one every 3 cm."""


class Stage:
    """A service around a rig, with words for what tests do to it."""

    def __init__(
        self,
        folder: Path,
        scenario: str = "empty",
        notifier: Notifier | None = None,
        prepare: Prepare | None = None,
    ) -> None:
        world = load_scenario(scenario)
        config = with_scenario(Config(), world)
        self.config = config.model_copy(
            update={
                "log": config.log.model_copy(update={"directory": str(folder)}),
                "service": config.service.model_copy(update={"reconnect_after_s": 0.3}),
            }
        )
        self.rig = Rig(world, self.config)
        desk = Desk(self.config, None)
        self.station = Station(self.config, desk.check)
        desk.station = self.station
        self.metrics = Metrics(self.station)
        notifier = notifier or Notifier({})
        drivers = self.rig.drivers()
        self.parts = Parts(
            self.config,
            desk,
            self.station,
            self.metrics,
            notifier,
            drivers,
            true_clearance_m=lambda: 0.4321,
            prepare=prepare,
        )
        self.service = Service(self.parts)

    async def until_true(self, holds: Callable[[], bool]) -> None:
        for _ in range(TURNS):
            if holds():
                return
            await asyncio.sleep(0.0005)
        pytest.fail(f"it never came to that: {self.station.why}")

    async def until(self, phase: Phase) -> None:
        await self.until_true(lambda: self.station.phase is phase)

    async def fly(self, order: MissionOrder) -> MissionRecord:
        record = self.station.submit(order)
        return await self.ended(record.id)

    async def ended(self, name: str) -> MissionRecord:
        await self.until_true(lambda: self.record(name).over)
        await self.until(Phase.READY)
        return self.record(name)

    def record(self, name: str) -> MissionRecord:
        record = self.station.mission(name)
        assert record is not None
        return record

    def is_under_way(self) -> bool:
        """True for the few ticks in which a flight has come a third of a metre: it cruises."""
        drawn = self.station.drawn
        return drawn is not None and len(drawn.track) == _POINTS_UNDER_WAY

    def truth_ne(self) -> tuple[float, float]:
        position = self.rig.vehicle.truth().position_ned_m
        return position[0], position[1]


def events(stage: Stage) -> str:
    return "\n".join(f"{event.name}: {event.why}" for event in stage.station.events)


async def test_missions_begin_where_the_last_one_ended_and_keep_the_room_s_frame(
    tmp_path: Path,
) -> None:
    stage = Stage(tmp_path)
    async with asyncio.TaskGroup() as group:
        group.create_task(stage.service.run())
        await stage.until(Phase.READY)
        for goal in ([1.0, 0.5], [1.0, -0.5], [0.0, 0.0]):
            record = await stage.fly(MissionOrder(goals=(goal,)))
            assert record.ending == "goal_reached", record.why
            assert math.dist(stage.truth_ne(), goal) < 0.3
            assert record.log is not None
            assert (tmp_path / record.log).exists()
            assert (tmp_path / (record.log + ".report.json")).exists()
            assert record.report is not None
            assert record.report["minimum_clearance_m"] == 0.4321  # what the simulator knows
            assert record.report["clearance_is_true"]
        stage.service.stop()
    text = stage.metrics.text().decode()
    assert 'autonomy_missions_total{ending="goal_reached"} 3.0' in text


async def test_a_service_that_prepares_answers_and_says_how_far_it_is(tmp_path: Path) -> None:
    compiled = asyncio.Event()

    async def prepare(tell: Callable[[str], None]) -> None:
        tell("compiled 3 of 40 kernels")
        await compiled.wait()

    stage = Stage(tmp_path, prepare=prepare)
    async with asyncio.TaskGroup() as group:
        group.create_task(stage.service.run())
        await stage.until(Phase.PREPARING)
        sentence = "the service is not ready yet: compiled 3 of 40 kernels"
        with pytest.raises(Refused, match=sentence):
            stage.station.submit(MissionOrder(goals=([1.0, 0.0],)))
        with pytest.raises(Refused, match=sentence):
            stage.station.command(OperatorCommand.LAND)
        assert stage.rig.vehicle.opened == 0
        compiled.set()
        await stage.until(Phase.READY)
        stage.service.stop()


async def test_a_service_that_is_told_to_end_while_it_prepares_ends(tmp_path: Path) -> None:
    given_up = asyncio.Event()

    async def prepare(_: Callable[[str], None]) -> None:
        try:
            await asyncio.Event().wait()
        finally:
            given_up.set()

    stage = Stage(tmp_path, prepare=prepare)
    async with asyncio.TaskGroup() as group:
        group.create_task(stage.service.run())
        await asyncio.sleep(0.0)
        stage.service.stop()
    assert given_up.is_set()
    assert stage.rig.vehicle.opened == 0
    assert stage.station.phase is Phase.STOPPING


async def test_what_the_sensors_drop_is_counted_for_people_to_see(tmp_path: Path) -> None:
    stage = Stage(tmp_path)
    stage.rig.drops.note("DISTANCE_SENSOR", "unreadable", 3)
    async with asyncio.TaskGroup() as group:
        group.create_task(stage.service.run())
        await stage.until(Phase.READY)
        text = stage.metrics.text().decode()
        stage.service.stop()
    assert 'autonomy_dropped_total{reason="unreadable",source="DISTANCE_SENSOR"} 3.0' in text


async def test_a_goal_is_checked_against_the_fence_where_it_stands_not_where_the_vehicle_is(
    tmp_path: Path,
) -> None:
    stage = Stage(tmp_path)
    north_m = stage.config.guard.fence.bounds()[1]
    async with asyncio.TaskGroup() as group:
        group.create_task(stage.service.run())
        await stage.until(Phase.READY)
        await stage.fly(MissionOrder(goals=([1.0, 0.0],)))
        with pytest.raises(BadInput, match="outside the geofence"):
            stage.station.submit(MissionOrder(goals=([north_m + 0.5, 0.0],)))
        yaw_rad = stage.rig.vehicle.truth().yaw_rad
        ahead_m = north_m - 0.5  # inside the fence from the origin, not from here
        goal = [ahead_m * math.cos(yaw_rad), -ahead_m * math.sin(yaw_rad)]
        with pytest.raises(BadInput, match="outside the geofence"):
            stage.station.submit(MissionOrder(goals=(goal,), frame="body"))
        stage.service.stop()


async def test_a_vehicle_that_is_not_there_is_waited_for(tmp_path: Path) -> None:
    stage = Stage(tmp_path)
    stage.rig.vehicle.away = True
    async with asyncio.TaskGroup() as group:
        group.create_task(stage.service.run())
        await stage.until(Phase.WAITING)
        await stage.until_true(lambda: "nobody answered" in stage.station.why)
        stage.rig.vehicle.away = False
        await stage.until(Phase.READY)
        stage.service.stop()


async def test_a_vehicle_that_falls_silent_is_waited_for_anew(tmp_path: Path) -> None:
    stage = Stage(tmp_path)
    async with asyncio.TaskGroup() as group:
        group.create_task(stage.service.run())
        await stage.until(Phase.READY)
        stage.rig.vehicle.cut_link()
        await stage.until(Phase.WAITING)
        assert stage.station.instant is None
        stage.rig.vehicle.restore_link()
        await stage.until(Phase.READY)
        assert stage.rig.vehicle.opened == 2
        stage.service.stop()


async def test_stop_lands_the_vehicle_and_the_service_is_ready_again(tmp_path: Path) -> None:
    stage = Stage(tmp_path)

    def stop_in_the_air() -> None:
        if stage.is_under_way():
            stage.station.command(OperatorCommand.STOP)

    stage.rig.at_tick = stop_in_the_air
    async with asyncio.TaskGroup() as group:
        group.create_task(stage.service.run())
        await stage.until(Phase.READY)
        record = await stage.fly(MissionOrder(goals=([2.0, 0.0],)))
        assert record.ending == "aborted"
        assert not stage.rig.vehicle.status().armed
        stage.service.stop()


async def test_a_hold_lasts_until_the_mission_is_told_to_go_on(tmp_path: Path) -> None:
    stage = Stage(tmp_path)
    held_ticks = 0

    def hold_and_go_on() -> None:
        nonlocal held_ticks
        instant = stage.station.instant
        if instant is None or instant.command is None:
            return
        state = instant.command.decision.state
        if stage.is_under_way() and held_ticks == 0:
            stage.station.command(OperatorCommand.HOLD)
        if state is MissionState.HOLD:
            held_ticks += 1
            if held_ticks == 400:  # 20 s: much longer than STOP holds
                stage.station.command(OperatorCommand.RESUME)

    stage.rig.at_tick = hold_and_go_on
    async with asyncio.TaskGroup() as group:
        group.create_task(stage.service.run())
        await stage.until(Phase.READY)
        record = await stage.fly(MissionOrder(goals=([1.0, 0.0],)))
        assert record.ending == "goal_reached", record.why
        stage.service.stop()
    assert 400 <= held_ticks <= 410
    assert "hold: held by the operator" in events(stage)


async def test_ending_the_service_in_flight_lands_first(tmp_path: Path) -> None:
    stage = Stage(tmp_path)

    def end_in_the_air() -> None:
        if stage.is_under_way() and not stage.parts.ending.is_set():
            stage.service.stop()

    stage.rig.at_tick = end_in_the_air
    async with asyncio.TaskGroup() as group:
        group.create_task(stage.service.run())
        await stage.until(Phase.READY)
        record = stage.station.submit(MissionOrder(goals=([2.0, 0.0],)))
    ended = stage.record(record.id)
    assert ended.ending == "aborted"
    assert stage.rig.vehicle.status().landed is LandedState.ON_GROUND
    assert stage.station.phase is Phase.STOPPING


async def test_what_the_service_left_in_the_air_it_can_land(tmp_path: Path) -> None:
    stage = Stage(tmp_path)
    async with asyncio.TaskGroup() as group:
        group.create_task(stage.service.run())
        await stage.until(Phase.READY)
        record = await stage.fly(MissionOrder(goals=([1.0, 0.0],), land=False))
        assert record.ending == "goal_reached"
        assert stage.rig.vehicle.status().armed
        with pytest.raises(BadInput, match="land it first"):
            stage.station.submit(MissionOrder(goals=([0.0, 0.0],)))
        stage.rig.vehicle.seconds_a_request = 20.0
        stage.station.command(OperatorCommand.LAND)
        await stage.until_true(lambda: not stage.rig.vehicle.status().armed)
        assert stage.rig.vehicle.status().landed is LandedState.ON_GROUND
        stage.service.stop()


def is_told(stage: Stage, text: str) -> bool:
    return text in events(stage)


def asks(stage: Stage) -> list[RequestKind]:
    """What the vehicle is asked from now on."""
    asked: list[RequestKind] = []
    execute_now = stage.rig.vehicle.execute_now

    def spied(request: Request) -> Reply:
        asked.append(request.kind)
        return execute_now(request)

    stage.rig.vehicle.execute_now = spied  # type: ignore[method-assign]  # a spy
    return asked


async def test_what_the_service_left_in_the_air_is_not_its_own_once_a_pilot_switched(
    tmp_path: Path,
) -> None:
    stage = Stage(tmp_path)
    autopilot = stage.rig.vehicle.autopilot
    async with asyncio.TaskGroup() as group:
        group.create_task(stage.service.run())
        await stage.until(Phase.READY)
        record = await stage.fly(MissionOrder(goals=([1.0, 0.0],), land=False))
        assert record.ending == "goal_reached"
        assert stage.service.attendant.left.custody is not None
        autopilot.take_over(Mode.POSITION)
        await stage.until_true(lambda: stage.service.attendant.left.custody is None)
        autopilot.take_over(Mode.HOLD)
        asked = asks(stage)
        for command in (OperatorCommand.LAND, OperatorCommand.HOLD):
            stage.station.command(command)
            said = f"{command.value}: nothing is flown"
            await stage.until_true(functools.partial(is_told, stage, said))
        stage.service.stop()
    assert asked == []
    assert stage.rig.vehicle.status().armed


class Uplink:
    """The way to the vehicle with a gap, and with the library's habit: the last setpoint is
    repeated at every tick.
    """

    def __init__(self, stage: Stage) -> None:
        self._vehicle, self._clock = stage.rig.vehicle, stage.rig.clock
        self._send, self._execute = self._vehicle.send, self._vehicle.execute_now
        self._last: Setpoint | None = None
        self._gap_s = (math.inf, math.inf)
        self._vehicle.send = self.send  # type: ignore[method-assign]  # a link with a gap
        self._vehicle.execute_now = self.execute  # type: ignore[method-assign]  # the same

    @property
    def cut(self) -> bool:
        return self._gap_s[0] <= self._clock.now_s() < self._gap_s[1]

    def fail_for(self, seconds: float) -> None:
        self._gap_s = (self._clock.now_s(), self._clock.now_s() + seconds)

    def send(self, setpoint: Setpoint) -> None:
        self._last = setpoint

    def execute(self, request: Request) -> Reply:
        if not self.cut:
            return self._execute(request)
        self._vehicle.advance(1.0)
        return Reply(self._clock.now_s(), request.kind, accepted=False, reason="no answer")

    def repeat(self) -> None:
        if self._last is not None and not self.cut:
            self._send(self._last)


async def land_by_order(stage: Stage) -> None:
    """An operator's LAND brings the vehicle down."""
    stage.rig.vehicle.seconds_a_request = 20.0
    stage.station.command(OperatorCommand.LAND)
    await stage.until_true(lambda: not stage.rig.vehicle.status().armed)
    assert stage.rig.vehicle.status().landed is LandedState.ON_GROUND
    assert "nothing is flown" not in events(stage)


def cut_in_flight(stage: Stage) -> Callable[[], None]:
    """Cuts the link once the vehicle cruises."""

    def cut() -> None:
        if stage.is_under_way():
            stage.rig.at_tick = None
            stage.rig.vehicle.cut_link()

    return cut


@pytest.mark.parametrize("ends", [False, True])
async def test_what_was_lost_with_its_link_is_landed_when_it_is_back(
    tmp_path: Path, *, ends: bool
) -> None:
    stage = Stage(tmp_path)
    vehicle = stage.rig.vehicle
    stage.rig.at_tick = cut_in_flight(stage)
    async with asyncio.TaskGroup() as group:
        running = group.create_task(stage.service.run())
        await stage.until(Phase.READY)
        name = stage.station.submit(MissionOrder(goals=([2.0, 0.0],))).id
        await stage.until_true(lambda: stage.record(name).over)
        assert stage.record(name).ending == "link_lost"
        await stage.until(Phase.WAITING)
        vehicle.restore_link()
        await stage.until(Phase.READY)
        await stage.until_true(functools.partial(is_told, stage, "PX4's failsafe holds"))
        assert stage.station.why.startswith("PX4's failsafe holds")
        assert vehicle.status().mode is FlightMode.HOLD
        if ends:
            vehicle.seconds_a_request = 20.0
            stage.service.stop()
            await stage.until_true(running.done)
            assert vehicle.status().landed is LandedState.ON_GROUND
            return
        await land_by_order(stage)
        await stage.until_true(lambda: stage.station.why.endswith("is ready for a mission"))
        stage.service.stop()


@pytest.mark.parametrize("change", ["pilot", "restart"])
async def test_what_a_pilot_took_or_another_autopilot_flies_is_not_what_was_lost(
    tmp_path: Path, change: str
) -> None:
    stage = Stage(tmp_path)
    vehicle = stage.rig.vehicle
    stage.rig.at_tick = cut_in_flight(stage)
    async with asyncio.TaskGroup() as group:
        group.create_task(stage.service.run())
        await stage.until(Phase.READY)
        stage.station.submit(MissionOrder(goals=([2.0, 0.0],)))
        await stage.until(Phase.FLYING)
        await stage.until(Phase.WAITING)
        facts = msgspec.structs.replace(vehicle.facts(), booted_s=5.0)
        if change == "restart":
            vehicle.facts = lambda: facts  # type: ignore[method-assign]  # another boot
        else:
            vehicle.autopilot.take_over(Mode.POSITION)
        asked = asks(stage)
        vehicle.restore_link()
        await stage.until(Phase.READY)
        stage.station.command(OperatorCommand.LAND)
        await stage.until_true(functools.partial(is_told, stage, "land: nothing is flown"))
        stage.service.stop()
    assert asked == []
    assert vehicle.status().armed


async def test_after_a_gap_of_the_setpoints_the_vehicle_stays_in_hold_and_is_landed(
    tmp_path: Path,
) -> None:
    stage = Stage(tmp_path)
    uplink, failed = Uplink(stage), False

    def fail_once() -> None:
        nonlocal failed
        if stage.is_under_way() and not failed:
            failed = True
            uplink.fail_for(1.4)
        uplink.repeat()

    stage.rig.at_tick = fail_once
    async with asyncio.TaskGroup() as group:
        group.create_task(stage.service.run())
        await stage.until(Phase.READY)
        record = await stage.fly(MissionOrder(goals=([2.0, 0.0],)))
        assert record.ending == "taken_over"
        assert "PX4's failsafe" in record.why
        over_s = stage.rig.clock.now_s()
        await stage.until_true(lambda: stage.rig.clock.now_s() > over_s + 3.0)
        assert stage.rig.vehicle.status().mode is FlightMode.HOLD
        await land_by_order(stage)
        stage.service.stop()


async def test_a_vehicle_that_a_pilot_took_in_flight_stays_the_pilot_s(tmp_path: Path) -> None:
    stage = Stage(tmp_path)
    autopilot = stage.rig.vehicle.autopilot

    def take() -> None:
        if stage.is_under_way():
            stage.rig.at_tick = None
            autopilot.take_over(Mode.HOLD)

    stage.rig.at_tick = take
    async with asyncio.TaskGroup() as group:
        group.create_task(stage.service.run())
        await stage.until(Phase.READY)
        record = await stage.fly(MissionOrder(goals=([2.0, 0.0],)))
        assert record.ending == "taken_over"
        await stage.until_true(lambda: stage.station.why.endswith("not flown by this service"))
        asked = asks(stage)
        stage.station.command(OperatorCommand.LAND)
        await stage.until_true(lambda: "land: nothing is flown" in events(stage))
        stage.service.stop()
    assert asked == []
    assert stage.rig.vehicle.status().mode is FlightMode.HOLD
    assert stage.rig.vehicle.status().armed


async def test_a_vehicle_that_somebody_else_flies_is_left_alone(tmp_path: Path) -> None:
    stage = Stage(tmp_path)
    async with asyncio.TaskGroup() as group:
        group.create_task(stage.service.run())
        await stage.until(Phase.READY)
        before = stage.rig.vehicle.status().mode
        stage.station.command(OperatorCommand.LAND)
        await stage.until_true(lambda: "nothing is flown by this service" in events(stage))
        assert stage.rig.vehicle.status().mode is before is FlightMode.HOLD
        stage.service.stop()


async def test_a_jump_of_the_frame_on_the_ground_moves_no_goal(tmp_path: Path) -> None:
    stage = Stage(tmp_path)
    async with asyncio.TaskGroup() as group:
        group.create_task(stage.service.run())
        await stage.until(Phase.READY)
        await stage.fly(MissionOrder(goals=([1.0, 0.0],)))
        stage.rig.vehicle.jump_estimate((0.7, -0.4, 0.1))
        record = await stage.fly(MissionOrder(goals=([0.0, 0.0],)))
        assert record.ending == "goal_reached", record.why
        assert math.hypot(*stage.truth_ne()) < 0.3
        stage.service.stop()


async def test_a_folder_that_takes_no_log_keeps_nobody_down(tmp_path: Path) -> None:
    blocked = tmp_path / "file"
    blocked.write_text("not a folder")
    stage = Stage(blocked)
    async with asyncio.TaskGroup() as group:
        group.create_task(stage.service.run())
        await stage.until(Phase.READY)
        record = await stage.fly(MissionOrder(goals=([1.0, 0.0],)))
        assert record.ending == "goal_reached"
        assert "flying without a log" in events(stage)
        stage.service.stop()


async def test_a_defect_ends_one_flight_not_the_service(tmp_path: Path) -> None:
    stage = Stage(tmp_path)

    def break_down() -> None:
        if stage.is_under_way() and stage.station.phase is Phase.FLYING:
            stage.rig.vehicle.seconds_a_request = 20.0
            stage.rig.at_tick = None
            raise ZeroDivisionError("planted")

    stage.rig.at_tick = break_down
    async with asyncio.TaskGroup() as group:
        group.create_task(stage.service.run())
        await stage.until(Phase.READY)
        record = stage.station.submit(MissionOrder(goals=([2.0, 0.0],)))
        await stage.until_true(lambda: stage.record(record.id).over)
        known = stage.record(record.id)
        assert known.ending == "internal"
        assert known.status is MissionStatus.DONE
        assert "planted" in known.why
        stage.service.stop()


class Heard(Notifier):
    """Keeps when signs of life were given, and how long there were none."""

    def __init__(self) -> None:
        super().__init__({})
        self.newest_s = 0.0
        self.longest_s = 0.0

    def alive(self, now_s: float) -> None:
        self.longest_s = max(self.longest_s, now_s - self.newest_s)
        self.newest_s = now_s


async def test_the_watchdog_is_fed_while_a_vehicle_is_brought_down_after_a_defect(
    tmp_path: Path,
) -> None:
    heard = Heard()
    stage = Stage(tmp_path, notifier=heard)
    vehicle, clock = stage.rig.vehicle, stage.rig.clock
    broken_s = 0.0

    def break_down() -> None:
        nonlocal broken_s
        if stage.is_under_way() and stage.station.phase is Phase.FLYING:
            stage.rig.at_tick = None
            broken_s, heard.longest_s = clock.now_s(), 0.0
            raise ZeroDivisionError("planted")

    stage.rig.at_tick = break_down
    async with asyncio.TaskGroup() as group:
        group.create_task(stage.service.run())
        await stage.until(Phase.READY)
        record = stage.station.submit(MissionOrder(goals=([2.0, 0.0],)))
        await stage.until_true(lambda: broken_s > 0.0)
        while not stage.record(record.id).over:
            await asyncio.sleep(0.02)
            vehicle.advance(0.05)
        assert clock.now_s() - broken_s > 5.0
        assert heard.longest_s < 2.0
        assert vehicle.status().landed is LandedState.ON_GROUND
        stage.service.stop()


def test_shifting_moves_the_fence_against_the_offset() -> None:
    stage_config = Config()
    desk = Desk(stage_config, None)
    mission = desk.mission(MissionOrder(goals=([1.0, 2.0],)), (0.0, 0.0), 0.0)
    fence = shifted(mission, (3.0, -1.0)).config.guard.fence
    for moved, before in zip(
        fence.outline_ne_m, stage_config.guard.fence.outline_ne_m, strict=True
    ):
        assert moved == (before[0] - 3.0, before[1] + 1.0)


def test_a_body_goal_is_ahead_of_the_vehicle_where_it_stands() -> None:
    mission = Desk(Config(), None).mission(
        MissionOrder(goals=([1.0, 0.0],), frame="body"), (2.0, 3.0), math.pi / 2.0
    )
    (goal,) = mission.route_ned_m(0.0)
    assert goal[:2] == pytest.approx((2.0, 4.0))
