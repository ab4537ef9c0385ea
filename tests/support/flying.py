"""`autonomy fly` as a process of its own, as a person starts it, and what it leaves behind."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

ROOT = Path(__file__).parents[2]
BODY_RADIUS_M = 0.15
START_LIMIT_S = 120.0
"""For everything before an event of the flight: a busy machine may take long to begin."""


class Flying:
    """`with Flying(folder, "--goal", "4,3", "--sim") as flying:` kills it at the end if it must.

    `prelude` is Python that runs before the command line does, to plant a defect.
    """

    def __init__(self, folder: Path, *arguments: str, prelude: str = "") -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self._out_path, self._err_path = folder / "out.jsonl", folder / "err.txt"
        program = ["-m", "autonomy.cli"]
        if prelude:
            program = ["-c", f"{prelude}\nfrom autonomy.cli import main\nmain()"]
        # Under nohup a hang-up is ignored, and stays so in every program that is begun from there.
        self._command = ["env", "--default-signal=HUP", sys.executable, *program, "fly", "--json"]
        self._command += ["--log-dir", str(folder), *arguments]
        self._process: subprocess.Popen[bytes] | None = None

    def __enter__(self) -> "Flying":
        with self._out_path.open("wb") as out, self._err_path.open("wb") as err:
            self._process = subprocess.Popen(
                self._command,
                stdout=out,
                stderr=err,
                cwd=ROOT,
                env=os.environ | {"PYTHONFAULTHANDLER": "1"},
            )
        return self

    def __exit__(self, *_: object) -> None:
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait()

    @property
    def process(self) -> "subprocess.Popen[bytes]":
        """The process that flies."""
        assert self._process is not None, "it was not started"
        return self._process

    @property
    def lines(self) -> list[dict[str, Any]]:
        """Every complete object it has written so far."""
        text = self._out_path.read_text(encoding="utf-8")
        return [json.loads(line) for line in text.splitlines() if line.endswith("}")]

    @property
    def errors(self) -> str:
        """Its standard error so far."""
        return self._err_path.read_text(encoding="utf-8")

    @property
    def report(self) -> dict[str, Any]:
        """The report, its last line."""
        last = self.lines[-1]
        assert last["type"] == "report", (last, self.errors)
        return last

    @property
    def states(self) -> list[str]:
        """The names of its events, in order."""
        return [line["name"] for line in self.lines if line["type"] == "event"]

    def wait_for(self, state: str, why: str = "", limit_s: float = START_LIMIT_S) -> None:
        """Until the mission has entered `state`, for a reason that contains `why`."""
        self.wait_until(
            lambda line: line["type"] == "event" and line["name"] == state and why in line["why"],
            f"{state} ({why})",
            limit_s,
        )

    def wait_for_note(self, text: str, limit_s: float = START_LIMIT_S) -> None:
        """Until it has said something that contains `text`."""
        self.wait_until(lambda line: text in line.get("text", ""), text, limit_s)

    def wait_for_speed(self, speed_m_s: float, limit_s: float = START_LIMIT_S) -> None:
        """Until it has flown that fast, horizontally."""

        def fast(line: dict[str, Any]) -> bool:
            north, east, _ = line.get("velocity_ned_m_s") or (0.0, 0.0, 0.0)
            return bool((north**2 + east**2) ** 0.5 > speed_m_s)

        self.wait_until(fast, f"{speed_m_s} m/s", limit_s)

    def wait_until(
        self, condition: Callable[[dict[str, Any]], bool], what: str, limit_s: float
    ) -> None:
        """Until a line fulfils `condition`."""
        end_s = time.monotonic() + limit_s
        while not any(condition(line) for line in self.lines):
            assert self.process.poll() is None, f"it ended before {what}: {self.errors}"
            assert time.monotonic() < end_s, f"no {what} in {limit_s} s: {self.lines[-3:]}"
            time.sleep(0.05)

    def send_signal(self, number: signal.Signals) -> None:
        """Send it a signal."""
        self.process.send_signal(number)

    def end(self, limit_s: float) -> int:
        """Wait until it has ended by itself; its exit code."""
        return self.process.wait(limit_s)


def never_harmed(truth: list[dict[str, Any]]) -> None:
    """The vehicle was never disarmed in the air and never touched anything."""
    assert any(state["in_air"] for state in truth), "it never flew"
    for state in truth:
        assert state["armed"] or not state["in_air"], f"disarmed in the air: {state}"
        assert not state["collided"], state


def on_the_ground(truth: list[dict[str, Any]]) -> bool:
    """It has landed and is disarmed."""
    last = truth[-1]
    return not last["in_air"] and not last["armed"]


def holding(truth: list[dict[str, Any]]) -> bool:
    """It hovers at rest in PX4's Hold."""
    last = truth[-1]
    north, east, down = last["velocity_ned_m_s"]
    speed_m_s = (north**2 + east**2 + down**2) ** 0.5
    return bool(last["in_air"] and last["armed"] and last["mode"] == "hold" and speed_m_s < 0.1)
