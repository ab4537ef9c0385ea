"""A scenario around a vehicle that flies elsewhere: what its beams would see there, and how near it
came to what is not there.
"""

import numpy as np

from hal.config import BeamsConfig
from hal.frames import Vector3
from hal.readings import RangeReading
from hal.sim import kernels
from hal.sim.faults import with_beam_faults
from hal.sim.scenario import Scenario
from hal.sim.sensors import SimulatedBeams
from hal.sim.world import World


class VirtualRoom:
    """World, beams and beam faults of a scenario, seen from poses that somebody else knows.

    Positions are NED about the scenario's origin; `elapsed_s` is the scenario's own time.
    """

    def __init__(self, scenario: Scenario, beams: BeamsConfig, seed: int) -> None:
        """Compiles what casts, so that nothing is in the air. Raises DocumentError for a fault of
        a beam that there is not.
        """
        kernels.warm_up()
        ranging, faults = (
            np.random.default_rng(child) for child in np.random.SeedSequence(seed).spawn(2)
        )
        self._world = World(scenario)
        self._body = scenario.vehicle
        self._beams = with_beam_faults(
            SimulatedBeams(self._world, beams, scenario.beams, ranging), scenario.faults, faults
        )

    @property
    def beams(self) -> tuple[str, ...]:
        """The names of the beams."""
        return self._beams.beams

    def sample(
        self,
        elapsed_s: float,
        position_ned_m: Vector3,
        roll_rad: float,
        pitch_rad: float,
        yaw_rad: float,
    ) -> tuple[RangeReading, ...]:
        """The readings that become known now, stamped in the scenario's time; empty when none."""
        return self._beams.sample(elapsed_s, position_ned_m, roll_rad, pitch_rad, yaw_rad)

    def clearance_m(self, elapsed_s: float, position_ned_m: Vector3) -> float:
        """Horizontal distance from a point to the nearest surface at its height; inf: none."""
        return self._world.at(elapsed_s).clearance_m(position_ned_m)

    def touches(self, elapsed_s: float, position_ned_m: Vector3) -> bool:
        """True when a body of the scenario's size would touch something there."""
        return self._world.at(elapsed_s).collides(
            position_ned_m, self._body.body_radius_m, self._body.body_half_height_m
        )
