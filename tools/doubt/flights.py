"""One simulated flight with at most one fault of one beam, and what the doubt made of it."""

import math
from collections.abc import Iterator

import msgspec
import numpy as np

from autonomy.config import Config
from autonomy.mission.guarded import Command
from autonomy.model import MissionState
from autonomy.simulation import Simulation, goal_of, with_scenario
from hal.sim.scenario import load_scenario, with_faults

ROOMS = ("default", "door", "u_trap", "empty", "low_wall", "curtain")
_WEIGHTS = (0.35, 0.15, 0.25, 0.15, 0.05, 0.05)
"""Of the rooms, in flights with a fault: over and under takes three times as long."""
MODES = ("stop", "rolling")
HALF_ANGLES_DEG = (0.0, 12.5)
BEAMS = ("front", "right", "back", "left", "up", "down")
KINDS = (
    "beam_silence",
    "beam_slow:rate_hz=2",
    "beam_dropout",
    "beam_blocked",
    "beam_stuck",
    "beam_constant",
    "beam_constant:range_m=0.4",
    "beam_noise:sigma_m=0.15",
    "beam_jump",
    "beam_crosstalk",
    "beam_bias:bias_m=0.3",
    "beam_bias:bias_m=-0.2",
    "beam_variance",
)
_EARLIEST_S, _LATEST_S = 1.0, 30.0
_ON_THE_WAY = frozenset(
    {
        MissionState.TAKEOFF,
        MissionState.OFFBOARD,
        MissionState.CRUISE,
        MissionState.STOP,
        MissionState.DETECT,
        MissionState.REPLAN,
        MissionState.FOLLOW,
        MissionState.HOLD,
    }
)


class Case(msgspec.Struct, frozen=True):
    """What to fly; the fault begins `at_s` after lift-off, and `kind` is "" for none."""

    room: str
    mode: str
    half_angle_deg: float
    seed: int
    kind: str = ""
    beam: str = ""
    at_s: float = 0.0

    @property
    def fault(self) -> str:
        """The fault as one line."""
        name, _, keys = self.kind.partition(":")
        more = [f"beam={self.beam}", keys] if keys else [f"beam={self.beam}"]
        if name == "beam_crosstalk":
            more.append("other=" + BEAMS[(BEAMS.index(self.beam) + 1) % 4])
        return f"{name}@liftoff+{self.at_s:g}:{','.join(more)}"


class Row(msgspec.Struct, frozen=True):
    """How it went. `doubts` are (time, beam, word) of every beam newly doubted on the way.

    `delay_s`: from the fault to the doubt of its beam, None for none; `active_s`: how long the
    fault was there before the landing began; `altered_s`: of that, for how long its readings were
    otherwise than without the fault.
    """

    case: Case
    ending: str
    why: str
    on_ground: bool
    collided: bool
    clearance_m: float
    airborne_s: float
    began_s: float
    active_s: float
    delay_s: float | None
    word: str
    doubts: tuple[tuple[float, str, str], ...]
    altered_s: float = math.inf


class _Watch:
    """Notes when which beam is doubted."""

    def __init__(self, beam: str) -> None:
        self._beam = beam
        self.spoilt = 0
        self.liftoff_s: float | None = None
        self.last_s = 0.0
        self.doubts: list[tuple[float, str, str]] = []
        self._known: frozenset[str] = frozenset()

    def note(self, simulation: Simulation, command: Command) -> None:
        decision = command.decision
        if decision.state not in _ON_THE_WAY:
            return
        if self.liftoff_s is None and not simulation.vehicle.truth().on_ground:
            self.liftoff_s = decision.now_s
        self.last_s = decision.now_s
        if self._beam:
            self.spoilt = simulation.spoilt_readings(self._beam)
        if not decision.doubts and not self._known:
            return
        self.doubts += [
            (round(decision.now_s, 3), doubt.beam, doubt.word.value)
            for doubt in decision.doubts
            if doubt.beam not in self._known
        ]
        self._known = frozenset(doubt.beam for doubt in decision.doubts)


def fly(case: Case, *, doubting: bool = True) -> Row:
    """Fly one case; `doubting` False: only silent beams are doubted, as a measure of what it is
    good for.
    """
    scenario = load_scenario(case.room)
    beams = scenario.beams.model_copy(update={"half_angle_deg": case.half_angle_deg})
    scenario = scenario.model_copy(update={"beams": beams})
    if case.kind:
        scenario = with_faults(scenario, [case.fault])
    keys = {"mission": {"replan": {"mode": case.mode}}, "failsafe": {"doubt_beams": doubting}}
    config = with_scenario(Config.model_validate(keys), scenario)
    simulation = Simulation(scenario, config, (goal_of(scenario, config),), case.seed)
    watch = _Watch(case.beam)
    flight = simulation.run(on_tick=watch.note)
    liftoff_s = watch.liftoff_s if watch.liftoff_s is not None else watch.last_s
    began_s = liftoff_s + case.at_s
    own = [d for d in watch.doubts if d[1] == case.beam and d[0] >= began_s] if case.kind else []
    return Row(
        case,
        flight.outcome.ending.value,
        flight.outcome.why,
        simulation.vehicle.truth().on_ground,
        flight.collided,
        round(flight.true_clearance_m, 4),
        round(watch.last_s - liftoff_s, 2),
        round(began_s, 2),
        round(max(0.0, watch.last_s - began_s), 2) if case.kind else 0.0,
        round(own[0][0] - began_s, 2) if own else None,
        own[0][2] if own else "",
        tuple(watch.doubts),
        round(watch.spoilt / scenario.beams.rate_hz, 2),
    )


def healthy(seeds: int) -> Iterator[Case]:
    """Flights without a fault: every room, mode and width of beam with `seeds` seeds."""
    for seed in range(seeds):
        for room in ROOMS:
            for mode in MODES:
                for half_angle_deg in HALF_ANGLES_DEG:
                    yield Case(room, mode, half_angle_deg, seed)


def faulty(count: int, seed: int = 0) -> Iterator[Case]:
    """`count` flights with one fault each: all kinds on all beams in turn, the rest by chance."""
    rng = np.random.default_rng(seed)
    for number in range(count):
        yield Case(
            room=str(rng.choice(ROOMS, p=_WEIGHTS)),
            mode=MODES[int(rng.integers(2))],
            half_angle_deg=HALF_ANGLES_DEG[int(rng.integers(2))],
            seed=int(rng.integers(1_000_000)),
            kind=KINDS[number % len(KINDS)],
            beam=BEAMS[number // len(KINDS) % len(BEAMS)],
            at_s=round(float(rng.uniform(_EARLIEST_S, _LATEST_S)), 2),
        )
