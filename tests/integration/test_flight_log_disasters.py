"""Kill and full disk, for real: what was written before is a good log."""

import resource
import signal
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import pytest

from autonomy.errors import NotReplayable
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


EXECUTIONER = """
import os, random, signal, sys, time
from pathlib import Path
from tests.unit.autonomy.flightlog.records import plain_inputs, plain_step
from autonomy.flightlog.recorder import FlightRecorder
from autonomy.flightlog.schema import FlightHeader

def write(path):
    recorder = FlightRecorder(path, FlightHeader(config_json="{}"))
    while True:
        inputs = plain_inputs(time.monotonic())
        recorder.tick(inputs, plain_step(inputs), 1e-4)
        time.sleep(0.02)

folder, count, chance = Path(sys.argv[1]), int(sys.argv[2]), random.Random(int(sys.argv[3]))
due = {}
for number in range(count):
    pid = os.fork()
    if pid == 0:
        write(folder / f"{number}.mcap")
    due[pid] = number, time.monotonic() + chance.uniform(0.0, 3.0)
before, stall = time.monotonic(), 0.0
while due:
    time.sleep(0.005)
    now = time.monotonic()
    stall = max(stall, now - before)
    for pid in [pid for pid, (_, at) in due.items() if at <= now]:
        number, _ = due.pop(pid)
        killed = time.monotonic()
        os.kill(pid, signal.SIGKILL)
        os.waitpid(pid, 0)
        stall = max(stall, time.monotonic() - killed)
        print(number, killed, flush=True)
    before = time.monotonic()
print("stall", stall, flush=True)
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


def test_writers_killed_at_random_moments_leave_all_but_the_last_second(tmp_path: Path) -> None:
    """`stall`: how long this machine let the clock itself wait; it is no part of the promise."""
    run = subprocess.run(
        [sys.executable, "-c", EXECUTIONER, str(tmp_path), "10", "20261122"],
        cwd=Path(__file__).parents[2],
        stdout=subprocess.PIPE,
        text=True,
        check=True,
        timeout=120,
    )
    *killed, (_, stall) = (line.split() for line in run.stdout.splitlines())
    assert len(killed) == 10
    lived = 0
    for number, killed_s in killed:
        try:
            log = FlightLog.open(tmp_path / f"{number}.mcap")
        except NotReplayable:  # in the first moments there is not even a header
            continue
        ticks = list(log)
        assert log.damage is not None
        assert [tick.index for tick in ticks] == list(range(len(ticks)))
        if not ticks:
            continue
        lived += 1
        assert replay(log, plain_step).exact
        stamps = [tick.inputs.now_s for tick in ticks]
        slow_s = max((b - a for a, b in pairwise(stamps)), default=0.0)
        lost_s = float(killed_s) - stamps[-1]
        assert lost_s < 1.0 + 5.0 * max(float(stall), slow_s), f"writer {number}"
    assert lived >= 4


def test_a_full_disk_ends_recording_and_says_so(tmp_path: Path) -> None:
    with child(tmp_path / "a.mcap", limit_bytes=120000) as process:
        said, _ = process.communicate(timeout=60)
    failure, landed = said.splitlines()[-2:]
    assert failure.endswith("recording ended before the flight did (File too large)")
    assert landed.startswith("landed ")
    log = FlightLog.open(tmp_path / "a.mcap")
    assert replay(log, plain_step).exact
