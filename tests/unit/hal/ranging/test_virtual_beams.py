"""Beams into a room that is not there: where it is, what is told, how near the vehicle came."""

import asyncio
import math
from collections.abc import AsyncIterator, Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from hal import registry
from hal.clock import MonotonicClock, SimClock
from hal.config import BeamsConfig
from hal.errors import DocumentError, ReadingRefused, SensorSilent
from hal.frames import Vector3, add, scale
from hal.ranging.virtual_beams import NearMiss, TakeOffFrame, VirtualBeams
from hal.readings import (
    Attitude,
    FlightMode,
    LandedState,
    LocalPosition,
    RangeReading,
    RangeStatus,
    VehicleStatus,
)
from hal.setpoints import Request, RequestKind
from hal.sim.autopilot import Autopilot
from hal.sim.scenario import Scenario, load_scenario
from hal.sim.vehicle import SimVehicle
from hal.sim.virtual_room import VirtualRoom
from tests.support.link import SpokenLink
from tests.support.lockstep import LockstepTime
from tests.support.simulated_drivers import DrivenVehicle

VIRTUAL = {"driver": "virtual", "scenario": "default"}
EXACT = {"sigma_m": 0.0, "sigma_fraction": 0.0, "quantum_m": 0.0, "dropout_probability": 0.0}
TICK_S = 0.05


def standing() -> Autopilot:
    """An autopilot in an empty world."""
    return Autopilot(load_scenario("empty"), np.random.default_rng(1))


def pillar(north_m: float, east_m: float = 0.0, **more: object) -> Scenario:
    """One pillar of 0.1 m radius, and beams without noise."""
    return Scenario.model_validate(
        {
            "name": "pillar",
            "obstacles": [{"kind": "disc", "centre_ne_m": (north_m, east_m), "radius_m": 0.1}],
            "beams": EXACT,
            "goal_ne_m": (-3.0, 0.0),
        }
        | more
    )


class Bench:
    """A simulated vehicle in an empty world, and virtual beams around it."""

    def __init__(self, scenario: Scenario) -> None:
        self.clock = SimClock(100.0)
        self.vehicle = SimVehicle(standing(), self.clock)
        self.time = LockstepTime()
        self.beams = VirtualBeams(
            VirtualRoom(scenario, BeamsConfig(), 1),
            self.vehicle,
            self.clock,
            new_waiter=self.time.new_waiter,
        )
        self.readings: list[RangeReading] = []

    def fly(self, seconds: float) -> None:
        for _ in range(round(seconds / TICK_S)):
            self.vehicle.advance(TICK_S)
            self.time.advance(TICK_S)
            self.readings += self.beams.take()

    async def opened(self) -> None:
        opening = asyncio.get_running_loop().create_task(self.beams.open(5.0))
        while not opening.done():
            self.fly(TICK_S)
            await asyncio.sleep(0.001)
        await opening

    def newest(self, beam: str) -> RangeReading:
        return [reading for reading in self.readings if reading.beam == beam][-1]

    def ask(self, kind: RequestKind, altitude_m: float = 1.0) -> None:
        reply = self.vehicle.execute_now(Request(kind, altitude_m))
        assert reply.accepted, reply.reason

    def take_off(self) -> None:
        self.ask(RequestKind.ARM)
        self.ask(RequestKind.TAKEOFF)
        self.fly(10.0)
        assert self.vehicle.truth().position_ned_m[2] < -0.8


@pytest.fixture
async def bench() -> AsyncIterator[Callable[[Scenario], Bench]]:
    """Makes benches, and closes their beams."""
    made: list[Bench] = []

    def make(scenario: Scenario) -> Bench:
        made.append(Bench(scenario))
        made[-1].vehicle.advance(6.0)
        return made[-1]

    yield make
    for each in made:
        await each.beams.close()


# ---------------------------------------------------------------- where the room is


def at(
    stamp_s: float, position: Vector3, counter: int = 0, v: Vector3 = (0, 0, 0)
) -> LocalPosition:
    return LocalPosition(stamp_s, position, v, counter)


places = st.tuples(*(st.floats(-50.0, 50.0) for _ in range(3)))


@given(waits=st.lists(places, min_size=1, max_size=5), flown=places)
@settings(deadline=None, max_examples=50)
def test_the_room_s_origin_is_where_the_vehicle_was_armed(
    waits: list[Vector3], flown: Vector3
) -> None:
    frame = TakeOffFrame()
    for number, place in enumerate(waits):
        assert frame.place(at(number, place), waiting=True) == (0.0, 0.0, 0.0)
    assert frame.place(at(10.0, waits[-1]), waiting=False) == (0.0, 0.0, 0.0)
    placed = frame.place(at(11.0, add(waits[-1], flown)), waiting=False)
    assert placed == pytest.approx(flown, abs=1e-9)


@given(jump=places, velocity=st.tuples(*(st.floats(-1.0, 1.0) for _ in range(3))))
@settings(deadline=None, max_examples=50)
def test_a_jump_of_the_autopilot_s_frame_moves_nothing_around_the_vehicle(
    jump: Vector3, velocity: Vector3
) -> None:
    frame = TakeOffFrame()
    frame.place(at(0.0, (1.0, 2.0, 0.0)), waiting=True)
    frame.place(at(1.0, (1.0, 2.0, 0.0)), waiting=False)
    before = frame.place(at(2.0, (2.0, 2.0, -1.0), 0, velocity), waiting=False)
    jumped = add(add((2.0, 2.0, -1.0), scale(velocity, 0.1)), jump)
    after = frame.place(at(2.1, jumped, 1, velocity), waiting=False)
    assert after == pytest.approx(add(before, scale(velocity, 0.1)), abs=1e-9)


def test_landing_elsewhere_and_arming_again_does_not_move_the_room() -> None:
    frame = TakeOffFrame()
    frame.place(at(0.0, (1.0, 0.0, 0.0)), waiting=True)
    frame.place(at(1.0, (1.0, 0.0, 0.0)), waiting=False)
    frame.place(at(9.0, (4.0, 3.0, 0.0)), waiting=False)
    assert frame.place(at(10.0, (4.0, 3.0, 0.0)), waiting=True) == (3.0, 3.0, 0.0)
    assert frame.place(at(11.0, (4.0, 3.0, 0.0)), waiting=False) == (3.0, 3.0, 0.0)


def test_a_vehicle_that_is_armed_when_it_is_first_heard_stands_in_the_origin() -> None:
    frame = TakeOffFrame()
    assert frame.place(at(0.0, (7.0, 1.0, 0.0)), waiting=False) == (0.0, 0.0, 0.0)
    assert frame.place(at(1.0, (8.0, 1.0, 0.0)), waiting=False) == (1.0, 0.0, 0.0)


# ---------------------------------------------------------------- what is told


async def test_beams_look_from_the_reported_pose_into_the_room(
    bench: Callable[[Scenario], Bench],
) -> None:
    here = bench(pillar(0.6))
    await here.opened()
    here.fly(0.5)
    front = here.newest("front")
    assert front.status is RangeStatus.VALID
    assert front.range_m == pytest.approx(0.5, abs=0.01)
    assert here.newest("back").status is RangeStatus.OUT_OF_RANGE
    assert here.newest("down").status is RangeStatus.TOO_NEAR  # it stands on the floor
    here.vehicle.jump_estimate((5.0, -3.0, 1.0))
    here.fly(0.5)
    assert here.newest("front").range_m == pytest.approx(0.5, abs=0.01)


async def test_the_stamp_is_that_of_the_pose_and_no_pose_gives_no_readings(
    bench: Callable[[Scenario], Bench],
) -> None:
    here = bench(pillar(0.6))
    await here.opened()
    here.fly(1.0)
    position = here.vehicle.local_position()
    assert position is not None
    assert here.newest("up").stamp_s == pytest.approx(position.stamp_s, abs=1e-9)
    here.vehicle.cut_link()
    here.fly(0.3)
    heard = len(here.readings)
    here.fly(1.0)
    assert len(here.readings) == heard


async def test_a_limit_of_the_sensor_is_not_told_as_a_distance(
    bench: Callable[[Scenario], Bench],
) -> None:
    rough = pillar(1.1).model_dump()
    rough["beams"]["quantum_m"] = 0.01
    here = bench(Scenario.model_validate(rough))
    await here.opened()
    here.fly(0.5)
    assert here.newest("front").status is RangeStatus.OUT_OF_RANGE


async def test_the_scenario_s_beam_faults_come_when_they_are_due(
    bench: Callable[[Scenario], Bench],
) -> None:
    fault = {"kind": "beam_dropout", "beam": "front", "start_s": 2.0}
    here = bench(pillar(0.6, faults=[fault]))
    await here.opened()
    here.fly(1.0)
    assert here.newest("front").status is RangeStatus.VALID
    here.fly(2.0)
    assert here.newest("front").status is RangeStatus.NO_SIGNAL
    assert here.newest("back").status is RangeStatus.OUT_OF_RANGE


async def test_without_a_pose_it_is_told_what_is_missing() -> None:
    clock = MonotonicClock()
    vehicle = SimVehicle(standing(), SimClock(50.0))
    beams = VirtualBeams(VirtualRoom(pillar(0.6), BeamsConfig(), 1), vehicle, clock)
    with pytest.raises(SensorSilent, match=r"front.* no valid local position .*position source"):
        await beams.open(0.1)
    assert beams.take() == ()


# ---------------------------------------------------------------- how near it came


async def test_the_least_clearance_is_that_of_the_flight_and_not_of_the_ground(
    bench: Callable[[Scenario], Bench],
) -> None:
    here = bench(pillar(0.9, 0.0))
    await here.opened()
    here.fly(1.0)
    assert here.beams.near_miss == NearMiss()
    here.take_off()
    here.ask(RequestKind.LAND)
    here.fly(15.0)
    assert not here.vehicle.status().armed
    missed = here.beams.near_miss
    assert missed.least_m == pytest.approx(0.8, abs=0.1)
    assert missed.collisions == 0


async def test_standing_near_something_with_motors_on_is_no_near_miss(
    bench: Callable[[Scenario], Bench],
) -> None:
    here = bench(pillar(0.4))
    await here.opened()
    here.ask(RequestKind.ARM)
    here.fly(1.0)
    assert here.vehicle.status().armed
    assert here.beams.near_miss == NearMiss()


class Turning:
    """A pose source whose attitude is 0.1 s newer than its position, turning at 1 rad/s."""

    def __init__(self) -> None:
        self.now_s = 0.0

    def local_position(self) -> LocalPosition:
        return at(self.now_s, (0.0, 0.0, 0.0))

    def attitude(self) -> Attitude:
        return Attitude(self.now_s + 0.1, 0.0, 0.0, 0.5, 1.0)

    def status(self) -> VehicleStatus:
        return VehicleStatus(self.now_s, False, FlightMode.HOLD, LandedState.ON_GROUND, 0.0)


class YawNoted:
    """A room that notes the heading it is looked at from."""

    beams = ("front",)
    yaw_rad = math.nan

    def sample(
        self, elapsed_s: float, _position: Vector3, _roll: float, _pitch: float, yaw_rad: float
    ) -> tuple[RangeReading, ...]:
        self.yaw_rad = yaw_rad
        return (RangeReading(elapsed_s, "front", RangeStatus.VALID, 0.5, 1e-4, 0.02, 1.0),)

    def clearance_m(self, _elapsed_s: float, _position: Vector3) -> float:
        return math.inf

    def touches(self, _elapsed_s: float, _position: Vector3) -> bool:
        return False


async def test_the_heading_is_that_of_the_moment_of_the_position() -> None:
    source, room, time = Turning(), YawNoted(), LockstepTime()
    beams = VirtualBeams(room, source, time.clock, new_waiter=time.new_waiter)
    opening = asyncio.get_running_loop().create_task(beams.open(5.0))
    while not opening.done():
        source.now_s += 0.05
        time.advance(0.05)
        await asyncio.sleep(0.001)
    await opening
    await beams.close()
    assert room.yaw_rad == pytest.approx(0.4)


async def test_flying_through_something_that_is_not_there_is_a_collision(
    bench: Callable[[Scenario], Bench],
) -> None:
    here = bench(pillar(2.0, ceiling_m=0.9))
    await here.opened()
    here.take_off()
    assert here.beams.near_miss.collisions == 1
    assert here.beams.near_miss.least_m == pytest.approx(1.9, abs=0.1)


def test_touching_for_long_is_one_collision_and_touching_again_another() -> None:
    missed = NearMiss()
    for clearance_m in (0.3, 0.1, 0.05, 0.1, 0.4, 0.1, math.inf):
        missed = missed.after(clearance_m, touching=clearance_m < 0.15)
    assert missed.collisions == 2
    assert missed.least_m == 0.05
    assert NearMiss().after(math.inf, touching=False).least_m is None


# ---------------------------------------------------------------- configuration


def test_virtual_beams_have_every_beam() -> None:
    config = BeamsConfig.model_validate({"drivers": [VIRTUAL]})
    assert config.virtual() is not None
    vehicle = DrivenVehicle(standing(), SimClock(50.0))
    (only,) = registry.range_sensors(config, vehicle, SimClock(50.0))
    assert isinstance(only, VirtualBeams)
    with pytest.raises(ReadingRefused, match="pose"):
        registry.range_sensors(config, SpokenLink(), MonotonicClock())


@pytest.mark.parametrize("other", [{"driver": "mavlink"}, VIRTUAL])
def test_virtual_beams_beside_others_are_refused_with_the_reason(other: dict[str, str]) -> None:
    with pytest.raises(ValidationError, match=r"into a room that is not there.*virtual alone"):
        BeamsConfig.model_validate({"drivers": [VIRTUAL, other]})


def test_a_scenario_that_does_not_exist_is_refused_before_anything_is_opened() -> None:
    vehicle = DrivenVehicle(standing(), SimClock(50.0))
    config = BeamsConfig.model_validate({"drivers": [VIRTUAL | {"scenario": "nowhere"}]})
    with pytest.raises(DocumentError, match="nowhere"):
        registry.range_sensors(config, vehicle, SimClock(50.0))
