"""T3DRM as printed: nose forward, no turning, nothing between the planner and the motors.

The paper's drone looks ahead, to both sides, back, up and down, and does not turn to look; it has
no guard. Adapted, and no more: the project's pilot in mode `stop`, its yaw scan replaced by the
bearing of flight, its look round by nothing; no other heights, no making way. The guard is left out
because it would let this one fly nowhere: beams that do not turn show four lines as free, and never
the width of the body.
"""

import math

from autonomy.config import Config
from autonomy.guidance.yaw_scan import YawScan
from autonomy.mission.pilot import Pilot
from autonomy.model import Command, Inputs
from hal.frames import Vector3
from tools.bench.rivals.harness import unguarded

_FLIES_M_S = 0.05


class NoseForward(YawScan):
    """Looks where it flies; every look round has ended before it began."""

    def __init__(self, rate_rad_s: float) -> None:
        super().__init__(rate_rad_s)
        self.turned_rad = math.inf
        self.bearing_rad: float | None = None

    def restart(self) -> None:
        """There is no sweep to count."""

    def step(self, yaw_rad: float, dt_s: float) -> float:  # noqa: ARG002  # the scan's signature
        """The bearing of flight; before any, the heading as it is."""
        self.commanded_rad = yaw_rad if self.bearing_rad is None else self.bearing_rad
        return self.commanded_rad


class PrintedPilot:
    """A `simulation.Flyer`: the pilot, nose forward and without a guard."""

    def __init__(self, config: Config, route: tuple[Vector3, ...]) -> None:
        self._pilot = Pilot(config, route)
        self._nose = NoseForward(math.radians(config.guidance.yaw_rate_deg_s))
        # No configuration says "do not turn": the scan is exchanged where the pilot keeps it.
        self._pilot._steering.scan = self._nose

    @property
    def goal(self) -> Vector3:
        """The goal being flown to."""
        return self._pilot.goal

    def step(self, inputs: Inputs) -> Command:
        """One tick: decide; the nose follows at the next one."""
        decision = self._pilot.step(inputs)
        setpoint = decision.setpoint
        if setpoint is not None:
            north, east = setpoint.velocity_ned_m_s[:2]
            if math.hypot(north, east) > _FLIES_M_S:
                self._nose.bearing_rad = math.atan2(east, north)
        self._pilot.sent(setpoint)
        return unguarded(decision, self._pilot.sensing.home_ned_m)
