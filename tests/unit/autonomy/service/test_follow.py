import asyncio
import io
import math

import pytest

from autonomy.config import Config
from autonomy.model import (
    Command,
    Decision,
    Environment,
    Event,
    GuardReport,
    MissionState,
    Obstacle,
    ObstacleKind,
    Plan,
)  # fmt: skip
from autonomy.service.contract import MissionOrder, MissionStatus, Phase
from autonomy.service.follow import FRAME_BYTES_MAX, Frame, frames, read_frames
from autonomy.service.station import FlownMission, Instant, Station
from hal.readings import FlightMode, LandedState, VehicleStatus

STATUS = VehicleStatus(0.0, True, FlightMode.OFFBOARD, LandedState.IN_AIR, 0.0)


def a_plan() -> Plan:
    alone = Obstacle(ObstacleKind.DISCRETE, (1.0, 2.0), 0.1, (), ((1.0, 2.0),), 0.0, 0.0, math.inf)
    return Plan((), 1.0, 0.23, Environment.DISCRETE, (alone,))


def decided(now_s: float, events: tuple[Event, ...]) -> Command:
    decision = Decision(now_s, MissionState.CRUISE, None, None, events=events)
    return Command(decision, None, None, GuardReport())


def accept(_: MissionOrder) -> None:
    """Anything may be flown."""


async def test_a_watcher_hears_every_event_once_and_the_end() -> None:
    station = Station(Config(), accept)
    station.at_rest(
        Instant(0.0, STATUS.__class__(0.0, False, FlightMode.HOLD, LandedState.ON_GROUND, 0.0), {})
    )
    station.enter(Phase.READY, "ready")
    name = station.submit(MissionOrder(goals=([1.0, 0.0],))).id
    station.take_mission()
    station.begin(FlownMission(name, ((1.0, 0.0),), (0.0, 0.0)))
    drawn = station.drawn
    assert drawn is not None
    stream = frames(station, name)
    told: list[bytes] = [await anext(stream)]
    for number in range(3):
        # More ticks than frames: what happens between two frames must not be lost.
        for part in range(2):
            event = Event(float(number), "note", f"{number}.{part}")
            drawn.events.append(event)
            station.instant = Instant(float(number), STATUS, {}, command=decided(number, (event,)))
        if number == 1:
            drawn.plan, drawn.plan_version = a_plan(), 1
        told.append(await anext(stream))
    station.update(name, status=MissionStatus.DONE, report={"why": "there"})
    told.extend([part async for part in stream])
    heard = list(read_frames(io.BytesIO(b"".join(told)).read))
    events = [e.why for f in heard if f.command is not None for e in f.command.decision.events]
    assert events == ["0.0", "0.1", "1.0", "1.1", "2.0", "2.1"]
    plans = [f.command.decision.plan for f in heard if f.command is not None]
    assert plans == [None, a_plan(), None]
    assert heard[-1].record is not None
    assert heard[-1].record.report == {"why": "there"}
    assert [f.record for f in heard[:-1]] == [None] * (len(heard) - 1)


async def test_a_mission_that_is_not_known_ends_at_once() -> None:
    station = Station(Config(), accept)
    parts = [part async for part in frames(station, "unknown")]
    assert list(read_frames(io.BytesIO(b"".join(parts)).read)) == [Frame()]
    await asyncio.sleep(0)


def test_a_stream_that_breaks_off_ends_and_one_of_nonsense_is_refused() -> None:
    assert list(read_frames(io.BytesIO(b"\x00\x00\x00\x09abc").read)) == []
    assert list(read_frames(io.BytesIO(b"\x00\x00").read)) == []
    too_long = (FRAME_BYTES_MAX + 1).to_bytes(4, "big")
    with pytest.raises(ValueError, match="none of this service's"):
        list(read_frames(io.BytesIO(too_long).read))
