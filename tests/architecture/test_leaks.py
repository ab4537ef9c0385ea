"""The suite's own watch: what it must notice, shown on planted tests."""

import subprocess
import sys
from pathlib import Path

import pytest

CONFTEST = Path(__file__).parents[1] / "conftest.py"


def run_planted(folder: Path, body: str) -> subprocess.CompletedProcess[str]:
    (folder / "conftest.py").write_text(CONFTEST.read_text())
    (folder / "test_planted.py").write_text(body)
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", "-p", "no:xdist"]
    return subprocess.run(
        [*command, "-o", "asyncio_mode=auto", "--rootdir", str(folder), str(folder)],
        capture_output=True,
        text=True,
        cwd=folder,
        check=False,
    )


TASK_LEFT = """
import asyncio

async def test_planted():
    global kept
    kept = asyncio.get_running_loop().create_task(asyncio.sleep(9), name="planted")
"""

THREAD_LEFT = """
import threading

def test_planted():
    threading.Timer(4.0, print).start()
"""

NOTHING_LEFT = """
import asyncio, threading

async def test_planted():
    async with asyncio.TaskGroup() as group:
        group.create_task(asyncio.to_thread(threading.get_ident))
"""


@pytest.mark.parametrize(
    ("body", "noticed"),
    [
        (TASK_LEFT, "tasks left running: planted"),
        (THREAD_LEFT, "threads left running: Thread-"),
    ],
)
def test_a_test_that_leaves_work_running_fails(tmp_path: Path, body: str, noticed: str) -> None:
    run = run_planted(tmp_path, body)
    assert run.returncode == 1, run.stdout + run.stderr
    assert noticed in run.stdout


def test_a_test_that_cleans_up_passes(tmp_path: Path) -> None:
    run = run_planted(tmp_path, NOTHING_LEFT)
    assert run.returncode == 0, run.stdout + run.stderr
