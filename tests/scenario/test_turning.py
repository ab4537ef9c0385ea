"""The vehicle turns all the time, and faster beside what is near."""

import math
from itertools import pairwise

import numpy as np

from autonomy.config import Config
from autonomy.model import Ending
from autonomy.simulation import Simulation, goal_of, with_scenario
from hal.config import Fence
from hal.frames import wrap_pi
from hal.sim.scenario import Scenario, Wall

PATH_STATES = ("cruise", "follow")


def test_beside_what_is_near_it_turns_twice_as_fast() -> None:
    scenario = Scenario(
        name="beside a wall",
        obstacles=(Wall(from_ne_m=(-1.0, 0.235), to_ne_m=(1.0, 0.235)),),
        goal_ne_m=(4.0, -1.0),
        fence=Fence.rectangle((-2.0, 6.0), (-3.0, 3.0)),
    )
    config = with_scenario(Config(), scenario)
    flight = Simulation(scenario, config, (goal_of(scenario, config),)).run(keep_commands=True)
    assert flight.outcome.ending is Ending.GOAL_REACHED
    looking: list[float] = []
    flying: list[float] = []
    for before, now in pairwise(command.decision for command in flight.commands):
        if before.fused is None or now.fused is None:
            continue
        turned = wrap_pi(now.fused.yaw_rad - before.fused.yaw_rad)
        rate_deg_s = math.degrees(turned) / (now.now_s - before.now_s)
        if now.state == "detect":
            looking.append(rate_deg_s)
        elif now.state in PATH_STATES and now.fused.point[1] < -0.4:
            flying.append(rate_deg_s)
    assert max(looking) > 80.0
    assert 50.0 < np.median(flying) < 70.0
