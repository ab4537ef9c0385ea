"""What was asked of a flight, and what became of it: the two records at the ends of `app.fly`."""

import msgspec

from autonomy.errors import ExitCode
from autonomy.model import Ending
from hal.frames import Vector3

EXIT_CODES: dict[Ending, ExitCode] = {
    Ending.GOAL_REACHED: ExitCode.GOAL_REACHED,
    Ending.UNREACHABLE: ExitCode.UNREACHABLE,
    Ending.ABORTED: ExitCode.ABORTED,
    Ending.PREFLIGHT_REFUSED: ExitCode.PREFLIGHT_REFUSED,
    Ending.OFFBOARD_REFUSED: ExitCode.OFFBOARD_REFUSED,
    Ending.LINK_LOST: ExitCode.LINK_LOST,
    Ending.FAILSAFE: ExitCode.FAILSAFE,
    Ending.BUDGET: ExitCode.BUDGET,
    Ending.TAKEN_OVER: ExitCode.TAKEN_OVER,
    Ending.INTERNAL: ExitCode.INTERNAL,
}


class FlyOptions(msgspec.Struct, frozen=True):
    """`autonomy fly` as it was typed. Exactly one of `scenario` and `connection` is given.

    `goals` are as typed, in `frame`; a goal without a third coordinate has None there.
    """

    goals: tuple[tuple[float, float, float | None], ...]
    frame: str = "ned"
    altitude_m: float | None = None
    land: bool | None = None
    scenario: str | None = None
    connection: str | None = None
    config_path: str | None = None
    seed: int = 0
    output: str = "auto"
    log_dir: str | None = None
    log: bool = True
    time_limit_s: float | None = None
    mode: str | None = None


class FlightReport(msgspec.Struct, frozen=True):
    """What a flight was. Lengths in metres, times in seconds.

    `minimum_clearance_m` is from the vehicle's centre to the nearest surface: the true one from
    the simulated world when `clearance_is_true`, else the nearest mapped hit.
    `planning_s` is the computing time of each replan (Algorithm 1's record).
    """

    ending: Ending
    why: str
    exit_code: int
    route_ned_m: tuple[Vector3, ...]
    flight_time_s: float = 0.0
    path_length_m: float = 0.0
    straight_length_m: float = 0.0
    stops: int = 0
    replans: int = 0
    minimum_clearance_m: float | None = None
    clearance_is_true: bool = False
    body_radius_m: float = 0.15
    max_speed_m_s: float = 0.0
    planning_s: tuple[float, ...] = ()
    time_record: str = ""
    leg_kinds: tuple[str, ...] = ()
    """The kinds of legs that were flown, in the order of their first use."""
    guard_limits: dict[str, int] = {}
    """How many ticks each rule of the guard changed the setpoint."""
    late_ticks: int = 0
    events: tuple[tuple[float, str, str], ...] = ()
    log_path: str | None = None
    log_notes: tuple[str, ...] = ()
    seed: int | None = None
    scenario: str | None = None
