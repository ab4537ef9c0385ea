"""What the vehicle was doing at one moment, and why, in sentences."""

import math
from bisect import bisect_right

from autonomy.config import Config
from autonomy.errors import BadInput
from autonomy.geometry import moved
from autonomy.mission.coverage import coverage
from autonomy.model import MissionState, NoPlan, ObstacleKind
from autonomy.report import frame_words
from autonomy.review.history import History, Moment, Replan
from autonomy.review.invariants import PATH_STATES
from hal.vehicle.guard import WORDS, stopping_distance_m

DOING: dict[MissionState, str] = {
    MissionState.PREFLIGHT: "checking whether anything forbids the flight",
    MissionState.ARM: "arming",
    MissionState.TAKEOFF: "climbing, flown by PX4",
    MissionState.OFFBOARD: "taking over from PX4: holding until it flies by our setpoints",
    MissionState.CRUISE: "flying straight at the goal",
    MissionState.STOP: "stopping",
    MissionState.DETECT: "holding and turning, so that the beams see every direction",
    MissionState.REPLAN: "planning",
    MissionState.FOLLOW: "following the path that was planned",
    MissionState.HOLD: "holding",
    MissionState.RETURN: "flying back along the way that was flown",
    MissionState.LAND: "landing, flown by PX4",
    MissionState.DONE: "done",
    MissionState.YIELDED: "not flying: somebody else took the vehicle",
}


def explain(history: History, at_s: float) -> str:
    """The moment `at_s` seconds after the first tick, told in words, one sentence a line.

    Raises BadInput when the log does not reach so far.
    """
    times = [moment.now_s - history.start_s for moment in history.moments]
    if not 0.0 <= at_s <= times[-1]:
        raise BadInput(
            f"{history.path}: the log covers 0 to {times[-1]:.1f} s; {at_s:g} s is not in it"
        )
    index = bisect_right(times, at_s) - 1
    moment = history.moments[index]
    lines = [
        f"At {times[index]:.2f} s the vehicle was {DOING[moment.state]} ({moment.state.value}).",
        *_since(history, index),
        *_where(history, moment),
        *_speed(history, moment),
        *_beams(history, moment),
        *_guard(moment),
        *_plan(history, moment),
        *_next(history, index),
    ]
    return "\n".join(lines)


def _since(history: History, index: int) -> list[str]:
    """The last thing that was told before, which is the reason of the state."""
    for moment in reversed(history.moments[: index + 1]):
        if moment.events:
            event = moment.events[-1]
            return [f"Since {moment.now_s - history.start_s:.2f} s, because: {event.why}."]
    return []


def _where(history: History, moment: Moment) -> list[str]:
    if not moment.known:
        return ["It did not know where it was."]
    north, east, _ = moment.position_ned_m
    goal = history.route[-1]
    gap_m = math.hypot(goal[0] - north, goal[1] - east)
    ((shown_north, shown_east),) = moved([(north, east)], history.offset_ne_m)
    line = (
        f"It was at {shown_north:.2f} m north, {shown_east:.2f} m east "
        f"{frame_words(history.offset_ne_m)}; it was {moment.altitude_m:.2f} m up, "
        f"{gap_m:.2f} m from the last goal, moving at {moment.speed_m_s:.2f} m/s."
    )
    if not moment.streaming:
        return [line]
    skin_m = moment.clearance_m - history.config.body.radius_m
    return [line, f"The nearest thing it knew was {skin_m:.2f} m from its body, or farther."]


def _speed(history: History, moment: Moment) -> list[str]:
    """Table 2 and the stopping distance, where it was on its way."""
    if moment.state not in PATH_STATES or not moment.streaming:
        return []
    lines = [speed_rule(moment, history.config)]
    if moment.ahead_m is not None:
        guard = history.config.guard
        need_m = stopping_distance_m(moment.speed_m_s, guard.reaction_s, guard.braking_m_s2)
        lines.append(
            f"{moment.ahead_m:.2f} m ahead were seen free, it needed {need_m:.2f} m to stop."
        )
    return lines


MAXIMUM, LOST, BETWEEN, MINIMUM, ZERO = SPEED_ROWS = (
    "maximum: nothing near, or receding from it with room",
    "less than Table 2: a beam was not believed, and so the others looked as often along the way",
    "between minimum and maximum, for the clearance, which gave no room or did not grow",
    "minimum: something was near",
    "zero: not seen free",
)
"""The rows of Table 2, as they are flown (t3drm/speed.py), and what comes below them."""


def speed_row(moment: Moment, config: Config) -> str:
    """The one of SPEED_ROWS that a moment's speed limit came from."""
    guidance, limit_m_s = config.guidance, moment.speed_limit_m_s
    if limit_m_s >= guidance.speed_max_m_s:
        return MAXIMUM
    left = coverage(config, {doubt.beam for doubt in moment.doubts})
    if left.share < 1.0 and limit_m_s == guidance.speed_max_m_s * left.share:
        return LOST
    if limit_m_s > guidance.speed_min_m_s:
        return BETWEEN
    return MINIMUM if limit_m_s > 0.0 else ZERO


def speed_rule(moment: Moment, config: Config) -> str:
    """Which row of Table 2 a moment's speed limit came from, in a sentence."""
    limit_m_s, row = moment.speed_limit_m_s, speed_row(moment, config)
    name, colon, why = row.partition(": ")
    if row == LOST:
        return f"It flew no faster than {limit_m_s:.2f} m/s, {name}: {why}."
    if not colon:
        return f"Table 2 gave {limit_m_s:.2f} m/s, {row}."
    return f"Table 2 gave the {name}, {limit_m_s:.2f} m/s: {why}."


def _beams(history: History, moment: Moment) -> list[str]:
    """The beams that were not believed, why, since when, and what covered for them."""
    lines = []
    for doubt in moment.doubts:
        since_s = doubt.since_s - history.start_s
        by = f"; the turning covered for it, {doubt.covered_by} first" if doubt.covered_by else ""
        lines.append(
            f"Beam {doubt.beam} had not been believed since {since_s:.2f} s ({doubt.word}): "
            f"{doubt.why}{by}."
        )
    return lines


def _guard(moment: Moment) -> list[str]:
    reasons = [WORDS.get(limit, limit) for limit in moment.limits]
    return [f"The guard changed the setpoint: {'; '.join(reasons)}."] if reasons else []


def _plan(history: History, moment: Moment) -> list[str]:
    """The plan in force."""
    made = [replan for replan in history.replans if replan.now_s <= moment.now_s]
    if not made or not moment.streaming:
        return []
    return [
        f"The plan was made at {made[-1].now_s - history.start_s:.2f} s: {plan_words(made[-1])}."
    ]


def plan_words(replan: Replan) -> str:
    """One planning step in one clause."""
    result = replan.result
    kinds = [obstacle.kind for obstacle in result.obstacles]
    discrete = kinds.count(ObstacleKind.DISCRETE)
    seen = f"{discrete} discrete and {len(kinds) - discrete} continuous obstacles"
    if isinstance(result, NoPlan):
        return f"{seen}, no way ({result.reason})"
    legs = ", ".join(dict.fromkeys(leg.kind.value for leg in result.legs))
    others = len(result.rejected)
    rejected = f"; longer or blocked: {others} other" if others else ""
    height = "" if result.height_m is None else f", {result.height_m:.2f} m high"
    return (
        f"{seen}; {legs}, {result.length_m:.2f} m at {result.keep_out_m:.3f} m from every hit"
        f"{height}{rejected}"
    )


def _next(history: History, index: int) -> list[str]:
    for moment in history.moments[index + 1 :]:
        if moment.events:
            event = moment.events[0]
            return [f"Next, at {moment.now_s - history.start_s:.2f} s: {event.why}."]
    return []
