"""Does a 64-bit ARM computer find a built package for everything that is locked?

    python -m tools.wheels [--write]      # needs uv and the package index; downloads names alone

The exit code is 1 when something would have to be compiled on the drone. `--write` renews
tools/deploy/README.md.
"""

import argparse
import re
import sys
import tempfile
import tomllib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple
from urllib.parse import unquote, urlsplit

from packaging.markers import Marker
from packaging.tags import Tag, compatible_tags, cpython_tags
from packaging.utils import parse_wheel_filename

from tools import lock, pages

README = Path(__file__).parent / "deploy" / "README.md"
SECTION = "wheels"
PYTHONS = ((3, 11), (3, 12), (3, 13))
GLIBC_MINOR = 36
"""Debian 12's, and so Raspberry Pi OS 12's: 2.36."""


class Offer(NamedTuple):
    """What one Python is offered of one package; `glibc` as (2, 28), None for any."""

    version: str
    pure: bool
    glibc: tuple[int, int] | None


def tags(python: tuple[int, int]) -> frozenset[Tag]:
    """What this CPython runs on aarch64 with glibc 2.36."""
    minors = range(GLIBC_MINOR, 16, -1)
    platforms = [f"manylinux_2_{minor}_aarch64" for minor in minors]
    platforms += ["manylinux2014_aarch64", "linux_aarch64"]
    name = f"cp{python[0]}{python[1]}"
    return frozenset(
        [*cpython_tags(python, platforms=platforms), *compatible_tags(python, name, platforms)]
    )


def offered(package: Mapping[str, Any], python: tuple[int, int]) -> Offer | None:
    """The wheel that asks least of the C library; None when there is none."""
    mine = tags(python)
    offers = []
    for wheel in package.get("wheels", ()):
        _, version, _, its = parse_wheel_filename(file_name(wheel))
        fitting = its & mine
        if fitting:
            pure = any(tag.platform == "any" for tag in fitting)
            offers.append(Offer(str(version), pure, None if pure else least_glibc(fitting)))
    return min(offers, key=lambda offer: offer.glibc or (0, 0), default=None)


def file_name(wheel: Mapping[str, Any]) -> str:
    """The last part of a wheel's address, unless it has a name."""
    return str(wheel.get("name") or unquote(urlsplit(wheel["url"]).path).rpartition("/")[2])


def least_glibc(fitting: Iterable[Tag]) -> tuple[int, int] | None:
    """The oldest glibc that one of the tags promises to run on."""
    found = []
    for tag in fitting:
        named = re.match(r"manylinux_(\d+)_(\d+)_", tag.platform)
        if named is not None:
            found.append((int(named[1]), int(named[2])))
        elif tag.platform.startswith("manylinux2014"):
            found.append((2, 17))
    return min(found, default=None)


def table(packages: Iterable[Mapping[str, Any]]) -> tuple[str, list[str]]:
    """The page's table, and what has no wheel: a sentence each.

    `packages` as in a pylock.toml: one entry for each version, with its marker and wheels.
    """
    pure, missing = [], []
    compiled: dict[str, list[str]] = {}
    for name, versions in sorted(grouped(packages).items()):
        cells = []
        for python in PYTHONS:
            facts = {"python_full_version": f"{python[0]}.{python[1]}.0", "sys_platform": "linux"}
            package = next(
                (p for p in versions if "marker" not in p or Marker(p["marker"]).evaluate(facts)),
                None,
            )
            offer = offered(package, python) if package is not None else None
            if package is not None and offer is None:
                missing.append(f"{name} {package['version']} for Python {python[0]}.{python[1]}")
            cells.append(cell(package, offer))
        if all(each.endswith("any") for each in cells):
            pure.append(name)
        else:
            compiled[name] = cells
    head = " | ".join(f"Python {major}.{minor}" for major, minor in PYTHONS)
    lines = [f"| package | {head} |", "|---" * (len(PYTHONS) + 1) + "|"]
    lines += [f"| {name} | {' | '.join(cells)} |" for name, cells in compiled.items()]
    lines += ["", f"For any processor ({len(pure)}): {', '.join(pure)}."]
    return "\n".join(lines), missing


def grouped(packages: Iterable[Mapping[str, Any]]) -> dict[str, list[Mapping[str, Any]]]:
    """The versions of each package, by its name."""
    found: dict[str, list[Mapping[str, Any]]] = {}
    for package in packages:
        found.setdefault(package["name"], []).append(package)
    return found


def cell(package: Mapping[str, Any] | None, offer: Offer | None) -> str:
    """What a Python gets, in a word or two."""
    if package is None:
        return "not needed"
    if offer is None:
        return f"{package['version']}, **none**"
    if offer.pure:
        return f"{offer.version}, any"
    return f"{offer.version}, glibc {'.'.join(map(str, offer.glibc or (0, 0)))}"


def main(arguments: list[str] | None = None) -> int:
    """Entry point; returns the exit code."""
    parser = argparse.ArgumentParser(prog="python -m tools.wheels")
    parser.add_argument("--write", action="store_true", help="renew tools/deploy/README.md")
    options = parser.parse_args(arguments)
    if options.write:
        pages.must_have(SECTION, README)
    project = tomllib.loads((lock.ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    with tempfile.TemporaryDirectory() as folder:
        into = Path(folder) / "pylock.toml"
        lock.resolve(project, into, "--format=pylock.toml", f"--constraint={lock.LOCK}")
        packages = tomllib.loads(into.read_text(encoding="utf-8"))["packages"]
    text, missing = table(packages)
    print(text)
    if options.write:
        pages.renew(SECTION, text, README)
    for sentence in missing:
        print(f"wheels: {sentence} has no wheel; it is compiled on the drone, or held back")
    return 1 if missing else 0


if __name__ == "__main__":
    sys.exit(main())
