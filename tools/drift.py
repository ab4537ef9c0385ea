"""What the fix by known walls is worth: flights with a drifting estimate, with it and without it.

python -m tools.drift [--room NAME ...] [--flights N] [--drift LEVEL ...] [--mode MODE ...]

Prints one line per flight that touched, then a Markdown table. Levels: `none`, `default`, `double`
(of the scenario's default), `px4` (2.5 cm and 2.5 cm/s for 3.5 s, as measured on PX4 main
bb59c637cd, SIH quadrotor, 2026-11), `steady` (the default and 1 cm/s north all the time).
"""

import argparse
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from autonomy.config import Config
from autonomy.mission.guarded import Command
from autonomy.model import MissionState
from autonomy.simulation import Simulation, goal_of, with_scenario
from autonomy.warm import warm_up
from hal.sim.scenario import EstimatorSimulation, Scenario, with_faults
from tools.bench.flights import OPEN_ROOMS, scenario_of

ROOMS = ("sealed", "door", "u_trap", OPEN_ROOMS)
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
_FLYING = frozenset(MissionState) - {MissionState.TAKEOFF, MissionState.LAND, MissionState.DONE}


@dataclass(frozen=True)
class Case:
    """One flight to be flown."""

    room: str
    level: str
    mode: str
    seed: int
    fixed: bool


@dataclass(frozen=True)
class Flown:
    """What came of it. Position errors are the mission frame's against the room, in metres."""

    case: Case
    ending: str
    collided: bool
    clearance_m: float
    goal_error_m: float
    errors_m: tuple[float, ...]
    simulated_s: float
    wall_s: float
    fused: int
    rejected: int


@dataclass
class ErrorBook:
    """Collects how far the vehicle is from where it takes itself to be, five times a second."""

    errors_m: list[float] = field(default_factory=list)
    fused: int = 0
    rejected: int = 0
    _ticks: int = 0

    def note(self, simulation: Simulation, command: Command) -> None:
        """One tick."""
        decision = command.decision
        self._ticks += 1
        if decision.walls is not None:
            self.fused, self.rejected = decision.walls.fused, decision.walls.rejected
        if decision.fused is None or decision.height_m is None or self._ticks % 4:
            return
        true, taken = simulation.vehicle.truth().position_ned_m, decision.fused.position_ned_m
        if decision.state in _FLYING:
            self.errors_m.append(math.hypot(taken[0] - true[0], taken[1] - true[1]))


def drifting(scenario: Scenario, level: str) -> Scenario:
    """The scenario with an estimate that is wrong by that level."""
    estimator = EstimatorSimulation.model_validate(
        {**scenario.estimator.model_dump(), **LEVELS[level]}
    )
    changed = scenario.model_copy(update={"estimator": estimator})
    return with_faults(changed, (_STEADY,)) if level == "steady" else changed


def fly(case: Case) -> Flown:
    """Fly one case; deterministic."""
    scenario = drifting(scenario_of(case.room, case.seed), case.level)
    document = {
        "mission": {"replan": {"mode": case.mode}},
        "estimation": {"walls": {"use": case.fixed}},
    }
    config = with_scenario(Config.model_validate(document), scenario)
    simulation = Simulation(scenario, config, (goal_of(scenario, config),), case.seed)
    book = ErrorBook()
    flight = simulation.run(on_tick=book.note)
    return Flown(
        case,
        flight.outcome.ending.value,
        flight.collided,
        flight.true_clearance_m,
        flight.final_error_m,
        tuple(book.errors_m),
        flight.simulated_s,
        flight.wall_s,
        book.fused,
        book.rejected,
    )


def cases(
    rooms: Sequence[str], levels: Sequence[str], modes: Sequence[str], flights: int, first: int
) -> Iterator[Case]:
    """Every combination, with the fix and without it."""
    for level in levels:
        for room in rooms:
            for mode in modes:
                for seed in range(first, first + flights):
                    for fixed in (True, False):
                        yield Case(room, level, mode, seed, fixed)


def table(flown: Sequence[Flown]) -> str:
    """Markdown: one line per level, room and mode, each with the fix and without it."""
    lines = [
        (
            "| drift | room | mode | walls | flights | goal | touched | least clearance m "
            "| median m | position error cm rms | p95 | goal error cm median | p95 |"
        ),
        f"|{'---|' * 13}",
    ]
    keys = dict.fromkeys((f.case.level, f.case.room, f.case.mode, f.case.fixed) for f in flown)
    for key in keys:
        mine = [f for f in flown if (f.case.level, f.case.room, f.case.mode, f.case.fixed) == key]
        errors = np.array([e for f in mine for e in f.errors_m] or [0.0])
        goals = np.array([f.goal_error_m for f in mine if f.ending == "goal_reached"] or [np.nan])
        clearances = [f.clearance_m for f in mine]
        lines.append(
            f"| {key[0]} | {key[1]} | {key[2]} | {'yes' if key[3] else 'no'} | {len(mine)} "
            f"| {sum(f.ending == 'goal_reached' for f in mine)} | {sum(f.collided for f in mine)} "
            f"| {min(clearances):.3f} | {float(np.median(clearances)):.3f} "
            f"| {100.0 * math.sqrt(float(np.mean(errors**2))):.1f} "
            f"| {100.0 * float(np.percentile(errors, 95)):.1f} "
            f"| {100.0 * float(np.median(goals)):.1f} "
            f"| {100.0 * float(np.percentile(goals, 95)):.1f} |"
        )
    return "\n".join(lines)


def main() -> None:
    """Parse, fly, print."""
    parser = argparse.ArgumentParser(
        description=__doc__, allow_abbrev=False, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--room", action="append", help=f"default: {', '.join(ROOMS)}")
    parser.add_argument("--drift", action="append", choices=tuple(LEVELS), help="default: px4")
    parser.add_argument("--mode", action="append", choices=MODES, help="default: both")
    parser.add_argument("--flights", type=int, default=10, help="of each room, level and mode")
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--only", choices=("with", "without"), help="fly one side alone")
    options = parser.parse_args()
    warm_up()
    flown = []
    for case in cases(
        options.room or ROOMS,
        options.drift or ("px4",),
        options.mode or MODES,
        options.flights,
        options.first_seed,
    ):
        if options.only is not None and case.fixed != (options.only == "with"):
            continue
        flown.append(fly(case))
        if flown[-1].collided:
            print(f"touched: {case}, {flown[-1].clearance_m:.3f} m", flush=True)
    print(table(flown))


if __name__ == "__main__":
    main()
