"""What is wrong with this machine before flying, a sentence a finding."""

import importlib.metadata
import os
import platform
import re
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

from autonomy.config import Config
from autonomy.finding import Finding, note, ok
from autonomy.mission.sensing import THIN_DEG
from autonomy.warm import warm_up

_OLDEST_PYTHON = (3, 11)
_ROOM_BYTES = 200_000_000
"""What an hour of flight log needs, generously."""
_SLOW_WARM_UP_S = 5.0


# ---------------------------------------------------------------- this machine


def check_machine(
    config: Config, log_directory: Path, tell: Callable[[str], None] | None = None
) -> Iterator[Finding]:
    """Python, packages, disk and kernels, each when it is known. The configuration itself is valid:
    it was loaded. `tell` hears now and then what takes long.
    """
    beams = len(config.beams.mounts)
    yield ok(f"the configuration is valid; it has {beams} range beams")
    yield from check_movers(config)
    yield check_python()
    yield from check_packages()
    yield check_disk(log_directory)
    yield check_kernels(tell)


def check_movers(config: Config) -> tuple[Finding, ...]:
    """Wide beams do not tell where in their cone a thing is, so not that it moves either."""
    level = [mount.name for mount in config.beams.mounts if mount.horizontal]
    if not config.movers.watch or any(
        config.beams.half_angle_deg(name) <= THIN_DEG for name in level
    ):
        return ()
    sentence = (
        f"no level beam sees {THIN_DEG:g} deg or less to each side: nothing is seen to move, and "
        "nobody is made way for, in spite of movers.watch; keep people and pets out"
    )
    return (note(sentence, "movers"),)


def check_python() -> Finding:
    """Old Pythons do not run this program; 32-bit ones have no numba."""
    version = platform.python_version()
    if sys.version_info[:2] < _OLDEST_PYTHON or sys.maxsize < 2**32:
        return Finding(good=False, sentence=f"Python {version} is too old, or not 64-bit; use 3.11")
    return Finding(good=True, sentence=f"Python {version} on {platform.machine()}")


def check_packages() -> tuple[Finding, ...]:
    """Every dependency that this distribution asks for is there, and new enough."""
    findings = []
    for requirement in importlib.metadata.requires("autonomy") or ():
        match = re.match(r"([A-Za-z0-9_.-]+)\s*>=\s*([0-9.]+)\s*$", requirement)
        if match is None:  # an extra: not needed for flying
            continue
        name, least = match.groups()
        try:
            version = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            findings.append(f"the package {name} is missing; install it with: pip install {name}")
            continue
        if _numbers(version) < _numbers(least):
            findings.append(
                f"the package {name} is {version}; install {least} or newer with: "
                f"pip install --upgrade {name}"
            )
    if not findings:
        return (Finding(good=True, sentence="all packages are there and new enough"),)
    return tuple(Finding(good=False, sentence=sentence) for sentence in findings)


def _numbers(version: str) -> tuple[int, ...]:
    return tuple(int(part) for part in re.findall(r"\d+", version)[:3])


def check_kernels(tell: Callable[[str], None] | None = None) -> Finding:
    """Compile what flies; the second time it comes from the disk. `tell` as in `warm_up`."""
    before_s = time.monotonic()
    warm_up(tell)
    took_s = time.monotonic() - before_s
    again = "; it was compiled now, the next start is fast" if took_s > _SLOW_WARM_UP_S else ""
    return Finding(good=True, sentence=f"the kernels were ready in {took_s:.1f} s{again}")


def check_disk(directory: Path) -> Finding:
    """A flight log can be written where it is to be, and there is room."""
    existing = directory
    while not existing.exists() and existing != existing.parent:
        existing = existing.parent
    try:
        with tempfile.TemporaryFile(dir=existing) as file:
            file.write(b"autonomy")
            file.flush()
            os.fsync(file.fileno())
    except OSError as error:
        return Finding(
            good=False,
            sentence=f"{directory}: flight logs cannot be written there ({error.strerror}); "
            "set log.directory or --log-dir to a folder that this user may write",
        )
    free = shutil.disk_usage(existing).free
    if free < _ROOM_BYTES:
        return Finding(
            good=False,
            sentence=f"{directory}: only {free / 1e6:.0f} MB are free; make room for flight logs",
        )
    return Finding(good=True, sentence=f"{directory}: {free / 1e9:.1f} GB free for flight logs")
