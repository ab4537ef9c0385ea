"""What goes over the service's wire: orders in, states and changes out. Version 1.

Coordinates are north, east in the service's frame: NED about the place where the first mission of
this vehicle was armed (before that: where it stands). Lengths in m, times in s, angles in rad.
"""

from enum import StrEnum
from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta

from autonomy.geometry import Point

Coordinate = Annotated[float, Meta(ge=-1000.0, le=1000.0)]
GoalNE = Annotated[list[Coordinate], Meta(min_length=2, max_length=3)]

GOALS_MAX = 32


class MissionOrder(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A mission as asked for. A goal is [x, y] or [x, y, z] in `frame`; z as in `autonomy fly`."""

    goals: Annotated[tuple[GoalNE, ...], Meta(min_length=1, max_length=GOALS_MAX)]
    frame: Literal["ned", "enu", "body"] = "ned"
    altitude_m: Annotated[float, Meta(gt=0.0, le=100.0)] | None = None
    land: bool | None = None
    time_limit_s: Annotated[float, Meta(gt=0.0, le=86400.0)] | None = None
    mode: Literal["stop", "rolling"] | None = None


class MissionStatus(StrEnum):
    """Where a mission is in its life."""

    QUEUED = "queued"
    FLYING = "flying"
    DONE = "done"
    REFUSED = "refused"  # refused after it was queued, before anything moved
    CANCELLED = "cancelled"  # taken back before anything moved


class MissionRecord(msgspec.Struct, frozen=True):
    """One mission of this service since it started. `report` is there when it is done."""

    id: str
    order: MissionOrder
    status: MissionStatus
    created_utc: str
    why: str = ""
    ending: str | None = None
    exit_code: int | None = None
    report: dict[str, Any] | None = None
    log: str | None = None
    """Name of its flight log under /v1/logs."""

    @property
    def over(self) -> bool:
        """True when nothing about it will change."""
        return self.status not in (MissionStatus.QUEUED, MissionStatus.FLYING)


class Phase(StrEnum):
    """What the service is doing."""

    PREPARING = "preparing"  # loads or compiles what it flies with; `why` says how far it is
    WAITING = "waiting"  # for a vehicle; `why` says for which
    READY = "ready"  # a vehicle is there, nothing is flown
    FLYING = "flying"
    STOPPING = "stopping"


class BeamView(msgspec.Struct, frozen=True):
    """One beam as people see it. `origin` and `bearing_rad` are None for vertical beams."""

    name: str
    health: str
    """ok, silent, doubted, no signal, not heard yet; in flight also stale, too near, stuck,
    saturated, jumping, cross-talk, inconsistent."""
    sees: str
    """hit, clear, too near, nothing."""
    range_m: float | None
    max_m: float
    age_s: float | None
    origin: Point | None = None
    bearing_rad: float | None = None


class SourceView(msgspec.Struct, frozen=True):
    """One source of the position filter. A `test_ratio` above 1 was rejected."""

    name: str
    """position, velocity, gnss, floor, ceiling."""
    test_ratio: float
    fused: int
    rejected: int
    age_s: float | None


class FilterView(msgspec.Struct, frozen=True):
    """How the position filter gets on."""

    sources: tuple[SourceView, ...]
    position_sigma_m: float
    room_sigma_m: float | None
    gnss_apart_m: float | None
    frame_jumps: int
    restarts: int


class VehicleView(msgspec.Struct, frozen=True):
    """The vehicle as far as it is known."""

    position: Point
    height_m: float
    yaw_rad: float
    velocity: Point
    speed_m_s: float
    position_ok: bool
    why_not_ok: str
    mode: str
    armed: bool
    landed: str
    battery: float | None
    link_age_s: float
    height_agl_m: float | None = None
    """Over the surface below."""
    room_above_m: float | None = None
    """Below the ceiling."""


class GuardView(msgspec.Struct, frozen=True):
    """What the guard allowed in the newest tick. `why` has a clause for each limit."""

    limits: tuple[str, ...]
    speed_limit_m_s: float
    free_distance_m: float
    why: tuple[str, ...] = ()


class FaultView(msgspec.Struct, frozen=True):
    """One row of the table of faults, and what this flight, or the last one, has seen of it."""

    name: str
    words: str
    """What it is."""
    response: str
    """slow, stop, hold, return, land, let go: as the configuration chooses."""
    active: bool
    times: int
    """How often it began."""
    first_s: float | None
    last_s: float | None
    """On the service's monotonic clock."""


class MoverView(msgspec.Struct, frozen=True):
    """Something that was not there before; `moving` is False while that is not certain."""

    centre: Point
    velocity: Point
    radius_m: float
    moving: bool


class FlightView(msgspec.Struct, frozen=True):
    """The mission being flown, or the last one."""

    mission: str
    state: str
    goals: tuple[Point, ...]
    distance_to_go_m: float
    clearance_m: float
    speed_limit_m_s: float
    stops: int
    replans: int


class State(msgspec.Struct, frozen=True, tag="state"):
    """Sent at the stream's rate, and the answer of GET /v1/state."""

    time_s: float
    """The service's monotonic clock."""
    phase: Phase
    why: str
    """One sentence: what it waits for, or the reason of the last change."""
    vehicle: VehicleView | None
    beams: tuple[BeamView, ...]
    guard: GuardView | None
    flight: FlightView | None
    filter: FilterView | None = None
    """None while nothing is flown."""
    faults: tuple[FaultView, ...] = ()
    """Those that this flight has seen, the present ones first."""
    movers: tuple[MoverView, ...] = ()


class Room(msgspec.Struct, frozen=True, tag="room"):
    """What does not change in a flight."""

    fence: tuple[Point, ...]
    body_radius_m: float
    beam_max_m: float
    speed_max_m_s: float
    altitude_m: float
    scenario: str | None
    token_required: bool


class Hits(msgspec.Struct, frozen=True, tag="hits"):
    """All known hits; replaces what was sent before."""

    points: list[list[float]]


class ObstacleView(msgspec.Struct, frozen=True):
    """One obstacle with its keep-out circle (radius about the centre)."""

    kind: str
    centre: Point
    radius_m: float
    hull: tuple[Point, ...]
    hits: tuple[Point, ...]


class LegView(msgspec.Struct, frozen=True):
    """One piece of the path."""

    kind: str
    points: tuple[Point, ...]


class PlanView(msgspec.Struct, frozen=True, tag="plan"):
    """The newest plan; `evidence` is what bars the way when there is none."""

    found: bool
    why: str
    environment: str
    keep_out_m: float
    legs: tuple[LegView, ...]
    rejected: tuple[tuple[Point, ...], ...]
    obstacles: tuple[ObstacleView, ...]
    evidence: tuple[Point, ...] = ()
    height_m: float | None = None
    """Above the take-off point: the height that the legs are flown at."""


class Track(msgspec.Struct, frozen=True, tag="track"):
    """The path flown; `start` is the index of the first point, 0 begins anew."""

    start: int
    points: list[Point]


class EventView(msgspec.Struct, frozen=True, tag="event"):
    """One thing worth telling a person, numbered without gaps."""

    number: int
    time_utc: str
    name: str
    why: str


class ReelFrame(msgspec.Struct, frozen=True):
    """What changed until `at_s` seconds after the flight's first tick, and the state then."""

    at_s: float
    messages: tuple[State | Room | Hits | PlanView | Track | EventView, ...]


class Reel(msgspec.Struct, frozen=True):
    """A recorded flight to look back at: what the stream would have told, with its time. An event's
    `time_utc` is in seconds since the first tick here.
    """

    log: str
    duration_s: float
    frames: tuple[ReelFrame, ...]


Message = State | Room | Hits | PlanView | Track | EventView


class Problem(msgspec.Struct, frozen=True):
    """Why something was refused: one sentence with what to do."""

    error: str


class Reading(msgspec.Struct, frozen=True):
    """The flight log that a reel or a report is being made of, and the share that is read."""

    log: str | None = None
    share: float = 0.0


class LogFile(msgspec.Struct, frozen=True):
    """One flight log; `report` is the flight's report when the service flew it."""

    name: str
    size_bytes: int
    modified_utc: str
    report: dict[str, Any] | None = None
