"""What the service costs: processor, memory, and how punctual its control loop is.

python -m tools.bench.service [--scenario NAME] [--rest S] [--write]

Starts `autonomy serve --sim` with its log, opens the page's stream at its full rate, and flies one
mission there and one back: the first with the page open, the second while reports of flights are
made one after another. Ticks are judged by the times in the flights' own logs. The simulated PX4
and whatever makes reports are processes of their own and not counted.
"""

import argparse
import contextlib
import json
import signal
import statistics
import subprocess
import sys
import tempfile
import threading
import time
import urllib.error
import urllib.request
from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path

import msgspec
import psutil
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from autonomy.config import Config
from autonomy.flightlog.reader import FlightLog
from autonomy.service.contract import MissionRecord, MissionStatus, Phase
from autonomy.service.server import listening_socket
from hal.sim.scenario import load_scenario
from tools import pages, unit_file
from tools.bench import report

_READY_S, _MISSION_S = 900.0, 300.0
"""A first start compiles the kernels."""
_POLL_S = 0.25
_MISSION_POLL_S = 2.0
"""The page asks for nothing while it watches: a flight's cost shall not be that of asking."""
_HELP_RUNS = 5
_MIB = 1024.0 * 1024.0
WANTED = {"cpu": 0.10, "memory": 200.0, "jitter": 0.005, "help": 0.2}
"""Of a core, MiB, s (p99), s."""


class Used(msgspec.Struct, frozen=True):
    """One stretch of the service's life: seconds of wall clock and of processor, largest memory."""

    name: str
    wall_s: float
    cpu_s: float
    rss_mib: float
    own_mib: float
    """Of that, what no other process shares."""

    @property
    def cpu(self) -> float:
        """Of one core."""
        return self.cpu_s / self.wall_s if self.wall_s > 0.0 else 0.0


class Punctual(msgspec.Struct, frozen=True):
    """How far the ticks of one flight were from their period, in s; and what a step took."""

    name: str
    ticks: int
    median_s: float
    p99_s: float
    worst_s: float
    step_median_s: float


def punctuality(
    name: str, times_s: Sequence[float], steps_s: Sequence[float], period_s: float
) -> Punctual:
    """From when ticks began; raises ValueError for fewer than two."""
    apart = sorted(abs(b - a - period_s) for a, b in pairwise(times_s))
    if not apart:
        raise ValueError(f"{name}: fewer than two ticks")
    return Punctual(
        name,
        len(times_s),
        statistics.median(apart),
        apart[min(len(apart) - 1, int(0.99 * len(apart)))],
        apart[-1],
        statistics.median(steps_s),
    )


def of_log(name: str, path: Path, period_s: float) -> Punctual:
    """The ticks of a flight log."""
    times_s, steps_s = [], []
    for tick in FlightLog.open(path):
        times_s.append(tick.inputs.now_s)
        steps_s.append(tick.step_s)
    return punctuality(name, times_s, steps_s, period_s)


class Meter:
    """Watches one process: its processor time, and its memory every quarter of a second."""

    def __init__(self, pid: int) -> None:
        self._process = psutil.Process(pid)

    @contextlib.contextmanager
    def stretch(self, name: str, into: list[Used]) -> Iterator[None]:
        """Measure what happens inside."""
        before, began_s = self._cpu_s(), time.monotonic()
        peaks = [0.0, 0.0]
        over = threading.Event()

        def look() -> None:
            while True:
                memory = self._process.memory_full_info()
                peaks[0], peaks[1] = max(peaks[0], memory.rss), max(peaks[1], memory.uss)
                if over.wait(_POLL_S):
                    return

        looking = threading.Thread(target=look)
        looking.start()
        try:
            yield
        finally:
            over.set()
            looking.join()
        wall_s, cpu_s = time.monotonic() - began_s, self._cpu_s() - before
        into.append(Used(name, wall_s, cpu_s, peaks[0] / _MIB, peaks[1] / _MIB))

    def _cpu_s(self) -> float:
        times = self._process.cpu_times()
        return float(times.user + times.system)


class Served:
    """A running service, asked over HTTP."""

    def __init__(self, folder: Path, scenario: str) -> None:
        with listening_socket("127.0.0.1", 0) as free:
            self.port = int(free.getsockname()[1])
        command = [sys.executable, "-m", "autonomy.cli", "serve", "--sim", scenario]
        command += ["--port", str(self.port), "--log-dir", str(folder)]
        self.process = unit_file.started(command, subprocess.DEVNULL)
        self._wait_ready()

    def get(self, path: str, timeout_s: float = 10.0) -> bytes:
        """The body of an answer; raises OSError."""
        address = f"http://127.0.0.1:{self.port}{path}"
        with urllib.request.urlopen(address, timeout=timeout_s) as answer:
            body: bytes = answer.read()
            return body

    def fly(self, goal: tuple[float, float]) -> MissionRecord:
        """Fly there; the mission's record when it is over. Raises OSError, TimeoutError."""
        body = json.dumps({"goals": [list(goal)]}).encode()
        request = urllib.request.Request(
            f"http://127.0.0.1:{self.port}/v1/missions",
            data=body,
            headers={"content-type": "application/json"},
        )
        with urllib.request.urlopen(request, timeout=30.0) as answer:  # noqa: S310 - loopback
            record = msgspec.json.decode(answer.read(), type=MissionRecord)
        ends_s = time.monotonic() + _MISSION_S
        while record.status in (MissionStatus.QUEUED, MissionStatus.FLYING):
            if time.monotonic() > ends_s:
                raise TimeoutError(f"mission {record.id} is not over after {_MISSION_S:g} s")
            time.sleep(_MISSION_POLL_S)
            record = msgspec.json.decode(self.get(f"/v1/missions/{record.id}"), type=MissionRecord)
        return record

    def end(self) -> None:
        """As systemd ends it."""
        self.process.send_signal(signal.SIGTERM)
        self.process.wait(120.0)

    def _wait_ready(self) -> None:
        ends_s = time.monotonic() + _READY_S
        while time.monotonic() < ends_s:
            if self.process.poll() is not None:
                raise TimeoutError("the service ended before it was ready")
            with contextlib.suppress(OSError):
                if json.loads(self.get("/v1/health"))["phase"] == Phase.READY.value:
                    return
            time.sleep(_POLL_S)
        raise TimeoutError(f"the service was not ready after {_READY_S:g} s")


@contextlib.contextmanager
def open_page(port: int) -> Iterator[list[int]]:
    """A watcher like the page: takes the stream at its full rate. Yields [messages, bytes]."""
    counted = [0, 0]
    with connect(f"ws://127.0.0.1:{port}/v1/stream", max_size=None) as socket:

        def take() -> None:
            with contextlib.suppress(ConnectionClosed):
                for message in socket:
                    counted[0] += 1
                    counted[1] += len(message)

        watching = threading.Thread(target=take)
        watching.start()
        yield counted
        socket.close()
        watching.join()


@contextlib.contextmanager
def reports_made(served: Served, log: str) -> Iterator[list[int]]:
    """Reports of `log` and reels for looking back at it, one after another. Yields [how many]."""
    made = [0]
    over = threading.Event()

    def make() -> None:
        while not over.is_set():
            for what in ("report", "reel"):
                with contextlib.suppress(urllib.error.HTTPError):
                    served.get(f"/v1/logs/{log}/{what}", 320.0)
                    made[0] += 1

    making = threading.Thread(target=make)
    making.start()
    try:
        yield made
    finally:
        over.set()
        making.join()


def help_s(runs: int = _HELP_RUNS) -> float:
    """The quickest of a few `autonomy --help`, in s of wall clock."""
    command = [sys.executable, "-m", "autonomy.cli", "--help"]
    taken = []
    for _ in range(runs):
        began_s = time.perf_counter()
        subprocess.run(command, stdout=subprocess.DEVNULL, check=True)
        taken.append(time.perf_counter() - began_s)
    return min(taken)


class Measured(msgspec.Struct, frozen=True):
    """Everything of one run."""

    used: tuple[Used, ...]
    ticks: tuple[Punctual, ...]
    help_s: float
    stream: tuple[int, int]
    reports: int
    scenario: str


def measure(scenario: str, rest_s: float) -> Measured:
    """Rest, fly there, fly back while reports are made; raises OSError or TimeoutError."""
    world = load_scenario(scenario)
    goal = world.goal_ne_m
    period_s = 1.0 / Config().control.rate_hz
    used: list[Used] = []
    ticks: list[Punctual] = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        served = Served(folder, scenario)
        try:
            meter = Meter(served.process.pid)
            with meter.stretch("at rest, no page", used):
                time.sleep(rest_s)
            with open_page(served.port) as counted:
                with meter.stretch("at rest, page open", used):
                    time.sleep(rest_s)
                with meter.stretch("flying, page open", used):
                    there = served.fly(goal)
                with (
                    meter.stretch("flying, page open, reports being made", used),
                    reports_made(served, str(there.log)) as made,
                ):
                    back = served.fly((0.0, 0.0))
        finally:
            served.end()
        for stretch, record in (("page open", there), ("page open, reports being made", back)):
            if record.log is not None:
                ticks.append(of_log(stretch, folder / record.log, period_s))
    return Measured(
        tuple(used), tuple(ticks), help_s(), (counted[0], counted[1]), made[0], scenario
    )


def page(measured: Measured) -> str:
    """The measurement in Markdown."""
    wanted = (
        f"`autonomy serve --sim {measured.scenario}`, 20 Hz, log on. Wanted: under "
        f"{WANTED['cpu']:.0%} of a core, {WANTED['memory']:.0f} MiB, jitter p99 "
        f"{1e3 * WANTED['jitter']:.0f} ms, help {WANTED['help']:g} s."
    )
    used = (
        f"| {each.name} | {each.cpu:.1%} | {each.rss_mib:.0f} | {each.own_mib:.0f} |"
        for each in measured.used
    )
    ticks = (
        f"| {each.name} | {each.ticks} | {1e3 * each.median_s:.2f} ms | "
        f"{1e3 * each.p99_s:.2f} ms | {1e3 * each.worst_s:.1f} ms | "
        f"{1e3 * each.step_median_s:.2f} ms |"
        for each in measured.ticks
    )
    rest = (
        f"`autonomy --help`: {measured.help_s:.2f} s. The page was told {measured.stream[0]} "
        f"messages, {measured.stream[1] / 1e6:.1f} MB; {measured.reports} reports and reels "
        "were made."
    )
    used_head = "| service | of one core | memory, MiB | of it not shared |\n|---|--:|--:|--:|"
    tick_head = "| control loop, off its period by | ticks | median | p99 | worst | a step |"
    tick_head += "\n|---|--:|--:|--:|--:|--:|"
    parts = (report.stamp(), "", wanted, "", used_head, *used, "", tick_head, *ticks, "", rest)
    return "\n".join(parts)


def main(arguments: Sequence[str] | None = None) -> int:
    """Returns 1 where something that is wanted was not reached."""
    parser = argparse.ArgumentParser(
        prog="python -m tools.bench service",
        description=__doc__.splitlines()[0] if __doc__ else None,
    )
    parser.add_argument("--scenario", default="default")
    parser.add_argument("--rest", type=float, default=10.0, help="seconds of rest")
    parser.add_argument("--write", action="store_true", help="renew tools/bench/README.md")
    options = parser.parse_args(arguments)
    if options.write:
        pages.must_have("service", report.README)
    measured = measure(options.scenario, options.rest)
    text = page(measured)
    sys.stdout.write(text + "\n")
    if options.write:
        report.renew("service", text)
    return int(bool(missed(measured)))


def missed(measured: Measured) -> list[str]:
    """What is wanted and was not reached."""
    found = [f"{u.name}: {u.cpu:.1%} of a core" for u in measured.used if u.cpu > WANTED["cpu"]]
    found += [
        f"{u.name}: {u.rss_mib:.0f} MiB" for u in measured.used if u.rss_mib > WANTED["memory"]
    ]
    found += [f"{t.name}: {t.p99_s:.4f} s" for t in measured.ticks if t.p99_s > WANTED["jitter"]]
    if measured.help_s > WANTED["help"]:
        found.append(f"help: {measured.help_s:.2f} s")
    return found


if __name__ == "__main__":
    sys.exit(main())
