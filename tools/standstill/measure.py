"""Fly, do something to the program, and read from the truth how long the vehicle still moved."""

import itertools
import math
import signal
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tests.support.flying import Flying
from tests.support.mock_px4 import MockProcess, free_udp_port
from tests.support.wire import WireTap
from tools.standstill.faults import Fault, Scene

AT_REST_M_S = 0.05
REST_FOR_S = 0.5
"""So long it has to be at rest to count as standing: a turning velocity passes through zero."""
STOPPED_FOR_S = 0.3
COMMANDED_M_S = 0.02
"""A commanded velocity below this is a stop."""
_WIRE_PERIOD_S = 0.1
WATCHED_S = 20.0
"""A program that is gone, or that goes on, is watched so long."""
LATER_S = 10.0
_LIMIT_S = 150.0
_CRUISING_M_S = 0.15


def _take_off(flying: Flying, mock: MockProcess) -> None:
    flying.wait_for("takeoff")
    mock.wait_for_truth(lambda state: state["in_air"], _LIMIT_S)


def _cruise(flying: Flying, _: MockProcess) -> None:
    flying.wait_for_speed(_CRUISING_M_S)


def _detect(flying: Flying, _: MockProcess) -> None:
    flying.wait_for("detect")


def _hold(flying: Flying, _: MockProcess) -> None:
    flying.wait_for_speed(_CRUISING_M_S)
    flying.send_signal(signal.SIGINT)
    flying.wait_for("hold")


def _land(flying: Flying, mock: MockProcess) -> None:
    _hold(flying, mock)
    flying.wait_for("land")


STATES: dict[str, Callable[[Flying, MockProcess], None]] = {
    "takeoff": _take_off,
    "cruise": _cruise,
    "detect": _detect,
    "hold": _hold,
    "land": _land,
}
"""How to bring a flight into a state of the mission."""


@dataclass(frozen=True)
class Measured:
    """One fault in one state. `end` is the vehicle's, `exit_code` the program's (None: it went on,
    and was ended).

    `stopped_s`: from the fault until zero velocity was asked for, by the program on the wire or by
    PX4's own failsafe, and stayed so for 0.3 s; nan when it never was.
    `standing_s`: from the fault until the vehicle stands for half a second; nan when it never did.
    `moved_m`: how far it went meanwhile, horizontally. `harmed` is a sentence, or empty.
    """

    fault: str
    state: str
    speed_m_s: float
    stopped_s: float
    standing_s: float
    moved_m: float
    end: str
    exit_code: int | None
    clearance_m: float
    harmed: str
    later_m: float = 0.0
    """How far it got, horizontally, in the last `LATER_S` that were watched."""


def measure(fault: Fault, state: str, folder: Path) -> Measured:
    """One flight of the command line on the mock PX4, with the fault in the state."""
    folder.mkdir(parents=True, exist_ok=True)
    orders = folder / "orders"
    prelude = (
        "from pathlib import Path\nfrom tools.standstill.saboteur import listen\n"
        f"listen(Path({str(orders)!r}))"
    )
    port = free_udp_port()
    options = ("--goal", "4,3", "--mode", "stop", "--connection", f"udpin://127.0.0.1:{port}")
    with (
        MockProcess(folder, "--scenario", "default") as mock,
        WireTap(mock.port, port) as tap,
        Flying(folder, *options, prelude=prelude) as flying,
    ):
        STATES[state](flying, mock)
        since_s, before = time.monotonic(), len(mock.truth())
        fault.cause(Scene(flying, orders))
        exit_code = _watch(flying, mock)
        truth = mock.truth()
        sent = [(t.at_s - since_s, t.speed_m_s) for t in list(tap.targets)]
    return judged(fault.name, state, truth, before, exit_code, sent)


def _watch(flying: Flying, mock: MockProcess) -> int | None:
    """Until program and vehicle have settled, or for `WATCHED_S`; the program's exit code."""
    end_s = time.monotonic() + WATCHED_S
    while time.monotonic() < end_s:
        last = mock.truth()[-1]
        if flying.process.poll() is not None and (not last["armed"] or last["mode"] == "hold"):
            time.sleep(2.0)
            break
        time.sleep(0.2)
    return flying.process.poll()


def judged(
    fault: str,
    state: str,
    truth: Sequence[dict[str, Any]],
    before: int,
    exit_code: int | None,
    sent: Sequence[tuple[float, float]],
) -> Measured:
    """What the true states say, `before` of them from before the fault, and the setpoints `sent`:
    (seconds after the fault, commanded speed).
    """
    after = truth[max(0, before - 1) :]
    rest = standing_from(after)
    until = after if rest is None else after[: rest + 1]
    last = truth[-1]
    flown = [s["clearance_m"] for s in truth if s["in_air"] and s["clearance_m"] is not None]
    return Measured(
        fault,
        state,
        _speed_m_s(after[0]),
        stopped_s(after, sent),
        math.nan if rest is None else after[rest]["t"] - after[0]["t"],
        _way_m(until),
        _end(last, exit_code),
        exit_code,
        min(flown, default=math.inf),
        _harm(truth),
        later_m(after),
    )


def later_m(after: Sequence[dict[str, Any]]) -> float:
    """Metres between the place `LATER_S` before the end and the farthest from it since."""
    late = [s for s in after if s["t"] >= after[-1]["t"] - LATER_S]
    here = late[0]["position_ned_m"][:2]
    return max(math.dist(here, s["position_ned_m"][:2]) for s in late)


def stopped_s(after: Sequence[dict[str, Any]], sent: Sequence[tuple[float, float]]) -> float:
    """When zero velocity was asked for: on the wire, or by a mode of PX4's own; nan if never."""
    theirs = [s["t"] - after[0]["t"] for s in after if s["mode"] != "offboard"]
    ours = math.nan
    last_s = max((at_s for at_s, _ in sent), default=-math.inf)
    moving = [at_s for at_s, speed in sent if speed > COMMANDED_M_S]
    at_rest = [at_s for at_s, speed in sent if speed <= COMMANDED_M_S and at_s >= 0.0]
    if not [at_s for at_s in moving if at_s >= -_WIRE_PERIOD_S] and at_rest:
        return 0.0
    for at_s in at_rest:
        if last_s >= at_s + STOPPED_FOR_S and not any(
            at_s <= m_s <= at_s + STOPPED_FOR_S for m_s in moving
        ):
            ours = at_s
            break
    return min((s for s in (ours, *theirs[:1]) if not math.isnan(s)), default=math.nan)


def standing_from(states: Sequence[dict[str, Any]]) -> int | None:
    """The first state from which on it is at rest for `REST_FOR_S`; None when there is none."""
    first = 0
    for index, state in enumerate(states):
        if _speed_m_s(state) > AT_REST_M_S:
            first = index + 1
        elif state["t"] - states[first]["t"] >= REST_FOR_S:
            return first
    return first if first < len(states) and not states[first]["in_air"] else None


def _speed_m_s(state: dict[str, Any]) -> float:
    """Horizontal: up and down belong to taking off and landing."""
    return math.hypot(*state["velocity_ned_m_s"][:2])


def _way_m(states: Sequence[dict[str, Any]]) -> float:
    points = [state["position_ned_m"][:2] for state in states]
    return sum(math.dist(a, b) for a, b in itertools.pairwise(points))


def _end(last: dict[str, Any], exit_code: int | None) -> str:
    if not last["in_air"]:
        return "landed" if not last["armed"] else "on the ground, armed"
    return "flies on" if exit_code is None else f"PX4 {last['mode']}"


def _harm(truth: Sequence[dict[str, Any]]) -> str:
    for state in truth:
        if state["collided"]:
            return f"touched something at {state['t']:.1f} s"
        if state["in_air"] and not state["armed"]:
            return f"disarmed in the air at {state['t']:.1f} s"
    return ""
