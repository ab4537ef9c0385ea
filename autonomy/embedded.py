"""The embedded PX4: the mock vehicle in a process of its own, reached like a real one.

It is started for `--sim`, speaks MAVLink on loopback, writes the truth that only a simulation
knows to a file, and is ended with the flight.
"""

import json
import socket
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from autonomy.errors import AutonomyError

_END_S = 3.0


def free_udp_port() -> int:
    """A UDP port on loopback that nobody has at this moment."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
    return port


class EmbeddedPx4:
    """A context: the mock PX4 runs inside it. `connection` is what a client opens."""

    def __init__(self, scenario: str, seed: int, faults: Sequence[str] = ()) -> None:
        """`scenario` is a shipped name or the path of a file, `faults` are more of what goes wrong
        in it, each as `hal.sim.fault_kinds.parse_fault` reads it.
        """
        self._scenario = scenario
        self._seed = seed
        self._faults = tuple(faults)
        self._process: subprocess.Popen[str] | None = None
        self._folder = tempfile.TemporaryDirectory(prefix="autonomy-sim-")
        self.truth_path = Path(self._folder.name) / "truth.jsonl"
        self.port = free_udp_port()
        self._asked = 0

    @property
    def connection(self) -> str:
        """The URL under which the vehicle is heard."""
        return f"udpin://127.0.0.1:{self.port}"

    @property
    def pid(self) -> int | None:
        """The mock's process, while it runs."""
        return self._process.pid if self._process is not None else None

    def __enter__(self) -> "EmbeddedPx4":
        """Start and wait until it is up; raises AutonomyError with its last words when it fails."""
        command = [sys.executable, "-m", "hal.sim.mock_px4"]
        command += ["--scenario", self._scenario, "--port", str(self.port)]
        command += ["--seed", str(self._seed), "--truth", str(self.truth_path)]
        for fault in self._faults:
            command += ["--fault", fault]
        # Its standard input ends with this process, also where nobody can tidy up (SIGKILL).
        command += ["--while-stdin"]
        # The child must not get the terminal's Ctrl-C: the vehicle flies on while we land it.
        errors_path = Path(self._folder.name) / "errors.txt"
        with errors_path.open("w", encoding="utf-8") as errors:
            self._process = subprocess.Popen(  # noqa: S603  our own module, no shell
                command,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=errors,
                text=True,
                start_new_session=True,
            )
        stdout = self._process.stdout
        line = stdout.readline() if stdout is not None else ""
        if not line.startswith("ready"):
            self._process.kill()
            self._process.communicate()
            self._process = None
            said = errors_path.read_text(encoding="utf-8").strip().splitlines()
            self._folder.cleanup()
            last = said[-1] if said else "it said nothing"
            raise AutonomyError(f"the embedded vehicle did not start: {last}")
        return self

    def give_up(self) -> None:
        """End a start that another thread waits for: it fails there."""
        process = self._process
        if process is not None:
            process.kill()

    def __exit__(self, *_: object) -> None:
        """End the process and remove its files; the truth must have been read before."""
        process = self._process
        if process is not None:
            process.terminate()
            try:
                process.communicate(timeout=_END_S)
            except subprocess.TimeoutExpired:
                process.kill()
                process.communicate()
            self._process = None
        self._folder.cleanup()

    def true_clearance_m(self) -> float | None:
        """The smallest true clearance in the air since this was asked last; None if it never was
        in the air: asked after each flight it is that flight's.
        """
        smallest: float | None = None
        states = self.truth()
        new, self._asked = states[self._asked :], len(states)
        for state in new:
            clearance = state.get("clearance_m")
            if state.get("in_air") and isinstance(clearance, float):
                smallest = clearance if smallest is None else min(smallest, clearance)
        return smallest

    def truth(self) -> list[dict[str, object]]:
        """Every true state written so far, oldest first; a line cut short is left out."""
        states: list[dict[str, object]] = []
        if not self.truth_path.exists():
            return states
        for line in self.truth_path.read_text(encoding="utf-8").splitlines():
            try:
                states.append(json.loads(line))
            except json.JSONDecodeError:
                continue
        return states
