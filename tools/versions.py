"""What made a result: the project, its commit, and the libraries that count."""

import functools
import platform
import subprocess
from pathlib import Path

import msgspec
import numba
import numpy as np

from autonomy import __version__


class Versions(msgspec.Struct, frozen=True):
    """What the same flight needs to come out the same."""

    version: str
    commit: str
    python: str
    numpy: str
    numba: str
    machine: str


@functools.cache
def commit() -> str:
    """The commit that runs, as git tells it, with `-dirty` for what is not committed; `unknown`
    where there is no git. Asked once in a process.
    """
    asked = ["git", "describe", "--always", "--dirty"]
    try:
        told = subprocess.run(
            asked, capture_output=True, text=True, check=True, cwd=Path(__file__).parent
        )
    except (OSError, subprocess.CalledProcessError):
        return "unknown"
    return told.stdout.strip()


@functools.cache
def versions() -> Versions:
    """Of this process."""
    return Versions(
        __version__,
        commit(),
        platform.python_version(),
        np.__version__,
        numba.__version__,
        platform.machine(),
    )
