"""Whose the vehicle is: which of its modes are there because this program asked for them."""

from hal.readings import FlightMode
from hal.setpoints import RequestKind

_MODES = {
    # PX4 goes to Hold by itself at the end of a take-off.
    RequestKind.TAKEOFF: frozenset({FlightMode.TAKEOFF, FlightMode.HOLD}),
    RequestKind.OFFBOARD: frozenset({FlightMode.OFFBOARD}),
    RequestKind.HOLD: frozenset({FlightMode.HOLD}),
    RequestKind.LAND: frozenset({FlightMode.LAND}),
}


class Custody:
    """Follows requests and heartbeats; `holds(mode)` is False once somebody else chose the mode.

    Nothing is held before the first take-off is asked for: a vehicle that a person flies meanwhile
    is theirs in every mode. A heartbeat tells a new mode up to a second late, so the modes before
    a request count until one of the new modes was seen, and no longer. What was lost once is
    regained only by taking off again.
    """

    def __init__(self) -> None:
        self._wanted: frozenset[FlightMode] = frozenset()
        self._before: frozenset[FlightMode] = frozenset()

    def asked(self, kind: RequestKind) -> None:
        """This program is about to ask for `kind`."""
        modes = _MODES.get(kind)
        if modes is None or modes == self._wanted:
            return
        if not self._wanted and kind is not RequestKind.TAKEOFF:
            return
        self._before |= self._wanted
        self._wanted = modes

    def adopt(self, *kinds: RequestKind) -> None:
        """This program's last life, or PX4's failsafe, asked for one of `kinds`."""
        self._wanted = frozenset().union(*(_MODES[kind] for kind in kinds))
        self._before = frozenset()

    def see(self, mode: FlightMode) -> None:
        """The vehicle says that it is in `mode`."""
        if mode in self._wanted:
            self._before = frozenset()

    def let_go(self) -> None:
        """Somebody else has the vehicle."""
        self._wanted = self._before = frozenset()

    @property
    def climbs_when_armed(self) -> bool:
        """This program asked for Takeoff last: a disarmed vehicle may stand there in it."""
        return FlightMode.TAKEOFF in self._wanted

    def holds(self, mode: FlightMode) -> bool:
        """True while `mode`, which the vehicle says it is in, is this program's doing."""
        self.see(mode)
        return mode in self._wanted or mode in self._before
