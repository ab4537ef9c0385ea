"""Which of PX4's parameters matter to a flight of this service, what they should be, and why.

Facts by version, 1.14 to 1.19. Sources, named with each row:
[measured] PX4 main bb59c637cd, SIH quadrotor, 2026-11; [notes x] PX4's release notes of x;
[failsafe.cpp], [mode_requirements.cpp] PX4's sources of those names, main, 2026; [reference] PX4's
parameter reference.
"""

import math
import re
from collections.abc import Callable, Mapping

import msgspec

from autonomy.config import Config
from autonomy.finding import Finding, Fix, bad, note, ok

Version = tuple[int, int]

OLDEST: Version = (1, 14)
NEWEST: Version = (1, 19)
_EPSILON = 1e-4


class Situation(msgspec.Struct, frozen=True):
    """What the advice depends on beside the parameters."""

    config: Config
    global_position: bool
    has_gnss: bool


class Advice(msgspec.Struct, frozen=True):
    """One parameter. `want` gives the recommended value, None where the present one is good.

    `grave`: flying as it is would be dangerous, not only worse. `since` and `before` bound the
    versions that have the parameter (`before` exclusively). `fixes`: `--fix` may set it.
    """

    name: str
    kind: type[int] | type[float]
    want: Callable[[float, Situation], float | None]
    why: str
    source: str
    grave: bool = False
    since: Version = OLDEST
    before: Version = (99, 0)
    fixes: bool = True

    def in_version(self, version: Version | None) -> bool:
        """True where PX4 `version` has the parameter; an unknown one may have any."""
        return version is None or self.since <= version < self.before


def _one_of(*good: int) -> Callable[[float, Situation], float | None]:
    """The first of `good` is recommended where the value is none of them."""
    return lambda value, _: None if round(value) in good else float(good[0])


def _at_most(limit: float) -> Callable[[float, Situation], float | None]:
    return lambda value, _: None if value <= limit + _EPSILON else limit


def _offboard_loss(value: float, situation: Situation) -> float | None:
    """Land where Hold cannot run: PX4 falls through to it anyway, after a pause."""
    if round(value) == 4 or (round(value) == 5 and situation.global_position):
        return None
    return 5.0 if situation.global_position else 4.0


def _position_gain(value: float, situation: Situation) -> float | None:
    gain = situation.config.guard.position_gain_per_s
    return None if abs(value - gain) <= 0.1 else gain


def _fast_enough_and_slow(value: float, situation: Situation) -> float | None:
    """A pilot and PX4's own modes fly no faster than a room bears, nor slower than this service."""
    least = 2.0 * situation.config.guard.speed_max_m_s
    most = max(2.0, least)
    return None if least - _EPSILON <= value <= most + _EPSILON else max(1.0, least)


def _under_the_ceiling(value: float, situation: Situation) -> float | None:
    highest_m = situation.config.guard.altitude_max_m
    return None if value <= highest_m + _EPSILON else highest_m


def _below_our_own(value: float, situation: Situation) -> float | None:
    """PX4 acts on a battery that this service has long landed for: at half of what is left then."""
    ours = situation.config.failsafe.battery_land
    return None if value < ours else math.floor(0.5 * ours * 100.0) / 100.0


def _not_required(value: float, situation: Situation) -> float | None:
    return 0.0 if round(value) != 0 and not situation.has_gnss else None


def _arms_without_gnss(value: float, situation: Situation) -> float | None:
    return 1.0 if round(value) == 0 and not situation.global_position else None


def _no_gnss_height(value: float, situation: Situation) -> float | None:
    return 0.0 if round(value) == 1 and not situation.has_gnss else None


def _no_collision_prevention(value: float, situation: Situation) -> float | None:
    driver = situation.config.beams.virtual()
    sent = driver is not None and driver.send
    return -1.0 if sent and value > 0.0 else None


ADVICE: tuple[Advice, ...] = (
    Advice(
        "COM_OBL_RC_ACT",
        int,
        _offboard_loss,
        "what PX4 does when this program dies: 5 holds (needs a global position), 4 lands; 0 to "
        "3 end in a return that climbs first, by 4 m as measured, 6 and 7 cut the motors",
        "[measured], [failsafe.cpp]; one list of values since 1.14",
        grave=True,
    ),
    Advice(
        "COM_OF_LOSS_T",
        float,
        _at_most(1.0),
        "seconds without setpoints until PX4 acts; until then it flies on with the last velocity",
        "[measured]: acts 0.02 to 0.12 s after it",
        grave=True,
    ),
    Advice(
        "NAV_DLL_ACT",
        int,
        _one_of(1, 0, 3),
        "this program is PX4's ground station: when it dies PX4 must only hold (1) or land (3); 2 "
        "climbs and returns, 5 and 6 cut the motors",
        "[measured], [failsafe.cpp]",
        grave=True,
    ),
    Advice(
        "MPC_XY_P",
        float,
        _position_gain,
        "the guard counts on it: a position error adds this times itself to the speed "
        "(guard.position_gain_per_s)",
        "[measured]: 0.95 by default",
        grave=True,
    ),
    Advice(
        "COM_TAKEOFF_ACT",
        int,
        _one_of(0),
        "after the take-off PX4 must hold (0), not begin a mission (1)",
        "[notes 1.18]: removed, always Hold",
        grave=True,
        before=(1, 18),
    ),
    Advice(
        "NAV_RCL_ACT",
        int,
        _one_of(1, 3, 0, 7),
        "when the transmitter's signal is lost PX4 should hold (1) or land (3); its default 2 "
        "climbs and returns. Not seen when the signal was never there",
        "[failsafe.cpp]; [measured] with no transmitter; 7 (Hold as a change of mode) is of 1.18",
    ),
    Advice(
        "COM_RCL_EXCEPT",
        int,
        lambda value, _: None if not round(value) & 4 else float(round(value) & ~4),
        "bit 2 lets Offboard go on without the pilot's transmitter: nobody could take over",
        "[failsafe.cpp]: bits 0 Mission, 1 automatic modes, 2 Offboard; newer ones beyond",
    ),
    Advice(
        "COM_RC_OVERRIDE",
        int,
        lambda value, _: None if round(value) & 2 else float(round(value) | 2),
        "bit 1 lets the pilot take over from Offboard by moving the sticks",
        "[notes 1.18]: removed for MAN_OVERRIDE_SPD",
        before=(1, 18),
    ),
    Advice(
        "MAN_OVERRIDE_SPD",
        float,
        lambda value, _: None if value > 0.0 else 1.0,
        "a stick moved faster than this takes over from Offboard; negative: it does not",
        "[notes 1.18]: 1 by default",
        since=(1, 18),
    ),
    Advice(
        "COM_RC_IN_MODE",
        int,
        lambda value, _: None if round(value) != 4 else 0.0,
        "4 shuts the sticks out: no pilot can take over",
        "[reference]; PX4's simulation starts with 1 [measured]",
        fixes=False,
    ),
    Advice(
        "RTL_RETURN_ALT",
        float,
        _under_the_ceiling,
        "a return, also one that a pilot asks for, climbs to it (or to a cone): keep it below the "
        "ceiling (guard.altitude_max_m); some versions climb with the distance from home whatever "
        "it says, so land indoors rather than return",
        "[measured]: +8.8 m at 7 m from home with the default of 30 m",
    ),
    Advice(
        "MPC_XY_VEL_MAX",
        float,
        _fast_enough_and_slow,
        "the fastest that anything but this program may fly in the room, 12 m/s by default; not "
        "slower than twice guard.speed_max_m_s",
        "[reference]",
    ),
    Advice(
        "MPC_Z_VEL_MAX_UP",
        float,
        _at_most(1.0),
        "the fastest climb, under a ceiling",
        "[reference]: 3 by default",
    ),
    Advice(
        "MPC_Z_V_AUTO_UP",
        float,
        _at_most(1.0),
        "the climb of PX4's own modes, under a ceiling",
        "[reference]: 3 by default",
    ),
    Advice(
        "GF_ACTION",
        int,
        _one_of(2, 0, 1, 5),
        "on leaving PX4's own fence it should hold (2) or land (5); 3 climbs and returns, 4 cuts "
        "the motors",
        "[failsafe.cpp]",
    ),
    Advice(
        "COM_LOW_BAT_ACT",
        int,
        _one_of(2, 0),
        "with a low battery PX4 should land (2); 3 and 5 return first, which climbs",
        "[failsafe.cpp]; [notes 1.18 rc2]: 5 is new",
    ),
    Advice(
        "BAT_CRIT_THR",
        float,
        _below_our_own,
        "PX4's own action must come after this service's landing (failsafe.battery_land)",
        "[reference]: 0.07 by default",
    ),
    Advice(
        "SYS_HAS_GPS",
        int,
        _not_required,
        "nothing is heard of a GNSS receiver: with 1, PX4 waits for one and warns before arming",
        "[reference]",
    ),
    Advice(
        "COM_ARM_WO_GPS",
        int,
        _arms_without_gnss,
        "0 forbids arming without a global position, and there is none",
        "systemCheck.cpp of 1.14 to 1.16, estimatorCheck.cpp of main",
    ),
    Advice(
        "EKF2_HGT_REF",
        int,
        _no_gnss_height,
        "1 takes the height from GNSS, and there is none; indoors a range sensor below (2) or "
        "vision (3) is better than the barometer (0), which drifts with doors and fans",
        "[reference], since 1.14; z drifted by 0.1 to 0.3 m between flights [measured]",
        fixes=False,
    ),
    Advice(
        "CP_DIST",
        float,
        _no_collision_prevention,
        "virtual beams are sent to the vehicle: in Position mode PX4 would keep the pilot away "
        "from obstacles that are not there",
        "[measured]: it does nothing in Offboard and Hold",
    ),
)
"""The gravest first."""

INDOOR_SOURCES = ("EKF2_GPS_CTRL", "EKF2_OF_CTRL", "EKF2_EV_CTRL")
"""Bit masks of what PX4's estimator takes a horizontal position from (since 1.14)."""


def version_of(text: str) -> Version | None:
    """(major, minor) of "1.16.0"; None for what is no version."""
    match = re.match(r"(\d+)\.(\d+)", text)
    return (int(match[1]), int(match[2])) if match else None


def kinds(version: Version | None) -> dict[str, type[int] | type[float]]:
    """The parameters to read from PX4 `version`, with their types."""
    wanted: dict[str, type[int] | type[float]] = dict.fromkeys(INDOOR_SOURCES, int)
    wanted |= {a.name: a.kind for a in ADVICE if a.in_version(version)}
    return wanted


def about_version(text: str) -> Finding:
    """Whether this PX4 is one that the advice knows."""
    version = version_of(text)
    known = f"{OLDEST[0]}.{OLDEST[1]} to {NEWEST[0]}.{NEWEST[1]}"
    if version is None:
        sentence = f"PX4 does not tell its version; what follows is for {known}"
        return note(sentence, "version")
    if version < OLDEST:
        sentence = (
            f"PX4 {text} is older than {OLDEST[0]}.{OLDEST[1]}: its failsafes and their parameters "
            "are others; update it"
        )
        return bad(sentence, "version")
    if version > NEWEST:
        sentence = f"PX4 {text} is newer than what this program knows of ({known})"
        return note(sentence, "version")
    return ok(f"PX4 {text}: its parameters are known here", "version")


def parameter_findings(
    version: Version | None, parameters: Mapping[str, float], situation: Situation
) -> tuple[Finding, ...]:
    """One finding a parameter that PX4 `version` has, with its value, and what it should be.

    A parameter that the vehicle does not tell is a finding only where it matters to safety.
    """
    found = []
    for advice in ADVICE:
        if not advice.in_version(version):
            continue
        value = parameters.get(advice.name)
        if value is None:
            if advice.grave and advice.before == (99, 0):
                sentence = f"the vehicle does not tell {advice.name}: {advice.why}"
                found.append(bad(sentence, advice.name))
            continue
        found.append(_judged(advice, value, situation))
    return (*found, *_sources(parameters, situation))


def _judged(advice: Advice, value: float, situation: Situation) -> Finding:
    wanted = advice.want(value, situation)
    if wanted is None:
        return ok(f"{advice.name} is {value:g}", advice.name)
    fix = Fix(advice.name, value, wanted, integer=advice.kind is int) if advice.fixes else None
    sentence = f"{advice.name} is {value:g}, better {wanted:g}: {advice.why}"
    return Finding(good=False, sentence=sentence, grave=advice.grave, subject=advice.name, fix=fix)


def _sources(parameters: Mapping[str, float], situation: Situation) -> tuple[Finding, ...]:
    """Where the position can come from."""
    on = {name: bool(round(parameters[name])) for name in INDOOR_SOURCES if name in parameters}
    if not on:
        return ()
    words = {"EKF2_GPS_CTRL": "GNSS", "EKF2_OF_CTRL": "optical flow", "EKF2_EV_CTRL": "vision"}
    used = [words[name] for name, active in on.items() if active]
    others = [name for name in on if name != "EKF2_GPS_CTRL" and on[name]]
    if not situation.has_gnss and not others:
        sentence = (
            "PX4's estimator takes its position from GNSS only, and there is none: EKF2_OF_CTRL "
            "(optical flow) and EKF2_EV_CTRL (motion capture, visual odometry) are 0"
        )
        return (note(sentence, "EKF2"),)
    return (ok(f"PX4 may take its position from {', '.join(used)}", "EKF2"),)
