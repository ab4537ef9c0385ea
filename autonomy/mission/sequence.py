"""From the ground into the air and back: preflight, arm, take off, offboard; land, done.

Each function is one state. It looks at the tick, asks the autopilot for things, and returns where
to go next, or None to stay.
"""

import math

import msgspec

from autonomy.config import Config
from autonomy.mission import preflight
from autonomy.mission.tick import Tick
from autonomy.model import Ending, MissionState, Outcome
from hal.readings import FlightMode, LandedState, VehicleStatus
from hal.setpoints import RequestKind

_REPEAT_LAND_S = 2.0
_STREAM_BEFORE_OFFBOARD_S = 0.3
_OFFBOARD_TIMEOUT_S = 5.0
_OFFBOARD_AGAIN_S = 0.5
_ARM_TIMEOUT_S = 5.0
_SILENCE_ENDS_LANDING_S = 10.0
# PX4 disarms 2 s after landing (COM_DISARM_LAND); it is asked only when it did not.
_DISARMS_ITSELF_S = 5.0
# Positions may still be on their way when the link has just opened.
_GLOBAL_POSITION_COMES_S = 1.5
# The mode that was selected for arming is given back when the flight does not happen: two requests
# one after another, and a heartbeat.
_GIVE_BACK_S = 5.0
# The link tells what the vehicle does within this.
_IN_THE_AIR_S = 1.5
# Where PX4 does not end its take-off in Hold, it is over at this part of the height.
_CLIMBED = 0.85
_SETTLE_S = 1.0
# A heartbeat a second tells "armed": so long after the answer to ARM nothing of it is outstanding.
_ARMED_IS_TOLD_S = 1.5
# Requests wait for each other: the answer to ARM may come so many times its own time late.
_REQUESTS_BEFORE_ARM = 2.0
_OFF_THE_GROUND_M = 0.3

_TAKING_OFF = frozenset({FlightMode.TAKEOFF, FlightMode.HOLD, FlightMode.OFFBOARD})
_PHASES = {
    MissionState.TAKEOFF: (FlightMode.TAKEOFF, _TAKING_OFF),
    MissionState.OFFBOARD: (FlightMode.TAKEOFF, _TAKING_OFF),
    MissionState.LAND: (FlightMode.LAND, frozenset({FlightMode.LAND})),
}
"""By state: the mode that was asked for, and those that follow from what was asked."""


class Move(msgspec.Struct, frozen=True):
    """Go to `state`; `why` is told to people; `outcome` is the verdict if this ends the mission."""

    state: MissionState
    why: str
    outcome: Outcome | None = None


def stopped(state: MissionState, doing: str = "") -> Move:
    """The operator ended the mission."""
    why = "stopped by the operator"
    return Move(state, f"{why}{doing}", Outcome(Ending.ABORTED, why))


def _off_the_ground(tick: Tick) -> bool:
    """True for a vehicle that is known to be higher than where it was armed."""
    return tick.fused.ok and -tick.fused.position_ned_m[2] > _OFF_THE_GROUND_M


class Sequence:
    """The states around the flight proper. Remembers only when it asked last."""

    def __init__(self, config: Config) -> None:
        self._config = config
        self._asked: set[RequestKind] = set()
        self._asked_to_land_s = -math.inf
        self._on_ground_since_s = math.inf
        self._offboard_accepted = False
        self._offboard_refusal = f"it did not switch within {_OFFBOARD_TIMEOUT_S:g} s"
        self._offboard_from_s = _STREAM_BEFORE_OFFBOARD_S
        self._seen: set[FlightMode] = set()
        self._selected_takeoff = False
        self._takeoff_shown = False
        """The vehicle told that it is in the selected mode, or cannot be any more."""
        self._gives_back_since_s: float | None = None
        self._arming_until_s = -math.inf
        """An ARM that was asked for may take effect until then."""
        self._refusal_to_arm = ""

    def preflight(
        self,
        tick: Tick,
        elapsed_s: float,
        silent: tuple[str, ...],
        room_above_m: float | None = None,
        covered: tuple[str, ...] = (),
    ) -> Move | None:
        """Wait until nothing forbids arming, or refuse when the time is up, or when told to stop.

        After a landing PX4 shows the mode that was flown before, Offboard, and does not arm in it.
        In Hold it does not arm either without a global position, which a room may not have; in
        Takeoff it does, so that is selected then.
        """
        status = tick.inputs.status
        if tick.stopping:
            return None if self._gives_back(tick) else stopped(MissionState.DONE)
        if status.mode is FlightMode.OFFBOARD and not status.armed:
            self._ask_once(tick, RequestKind.HOLD)
        if elapsed_s > _GLOBAL_POSITION_COMES_S and preflight.hold_keeps_down(status):
            self._select_takeoff(tick)
        self._note_takeoff(status)
        found = preflight.findings(
            self._config,
            tick.inputs.facts,
            tick.inputs.status,
            tick.fused,
            silent,
            room_above_m,
            covered,
        )
        if not found:
            return Move(MissionState.ARM, "every check on the ground passed")
        patience_s = self._config.mission.preflight_timeout_s
        if status.armed and status.landed not in (LandedState.ON_GROUND, LandedState.UNKNOWN):
            # Waiting cannot help: somebody flies it, or PX4 holds it for a service that was killed.
            patience_s = min(patience_s, _IN_THE_AIR_S)
        if elapsed_s < patience_s or self._gives_back(tick):
            return None
        why = "; ".join(found)
        return Move(MissionState.DONE, why, Outcome(Ending.PREFLIGHT_REFUSED, why))

    def _select_takeoff(self, tick: Tick) -> None:
        """Ask a vehicle that is disarmed for Takeoff: it climbs as soon as it is armed."""
        self._selected_takeoff = True
        self._ask_once(tick, RequestKind.TAKEOFF, self._config.mission.altitude_m)

    def _note_takeoff(self, status: VehicleStatus) -> None:
        self._takeoff_shown |= self._selected_takeoff and status.mode is FlightMode.TAKEOFF

    def _gives_back(self, tick: Tick) -> bool:
        """True while a disarmed vehicle is being brought from the selected Takeoff into Hold: the
        next person to arm it must not be surprised by a climb.
        """
        status = tick.inputs.status
        if not self._selected_takeoff or status.armed:
            return False
        self._note_takeoff(status)
        if self._gives_back_since_s is None:
            self._gives_back_since_s = tick.now_s
            self._asked.discard(RequestKind.HOLD)
        elif tick.accepted(RequestKind.HOLD):
            self._takeoff_shown = True  # requests are answered in turn: the selection is over
        if self._takeoff_shown and status.mode is not FlightMode.TAKEOFF:
            return False
        self.ask_hold(tick)
        return tick.now_s - self._gives_back_since_s <= _GIVE_BACK_S

    def arm(self, tick: Tick, elapsed_s: float) -> Move | None:
        """Arm once; refused means the flight does not happen."""
        if tick.inputs.status.armed:
            self._asked.discard(RequestKind.HOLD)  # the mission's end may ask for it again
            return Move(MissionState.TAKEOFF, "the vehicle is armed")
        reason = tick.refusal(RequestKind.ARM)
        if reason is None and elapsed_s > _ARM_TIMEOUT_S:
            reason = f"it did not report armed within {_ARM_TIMEOUT_S:g} s"
        self._refusal_to_arm = self._refusal_to_arm or reason or ""
        self._note_arming(tick)
        if self._refusal_to_arm:
            if self._gives_back(tick):
                return None
            why = f"the vehicle refused to arm: {self._refusal_to_arm}"
            return Move(MissionState.LAND, why, Outcome(Ending.PREFLIGHT_REFUSED, why))
        if RequestKind.ARM not in self._asked:
            answer_s = self._config.vehicle.request_timeout_s * _REQUESTS_BEFORE_ARM
            self._arming_until_s = tick.now_s + answer_s + _ARMED_IS_TOLD_S
        self._ask_once(tick, RequestKind.ARM)
        return None

    def _note_arming(self, tick: Tick) -> None:
        """An ARM may take effect until it was answered, and is told a little later."""
        if any(reply.kind is RequestKind.ARM for reply in tick.inputs.replies):
            self._arming_until_s = tick.now_s + _ARMED_IS_TOLD_S

    def takeoff(self, tick: Tick, elapsed_s: float) -> Move | None:
        """Let PX4 climb to the altitude and reach Hold, or its end without a global position:
        Hold needs one, and PX4 stays in Takeoff then.
        """
        status = tick.inputs.status
        height_m = -tick.fused.position_ned_m[2]
        in_hold = status.landed is LandedState.IN_AIR and status.mode is FlightMode.HOLD
        up_there = tick.fused.ok and height_m >= _CLIMBED * self._config.mission.altitude_m
        climbed = status.mode is FlightMode.TAKEOFF and not status.global_position and up_there
        if in_hold or climbed:
            return Move(MissionState.OFFBOARD, f"took off to {height_m:.2f} m")
        reason = tick.refusal(RequestKind.TAKEOFF)
        if reason is None and elapsed_s > self._config.mission.takeoff_timeout_s:
            reason = f"not in the air after {self._config.mission.takeoff_timeout_s:g} s"
        if reason is not None:
            why = f"the take-off failed: {reason}"
            return Move(MissionState.LAND, why, Outcome(Ending.PREFLIGHT_REFUSED, why))
        self._ask_once(tick, RequestKind.TAKEOFF, self._config.mission.altitude_m)
        return None

    def offboard(self, tick: Tick, elapsed_s: float) -> Move | None:
        """Stream setpoints, then ask for Offboard and wait until PX4 reports it."""
        if tick.accepted(RequestKind.OFFBOARD):
            self._offboard_accepted = True
        if self._offboard_accepted and tick.inputs.status.mode is FlightMode.OFFBOARD:
            return Move(MissionState.DETECT, "PX4 lets this service fly; looking around first")
        reason = tick.refusal(RequestKind.OFFBOARD)
        if reason is not None:
            # The vehicle hovers in Hold: a refusal for want of a fresh position may pass.
            self._offboard_refusal = reason
            self._asked.discard(RequestKind.OFFBOARD)
            self._offboard_from_s = elapsed_s + _OFFBOARD_AGAIN_S
        if elapsed_s > _OFFBOARD_TIMEOUT_S:
            why = f"PX4 refused Offboard: {self._offboard_refusal}"
            return Move(MissionState.LAND, why, Outcome(Ending.OFFBOARD_REFUSED, why))
        if elapsed_s >= self._offboard_from_s and tick.fused.ok:
            self._ask_once(tick, RequestKind.OFFBOARD)
        return None

    def land(self, tick: Tick, elapsed_s: float) -> Move | None:
        """Ask for Land until PX4 lands, disarms on the ground, then the mission is done."""
        status = tick.inputs.status
        if status.link_age_s > _SILENCE_ENDS_LANDING_S:
            why = (
                f"the vehicle has been silent for {status.link_age_s:.0f} s while landing; "
                "PX4's own failsafe has it now"
            )
            return Move(MissionState.DONE, why, Outcome(Ending.LINK_LOST, why))
        self._note_arming(tick)
        on_ground = status.landed in (LandedState.ON_GROUND, LandedState.UNKNOWN)
        settled = elapsed_s >= _SETTLE_S and tick.now_s >= self._arming_until_s
        if not status.armed and on_ground and not self._gives_back(tick) and settled:
            return Move(MissionState.DONE, "landed and disarmed")
        if elapsed_s > self._config.mission.land_timeout_s:
            why = (
                "the vehicle did not report landed and disarmed within "
                f"{self._config.mission.land_timeout_s:g} s; take it over by hand"
            )
            return Move(MissionState.DONE, why, Outcome(Ending.FAILSAFE, why))
        if status.armed:
            self._ask_to_land(tick)
        return None

    def _ask_to_land(self, tick: Tick) -> None:
        """LAND until it lands; on the ground a plain disarm where PX4 did not disarm by itself."""
        status = tick.inputs.status
        down = status.landed is LandedState.ON_GROUND and not _off_the_ground(tick)
        if not down:
            self._on_ground_since_s = math.inf
        elif self._on_ground_since_s == math.inf:
            self._on_ground_since_s = tick.now_s
        if tick.now_s - self._asked_to_land_s < _REPEAT_LAND_S:
            return
        if tick.now_s - self._on_ground_since_s >= _DISARMS_ITSELF_S:
            # PX4 refuses it should it know better.
            tick.ask(RequestKind.DISARM)
            self._asked_to_land_s = tick.now_s
        elif not down and status.mode is not FlightMode.LAND:
            tick.ask(RequestKind.LAND)
            self._asked_to_land_s = tick.now_s

    def in_the_air(self) -> None:
        """The flight goes on in PX4's Hold: the take-off is over."""
        self._seen.add(FlightMode.TAKEOFF)

    def taken_over(self, state: MissionState, status: VehicleStatus) -> bool:
        """True when somebody else switched the mode during take-off or landing.

        The heartbeat tells a new mode up to a second late, hence what was asked for must have
        been seen first, except that nobody but a pilot takes the sticks during a landing.
        """
        phase = _PHASES.get(state)
        if phase is None or not status.armed or status.landed is LandedState.ON_GROUND:
            return False
        asked_for, ours = phase
        if status.mode is asked_for:
            self._seen.add(asked_for)
        if status.mode in ours or status.mode is FlightMode.UNKNOWN:
            return False
        sticks = state is MissionState.LAND and status.mode is FlightMode.MANUAL
        return sticks or asked_for in self._seen

    def ask_hold(self, tick: Tick) -> None:
        """Ask for PX4's Hold, again when it was refused."""
        if tick.refusal(RequestKind.HOLD) is not None:
            self._asked.discard(RequestKind.HOLD)
        self._ask_once(tick, RequestKind.HOLD)

    def _ask_once(self, tick: Tick, kind: RequestKind, altitude_m: float = 0.0) -> None:
        """Ask the first time only: a repeated arm or take-off is never wanted."""
        if kind not in self._asked:
            self._asked.add(kind)
            tick.ask(kind, altitude_m)
