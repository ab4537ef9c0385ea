"""The service as a process, and its page in a browser."""

import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from playwright.sync_api import Browser, sync_playwright

from autonomy.service.server import listening_socket
from tools.chromium import installed

READY_S = 300.0
"""A first start compiles the kernels."""
ENDS_S = 90.0


class Service:
    """`autonomy serve --sim` on one port, started as often as needed."""

    def __init__(self, folder: Path, scenario: str = "empty", config: str = "") -> None:
        self.logs = folder / "logs"
        self._said = folder / "said.txt"
        with listening_socket("127.0.0.1", 0) as free:
            self.port = int(free.getsockname()[1])
        self.url = f"http://127.0.0.1:{self.port}/"
        command = [sys.executable, "-m", "autonomy.cli", "serve", "--sim", scenario]
        self._command = [*command, "--port", str(self.port), "--log-dir", str(self.logs)]
        if config:
            written = folder / "config.yaml"
            written.write_text(config)
            self._command += ["--config", str(written)]
        self._process: subprocess.Popen[bytes] | None = None

    @property
    def pid(self) -> int:
        """Of the running process."""
        assert self._process is not None
        return self._process.pid

    def start(self) -> None:
        """Until it says that a mission may come."""
        with self._said.open("wb") as file:
            self._process = subprocess.Popen(self._command, stderr=file)
        ends_s = time.monotonic() + READY_S
        while "ready:" not in self._said.read_text():
            assert self._process.poll() is None, self._said.read_text()
            assert time.monotonic() < ends_s, self._said.read_text()
            time.sleep(0.05)

    def end(self) -> None:
        """As systemd ends it: what flies is landed first."""
        if self._process is not None:
            self._process.send_signal(signal.SIGTERM)
            self._process.wait(ENDS_S)
            self._process = None


@contextmanager
def chromium() -> Iterator[Browser]:
    """A headless browser."""
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=installed(), args=["--no-sandbox"])
        try:
            yield browser
        finally:
            browser.close()
