"""What a flight log holds, and how one record becomes bytes and the same record again.

A log is an MCAP file. Its metadata record `flight` is the `FlightHeader`. The topic `route` has the
goals, once; each tick is three messages with one sequence number, on the topics `inputs`,
`decisions` and `guard`; what the autopilot wrote for people is on `texts`. Messages are JSON,
described by JSON schemas in the file.

JSON has no infinity and no NaN: they are written as the strings "inf", "-inf" and "nan". Every
other number is written with the digits that restore the same double.
"""

import json
import math
import re
from typing import Any, TypeVar

import msgspec

from autonomy.geometry import Point
from autonomy.model import Command, Decision, GuardReport, Inputs, Resumed
from hal.frames import Vector3
from hal.readings import StatusText
from hal.setpoints import Setpoint

FORMAT = 1
"""Raised when logs of an older program can no longer be read."""

SUFFIX = ".mcap"
EXPORT_SUFFIX = ".foxglove.mcap"
"""What is made from a log for other programs ends so, and is not taken for a log."""

PROFILE = "autonomy"
METADATA = "flight"


class FlightHeader(msgspec.Struct, frozen=True):
    """What a flight began with; with route and inputs, all that is needed to fly it again.

    `config_json` is the effective configuration, `scenario` the simulated world's name (empty on a
    real flight), `versions` names the program and the libraries that compute.
    """

    config_json: str
    scenario: str = ""
    seed: int | None = None
    started_utc: str = ""
    versions: dict[str, str] = {}
    host_boot: str = ""
    """Which start of this computer: monotonic times of two logs are on one axis within it."""
    started_s: float | None = None
    """When recording began, on that axis: it orders flights, whatever the date was set to."""
    format: int = FORMAT


class RouteRecord(msgspec.Struct, frozen=True):
    """The goals in order, in NED about the take-off point."""

    goals_ned_m: tuple[Vector3, ...]
    resumed: Resumed | None = None
    """Where an interrupted mission went on, for a flight that began in the air."""
    offset_ne_m: Point = (0.0, 0.0)
    """Where the take-off point lies in the frame of the service that was given the goals."""


class GuardRecord(msgspec.Struct, frozen=True):
    """The rest of a `Command` beside its decision, and how long computing it took."""

    setpoint: Setpoint | None
    wire_setpoint: Setpoint | None
    guard: GuardReport
    step_s: float


class Tick(msgspec.Struct, frozen=True):
    """One step of the control loop; `index` counts from 0 and a gap is a tick that was lost."""

    index: int
    inputs: Inputs
    command: Command
    step_s: float


TOPICS: dict[str, type[msgspec.Struct]] = {
    "route": RouteRecord,
    "inputs": Inputs,
    "decisions": Decision,
    "guard": GuardRecord,
    "texts": StatusText,
}

Record = TypeVar("Record", bound=msgspec.Struct)

_NOT_FINITE = re.compile(rb"\xcb[\x7f\xff][\xf0-\xff]", re.DOTALL)
"""Exponent bits all set. What only looks so (in a text, say) is spelled out for nothing."""


def encode(record: msgspec.Struct) -> bytes:
    """The record as JSON; raises TypeError when a field holds what is not plain data."""
    # msgspec writes JSON in a tenth of the time, but null for what is not finite. In MessagePack,
    # as quick, every float is its eight bytes behind 0xcb: what is not finite is seen there.
    if _NOT_FINITE.search(msgspec.msgpack.encode(record)) is None:
        return msgspec.json.encode(record)
    plain = _spelled_out(msgspec.to_builtins(record))
    return json.dumps(plain, allow_nan=False, separators=(",", ":")).encode()


def decode(data: bytes, kind: type[Record]) -> Record:
    """The record that `encode` was given; raises msgspec.MsgspecError when it is not a `kind`."""
    # Not strict, so that a number may come as a string: see the module's first paragraph.
    return msgspec.json.decode(data, type=kind, strict=False)


def json_schema(kind: type[msgspec.Struct]) -> bytes:
    """The JSON schema of a record, for programs that know nothing of this one."""
    return json.dumps(msgspec.json.schema(kind)).encode()


def _spelled_out(plain: Any) -> Any:
    """The same tree with every non-finite number as a string."""
    if isinstance(plain, dict):
        return {key: _spelled_out(value) for key, value in plain.items()}
    if isinstance(plain, list | tuple):
        return [_spelled_out(value) for value in plain]
    if isinstance(plain, float) and not math.isfinite(plain):
        return str(plain)
    return plain
