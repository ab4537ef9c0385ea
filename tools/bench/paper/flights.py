"""The paper's scenarios flown: ideally, with a real vehicle's response and noise, over MAVSDK.

Every flight is measured alike, on what the pilot believed of its position: all that a real one
has. `navigation`: from the end of the take-off until the landing begins.
"""

import json
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path

import msgspec

from autonomy.flightlog.reader import FlightLog
from autonomy.geometry import Point, distance
from autonomy.model import Decision, MissionState
from autonomy.simulation import Simulation, goal_of
from hal.sim.scenario import Scenario, load_scenario
from tools.bench.paper.ideal import without_error
from tools.bench.rooms import shipped_config

FOLDER = Path(__file__).parent
SCENARIOS = (1, 2, 3, 4, 5)
IDEAL, SIMULATED, MAVSDK = "ideal", "simulated", "mavsdk"
"""Perfect sensors and an obedient vehicle; measured response and noise, in process; the same over
MAVSDK, MAVLink and the mock PX4, in real time."""
MODES = ("stop", "rolling")
STEP_M = 0.03
"""Steps shorter than the noise would add up to a length that nobody flew (as in the reports)."""
LIMIT_S = 900.0
_AROUND = frozenset({MissionState.TAKEOFF, MissionState.LAND, MissionState.DONE})
_BEFORE = frozenset({MissionState.PREFLIGHT, MissionState.ARM})


class Case(msgspec.Struct, frozen=True):
    """One flight to be flown."""

    scenario: int
    how: str
    mode: str
    seed: int


class Row(msgspec.Struct, frozen=True):
    """What came of it. `clearance_m` is the least true one from the vehicle's centre."""

    case: Case
    ending: str
    length_m: float
    navigation_s: float
    stops: int
    replans: int
    clearance_m: float | None
    planning_s: tuple[float, ...] = ()
    """The computing time of each replan."""
    track: tuple[Point, ...] = ()


class Navigation:
    """Adds up the way and the time of the navigation, decision by decision."""

    def __init__(self) -> None:
        self.length_m = 0.0
        self.track: list[Point] = []
        self.stops = self.replans = 0
        self._first_s: float | None = None
        self._last_s = 0.0

    @property
    def seconds(self) -> float:
        """How long it has taken so far."""
        return self._last_s - self._first_s if self._first_s is not None else 0.0

    def note(self, decision: Decision) -> None:
        """One tick."""
        self.stops, self.replans = decision.stops, decision.replans
        if decision.state in _AROUND or decision.state in _BEFORE or decision.fused is None:
            return
        if self._first_s is None:
            self._first_s = decision.now_s
            self.track.append(decision.fused.point)
        self._last_s = decision.now_s
        step_m = distance(self.track[-1], decision.fused.point)
        if step_m > STEP_M:
            self.length_m += step_m
            self.track.append(decision.fused.point)


def scenario_path(number: int) -> Path:
    """The file of a reconstruction."""
    return FOLDER / f"scenario_{number}.yaml"


def scenario_of(number: int) -> Scenario:
    """One of the five reconstructions."""
    return load_scenario(str(scenario_path(number)))


def cases(hows: Iterable[str], modes: Iterable[str], trials: int) -> Iterator[Case]:
    """The flights of Tables 4 and 5; the ideal one has no chance in it and is flown once."""
    for scenario in (1, 2):
        for mode in modes:
            for how in hows:
                for seed in range(1 if how == IDEAL else trials):
                    yield Case(scenario, how, mode, seed)


def fly(case: Case, *, logs: Path | None = None) -> Row:
    """One flight; over MAVSDK its log is kept in `logs`, if that is given.

    Raises RuntimeError, with its last words, when a flight over MAVSDK leaves no report.
    """
    if case.how == MAVSDK:
        return _over_mavsdk(case, logs)
    scenario = scenario_of(case.scenario)
    if case.how == IDEAL:
        scenario = without_error(scenario)
    config = shipped_config(scenario, case.mode)
    simulation = Simulation(scenario, config, (goal_of(scenario, config),), case.seed)
    seen = Navigation()
    flight = simulation.run(on_tick=lambda _, command: seen.note(command.decision))
    timing = flight.timing
    return Row(
        case,
        flight.outcome.ending.value,
        seen.length_m,
        seen.seconds,
        seen.stops,
        seen.replans,
        flight.true_clearance_m,
        tuple(r.seconds for r in timing.replans) if timing is not None else (),
        tuple(seen.track),
    )


def _over_mavsdk(case: Case, logs: Path | None) -> Row:
    """`autonomy fly --sim` as a process of its own, as a person starts it; about a minute."""
    with tempfile.TemporaryDirectory(prefix="paper-") as temporary:
        folder = logs if logs is not None else Path(temporary)
        command = [sys.executable, "-m", "autonomy.cli", "fly", "--json", "--mode", case.mode]
        command += ["--sim", str(scenario_path(case.scenario)), "--seed", str(case.seed)]
        command += ["--log-dir", str(folder)]
        done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=LIMIT_S)
        last = (done.stdout.strip().splitlines() or [""])[-1]
        report = json.loads(last) if last.startswith("{") else {}
        if report.get("type") != "report" or not report.get("log_path"):
            said = (done.stderr.strip().splitlines() or ["it said nothing"])[-1]
            raise RuntimeError(f"the flight {case} left no report: {said}")
        return _row_of(case, report)


def _row_of(case: Case, report: dict[str, object]) -> Row:
    """The row of a flight from its report and its log."""
    seen = Navigation()
    for tick in FlightLog.open(Path(str(report["log_path"]))):
        seen.note(tick.command.decision)
    clearance_m = report.get("minimum_clearance_m")
    return Row(
        case,
        str(report["ending"]),
        seen.length_m,
        seen.seconds,
        seen.stops,
        seen.replans,
        clearance_m if isinstance(clearance_m, float) else None,
        (),
        tuple(seen.track),
    )
