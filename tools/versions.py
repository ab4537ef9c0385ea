"""What made a result: the project, its commit, and the libraries that count."""

import functools
import hashlib
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
    """The commit that runs, as git tells it; `-dirty-` and a digest for what is not committed
    (files that git knows); `unknown` where there is no git. Asked once in a process.
    """
    try:
        name = _git("rev-parse", "--short=10", "HEAD").decode().strip()
        changed = _git("diff", "HEAD", "--binary")
    except (OSError, subprocess.CalledProcessError):
        return "unknown"
    return f"{name}-dirty-{hashlib.sha256(changed).hexdigest()[:8]}" if changed else name


def _git(*words: str) -> bytes:
    folder = Path(__file__).parent
    return subprocess.run(("git", *words), capture_output=True, check=True, cwd=folder).stdout


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
