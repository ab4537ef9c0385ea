"""The lock file: what the image installs, each version with the hashes of its files.

    python -m tools.lock              # renews requirements.lock from pyproject.toml; needs uv
    python -m tools.lock --check      # does it fit pyproject.toml? asks nobody

One file for every platform and Python from the oldest supported one on: markers choose. It holds
the core, the extras of a drone and what builds the project, with all that they need in turn.
"""

import argparse
import importlib.util
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).resolve().parent.parent
LOCK = ROOT / "requirements.lock"
EXTRAS = ("hardware", "log", "service")
"""What a drone is given."""
_HEADER = "# Made by: python -m tools.lock\n"


class Pin(NamedTuple):
    """One version in the lock file; several of one name have markers that exclude each other."""

    name: str
    version: str
    marker: str | None
    hashes: tuple[str, ...]
    asked_by_us: bool


def demanded(project: Mapping[str, Any]) -> list[Requirement]:
    """What pyproject.toml asks for directly: core, the drone's extras, the build."""
    core, extras = project["project"]["dependencies"], project["project"]["optional-dependencies"]
    lines = [*core, *(line for name in EXTRAS for line in extras[name])]
    return [Requirement(line) for line in (*lines, *project["build-system"]["requires"])]


def pins(lock: str) -> Iterator[Pin]:
    """The entries of a lock file as uv writes it. Raises ValueError for a line it never writes."""
    entries = re.split(r"\n(?=[A-Za-z0-9])", re.sub(r"\A(?:#.*\n)+", "", lock).strip())
    for entry in entries:
        first, *rest = entry.splitlines()
        head = re.fullmatch(r"([\w.-]+)==([\w.!+]+)(?: ; (.+?))? \\", first)
        if head is None:
            raise ValueError(f"{first}: is no pinned version with hashes")
        hashes = tuple(re.findall(r"--hash=(sha256:[0-9a-f]{64})\b", entry))
        # uv names who asks, but for what it was told on its standard input: the build's.
        why = [line for line in rest if line.lstrip().startswith("#")]
        asked = not why or any(line.endswith("autonomy (pyproject.toml)") for line in why)
        yield Pin(canonicalize_name(head[1]), head[2], head[3], hashes, asked)


def misfits(project: Mapping[str, Any], lock: str) -> list[str]:
    """Where the lock file does not fit pyproject.toml, a sentence each."""
    wanted = {canonicalize_name(each.name): each for each in demanded(project)}
    found: dict[str, list[Pin]] = {}
    sentences = []
    for pin in pins(lock):
        found.setdefault(pin.name, []).append(pin)
        if not pin.hashes:
            sentences.append(f"{pin.name} {pin.version} has no hash")
        if pin.asked_by_us and pin.name not in wanted:
            sentences.append(f"{pin.name} is locked, but pyproject.toml asks for it no more")
    for name, requirement in wanted.items():
        if name not in found:
            sentences.append(f"{name} is not locked")
        sentences.extend(
            f"{name} is locked at {pin.version}, pyproject.toml asks for {requirement.specifier}"
            for pin in found.get(name, ())
            if pin.version not in requirement.specifier
        )
    return sentences


def resolve(project: Mapping[str, Any], into: Path, *options: str) -> None:
    """Write what uv resolves for `demanded` into a file; versions pinned in it already are kept.

    Raises SystemExit with uv's own words when it finds no answer.
    """
    oldest = project["project"]["requires-python"].removeprefix(">=")
    if importlib.util.find_spec("uv") is None:
        raise SystemExit("uv is not installed; .venv/bin/pip install -e '.[release]'")
    command = [
        sys.executable,
        "-m",
        "uv",
        "pip",
        "compile",
        "--quiet",
        "--universal",
        "--no-header",
    ]
    command += [f"--python-version={oldest}", *(f"--extra={name}" for name in EXTRAS), *options]
    done = subprocess.run(
        [*command, f"--output-file={into}", "pyproject.toml", "-"],
        cwd=ROOT,
        input="\n".join(project["build-system"]["requires"]),
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode != 0:
        raise SystemExit(done.stderr.strip())


def main(arguments: list[str]) -> int:
    """Entry point; returns the exit code."""
    parser = argparse.ArgumentParser(prog="python -m tools.lock")
    parser.add_argument("--check", action="store_true", help="compare only, without a network")
    parser.add_argument("--upgrade", action="store_true", help="newest versions, not the kept ones")
    options = parser.parse_args(arguments)
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    if not options.check:
        upgrade = ["--upgrade"] if options.upgrade else []
        resolve(project, LOCK, "--generate-hashes", *upgrade)
        LOCK.write_text(_HEADER + LOCK.read_text(encoding="utf-8"), encoding="utf-8")
    sentences = misfits(project, LOCK.read_text(encoding="utf-8"))
    for sentence in sentences:
        print(f"requirements.lock: {sentence}; renew it with: python -m tools.lock")
    return 1 if sentences else 0


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
