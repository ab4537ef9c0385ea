"""`autonomy serve` as systemd runs it, on real MAVSDK and real MAVLink."""

import json
import os
import re
import signal
import socket
import subprocess
import sys
import time
import urllib.request
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from autonomy.embedded import free_udp_port
from autonomy.service.client import Client
from autonomy.service.contract import MissionOrder, Phase
from hal.sim.scenario import load_scenario

pytestmark = pytest.mark.integration
AUTONOMY = (sys.executable, "-m", "autonomy.cli")


class Systemd:
    """The socket that systemd listens on."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._wire = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._wire.bind(str(path))
        self._wire.settimeout(0.2)
        self.heard: list[str] = []

    def until(self, beginning: str, within_s: float) -> None:
        ends_s = time.monotonic() + within_s
        while time.monotonic() < ends_s:
            try:
                self.heard.append(self._wire.recv(4096).decode())
            except TimeoutError:
                continue
            if self.heard[-1].startswith(beginning):
                return
        pytest.fail(f"never told {beginning}: {self.heard[-8:]}")

    def close(self) -> None:
        self._wire.close()


class Served:
    """A running service."""

    def __init__(self, folder: Path, *arguments: str) -> None:
        self.systemd = Systemd(folder / "notify")
        self._said = (folder / "said.txt").open("w+")
        self.process = subprocess.Popen(
            [*AUTONOMY, "serve", "--port", "0", "--log-dir", str(folder / "logs"), *arguments],
            stderr=self._said,
            env={
                **os.environ,
                "NOTIFY_SOCKET": str(self.systemd.path),
                "WATCHDOG_USEC": "2000000",
            },
        )
        self.said_path = folder / "said.txt"

    def ready(self) -> Client:
        self.systemd.until("READY=1", 40.0)
        found = re.search(r"listening on (\S+)", self.said_path.read_text())
        assert found is not None
        return Client(found[1])

    def end(self) -> int:
        self.process.send_signal(signal.SIGTERM)
        return self.process.wait(60.0)

    def close(self) -> None:
        if self.process.poll() is None:
            self.process.kill()
            self.process.wait()
        self._said.close()
        self.systemd.close()


Serve = Callable[..., Served]


@pytest.fixture
def serve(tmp_path: Path) -> Iterator[Serve]:
    started: list[Served] = []

    def start(*arguments: str) -> Served:
        started.append(Served(tmp_path, *arguments))
        return started[-1]

    yield start
    for served in started:
        served.close()


@pytest.fixture
def vehicle() -> Iterator[Callable[[], tuple[str, subprocess.Popen[str]]]]:
    port = free_udp_port()
    running: list[subprocess.Popen[str]] = []

    def start() -> tuple[str, subprocess.Popen[str]]:
        command = [sys.executable, "-m", "hal.sim.mock_px4"]
        command += ["--scenario", "empty", "--port", str(port)]
        running.append(subprocess.Popen(command, stdout=subprocess.PIPE, text=True))
        stdout = running[-1].stdout
        assert stdout is not None
        assert stdout.readline().startswith("ready")
        return f"udpin://127.0.0.1:{port}", running[-1]

    yield start
    for process in running:
        if process.poll() is None:
            process.kill()
            process.communicate()


def until(holds: Callable[[], bool], within_s: float = 30.0) -> None:
    ends_s = time.monotonic() + within_s
    while not holds():
        assert time.monotonic() < ends_s, "it never came to that"
        time.sleep(0.05)


def read(client: Client, path: str) -> Any:
    with urllib.request.urlopen(client.url + path, timeout=5) as answer:  # noqa: S310 - our own
        return json.loads(answer.read())


def test_a_mission_over_http_from_readiness_to_its_log(serve: Serve) -> None:
    served = serve("--sim", "empty")
    client = served.ready()
    north, east = load_scenario("empty").goal_ne_m
    record = client.create(MissionOrder(goals=([north / 3.0, east / 3.0],)))
    frames = list(client.follow(record.id))
    over = frames[-1].record
    assert over is not None
    assert over.ending == "goal_reached", over.why
    states = {str(f.command.decision.state) for f in frames if f.command is not None}
    assert {"takeoff", "detect", "cruise", "land"} <= states
    assert [log["name"] for log in read(client, "/v1/logs")] == [over.log]
    served.systemd.until("WATCHDOG=1", 5.0)
    assert served.end() == 0
    assert any(
        message.startswith("STATUS=waiting for a vehicle") for message in served.systemd.heard
    )


def test_stopped_in_flight_it_lands_before_it_ends(serve: Serve) -> None:
    served = serve("--sim", "empty")
    client = served.ready()
    record = client.create(MissionOrder(goals=([2.0, 0.0],)))
    for frame in client.follow(record.id):
        if frame.command is not None and frame.command.decision.state == "cruise":
            break
    assert served.end() == 0
    (report,) = served.said_path.parent.glob("logs/*.report.json")
    assert json.loads(report.read_text())["ending"] == "aborted"


def test_it_survives_its_vehicle_s_restart_and_keeps_others_away(
    serve: Serve, vehicle: Callable[[], tuple[str, subprocess.Popen[str]]]
) -> None:
    url, process = vehicle()
    served = serve("--connection", url)
    client = served.ready()

    second = subprocess.run(
        [*AUTONOMY, "serve", "--port", "0", "--connection", url],
        capture_output=True,
        text=True,
        check=False,
    )
    assert second.returncode == 14
    assert f"held by autonomy serve (process {served.process.pid}" in second.stderr

    process.kill()
    process.communicate()
    until(lambda: client.state().phase is Phase.WAITING)
    assert client.state().vehicle is None
    vehicle()
    until(lambda: client.state().phase is Phase.READY)

    handed = subprocess.run(
        [*AUTONOMY, "fly", "--goal", "0.7,0.3", "--connection", url, "--json"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert handed.returncode == 0, handed.stdout[-500:] + handed.stderr
    assert "handed to autonomy serve" in handed.stdout
    assert served.end() == 0


def in_cruise(client: Client, goal: tuple[float, float]) -> None:
    """A mission of this service, followed until it is on its way."""
    record = client.create(MissionOrder(goals=([*goal],)))
    for frame in client.follow(record.id):
        if frame.command is not None and str(frame.command.decision.state) == "cruise":
            return
    pytest.fail("it never came to cruise")


def anew(tmp_path: Path, choice: str, serve: Serve, url: str) -> tuple[Served, Client]:
    """The service started again after SIGKILL in cruise, with a choice."""
    config = tmp_path / "choice.yaml"
    config.write_text(f"service: {{on_restart_in_flight: {choice}}}\n")
    first = serve("--connection", url, "--config", str(config))
    in_cruise(first.ready(), (3.0, 1.0))
    time.sleep(1.5)  # what is flushed to the log once a second is there
    first.process.kill()
    first.process.wait()
    first.close()
    (tmp_path / "notify").unlink()
    second = serve("--connection", url, "--config", str(config))
    return second, second.ready()


def test_killed_in_cruise_and_begun_anew_it_goes_on_to_the_goal(
    tmp_path: Path, serve: Serve, vehicle: Callable[[], tuple[str, subprocess.Popen[str]]]
) -> None:
    url, _ = vehicle()
    second, client = anew(tmp_path, "resume", serve, url)
    until(lambda: bool(read(client, "/v1/missions")), 30.0)
    until(lambda: read(client, "/v1/missions")[0]["status"] == "done", 120.0)
    assert read(client, "/v1/missions")[0]["ending"] == "goal_reached"
    assert second.end() == 0


def test_killed_in_cruise_and_begun_anew_it_lands_where_that_is_chosen(
    tmp_path: Path, serve: Serve, vehicle: Callable[[], tuple[str, subprocess.Popen[str]]]
) -> None:
    url, _ = vehicle()
    second, client = anew(tmp_path, "land", serve, url)

    def down() -> bool:
        seen = read(client, "/v1/state")["vehicle"]
        return seen is not None and not seen["armed"]

    until(down, 60.0)
    assert not read(client, "/v1/missions")
    assert second.end() == 0
