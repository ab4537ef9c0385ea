"""The service killed in flight and begun anew: whose the vehicle is, and what becomes of it."""

import asyncio
import math
from collections.abc import Callable
from pathlib import Path

import msgspec
import pytest

from autonomy.config import Config
from autonomy.flightlog.folder import host_boot
from autonomy.flightlog.reader import FlightLog
from autonomy.in_flight import (
    Found,
    HoldMark,
    changed_section,
    last_flight,
    leave_mark,
    mark_path,
    read_mark,
    why_not_held_for_us,
    why_not_ours,
    why_not_resumed,
)
from autonomy.logbook import replay_log
from autonomy.model import MissionState, OperatorCommand
from autonomy.service.contract import MissionOrder, MissionStatus, Phase
from autonomy.service.metrics import Metrics
from autonomy.service.station import Refused, Station
from autonomy.service.systemd import Notifier
from autonomy.serving.desk import Desk, shifted
from autonomy.serving.parts import Parts
from autonomy.serving.service import Service
from autonomy.simulation import with_scenario
from hal.config import Fence
from hal.frames import Vector3
from hal.readings import FlightMode, LandedState
from hal.setpoints import Reply, Request, RequestKind
from hal.sim.px4 import Mode
from hal.sim.scenario import load_scenario
from tests.support.simulated_drivers import Rig

TURNS = 60_000
TICK_S = 0.05
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
        parts = Parts(self.config, desk, self.station, metrics, notifier, drivers)
        self.service = Service(parts)

    async def until(self, holds: Callable[[], bool], *, alone: bool = False) -> None:
        """Waits for it. Between looks a landing that no mission flies goes on, and with `alone`
        whatever the vehicle does: the looks of the service would let wall-clock time pass.
        """
        for _ in range(TURNS):
            if holds():
                return
            lands = self.mode is FlightMode.LAND and self.station.phase is not Phase.FLYING
            if alone or lands:
                self.rig.vehicle.advance(TICK_S)
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


async def dies_in_cruise(life: Life, after_s: float = 4.0) -> None:
    """Ends a service that flies a mission, a new one or one that goes on, as SIGKILL does."""
    vehicle = life.rig.vehicle
    new = life.config.service.on_restart_in_flight != "resume"
    async with asyncio.TaskGroup() as group:
        running = group.create_task(life.service.run())
        if new:
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
        await life.until(running.done, alone=True)
    for name in LINK:
        delattr(vehicle, name)
    vehicle.advance(after_s)


async def interrupted(
    folder: Path, home_ned_m: Vector3 = (0.0, 0.0, 0.0), after_s: float = 4.0
) -> Rig:
    """A vehicle in the air whose service died in cruise; PX4's failsafe has had its time.

    It was armed at `home_ned_m` of PX4's frame.
    """
    life = Life(None, folder)
    vehicle = life.rig.vehicle
    if home_ned_m != (0.0, 0.0, 0.0):
        vehicle.jump_estimate(home_ned_m)
    await dies_in_cruise(life, after_s)
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
        over = life.station.phase is not Phase.FLYING
        life.service.stop()
        await life.until(running.done, alone=over)
    return life


def newest_log(folder: Path) -> Path:
    return max(folder.glob("*.mcap"), key=lambda path: path.stat().st_mtime_ns)


def is_ready(life: Life) -> bool:
    return life.station.phase is Phase.READY


def landed_by_an_operator() -> Callable[[Life], bool]:
    """Ends a life that, once ready, left the vehicle in Hold until it was told to land it."""
    ordered = False

    def lands(life: Life) -> bool:
        nonlocal ordered
        if is_ready(life) and not ordered:
            assert life.mode is FlightMode.HOLD
            life.station.command(OperatorCommand.LAND)
            ordered = True
        return ordered and life.down

    return lands


async def test_hold_leaves_it_in_px4s_hold_and_lands_it_when_ordered(tmp_path: Path) -> None:
    rig = await interrupted(tmp_path)
    assert rig.vehicle.status().mode is FlightMode.HOLD
    await begun_anew(rig, tmp_path, "hold", landed_by_an_operator(), "PX4 holds the vehicle")


async def test_land_lands_it(tmp_path: Path) -> None:
    rig = await interrupted(tmp_path)
    await begun_anew(rig, tmp_path, "land", lambda life: life.down, "in flight; landing")


async def test_a_landing_after_a_restart_is_watched_and_no_mission_comes_between(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rig = await interrupted(tmp_path)
    watched: list[bool] = []
    monkeypatch.setattr(Notifier, "ready", lambda _: watched.append(rig.vehicle.status().armed))

    def lands(life: Life) -> bool:
        if life.mode is FlightMode.LAND and not life.down:
            assert watched == [True]
            with pytest.raises(Refused, match="interrupted in flight; landing"):
                life.station.submit(MissionOrder(goals=([*GOAL],)))
        return life.down

    await begun_anew(rig, tmp_path, "land", lands, "in flight; landing")
    assert watched == [True]


async def test_what_was_said_of_a_vehicle_in_the_air_holds_until_a_pilot_takes_it(
    tmp_path: Path,
) -> None:
    rig = await interrupted(tmp_path)

    def taken(life: Life) -> bool:
        if "PX4 holds the vehicle" in life.station.why:
            rig.vehicle.autopilot.set_mode(Mode.RETURN.main, Mode.RETURN.sub)
        return is_ready(life) and "not flown by this service" in life.station.why

    await begun_anew(rig, tmp_path, "hold", taken, "PX4 holds the vehicle")


async def test_a_landing_that_was_ordered_is_told_as_one(tmp_path: Path) -> None:
    rig = await interrupted(tmp_path)
    life = await begun_anew(rig, tmp_path, "hold", landed_by_an_operator(), "PX4 holds")
    assert "is landing for this service" in life.said()


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


def found_with(rig: Rig, folder: Path) -> Found:
    vehicle = rig.vehicle
    config = Life(rig, folder).config
    return Found(
        rig.clock.now_s(),
        host_boot(),
        vehicle.facts(),
        vehicle.status(),
        vehicle.local_position(),
        config,
    )


async def test_what_does_not_agree_takes_nothing_over(tmp_path: Path) -> None:
    rig = await interrupted(tmp_path)
    flight = last_flight(tmp_path)
    assert flight is not None
    assert flight.resumed is not None
    found = found_with(rig, tmp_path)
    facts, status = found.facts, found.status
    assert why_not_ours(flight, found) is None
    assert why_not_held_for_us(flight, found) is None
    assert why_not_resumed(flight, found) is None
    replace = msgspec.structs.replace
    link = found.config.vehicle.model_copy(update={"connection": "udpin://0.0.0.0:15699"})
    elsewhere = found.config.model_copy(update={"vehicle": link})
    for other, word in (
        (replace(found, host_boot="another"), "computer was started anew"),
        (replace(found, now_s=found.now_s + 121.0), "s ago"),
        (replace(found, facts=replace(facts, system_id=2)), "another vehicle"),
        (replace(found, facts=replace(facts, booted_s=None)), "does not tell"),
        (replace(found, facts=replace(facts, booted_s=found.now_s)), "autopilot was started"),
        (replace(found, facts=replace(facts, booted_s=-1.2)), "1 s apart"),
        (replace(found, config=elsewhere), "the last flight was on"),
        (replace(found, scenario="maze"), "another world"),
    ):
        assert word in str(why_not_ours(flight, other))
    assert found.position is not None
    n, e, d = found.position.position_ned_m
    moved = replace(found.position, position_ned_m=(n + 1.2, e, d))
    assert "m from where" in str(why_not_resumed(flight, replace(found, position=moved)))
    assert why_not_resumed(flight, replace(found, position=None)) == "there is no position"
    untold = replace(found.position, resets_told=False)
    assert "does not tell resets" in str(why_not_resumed(flight, replace(found, position=untold)))
    assert "gone on once already" in str(why_not_resumed(replace(flight, again=True), found))
    chosen = replace(found, status=replace(status, in_failsafe=False))
    assert "into Hold" in str(why_not_held_for_us(flight, chosen))
    died_s = flight.last.inputs.now_s
    held = replace(flight, held_s=died_s + 1.25)
    assert why_not_held_for_us(held, chosen) is None
    assert "m from where" in str(why_not_held_for_us(held, replace(chosen, position=moved)))
    for at_s in (died_s - 1.0, found.now_s + 1.0):
        assert "into Hold" in str(why_not_held_for_us(replace(flight, held_s=at_s), chosen))
    assert "stood still" in str(why_not_resumed(held, found))
    flying = replace(chosen, status=replace(chosen.status, mode=FlightMode.MANUAL))
    assert "manual" in str(why_not_held_for_us(held, flying))
    returning = replace(flight.last.command.decision, state=MissionState.RETURN)
    last = replace(flight.last, command=replace(flight.last.command, decision=returning))
    assert "return" in str(why_not_resumed(replace(flight, last=last), found))
    unproved = replace(flight, resumed=None, why_not_proved="ticks are missing")
    assert why_not_resumed(unproved, found) == "ticks are missing"


async def test_a_mission_goes_on_only_by_the_limits_it_began_with(tmp_path: Path) -> None:
    rig = await interrupted(tmp_path)
    flight, found = last_flight(tmp_path), found_with(rig, tmp_path)
    assert flight is not None
    config = found.config
    for section, key, value in (
        ("guard", "speed_max_m_s", 0.2),
        ("body", "radius_m", 0.16),
        ("failsafe", "battery_warn", 0.3),
        ("beams", "stale_after_s", 0.2),
    ):
        changed = getattr(config, section)
        changed = changed.model_copy(update={key: value})
        other = config.model_copy(update={section: changed})
        said = why_not_resumed(flight, msgspec.structs.replace(found, config=other))
        assert said == f"it was flown with another configuration ({section})"
    narrow = config.guard.model_copy(update={"fence": Fence.rectangle((-1.0, 3.0), (-1.0, 3.0))})
    assert changed_section(config, config.model_copy(update={"guard": narrow})) == "guard.fence"


def test_the_fence_of_a_later_mission_is_the_same_fence_elsewhere(tmp_path: Path) -> None:
    life = Life(None, tmp_path)
    mission = Desk(life.config, None).mission(MissionOrder(goals=([1.0, 0.0],)), (0.0, 0.0), 0.0)
    assert changed_section(shifted(mission, (0.3, -0.7)).config, life.config) is None


@pytest.mark.parametrize("choice", ["resume", "land"])
async def test_the_goal_of_a_home_far_from_the_autopilot_s_origin_is_reached(
    tmp_path: Path, choice: str
) -> None:
    rig = await interrupted(tmp_path, home_ned_m=(5.0, -3.0, 0.9))

    def over(life: Life) -> bool:
        missions = life.station.missions()
        return life.down and (choice == "land" or missions[0].status is MissionStatus.DONE)

    life = await begun_anew(rig, tmp_path, choice, over, "in flight")
    if choice == "resume":
        (record,) = life.station.missions()
        assert record.ending == "goal_reached", record.why
        north, east, _ = rig.vehicle.truth().position_ned_m
        assert math.hypot(north - GOAL[0], east - GOAL[1]) < 0.3
        downs = [
            tick.command.decision.fused.position_ned_m[2]
            for tick in FlightLog.open(newest_log(tmp_path))
            if tick.command.decision.fused is not None
            and tick.command.decision.state is MissionState.CRUISE
        ]
        assert max(abs(down + life.config.mission.altitude_m) for down in downs) < 0.2


async def held_by_the_deadman(folder: Path) -> Rig:
    """A vehicle whose program hung, was stopped by its deadman, and then killed by a watchdog."""
    rig = await interrupted(folder, after_s=0.3)
    assert rig.vehicle.hold_now()
    leave_mark(newest_log(folder), HoldMark(rig.clock.now_s(), host_boot()))
    rig.vehicle.advance(2.0)
    for _ in range(400):
        if read_mark(newest_log(folder)) is not None:
            break
        await asyncio.sleep(0.01)
    status = rig.vehicle.status()
    assert status.mode is FlightMode.HOLD
    assert not status.in_failsafe
    return rig


async def test_what_the_deadman_put_into_hold_is_landed_as_configured(tmp_path: Path) -> None:
    rig = await held_by_the_deadman(tmp_path)
    await begun_anew(rig, tmp_path, "land", lambda life: life.down, "in flight; landing")


async def test_a_hold_of_nobody_knows_whom_is_left_alone_until_an_operator_says_land(
    tmp_path: Path,
) -> None:
    rig = await held_by_the_deadman(tmp_path)
    mark_path(newest_log(tmp_path)).write_text("torn")
    why = "a pilot or another program put it into Hold"
    await begun_anew(rig, tmp_path, "land", landed_by_an_operator(), why)


async def test_a_landing_that_is_refused_is_asked_for_again(tmp_path: Path) -> None:
    rig = await interrupted(tmp_path)
    execute_now, lands = rig.vehicle.execute_now, 0

    def refusing(request: Request) -> Reply:
        nonlocal lands
        lands += request.kind is RequestKind.LAND
        if request.kind is RequestKind.LAND and lands == 1:
            return Reply(rig.clock.now_s(), request.kind, accepted=False, reason="planted")
        return execute_now(request)

    rig.vehicle.execute_now = refusing  # type: ignore[method-assign]  # a spy
    await begun_anew(rig, tmp_path, "land", lambda life: life.down, "in flight; landing")
    assert lands == 2


async def test_a_vehicle_that_falls_silent_while_its_log_is_read_is_landed_when_it_is_back(
    tmp_path: Path,
) -> None:
    rig = await interrupted(tmp_path)

    def silent() -> None:
        rig.at_tick = None
        rig.vehicle.cut_link()
        rig.vehicle.advance(5.0)

    rig.at_tick = silent

    def lands(life: Life) -> bool:
        if "fell silent" in life.station.why:
            rig.vehicle.restore_link()
        return life.down

    await begun_anew(rig, tmp_path, "land", lands, "in flight; landing")


async def left_in_the_air(folder: Path, *, pilot: bool = False) -> Rig:
    """A vehicle whose mission ended in Hold at its goal, or by a pilot's Hold, and whose service
    was killed then.
    """
    life = Life(None, folder)
    vehicle = life.rig.vehicle

    def take() -> None:
        if vehicle.status().mode is FlightMode.OFFBOARD:
            life.rig.at_tick = None
            vehicle.autopilot.take_over(Mode.HOLD)

    life.rig.at_tick = take if pilot else None
    async with asyncio.TaskGroup() as group:
        running = group.create_task(life.service.run())
        await life.ready()
        record = life.station.submit(MissionOrder(goals=([0.5, 0.0],), land=False))
        await life.until(lambda: life.station.missions()[0].over)
        running.cancel()
    ended = life.station.mission(record.id)
    assert ended is not None
    assert ended.ending == ("taken_over" if pilot else "goal_reached"), ended.why
    assert life.mode is FlightMode.HOLD
    vehicle.advance(200.0)
    return life.rig


async def test_what_a_mission_left_in_hold_lands_by_an_order_of_the_next_life(
    tmp_path: Path,
) -> None:
    rig = await left_in_the_air(tmp_path)
    flight, found = last_flight(tmp_path), found_with(rig, tmp_path)
    assert flight is not None
    assert why_not_ours(flight, found) is None
    assert why_not_resumed(flight, found) == "it was over"
    replace = msgspec.structs.replace
    assert "ended" in str(why_not_ours(flight, replace(found, now_s=found.now_s + 1800.0)))
    assert found.position is not None
    n, e, d = found.position.position_ned_m
    moved = replace(found, position=replace(found.position, position_ned_m=(n + 1.2, e, d)))
    assert "m from where" in str(why_not_ours(flight, moved))
    await begun_anew(rig, tmp_path, "land", landed_by_an_operator(), "its mission was over")


async def test_what_a_pilot_took_from_a_mission_is_nobody_s_after_a_kill(tmp_path: Path) -> None:
    await left_in_the_air(tmp_path, pilot=True)
    assert last_flight(tmp_path) is None


async def test_a_mission_that_was_interrupted_twice_does_not_go_on(tmp_path: Path) -> None:
    rig = await interrupted(tmp_path)
    await dies_in_cruise(Life(rig, tmp_path, "resume"))
    flight = last_flight(tmp_path)
    assert flight is not None
    assert "gone on once already" in str(why_not_resumed(flight, found_with(rig, tmp_path)))


async def test_a_life_that_ended_before_its_first_tick_counts_as_one(tmp_path: Path) -> None:
    await interrupted(tmp_path)
    (tmp_path / "later.mcap").touch()
    flight = last_flight(tmp_path)
    assert flight is not None
    assert flight.again
