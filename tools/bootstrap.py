"""Make the virtual environment `.venv` from nothing but Python's standard library.

    python3 tools/bootstrap.py [core|dev]

`core` installs what flying needs, `dev` also what tests and lint need; the project itself goes in
as an editable install. Debian's python3 has no ensurepip unless python3-venv is there: then pip's
own wheel is fetched from the configured package index (PIP_INDEX_URL, pip's configuration files,
else PyPI), its SHA-256 compared with the one on the index page.
"""

import base64
import configparser
import hashlib
import html.parser
import importlib.util
import os
import re
import ssl
import subprocess
import sys
import tempfile
import urllib.error
import urllib.parse
import urllib.request
import venv
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parent.parent
DEFAULT_INDEX = "https://pypi.org/simple"
OLDEST_PYTHON = (3, 11)
TIMEOUT_S = 60.0


class BootstrapError(Exception):
    """One sentence for the person at the terminal."""


class Wheel(NamedTuple):
    """One file that the index page offers."""

    name: str
    url: str
    sha256: str
    version: tuple[int, ...]


def pip_settings(environ: dict[str, str], system: tuple[Path, ...]) -> dict[str, str]:
    """pip's `index-url` and `cert` as pip would find them: files first, environment last.

    `system` are the files read when PIP_CONFIG_FILE does not name one; later files win.
    """
    named = environ.get("PIP_CONFIG_FILE")
    files = (*system, Path(named)) if named and named != os.devnull else system
    if named == os.devnull:
        files = ()
    found: dict[str, str] = {}
    for path in files:
        parser = configparser.RawConfigParser()
        try:
            parser.read(path, encoding="utf-8")
        except configparser.Error:
            raise BootstrapError(f"{path}: is not a pip configuration file; mend it") from None
        for section in ("global", "install"):
            for key in ("index-url", "cert"):
                if parser.has_option(section, key):
                    found[key] = parser.get(section, key).strip()
    for key, variable in (("index-url", "PIP_INDEX_URL"), ("cert", "PIP_CERT")):
        if environ.get(variable):
            found[key] = environ[variable]
    return found


def system_files(environ: dict[str, str]) -> tuple[Path, ...]:
    """Where pip keeps its configuration on Linux, the least important first."""
    home = Path(environ.get("HOME", "/"))
    user = Path(environ.get("XDG_CONFIG_HOME") or home / ".config")
    return (Path("/etc/pip.conf"), home / ".pip" / "pip.conf", user / "pip" / "pip.conf")


class _Links(html.parser.HTMLParser):
    """Collects the attributes of every anchor of a simple index page (PEP 503)."""

    def __init__(self) -> None:
        super().__init__()
        self.anchors: list[dict[str, str]] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag == "a":
            self.anchors.append({key: value or "" for key, value in attrs})


def newest_pip(page: str, page_url: str, python: tuple[int, int]) -> Wheel:
    """The newest final release of pip on a simple index page that runs on `python`.

    Only files with a SHA-256 in their link count. Raises BootstrapError when there is none.
    """
    links = _Links()
    links.feed(page)
    wheels = []
    for anchor in links.anchors:
        url, fragment = urllib.parse.urldefrag(
            urllib.parse.urljoin(page_url, anchor.get("href", ""))
        )
        name = urllib.parse.unquote(urllib.parse.urlsplit(url).path.rsplit("/", 1)[-1])
        release = re.fullmatch(r"pip-(\d+(?:\.\d+)*)-py3-none-any\.whl", name)
        digest = re.fullmatch(r"sha256=([0-9a-f]{64})", fragment)
        least = re.search(r">=\s*(\d+)\.(\d+)", anchor.get("data-requires-python", ""))
        runs = least is None or (int(least[1]), int(least[2])) <= python
        if release and digest and runs and "data-yanked" not in anchor:
            version = tuple(int(part) for part in release[1].split("."))
            wheels.append(Wheel(name, url, digest[1], version))
    if not wheels:
        raise BootstrapError(f"{page_url}: offers no wheel of pip with a SHA-256 for this Python")
    return max(wheels, key=lambda wheel: wheel.version)


def download(url: str, cert: str | None) -> bytes:
    """The body of `url` (http, https or file; user:password@ is sent as basic authentication)."""
    parts = urllib.parse.urlsplit(url)
    if parts.scheme not in ("http", "https", "file"):
        raise BootstrapError(f"{url}: only http, https and file addresses can be fetched")
    headers = {"Accept": "text/html, */*;q=0.1", "User-Agent": "autonomy-bootstrap"}
    if parts.username:
        user = (
            f"{urllib.parse.unquote(parts.username)}:{urllib.parse.unquote(parts.password or '')}"
        )
        headers["Authorization"] = "Basic " + base64.b64encode(user.encode()).decode()
        parts = parts._replace(netloc=parts.netloc.rpartition("@")[2])
    shown = parts.geturl()
    request = urllib.request.Request(shown, headers=headers)  # noqa: S310 - scheme checked above
    context = ssl.create_default_context(cafile=cert) if parts.scheme == "https" else None
    try:
        with urllib.request.urlopen(  # noqa: S310 - scheme checked above
            request, timeout=TIMEOUT_S, context=context
        ) as response:
            body: bytes = response.read()
            return body
    except OSError as error:  # URLError is one
        if isinstance(error, urllib.error.HTTPError):
            error.close()
        raise BootstrapError(f"{shown}: cannot be fetched ({error})") from None


def fetch_pip(folder: Path, settings: dict[str, str]) -> Path:
    """Download pip's wheel into `folder`; raises BootstrapError when it is not what it says."""
    index = settings.get("index-url", DEFAULT_INDEX).rstrip("/")
    cert = settings.get("cert")
    page_url = f"{index}/pip/"
    page = download(page_url, cert).decode("utf-8", "replace")
    wheel = newest_pip(page, page_url, sys.version_info[:2])
    body = download(wheel.url, cert)
    if hashlib.sha256(body).hexdigest() != wheel.sha256:
        raise BootstrapError(f"{wheel.name}: the SHA-256 differs from the index page's; not used")
    path = folder / wheel.name
    path.write_bytes(body)
    return path


def run(*command: str | Path) -> None:
    """Run one command in the project; raises BootstrapError when it fails."""
    words = [str(word) for word in command]
    environ = {**os.environ, "PIP_ROOT_USER_ACTION": "ignore", "PIP_DISABLE_PIP_VERSION_CHECK": "1"}
    if subprocess.run(words, cwd=ROOT, env=environ, check=False).returncode != 0:
        raise BootstrapError(f"failed: {' '.join(words)}")


def has_pip(python: Path) -> bool:
    """True when the environment's interpreter exists and can run pip."""
    if not python.exists():
        return False
    probe = subprocess.run(
        [str(python), "-m", "pip", "--version"], capture_output=True, check=False
    )
    return probe.returncode == 0


def make_environment(folder: Path) -> Path:
    """A virtual environment with pip in `folder`; an unusable one is replaced."""
    python = folder / "bin" / "python"
    if has_pip(python):
        return python
    if importlib.util.find_spec("ensurepip") is not None:
        try:
            venv.create(folder, with_pip=True, clear=True, symlinks=True)
        except (subprocess.CalledProcessError, OSError):
            print("bootstrap: ensurepip does not work here; fetching pip from the package index")
    if not has_pip(python):
        venv.create(folder, with_pip=False, clear=True, symlinks=True)
        environ = dict(os.environ)
        with tempfile.TemporaryDirectory() as temporary:
            wheel = fetch_pip(Path(temporary), pip_settings(environ, system_files(environ)))
            # A wheel is a zip archive, and Python runs a package inside one: pip installs itself.
            run(python, wheel / "pip", "install", "--quiet", "--no-index", wheel)
    return python


def main(arguments: list[str]) -> int:
    """Entry point; returns the exit code."""
    what = arguments[0] if arguments else "core"
    if what not in ("core", "dev") or len(arguments) > 1:
        print("usage: bootstrap.py [core|dev]", file=sys.stderr)
        return 2
    if sys.version_info[:2] < OLDEST_PYTHON:
        print(
            f"bootstrap: Python {'.'.join(map(str, OLDEST_PYTHON))} or newer is needed, this is "
            f"{sys.version.split()[0]}; say which to use with: make PYTHON=/path/to/python3",
            file=sys.stderr,
        )
        return 1
    try:
        python = make_environment(ROOT / ".venv")
        target = ".[dev]" if what == "dev" else "."
        print(f"bootstrap: installing {target} into .venv", flush=True)
        run(python, "-m", "pip", "install", "--quiet", "--prefer-binary", "--editable", target)
    except BootstrapError as error:
        print(f"bootstrap: {error}", file=sys.stderr)
        return 1
    return 0


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
