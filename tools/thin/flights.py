"""One simulated flight between two thin obstacles on its line, and when it knew of them."""

import math
from collections.abc import Iterator, Sequence

import msgspec
import numpy as np

from autonomy.config import Config
from autonomy.geometry import Point, distance
from autonomy.mission.guarded import Command
from autonomy.simulation import Simulation, goal_of
from hal.config import Fence
from hal.sim.scenario import (
    BeamSimulation,
    Disc,
    EstimatorSimulation,
    Scenario,
    SimObstacle,
    Wall,
)
from tools.bench.rooms import shipped_config

POST, WALL_END = "post", "wall's end"
KINDS = (POST, WALL_END)
THICKNESSES_M = (0.008, 0.01, 0.015, 0.02, 0.025, 0.03, 0.04, 0.06)
HALF_ANGLES_DEG = (0.0, 12.5)
RATE_HZ, SPEED_M_S = 20.0, 0.2
"""How often simulated beams measure, and how fast is flown, unless told otherwise."""
OTHER_WAYS = ((10.0, SPEED_M_S), (RATE_HZ, SPEED_M_S / 2.0), (50.0, SPEED_M_S))
"""(Hz, m/s): slower sensors, slower flight, faster sensors."""
OTHERWISE_M = (0.008, 0.015)
"""Posts of these are flown at in the other ways, too."""

_LENGTH_M = 2.4
_ALONG_M = (0.9, 1.5)
_WALL_M = 0.3
_OFF_THE_LINE_M = 0.03
_LOW_M, _HIGH_M = -1.2, 3.6
_FENCE_M = 0.2
_ON_THE_MAP_M = 0.08
"""A hit so near to an obstacle's surface is of it: nothing else is, and position (1 cm), heading
(0.8 deg) and range (5 mm + 1 %) are wrong by less."""


class Case(msgspec.Struct, frozen=True):
    """One flight to be flown; the same `seed` is the same course, whatever stands on it."""

    kind: str
    thickness_m: float
    half_angle_deg: float
    seed: int
    rate_hz: float = RATE_HZ
    speed_m_s: float = SPEED_M_S


class Flight(msgspec.Struct, frozen=True):
    """What came of it. Distances are the true ones from the body's centre.

    `first_m`: to each obstacle's surface when it was first on the map; None where it never was.
    """

    case: Case
    ending: str
    collided: bool
    clearance_m: float
    first_m: tuple[float | None, ...]
    wall_s: float


def fly(case: Case) -> Flight:
    """Fly one case, rolling, as shipped but for rate and speed; deterministic."""
    places, scenario = course(case)
    config = _config(case, scenario)
    simulation = Simulation(scenario, config, (goal_of(scenario, config),), case.seed)
    watch = _Watch(places, case.thickness_m / 2.0)
    flight = simulation.run(on_tick=watch.note)
    return Flight(
        case,
        flight.outcome.ending.value,
        flight.collided,
        round(flight.true_clearance_m, 4),
        tuple(watch.first_m),
        round(flight.wall_s, 3),
    )


def cases(
    thicknesses_m: Sequence[float], half_angles_deg: Sequence[float], seeds: range
) -> Iterator[Case]:
    """Every beam, kind and thickness, with every seed."""
    for seed in seeds:
        for half_angle_deg in half_angles_deg:
            for kind in KINDS:
                for thickness_m in thicknesses_m:
                    yield Case(kind, thickness_m, half_angle_deg, seed)


def otherwise(seeds: range) -> Iterator[Case]:
    """Thin beams and thin posts: flown as shipped, and in the other ways."""
    for seed in seeds:
        for thickness_m in OTHERWISE_M:
            for rate_hz, speed_m_s in ((RATE_HZ, SPEED_M_S), *OTHER_WAYS):
                yield Case(POST, thickness_m, 0.0, seed, rate_hz, speed_m_s)


def course(case: Case) -> tuple[tuple[Point, ...], Scenario]:
    """The middles of what faces the vehicle (posts, or walls' ends), and the room they are in.

    A room of 4.8 m; the course begins at its origin and leads 2.4 m to a bearing drawn between
    north and east. Two obstacles stand on it, each at most 3 cm beside the line.
    """
    rng = np.random.default_rng(case.seed)
    bearing_rad = float(rng.uniform(0.0, math.pi / 2.0))
    cos, sin = math.cos(bearing_rad), math.sin(bearing_rad)

    def at(along_m: float, beside_m: float) -> Point:
        return (along_m * cos - beside_m * sin, along_m * sin + beside_m * cos)

    places: list[Point] = []
    obstacles: list[SimObstacle] = list(_room())
    for along_m in _ALONG_M:
        beside_m = float(rng.uniform(-_OFF_THE_LINE_M, _OFF_THE_LINE_M))
        place = at(along_m, beside_m)
        places.append(place)
        if case.kind == POST:
            obstacles.append(Disc(centre_ne_m=place, radius_m=case.thickness_m / 2.0))
        else:
            end = at(along_m + _WALL_M, beside_m)
            obstacles.append(Wall(from_ne_m=place, to_ne_m=end, thickness_m=case.thickness_m))
    inside = (_LOW_M + _FENCE_M, _HIGH_M - _FENCE_M)
    return tuple(places), Scenario(
        name=f"{case.kind} of {100.0 * case.thickness_m:g} cm",
        obstacles=tuple(obstacles),
        goal_ne_m=at(_LENGTH_M, 0.0),
        fence=Fence.rectangle(inside, inside),
        beams=BeamSimulation(
            half_angle_deg=case.half_angle_deg, rate_hz=case.rate_hz, dropout_probability=0.02
        ),
        estimator=EstimatorSimulation(
            position_sigma_m=0.01, velocity_sigma_m_s=0.01, yaw_sigma_deg=0.8, correlation_s=3.0
        ),
    )


def _room() -> Iterator[Wall]:
    low, high = _LOW_M, _HIGH_M
    corners = ((low, low), (high, low), (high, high), (low, high))
    for a, b in zip(corners, corners[1:] + corners[:1], strict=True):
        yield Wall(from_ne_m=a, to_ne_m=b, thickness_m=0.02)


def _config(case: Case, scenario: Scenario) -> Config:
    config = shipped_config(scenario, "rolling")
    rate_hz = max(case.rate_hz, config.control.rate_hz)  # a tick takes one reading of a beam
    control = config.control.model_copy(update={"rate_hz": rate_hz})
    guidance = config.guidance.model_copy(update={"speed_max_m_s": case.speed_m_s})
    changed = config.model_copy(update={"control": control, "guidance": guidance})
    return Config.model_validate(changed.model_dump())


class _Watch:
    """Notes how far each obstacle is when its first hit is on the map."""

    def __init__(self, places: Sequence[Point], half_thickness_m: float) -> None:
        self._places = places
        self._half_thickness_m = half_thickness_m
        self._version = -1
        self.first_m: list[float | None] = [None] * len(places)

    def note(self, simulation: Simulation, command: Command) -> None:
        """One tick."""
        known = simulation.guarded.pilot.sensing.map
        if command.decision.fused is None or known.version == self._version:
            return
        self._version = known.version
        true = simulation.vehicle.truth().position_ned_m
        near_m = self._half_thickness_m + _ON_THE_MAP_M
        for number, place in enumerate(self._places):
            if self.first_m[number] is not None:
                continue
            if known.nearest_hit((*place, true[2]), near_m) is not None:
                far_m = distance(true[:2], place) - self._half_thickness_m
                self.first_m[number] = round(far_m, 3)
