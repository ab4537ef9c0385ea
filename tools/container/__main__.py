"""Build the image with a real builder and try it, where no image registry can be reached.

    python -m tools.container [--write]

As root on Debian with debootstrap, buildah, podman and runc; Debian's and pip's packages must be in
reach. The base is a Debian root made here, put into a store of its own under the name that the
Dockerfile pins (without the digest, which only the real one has), and everything after that is the
Dockerfile's. Ten minutes, most of them compiling; `--write` renews tools/container/README.md.
"""

import argparse
import datetime
import os
import platform
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

from tools import pages

ROOT = Path(__file__).resolve().parents[2]
README = Path(__file__).with_name("README.md")
SECTION = "proof"
NEEDED = ("debootstrap", "buildah", "podman", "runc")
IMAGE = "localhost/autonomy"
CERTIFICATES = "/etc/ssl/certs"
SERVED_S = 180.0
TESTS = (
    "tests/paper",
    "tests/contract",
    "tests/unit/hal/ranging",
    "tests/unit/autonomy/t3drm",
    "tests/scenario/test_nothing_is_compiled_in_the_air.py",
)
"""What needs nothing but the program and pytest."""
_DEBIAN = "bookworm"


class ProofError(Exception):
    """Something else than what is promised: one sentence."""


class Builder:
    """buildah and podman over a store of their own, which is gone with its folder."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        store = ("--root", str(folder / "store"), "--runroot", str(folder / "run"))
        self._buildah = ("buildah", *store, "--storage-driver", "overlay")
        self._podman = ("podman", *store, "--storage-driver", "overlay", "--runtime", "runc")

    def base(self, name: str) -> str:
        """A Debian root with Python as an image of this name; says what is in it."""
        root = self.folder / "root"
        packages = "--include=python3,python3-venv,ca-certificates"
        run("debootstrap", "--variant=minbase", packages, _DEBIAN, str(root))
        (root / "usr/local/bin/python").symlink_to("/usr/bin/python3")
        archive = self.folder / "root.tar"
        run("tar", "-C", str(root), "-cf", str(archive), ".")
        run(*self._podman, "import", "--quiet", str(archive), name)
        archive.unlink()
        shutil.rmtree(root)
        return f"Debian {_DEBIAN}, {self.inside(name, 'python3', '--version')}, as `{name}`"

    def build(self, base: str) -> str:
        """The image from the project's Dockerfile; says how big it is over its base."""
        # The machine's certificates: a package index may be reached through a proxy of its own.
        certificates = f"--volume={CERTIFICATES}:{CERTIFICATES}:ro"
        how = ("--isolation=chroot", "--network=host", "--pull-never", "--format=docker")
        what = (f"--build-arg=BASE={base}", f"--tag={IMAGE}", str(ROOT))
        run(*self._buildah, "build", *how, certificates, *what)
        whole, below = self._size_mb(IMAGE), self._size_mb(base)
        return f"built; {whole - below:.0f} MB over a base of {below:.0f} MB"

    def inside(self, image: str, *command: str, options: tuple[str, ...] = ()) -> str:
        """What a command prints in a new container without a network; ProofError when it fails."""
        options = ("--rm", "--no-healthcheck", f"--entrypoint={command[0]}", *options)
        return run(*self._run(options), image, *command[1:])

    def start(self, name: str, *command: str) -> None:
        """The image in the background, with its own entry point."""
        run(*self._run(("--detach", f"--name={name}")), IMAGE, *command)

    def podman(self, *command: str) -> str:
        """One command of podman's."""
        return run(*self._podman, *command)

    def _run(self, options: tuple[str, ...]) -> tuple[str, ...]:
        limits = ("--ulimit=nofile=1024:1024", "--ulimit=nproc=1024:1024")
        return (*self._podman, "run", "--network=none", *limits, *options)

    def _size_mb(self, image: str) -> float:
        return int(self.podman("image", "inspect", "--format={{.Size}}", image)) / 1e6


def identity(builder: Builder) -> str:
    """Nobody in the container is root or may change the program."""
    tell = "import os; print(os.getuid(), os.access('/opt/autonomy/bin', os.W_OK))"
    said = builder.inside(IMAGE, "python", "-c", tell)
    expect(said == "1000 False", f"user and right to write the program: {said}")
    missing = builder.inside(IMAGE, "sh", "-c", "command -v gcc make pip || true")
    return f"user 1000, may not write the program; compilers and pip: {missing or 'none'}"


def flight(builder: Builder) -> str:
    """The demonstration flight as anybody's user, and its log flown again."""
    flights = builder.folder / "flights"
    flights.mkdir(mode=0o777)
    flights.chmod(0o777)
    shared = (f"--volume={flights}:/flights", "--user=4242:4242")
    began_s = time.monotonic()
    said = builder.inside(IMAGE, "autonomy", "fly", "--goal", "4,3", "--sim", options=shared)
    took_s = time.monotonic() - began_s
    (log,) = flights.glob("*.mcap")
    builder.inside(IMAGE, "autonomy", "replay", f"flights/{log.name}", options=shared)
    told = dict(re.findall(r"^(flight time|clearance) +(\S+ \S+)", said, re.MULTILINE))
    return (
        f"exit code 0 after {took_s:.0f} s (flight time {told['flight time']}, clearance "
        f"{told['clearance']}); `replay` finds every decision again"
    )


def health(builder: Builder) -> str:
    """The default command without a vehicle, then with a simulated one: healthy, and ended."""
    told = []
    for command in ((), ("serve", "--sim")):
        builder.start("served", *command)
        began_s = time.monotonic()
        until(lambda: is_healthy(builder), SERVED_S, "never healthy")
        took_s = time.monotonic() - began_s
        phase = builder.podman("exec", "served", "autonomy", "status").splitlines()[0]
        builder.podman("stop", "--time=150", "served")
        code = builder.podman("inspect", "--format={{.State.ExitCode}}", "served")
        builder.podman("rm", "served")
        expect(code == "0", f"{command} ended with exit code {code}")
        words = " ".join(command) or "no command"
        told.append(f'{words}: healthy after {took_s:.0f} s, "{phase}", stopped with 0')
    return "; ".join(told)


def is_healthy(builder: Builder) -> bool:
    """What the image's own health check says."""
    try:
        builder.podman("healthcheck", "run", "served")
    except ProofError:
        return False
    return True


def tests(builder: Builder) -> str:
    """A selection of the tests against the installed program: its sources are not there."""
    site, tree = builder.folder / "site", builder.folder / "tree"
    tools = ("pytest", "pytest-asyncio", "hypothesis")
    run(sys.executable, "-m", "pip", "install", "--quiet", f"--target={site}", *tools)
    for name in ("tests", "tools", "configs"):
        shutil.copytree(ROOT / name, tree / name, ignore=shutil.ignore_patterns("__pycache__"))
    for document in (ROOT / "pyproject.toml", *(ROOT / "hal").rglob("README.md")):
        place = tree / document.relative_to(ROOT)
        place.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(document, place)
    said = builder.inside(
        IMAGE,
        *("python", "-m", "pytest", "-q", "-p", "no:cacheprovider", *TESTS),
        options=(
            *(f"--volume={site}:/site:ro", f"--volume={tree}:/tree:ro", "--workdir=/tree"),
            *("--env=PYTHONPATH=/site:/tree", "--env=PYTHONDONTWRITEBYTECODE=1"),
            "--env=HYPOTHESIS_STORAGE_DIRECTORY=/tmp/hypothesis",
        ),
    )
    return f"`{' '.join(TESTS)}`: {said.splitlines()[-1]}"


CASES: dict[str, Callable[[Builder], str]] = {
    "Whose it is": identity,
    "`autonomy fly --goal 4,3 --sim`": flight,
    "Default command, health check, `docker stop`": health,
    "Tests in it": tests,
}


def main(arguments: list[str] | None = None) -> int:
    """Build and try; the exit code is 1 when anything was not as promised."""
    parser = argparse.ArgumentParser(prog="python -m tools.container")
    parser.add_argument("--write", action="store_true", help="renew tools/container/README.md")
    options = parser.parse_args(arguments)
    if options.write:
        pages.must_have(SECTION, README)
    try:
        rows = prove()
    except ProofError as error:
        print(f"container: {error}", file=sys.stderr)
        return 1
    text = page(rows)
    print(text)
    if options.write:
        pages.renew(SECTION, text, README)
    return 0


def prove() -> list[tuple[str, str]]:
    """What was done, and what came of it. Raises ProofError at the first broken promise."""
    missing = [name for name in NEEDED if shutil.which(name) is None]
    if missing:
        raise ProofError(f"{', '.join(missing)} not found; apt-get install {' '.join(missing)}")
    if os.geteuid() != 0:
        raise ProofError("run it as root: it makes a Debian root and namespaces")
    name = "docker.io/library/" + base_name((ROOT / "Dockerfile").read_text(encoding="utf-8"))
    rows: list[tuple[str, str]] = []
    with tempfile.TemporaryDirectory(prefix="autonomy-container-") as folder:
        builder = Builder(Path(folder))
        making: dict[str, Callable[[Builder], str]] = {
            "Base": lambda each: each.base(name),
            "`docker build`": lambda each: each.build(name),
        }
        for what, step in (making | CASES).items():
            print(f"container: {what}", file=sys.stderr, flush=True)
            rows.append((what, step(builder)))
        builder.podman("rmi", "--all", "--force")
    return rows


def base_name(dockerfile: str) -> str:
    """The base that the Dockerfile pins, without its digest; ProofError when it pins none."""
    pinned = re.search(r"^ARG BASE=(\S+)@sha256:[0-9a-f]{64}$", dockerfile, re.MULTILINE)
    if pinned is None:
        raise ProofError("Dockerfile: no line ARG BASE=NAME:TAG@sha256:DIGEST; pin the base")
    return pinned[1]


def page(rows: list[tuple[str, str]]) -> str:
    """The table for the README."""
    versions = [run(name, "--version").splitlines()[0] for name in ("buildah", "podman", "runc")]
    day = datetime.datetime.now(tz=datetime.UTC).date()
    head = f"Proved {day} on {platform.machine()} with {', '.join(versions)}."
    lines = [f"| {what} | {came} |" for what, came in rows]
    return "\n".join([head, "", "| what | what came of it |", "|---|---|", *lines])


def until(holds: Callable[[], bool], timeout_s: float, otherwise: str) -> None:
    """Wait for something; raises ProofError when it does not come in time."""
    ends_s = time.monotonic() + timeout_s
    while not holds():
        if time.monotonic() > ends_s:
            raise ProofError(otherwise)
        time.sleep(1.0)


def expect(holds: bool, otherwise: str) -> None:  # noqa: FBT001 - as assert
    """Raises ProofError when it does not hold."""
    if not holds:
        raise ProofError(otherwise)


def run(*command: str) -> str:
    """What a command printed; raises ProofError with its last words when it fails."""
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        words = (done.stderr.strip() or done.stdout.strip())[-2000:]
        raise ProofError(f"{' '.join(command)}: exit code {done.returncode}: {words}")
    return done.stdout.strip()


if __name__ == "__main__":
    sys.exit(main())
