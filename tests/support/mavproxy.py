"""MAVProxy as a child process: commands on its standard input, what it prints line by line."""

import os
import subprocess
import sys
import threading
import time
from pathlib import Path

MODULES = "cmdlong,param,mode,arm,wp,rally,fence,link,log,misc,ftp"
"""What a session without a window needs."""


class MavProxy:
    """`with MavProxy(folder, port) as proxy:` listens on `port`; it is ended at the end."""

    def __init__(self, folder: Path, port: int) -> None:
        program = Path(sys.executable).with_name("mavproxy.py")
        self._command = [
            *(sys.executable, "-u", str(program)),
            f"--master=udpin:127.0.0.1:{port}",
            "--source-system=255",
            f"--state-basedir={folder}",
            "--logfile=session.tlog",
            f"--default-modules={MODULES}",
        ]
        self._folder = folder
        self._lines: list[str] = []
        self._process: subprocess.Popen[str] | None = None
        self._reader = threading.Thread(target=self._read, name="mavproxy")

    def __enter__(self) -> "MavProxy":
        self._process = subprocess.Popen(
            self._command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            cwd=self._folder,
            env=os.environ | {"HOME": str(self._folder), "MPLBACKEND": "agg"},
        )
        self._reader.start()
        return self

    def __exit__(self, *_: object) -> None:
        process = self._process
        assert process is not None
        assert process.stdin is not None
        process.kill()
        process.wait()
        self._reader.join()
        process.stdin.close()
        assert process.stdout is not None
        process.stdout.close()

    def _read(self) -> None:
        assert self._process is not None
        assert self._process.stdout is not None
        for line in self._process.stdout:
            self._lines.append(line.rstrip())

    @property
    def text(self) -> str:
        """Everything it has printed."""
        return "\n".join(self._lines)

    def do(self, command: str, expected: str = "", limit_s: float = 60.0) -> str:
        """Type a command and wait until something new contains `expected`; that line.

        Typed again every 15 s: on a machine that is too busy its socket overflows, and MAVProxy
        itself repeats no command.
        """
        seen, end_s = len(self._lines), time.monotonic() + limit_s
        while True:
            self._type(command)
            if not expected:
                return ""
            try:
                return self.wait(expected, min(15.0, end_s - time.monotonic()), since=seen)
            except AssertionError:
                if time.monotonic() > end_s - 1.0:
                    raise

    def _type(self, command: str) -> None:
        process = self._process
        assert process is not None
        assert process.stdin is not None
        process.stdin.write(command + "\n")
        process.stdin.flush()

    def wait(self, expected: str, limit_s: float = 60.0, *, since: int = 0) -> str:
        """Wait for a line, after the first `since`, that contains `expected`."""
        end_s = time.monotonic() + limit_s
        while time.monotonic() < end_s:
            for line in self._lines[since:]:
                if expected in line:
                    return line
            time.sleep(0.05)
        raise AssertionError(f"MAVProxy did not say {expected!r} in {limit_s} s: {self.text}")
