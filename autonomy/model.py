"""The nouns that cross package boundaries: what goes into a decision and what comes out of it.

Everything here is an immutable record without behaviour beyond derivation. `Inputs` and
`Decision` are what the flight log stores; they restore bit for bit.
"""

import math
from enum import StrEnum

import msgspec

from autonomy.geometry import Point
from hal.frames import ZERO3, Vector3
from hal.readings import (
    Attitude,
    GnssFix,
    LocalPosition,
    RangeReading,
    VehicleFacts,
    VehicleStatus,
)
from hal.setpoints import Reply, Request, Setpoint


class Event(msgspec.Struct, frozen=True):
    """One thing worth telling a person; `why` is a sentence."""

    stamp_s: float
    name: str
    why: str


# ---------------------------------------------------------------- estimation


class SourceHealth(msgspec.Struct, frozen=True, gc=False, omit_defaults=True):
    """How the estimator gets on with one source of measurements.

    `test_ratio` is the newest one's (at most 1: fused; 1e6 stands for what is no number), `age_s`
    the age of the newest one that was fused; None before that.
    """

    test_ratio: float = 0.0
    fused: int = 0
    rejected: int = 0
    age_s: float | None = None


UNHEARD = SourceHealth()


class FilterHealth(msgspec.Struct, frozen=True, gc=False, omit_defaults=True):
    """What the estimator is made of, for people: nothing is decided by it.

    `gnss_bias_ne_m` is GNSS less local position (nothing at the first fix), `gnss_apart_m` how far
    that has moved since the first seconds. `room_sigma_m` is what the position is uncertain by
    against the room, each axis, one sigma, when the autopilot drifts as configured;
    `FusedState.position_sigma_m` is against the autopilot's frame.
    """

    position: SourceHealth = UNHEARD
    velocity: SourceHealth = UNHEARD
    gnss: SourceHealth = UNHEARD
    floor: SourceHealth = UNHEARD
    ceiling: SourceHealth = UNHEARD
    gnss_bias_ne_m: Point | None = None
    gnss_apart_m: float | None = None
    room_sigma_m: float | None = None
    floor_steps: int = 0
    ceiling_steps: int = 0
    frame_jumps: int = 0
    late: int = 0
    """Measurements that were fused behind newer ones."""
    restarts: int = 0
    """How often the filter had to begin anew, because it diverged or after a silence."""


SOURCES = ("position", "velocity", "gnss", "floor", "ceiling")
"""The fields of `FilterHealth` that are a `SourceHealth`."""


class FusedState(msgspec.Struct, frozen=True):
    """The vehicle as the estimator believes it, in the autopilot's local NED frame.

    `height_agl_m` is the height over the surface below, None when no down beam or terrain estimate
    supports it. `position_sigma_m` is the one-sigma horizontal uncertainty. `ok` is False when
    position or attitude is missing or stale: then nothing may be flown by it.
    """

    stamp_s: float
    position_ned_m: Vector3
    velocity_ned_m_s: Vector3
    yaw_rad: float
    position_sigma_m: float
    height_agl_m: float | None
    ok: bool
    why_not_ok: str = ""
    roll_rad: float = 0.0
    pitch_rad: float = 0.0
    yaw_rate_rad_s: float = 0.0
    frame_shift_ned_m: Vector3 = ZERO3
    """How far the frame jumped at this step (EKF reset): the map moves by as much."""
    room_above_m: float | None = None
    """From the vehicle's centre to the ceiling above; None when no beam supports it."""
    health: FilterHealth = FilterHealth()
    news: tuple[Event, ...] = ()
    """What the estimator noticed at this step."""

    @property
    def point(self) -> Point:
        """Horizontal position (north, east)."""
        return (self.position_ned_m[0], self.position_ned_m[1])


class WallFixReport(msgspec.Struct, frozen=True):
    """What beams on known walls say of the autopilot's frame (estimation/wall_fix.py).

    `offset_ne_m`: the frame is taken to be wrong by so much; `sigma_ne_m`: how well that is known
    against the walls in sight. `test_ratio`: the largest of this tick, above 1 rejected, 0 without
    any. Counts are since arming; `forgotten` are cells of walls that were contradicted.
    """

    offset_ne_m: Point = (0.0, 0.0)
    sigma_ne_m: Point = (0.0, 0.0)
    test_ratio: float = 0.0
    fused: int = 0
    rejected: int = 0
    forgotten: int = 0


# ---------------------------------------------------------------- obstacles and plans


class ObstacleKind(StrEnum):
    """The paper's two classes of obstacles."""

    DISCRETE = "discrete"
    CONTINUOUS = "continuous"


class Environment(StrEnum):
    """What the surroundings are as a whole."""

    FREE = "free"
    DISCRETE = "discrete"
    CONTINUOUS = "continuous"
    MIXED = "mixed"


class Obstacle(msgspec.Struct, frozen=True, gc=False):
    """One connected component of hit points at the keep-out radius.

    (centre, radius_m) is its minimum enclosing circle; `hull` its convex hull, counter-clockwise
    seen with north up and east right reversed to (north, east) axes; `death_m` is the radius at
    which it would merge with its nearest neighbour (inf for the last component).
    """

    kind: ObstacleKind
    centre: Point
    radius_m: float
    hull: tuple[Point, ...]
    hits: tuple[Point, ...]
    linearity: float
    regularity: float
    death_m: float


class MovingObstacle(msgspec.Struct, frozen=True):
    """Something that was not there before: a disc, where it is now and where it is going.

    `sigma_m` and `speed_sigma_m_s` are one sigma of each component; `seen_s` is when a beam met it
    last; `moving` is False while that is not certain yet.
    """

    name: int
    point: Point
    velocity_ne_m_s: Point
    radius_m: float
    sigma_m: float
    speed_sigma_m_s: float
    seen_s: float
    moving: bool

    @property
    def speed_m_s(self) -> float:
        """How fast it goes."""
        return math.hypot(*self.velocity_ne_m_s)


class LegKind(StrEnum):
    """By which navigation a piece of path was found."""

    STRAIGHT = "straight"
    TANGENT = "tangent"  # spherical navigation: tangent segment
    ARC = "arc"  # spherical navigation: geodesic on the keep-out sphere
    HYPERBOLA = "hyperbola"  # hyperbolic navigation: fly-by conic
    GEODESIC = "geodesic"  # geodesic of g = I / v^2 on the local grid


class Leg(msgspec.Struct, frozen=True):
    """One piece of a plan as a polyline (at least two points), with its keep-out radius."""

    kind: LegKind
    points: tuple[Point, ...]
    length_m: float
    keep_out_m: float


class Plan(msgspec.Struct, frozen=True, tag="plan"):
    """A path from where the vehicle was to the goal, free of everything known."""

    legs: tuple[Leg, ...]
    length_m: float
    keep_out_m: float
    environment: Environment
    obstacles: tuple[Obstacle, ...]
    rejected: tuple[tuple[Point, ...], ...] = ()
    """Candidates that were longer or blocked, for people to look at."""
    height_m: float | None = None
    """Above the take-off point: the height that all legs are flown at."""

    @property
    def points(self) -> tuple[Point, ...]:
        """The whole path as one polyline without repeated joints."""
        joined: list[Point] = []
        for leg in self.legs:
            joined.extend(leg.points if not joined else leg.points[1:])
        return tuple(joined)


class NoPlan(msgspec.Struct, frozen=True, tag="no_plan"):
    """Nothing known leads to the goal. `evidence` is the closed curve of hits that bars the way."""

    reason: str
    evidence: tuple[Point, ...]
    environment: Environment
    obstacles: tuple[Obstacle, ...]


# ---------------------------------------------------------------- the mission


class MissionState(StrEnum):
    """Where the mission is (autonomy/mission/README.md draws the machine)."""

    PREFLIGHT = "preflight"
    ARM = "arm"
    TAKEOFF = "takeoff"
    OFFBOARD = "offboard"
    CRUISE = "cruise"
    STOP = "stop"
    DETECT = "detect"
    REPLAN = "replan"
    FOLLOW = "follow"
    HOLD = "hold"
    RETURN = "return"
    LAND = "land"
    DONE = "done"
    YIELDED = "yielded"


class Ending(StrEnum):
    """How a mission ended; each has an exit code (autonomy/errors.py)."""

    GOAL_REACHED = "goal_reached"
    UNREACHABLE = "unreachable"
    ABORTED = "aborted"
    PREFLIGHT_REFUSED = "preflight_refused"
    OFFBOARD_REFUSED = "offboard_refused"
    LINK_LOST = "link_lost"
    FAILSAFE = "failsafe"
    BUDGET = "budget"
    TAKEN_OVER = "taken_over"
    INTERNAL = "internal"


class Outcome(msgspec.Struct, frozen=True):
    """The verdict: how it ended, in one sentence, and the evidence where there is any."""

    ending: Ending
    why: str
    evidence: tuple[Point, ...] = ()


class OperatorCommand(StrEnum):
    """What a person may ask for at any time."""

    STOP = "stop"  # stop, hold, then land; again: land at once
    HOLD = "hold"  # hold where you are until told something else
    RESUME = "resume"  # go on after HOLD
    LAND = "land"


class BeamWord(StrEnum):
    """The health of a range beam in a word; anything but OK is not believed."""

    OK = "ok"
    STALE = "stale"  # nothing was heard of it lately
    NO_SIGNAL = "no signal"  # it answers, and cannot measure
    TOO_NEAR = "too near"  # it sees something on its own lens
    STUCK = "stuck"  # it repeats itself while the vehicle moves
    SATURATED = "saturated"  # it says that nothing is there, and others see something
    JUMPING = "jumping"  # far noisier than it claims
    CROSS_TALK = "cross-talk"  # it repeats another beam
    INCONSISTENT = "inconsistent"  # it contradicts the others, or the vehicle's own motion


class BeamDoubt(msgspec.Struct, frozen=True):
    """A beam that is not believed since `since_s`; `why` is a sentence without its name.

    `covered_by`: the beam that the turning brings over its direction next, "" for none.
    """

    beam: str
    word: BeamWord
    since_s: float
    why: str
    covered_by: str = ""


class GuardReport(msgspec.Struct, frozen=True):
    """What the guard did to a setpoint. No violation: `limits` is empty, nothing was changed."""

    limits: tuple[str, ...] = ()
    speed_limit_m_s: float = 0.0
    free_distance_m: float = 0.0


class Inputs(msgspec.Struct, frozen=True):
    """Everything that one step may know. New readings only; the rest is the newest known."""

    now_s: float
    ranges: tuple[RangeReading, ...]
    local_position: LocalPosition | None
    attitude: Attitude | None
    gnss: GnssFix | None
    status: VehicleStatus
    facts: VehicleFacts | None = None
    replies: tuple[Reply, ...] = ()
    commands: tuple[OperatorCommand, ...] = ()
    guard: GuardReport | None = None
    """What the guard did to the setpoint of the step before."""


class Decision(msgspec.Struct, frozen=True):
    """Everything that one step decided. `plan` is set only on the step that made it."""

    now_s: float
    state: MissionState
    fused: FusedState | None
    setpoint: Setpoint | None
    requests: tuple[Request, ...] = ()
    events: tuple[Event, ...] = ()
    plan: Plan | NoPlan | None = None
    distance_to_go_m: float = 0.0
    clearance_m: float = 0.0
    speed_limit_m_s: float = 0.0
    stops: int = 0
    replans: int = 0
    outcome: Outcome | None = None
    height_m: float | None = None
    """The height of flight above the take-off point: being flown at, or changed to."""
    faults: tuple[str, ...] = ()
    """What counts as wrong (`mission.failsafe.Fault`), strongest response first."""
    walls: WallFixReport | None = None
    """What moved the mission frame; None before arming."""
    doubts: tuple[BeamDoubt, ...] = ()
    """The beams that are not believed now."""
    movers: tuple[MovingObstacle, ...] = ()
    """What is known to move, or new and not yet known to stand."""


class Crumb(msgspec.Struct, frozen=True):
    """One place of the way flown, in the mission frame: (north, east), height above the take-off
    point, and whether there was room around it.
    """

    point: Point
    height_m: float
    is_open: bool


class Resumed(msgspec.Struct, frozen=True):
    """Where a mission goes on whose program was killed in flight.

    `home_ned_m` is its frame's origin in the autopilot's local frame, `armed_s` when its time
    began, `goal_index` the next goal of its route, `trail` the way flown so far.
    """

    home_ned_m: Vector3
    armed_s: float
    goal_index: int = 0
    trail: tuple[Crumb, ...] = ()
    flown_m: float = 0.0


class Command(msgspec.Struct, frozen=True):
    """What leaves the pure core: the decision, and its setpoint as the guard let it pass.

    `setpoint` is in the mission frame, `wire_setpoint` in the autopilot's local frame.
    """

    decision: Decision
    setpoint: Setpoint | None
    wire_setpoint: Setpoint | None
    guard: GuardReport
