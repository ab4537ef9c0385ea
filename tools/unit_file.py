"""How the systemd unit runs the service, for tools that run it without systemd."""

import contextlib
import os
import re
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import IO

import psutil

UNIT = Path(__file__).parents[1] / "configs" / "autonomy.service"


def environment() -> dict[str, str]:
    """This process's environment, and what the unit adds for the interpreter."""
    added: dict[str, str] = {}
    for pairs in re.findall(r"^Environment=(.*)$", UNIT.read_text(encoding="utf-8"), re.MULTILINE):
        added |= dict(pair.split("=", 1) for pair in pairs.split())
    return os.environ | {key: text for key, text in added.items() if key.startswith("PYTHON")}


def niceness() -> int:
    """Its `Nice=`; 0 without."""
    found = re.search(r"^Nice=(-?\d+)$", UNIT.read_text(encoding="utf-8"), re.MULTILINE)
    return int(found[1]) if found is not None else 0


def started(command: Sequence[str], stderr: int | IO[bytes] | IO[str]) -> "subprocess.Popen[bytes]":
    """The command as the unit would run it; as urgent only where this user may ask for that."""
    process = subprocess.Popen(command, stderr=stderr, env=environment())
    with contextlib.suppress(psutil.AccessDenied):
        psutil.Process(process.pid).nice(niceness())
    return process
