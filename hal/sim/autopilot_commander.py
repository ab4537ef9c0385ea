"""PX4's commander: who may arm, which request is refused, and what is said about it.

Results and words: measured on PX4 main bb59c637cd, SIH quadrotor, 2026-11.
"""

import math
from collections import Counter

from hal.frames import Vector3
from hal.sim import px4_events as events
from hal.sim.autopilot_health import Health
from hal.sim.autopilot_land_detector import LandDetector
from hal.sim.autopilot_phases import FlightPhases
from hal.sim.autopilot_situation import Situation
from hal.sim.px4 import Mode, Result, Severity

_NAMES = {
    Mode.MANUAL: "Manual",
    Mode.ALTITUDE: "Altitude",
    Mode.POSITION: "Position",
    Mode.ORBIT: "Orbit",
    Mode.ACRO: "Acro",
    Mode.STABILIZED: "Stabilized",
    Mode.OFFBOARD: "Offboard",
    Mode.MISSION: "Mission",
    Mode.HOLD: "Hold",
    Mode.RETURN: "Return",
}


class Commander:
    """Takes requests, arms and disarms. The contracts of the requests are `Autopilot`'s."""

    def __init__(
        self,
        situation: Situation,
        health: Health,
        phases: FlightPhases,
        land_detector: LandDetector,
    ) -> None:
        self._situation = situation
        self._health = health
        self._phases = phases
        self._land_detector = land_detector
        self._refusals: dict[str, tuple[str, ...]] = {}
        self._refused: Counter[str] = Counter()
        self.flights = 0
        """How often it has armed."""

    # ------------------------------------------------------------ arming

    def arm(self) -> Result:
        """MAV_CMD_COMPONENT_ARM_DISARM with 1."""
        s = self._situation
        if s.armed:
            return Result.ACCEPTED
        if self._refusals.get("arm"):
            return self._refuse("arm")
        reason = self._health.not_armable_because
        if reason:
            self._health.say_why_not(reason)
            s.say(
                Severity.CRITICAL,
                "Arming denied: Resolve system health failures first",
                events.ARMING_DENIED,
            )
            return Result.TEMPORARILY_REJECTED
        s.armed = True
        s.armed_s = s.now_s
        self.flights += 1
        s.home_ned_m = s.estimated_position_ned_m
        s.home_set_s = s.now_s
        s.entered = None
        self._land_detector.armed()
        s.say(Severity.INFO, "Armed by external command", events.ARMED_BY, events.COMMAND_EXTERNAL)
        return Result.ACCEPTED

    def disarm(self, *, force: bool) -> Result:
        """MAV_CMD_COMPONENT_ARM_DISARM with 0."""
        s = self._situation
        if not s.armed:
            return Result.ACCEPTED
        if not s.landed and not force:
            s.say(Severity.CRITICAL, "Disarming denied: not landed", events.DISARMING_DENIED)
            return Result.TEMPORARILY_REJECTED
        self.stop_motors("Disarmed by external command", events.COMMAND_EXTERNAL)
        return Result.ACCEPTED

    def stop_motors(self, text: str, reason: int) -> None:
        """Disarm, landed or not, and say so; a landing or take-off that was wanted is over."""
        s = self._situation
        if s.failsafe is not None:
            self._health.consider_warned()
        self._phases.rest()
        self._land_detector.disarmed()
        s.armed = False
        s.failsafe = None
        s.entered = None
        s.climb_to_m = None
        if s.intended in (Mode.LAND, Mode.RETURN):
            s.intended = s.before_landing
        if s.intended in (Mode.TAKEOFF, Mode.MISSION):
            s.intended = Mode.HOLD
        s.say(Severity.INFO, text, events.DISARMED_BY, reason)

    # ------------------------------------------------------------ modes

    def takeoff(self, altitude_amsl_m: float | None) -> Result:
        """MAV_CMD_NAV_TAKEOFF."""
        s = self._situation
        height_m = float(s.parameters["MIS_TAKEOFF_ALT"])
        base_ned_m = s.home_ned_m if s.armed else s.estimated_position_ned_m
        target_m = base_ned_m[2] - height_m
        if altitude_amsl_m is not None and math.isfinite(altitude_amsl_m):
            target_m = s.origin[2] - altitude_amsl_m
        elif s.armed:
            s.say(
                Severity.INFO,
                f"Using default takeoff altitude: {height_m:.1f} m",
                events.TAKEOFF_ALTITUDE,
                height_m,
            )
        s.ask_for(Mode.TAKEOFF)
        s.climb_to_m = min(target_m, s.estimated_position_ned_m[2])
        return Result.ACCEPTED

    def land(self) -> Result:
        """MAV_CMD_NAV_LAND."""
        self._situation.say(Severity.INFO, "Landing at current position", events.LANDING_HERE)
        self._situation.ask_for(Mode.LAND)
        return Result.ACCEPTED

    def return_to_launch(self) -> Result:
        """MAV_CMD_NAV_RETURN_TO_LAUNCH."""
        self._situation.say(Severity.INFO, "Returning to launch", events.RETURNING)
        self._situation.ask_for(Mode.RETURN)
        return Result.ACCEPTED

    def hold_at(self, position_ned_m: Vector3) -> Result:
        """MAV_CMD_DO_REPOSITION."""
        s = self._situation
        here = s.estimated_position_ned_m
        n, e, d = (h if math.isnan(p) else p for p, h in zip(position_ned_m, here, strict=True))
        s.ask_for(Mode.HOLD)
        if s.armed:
            self._phases.hold_at((n, e, d))
        return Result.ACCEPTED

    def start_mission(self, first: int) -> Result:
        """MAV_CMD_MISSION_START."""
        s = self._situation
        if not s.mission.items or not s.mission.set_current(first):
            s.say(
                Severity.CRITICAL, "Mission start denied! No valid mission", events.MISSION_DENIED
            )
            return Result.DENIED
        result = self.arm()
        if result is Result.ACCEPTED:
            s.ask_for(Mode.MISSION)
        return result

    def set_mode(self, main: int, sub: int) -> Result:
        """MAV_CMD_DO_SET_MODE."""
        s = self._situation
        try:
            mode = Mode(sub << 24 | main << 16)
        except ValueError:
            s.say(Severity.CRITICAL, "Unsupported main mode")
            return Result.TEMPORARILY_REJECTED
        if mode is Mode.OFFBOARD and self._refusals.get("offboard"):
            return self._refuse("offboard")
        if s.armed and not s.available(mode):
            s.say(
                Severity.CRITICAL,
                f"Switching to {_NAMES[mode]} is currently not available",
                events.MODE_NOT_AVAILABLE,
                int(mode),
                mode.main,
            )
            return Result.TEMPORARILY_REJECTED
        if mode is Mode.TAKEOFF and s.climb_to_m is None:
            s.climb_to_m = s.default_takeoff_m
        s.ask_for(mode)
        return Result.ACCEPTED

    # ------------------------------------------------------------ faults

    def refuse(self, what: str, texts: tuple[str, ...]) -> None:
        """Refuse "arm" or "offboard" with these texts from now on; with none, no longer."""
        self._refusals[what] = texts

    def take_refused(self, what: str) -> int:
        """How often that was refused since it was last asked."""
        return self._refused.pop(what, 0)

    def _refuse(self, what: str) -> Result:
        self._refused[what] += 1
        for text in self._refusals[what]:
            preflight = text.startswith("Preflight")
            self._situation.say(Severity.WARNING if preflight else Severity.CRITICAL, text)
        return Result.TEMPORARILY_REJECTED
