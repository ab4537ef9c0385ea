"""Install the service on a drone, and remove it again. Debian or a child of it; run as root.

    python3 -m tools.deploy install [--source PATH_OR_WHEEL]
    python3 -m tools.deploy remove [--purge]

Installs an environment of its own (/opt/autonomy), a user, udev rules, the unit, configuration and
a token (/etc/autonomy); what is there already is kept. `remove` leaves configuration and flight
logs; `--purge` takes them too. Needs nothing but Python's standard library and python3-venv.
"""

import argparse
import grp
import os
import pwd
import secrets
import shutil
import subprocess
import sys
from pathlib import Path

PROJECT = Path(__file__).resolve().parents[2]
PREFIX = Path("/opt/autonomy")
SETTINGS = Path("/etc/autonomy")
UNIT = Path("/etc/systemd/system/autonomy.service")
RULES = Path("/etc/udev/rules.d/60-autonomy.rules")
COMMAND = Path("/usr/local/bin/autonomy")
KEPT = (Path("/var/lib/autonomy"), Path("/var/cache/autonomy"))
USER = "autonomy"
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
    try:
        if options.action == "install":
            install(options.source)
        else:
            remove(purge=options.purge)
    except (subprocess.CalledProcessError, OSError) as error:
        print(f"deploy: {error}", file=sys.stderr)
        return 1
    return 0


def install(source: str) -> None:
    """Everything in its place; may be run again to bring it up to date."""
    make_user()
    say(f"installing {source} into {PREFIX}")
    if not (PREFIX / "bin" / "python").exists():
        run(sys.executable, "-m", "venv", str(PREFIX))
    pip = (str(PREFIX / "bin" / "python"), "-m", "pip", "install", "--quiet", "--upgrade")
    run(*pip, f"{source}[service,hardware,plots]")
    link(COMMAND, PREFIX / "bin" / "autonomy")
    SETTINGS.mkdir(mode=0o755, exist_ok=True)
    settings = SETTINGS / "config.yaml"
    if not settings.exists():
        settings.write_text(CONFIGURATION, encoding="utf-8")
    make_token(SETTINGS / "token")
    shutil.copyfile(PROJECT / "configs" / "autonomy.service", UNIT)
    RULES.parent.mkdir(parents=True, exist_ok=True)
    shutil.copyfile(PROJECT / "tools" / "deploy" / "60-autonomy.rules", RULES)
    run(str(PREFIX / "bin" / "autonomy"), "config", "check", str(settings))
    if systemd_runs():
        run("systemctl", "daemon-reload")
        run("udevadm", "control", "--reload")
        say("start it with: systemctl enable --now --no-block autonomy")
    say("the page will be at http://127.0.0.1:8042")


def remove(*, purge: bool) -> None:
    """Everything out of its place; configuration, token and flight logs only with `purge`."""
    if systemd_runs():
        subprocess.run(["systemctl", "disable", "--now", "autonomy"], check=False)
    for path in (UNIT, RULES, COMMAND):
        path.unlink(missing_ok=True)
    shutil.rmtree(PREFIX, ignore_errors=True)
    if systemd_runs():
        run("systemctl", "daemon-reload")
    if not purge:
        say(f"kept: {SETTINGS}, {', '.join(str(path) for path in KEPT)} and the user {USER}")
        return
    for folder in (SETTINGS, *KEPT):
        shutil.rmtree(folder, ignore_errors=True)
    if has_user():
        run("userdel", USER)


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


def run(*command: str) -> None:
    """Run one command; raises CalledProcessError when it fails."""
    subprocess.run(command, check=True)


def say(text: str) -> None:
    """One line on what is done."""
    print(f"deploy: {text}", flush=True)


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
