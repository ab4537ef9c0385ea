"""When the vehicle really leaves the ground, and when PX4 believes that it did, or has landed.

PX4's belief is later than the truth by up to two seconds. Intervals: measured on PX4 main
bb59c637cd, SIH quadrotor, 2026-11.
"""

import math

from hal.sim import px4_events as events
from hal.sim.autopilot_situation import Situation
from hal.sim.px4 import Mode, Severity
from hal.sim.quadrotor import Command

_DETECT_AFTER_SPOOL_UP_S = 0.83
_LIFT_OFF_AUTO_S = -0.1  # against the end of the thrust ramp, MPC_TKO_RAMP_T
_LIFT_OFF_OFFBOARD_S = -0.7
_LANDING_DETECTED_S = 1.8
_FREE_FALL_LANDED_S = 0.43


class LandDetector:
    """Writes `Situation.landed` and `Situation.airborne`."""

    def __init__(self, situation: Situation) -> None:
        self._situation = situation
        self._kill_s: float | None = None
        self._ramp_s: float | None = None
        self._landed_s: float | None = None
        self._touch_s: float | None = None
        self._flown = False

    def armed(self) -> None:
        """The motors begin to turn."""
        self._situation.airborne = self._flown = False
        self._ramp_s = self._landed_s = self._touch_s = None

    def disarmed(self) -> None:
        """The motors stand still; in the air it falls from now on."""
        s = self._situation
        self._kill_s = None if s.landed else s.now_s
        s.airborne = False
        self._ramp_s = self._landed_s = self._touch_s = None

    def detect_fall(self) -> None:
        """While disarmed: what was killed in the air lies on the ground at last."""
        s, since = self._situation, self._kill_s
        if since is not None and (s.quadrotor.on_ground or s.now_s - since > _FREE_FALL_LANDED_S):
            s.landed = True

    def lift_off(self, command: Command) -> bool:
        """Spool up, ramp the thrust, leave the ground; True when it has just left it."""
        s = self._situation
        if s.airborne:
            return False
        climbing = s.mode in (Mode.TAKEOFF, Mode.OFFBOARD, Mode.MISSION) and (
            self._wanted_down_m_s(command) < -0.05
        )
        if not climbing:
            if s.landed:
                self._ramp_s = None
            return False
        if self._ramp_s is None:
            spooled_s = s.armed_s + float(s.parameters["COM_SPOOLUP_TIME"])
            self._ramp_s = max(s.now_s, spooled_s)
        since_s = s.now_s - self._ramp_s
        if s.landed and since_s >= _DETECT_AFTER_SPOOL_UP_S:
            self._takeoff_detected()
        ramp_s = float(s.parameters["MPC_TKO_RAMP_T"])
        early_s = _LIFT_OFF_OFFBOARD_S if s.mode is Mode.OFFBOARD else _LIFT_OFF_AUTO_S
        if s.landed or since_s < ramp_s + early_s:
            return False
        s.airborne = True
        self._touch_s = None
        return True

    def detect_landing(self, command: Command) -> None:
        """On the ground and still asked down for long enough: landed."""
        s = self._situation
        # A take-off may be called off when it was detected and the ground not left yet.
        if not s.airborne and s.landed:
            return
        if not s.quadrotor.on_ground or self._wanted_down_m_s(command) < 0.05:
            self._touch_s = None
            return
        if self._touch_s is None:
            self._touch_s = s.now_s
        if s.now_s - self._touch_s >= _LANDING_DETECTED_S:
            s.landed = True
            s.airborne = False
            self._ramp_s = None
            self._landed_s = s.now_s
            s.mission.landed()
            s.say(Severity.INFO, "Landing detected", events.LANDING_DETECTED)

    @property
    def disarm_because(self) -> tuple[str, int] | None:
        """(text, reason in the event) when it is time to disarm by itself, else None."""
        s = self._situation
        if not s.landed:
            return None
        if self._landed_s is not None:
            after_s = float(s.parameters["COM_DISARM_LAND"])
            if after_s >= 0.0 and s.now_s - self._landed_s >= after_s:
                return "Disarmed by landing", events.LANDING
            return None
        after_s = float(s.parameters["COM_DISARM_PRFLT"])
        limit_s = after_s + float(s.parameters["COM_SPOOLUP_TIME"])
        if after_s > 0.0 and not self._flown and s.now_s - s.armed_s >= limit_s:
            return "Disarmed by auto preflight disarming", events.PREFLIGHT_INACTION
        return None

    def _takeoff_detected(self) -> None:
        s = self._situation
        s.landed = False
        self._flown = True
        self._landed_s = None
        s.home_set_s = s.now_s
        s.say(Severity.INFO, "Takeoff detected", events.TAKEOFF_DETECTED)

    def _wanted_down_m_s(self, command: Command) -> float:
        down = command.velocity_ned_m_s[2]
        wanted = 0.0 if math.isnan(down) else down
        if not math.isnan(command.position_ned_m[2]):
            wanted += float(self._situation.parameters["MPC_Z_P"]) * (
                command.position_ned_m[2] - self._situation.estimated_position_ned_m[2]
            )
        return wanted
