"""Find the browser for the page's tests, and install Debian's where there is none.

    python3 -m tools.chromium

CHROMIUM names another program. Installing needs root and apt-get; without them a sentence says
what to do.
"""

import os
import shutil
import subprocess
import sys

NAMES = ("chromium", "chromium-browser", "google-chrome")
_ADVICE = "install it (apt-get install chromium), or name a browser: CHROMIUM=/path/to/chromium"


class NoBrowser(Exception):
    """One sentence for the person at the terminal."""


def found() -> str | None:
    """The browser's program; None where there is none."""
    named = os.environ.get("CHROMIUM")
    if named is not None:
        return shutil.which(named)
    return next((path for path in map(shutil.which, NAMES) if path is not None), None)


def installed() -> str:
    """The browser's program, installed if need be; raises NoBrowser."""
    program = found()
    if program is not None:
        return program
    apt = shutil.which("apt-get")
    if "CHROMIUM" in os.environ or apt is None or os.geteuid() != 0:
        raise NoBrowser(f"the page's tests need Chromium; {_ADVICE}")
    environ = {**os.environ, "DEBIAN_FRONTEND": "noninteractive"}
    for words in (("update", "-qq"), ("install", "-y", "-qq", "--no-install-recommends", NAMES[0])):
        print(f"chromium: apt-get {' '.join(words)}", flush=True)
        if subprocess.run((apt, *words), env=environ, check=False).returncode != 0:
            raise NoBrowser(f"apt-get {words[0]} failed; {_ADVICE}")
    program = found()
    if program is None:
        raise NoBrowser(f"apt-get installed no Chromium; {_ADVICE}")
    return program


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
