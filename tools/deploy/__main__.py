"""Install the service on a drone, and remove it again. Debian or a child of it; run as root.

    python3 -m tools.deploy install [--source PATH_OR_WHEEL]
    python3 -m tools.deploy remove [--purge]

Installs an environment of its own (/opt/autonomy), a user, udev rules, the unit, configuration and
a token (/etc/autonomy); configuration and token that are there already are kept. `remove` leaves
configuration, flight logs and the user who owns them; `--purge` takes them too. Works in a chroot
as well, as images are made. Needs nothing but Python's standard library.
"""

import argparse
import grp
import os
import pwd
import secrets
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from tools.bootstrap import BootstrapError, make_environment

PROJECT = Path(__file__).resolve().parents[2]
PREFIX = Path("/opt/autonomy")
SETTINGS = Path("/etc/autonomy")
UNIT = Path("/etc/systemd/system/autonomy.service")
RULES = Path("/etc/udev/rules.d/60-autonomy.rules")
DROP_INS = Path("/etc/systemd/system/autonomy.service.d")
COMMAND = Path("/usr/local/bin/autonomy")
STATE = Path("/var/lib/autonomy")
CACHE = Path("/var/cache/autonomy")
RUNTIME = Path("/run/autonomy")
USER = "autonomy"
NOT_SOURCE = shutil.ignore_patterns(".*", "build", "__pycache__", "*.egg-info")
GROUPS = ("dialout", "i2c", "gpio")
CONFIGURATION = """\
# What differs from the defaults; `autonomy config show` prints every key.
vehicle:
  connection: udpin://0.0.0.0:14540  # or serial:///dev/ttyACM0:921600
service:
  host: 127.0.0.1  # 0.0.0.0 to reach it from elsewhere: then /etc/autonomy/token is asked for
log:
  directory: /var/lib/autonomy/flights
"""


def main(arguments: list[str]) -> int:
    """Entry point; returns the exit code."""
    parser = argparse.ArgumentParser(prog="python3 -m tools.deploy")
    actions = parser.add_subparsers(dest="action", required=True)
    installing = actions.add_parser("install")
    installing.add_argument("--source", default=str(PROJECT), help="the project or its wheel")
    removing = actions.add_parser("remove")
    removing.add_argument("--purge", action="store_true", help="also configuration and logs")
    options = parser.parse_args(arguments)
    if os.geteuid() != 0:
        print("deploy: run it as root", file=sys.stderr)
        return 1
    os.umask(0o022)  # the service's user must be able to read what root installs
    try:
        if options.action == "install":
            install(options.source)
        else:
            remove(purge=options.purge)
    except (DeployError, BootstrapError, OSError) as error:
        print(f"deploy: {error}", file=sys.stderr)
        return 1
    return 0


class DeployError(Exception):
    """One sentence for the person at the terminal."""


def install(source: str) -> None:
    """Everything in its place; may be run again to bring it up to date."""
    if is_active():
        raise DeployError("the service runs; first: systemctl stop autonomy (lands what it flies)")
    if COMMAND.exists() and not is_ours(COMMAND):
        raise DeployError(f"{COMMAND} is another program; move it away first")
    make_user()
    install_package(source)
    link(COMMAND, PREFIX / "bin" / "autonomy")
    SETTINGS.mkdir(mode=0o755, exist_ok=True)
    settings = SETTINGS / "config.yaml"
    if not settings.exists():
        settings.write_text(CONFIGURATION, encoding="utf-8")
    make_token(SETTINGS / "token")
    shutil.copyfile(PROJECT / "configs" / "autonomy.service", UNIT)
    RULES.parent.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(PROJECT / "tools" / "deploy" / RULES.name, RULES)
    make_known()
    run(str(PREFIX / "bin" / "autonomy"), "config", "check", str(settings))
    say(f"what differs on this drone goes into {settings}")
    if systemd_runs():
        say("then: systemctl enable --now --no-block autonomy")
    else:
        say("then: systemctl enable autonomy, and it starts with the computer")
    say("the page will be at http://127.0.0.1:8042")


def install_package(source: str) -> None:
    """The program from a folder or a wheel into its environment.

    A folder is built from a copy: a build leaves files behind, and takes in what an older one left.
    """
    say(f"installing {source} into {PREFIX}: some 750 MB, a minute or more")
    python = make_environment(PREFIX)
    pip = (str(python), "-m", "pip", "install", "--quiet", "--no-cache-dir", "--prefer-binary")
    extras = "[service,hardware,log]"
    if not Path(source).is_dir():
        run(*pip, "--upgrade", f"{source}{extras}")
        run(*pip, "--force-reinstall", "--no-deps", source)  # pip keeps one of the same version
        return
    with tempfile.TemporaryDirectory() as temporary:
        copy = Path(temporary) / "autonomy"
        shutil.copytree(source, copy, ignore=NOT_SOURCE)
        run(*pip, "--upgrade", f"{copy}{extras}")


def remove(*, purge: bool) -> None:
    """Everything out of its place; configuration, token, flight logs and user only with `purge`."""
    if systemd_runs():
        if is_active():
            say("stopping the service; what it flies lands first")
        run("systemctl", "disable", "--now", "--quiet", "autonomy", may_fail=True)
    elif shutil.which("systemctl") is not None:
        run("systemctl", "disable", "--quiet", "autonomy", may_fail=True)
    for path in (UNIT, RULES):
        path.unlink(missing_ok=True)
    if is_ours(COMMAND):
        COMMAND.unlink()
    folders = (PREFIX, CACHE, *((SETTINGS, STATE, DROP_INS, RUNTIME) if purge else ()))
    refused = [sentence for folder in folders for sentence in take_away(folder)]
    if purge and has_user():
        run("userdel", USER)
    make_known()
    if refused:
        raise DeployError(f"not removed: {'; '.join(refused)}; mend that, then run it again")
    if purge:
        say(f"removed; the groups {', '.join(GROUPS)} stay, others may be in them")
        return
    kept = (SETTINGS, STATE, DROP_INS)
    there = ", ".join(str(path) for path in kept if path.exists())
    say(f"kept: {there} and the user {USER}")


def take_away(folder: Path) -> list[str]:
    """Remove what can be removed; the folder with the first reason when something stays."""
    shutil.rmtree(folder, ignore_errors=True)
    try:
        shutil.rmtree(folder)
    except FileNotFoundError:
        return []
    except OSError as error:
        return [f"{folder} ({error.strerror or error})"]
    return []


def make_known() -> None:
    """Tell systemd and udev, where they run, that their files changed: devices that are plugged in
    already get their groups now.
    """
    if not systemd_runs():
        return
    run("systemctl", "daemon-reload")
    if Path("/run/udev/control").exists():
        run("udevadm", "control", "--reload", may_fail=True)
        subsystems = [f"--subsystem-match={name}" for name in ("tty", "i2c-dev", "gpio")]
        run("udevadm", "trigger", "--action=change", *subsystems, may_fail=True)


def make_user() -> None:
    """The service's own user, in the groups that own serial ports, I2C buses and GPIO lines."""
    for group in GROUPS:
        try:
            grp.getgrnam(group)
        except KeyError:
            run("groupadd", "--system", group)
    if not has_user():
        say(f"adding the user {USER}")
        shell = ("--shell", "/usr/sbin/nologin", "--home-dir", "/var/lib/autonomy")
        run("useradd", "--system", "--user-group", "--groups", ",".join(GROUPS), *shell, USER)


def has_user() -> bool:
    """True when the service's user exists."""
    try:
        pwd.getpwnam(USER)
    except KeyError:
        return False
    return True


def make_token(path: Path) -> None:
    """A token that only root and the service can read; one that is there stays."""
    if path.exists():
        return
    descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o640)
    with os.fdopen(descriptor, "w") as file:
        file.write(secrets.token_urlsafe(32) + "\n")
    shutil.chown(path, "root", USER)
    say(f"a token for the page is in {path}")


def link(path: Path, target: Path) -> None:
    """`path` as a link to `target`."""
    path.unlink(missing_ok=True)
    path.symlink_to(target)


def systemd_runs() -> bool:
    """True on a booted system, False in a chroot or container without systemd."""
    return Path("/run/systemd/system").is_dir()


def is_active() -> bool:
    """True while the service runs, or starts."""
    if not systemd_runs():
        return False
    said = subprocess.run(
        ["systemctl", "is-active", "autonomy"], capture_output=True, text=True, check=False
    ).stdout
    return said.strip() in ("active", "activating", "deactivating", "reloading")


def is_ours(path: Path) -> bool:
    """True for a link into the environment that is installed here."""
    return path.is_symlink() and path.readlink().is_relative_to(PREFIX)


def run(*command: str, may_fail: bool = False) -> None:
    """Run one command; raises DeployError when it fails and may not."""
    try:
        subprocess.run(command, check=not may_fail)
    except subprocess.CalledProcessError as error:
        raise DeployError(
            f"exit code {error.returncode} of: {' '.join(command)}; mend that, then run it again"
        ) from None


def say(text: str) -> None:
    """One line on what is done."""
    print(f"deploy: {text}", flush=True)


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
