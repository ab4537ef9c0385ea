"""A recorded flight as the page would have shown it live: the same messages, with their time.

The log is flown again, for it does not hold the map, and put before a watcher as slow as a person.
"""

from collections.abc import Callable
from pathlib import Path

import msgspec

from autonomy.errors import NotReplayable
from autonomy.flightlog.reader import FlightLog
from autonomy.geometry import moved
from autonomy.logbook import recorded_config
from autonomy.mission.guarded import GuardedPilot
from autonomy.service import view
from autonomy.service.contract import (
    Hits,
    Message,
    Phase,
    PlanView,
    Reel,
    ReelFrame,
    State,
)
from autonomy.service.station import FlownMission, Station
from autonomy.service.stream import Cursor

PERIOD_S = 0.2
"""Between two frames of a flight that is not long."""
FRAMES_MAX = 3000
"""Ten minutes. A longer flight has frames farther apart."""


def reel_of(path: Path, tell_share: Callable[[float], None] = lambda _: None) -> Reel:
    """The flight recorded at `path`, in the frame of the service that flew it.

    `tell_share` hears at every tick how much of the log is read, from 0 to 1.

    Raises NotReplayable when there is nothing to fly, DocumentError when its configuration is
    refused.
    """
    log = FlightLog.open(path)
    config, route = recorded_config(log), log.route()
    guarded = GuardedPilot(config, route, log.resumed())
    start_s: float | None = None
    clock = _Clock()
    station = Station(config, lambda _: None, clock.read)
    offset = log.offset_ne_m()
    goals = moved(tuple((goal[0], goal[1]) for goal in route), offset)
    station.begin(FlownMission(path.stem, goals, offset))
    station.enter(Phase.FLYING, "the flight begins")
    room = view.room(config, log.header.scenario or None, token_required=False)
    # The recorded fence is in the mission's frame.
    room = msgspec.structs.replace(room, fence=moved(room.fence, offset))
    cursor = Cursor(station, room)
    frames: list[ReelFrame] = []
    period_s, at_s = PERIOD_S, 0.0
    for tick in log:
        tell_share(log.share_read)
        start_s = tick.inputs.now_s if start_s is None else start_s
        at_s = tick.inputs.now_s - start_s
        clock.at_s = at_s
        guarded.step(tick.inputs)
        station.flight_tick(tick.command, tick.inputs.status, guarded.pilot.sensing)
        if not frames or at_s >= frames[-1].at_s + period_s - 1e-6:
            frames.append(ReelFrame(round(at_s, 3), tuple(cursor.changes())))
        if len(frames) > FRAMES_MAX:
            frames, period_s = _half(frames), 2.0 * period_s
    if start_s is None:
        raise NotReplayable(f"{path}: holds no complete tick; there is nothing to show")
    frames.append(ReelFrame(round(at_s, 3), tuple(cursor.changes())))
    return Reel(log=path.name, duration_s=round(at_s, 3), frames=tuple(frames))


class _Clock:
    """Events are stamped with seconds since the first tick, as people read a log."""

    def __init__(self) -> None:
        self.at_s = 0.0

    def read(self) -> str:
        return f"{self.at_s:.2f}"


def _half(frames: list[ReelFrame]) -> list[ReelFrame]:
    """Every other frame of an odd number; what the one before it told is told with it."""
    pairs = zip(frames[::2], [*frames[1::2], None], strict=False)
    halved: list[ReelFrame] = []
    late: tuple[Message, ...] = ()
    for first, second in pairs:
        messages = (*late, *first.messages)
        halved.append(ReelFrame(first.at_s, _newest(messages)))
        told = second.messages if second is not None else ()
        late = tuple(message for message in told if not isinstance(message, State))
    return halved


def _newest(messages: tuple[Message, ...]) -> tuple[Message, ...]:
    """Without what a later message of the same frame replaces."""
    last = {type(message): message for message in messages}
    return tuple(
        message
        for message in messages
        if not isinstance(message, Hits | PlanView) or last[type(message)] is message
    )
