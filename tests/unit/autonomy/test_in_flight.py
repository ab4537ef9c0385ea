"""The service killed in flight and begun anew: whose the vehicle is, and what becomes of it."""

import asyncio
import math
from collections.abc import Callable
from pathlib import Path

import msgspec
import pytest

from autonomy.config import Config
from autonomy.flightlog.reader import FlightLog
from autonomy.flightlog.recorder import host_boot
from autonomy.in_flight import (
    Found,
    last_flight,
    why_not_failsafe,
    why_not_ours,
    why_not_resumed,
)
from autonomy.logbook import replay_log
from autonomy.model import MissionState, OperatorCommand
from autonomy.service.contract import MissionOrder, MissionStatus, Phase
from autonomy.service.metrics import Metrics
from autonomy.service.station import Station
from autonomy.service.systemd import Notifier
from autonomy.serving import Desk, Service
from autonomy.simulation import with_scenario
from hal.readings import FlightMode, LandedState
from hal.sim.px4 import Mode
from hal.sim.scenario import load_scenario
from tests.support.simulated_drivers import Rig

TURNS = 60_000
GOAL = (2.0, 1.0)
LINK = ("execute_now", "send", "stop_now", "hold_now")


class Life:
    """One life of a service around a rig that outlives it."""

    def __init__(self, rig: Rig | None, folder: Path, choice: str = "hold") -> None:
        world = load_scenario("empty")
        config = with_scenario(Config(), world)
        service = config.service.model_copy(update={"on_restart_in_flight": choice})
        log = config.log.model_copy(update={"directory": str(folder)})
        self.config = config.model_copy(update={"log": log, "service": service})
        self.rig = rig if rig is not None else Rig(world, self.config)
        desk = Desk(self.config, None)
        self.station = Station(self.config, desk.check)
        desk.station = self.station
        metrics, drivers = Metrics(self.station), self.rig.drivers()
        notifier = Notifier({})
        self.service = Service(self.config, desk, self.station, metrics, notifier, drivers)

    async def until(self, holds: Callable[[], bool]) -> None:
        for _ in range(TURNS):
            if holds():
                return
            await asyncio.sleep(0.0005)
        pytest.fail(f"it never came to that: {self.said()}")

    async def ready(self) -> None:
        await self.until(lambda: self.station.phase is Phase.READY)

    def said(self) -> str:
        return "\n".join(event.why for event in self.station.events)

    @property
    def mode(self) -> FlightMode:
        return self.rig.vehicle.status().mode

    @property
    def down(self) -> bool:
        status = self.rig.vehicle.status()
        return status.landed is LandedState.ON_GROUND and not status.armed


class Deaf:
    """The link of a dead program."""

    def __call__(self, *_: object) -> object:
        raise asyncio.CancelledError


async def interrupted(folder: Path) -> Rig:
    """A vehicle in the air whose service died in cruise; PX4's failsafe has had its time."""
    life = Life(None, folder)
    vehicle = life.rig.vehicle
    async with asyncio.TaskGroup() as group:
        running = group.create_task(life.service.run())
        await life.ready()
        life.station.submit(MissionOrder(goals=([*GOAL],)))

        def cruises() -> bool:
            instant = life.station.instant
            command = instant.command if instant is not None else None
            return command is not None and command.decision.state is MissionState.CRUISE

        await life.until(cruises)
        for _ in range(40):
            await asyncio.sleep(0.0005)
        for name in LINK:
            setattr(vehicle, name, Deaf())
        running.cancel()
    for name in LINK:
        delattr(vehicle, name)
    vehicle.advance(4.0)
    return life.rig


async def begun_anew(
    rig: Rig, folder: Path, choice: str, until: Callable[[Life], bool], said: str
) -> Life:
    """Another life, until something is true; then it is told to stop."""
    life = Life(rig, folder, choice)
    async with asyncio.TaskGroup() as group:
        running = group.create_task(life.service.run())
        await life.until(lambda: until(life))
        assert said in life.said()
        life.service.stop()
        await life.until(running.done)
    return life


def newest_log(folder: Path) -> Path:
    return max(folder.glob("*.mcap"), key=lambda path: path.stat().st_mtime_ns)


def is_ready(life: Life) -> bool:
    return life.station.phase is Phase.READY


async def test_hold_leaves_it_in_px4s_hold_and_lands_it_when_ordered(tmp_path: Path) -> None:
    rig = await interrupted(tmp_path)
    assert rig.vehicle.status().mode is FlightMode.HOLD
    ordered = False

    def lands(life: Life) -> bool:
        nonlocal ordered
        if is_ready(life) and not ordered:
            assert life.mode is FlightMode.HOLD
            life.station.command(OperatorCommand.LAND)
            ordered = True
        return ordered and life.down

    await begun_anew(rig, tmp_path, "hold", lands, "PX4 holds the vehicle")


async def test_land_lands_it(tmp_path: Path) -> None:
    rig = await interrupted(tmp_path)
    await begun_anew(rig, tmp_path, "land", lambda life: life.down, "in flight; landing")


async def test_resume_looks_round_and_reaches_the_goal_of_the_old_frame(tmp_path: Path) -> None:
    rig = await interrupted(tmp_path)

    def over(life: Life) -> bool:
        missions = life.station.missions()
        return bool(missions) and missions[0].status is MissionStatus.DONE

    life = await begun_anew(rig, tmp_path, "resume", over, "going on")
    (record,) = life.station.missions()
    assert record.ending == "goal_reached", record.why
    north, east, _ = rig.vehicle.truth().position_ned_m
    assert math.hypot(north - GOAL[0], east - GOAL[1]) < 0.3
    log = newest_log(tmp_path)
    states = [tick.command.decision.state for tick in FlightLog.open(log)]
    assert states[0] is MissionState.OFFBOARD
    assert states.index(MissionState.DETECT) < states.index(MissionState.CRUISE)
    assert MissionState.ARM not in states
    assert replay_log(log).exact


async def test_a_pilot_who_took_it_meanwhile_keeps_it(tmp_path: Path) -> None:
    rig = await interrupted(tmp_path)
    rig.vehicle.autopilot.set_mode(Mode.RETURN.main, Mode.RETURN.sub)
    life = await begun_anew(rig, tmp_path, "land", is_ready, "left alone")
    assert life.mode is FlightMode.RETURN


async def test_after_a_reset_of_the_estimator_it_is_held_not_resumed(tmp_path: Path) -> None:
    rig = await interrupted(tmp_path)
    rig.vehicle.jump_estimate((0.5, 0.0, 0.0))
    said = "cannot go on: PX4's estimator was reset"
    life = await begun_anew(rig, tmp_path, "resume", is_ready, said)
    assert not life.station.missions()


async def test_without_a_log_the_vehicle_in_the_air_is_somebody_s(tmp_path: Path) -> None:
    rig = await interrupted(tmp_path)
    said = "no flight of this service was interrupted"
    life = await begun_anew(rig, tmp_path / "other", "land", is_ready, said)
    assert life.mode is FlightMode.HOLD


async def test_what_does_not_agree_takes_nothing_over(tmp_path: Path) -> None:
    rig = await interrupted(tmp_path)
    flight = last_flight(tmp_path)
    assert flight is not None
    assert flight.resumed is not None
    facts, status = rig.vehicle.facts(), rig.vehicle.status()
    found = Found(rig.clock.now_s(), host_boot(), facts, status, rig.vehicle.local_position())
    assert why_not_ours(flight, found) is None
    assert why_not_failsafe(found.status) is None
    assert why_not_resumed(flight, found) is None
    replace = msgspec.structs.replace
    for other, word in (
        (replace(found, host_boot="another"), "computer was started anew"),
        (replace(found, now_s=found.now_s + 121.0), "s ago"),
        (replace(found, facts=replace(facts, system_id=2)), "another vehicle"),
        (replace(found, facts=replace(facts, booted_s=None)), "does not tell"),
        (replace(found, facts=replace(facts, booted_s=found.now_s)), "autopilot was started"),
    ):
        assert word in str(why_not_ours(flight, other))
    assert found.position is not None
    n, e, d = found.position.position_ned_m
    moved = replace(found.position, position_ned_m=(n + 1.2, e, d))
    assert "m from where" in str(why_not_resumed(flight, replace(found, position=moved)))
    assert why_not_resumed(flight, replace(found, position=None)) == "there is no position"
    assert "into Hold" in str(why_not_failsafe(replace(status, in_failsafe=False)))
    returning = replace(flight.last.command.decision, state=MissionState.RETURN)
    last = replace(flight.last, command=replace(flight.last.command, decision=returning))
    assert "return" in str(why_not_resumed(replace(flight, last=last), found))
    unproved = replace(flight, resumed=None, why_not_proved="ticks are missing")
    assert why_not_resumed(unproved, found) == "ticks are missing"
