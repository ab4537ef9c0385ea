"""What the rooms of the autopilot know together, as PX4's modules do by their topics.

Each value says which room writes it; all may read it. What only one room needs is in that room.
"""

import math

import numpy as np

from hal.frames import ZERO3, Vector3, add, wrap_pi
from hal.sim.autopilot_announcements import Announcements
from hal.sim.mission import Mission
from hal.sim.px4 import Mode, Parameters, Severity
from hal.sim.px4_events import EventKind
from hal.sim.px4_watch import GnssWatch, HeartbeatWatch
from hal.sim.quadrotor import EXACT, Command, Quadrotor

# The modes of a multicopter that need a global position: PX4's mode_requirements.cpp. Take-off
# needs a local one; after it, PX4 stays in Takeoff where Hold cannot run.
GLOBAL_MODES = frozenset({Mode.HOLD, Mode.RETURN, Mode.MISSION})
# Measured, beyond COM_OF_LOSS_T.
_OFFBOARD_LOSS_JITTER_S = (0.02, 0.12)


class Situation:
    """The state of one autopilot since it was started last.

    The parameters, the vehicle, the mission and what was said outlive a restart.
    """

    def __init__(
        self,
        parameters: Parameters,
        quadrotor: Quadrotor,
        mission: Mission,
        announcements: Announcements,
        rng: np.random.Generator,
        *,
        origin: Vector3,
        has_gnss: bool,
        now_s: float = 0.0,
    ) -> None:
        self.parameters = parameters
        self.quadrotor = quadrotor
        self.mission = mission
        self.announcements = announcements
        self.origin = origin
        """Of the local frame: latitude, longitude (degrees), altitude over sea (metres)."""
        self._rng = rng
        self._has_gnss = has_gnss

        # Written by the autopilot itself, at each step.
        self.now_s = now_s
        self.error = EXACT
        """Estimate minus truth."""

        # Written by who watches the link: heartbeats, setpoints, the receiver.
        self.ground_station = HeartbeatWatch()
        self.companion = HeartbeatWatch()
        self.gnss = GnssWatch()
        self.gnss_fix = True
        self.setpoint = Command()
        self.setpoint_s = -math.inf
        self.offboard_loss_jitter_s = 0.0
        """How much later than COM_OF_LOSS_T the next loss of setpoints is noticed."""

        # Written by the commander.
        self.armed = False
        self.armed_s = 0.0
        self.intended = Mode.HOLD
        """The mode that was asked for; the end of a take-off asks for Hold."""
        self.before_landing = Mode.HOLD
        """The mode that comes back when a landing is over."""
        self.home_ned_m: Vector3 = ZERO3
        self.home_set_s = 0.0
        """Set by arming, and again by the detected take-off."""
        self.climb_to_m: float | None = None
        """Where a take-off ends, down; None without one."""

        # Written by the failsafes, ended by every mode that is asked for.
        self.failsafe: Mode | None = None

        # Written by the phases of flight: the mode whose phase has taken over.
        self.entered: Mode | None = None

        # Written by the land detector.
        self.landed = True
        """PX4's belief."""
        self.airborne = False
        """True while its thrust carries it."""

    @property
    def mode(self) -> Mode:
        """The mode that is flown: the failsafe's, else the one that was asked for."""
        return self.failsafe or self.intended

    @property
    def estimated_position_ned_m(self) -> Vector3:
        """What it believes."""
        return add(self.quadrotor.position_ned_m, self.error.position_ned_m)

    @property
    def estimated_velocity_ned_m_s(self) -> Vector3:
        """What it believes."""
        return add(self.quadrotor.velocity_ned_m_s, self.error.velocity_ned_m_s)

    @property
    def estimated_yaw_rad(self) -> float:
        """What it believes."""
        return wrap_pi(self.quadrotor.yaw_rad + self.error.yaw_rad)

    @property
    def global_position(self) -> bool:
        """True while it knows where on Earth it is; the local position may be good without."""
        return self._has_gnss and self.gnss.position_valid

    @property
    def default_takeoff_m(self) -> float:
        """Where a take-off ends that names no altitude, down: MIS_TAKEOFF_ALT above home."""
        return self.home_ned_m[2] - float(self.parameters["MIS_TAKEOFF_ALT"])

    def setpoint_fresh(self, extra_s: float = 0.0) -> bool:
        """True while the newest setpoint counts: COM_OF_LOSS_T and `extra_s`."""
        limit_s = float(self.parameters["COM_OF_LOSS_T"]) + extra_s
        return self.now_s - self.setpoint_s <= limit_s

    def available(self, mode: Mode) -> bool:
        """Whether the mode can be flown now."""
        if mode in GLOBAL_MODES and not self.global_position:
            return False
        if mode is Mode.OFFBOARD:
            return self.setpoint_fresh()
        if mode is Mode.MISSION:
            return bool(self.mission.items)
        return not mode.needs_pilot

    def ask_for(self, mode: Mode) -> None:
        """From now on this mode is wanted; a failsafe and a take-off end."""
        if mode in (Mode.LAND, Mode.RETURN) and self.intended not in (Mode.LAND, Mode.RETURN):
            self.before_landing = self.intended
        if mode is not Mode.TAKEOFF:
            self.climb_to_m = None
        self.intended = mode
        self.failsafe = None
        self.entered = None
        self.draw_offboard_loss()

    def draw_offboard_loss(self) -> None:
        """Chance decides anew how late a loss of setpoints is noticed."""
        self.offboard_loss_jitter_s = float(self._rng.uniform(*_OFFBOARD_LOSS_JITTER_S))

    def say(
        self, severity: Severity, text: str, kind: EventKind | None = None, *arguments: float
    ) -> None:
        """Queue a status text, and the event that tells the same."""
        self.announcements.say(self.now_s, severity, text)
        if kind is not None:
            self.report(kind, *arguments)

    def report(self, kind: EventKind, *arguments: float) -> None:
        """Queue an event alone."""
        self.announcements.report(self.now_s, kind, *arguments)
