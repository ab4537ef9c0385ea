"""What may stop a flight: faults, by the table in `failsafe.py`; PX4 or a pilot who takes over."""

import math

import msgspec

from autonomy.config import Config
from autonomy.mission import failsafe
from autonomy.mission.machine import NAVIGATING_STATES, OFFBOARD_STATES
from autonomy.mission.sensing import Sensing
from autonomy.mission.sequence import Move, Sequence
from autonomy.mission.tick import Tick
from autonomy.model import Ending, MissionState, Outcome
from hal.readings import FlightMode, VehicleStatus

_STALL_S = 0.5
"""A loop that comes later than this did not listen meanwhile: silence then says nothing."""


class Responding:
    """Looks at every tick before the present state does."""

    def __init__(self, config: Config, sensing: Sensing, sequence: Sequence) -> None:
        self._config = config
        self._sensing = sensing
        self._sequence = sequence
        self._armed_s: float | None = None
        self._listening_since_s = -math.inf

    def armed(self, now_s: float) -> None:
        """The mission's time begins."""
        self._armed_s = now_s

    def listen(self, tick: Tick) -> None:
        """Once a tick, before anything is asked."""
        if tick.dt_s > _STALL_S:
            self._listening_since_s = tick.now_s

    def respond(self, tick: Tick) -> Move | None:
        """Let go when PX4 or a pilot took over; else do what the fault table says."""
        status = self._status(tick)
        heard = status.link_age_s <= self._config.vehicle.link_timeout_s
        why = self._who_took_it(tick.state, status) if heard else None
        if why is not None:
            return Move(MissionState.YIELDED, why, Outcome(Ending.TAKEN_OVER, why))
        if tick.state not in OFFBOARD_STATES and tick.state is not MissionState.TAKEOFF:
            return None
        found = self.faults(tick)
        if not found:
            return None
        worst = found[0]
        if worst.response is failsafe.Response.LAND:
            why = f"{worst.why}: landing"
            return Move(MissionState.LAND, why, Outcome(worst.ending, worst.why))
        if tick.state in NAVIGATING_STATES - {MissionState.HOLD}:
            return Move(MissionState.HOLD, f"{worst.why}: holding")
        return None

    def faults(self, tick: Tick) -> tuple[failsafe.Found, ...]:
        """Faults present now, strongest response first."""
        mission_s = tick.now_s - self._armed_s if self._armed_s is not None else 0.0
        return failsafe.detect(
            self._config,
            self._status(tick),
            tick.fused,
            self._sensing.state_lost_s(tick.now_s),
            self._silent_beams(tick),
            mission_s,
        )

    def _who_took_it(self, state: MissionState, status: VehicleStatus) -> str | None:
        """Why the vehicle is no longer this service's to command; None while it is."""
        if state in OFFBOARD_STATES | {MissionState.TAKEOFF} and not status.armed:
            return "a pilot or PX4 disarmed the vehicle; this service lets go"
        if self._sequence.taken_over(state, status) or (
            state in NAVIGATING_STATES and status.mode is not FlightMode.OFFBOARD
        ):
            who = "PX4's failsafe" if status.in_failsafe else "a pilot or PX4"
            return f"{who} switched the vehicle to {status.mode.value}; this service lets go"
        return None

    def _silent_beams(self, tick: Tick) -> dict[str, float]:
        """Horizontal beams without a fresh reading, silent only for as long as this loop has
        listened: one that stood still hears first whether PX4's failsafe has the vehicle.
        """
        listened_s = tick.now_s - self._listening_since_s
        silent = self._sensing.silent_horizontal_beams(tick.now_s)
        return {name: min(age_s, listened_s) for name, age_s in silent.items()}

    def _status(self, tick: Tick) -> VehicleStatus:
        """The vehicle's status, silent only for as long as this loop has listened."""
        status = tick.inputs.status
        listened_s = tick.now_s - self._listening_since_s
        if status.link_age_s <= listened_s:
            return status
        return msgspec.structs.replace(status, link_age_s=listened_s)
