"""The import contracts hold, and every kind of violation is really caught."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
RUNNER = (
    "import sys; from importlinter.cli import lint_imports_command as c; "
    "sys.path.insert(0, ''); c(['--no-cache'])"
)


def lint(folder: Path) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-c", RUNNER], cwd=folder, capture_output=True, text=True, check=False
    )


@pytest.fixture(scope="module")
def planted_tree(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the sources that a test may spoil."""
    folder = tmp_path_factory.mktemp("tree")
    for package in ("autonomy", "hal", "tools"):
        shutil.copytree(
            ROOT / package, folder / package, ignore=shutil.ignore_patterns("__pycache__", "*.nb?")
        )
    shutil.copy(ROOT / "pyproject.toml", folder)
    return folder


def test_the_contracts_hold() -> None:
    run = lint(ROOT)
    assert run.returncode == 0, run.stdout


@pytest.mark.parametrize(
    ("module", "line", "contract"),
    [
        ("hal/sim/planted.py", "import autonomy.geometry", "tools -> autonomy -> hal"),
        ("autonomy/perception/planted.py", "import autonomy.t3drm", "autonomy: from the shell"),
        ("autonomy/t3drm/planted.py", "import autonomy.mission", "autonomy: from the shell"),
        ("autonomy/planted.py", "", "autonomy: from the shell"),
        ("hal/planted.py", "", "hal: from the registry"),
        ("hal/gnss/planted.py", "import hal.vehicle", "hal: from the registry"),
        ("autonomy/service/planted.py", "from mavsdk.asyncio import Mavsdk", "mavsdk has one door"),
        ("hal/vehicle/planted.py", "from pymavlink import mavutil", "pymavlink has one door"),
        ("autonomy/mission/planted.py", "import filterpy.kalman", "filterpy has one door"),
        ("hal/ranging/planted.py", "from smbus2 import SMBus", "smbus2 has one door"),
        ("hal/ranging/planted.py", "import gpiod", "gpiod has one door"),
        ("hal/gnss/planted.py", "import pynmeagps", "pynmeagps has one door"),
        ("hal/gnss/planted.py", "import pyubx2", "pyubx2 has one door"),
        ("hal/gnss/planted.py", "import serial", "pyserial has one door"),
        ("autonomy/t3drm/planted.py", "import asyncio", "the core knows no clock"),
        ("autonomy/guidance/planted.py", "from time import monotonic", "the core knows no clock"),
        ("autonomy/mission/planted.py", "import random", "the core knows no clock"),
        ("autonomy/estimation/planted.py", "import logging", "the core knows no clock"),
    ],
)
def test_a_planted_violation_is_caught(
    planted_tree: Path, module: str, line: str, contract: str
) -> None:
    planted = planted_tree / module
    planted.write_text(f'"""Planted."""\n\n{line}\n')
    try:
        run = lint(planted_tree)
    finally:
        planted.unlink()
    assert run.returncode == 1, run.stdout + run.stderr
    broken = [row for row in run.stdout.splitlines() if " BROKEN" in row]
    assert [row for row in broken if row.startswith(contract)], run.stdout
