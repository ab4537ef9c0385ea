"""LAND: down to the ground, or into PX4's Hold at the goal where the mission says so."""

from autonomy.config import Config
from autonomy.mission.sequence import Move, Sequence
from autonomy.mission.tick import Tick
from autonomy.model import Ending, MissionState, Outcome
from hal.readings import FlightMode

_HANDOVER_TIMEOUT_S = 5.0


class Landing:
    """Remembers whether staying up has been given up."""

    def __init__(self, config: Config, sequence: Sequence) -> None:
        self._config = config
        self._sequence = sequence
        self._must_land = False

    def land(self, tick: Tick, outcome: Outcome | None) -> Move | None:
        """LAND, or end in PX4's Hold when the mission says so and the goal was reached."""
        if not self._stays_up(tick, outcome):
            return self._sequence.land(tick, tick.elapsed_s)
        if tick.inputs.status.mode is FlightMode.HOLD:
            return Move(MissionState.DONE, "holding at the goal in PX4's Hold mode")
        self._sequence.ask_hold(tick)
        return None

    def _stays_up(self, tick: Tick, outcome: Outcome | None) -> bool:
        """True while the mission is to end in PX4's Hold, and nothing is in the way of that."""
        reached = outcome is not None and outcome.ending is Ending.GOAL_REACHED
        if self._config.mission.land_at_end or not reached or self._must_land:
            return False
        if tick.inputs.commands or tick.faults:
            self._must_land = True
        elif tick.elapsed_s > _HANDOVER_TIMEOUT_S:
            self._must_land = True
            tick.say("land", "PX4 did not take the vehicle into Hold; landing instead")
        return not self._must_land
