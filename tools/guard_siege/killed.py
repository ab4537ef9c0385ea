"""The program killed in flight, again and again, in simulated rooms: does the vehicle touch?

At every moment that is looked at, a twin of the simulated vehicle loses its stream for good and
flies on by itself, with PX4's failsafe, to rest; the flight itself goes on as if nothing had been.
"""

import copy
import math
from dataclasses import dataclass

from autonomy.config import Config
from autonomy.mission.guarded import Command
from autonomy.mission.machine import NAVIGATING_STATES
from autonomy.simulation import Simulation, goal_of, with_scenario
from hal.frames import horizontal_norm, subtract
from hal.sim.scenario import Scenario
from hal.vehicle.guard import Guard
from tools.bench.rooms import room

EVERY_S = 1.0
NEAR_EVERY_S = 0.2
"""Where the guard limits the speed for want of room, more often."""
TO_REST_S = 4.0
SLOWEST_M_S = 0.03
_STEP_S = 0.05


@dataclass(frozen=True)
class Death:
    """One moment at which the program died. Clearances are true ones, of the vehicle's centre."""

    at_s: float
    speed_m_s: float
    """The fastest from then on: it may die while it is still speeding up."""
    free_m: float
    travelled_m: float
    clearance_m: float
    """The least from then on."""


def deaths_in_room(number: int, seed: int = 0, *, mode: str = "rolling") -> list[Death]:
    """Fly a random room and die at its worst moments."""
    return deaths_in(room(number), seed, mode=mode)


def deaths_in(scenario: Scenario, seed: int = 0, *, mode: str = "rolling") -> list[Death]:
    """Fly a scenario and die at its worst moments."""
    config = Config.model_validate({"mission": {"replan": {"mode": mode}}})
    config = with_scenario(config, scenario)
    simulation = Simulation(scenario, config, (goal_of(scenario, config),), seed)
    horizon_m = Guard(config.guard).horizon_m
    found: list[Death] = []
    last_s = 0.0

    def look(flying: Simulation, command: Command) -> None:
        nonlocal last_s
        decision, free_m = command.decision, command.guard.free_distance_m
        due_s = NEAR_EVERY_S if free_m < horizon_m else EVERY_S
        if decision.state not in NAVIGATING_STATES or decision.now_s - last_s < due_s:
            return
        speed_m_s = horizontal_norm(flying.vehicle.truth().velocity_ned_m_s)
        if command.wire_setpoint is not None and speed_m_s >= SLOWEST_M_S:
            last_s = decision.now_s
            travelled_m, clearance_m, fastest_m_s = _blind(flying, scenario)
            found.append(Death(last_s, fastest_m_s, free_m, travelled_m, clearance_m))

    simulation.run(on_tick=look)
    return found


def _blind(simulation: Simulation, scenario: Scenario) -> tuple[float, float, float]:
    """(travelled, least clearance, fastest) of a twin whose stream ends now."""
    twin = copy.deepcopy(simulation.vehicle)
    twin.cut_link()
    began = twin.truth().position_ned_m
    farthest_m, clearance_m, fastest_m_s = 0.0, math.inf, 0.0
    for _ in range(round(TO_REST_S / _STEP_S)):
        place = twin.truth().position_ned_m
        farthest_m = max(farthest_m, horizontal_norm(subtract(place, began)))
        half_height_m = scenario.vehicle.body_half_height_m
        clearance_m = min(clearance_m, simulation.world.clearance_m(place, half_height_m))
        fastest_m_s = max(fastest_m_s, horizontal_norm(twin.truth().velocity_ned_m_s))
        twin.advance(_STEP_S)
    return farthest_m, clearance_m, fastest_m_s
