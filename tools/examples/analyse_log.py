"""Analyse a flight log: how long each state took, how near the walls were, how fast it decided.

A log is an MCAP file that holds every input and every decision. The project's own reader gives
them as records; `every_topic` shows that any MCAP library reads it, too: messages are JSON.
"""

import argparse
import math
import statistics
from collections import Counter, defaultdict
from collections.abc import Sequence
from pathlib import Path

from mcap.reader import make_reader

from autonomy.flightlog.reader import FlightLog


def seconds_by_state(log: FlightLog) -> dict[str, float]:
    """How long the mission was in each of its states."""
    spent: defaultdict[str, float] = defaultdict(float)
    before_s: float | None = None
    for tick in log:
        decision = tick.command.decision
        if before_s is not None:
            spent[decision.state.value] += decision.now_s - before_s
        before_s = decision.now_s
    return dict(spent)


def flown(log: FlightLog) -> dict[str, float]:
    """Numbers of the flight; the clearance is that of the map, as the pilot knew it."""
    commands = [tick.command for tick in log]
    steps_ms = [tick.step_s * 1e3 for tick in log]
    sent = [command for command in commands if command.setpoint is not None]
    speeds_m_s = [math.hypot(*c.setpoint.velocity_ned_m_s[:2]) for c in sent if c.setpoint]
    return {
        "ticks": len(commands),
        "least clearance, m": min(command.decision.clearance_m for command in sent),
        "fastest setpoint, m/s": max(speeds_m_s),
        "plans": sum(command.decision.plan is not None for command in commands),
        "changed by the guard": sum(bool(command.guard.limits) for command in commands),
        "step, median, ms": statistics.median(steps_ms),
        "step, longest, ms": max(steps_ms),
    }


def every_topic(path: Path) -> Counter[str]:
    """Messages by topic, read without this project."""
    with path.open("rb") as file:
        return Counter(channel.topic for _, channel, _ in make_reader(file).iter_messages())


def main(arguments: Sequence[str] | None = None) -> None:
    """Tell them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("log", type=Path, help="a file of the folder flights/")
    path = parser.parse_args(arguments).log
    log = FlightLog.open(path)
    print(f"flown {log.header.started_utc} in {log.header.scenario or 'the real world'}")
    for state, seconds in seconds_by_state(log).items():
        print(f"{state:>22}: {seconds:6.1f} s")
    for what, number in flown(log).items():
        print(f"{what:>22}: {number:.6g}")
    print("messages:", ", ".join(f"{n} {topic}" for topic, n in every_topic(path).items()))


if __name__ == "__main__":
    main()
