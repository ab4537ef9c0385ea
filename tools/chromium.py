"""Find the browser for the page's tests, and install Debian's where there is none.

    python3 -m tools.chromium

CHROMIUM names another program. What drives it, Playwright's node, wants a library that Chromium
itself does not bring. Installing needs root and apt-get; without them a sentence says what to do.
"""

import ctypes.util
import os
import shutil
import subprocess
import sys

NAMES = ("chromium", "chromium-browser", "google-chrome")
LIBRARY, LIBRARY_PACKAGE = "atomic", "libatomic1"
_ADVICE = (
    f"install it (apt-get install {NAMES[0]} {LIBRARY_PACKAGE}), "
    "or name a browser: CHROMIUM=/path/to/chromium"
)


class NoBrowser(Exception):
    """One sentence for the person at the terminal."""


def found() -> str | None:
    """The browser's program; None where there is none."""
    named = os.environ.get("CHROMIUM")
    if named is not None:
        return shutil.which(named)
    return next((path for path in map(shutil.which, NAMES) if path is not None), None)


def missing() -> list[str]:
    """Debian's packages that the tests need and this computer has not."""
    packages = [] if found() is not None else [NAMES[0]]
    return packages if ctypes.util.find_library(LIBRARY) else [*packages, LIBRARY_PACKAGE]


def installed() -> str:
    """The browser's program, installed with what drives it if need be; raises NoBrowser."""
    packages = missing()
    if packages:
        _install(packages)
    program = found()
    if program is None:
        raise NoBrowser(f"apt-get installed no Chromium; {_ADVICE}")
    return program


def _install(packages: list[str]) -> None:
    apt = shutil.which("apt-get")
    named = "CHROMIUM" in os.environ and NAMES[0] in packages
    if named or apt is None or os.geteuid() != 0:
        raise NoBrowser(f"the page's tests need {' and '.join(packages)}; {_ADVICE}")
    environ = {**os.environ, "DEBIAN_FRONTEND": "noninteractive"}
    for words in (
        ("update", "-qq"),
        ("install", "-y", "-qq", "--no-install-recommends", *packages),
    ):
        print(f"chromium: apt-get {' '.join(words)}", flush=True)
        if subprocess.run((apt, *words), env=environ, check=False).returncode != 0:
            raise NoBrowser(f"apt-get {words[0]} failed; {_ADVICE}")


def main() -> int:
    """Entry point; returns the exit code."""
    try:
        print(f"chromium: {installed()}")
    except NoBrowser as error:
        print(f"chromium: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
