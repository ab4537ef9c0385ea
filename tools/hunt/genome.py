"""A room as a vector of numbers in [0, 1], so that a search can bend it.

The same vector gives the same room, bit for bit: rooms are stored as their vectors. Whatever the
numbers are, the room is one that a flight may be asked to fly in: take-off point and goal are free,
the errors are those of real sensors and of a real autopilot, and at most one thing fails.
"""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from hal.config import Fence
from hal.sim.fault_kinds import parse_fault
from hal.sim.scenario import (
    BeamSimulation,
    Box,
    Disc,
    EstimatorSimulation,
    Scenario,
    SimObstacle,
    VehicleSimulation,
    Wall,
)
from tools.bench.rooms import CORNER_M, END_FREE_M, OFF_THE_WALLS_M

Floats = NDArray[np.float64]

OBSTACLES = 9
"""At most so many stand in a room, beside its walls and a dividing wall."""
_PER_OBSTACLE = 6
_ROOM = 10
_ERRORS = 10
_FAULT = 5
LENGTH = _ROOM + _ERRORS + _FAULT + OBSTACLES * _PER_OBSTACLE
"""Numbers in a vector."""

FAULTS = (
    "beam_dropout@{when}/{lasts}:beam={beam}",
    "beam_stuck@{when}/{lasts}:beam={beam}",
    "beam_silence@{when}/{lasts}:beam={beam}",
    "beam_noise@{when}/{lasts}:beam={beam},sigma_m={small}",
    "beam_bias@{when}/{lasts}:beam={beam},bias_m={signed}",
    "beam_crosstalk@{when}/{lasts}:beam={beam},other=right,probability=0.3",
    "position_noise@{when}/{lasts}:sigma_m={small}",
    "position_silence@{when}/{short}",
    "position_stuck@{when}/{short}",
    "ekf_reset@{when}:north_m={far},east_m={signed}",
    "gnss_loss@{when}/{lasts}",
    "gnss_jump@{when}/{lasts}:north_m=5",
    "gnss_drift@{when}/{lasts}:north_m_s=0.1",
    "link_loss@{when}/{short}",
    "link_delay@{when}/{lasts}:delay_s={small}",
    "link_drop@{when}/{lasts}:probability=0.3",
)
"""What may fail, one at a time: all that the simulation knows and that leaves a way to be safe."""
_BEAMS = ("front", "right", "back", "left")
_FAULTY = 0.35
"""In this share of random rooms something fails."""


class Genes:
    """Hands out the numbers of a vector in order."""

    def __init__(self, vector: Sequence[float]) -> None:
        """Values outside [0, 1] are brought to the nearer end."""
        self._values = [min(1.0, max(0.0, float(value))) for value in vector]
        self._at = 0

    def between(self, low: float, high: float) -> float:
        """The next number, laid between `low` and `high`, to 0.1 mm or its like."""
        self._at += 1
        return round(low + (high - low) * self._values[self._at - 1], 4)

    def choice(self, number: int) -> int:
        """The next number as one of 0 .. number - 1."""
        self._at += 1
        return min(number - 1, int(self._values[self._at - 1] * number))


def random_vector(number: int, seed: int = 0) -> Floats:
    """The vector of random room `number` of family `seed`."""
    return np.random.default_rng((seed, number)).uniform(0.0, 1.0, LENGTH)


def decoded(vector: Sequence[float] | Floats, name: str) -> tuple[Scenario, str]:
    """(the room, `stop` or `rolling`) of a vector of `LENGTH` numbers."""
    if len(vector) != LENGTH:
        raise ValueError(f"a room has {LENGTH} numbers, not {len(vector)}")
    genes = Genes([float(value) for value in vector])
    mode = ("stop", "rolling")[genes.choice(2)]
    side = genes.between(2.2, 3.6)
    low, high = -CORNER_M, side - CORNER_M
    goal = tuple(genes.between(0.55 * side - CORNER_M, high - CORNER_M) for _ in range(2))
    strewn: list[SimObstacle | None] = list(_dividing_wall(genes, low, high))
    start_yaw_deg = genes.between(-180.0, 180.0)
    errors = _errors(genes)
    faults = _faults(genes)
    strewn += [_obstacle(genes, low, high) for _ in range(OBSTACLES)]
    obstacles = _room_walls(low, high)
    obstacles += [o for o in strewn if o is not None and _leaves_ends_free(o, goal)]
    fence = (low + OFF_THE_WALLS_M, high - OFF_THE_WALLS_M)
    beams, estimator, vehicle = errors
    scenario = Scenario(
        name=name,
        obstacles=tuple(obstacles),
        goal_ne_m=(goal[0], goal[1]),
        start_yaw_deg=start_yaw_deg,
        fence=Fence.rectangle(fence, fence),
        beams=beams,
        estimator=estimator,
        vehicle=vehicle,
        faults=tuple(parse_fault(line) for line in faults),
    )
    return scenario, mode


def _room_walls(low: float, high: float) -> list[SimObstacle]:
    corners = ((low, low), (high, low), (high, high), (low, high))
    return [
        Wall(from_ne_m=a, to_ne_m=b, thickness_m=0.02)
        for a, b in zip(corners, corners[1:] + corners[:1], strict=True)
    ]


def _dividing_wall(genes: Genes, low: float, high: float) -> list[SimObstacle]:
    """A wall across the room with a door in it; none, or one without a door, for some numbers."""
    kind, at = genes.choice(6), genes.between(END_FREE_M, 0.7 * high)
    width, where = genes.between(0.36, 0.9), genes.between(0.1, 0.9)
    along_east = genes.choice(2)
    if kind < 3:
        return []
    door = low + where * (high - low - width)
    ends = [(low, high)] if kind == 5 else [(low, door), (door + width, high)]
    return [
        Wall(from_ne_m=(at, a), to_ne_m=(at, b))
        if along_east
        else Wall(from_ne_m=(a, at), to_ne_m=(b, at))
        for a, b in ends
        if b - a > 0.02
    ]


def _errors(genes: Genes) -> tuple[BeamSimulation, EstimatorSimulation, VehicleSimulation]:
    """How wrong beams and estimate are, and how the vehicle stops.

    The autopilot's velocity errs by up to 3 cm/s for seconds (measured on PX4 main bb59c637cd, SIH
    quadrotor, 2026-11: 2 to 3 cm/s), range sensors by up to 1 cm and 2 %.
    """
    beams = BeamSimulation(
        sigma_m=genes.between(0.0, 0.01),
        sigma_fraction=genes.between(0.0, 0.02),
        dropout_probability=genes.between(0.0, 0.05),
        delay_s=genes.between(0.0, 0.03),
    )
    estimator = EstimatorSimulation(
        position_sigma_m=genes.between(0.0, 0.03),
        height_sigma_m=genes.between(0.0, 0.03),
        velocity_sigma_m_s=genes.between(0.0, 0.03),
        yaw_sigma_deg=genes.between(0.0, 2.0),
        correlation_s=genes.between(2.0, 10.0),
    )
    return beams, estimator, VehicleSimulation(drag_per_mass_s=genes.between(0.1, 1.0))


def _faults(genes: Genes) -> list[str]:
    """No fault, or one line of `hal.sim.fault_kinds`."""
    which = genes.between(0.0, 1.0)
    words = {
        "when": f"liftoff+{genes.between(0.0, 40.0):g}",
        "lasts": f"{genes.between(0.2, 20.0):g}",
        "beam": _BEAMS[genes.choice(len(_BEAMS))],
    }
    size = genes.between(0.0, 1.0)
    words["short"] = f"{0.2 + 2.0 * size:g}"
    words["small"] = f"{0.02 + 0.08 * size:g}"
    words["signed"] = f"{-0.05 + 0.1 * size:g}"
    words["far"] = f"{0.1 + size:g}"
    if which >= _FAULTY:
        return []
    kind = min(len(FAULTS) - 1, int(which / _FAULTY * len(FAULTS)))
    return [FAULTS[kind].format(**words)]


def _obstacle(genes: Genes, low: float, high: float) -> SimObstacle | None:
    """A disc, a box or a wall from floor to ceiling; or nothing."""
    kind = genes.choice(5)
    centre = (genes.between(low + 0.1, high - 0.1), genes.between(low + 0.1, high - 0.1))
    first, second = genes.between(0.0, 1.0), genes.between(0.0, 1.0)
    turn = genes.between(0.0, math.pi)
    if kind == 0:
        return None
    if kind == 1:
        return Disc(centre_ne_m=centre, radius_m=round(0.01 + 0.3 * first, 4))
    if kind == 2:
        size = (round(0.05 + 0.5 * first, 4), round(0.05 + 0.5 * second, 4))
        return Box(centre_ne_m=centre, size_m=size, yaw_deg=math.degrees(turn))
    half = 0.1 + 0.8 * first
    dn, de = half * math.cos(turn), half * math.sin(turn)
    return Wall(
        from_ne_m=(round(centre[0] - dn, 4), round(centre[1] - de, 4)),
        to_ne_m=(round(centre[0] + dn, 4), round(centre[1] + de, 4)),
        thickness_m=round(0.01 + 0.09 * second, 4),
    )


def _leaves_ends_free(obstacle: SimObstacle, goal: Sequence[float]) -> bool:
    """True when neither take-off point nor goal is crowded by it."""
    ends = ((0.0, 0.0), (goal[0], goal[1]))
    return all(obstacle.distance_m(*end) >= END_FREE_M for end in ends)
