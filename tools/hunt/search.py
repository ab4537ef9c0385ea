"""Random rooms, and hunts: each a run of CMA-ES from the worst of a few random rooms.

A hunt is a function of its number alone, so a campaign is a list of numbers: what is done is kept,
what is not is done the next time, in any order and on any number of processes.
"""

import math
from collections.abc import Callable, Iterator

import cma
import numpy as np

from tools.hunt.genome import LENGTH, random_vector
from tools.hunt.trial import Trial, flown

ROOMS_A_HUNT = 400
_FIRST = 48
"""So many random rooms are flown; the worst is where the hunt begins."""
_SIGMA = 0.12
_POPULATION = 16
GOALS = ("clearance", "stall", "detour")
_HUNT_SEED = 1_000_003
_TOUCHED_M = 0.5
"""A collision is this much worse than its clearance."""


def goal_of_hunt(number: int) -> str:
    """What hunt `number` wants to make worse: the clearance, the time, or the way."""
    return GOALS[number % len(GOALS)]


def cost(trial: Trial, goal: str) -> float:
    """What the hunt makes as small as it can."""
    if trial.failure == "raised":
        return -100.0
    touched = _TOUCHED_M if trial.failure == "collision" else 0.0
    if goal == "clearance":
        return trial.clearance_m - touched
    if goal == "stall":
        return -trial.navigation_s - 1000.0 * (trial.failure == "no verdict")
    wrong = 10.0 * (trial.failure == "wrong verdict")
    return -trial.detour - wrong


def random_rooms(numbers: range) -> Iterator[Trial]:
    """Fly the random rooms of these numbers."""
    for number in numbers:
        yield flown(_rounded(random_vector(number)), f"random {number}")


def hunt(
    number: int, rooms: int = ROOMS_A_HUNT, fly: Callable[[tuple[float, ...], str], Trial] = flown
) -> Iterator[Trial]:
    """Hunt `number`: `rooms` flights, each worse than those before if it goes well."""
    goal, name = goal_of_hunt(number), f"hunt {number}"
    first = min(_FIRST, rooms)
    worst: tuple[float, tuple[float, ...]] = (math.inf, ())
    for index in range(first):
        vector = _rounded(random_vector(index, _HUNT_SEED + number))
        trial = fly(vector, f"{name}.{index}")
        worst = min(worst, (cost(trial, goal), vector))
        yield trial
    options = {
        "bounds": [0.0, 1.0],
        "popsize": _POPULATION,
        "seed": number + 1,
        "CMA_diagonal": True,  # so few flights cannot teach it how 97 numbers go together
        "verbose": -9,
        "maxiter": 10**6,
        "tolflatfitness": 10**6,
    }
    strategy = cma.CMAEvolutionStrategy(np.clip(worst[1], 0.02, 0.98), _SIGMA, options)
    done = first
    while done < rooms:
        asked = strategy.ask()
        costs = []
        for vector in asked:
            trial = fly(_rounded(vector), f"{name}.{done}")
            costs.append(cost(trial, goal))
            done += 1
            yield trial
        strategy.tell(asked, costs)


def _rounded(vector: "np.ndarray[tuple[int, ...], np.dtype[np.float64]]") -> tuple[float, ...]:
    """The vector as it is stored: five digits, so that what is read back is what was flown."""
    if len(vector) != LENGTH:
        raise ValueError(f"a room has {LENGTH} numbers, not {len(vector)}")
    return tuple(round(min(1.0, max(0.0, float(value))), 5) for value in vector)
