"""What the mock PX4 flies: autopilot, world, sensors and faults of one scenario, step by step."""

import math
from typing import TextIO

import msgspec
import numpy as np

from hal.config import BeamsConfig
from hal.readings import FixType, GnssFix, LocalPosition, RangeReading
from hal.sim.autopilot import Autopilot
from hal.sim.fault_clock import FaultClock
from hal.sim.faults import GnssFaults, PositionFaults, with_beam_faults
from hal.sim.scenario import Scenario
from hal.sim.sensors import EstimatorError, SimulatedBeams, SimulatedGnss
from hal.sim.vehicle import Truth, truth_of
from hal.sim.vehicle_faults import EstimateFaults, VehicleFaults
from hal.sim.world import World

_TRUTH_HZ = 20.0
_LEAST_SATELLITES = 4


class Plant:
    """One scenario being flown; times are seconds since the autopilot started.

    After each `step` its attributes hold what became known in that step.
    """

    def __init__(
        self, scenario: Scenario, beams: BeamsConfig, seed: int, *, boot_s: float = 0.0
    ) -> None:
        flight, estimate, ranging, gnss, faults, fixes, self.link_rng = (
            np.random.default_rng(child) for child in np.random.SeedSequence(seed).spawn(7)
        )
        self.scenario = scenario
        self.beams_config = beams
        self.world = World(scenario)
        self.autopilot = Autopilot(scenario, flight, boot_s=boot_s)
        self.fault_clock = when = FaultClock()
        self.faults = VehicleFaults(self.autopilot, scenario.faults, when)
        self._estimate_faults = EstimateFaults(scenario.faults, when)
        self._gnss_faults = GnssFaults(scenario.faults, fixes, when)
        self._estimator = EstimatorError(scenario.estimator, estimate)
        self._beams = with_beam_faults(
            SimulatedBeams(self.world, beams, scenario.beams, ranging),
            scenario.faults,
            faults,
            clock=when,
        )
        self._gnss = SimulatedGnss(scenario.gnss, gnss) if scenario.gnss.present else None
        self._position_faults = PositionFaults(scenario.faults, faults, clock=when)
        self.position: LocalPosition | None = None
        """The estimate as it is heard of; None while a fault keeps it silent."""
        self.ranges: tuple[RangeReading, ...] = ()
        self.new_fix: GnssFix | None = None
        self.fix: GnssFix | None = None

    def step(self, dt_s: float) -> None:
        """Let `dt_s` seconds pass."""
        autopilot = self.autopilot
        self.faults.step(autopilot.now_s)
        offset, jump = self._estimate_faults.spoil(autopilot.now_s, self._estimator.step(dt_s))
        if jump is not None:
            autopilot.shift_estimate(jump.position_ned_m, jump.yaw_rad)
        autopilot.step(dt_s, offset)
        truth = self.truth()
        now_s = autopilot.now_s
        self.ranges = self._beams.sample(
            now_s, truth.position_ned_m, truth.roll_rad, truth.pitch_rad, truth.yaw_rad
        )
        fix = self._gnss.sample(now_s, truth.position_ned_m) if self._gnss else None
        self.new_fix = self._gnss_faults.pass_on(now_s, self._received(fix))
        self.fix = self.new_fix or self.fix
        self.position = self._position_faults.pass_on(
            LocalPosition(
                now_s,
                autopilot.estimated_position_ned_m,
                autopilot.estimated_velocity_ned_m_s,
                self._estimate_faults.resets % 256,
            )
        )

    def _received(self, fix: GnssFix | None) -> GnssFix | None:
        """The fix as far as the receiver sees satellites; SIM_GPS_USED says how many it uses."""
        seen = int(self.autopilot.parameters["SIM_GPS_USED"])
        self.autopilot.gnss_fix = seen >= _LEAST_SATELLITES and not self.faults.blind
        if fix is None or self.autopilot.gnss_fix:
            return fix
        return msgspec.structs.replace(fix, fix_type=FixType.NO_FIX, satellites=seen)

    def truth(self) -> Truth:
        """The true state now."""
        return truth_of(self.autopilot, self.autopilot.now_s)


class TruthRecord(msgspec.Struct, frozen=True):
    """One line of the truth file. `clearance_m` is None where there is no obstacle at all."""

    t: float
    position_ned_m: tuple[float, float, float]
    velocity_ned_m_s: tuple[float, float, float]
    yaw_rad: float
    clearance_m: float | None
    collided: bool
    in_air: bool
    armed: bool
    landed: str
    mode: str


class TruthWriter:
    """Writes the truth as JSON lines at 20 Hz, each flushed: readers never wait for a buffer."""

    def __init__(self, plant: Plant, out: TextIO) -> None:
        self._plant = plant
        self._out = out
        self._due_s = 0.0

    def write_if_due(self) -> None:
        """One line, unless the last is younger than 50 ms."""
        now_s = self._plant.autopilot.now_s
        if now_s < self._due_s - 1e-9:
            return
        self._due_s = now_s + 1.0 / _TRUTH_HZ
        line = msgspec.json.encode(truth_record(self._plant)).decode()
        self._out.write(line + "\n")
        self._out.flush()


def truth_record(plant: Plant) -> TruthRecord:
    """The true state of `plant` as a line of the truth file."""
    truth, autopilot = plant.truth(), plant.autopilot
    world = plant.world.at(truth.stamp_s)
    body = plant.scenario.vehicle
    clearance_m = world.clearance_m(truth.position_ned_m, body.body_half_height_m)
    return TruthRecord(
        t=round(truth.stamp_s, 6),
        position_ned_m=truth.position_ned_m,
        velocity_ned_m_s=truth.velocity_ned_m_s,
        yaw_rad=truth.yaw_rad,
        clearance_m=clearance_m if math.isfinite(clearance_m) else None,
        collided=world.collides(truth.position_ned_m, body.body_radius_m, body.body_half_height_m),
        in_air=not truth.on_ground,
        armed=truth.armed,
        landed=autopilot.landed.landed_state.value,
        mode=autopilot.mode.flight_mode.value,
    )
