"""Kill and full disk, for real: what was written before is a good log."""

import resource
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from autonomy.flightlog.reader import FlightLog, replay
from tests.unit.autonomy.flightlog.records import plain_step

pytestmark = pytest.mark.integration

CHILD = """
import sys, time
from pathlib import Path
from tests.unit.autonomy.flightlog.records import plain_inputs, plain_step
from autonomy.flightlog.recorder import FlightRecorder
from autonomy.flightlog.schema import FlightHeader
recorder = FlightRecorder(Path(sys.argv[1]), FlightHeader(config_json="{}"))
for index in range(100_000):
    inputs = plain_inputs(index / 20.0, 0.5 + index / 1e6)
    recorder.tick(inputs, plain_step(inputs), 1e-4)
    if index == 400:
        print("flying", flush=True)
    time.sleep(0.0025)
    if recorder.failure:
        print(recorder.failure, flush=True)
        break
recorder.close()
print("landed", recorder.dropped, flush=True)
"""


def child(path: Path, limit_bytes: int | None = None) -> "subprocess.Popen[str]":
    def limit() -> None:
        if limit_bytes is not None:
            signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
            resource.setrlimit(resource.RLIMIT_FSIZE, (limit_bytes, limit_bytes))

    return subprocess.Popen(
        [sys.executable, "-c", CHILD, str(path)],
        cwd=Path(__file__).parents[2],
        stdout=subprocess.PIPE,
        text=True,
        preexec_fn=limit,
    )


def test_a_killed_flight_is_readable_to_within_a_second(tmp_path: Path) -> None:
    with child(tmp_path / "a.mcap") as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "flying\n"
        process.kill()
    log = FlightLog.open(tmp_path / "a.mcap")
    ticks = list(log)
    assert log.damage is not None
    assert "cut off" in log.damage
    assert len(ticks) > 0
    assert replay(log, plain_step).exact


def test_a_full_disk_ends_recording_and_says_so(tmp_path: Path) -> None:
    with child(tmp_path / "a.mcap", limit_bytes=120000) as process:
        said, _ = process.communicate(timeout=60)
    failure, landed = said.splitlines()[-2:]
    assert failure.endswith("recording ended before the flight did (File too large)")
    assert landed.startswith("landed ")
    log = FlightLog.open(tmp_path / "a.mcap")
    assert replay(log, plain_step).exact
