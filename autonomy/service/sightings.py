"""Which faults of the table a flight has seen. The control side notes, the web side reads."""

import msgspec

from autonomy.config import Config
from autonomy.mission.failsafe import RULES, Fault, response_to
from autonomy.model import Ending, Outcome
from autonomy.service.contract import FaultView
from hal.readings import VehicleStatus


class Sighting(msgspec.Struct, frozen=True):
    """One fault in one flight: how often it began, and when it was there, on the loop's clock."""

    times: int
    first_s: float
    last_s: float


class Sightings:
    """The faults of one flight. What another thread reads is replaced, never changed."""

    def __init__(self) -> None:
        self.seen: dict[str, Sighting] = {}
        self.present: tuple[str, ...] = ()

    def note(self, now_s: float, faults: tuple[str, ...]) -> None:
        """One tick: what counts as wrong now, strongest response first."""
        before, self.present = self.present, faults
        if not faults:
            return
        seen = dict(self.seen)
        for name in faults:
            known = seen.get(name, Sighting(0, now_s, now_s))
            began = name not in before
            seen[name] = Sighting(known.times + began, known.first_s, now_s)
        self.seen = seen


def ending_faults(outcome: Outcome | None, status: VehicleStatus) -> tuple[str, ...]:
    """The faults that are found by their owner and end a flight: they are told with its outcome."""
    if outcome is None:
        return ()
    if outcome.ending is Ending.UNREACHABLE:
        return (Fault.UNREACHABLE.value,)
    if outcome.ending is not Ending.TAKEN_OVER:
        return ()
    if not status.armed:
        return (Fault.DISARMED.value,)
    return (Fault.OFFBOARD_LOST.value if status.in_failsafe else Fault.PILOT_TAKEOVER.value,)


def faults(config: Config, sightings: Sightings | None) -> tuple[FaultView, ...]:
    """The whole table, what was seen of each row; strongest response first."""
    views = (_view(config, fault, sightings or Sightings()) for fault in Fault)
    return tuple(sorted(views, key=lambda view: -_STRENGTH[view.name]))


def seen(config: Config, sightings: Sightings) -> tuple[FaultView, ...]:
    """The rows that were seen in this flight, those present first."""
    known = (*sightings.present, *(name for name in sightings.seen))
    return tuple(_view(config, Fault(name), sightings) for name in dict.fromkeys(known))


def _view(config: Config, fault: Fault, sightings: Sightings) -> FaultView:
    sighting = sightings.seen.get(fault.value)
    return FaultView(
        name=fault.value,
        words=RULES[fault].words.replace("`", ""),
        response=response_to(config, fault).name.lower().replace("_", " "),
        active=fault.value in sightings.present,
        times=sighting.times if sighting is not None else 0,
        first_s=sighting.first_s if sighting is not None else None,
        last_s=sighting.last_s if sighting is not None else None,
    )


_STRENGTH = {fault.value: RULES[fault].response.value for fault in Fault}
