"""One flight of a campaign. Deterministic: a case and a commit make a row, timing apart."""

import functools
import hashlib
import time
import traceback
from pathlib import Path
from typing import NamedTuple

import msgspec
import numpy as np

from autonomy.config import Config
from autonomy.errors import BadInput
from autonomy.mission.guarded import Command
from autonomy.model import Inputs
from autonomy.simulation import Flyer, SimulatedFlight, Simulation, goal_of
from hal.frames import Vector3
from hal.sim.scenario import Scenario
from tools.bench import rivals
from tools.bench.campaign.arena import arena
from tools.bench.campaign.case import Case, Row
from tools.bench.campaign.models import with_models
from tools.bench.rivals import config_of, flyer
from tools.versions import versions

RAISED = "raised"
_TRACEBACK_LINES = 3


class Flown(NamedTuple):
    """A row with what is too much for a table; no flight where something raised."""

    row: Row
    scenario: Scenario
    flight: SimulatedFlight | None


class _Timed:
    """A flyer with a stopwatch: every step's CPU time is added to `steps_s`."""

    def __init__(self, flyer: Flyer, steps_s: list[float]) -> None:
        self._flyer = flyer
        self._steps_s = steps_s

    @property
    def goal(self) -> Vector3:
        """The flyer's."""
        return self._flyer.goal

    def step(self, inputs: Inputs) -> Command:
        """The flyer's."""
        began_s = time.thread_time()
        command = self._flyer.step(inputs)
        self._steps_s.append(time.thread_time() - began_s)
        return command


def fly(case: Case, barn: Path | None = None) -> Row:
    """The row of one case; what is raised in flight, or in making its world, is in the row."""
    try:
        scenario, config = scene(case, barn)
    except BadInput as error:
        return _without_world(case, str(error))
    return _flown_in(case, barn, scenario, config).row


def _without_world(case: Case, why: str) -> Row:
    """A world that cannot be made, or not be measured, does not end a campaign."""
    family, _, number = case.world.partition(":")
    return Row(
        **msgspec.structs.asdict(case),
        family=family,
        number=int(number) if number.isdecimal() else -1,
        reachable=False,
        optimum_m=None,
        passage_m=0.0,
        keep_out_m=0.0,
        speed_max_m_s=0.0,
        ending=RAISED,
        why=why,
        collided=False,
        clearance_m=None,
        **msgspec.structs.asdict(versions()),
        scenario="",
        config="",
    )


def flown(case: Case, barn: Path | None = None) -> Flown:
    """The same, with track and world."""
    return _flown_in(case, barn, *scene(case, barn))


def _flown_in(case: Case, barn: Path | None, scenario: Scenario, config: Config) -> Flown:
    if not case.planner.startswith("t3drm-"):
        _rivals_compiled()
    began_s, flight, raised = time.process_time(), None, ""
    steps: list[float] = []
    try:
        flight = _simulated(case, scenario, config, steps)
    except Exception:  # noqa: BLE001  the other flights go on, and the row tells
        raised = " / ".join(traceback.format_exc().splitlines()[-_TRACEBACK_LINES:])
    row = _row(case, barn, scenario, config, flight, raised)
    taken_us = 1e6 * np.array(steps or [0.0])
    timed = msgspec.structs.replace(
        row,
        ticks=len(steps),
        step_us=float(taken_us.mean()),
        step_p99_us=float(np.percentile(taken_us, 99)),
        cpu_s=time.process_time() - began_s,
    )
    return Flown(timed, scenario, flight)


@functools.cache
def _rivals_compiled() -> None:
    """Before the first of them flies in a process: compiling is none of its time."""
    rivals.warm_up()


def scene(case: Case, barn: Path | None = None) -> tuple[Scenario, Config]:
    """What a case is flown in and with."""
    scenario = with_models(arena(case.world, barn).scenario, case.sensors, case.response)
    return scenario, config_of(case.planner, scenario)


def _simulated(
    case: Case, scenario: Scenario, config: Config, steps: list[float]
) -> SimulatedFlight:
    route = (goal_of(scenario, config),)
    timed = _Timed(flyer(case.planner, config, route), steps)
    return Simulation(scenario, config, route, case.seed, flyer=timed).run()


def _row(
    case: Case,
    barn: Path | None,
    scenario: Scenario,
    config: Config,
    flight: SimulatedFlight | None,
    raised: str,
) -> Row:
    place = arena(case.world, barn)
    row = msgspec.structs.replace(
        _without_world(case, raised),
        family=place.family,
        number=place.number,
        reachable=place.truth.reachable,
        optimum_m=place.truth.optimum_m,
        passage_m=place.truth.passage_m,
        keep_out_m=config.body.radius_m + config.planner.hard_clearance_m,
        speed_max_m_s=config.guidance.speed_max_m_s,
        scenario=digest(scenario.model_dump_json()),
        config=config_digest(config),
    )
    return row if flight is None else _with_flight(row, flight)


def _with_flight(row: Row, flight: SimulatedFlight) -> Row:
    return msgspec.structs.replace(
        row,
        ending=flight.outcome.ending.value,
        why=flight.outcome.why,
        collided=flight.collided,
        clearance_m=_finite(flight.true_clearance_m),
        length_m=flight.path_length_m,
        navigation_s=flight.navigation_time_s,
        climb_s=flight.climb_time_s,
        flight_s=flight.flight_time_s,
        simulated_s=flight.simulated_s,
        stops=flight.stops,
        replans=flight.replans,
        side_changes=flight.side_changes,
        height_changes=flight.height_changes,
        final_error_m=_finite(flight.final_error_m),
        speed_reached_m_s=flight.max_speed_m_s,
    )


def placeless(config: Config) -> Config:
    """The configuration without its world's fence, the only thing that differs by world."""
    guard = config.guard.model_copy(update={"fence": Config().guard.fence})
    return config.model_copy(update={"guard": guard})


def config_digest(config: Config) -> str:
    """Of `placeless`."""
    return digest(placeless(config).model_dump_json())


def digest(text: str) -> str:
    """Twelve letters that tell texts apart."""
    return hashlib.sha256(text.encode()).hexdigest()[:12]


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None
