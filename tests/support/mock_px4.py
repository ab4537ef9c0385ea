"""The mock PX4 as a child process, as the command line starts it."""

import json
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any


def free_udp_port() -> int:
    """A UDP port on loopback that the operating system says is free."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
    return port


class MockProcess:
    """`with MockProcess(tmp_path) as mock:` waits until it is up, and ends it cleanly."""

    def __init__(self, folder: Path, *options: str, port: int | None = None) -> None:
        self.port = port or free_udp_port()
        self.truth_path = folder / "truth.jsonl"
        self._command = [
            *(sys.executable, "-m", "hal.sim.mock_px4", "--port", str(self.port)),
            *("--truth", str(self.truth_path), *options),
        ]
        self._process: subprocess.Popen[str] | None = None
        self.address = ("127.0.0.1", 0)

    def __enter__(self) -> "MockProcess":
        self._process = subprocess.Popen(
            self._command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
        )
        assert self._process.stdout is not None
        line = self._process.stdout.readline()
        if not line.startswith("ready"):
            _, errors = self._process.communicate()
            raise AssertionError(f"the mock did not start: {errors}")
        self.address = ("127.0.0.1", int(line.rsplit(":", 1)[1]))
        return self

    def __exit__(self, *_: object) -> None:
        self.end(signal.SIGTERM)

    @property
    def connection(self) -> str:
        """The URL under which a client hears it."""
        return f"udpin://127.0.0.1:{self.port}"

    def end(self, number: signal.Signals) -> int:
        """Signal it and wait; its exit status."""
        process = self._process
        if process is None:
            return 0
        self._process = None
        process.send_signal(number)
        try:
            _, errors = process.communicate(timeout=10.0)
        except subprocess.TimeoutExpired:
            process.kill()
            process.communicate()
            raise
        assert errors == ""
        return process.returncode

    def truth(self, vehicle: int = 1) -> list[dict[str, Any]]:
        """Every complete line of the truth file, of the first vehicle or of another."""
        path = self.truth_path
        path = path if vehicle == 1 else path.with_stem(f"{path.stem}-{vehicle}")
        lines = path.read_text().splitlines()
        return [json.loads(line) for line in lines if line.endswith("}")]

    def wait_for_truth(
        self, condition: Callable[[dict[str, Any]], bool], limit_s: float = 20.0
    ) -> dict[str, Any]:
        """Wait until the newest line of the truth fulfils `condition`, and return it."""
        end = time.monotonic() + limit_s
        while time.monotonic() < end:
            lines = self.truth()
            if lines and condition(lines[-1]):
                return lines[-1]
            time.sleep(0.05)
        raise AssertionError(f"it did not happen within {limit_s} s")

    def send_signal(self, number: signal.Signals) -> None:
        """Signal it and go on, as in stopping it for a while."""
        assert self._process is not None
        self._process.send_signal(number)
