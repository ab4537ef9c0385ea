"""PX4's failsafes: who came and went on the link, and what the vehicle does about it.

Intervals: measured on PX4 main bb59c637cd, SIH quadrotor, 2026-11. The battery's failsafe belongs
to the fault that drains it (vehicle_faults.py).
"""

import math

from hal.sim import px4_events as events
from hal.sim.autopilot_health import Health
from hal.sim.autopilot_situation import Situation
from hal.sim.px4 import Mode, Severity
from hal.sim.px4_watch import Change

_COMPANION_LOSS_S = 4.5
_OBL_ACTIONS = {4: Mode.LAND, 5: Mode.HOLD}
_DLL_ACTIONS = {1: Mode.HOLD, 2: Mode.RETURN, 3: Mode.LAND, 5: Mode.TERMINATION}
_EVENT_ACTIONS = {
    Mode.HOLD: events.ACTION_HOLD,
    Mode.RETURN: events.ACTION_RETURN,
    Mode.LAND: events.ACTION_LAND,
    Mode.TERMINATION: events.ACTION_TERMINATE,
}


class Failsafes:
    """Writes `Situation.failsafe`; a mode that is asked for ends what is begun here."""

    def __init__(self, situation: Situation, health: Health) -> None:
        self._situation = situation
        self._health = health
        self._offboard_lost = False
        self._station_action: Mode | None = None
        self._station_action_s = math.inf

    def begin(self, mode: Mode) -> None:
        """A failsafe takes over; nothing happens while disarmed."""
        if self._situation.armed:
            self._situation.failsafe, self._offboard_lost = mode, False
            self._announce(mode)

    def terminate(self) -> None:
        """Motors off for good."""
        self._situation.intended = self._situation.failsafe = Mode.TERMINATION
        self._announce(Mode.TERMINATION)

    def watch(self) -> None:
        """Notice who came and went on the link, and whether the position is good."""
        self._watch_station()
        self._watch_companion()
        self._watch_gnss()
        self._health.warn_without_setpoints()

    def act(self) -> None:
        """While armed: take over when setpoints stop, or when a ground station stays away."""
        self._check_offboard()
        self._check_station()

    def _watch_station(self) -> None:
        s = self._situation
        change = s.ground_station.step(s.now_s, float(s.parameters["COM_DL_LOSS_T"]))
        if change is Change.LOST:
            s.say(Severity.INFO, "Connection to ground station lost", events.STATION_LOST)
            self._plan_station_failsafe()
        elif change is Change.BACK:
            s.say(Severity.INFO, "GCS connection regained", events.STATION_BACK)
            self._station_action = None

    def _watch_companion(self) -> None:
        s = self._situation
        change = s.companion.step(s.now_s, _COMPANION_LOSS_S)
        if change is Change.LOST:
            s.say(Severity.CRITICAL, "Connection to mission computer lost", events.COMPANION_LOST)
        elif change is Change.BACK:
            s.say(Severity.INFO, "Onboard controller regained", events.COMPANION_BACK)

    def _watch_gnss(self) -> None:
        s = self._situation
        complains, position = s.gnss.step(s.now_s, fix=s.gnss_fix)
        if complains:
            self._health.complain_of_gnss()
        if position is Change.LOST and not s.armed:
            s.report(events.FAILSAFE_WARNING, int(s.intended))

    def _check_offboard(self) -> None:
        s = self._situation
        if s.intended is not Mode.OFFBOARD or s.landed:
            return
        if s.failsafe is not None:
            if self._offboard_lost and s.setpoint_fresh():
                s.failsafe = None
            return
        if s.setpoint_fresh(s.offboard_loss_jitter_s):
            return
        s.draw_offboard_loss()
        # Without a remote control every fallback to a piloted mode ends in a return.
        action = _OBL_ACTIONS.get(int(s.parameters["COM_OBL_RC_ACT"]), Mode.RETURN)
        # Hold falls through to Return, and Return to Land, where they cannot run (PX4's source).
        s.failsafe = action if s.available(action) else Mode.LAND
        self._offboard_lost = True
        self._announce(s.failsafe)

    def _plan_station_failsafe(self) -> None:
        s = self._situation
        action = _DLL_ACTIONS.get(int(s.parameters["NAV_DLL_ACT"]))
        if action is None or not s.armed or s.failsafe is not None:
            return
        delay_s = float(s.parameters["COM_FAIL_ACT_T"])
        self._station_action, self._station_action_s = action, s.now_s + delay_s
        s.failsafe, self._offboard_lost = Mode.HOLD, False
        s.say(
            Severity.CRITICAL,
            f"Failsafe activated: entering Hold for {delay_s:.0f} seconds",
            events.FAILSAFE_HOLDS,
            int(s.intended),
            _EVENT_ACTIONS[action],
            round(delay_s),
            events.CAUSE_GROUND_STATION_LOST,
        )

    def _check_station(self) -> None:
        s, action = self._situation, self._station_action
        if action is None or s.now_s < self._station_action_s:
            return
        self._station_action = None
        if s.failsafe is not Mode.HOLD:
            return
        s.failsafe = action
        s.say(
            Severity.CRITICAL,
            "Failsafe activated",
            events.FAILSAFE_OF,
            int(s.intended),
            _EVENT_ACTIONS[action],
            events.CAUSE_GROUND_STATION_LOST,
        )

    def _announce(self, mode: Mode) -> None:
        self._situation.say(
            Severity.CRITICAL,
            "Failsafe activated",
            events.FAILSAFE,
            int(Mode.TERMINATION if mode is Mode.TERMINATION else self._situation.intended),
            _EVENT_ACTIONS[mode],
        )
