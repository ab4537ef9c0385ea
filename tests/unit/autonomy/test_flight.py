"""The shell of a flight on simulated time: how it ends, and whose the vehicle is then."""

import asyncio
import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import msgspec
import pytest

from autonomy.config import Config
from autonomy.custody import Custody
from autonomy.errors import Stalled
from autonomy.flight import Flight, bring_down
from autonomy.mission.guarded import Command
from autonomy.model import Ending, Inputs
from autonomy.simulation import goal_of, with_scenario
from hal.readings import FlightMode, LandedState, StatusText, VehicleStatus
from hal.setpoints import Reply, Request, RequestKind, Setpoint
from hal.sim.mission import LOITER_UNLIMITED, MissionItem
from hal.sim.px4 import Mode, Result
from hal.sim.scenario import load_scenario
from hal.sim.vehicle import Truth
from hal.vehicle.deadman import Deadman, Watch
from tests.support.simulated_drivers import DrivenBeams, Rig

MOVING_M_S = 0.1
STAY = MissionItem(3, LOITER_UNLIMITED, (0.0, 0.0, 0.0, math.nan), math.nan, math.nan, 1.0)


class Planted(Exception):
    """The defect under test."""


class Notes:
    """An observer that keeps its lines."""

    def __init__(self) -> None:
        self.lines: list[str] = []

    def tick(self, command: Command) -> None:
        """Not kept."""

    def note(self, text: str) -> None:
        self.lines.append(text)


class Stage:
    """One flight, everything that was asked of its vehicle, and a hook once a tick."""

    def __init__(self) -> None:
        world = load_scenario("empty")
        self.config = with_scenario(Config(), world)
        self.rig = Rig(world, self.config)
        self.vehicle = self.rig.vehicle
        self.vehicle.seconds_a_request = 3.0
        self.asked: list[RequestKind] = []
        self.sent: list[Setpoint] = []
        self.stopped_s: list[float] = []
        self.notes = Notes()
        self._spy()
        self.deadman = Deadman(
            self.config.deadman, self.vehicle.stop_now, self.vehicle.hold_now, self.rig.clock
        )
        self.flight = Flight(
            self.config,
            (goal_of(world, self.config),),
            vehicle=self.vehicle,
            facts=self.vehicle.facts(),
            sensors=(DrivenBeams(self.rig),),
            gnss=None,
            deadman=self.deadman,
            clock=self.rig.clock,
            recorder=self,
            observer=self.notes,
        )

    def _spy(self) -> None:
        execute_now, send = self.vehicle.execute_now, self.vehicle.send
        stop_now = self.vehicle.stop_now

        def spied_execute(request: Request) -> Reply:
            self.asked.append(request.kind)
            return execute_now(request)

        def spied_send(setpoint: Setpoint) -> None:
            self.sent.append(setpoint)
            send(setpoint)

        def spied_stop() -> None:
            self.stopped_s.append(self.rig.clock.now_s())
            stop_now()

        self.vehicle.execute_now = spied_execute  # type: ignore[method-assign]  # a spy
        self.vehicle.send = spied_send  # type: ignore[method-assign]  # a spy
        self.vehicle.stop_now = spied_stop  # type: ignore[method-assign]  # a spy

    def tick(self, inputs: Inputs, command: Command, step_s: float) -> None:
        """A tick of the flight, for its log."""

    def text(self, text: StatusText) -> None:
        """A text, for its log."""

    @property
    def truth(self) -> Truth:
        return self.vehicle.truth()

    def switch(self, mode: Mode) -> None:
        """A pilot's switch."""
        self.vehicle.autopilot.take_over(mode)
        self.vehicle.advance(0.05)

    def when_cruising(self, act: Callable[[], object]) -> None:
        """Call `act` once, in Offboard and moving."""

        def watch() -> None:
            north, east, _ = self.truth.velocity_ned_m_s
            moving = (north**2 + east**2) ** 0.5 > MOVING_M_S
            if moving and self.vehicle.status().mode is FlightMode.OFFBOARD:
                self.rig.at_tick = None
                self.asked.clear()
                act()

        self.rig.at_tick = watch

    def stall(self, seconds: float, before_each: Callable[[float], None]) -> None:
        """The loop stands still; only the deadman, in steps, and the vehicle go on."""
        state, began_s = Watch.FED, self.rig.clock.now_s()
        while (late_s := self.rig.clock.now_s() - began_s) < seconds:
            before_each(late_s)
            self.vehicle.advance(0.05)
            state = self.deadman.step(state)

    def run(self) -> Ending:
        return asyncio.run(self.flight.run()).ending


@pytest.fixture
def stage(monkeypatch: pytest.MonkeyPatch) -> Iterator[Stage]:
    built = Stage()
    with _simulated_waiting(built, monkeypatch):
        yield built


@contextmanager
def _simulated_waiting(stage: Stage, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Bringing down waits on the vehicle's time."""
    sleep = asyncio.sleep

    async def wait(seconds: float) -> None:
        if seconds >= 1.0:
            stage.vehicle.advance(seconds)
        await sleep(0.0)

    monkeypatch.setattr("autonomy.flight.asyncio.sleep", wait)
    yield


def landed(stage: Stage) -> bool:
    status = stage.vehicle.status()
    return status.landed is LandedState.ON_GROUND and not status.armed


def raise_planted() -> None:
    raise Planted


def test_a_defect_in_flight_stops_first_then_holds_and_lands(stage: Stage) -> None:
    stage.when_cruising(raise_planted)
    with pytest.raises(ExceptionGroup):
        stage.run()
    assert stage.asked == [RequestKind.HOLD, RequestKind.LAND]
    assert stage.stopped_s
    assert landed(stage)


def test_without_the_task_that_carries_requests_it_cannot_land_so_it_is_landed(
    stage: Stage,
) -> None:
    def end_it() -> None:
        for task in asyncio.all_tasks():
            if "_serve_requests" in repr(task.get_coro()):
                task.cancel()

    stage.when_cruising(end_it)
    with pytest.raises(ExceptionGroup) as caught:
        stage.run()
    assert "the task that carries requests to the autopilot has ended" in str(
        caught.value.exceptions[0]
    )
    assert stage.asked == [RequestKind.HOLD, RequestKind.LAND]
    assert landed(stage)


def test_until_hold_is_granted_the_vehicle_stays_stopped_and_the_deadman_watches(
    stage: Stage,
) -> None:
    states: list[Watch] = []
    execute_now = stage.vehicle.execute_now

    def slow(request: Request) -> Reply:
        if request.kind is RequestKind.HOLD and not states:
            for _ in range(20):
                stage.vehicle.advance(0.05)
                states.append(stage.deadman.step(states[-1] if states else Watch.FED))
            assert stage.vehicle.status().mode is FlightMode.OFFBOARD
            assert max(abs(v) for v in stage.truth.velocity_ned_m_s) < 0.05
        return execute_now(request)

    stage.vehicle.execute_now = slow  # type: ignore[method-assign]  # a slow answer
    stage.when_cruising(raise_planted)
    with pytest.raises(ExceptionGroup):
        stage.run()
    assert Watch.SILENT in states
    assert Watch.RELEASED not in states
    assert stage.deadman.step(Watch.RELEASED) is Watch.RELEASED
    assert landed(stage)


def test_a_stalled_loop_whose_vehicle_was_held_lands_it(stage: Stage) -> None:
    stage.when_cruising(lambda: stage.stall(4.0, lambda _: None))
    with pytest.raises(ExceptionGroup) as caught:
        stage.run()
    assert caught.group_contains(Stalled)
    assert RequestKind.LAND in stage.asked
    assert landed(stage)


@pytest.mark.parametrize("at_s", [0.1, 2.5], ids=["before the hand-over", "after it"])
@pytest.mark.parametrize("mode", [Mode.POSITION, Mode.MISSION, Mode.RETURN, Mode.LAND])
def test_a_pilot_who_switches_during_a_stall_keeps_the_vehicle(
    stage: Stage, mode: Mode, at_s: float
) -> None:
    switched: list[float] = []
    stage.vehicle.autopilot.mission.replace([STAY])  # without a mission PX4 goes on to Hold

    def pilot(late_s: float) -> None:
        if late_s >= at_s and not switched:
            switched.append(late_s)
            stage.switch(mode)
            stage.asked.clear()

    stage.when_cruising(lambda: stage.stall(4.0, pilot))
    try:
        assert stage.run() is Ending.TAKEN_OVER
    except ExceptionGroup as group:
        assert group.subgroup(Stalled) is not None  # noqa: PT017 - either end is right
    assert switched
    assert stage.asked == []
    # A landing may be the deadman's: it is watched to its end, and nothing is asked for.
    watched = mode is Mode.LAND and landed(stage)
    assert watched or stage.vehicle.status().mode is mode.flight_mode


def test_a_pilot_who_takes_hold_during_a_stall_keeps_it(stage: Stage) -> None:
    stage.when_cruising(
        lambda: stage.stall(4.0, lambda late_s: stage.switch(Mode.HOLD) if late_s < 0.1 else None)
    )
    assert stage.run() is Ending.TAKEN_OVER
    assert stage.asked == []
    assert stage.vehicle.status().armed


def test_a_defect_before_the_take_off_leaves_whoever_flies_by_hand_alone(stage: Stage) -> None:
    for kind in (RequestKind.ARM, RequestKind.TAKEOFF):
        stage.vehicle.execute_now(Request(kind, 1.0))
    stage.vehicle.advance(8.0)
    stage.switch(Mode.POSITION)
    stage.asked.clear()
    stage.rig.at_tick = raise_planted
    with pytest.raises(ExceptionGroup):
        stage.run()
    assert stage.asked == []
    assert stage.vehicle.status().mode is FlightMode.MANUAL


def test_a_taken_vehicle_has_no_moving_setpoint_left_behind(stage: Stage) -> None:
    stage.when_cruising(lambda: stage.switch(Mode.POSITION))
    assert stage.run() is Ending.TAKEN_OVER
    assert len(stage.stopped_s) == 1
    assert stage.sent[-1].velocity_ned_m_s == (0.0, 0.0, 0.0)
    assert not any(stage.flight.custody.holds(mode) for mode in FlightMode)


def test_what_a_failsafe_takes_stays_in_hold_though_its_flag_comes_later_than_its_mode(
    stage: Stage, monkeypatch: pytest.MonkeyPatch
) -> None:
    told_now, looks = stage.vehicle.status, 0

    def told_late() -> VehicleStatus:
        nonlocal looks
        status = told_now()
        looks += status.in_failsafe
        return msgspec.structs.replace(status, in_failsafe=status.in_failsafe and looks > 8)

    monkeypatch.setattr(stage.vehicle, "status", told_late)
    stage.when_cruising(lambda: stage.vehicle.autopilot.fail_safe(Mode.HOLD))
    assert stage.run() is Ending.TAKEN_OVER
    assert stage.asked == [RequestKind.HOLD]
    assert stage.flight.lost
    assert stage.flight.custody.holds(FlightMode.HOLD)
    assert stage.vehicle.autopilot.intended_mode is Mode.HOLD


def test_a_hold_that_a_pilot_chose_is_the_pilot_s(stage: Stage) -> None:
    stage.when_cruising(lambda: stage.switch(Mode.HOLD))
    assert stage.run() is Ending.TAKEN_OVER
    assert stage.asked == []
    assert not stage.flight.lost
    assert not stage.flight.custody.holds(FlightMode.HOLD)


def test_a_vehicle_killed_in_flight_is_let_go_of_and_left_in_hold_for_who_arms_it_next(
    stage: Stage,
) -> None:
    stage.when_cruising(lambda: stage.vehicle.autopilot.disarm(force=True))
    assert stage.run() is Ending.TAKEN_OVER
    assert stage.asked == [RequestKind.HOLD]
    assert stage.vehicle.status().mode is FlightMode.HOLD
    stage.vehicle.advance(5.0)
    assert stage.vehicle.autopilot.arm() is Result.ACCEPTED
    stage.vehicle.advance(5.0)
    assert landed_height_m(stage) < 0.05


def landed_height_m(stage: Stage) -> float:
    return -stage.truth.position_ned_m[2]


def test_a_decision_that_took_too_long_is_neither_sent_nor_fed(stage: Stage) -> None:
    step = stage.flight._guarded.step
    late: list[int] = []
    before: list[int] = []

    def slow(inputs: Inputs) -> Command:
        command = step(inputs)
        north, east, _ = stage.truth.velocity_ned_m_s
        flying = command.wire_setpoint is not None and abs(north) + abs(east) > MOVING_M_S
        if flying and len(late) < 2:
            before.append(len(stage.sent))
            late.append(stage.flight.tally.late_ticks)
            stage.vehicle.advance(0.21)
        elif len(before) == 2:
            before.append(len(stage.sent))
        return command

    stage.flight._guarded.step = slow  # type: ignore[method-assign]  # a slow core
    assert stage.run() is Ending.GOAL_REACHED
    assert before[0] == before[1] == before[2]
    assert late[1] == late[0] + 1
    assert len([line for line in stage.notes.lines if "overloaded" in line]) == 1


def test_a_second_cancellation_changes_nothing_about_bringing_it_down(stage: Stage) -> None:
    released: list[bool] = []
    execute_now = stage.vehicle.execute_now

    async def fly() -> None:
        flying = asyncio.current_task()
        assert flying is not None

        def again(request: Request) -> Reply:
            if request.kind in (RequestKind.HOLD, RequestKind.LAND):
                flying.cancel()
            return execute_now(request)

        stage.vehicle.execute_now = again  # type: ignore[method-assign]  # an impatient person
        stage.when_cruising(flying.cancel)
        try:
            await stage.flight.run()
        finally:
            assert landed(stage)
            released.append(stage.deadman.step(Watch.RELEASED) is Watch.RELEASED)

    with pytest.raises(asyncio.CancelledError):
        asyncio.run(fly())
    assert released == [True]


class OnGround:
    """A disarmed vehicle without GNSS in the selected Takeoff; ARM takes effect after a while."""

    def __init__(self, arms_after: int) -> None:
        self.mode = FlightMode.TAKEOFF
        self.armed = self.flying = False
        self.looks = 0
        self.asked: list[RequestKind] = []
        self._arms_after = arms_after

    def status(self) -> VehicleStatus:
        self.looks += 1
        if self.looks == self._arms_after:
            self.armed, self.flying = True, self.mode is FlightMode.TAKEOFF
        landed_state = LandedState.TAKEOFF if self.flying else LandedState.ON_GROUND
        return VehicleStatus(0.0, self.armed, self.mode, landed_state, 0.0)

    async def execute(self, request: Request) -> Reply:
        self.asked.append(request.kind)
        if request.kind is RequestKind.HOLD:
            self.mode = FlightMode.HOLD
        if request.kind is RequestKind.LAND:
            self.mode, self.armed = FlightMode.LAND, False
        return Reply(0.0, request.kind, True)


@pytest.mark.parametrize("arms_after", [0, 4])
def test_a_vehicle_that_was_to_take_off_is_left_in_hold_and_an_arming_under_way_is_waited_for(
    stage: Stage, arms_after: int
) -> None:
    vehicle, custody = OnGround(arms_after), Custody()
    custody.asked(RequestKind.TAKEOFF)
    asyncio.run(bring_down(vehicle, stage.config, custody, arming_s=4.0))  # type: ignore[arg-type]  # what it needs of one
    assert vehicle.asked[0] is RequestKind.HOLD
    assert not vehicle.flying
    assert not vehicle.armed
    assert vehicle.mode is (FlightMode.LAND if arms_after else FlightMode.HOLD)
    assert vehicle.looks >= (4 if arms_after else 5)
