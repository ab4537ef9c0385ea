"""One room flown: what came of it, and whether that breaks a promise."""

import traceback

import msgspec
import numpy as np

from autonomy.config import Config
from autonomy.model import Ending
from autonomy.planning import outline_hits
from autonomy.simulation import SimulatedFlight, Simulation, goal_of
from autonomy.t3drm.spherical import Route, fence_planes, shortest_path
from hal.sim.scenario import Scenario
from tools.bench.rooms import OUTLINE_M, SENSING_M, passage_m, shipped_config
from tools.hunt.genome import decoded

_VERDICTS = (Ending.GOAL_REACHED, Ending.UNREACHABLE)
_STOPPED = (Ending.FAILSAFE, Ending.LINK_LOST, Ending.TAKEN_OVER)
"""How a flight may end where something fails."""
_OUTLINE_M = 0.03


class Trial(msgspec.Struct, frozen=True):
    """One room and its flight. `failure` is empty, or which promise was broken.

    `optimum_m` is the shortest way for the body with everything known, at the height of the
    flight; None where there is none. `error` is the end of a traceback.
    """

    name: str
    vector: tuple[float, ...]
    ending: str
    failure: str
    clearance_m: float
    length_m: float
    optimum_m: float | None
    navigation_s: float
    stops: int
    replans: int
    mode: str
    faults: tuple[str, ...]
    error: str = ""

    @property
    def detour(self) -> float:
        """Flown way over the shortest one, 0 where the goal was not reached or is over a wall."""
        if self.ending != Ending.GOAL_REACHED or not self.optimum_m:
            return 0.0
        return self.length_m / self.optimum_m


def flown(vector: tuple[float, ...], name: str) -> Trial:
    """Decode a room and fly it once; the seed of the flight's noise is 0."""
    scenario, mode = decoded(vector, name)
    return fly(scenario, mode, name, vector)


def fly(scenario: Scenario, mode: str, name: str, vector: tuple[float, ...] = ()) -> Trial:
    """Fly a scenario to its goal and judge the flight."""
    config = shipped_config(scenario, mode)
    flight, error = None, ""
    try:
        flight = Simulation(scenario, config, (goal_of(scenario, config),)).run()
    except Exception:  # noqa: BLE001  a room in which the pilot raises is what is looked for
        error = "".join(traceback.format_exc().splitlines(keepends=True)[-6:])
    kinds = tuple(fault.model_dump()["kind"] for fault in scenario.faults)
    if flight is None:
        nothing = (0.0, 0.0, optimum_m(scenario, config), 0.0, 0, 0)
        return Trial(name, vector, "raised", "raised", *nothing, mode, kinds, error)
    return Trial(
        name,
        vector,
        flight.outcome.ending.value,
        judged(flight, scenario, config),
        flight.true_clearance_m,
        flight.path_length_m,
        optimum_m(scenario, config),
        flight.navigation_time_s,
        flight.stops,
        flight.replans,
        mode,
        kinds,
    )


def judged(flight: SimulatedFlight, scenario: Scenario, config: Config) -> str:
    """Which promise a flight broke; empty when none.

    `collision`: the body touched something. `no verdict`: it ended by the time limit, an internal
    error, or a failsafe although nothing failed. `wrong verdict`: unreachable was said of a goal
    that a body with its keep-out, and as much again as sensing may take, can be slid to.
    """
    ending = flight.outcome.ending
    if flight.collided:
        return "collision"
    allowed = _VERDICTS + (_STOPPED if scenario.faults else ())
    if ending not in allowed:
        return "no verdict"
    if ending is Ending.UNREACHABLE and not scenario.faults:
        floor_m = config.body.radius_m + config.planner.hard_clearance_m + SENSING_M
        if passage_m(scenario, config) >= floor_m:
            return "wrong verdict"
    return ""


def optimum_m(scenario: Scenario, config: Config) -> float | None:
    """The shortest way of the body's disc at the mission's height; None where there is none."""
    hits = np.array(outline_hits(scenario, config, _OUTLINE_M), dtype=np.float64).reshape(-1, 2)
    planes = fence_planes(scenario.fence.outline_ne_m)
    if planes is None:
        raise ValueError(f"{scenario.name}: the fence is not convex")
    radii = np.full(hits.shape[0], config.body.radius_m + OUTLINE_M)
    route = shortest_path((0.0, 0.0), scenario.goal_ne_m, hits, radii, planes)
    return route.length_m if isinstance(route, Route) else None
