"""Write a planner: the wall follower, in place of T3DRM, in the same simulation.

A planner is asked twenty times a second what velocity to fly and is shown what the beams have seen
so far. Sensing, the map, take-off, turning, the speed rule, landing and the guard are the harness's
(`tools/bench/rivals`), and the same as T3DRM's.
"""

import argparse
import math
from collections.abc import Sequence

import numpy as np

from autonomy.geometry import Point
from autonomy.mission.guarded import Guarded
from autonomy.simulation import SimulatedFlight, Simulation, goal_of
from hal.sim.scenario import load_scenario
from tools.bench.rivals.harness import RivalPilot
from tools.bench.rivals.interface import Answer, Craft, View, towards
from tools.bench.rooms import shipped_config

KEEP_M = 0.1
"""Distance kept from a wall, beyond the keep-out radius."""
AHEAD_M = 0.6
"""So far ahead the straight way to the goal must be free."""


class WallFollower:
    """Flies at the goal; where something is in the way, goes round it with the wall on its right.

    One rule and no memory: it finds through the furnished room and the door, and circles for ever
    in `u_trap`.
    """

    def __init__(self, craft: Craft) -> None:
        self._speed_m_s = craft.speed_m_s
        self._keep_m = craft.keep_out_m + KEEP_M

    def decide(self, view: View) -> Answer:
        """At the goal, or along what is nearest."""
        goal = math.atan2(view.goal[1] - view.point[1], view.goal[0] - view.point[0])
        away = view.near - np.asarray(view.point)
        if len(away) == 0 or not self._blocked(away, goal):
            return towards(goal, self._speed_m_s)
        return self._along(away)

    def _blocked(self, away: np.ndarray, bearing: float) -> bool:
        """True where a hit lies in the corridor ahead."""
        ahead = away @ np.array((math.cos(bearing), math.sin(bearing)))
        aside = away @ np.array((-math.sin(bearing), math.cos(bearing)))
        return bool(np.any((ahead > 0.0) & (ahead < AHEAD_M) & (np.abs(aside) < self._keep_m)))

    def _along(self, away: np.ndarray) -> Point:
        """With the nearest hit on the right, turning off it when it is too near."""
        distances = np.hypot(away[:, 0], away[:, 1])
        nearest = int(np.argmin(distances))
        bearing = math.atan2(away[nearest, 1], away[nearest, 0])
        lean = max(-0.6, min(0.6, 4.0 * (self._keep_m - float(distances[nearest]))))
        return towards(bearing - math.pi / 2.0 - lean, self._speed_m_s)


def fly(scenario: str, seed: int = 0, time_limit_s: float = 300.0) -> SimulatedFlight:
    """The wall follower in a simulated world, with the guard below it."""
    world = load_scenario(scenario)
    config = shipped_config(world, "rolling")
    mission = config.mission.model_copy(update={"time_limit_s": time_limit_s})
    config = config.model_copy(update={"mission": mission})
    route = (goal_of(world, config),)
    pilot = RivalPilot(config, route, WallFollower(Craft.of(config)))
    return Simulation(world, config, route, seed, flyer=Guarded(pilot, config)).run()


def main(arguments: Sequence[str] | None = None) -> None:
    """Fly, and tell what it was like."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("scenario", nargs="?", default="default")
    flight = fly(parser.parse_args(arguments).scenario)
    print(f"{flight.outcome.ending}: {flight.outcome.why}")
    print(f"{flight.path_length_m:.1f} m in {flight.flight_time_s:.0f} s")
    print(f"true clearance {flight.true_clearance_m:.2f} m, collided: {flight.collided}")


if __name__ == "__main__":
    main()
