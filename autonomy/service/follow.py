"""How another process watches a mission as closely as if it flew it: frames of MessagePack.

A frame is a length (4 bytes, big-endian) and one `Frame`. The flight's own records travel, so that
`autonomy fly` shows the same progress and the same report as when it flies by itself.
"""

import asyncio
import struct
from collections.abc import AsyncIterator, Callable, Iterator

import msgspec

from autonomy.model import Command
from autonomy.service.contract import MissionRecord
from autonomy.service.station import Drawn, Station

FRAME_BYTES_MAX = 8_000_000
_PERIOD_S = 0.1
_LENGTH = struct.Struct(">I")
_ENCODER = msgspec.msgpack.Encoder()


class Frame(msgspec.Struct, frozen=True):
    """The newest command with every event since the last frame; `record` ends the stream."""

    command: Command | None = None
    record: MissionRecord | None = None


_DECODER = msgspec.msgpack.Decoder(Frame)


async def frames(station: Station, mission_id: str) -> AsyncIterator[bytes]:
    """Frames of one mission until it is over; a frame without content shows that it still runs."""
    told = 0
    plan_version = 0
    while True:
        record = station.mission(mission_id)
        if record is None or record.over:
            yield _encoded(Frame(record=record))
            return
        frame = Frame()
        drawn, instant = station.drawn, station.instant
        ours = drawn is not None and drawn.flown.id == mission_id
        if ours and drawn is not None and instant is not None and instant.command is not None:
            frame = Frame(_with_news(instant.command, drawn, told, plan_version))
            told = len(drawn.events)
            plan_version = drawn.plan_version
        yield _encoded(frame)
        await asyncio.sleep(_PERIOD_S)


def read_frames(read: Callable[[int], bytes]) -> Iterator[Frame]:
    """Frames from `read` (as of a file) until it ends; raises ValueError for what is none."""
    while len(head := read(_LENGTH.size)) == _LENGTH.size:
        (length,) = _LENGTH.unpack(head)
        if length > FRAME_BYTES_MAX:
            raise ValueError(f"a frame of {length} bytes is none of this service's")
        body = read(length)
        if len(body) < length:
            return
        yield _DECODER.decode(body)


def _with_news(command: Command, drawn: Drawn, told: int, plan_version: int) -> Command:
    """The command with all events since `told`, and with the plan when it is new."""
    decision = msgspec.structs.replace(
        command.decision,
        events=tuple(drawn.events[told:]),
        plan=drawn.plan if drawn.plan_version != plan_version else None,
    )
    return msgspec.structs.replace(command, decision=decision)


def _encoded(frame: Frame) -> bytes:
    body = _ENCODER.encode(frame)
    return _LENGTH.pack(len(body)) + body
