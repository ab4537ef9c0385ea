"""What stands against arming, and what is said about it: PX4's arming checks."""

from hal.sim import px4_events as events
from hal.sim.autopilot_situation import GLOBAL_MODES, Situation
from hal.sim.px4 import Mode, Severity

_HEADING = "no heading reference"
_NO_GNSS = "Preflight: GPS fix too low"
_NO_GLOBAL_POSITION = "Navigation error: No valid global position estimate"


class Health:
    """The checks before arming. Armable `armable_s` at the earliest, in autopilot time."""

    def __init__(self, situation: Situation, armable_s: float) -> None:
        self._situation = situation
        self._armable_s = armable_s
        self._said_reason = ""
        self._warned_mode: Mode | None = None
        self.fault = ""
        """A reason from outside, in PX4's words; empty without one."""

    @property
    def not_armable_because(self) -> str:
        """Why arming would be refused; empty when it would not."""
        s = self._situation
        if s.now_s < self._armable_s:
            return f"Preflight Fail: {_HEADING}"
        if self.fault:
            return self.fault
        if not s.gnss.position_valid:
            return _NO_GNSS
        if s.ground_station.lost and int(s.parameters["NAV_DLL_ACT"]) > 0:
            return "Preflight Fail: No connection to the GCS"
        if s.intended.needs_pilot:
            return "Mode needs a remote control"
        if s.intended is Mode.OFFBOARD and not s.setpoint_fresh():
            return "No offboard signal"
        if s.intended in GLOBAL_MODES and not s.global_position:
            return _NO_GLOBAL_POSITION
        return ""

    def report_anew(self) -> None:
        """Say what stands against arming, also what was said before."""
        self._said_reason = ""
        reason = self.not_armable_because
        if reason and not self._situation.armed:
            self.say_why_not(reason)

    def say_why_not(self, reason: str) -> None:
        """PX4's words on what stands against arming, once for as long as it does."""
        if reason == _NO_GLOBAL_POSITION:
            self._situation.report(events.NO_GLOBAL_POSITION, events.GLOBAL_MODES, 0)
        if reason.startswith("Preflight") and reason != self._said_reason:
            severity = Severity.CRITICAL if reason.endswith(_HEADING) else Severity.WARNING
            self._situation.say(severity, reason)
        self._said_reason = reason

    def complain_of_gnss(self) -> None:
        """Say that there is no fix, whether or not it was said before."""
        self._situation.say(Severity.WARNING, _NO_GNSS)
        self._said_reason = _NO_GNSS

    def warn_without_setpoints(self) -> None:
        """OFFBOARD selected on the ground without setpoints is worth a warning, once."""
        s = self._situation
        without = not s.armed and s.intended is Mode.OFFBOARD and not s.setpoint_fresh()
        if without and self._warned_mode is not s.intended:
            s.report(events.FAILSAFE_WARNING, int(s.intended))
        self._warned_mode = s.intended if without else None

    def consider_warned(self) -> None:
        """What a failsafe has announced about the mode is not announced again."""
        self._warned_mode = self._situation.intended
