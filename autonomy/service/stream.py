"""What one watcher has not been told yet. Runs on the web side."""

from collections.abc import Iterator

import msgspec

from autonomy.service import view
from autonomy.service.contract import Message, Room, Track
from autonomy.service.station import Station

_HITS_EVERY = 4
"""Hits move a little at every tick; a person does not see it at 5 Hz."""


class Cursor:
    """How far one watcher has been told; `news` or `changes` bring it up to date."""

    def __init__(self, station: Station, room: Room) -> None:
        self._station = station
        self._room: Room | None = room
        self._event = 0
        self._flight = 0
        self._hits_version = -1
        self._plan_version = 0
        self._track = 0
        self._turn = 0

    def news(self) -> Iterator[str]:
        """`changes` as JSON texts."""
        return (msgspec.json.encode(message).decode() for message in self.changes())

    def changes(self) -> Iterator[Message]:
        """What changed since the last call, and the state now."""
        if self._room is not None:
            yield self._room
            self._room = None
        for event in self._station.events:
            if event.number > self._event:
                self._event = event.number
                yield event
        yield from self._drawn()
        yield view.state(self._station)

    def _drawn(self) -> Iterator[Message]:
        """Changes of the picture."""
        drawn = self._station.drawn
        if drawn is None:
            return
        self._turn += 1
        if drawn.number != self._flight:
            self._flight = drawn.number
            self._hits_version, self._plan_version, self._track, self._turn = -1, 0, 0, 0
            yield Track(0, [])
        if drawn.hits_version != self._hits_version and self._turn % _HITS_EVERY == 0:
            self._hits_version = drawn.hits_version
            yield view.hits(drawn)
        if drawn.plan_version != self._plan_version:
            self._plan_version = drawn.plan_version
            plan = view.plan(drawn)
            if plan is not None:
                yield plan
        news = view.track(drawn, self._track)
        if news.points:
            self._track += len(news.points)
            yield news
