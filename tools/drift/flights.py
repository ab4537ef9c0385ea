"""One flight with a drifting estimate, with the fix or without it, and what it came to.

Levels of drift: `none`, `default` (the scenario's own), `double`, `px4` (2.5 cm and 2.5 cm/s for
3.5 s, as measured on PX4 main bb59c637cd, SIH quadrotor, 2026-11), `steady` (the default and
1 cm/s north all the time).
"""

import math
from collections.abc import Iterator, Sequence

import msgspec
import numpy as np

from autonomy.config import Config
from autonomy.mission.guarded import Command
from autonomy.model import MissionState
from autonomy.simulation import Simulation, goal_of, with_scenario
from hal.frames import Vector3
from hal.sim.scenario import BODY_HALF_HEIGHT_M, EstimatorSimulation, Scenario, with_faults
from tools.bench.flights import CLOSED_ROOMS, OPEN_ROOMS, scenario_of

ROOMS = ("sealed", "door", "divided", "u_trap", OPEN_ROOMS, CLOSED_ROOMS)
MODES = ("rolling", "stop")
_STILL = {"position_sigma_m": 0.0, "height_sigma_m": 0.0, "velocity_sigma_m_s": 0.0}
_DOUBLE = {"position_sigma_m": 0.04, "velocity_sigma_m_s": 0.02}
_PX4 = {"position_sigma_m": 0.025, "velocity_sigma_m_s": 0.025, "correlation_s": 3.5}
LEVELS: dict[str, dict[str, float]] = {
    "none": {**_STILL, "yaw_sigma_deg": 0.0},
    "default": {},
    "double": _DOUBLE,
    "px4": _PX4,
    "steady": {},
}
_STEADY = "position_drift@liftoff+5/3600:north_m_s=0.01"
_AROUND = frozenset({MissionState.TAKEOFF, MissionState.LAND, MissionState.DONE})
_AIRBORNE_M = 0.1
_NEAR_M = 0.45
_FAR_M = 9.0


class Case(msgspec.Struct, frozen=True):
    """One flight to be flown."""

    room: str
    level: str
    mode: str
    seed: int
    fixed: bool


class Row(msgspec.Struct, frozen=True):
    """What came of it.

    `clearance_m` is the least true one while flying, `landing_m` while landing (9: nothing
    near). Errors are the mission frame's against the room, in metres; `touch` says how it
    was at the nearest moment of a flight that touched.
    """

    case: Case
    ending: str
    collided: bool
    clearance_m: float
    landing_m: float
    goal_error_m: float
    error_rms_m: float
    navigation_s: float
    fused: int
    rejected: int
    touch: str = ""


class Book:
    """Collects the truth of a flight, tick by tick."""

    def __init__(self, explain_below_m: float) -> None:
        self._explain_below_m = explain_below_m
        self.errors: list[tuple[float, float]] = []
        """(s, m): how far the vehicle is from where it takes itself to be, while it flies."""
        self.clearance_m = {False: _FAR_M, True: _FAR_M}
        """By whether it was landing."""
        self.fused = self.rejected = 0
        self.touch = ""
        self._least_m = math.inf

    def note(self, simulation: Simulation, command: Command) -> None:
        """One tick."""
        decision, true = command.decision, simulation.vehicle.truth().position_ned_m
        if decision.walls is not None:
            self.fused, self.rejected = decision.walls.fused, decision.walls.rejected
        if decision.fused is None or -true[2] < _AIRBORNE_M:
            return
        taken = decision.fused.position_ned_m
        landing = decision.state is MissionState.LAND
        clear_m = simulation.world.clearance_m(true, BODY_HALF_HEIGHT_M)
        self.clearance_m[landing] = min(self.clearance_m[landing], clear_m)
        if decision.state not in _AROUND:
            self.errors.append((decision.now_s, math.hypot(taken[0] - true[0], taken[1] - true[1])))
        if clear_m < min(self._least_m, self._explain_below_m):
            self._least_m = clear_m
            self.touch = _moment(simulation, command, true, taken)


def _moment(simulation: Simulation, command: Command, true: Vector3, taken: Vector3) -> str:
    """Where the vehicle was and took itself to be, and where the map had the wall."""
    world, decision = simulation.world, command.decision
    hits = np.array(simulation.guarded.pilot.sensing.map.hits()).reshape(-1, 2)
    near = hits[np.hypot(*(hits - true[:2]).T) < _NEAR_M]
    off = [world.clearance_m((n, e, true[2]), BODY_HALF_HEIGHT_M) for n, e in near.tolist()]
    map_m = simulation.guarded.pilot.sensing.map.clearance_m(taken, 1.0)
    clear_m = world.clearance_m(true, BODY_HALF_HEIGHT_M)
    found = f"{100.0 * float(np.mean(off)):.1f} cm before the walls" if off else "none near"
    drift = simulation.vehicle.autopilot.estimate_offset.position_ned_m
    offset = decision.walls.offset_ne_m if decision.walls is not None else (0.0, 0.0)
    return (
        f"{decision.state.value} at {decision.now_s:.1f} s, {-true[2]:.2f} m high: clearance "
        f"{clear_m:.3f} m, by the map {map_m:.3f} m; at ({true[0]:.3f}, {true[1]:.3f}), taken for "
        f"({taken[0]:.3f}, {taken[1]:.3f}); autopilot off by ({drift[0]:.3f}, {drift[1]:.3f}), of "
        f"which known ({offset[0]:.3f}, {offset[1]:.3f}); hits {found}; guard: "
        f"{', '.join(command.guard.limits) or 'no limit'}"
    )


def drifting(scenario: Scenario, level: str) -> Scenario:
    """The scenario with an estimate that is wrong by that level."""
    estimator = EstimatorSimulation.model_validate(
        {**scenario.estimator.model_dump(), **LEVELS[level]}
    )
    changed = scenario.model_copy(update={"estimator": estimator})
    return with_faults(changed, (_STEADY,)) if level == "steady" else changed


def fly(case: Case) -> Row:
    """Fly one case; deterministic."""
    return flown(case)[0]


def flown(case: Case, explain_below_m: float | None = None) -> tuple[Row, Book]:
    """The same, with what was collected on the way; explained is by default what touches."""
    scenario = drifting(scenario_of(case.room, case.seed), case.level)
    document = {
        "mission": {"replan": {"mode": case.mode}},
        "estimation": {"walls": {"use": case.fixed}},
    }
    config = with_scenario(Config.model_validate(document), scenario)
    simulation = Simulation(scenario, config, (goal_of(scenario, config),), case.seed)
    below_m = scenario.vehicle.body_radius_m if explain_below_m is None else explain_below_m
    book = Book(below_m)
    flight = simulation.run(on_tick=book.note)
    errors = np.array([error for _, error in book.errors] or [0.0])
    row = Row(
        case,
        flight.outcome.ending.value,
        flight.collided,
        book.clearance_m[False],
        book.clearance_m[True],
        flight.final_error_m,
        math.sqrt(float(np.mean(errors**2))),
        flight.navigation_time_s,
        book.fused,
        book.rejected,
        book.touch if flight.collided else "",
    )
    return row, book


def cases(
    rooms: Sequence[str], levels: Sequence[str], modes: Sequence[str], flights: int, first: int
) -> Iterator[Case]:
    """Every combination, with the fix and without it, seed by seed."""
    for seed in range(first, first + flights):
        for level in levels:
            for room in rooms:
                for mode in modes:
                    for fixed in (True, False):
                        yield Case(room, level, mode, seed, fixed)
