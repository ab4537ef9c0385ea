"""The two soaks: in process as fast as it goes, and the service over MAVSDK in real time."""

import itertools
import json
import math
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
import urllib.request
from collections.abc import Callable
from pathlib import Path

import psutil

from autonomy.config import Config
from autonomy.errors import AutonomyError
from autonomy.service.client import Client
from autonomy.service.contract import MissionOrder, Phase
from autonomy.simulation import Simulation, goal_of, with_scenario
from autonomy.warm import warm_up
from hal.sim.scenario import load_scenario
from tools import unit_file
from tools.soak.sample import Sample, look

ROOMS = ("default", "u_trap", "door", "low_wall", "divided")
_READY_S = 60.0
_LAG_BUCKET = re.compile(r'autonomy_loop_lag_seconds_bucket\{le="([^"]+)"\} (\S+)')
Tell = Callable[[str], None]


def simulated(hours: float, tell: Tell) -> list[Sample]:
    """Fly the shipped rooms in turn, stopping and rolling, until `hours` of flight are over."""
    warm_up()
    process = psutil.Process()
    samples: list[Sample] = []
    flown_s, started_s = 0.0, time.monotonic()
    for number in itertools.count():
        scenario = load_scenario(ROOMS[number % len(ROOMS)])
        mode = ("stop", "rolling")[number // len(ROOMS) % 2]
        chosen = Config.model_validate({"mission": {"replan": {"mode": mode}}})
        config = with_scenario(chosen, scenario)
        flight = Simulation(scenario, config, (goal_of(scenario, config),), number).run()
        flown_s += flight.simulated_s
        if flight.collided:
            raise AutonomyError(f"{scenario.name}, {mode}, seed {number}: touched something")
        samples.append(look(process, time.monotonic() - started_s, number + 1))
        if number % 50 == 0:
            tell(f"{number + 1} missions, {flown_s / 3600.0:.2f} h, {samples[-1].rss_mb:.0f} MB")
        if flown_s >= 3600.0 * hours:
            return samples
    raise AssertionError("counting has no end")


def real(minutes: float, tell: Tell, every_s: float = 5.0) -> tuple[list[Sample], list[str]]:
    """`autonomy serve` with its simulated vehicle, mission after mission there and back.

    (samples of the service's process, how each mission ended). Its vehicle, a process of its own,
    is not looked at. Raises AutonomyError when the service does not become ready.
    """
    with tempfile.TemporaryDirectory(prefix="soak-") as name:
        folder = Path(name)
        command = [sys.executable, "-m", "autonomy.cli", "serve", "--sim", "empty", "--port", "0"]
        with (folder / "said.txt").open("w") as said:
            service = unit_file.started([*command, "--log-dir", str(folder / "logs")], said)
        try:
            client = _ready(service, folder / "said.txt")
            return _missions(service, client, minutes, tell, every_s)
        finally:
            service.send_signal(signal.SIGTERM)
            service.wait(120.0)


def _ready(service: "subprocess.Popen[bytes]", said: Path) -> Client:
    end_s = time.monotonic() + _READY_S
    while time.monotonic() < end_s and service.poll() is None:
        found = re.search(r"listening on (\S+)", said.read_text(encoding="utf-8"))
        if found is not None and Client(found[1]).state().phase is Phase.READY:
            return Client(found[1])
        time.sleep(0.2)
    raise AutonomyError(f"the service did not become ready: {said.read_text(encoding='utf-8')}")


def _missions(
    service: "subprocess.Popen[bytes]", client: Client, minutes: float, tell: Tell, every_s: float
) -> tuple[list[Sample], list[str]]:
    process = psutil.Process(service.pid)
    samples: list[Sample] = []
    endings: list[str] = []
    started_s = time.monotonic()
    goals = itertools.cycle([[2.0, 1.5], [0.0, 0.0]])
    before = _lags(client)
    mission = ""
    while True:
        at_s = time.monotonic() - started_s
        state = client.state()
        if state.phase is Phase.READY:
            if mission:
                endings.append(_ending(client, mission))
            if at_s >= 60.0 * minutes:
                return samples, endings
            mission = client.create(MissionOrder(goals=(next(goals),))).id
        now = _lags(client)
        samples.append(look(process, at_s, len(endings), _worst_tenth_ms(before, now)))
        before = now
        if len(samples) % 24 == 1:
            tell(f"{at_s / 60.0:.1f} min, {len(endings)} missions, {samples[-1].rss_mb:.0f} MB")
        time.sleep(every_s)


def _ending(client: Client, mission: str) -> str:
    with urllib.request.urlopen(f"{client.url}/v1/missions/{mission}", timeout=5) as answer:  # noqa: S310  our own service
        return str(json.loads(answer.read())["ending"])


def _lags(client: Client) -> dict[float, float]:
    """The loop-lag histogram of /metrics: upper bound in seconds -> ticks up to it."""
    with urllib.request.urlopen(f"{client.url}/metrics", timeout=5) as answer:  # noqa: S310  our own service
        text = answer.read().decode()
    return {float(bound): float(count) for bound, count in _LAG_BUCKET.findall(text)}


def _worst_tenth_ms(before: dict[float, float], now: dict[float, float]) -> float:
    """Below which bound nine tenths of the ticks between two looks began, in ms; nan for none."""
    ticks = {bound: count - before.get(bound, 0.0) for bound, count in now.items()}
    total = ticks.get(math.inf, 0.0)
    if total <= 0.0:
        return math.nan
    return 1e3 * min(bound for bound, count in ticks.items() if count >= 0.9 * total)


def machine() -> str:
    """Where this was measured."""
    return f"{os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}"
