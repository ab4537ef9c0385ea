"""What may stop a flight: faults, by the table in `failsafe.py`; PX4 or a pilot who takes over."""

import math

import msgspec

from autonomy.config import Config
from autonomy.geometry import distance
from autonomy.mission.drift import Drift
from autonomy.mission.failsafe import RULES, Fault, Found, Response, Situation, detect
from autonomy.mission.machine import NAVIGATING_STATES, OFFBOARD_STATES, PATH_STATES
from autonomy.mission.persistence import Persistence
from autonomy.mission.reserve import Reserve
from autonomy.mission.sensing import Sensing
from autonomy.mission.sequence import Move, Sequence
from autonomy.mission.tick import Tick
from autonomy.mission.trail import Trail
from autonomy.model import MissionState, Outcome
from hal.readings import FlightMode, VehicleStatus

_STALL_S = 0.5
"""A loop that comes later than this did not listen meanwhile: silence then says nothing."""
_AIRBORNE = OFFBOARD_STATES | {MissionState.TAKEOFF}
_WATCHED = _AIRBORNE | {MissionState.LAND}
_WAY_BACK_FACTOR, _LANDING_S = 1.5, 15.0
"""How long a return takes: the trail at full speed times this, and the landing."""


class Responding:
    """Looks at every tick before the present state does."""

    def __init__(
        self, config: Config, sensing: Sensing, sequence: Sequence, trail: Trail, drift: Drift
    ) -> None:
        self._config = config
        self._sensing = sensing
        self._sequence = sequence
        self._trail = trail
        self._drift = drift
        self._persistence = Persistence(config)
        self._reserve = Reserve()
        self._armed_s: float | None = None
        self._listening_since_s = -math.inf
        self._fence_at: tuple[float, float] | None = None
        self._inside_m = 0.0
        self._put_off: set[Fault] = set()
        """Faults that return when the operator's HOLD is over, and were told."""

    def armed(self, now_s: float) -> None:
        """The mission's time begins."""
        self._armed_s = now_s

    @property
    def armed_s(self) -> float | None:
        """When it began."""
        return self._armed_s

    def listen(self, tick: Tick) -> None:
        """Once a tick, before anything is asked: what is wrong now goes into `tick.faults`."""
        if tick.dt_s > _STALL_S:
            self._listening_since_s = tick.now_s
        if tick.state not in _WATCHED:
            return
        self._reserve.note(tick.now_s, tick.inputs.status.battery_remaining)
        tick.faults = self._persistence.step(
            tick.now_s, detect(self._config, self._situation(tick))
        )
        self._put_off.intersection_update(each.fault for each in tick.faults)

    def respond(self, tick: Tick) -> Move | None:
        """Let go when PX4 or a pilot took over; else do what the fault table says."""
        status = self._status(tick)
        heard = status.link_age_s <= self._config.vehicle.link_timeout_s
        taken = self._taken(tick.state, status) if heard else None
        if taken is not None:
            fault, why = taken
            return Move(MissionState.YIELDED, why, Outcome(RULES[fault].ending, why))
        if tick.state not in _AIRBORNE or not tick.faults:
            return None
        worst = tick.faults[0]
        if worst.response is Response.LAND or (
            worst.response is Response.RETURN and not self._may_return(tick, worst)
        ):
            return _ends(worst, MissionState.LAND, "landing")
        return self._interrupt(tick, worst)

    def _interrupt(self, tick: Tick, worst: Found) -> Move | None:
        """The responses that leave the vehicle in the air: return, hold, stop, slow."""
        if tick.state not in NAVIGATING_STATES:
            return None
        hold = next((each for each in tick.faults if each.response is Response.HOLD), None)
        if hold is not None:
            # What holds, holds a return as well.
            held = tick.state is MissionState.HOLD
            return None if held else Move(MissionState.HOLD, f"{hold.why}: holding")
        if worst.response is Response.RETURN:
            return self._turn_back(tick, worst)
        if worst.response is Response.STOP and tick.state in PATH_STATES:
            return Move(MissionState.STOP, f"{worst.why}: stopping to look")
        return None

    def _turn_back(self, tick: Tick, worst: Found) -> Move | None:
        """Return, unless the operator said otherwise: HOLD puts it off, STOP lands instead."""
        if tick.returning or tick.stopping:
            return None
        if not tick.held:
            return _ends(worst, MissionState.RETURN, "returning")
        if worst.fault not in self._put_off:
            self._put_off.add(worst.fault)
            tick.say("hold", f"{worst.why}: held by the operator; returning when told to go on")
        return None

    def _may_return(self, tick: Tick, worst: Found) -> bool:
        """False where landing here is the better end: on the way up, or with too little left."""
        if tick.state not in NAVIGATING_STATES:
            return False
        if worst.fault is not Fault.BATTERY_LOW or tick.returning:
            return True
        way_s = _WAY_BACK_FACTOR * self._trail.length_m / self._config.guidance.speed_max_m_s
        return self._reserve.lasts_s(self._config.failsafe.battery_land) >= way_s + _LANDING_S

    def _situation(self, tick: Tick) -> Situation:
        """What the detectors look at."""
        point, jump_m = tick.fused.point, self._sensing.jump_m
        if jump_m > 0.0:
            self._drift.restart()
        if tick.state in NAVIGATING_STATES:
            self._drift.step(tick.fused, tick.dt_s, self._sensing.map, tick.now_s)
            self._trail.count_way(point)
        else:
            self._drift.restart()
        return Situation(
            status=self._status(tick),
            fused=tick.fused,
            state_lost_s=self._sensing.state_lost_s(tick.now_s),
            beams_lost=self._sensing.lookout.too_few(tick.now_s),
            beam_lost_now=self._sensing.lookout.lost_now,
            mission_s=tick.now_s - self._armed_s if self._armed_s is not None else 0.0,
            path_m=self._trail.flown_m,
            returning=tick.returning,
            jump_m=jump_m,
            outside_m=self._outside_m(point) if tick.state in NAVIGATING_STATES else -math.inf,
            drift_m=self._drift.drift_m,
            drift_limit_m=self._drift.limit_m,
            drift_near=self._drift.towards_something,
            drift_s=self._drift.over_s(tick.fused.stamp_s),
        )

    def _outside_m(self, point: tuple[float, float]) -> float:
        """How far outside the fence; looked at only where it may have come near since."""
        at = self._fence_at
        if at is None or distance(at, point) >= self._inside_m:
            self._fence_at = point
            self._inside_m = self._config.guard.fence.inside_distance_m(*point)
        return -self._inside_m

    def _taken(self, state: MissionState, status: VehicleStatus) -> tuple[Fault, str] | None:
        """Why the vehicle is no longer this service's to command; None while it is."""
        if state in _AIRBORNE and not status.armed:
            return Fault.DISARMED, "a pilot or PX4 disarmed the vehicle; this service lets go"
        if self._sequence.taken_over(state, status) or (
            state in NAVIGATING_STATES and status.mode is not FlightMode.OFFBOARD
        ):
            fault = Fault.OFFBOARD_LOST if status.in_failsafe else Fault.PILOT_TAKEOVER
            who = "PX4's failsafe" if status.in_failsafe else "a pilot or PX4"
            why = f"{who} switched the vehicle to {status.mode.value}; this service lets go"
            return fault, why
        return None

    def _status(self, tick: Tick) -> VehicleStatus:
        """The vehicle's status, silent only for as long as this loop has listened."""
        status = tick.inputs.status
        listened_s = tick.now_s - self._listening_since_s
        if status.link_age_s <= listened_s:
            return status
        return msgspec.structs.replace(status, link_age_s=listened_s)


def _ends(fault: Found, state: MissionState, doing: str) -> Move:
    """The mission is over because of this fault."""
    return Move(state, f"{fault.why}: {doing}", Outcome(fault.ending, fault.why))
