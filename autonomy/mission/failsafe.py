"""One table of faults and responses. Detectors say which faults are present; the machine only
knows responses. Pure.

A response is a step of one escalation: slow, stop, hold, return, land. `machine.py` draws the
table for people; what is configurable names its key.
"""

import math
from collections.abc import Mapping
from enum import IntEnum, StrEnum

import msgspec

from autonomy.config import Config
from autonomy.model import Ending, FusedState
from hal.readings import VehicleStatus


class Fault(StrEnum):
    """What can be wrong in flight."""

    PILOT_TAKEOVER = "pilot_takeover"
    OFFBOARD_LOST = "offboard_lost"
    DISARMED = "disarmed"
    LINK_LOST = "link_lost"
    BATTERY_CRITICAL = "battery_critical"
    BATTERY_LOW = "battery_low"
    STATE_LOST_LONG = "state_lost_long"
    STATE_LOST = "state_lost"
    ESTIMATOR_DIVERGED = "estimator_diverged"
    POSITION_UNCERTAIN = "position_uncertain"
    POSITION_JUMPED = "position_jumped"
    BEAMS_LOST_LONG = "beams_lost_long"
    BEAMS_LOST = "beams_lost"
    BEAM_DOUBTED = "beam_doubted"
    FENCE_LEFT_FAR = "fence_left_far"
    FENCE_LEFT = "fence_left"
    DRIFT_LONG = "drift_long"
    DRIFT = "drift"
    UNREACHABLE = "unreachable"
    TIME_OVER = "time_over"
    PATH_OVER = "path_over"


class Response(IntEnum):
    """What the machine does about a fault, each step stronger than the one before."""

    SLOW = 1  # fly at the least speed of Table 2 while it lasts
    STOP = 2  # come to rest, look round, plan anew
    HOLD = 3  # hold; go on when the fault is gone
    RETURN = 4  # back along what was flown, then land; the mission is over
    LAND = 5  # land here; the mission is over
    LET_GO = 6  # somebody else has the vehicle: send nothing more, ask for nothing


class Rule(msgspec.Struct, frozen=True):
    """A row of the table.

    `flapping` is the response when the fault has come and gone too often
    (`failsafe.flapping_holds` times within `failsafe.flapping_window_s`), None where it cannot.
    `key` is the configuration key that chooses the response. The fault counts after `confirm_s`
    without a break, and is over after `clear_s` without it.
    """

    words: str
    response: Response
    ending: Ending
    flapping: Response | None = None
    key: str = ""
    confirm_s: float = 0.0
    clear_s: float = 0.0


_R, _E = Response, Ending
_CLEAR_S = 0.2
"""Without a fault for so long, a hold may end."""

RULES: Mapping[Fault, Rule] = {
    Fault.PILOT_TAKEOVER: Rule("another mode, chosen by a pilot", _R.LET_GO, _E.TAKEN_OVER),
    Fault.OFFBOARD_LOST: Rule("another mode, by PX4's own failsafe", _R.LET_GO, _E.TAKEN_OVER),
    Fault.DISARMED: Rule("disarmed in flight", _R.LET_GO, _E.TAKEN_OVER),
    Fault.LINK_LOST: Rule("no message for `vehicle.link_timeout_s`", _R.LAND, _E.LINK_LOST),
    Fault.BATTERY_CRITICAL: Rule(
        "at `failsafe.battery_land` or below", _R.LAND, _E.FAILSAFE, confirm_s=0.5
    ),
    Fault.BATTERY_LOW: Rule(
        "at `failsafe.battery_return` or below; without time for the way back: land",
        _R.RETURN,
        _E.FAILSAFE,
        key="failsafe.battery_low",
        confirm_s=1.0,
    ),
    Fault.STATE_LOST_LONG: Rule(
        "no usable position for `failsafe.state_loss_land_s`", _R.LAND, _E.FAILSAFE
    ),
    Fault.STATE_LOST: Rule(
        "no usable position", _R.HOLD, _E.FAILSAFE, flapping=_R.LAND, clear_s=_CLEAR_S
    ),
    Fault.ESTIMATOR_DIVERGED: Rule(
        "position uncertain beyond `estimation.sigma_max_m`",
        _R.HOLD,
        _E.FAILSAFE,
        flapping=_R.LAND,
        clear_s=_CLEAR_S,
    ),
    Fault.POSITION_UNCERTAIN: Rule(
        "position uncertain beyond 0.7 of `estimation.sigma_max_m`",
        _R.SLOW,
        _E.FAILSAFE,
        clear_s=1.0,
    ),
    Fault.POSITION_JUMPED: Rule(
        "PX4's frame jumped by `failsafe.jump_stop_m` or more",
        _R.STOP,
        _E.FAILSAFE,
        flapping=_R.LAND,
    ),
    Fault.BEAMS_LOST_LONG: Rule(
        "two horizontal beams lost for `failsafe.sensor_loss_land_s`",
        _R.LAND,
        _E.FAILSAFE,
        key="failsafe.sensor_loss",
    ),
    Fault.BEAMS_LOST: Rule(
        "two horizontal beams lost: silent for `failsafe.sensor_loss_hold_s`, or doubted",
        _R.HOLD,
        _E.FAILSAFE,
        flapping=_R.LAND,
        key="failsafe.sensor_loss",
        clear_s=_CLEAR_S,
    ),
    Fault.BEAM_DOUBTED: Rule(
        "one horizontal beam lost just now; the others cover for it, at half the speed",
        _R.STOP,
        _E.FAILSAFE,
    ),
    Fault.FENCE_LEFT_FAR: Rule(
        "`failsafe.fence_land_m` outside the geofence", _R.LAND, _E.FAILSAFE, confirm_s=0.2
    ),
    Fault.FENCE_LEFT: Rule(
        "`failsafe.fence_return_m` outside the geofence",
        _R.RETURN,
        _E.FAILSAFE,
        confirm_s=0.5,
        clear_s=_CLEAR_S,
    ),
    Fault.DRIFT_LONG: Rule(
        "a drift that lasts for `failsafe.drift_land_s`, or leads to an obstacle",
        _R.LAND,
        _E.FAILSAFE,
    ),
    Fault.DRIFT: Rule(
        "flown by `failsafe.drift_m` elsewhere than asked for: wind, or a second computer",
        _R.HOLD,
        _E.FAILSAFE,
        flapping=_R.LAND,
        clear_s=0.5,
    ),
    Fault.UNREACHABLE: Rule(
        "the ladder's last rung", _R.LAND, _E.UNREACHABLE, key="failsafe.unreachable"
    ),
    Fault.TIME_OVER: Rule(
        "`mission.time_limit_s` is over before it turned back",
        _R.LAND,
        _E.BUDGET,
        key="failsafe.budget",
    ),
    Fault.PATH_OVER: Rule(
        "`mission.path_limit_m` is flown before it turned back",
        _R.LAND,
        _E.BUDGET,
        key="failsafe.budget",
    ),
}
"""The table. Every fault has a row; what no detector here finds is found by its owner."""

UNCERTAIN = 0.7
"""Of the uncertainty at which nothing is flown any more: slow from here."""

_CHOICES = {"land": Response.LAND, "return": Response.RETURN}


def response_to(config: Config, fault: Fault, *, flapping: bool = False) -> Response:
    """The table's response, where a key chooses it by the configuration."""
    rule = RULES[fault]
    chosen = _chosen(config, rule.key)
    if flapping and rule.flapping is not None:
        return chosen or rule.flapping
    # What is only the first step of a loss holds, whatever is chosen for its second.
    return rule.response if chosen is None or rule.flapping is not None else chosen


def _chosen(config: Config, key: str) -> Response | None:
    name = key.removeprefix("failsafe.")
    return _CHOICES[getattr(config.failsafe, name)] if name else None


class Found(msgspec.Struct, frozen=True):
    """A fault that is present, with the sentence that tells a person."""

    fault: Fault
    why: str
    response: Response

    @property
    def ending(self) -> Ending:
        """How the mission ends if this fault ends it."""
        return RULES[self.fault].ending


def found(config: Config, fault: Fault, why: str) -> Found:
    """A fault with the response that the table and the configuration have for it."""
    return Found(fault, why, response_to(config, fault))


class Situation(msgspec.Struct, frozen=True):
    """What the detectors look at.

    `state_lost_s` is how long the fused state has not been ok; `beams_lost` is for how long too
    few horizontal beams have been left, and which are lost (`Lookout.too_few`), `beam_lost_now`
    why one was lost at this tick, "" for none; `mission_s` is the time since arming,
    `path_m` the way flown since; `jump_m` how far PX4's frame jumped at this tick; `outside_m` how
    far outside the fence the vehicle is (negative inside); `drift_m` how far it was flown lately
    elsewhere than asked for, `drift_s` for how long that has been over
    `drift_limit_m`, and `drift_near` says that it leads towards an obstacle; `returning` that the
    mission has turned back.
    """

    status: VehicleStatus
    fused: FusedState
    state_lost_s: float = 0.0
    beams_lost: tuple[float, str] | None = None
    beam_lost_now: str = ""
    mission_s: float = 0.0
    path_m: float = 0.0
    jump_m: float = 0.0
    outside_m: float = -math.inf
    drift_m: float = 0.0
    drift_limit_m: float = math.inf
    drift_s: float = 0.0
    drift_near: bool = False
    returning: bool = False


def detect(config: Config, now: Situation) -> tuple[Found, ...]:
    """The faults present now, strongest response first."""
    faults = [
        *_link_and_battery(config, now),
        *_position(config, now),
        *_beams(config, now),
        *_motion(config, now),
        *_budgets(config, now),
    ]
    if not faults:
        return ()
    present = [found(config, fault, why) for fault, why in faults]
    return tuple(sorted(present, key=lambda item: -item.response))


_Sentence = tuple[Fault, str]


def _link_and_battery(config: Config, now: Situation) -> list[_Sentence]:
    status, limits = now.status, config.failsafe
    said: list[_Sentence] = []
    if status.link_age_s > config.vehicle.link_timeout_s:
        said.append((Fault.LINK_LOST, f"the vehicle has been silent for {status.link_age_s:.1f} s"))
    left = status.battery_remaining
    if left is not None and left <= limits.battery_land:
        said.append((Fault.BATTERY_CRITICAL, f"the battery is at {left:.0%}"))
    if left is not None and left <= limits.battery_return:
        said.append((Fault.BATTERY_LOW, f"the battery is at {left:.0%}"))
    return said


def _position(config: Config, now: Situation) -> list[_Sentence]:
    fused, limits = now.fused, config.failsafe
    said: list[_Sentence] = []
    sigma_max_m = config.estimation.sigma_max_m
    if now.state_lost_s > limits.state_loss_land_s:
        why = f"no usable position for {now.state_lost_s:.1f} s: {fused.why_not_ok}"
        said.append((Fault.STATE_LOST_LONG, why))
    elif not fused.ok:
        diverged = fused.position_sigma_m > sigma_max_m
        fault = Fault.ESTIMATOR_DIVERGED if diverged else Fault.STATE_LOST
        said.append((fault, f"no usable position: {fused.why_not_ok}"))
    elif fused.position_sigma_m > UNCERTAIN * sigma_max_m:
        why = f"the position is uncertain to {fused.position_sigma_m:.2f} m"
        said.append((Fault.POSITION_UNCERTAIN, why))
    if now.jump_m >= limits.jump_stop_m:
        said.append((Fault.POSITION_JUMPED, f"PX4's frame jumped by {now.jump_m:.2f} m"))
    return said


def _beams(config: Config, now: Situation) -> list[_Sentence]:
    if now.beams_lost is not None:
        lost_s, which = now.beams_lost
        why = f"too few range beams are left, lost: {which}, for {lost_s:.1f} s"
        long = lost_s > config.failsafe.sensor_loss_land_s
        return [(Fault.BEAMS_LOST_LONG if long else Fault.BEAMS_LOST, why)]
    return [(Fault.BEAM_DOUBTED, now.beam_lost_now)] if now.beam_lost_now else []


def _motion(config: Config, now: Situation) -> list[_Sentence]:
    """Where the vehicle is and goes, against where it should."""
    limits = config.failsafe
    said: list[_Sentence] = []
    if not now.fused.ok:
        return said
    if now.outside_m > limits.fence_return_m:
        why = f"{now.outside_m:.2f} m outside the geofence"
        said.append((Fault.FENCE_LEFT, why))
        # Both: one that comes and goes must not break the other's confirmation.
        if now.outside_m > limits.fence_land_m:
            said.append((Fault.FENCE_LEFT_FAR, why))
    if now.drift_m > now.drift_limit_m or now.drift_near:
        long = now.drift_near or now.drift_s > limits.drift_land_s
        why = (
            f"flown {now.drift_m:.2f} m elsewhere than asked for: wind, or another computer's "
            "setpoints"
        )
        said.append((Fault.DRIFT_LONG if long else Fault.DRIFT, why))
    return said


def _budgets(config: Config, now: Situation) -> list[_Sentence]:
    """Of the way out: a return has `failsafe.return_timeout_s`."""
    mission = config.mission
    said: list[_Sentence] = []
    if now.returning:
        return said
    if now.mission_s > mission.time_limit_s:
        said.append((Fault.TIME_OVER, f"the time limit of {mission.time_limit_s:g} s is over"))
    if mission.path_limit_m is not None and now.path_m > mission.path_limit_m:
        said.append((Fault.PATH_OVER, f"the limit of {mission.path_limit_m:g} m of way is flown"))
    return said


_NONE = "-"


def table() -> str:
    """The table for people, in Markdown; the strongest response first."""
    rows = [
        "| fault | what it is | response | when it flaps | ending | chosen by |",
        "|---|---|---|---|---|---|",
    ]
    for fault, rule in sorted(RULES.items(), key=lambda item: -item[1].response):
        flapping = _NONE if rule.flapping is None else rule.flapping.name.lower()
        key = f"`{rule.key}`" if rule.key else _NONE
        response = rule.response.name.lower().replace("_", " ")
        cells = (f"`{fault}`", rule.words, response, flapping, f"`{rule.ending}`", key)
        rows.append(f"| {' | '.join(cells)} |")
    return "\n".join(rows)
