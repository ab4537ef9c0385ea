"""What must be true of every flight, checked on the record of one. Pure.

The guard and the pilot enforce most of this while they fly. Here it is judged from what was
recorded, by other code: the vehicle's true motion, not the setpoints.
"""

import math
from collections.abc import Callable, Iterable

import msgspec

from autonomy.model import Ending, MissionState
from autonomy.review.history import History, Moment
from hal.vehicle.guard import stopping_distance_m

PATH_STATES = frozenset({MissionState.CRUISE, MissionState.FOLLOW})
"""States in which the vehicle is on its way; it may climb into the altitude band before."""
_HAND_OVER_STATES = frozenset({MissionState.YIELDED, MissionState.DONE})


class Verdict(msgspec.Struct, frozen=True):
    """One invariant: the promise, whether it was kept, and the tightest moment.

    `worst` is what was left (negative: broken by so much) in `unit`, `at_s` when, counted from the
    first tick; both None where the flight never came to the test. `broken_s` is the first time.
    """

    name: str
    promise: str
    worst: float | None
    unit: str
    at_s: float | None
    broken_s: float | None
    why_not: str = ""
    """Why it was not judged, where the promise was not given for such a flight."""

    @property
    def kept(self) -> bool:
        """False when the promise was broken at least once."""
        return self.broken_s is None


def check(history: History) -> tuple[Verdict, ...]:
    """All invariants on one flight, in the order in which people ask for them."""
    guard, body = history.config.guard, history.config.body
    deadman_s = history.config.deadman.timeout_s

    def clearance(moment: Moment) -> float | None:
        return moment.clearance_m - body.radius_m if moment.streaming else None

    def stopping(moment: Moment) -> float | None:
        if moment.ahead_m is None:
            return None
        need_m = stopping_distance_m(moment.speed_m_s, guard.reaction_s, guard.braking_m_s2)
        return moment.ahead_m - need_m

    def fence(moment: Moment) -> float | None:
        if not (moment.streaming and moment.known):
            return None
        return guard.fence.inside_distance_m(*moment.position_ned_m[:2])

    def band(moment: Moment) -> float | None:
        if moment.state not in PATH_STATES or not moment.streaming:
            return None
        altitude_m = moment.altitude_m
        return min(altitude_m - guard.altitude_min_m, guard.altitude_max_m - altitude_m)

    def speed(moment: Moment) -> float | None:
        if moment.sent_ned_m_s is None:
            return None
        return guard.speed_max_m_s - math.hypot(*moment.sent_ned_m_s[:2])

    return (
        _judged(history, "clearance", "nothing known came nearer than the body", "m", clearance),
        _judged(
            history,
            "stopping",
            "the vehicle could always stop within the space ahead that it had seen free",
            "m",
            stopping,
        ),
        _judged(history, "fence", "the vehicle (its centre) stayed inside the fence", "m", fence),
        _judged(history, "altitude", "it flew its way inside the altitude band", "m", band),
        _judged(history, "speed", "no setpoint asked for more than the top speed", "m/s", speed),
        _path(history),
        _verdict(
            "stream",
            f"no gap between setpoints was longer than the deadman's {deadman_s:g} s",
            "s",
            ((at_s, deadman_s - gap_s) for at_s, gap_s in _gaps(history)),
        ),
        _verdict(
            "yield",
            "nothing was commanded after the vehicle was taken over",
            "setpoints",
            _after_hand_over(history),
        ),
    )


def _path(history: History) -> Verdict:
    """TangentBug's bound, from all that was met; broken when the way got longer than that."""
    name, promise = "path", "the way to the goal was no longer than TangentBug's bound"
    bound = history.path_bound
    why_not = _no_bound(history, bound.stretches)
    if why_not:
        return Verdict(name, promise, None, "m", None, None, why_not)
    start_s = history.start_s
    left = ((m.now_s - start_s, bound.bound_m - m.flown_m) for m in history.moments)
    return _verdict(name, promise, "m", left)


def _no_bound(history: History, stretches: int) -> str:
    """Why the bound says nothing of this flight, "" where it does."""
    outcome = history.outcome
    if not stretches:
        return "no way was planned"
    if history.movers:
        return "something moved, and the bound is for what stays"
    if outcome is not None and outcome.ending is Ending.UNREACHABLE:
        return "the goal cannot be reached, and the bound is of a way to it"
    return ""


def _judged(
    history: History, name: str, promise: str, unit: str, left: Callable[[Moment], float | None]
) -> Verdict:
    """An invariant with a margin at every moment to which it applies."""
    start_s = history.start_s
    margins = (
        (m.now_s - start_s, margin) for m in history.moments if (margin := left(m)) is not None
    )
    return _verdict(name, promise, unit, margins)


def _verdict(name: str, promise: str, unit: str, margins: Iterable[tuple[float, float]]) -> Verdict:
    """From (time, what was left); 1e-9 is rounding."""
    worst: tuple[float, float] | None = None
    broken_s: float | None = None
    for at_s, margin in margins:
        if worst is None or margin < worst[1]:
            worst = (at_s, margin)
        if not margin >= -1e-9 and broken_s is None:
            broken_s = at_s
    if worst is None:
        return Verdict(name, promise, None, unit, None, None)
    return Verdict(name, promise, worst[1], unit, worst[0], broken_s)


def _gaps(history: History) -> Iterable[tuple[float, float]]:
    """(time, seconds since the setpoint before) while setpoints are streamed."""
    before: Moment | None = None
    for moment in history.moments:
        if before is not None and before.streaming and moment.streaming:
            yield moment.now_s - history.start_s, moment.now_s - before.now_s
        before = moment


def _after_hand_over(history: History) -> Iterable[tuple[float, float]]:
    for moment in history.moments:
        if moment.state in _HAND_OVER_STATES:
            yield moment.now_s - history.start_s, 0.0 if moment.sent_ned_m_s is None else -1.0
