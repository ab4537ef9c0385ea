"""What a person orders in flight, and the HOLD that waits for the end of an order or a fault."""

from autonomy.mission.failsafe import Response
from autonomy.mission.machine import NAVIGATING_STATES
from autonomy.mission.sequence import Move, stopped
from autonomy.mission.tick import Tick
from autonomy.model import MissionState, OperatorCommand, Outcome

_HOLD_BEFORE_LANDING_S = 3.0
_BRIEF_HOLD_S = 1.0
"""After a fault this short the flight goes on without a new look round: within one turn of the
scan nothing that was seen has become old."""
_OVER = frozenset({MissionState.LAND, MissionState.YIELDED, MissionState.DONE})


class Orders:
    """STOP holds and then lands; LAND, or a second STOP, lands at once.

    HOLD holds until RESUME; said before the vehicle navigates, it holds as soon as it does.
    Of the faults only those that land or let go come before either (`responding.py`).
    """

    def __init__(self) -> None:
        self._landing: Outcome | None = None
        """The verdict of a STOP that holds now and lands soon."""
        self._held = False

    def obey(self, tick: Tick, command: OperatorCommand) -> Move | None:
        """One order; None when it changes nothing now."""
        if tick.state in _OVER:
            return None
        if command in (OperatorCommand.HOLD, OperatorCommand.RESUME):
            self._held = command is OperatorCommand.HOLD
            return None
        if tick.state is MissionState.PREFLIGHT:
            self._landing = stopped(MissionState.DONE).outcome
            return None  # it ends there, when what was selected for arming was given back
        if (
            command is OperatorCommand.LAND
            or self._landing is not None
            or tick.state not in NAVIGATING_STATES
        ):
            return stopped(MissionState.LAND, ": landing")
        move = stopped(MissionState.HOLD, ": holding, landing soon")
        self._landing = move.outcome
        if tick.state is MissionState.HOLD:
            tick.entered_s = tick.now_s
            return None
        return move

    def stay(self, tick: Tick) -> Move | None:
        """After the orders of a tick: hold where HOLD was said."""
        tick.held, tick.stopping = self._held, self._landing is not None
        if self._held and tick.state in NAVIGATING_STATES - {MissionState.HOLD}:
            return Move(MissionState.HOLD, "held by the operator until told to go on")
        return None

    def hold(self, tick: Tick, held_from: MissionState) -> Move | None:
        """HOLD: until the fault is gone, or until the operator's landing is due."""
        if self._landing is not None:
            if tick.elapsed_s >= _HOLD_BEFORE_LANDING_S:
                return Move(MissionState.LAND, "held as ordered; landing", self._landing)
            return None
        if self._held or any(fault.response is Response.HOLD for fault in tick.faults):
            return None
        if tick.returning:
            return Move(MissionState.RETURN, "nothing forbids it any more; on with the return")
        flying = held_from in (MissionState.CRUISE, MissionState.FOLLOW)
        if flying and tick.elapsed_s < _BRIEF_HOLD_S:
            return Move(held_from, "a moment's fault is over; what was seen is still true")
        return Move(MissionState.DETECT, "nothing forbids it any more; looking around to go on")
