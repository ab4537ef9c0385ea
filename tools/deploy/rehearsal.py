"""What the installed service does under systemd when things go wrong: done to it, and timed.

    python3 -m tools.deploy.rehearsal [--write] [CASE ...]

On a booted Debian where `python3 -m tools.deploy install` was run, as root, with the service
stopped. The unit is the installed one; a drop-in in /run sends it to a vehicle that is simulated
by a process of its own and so outlives the service, and is gone afterwards. Needs nothing but
Python's standard library.
"""

import argparse
import ctypes
import datetime
import json
import os
import platform
import signal
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Callable
from pathlib import Path
from typing import Any

from tools import pages

README = Path(__file__).with_name("README.md")
SECTION = "rehearsal"
SERVICE = "autonomy"
VEHICLE = "autonomy-rehearsal-vehicle"
DROP_IN = Path("/run/systemd/system/autonomy.service.d/rehearsal.conf")
PROGRAM = "/opt/autonomy/bin/autonomy"
CONFIGURATION = "/run/autonomy-rehearsal.yaml"
URL = "http://127.0.0.1:8091"
VEHICLE_PORT = 14591
COMPILES_S = 900.0
LANDS_S = 90.0
_POLL_S = 0.02
_SEIZE, _INTERRUPT, _ALL_THREADS = 0x4206, 0x4207, 0x40000000


class Unexpected(Exception):
    """Something else than what is promised: one sentence."""


def main(arguments: list[str] | None = None) -> int:
    """Rehearse; the exit code is 1 when anything was not as promised."""
    parser = argparse.ArgumentParser(
        prog="python3 -m tools.deploy.rehearsal",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("cases", nargs="*", metavar="CASE", help=f"some of: {', '.join(CASES)}")
    parser.add_argument("--write", action="store_true", help="renew tools/deploy/README.md")
    options = parser.parse_args(arguments)
    if unknown := set(options.cases) - set(CASES):
        parser.error(f"no such case: {', '.join(sorted(unknown))}; there are {', '.join(CASES)}")
    if options.write:
        pages.must_have(SECTION, README)
    if why := why_not_here():
        print(f"rehearsal: {why}", file=sys.stderr)
        return 2
    rows, failed = rehearsed(options.cases or list(CASES))
    text = section(rows)
    print(text)
    if options.write and not failed:
        pages.renew(SECTION, text, README)
    return int(failed)


def why_not_here() -> str | None:
    """Why it cannot be rehearsed on this machine, now; None when it can."""
    if os.geteuid() != 0 or not Path("/run/systemd/system").is_dir():
        return "run it as root on a system that systemd booted"
    if not Path(PROGRAM).exists():
        return "install the service first: python3 -m tools.deploy install"
    if is_active() not in ("inactive", "failed"):
        return "the service runs: systemctl stop autonomy, then again"
    return None


def rehearsed(names: list[str]) -> tuple[list[tuple[str, str]], bool]:
    """(what was done, what came of it) for each case, and whether anything was unexpected."""
    rows, failed = [], False
    try:
        clear()
        configure()
        for name in names:
            print(f"rehearsal: {name}", file=sys.stderr, flush=True)
            try:
                outcome = CASES[name]()
            except Unexpected as unexpected:
                outcome, failed = f"UNEXPECTED: {unexpected}", True
            print(f"rehearsal: {name}: {outcome}", file=sys.stderr, flush=True)
            rows.append((str(CASES[name].__doc__).rstrip("."), outcome))
            clear()
    finally:
        clear()
        DROP_IN.unlink(missing_ok=True)
        Path(CONFIGURATION).unlink(missing_ok=True)
        systemctl("daemon-reload")
    return rows, failed


def section(rows: list[tuple[str, str]]) -> str:
    """The table, as Markdown."""
    when = datetime.datetime.now(tz=datetime.UTC).date().isoformat()
    version = said("systemctl", "--version").split()[1]
    return "\n".join(
        [
            f"Measured {when}, systemd {version}, {platform.machine()}, {os.cpu_count()} cores.",
            "",
            "| what is done | what comes of it |",
            "|---|---|",
            *(f"| {what} | {came} |" for what, came in rows),
        ]
    )


# ---------------------------------------------------------------- cases


def boot() -> str:
    """The service is started, its vehicle later."""
    started_s = time.monotonic()
    systemctl("start", "--no-block", SERVICE)
    until(lambda: status().startswith("waiting for a vehicle"), COMPILES_S, "never waited")
    waiting_s = time.monotonic() - started_s
    state, line = is_active(), status()
    expect(state == "activating", f"{state} before a vehicle answered")
    start_vehicle()
    came_s = time.monotonic()
    until(lambda: is_active() == "active", 30.0, "never ready")
    ready_s = time.monotonic() - came_s
    return (
        f'after {waiting_s:.1f} s `activating`, Status: "{line}"; '
        f'{ready_s:.1f} s after the vehicle was started `active`, Status: "{status()}"'
    )


def hangs_on_the_ground() -> str:
    """The process is stopped (SIGSTOP) on the ground."""
    both_up()
    pid, at_s = main_pid(), time.monotonic()
    os.kill(pid, signal.SIGSTOP)
    return begun_anew(pid, at_s, killed_by="watchdog")


def hangs_in_flight() -> str:
    """The process is stopped (SIGSTOP) in flight."""
    pid, at_s = in_flight()
    os.kill(pid, signal.SIGSTOP)
    return f"{begun_anew(pid, at_s, killed_by='watchdog')}; {found_in_the_air()}"


def loop_hangs() -> str:
    """The thread of the control loop alone is stopped in flight; the others go on."""
    pid, at_s = in_flight()
    freeze_thread(pid)
    return f"{begun_anew(pid, at_s, killed_by='watchdog')}; {found_in_the_air()}"


def killed() -> str:
    """The process is killed (SIGKILL) in flight."""
    pid, at_s = in_flight()
    os.kill(pid, signal.SIGKILL)
    return f"{begun_anew(pid, at_s, killed_by='signal')}; {found_in_the_air()}"


def stopped() -> str:
    """`systemctl stop` in flight."""
    _, at_s = in_flight()
    systemctl("stop", SERVICE)
    stopped_s = time.monotonic() - at_s
    shown = f"{show('ActiveState')}, result {show('Result')}"
    expect(shown == "inactive, result success", f"{shown} after stop")
    both_up()
    expect(is_down(), "the vehicle is not on the ground")
    return f"held and landed, `inactive` with success {stopped_s:.1f} s later; vehicle disarmed"


def restarted() -> str:
    """`systemctl restart` in flight."""
    pid, at_s = in_flight()
    systemctl("restart", SERVICE)
    until(lambda: is_active() == "active", 60.0, "never ready again")
    again_s = time.monotonic() - at_s
    expect(main_pid() != pid and is_down(), "the vehicle is not on the ground")
    return f"held and landed, `active` again {again_s:.1f} s later; vehicle disarmed"


def stopped_while_waiting() -> str:
    """`systemctl stop` while no vehicle answers."""
    systemctl("start", "--no-block", SERVICE)
    until(lambda: status().startswith("waiting for a vehicle"), COMPILES_S, "never waited")
    at_s = time.monotonic()
    systemctl("stop", SERVICE)
    ended = f"`{show('ActiveState')}`, {show('Result')}"
    return f"{ended} {time.monotonic() - at_s:.1f} s later"


def refused() -> str:
    """A configuration with an unknown key."""
    Path(CONFIGURATION).write_text("service: {prot: 8042}\n", encoding="utf-8")
    systemctl("start", "--no-block", SERVICE)
    until(lambda: is_active() == "failed", COMPILES_S, "never refused")
    time.sleep(5.0)  # two of RestartSec: it must not begin again
    code, restarts = show("ExecMainStatus"), show("NRestarts")
    expect(is_active() == "failed" and code == "3", f"{is_active()}, exit code {code}")
    sentence = said("journalctl", "-u", SERVICE, "-n", "20", "-o", "cat", "--no-pager")
    line = [line for line in sentence.splitlines() if line.startswith("autonomy: ")][-1]
    return f"`failed` with exit code {code}, {restarts} restarts; the journal: {line}"


CASES: dict[str, Callable[[], str]] = {
    "boot": boot,
    "refused": refused,
    "stopped_while_waiting": stopped_while_waiting,
    "hangs_on_the_ground": hangs_on_the_ground,
    "hangs_in_flight": hangs_in_flight,
    "loop_hangs": loop_hangs,
    "killed": killed,
    "stopped": stopped,
    "restarted": restarted,
}


# ---------------------------------------------------------------- what cases are made of


def in_flight() -> tuple[int, float]:
    """A mission under way at flying height; (the service's pid, now)."""
    both_up()
    post("/v1/missions", {"goals": [[4, 3]]})
    until(is_cruising, 60.0, "the mission never got under way")
    return main_pid(), time.monotonic()


def begun_anew(pid: int, at_s: float, *, killed_by: str) -> str:
    """How long it took systemd to kill what `pid` was, and to begin anew."""
    until(lambda: show("MainPID") != str(pid), 10.0, "never killed")
    killed_s = float(show("ExecMainExitTimestampMonotonic")) / 1e6 - at_s
    result = show("Result")
    expect(result == killed_by, f"result {result} instead of {killed_by}")
    until(lambda: show("MainPID") not in ("0", str(pid)), 30.0, "never begun anew")
    begun_s = float(show("ExecMainStartTimestampMonotonic")) / 1e6 - at_s
    until(lambda: is_active() == "active", 120.0, "never ready again")
    ready_s = float(show("ActiveEnterTimestampMonotonic")) / 1e6 - at_s
    ended = "killed by the watchdog" if killed_by == "watchdog" else "gone"
    return (
        f"{ended} after {killed_s:.2f} s, begun anew at {begun_s:.1f} s, "
        f"`active` at {ready_s:.1f} s"
    )


def found_in_the_air() -> str:
    """What the new life says of the vehicle that it found; an operator's `land` brings it down."""
    until(lambda: vehicle() is not None, 10.0, "never saw its vehicle")
    time.sleep(5.0)
    found = vehicle() or {}
    expect(found["height_m"] > 0.3 and bool(found["armed"]), "the vehicle is not in the air")
    expect(found["speed_m_s"] < 0.1, f"it moves with {found['speed_m_s']:.2f} m/s")
    why = status()
    mode = str(found["mode"])
    at_s = time.monotonic()
    post("/v1/land", None)
    until(is_down, LANDS_S, "ordered to land, it did not")
    landed_s = time.monotonic() - at_s
    return f'vehicle in {mode}, Status: "{why}"; `land` obeyed, down {landed_s:.1f} s later'


def freeze_thread(tid: int) -> None:
    """Stop one thread as a debugger does, until its process is killed.

    A tracer hears of the end first, and must take note before the parent is told: a child of this
    program does nothing else.
    """
    if os.fork():
        return
    ptrace = ctypes.CDLL(None, use_errno=True).ptrace
    ptrace.argtypes = [ctypes.c_long] * 4
    if ptrace(_SEIZE, tid, 0, 0) == 0 and ptrace(_INTERRUPT, tid, 0, 0) == 0:
        while True:
            try:
                _, ending = os.waitpid(tid, _ALL_THREADS)
            except OSError:
                break
            if not os.WIFSTOPPED(ending):
                break
    os._exit(0)


def configure() -> None:
    """The drop-in: the simulated vehicle, a port of its own, nothing else changed."""
    DROP_IN.parent.mkdir(parents=True, exist_ok=True)
    DROP_IN.write_text(
        f"[Service]\nExecStart=\nExecStart={PROGRAM} serve --config {CONFIGURATION}\n",
        encoding="utf-8",
    )
    systemctl("daemon-reload")


def both_up() -> None:
    """The vehicle and the service, ready."""
    start_vehicle()
    if is_active() != "active":
        systemctl("start", "--no-block", SERVICE)
        until(lambda: is_active() == "active", COMPILES_S, "never ready")
    until(lambda: vehicle() is not None, 10.0, "never saw its vehicle")


def clear() -> None:
    """Nothing runs any more."""
    systemctl("stop", SERVICE, VEHICLE, may_fail=True)
    systemctl("reset-failed", SERVICE, VEHICLE, may_fail=True)
    Path(CONFIGURATION).write_text(
        f"vehicle: {{connection: udpin://127.0.0.1:{VEHICLE_PORT}}}\n"
        f"service: {{port: {URL.rpartition(':')[2]}}}\n"
        "log: {directory: /var/lib/autonomy/rehearsal}\n",
        encoding="utf-8",
    )


def start_vehicle() -> None:
    """The simulated vehicle in a unit of its own, unless it is there."""
    if said("systemctl", "is-active", VEHICLE).strip() == "active":
        return
    simulated = (PROGRAM, "sim", "default", "--port", str(VEHICLE_PORT))
    own = ("--property=User=autonomy", "--property=Nice=-10")  # a real one has its own computer
    run("systemd-run", "--quiet", f"--unit={VEHICLE}", *own, *simulated)


def is_cruising() -> bool:
    """True at flying height and under way."""
    seen = vehicle()
    return seen is not None and seen["height_m"] > 0.9 and seen["speed_m_s"] > 0.1


def is_down() -> bool:
    """True on the ground and disarmed."""
    seen = vehicle()
    return seen is not None and seen["landed"] == "on_ground" and not seen["armed"]


def vehicle() -> dict[str, Any] | None:
    """The vehicle as the service sees it, None without one or without a service."""
    try:
        state = get("/v1/state")
    except (urllib.error.URLError, OSError):
        return None
    found: dict[str, Any] | None = state["vehicle"]
    return found


def get(path: str) -> Any:
    """What the service answers."""
    with urllib.request.urlopen(URL + path, timeout=2.0) as response:  # noqa: S310 - http, see URL
        return json.load(response)


def post(path: str, body: object) -> None:
    """An order; raises Unexpected when it is refused."""
    request = urllib.request.Request(  # noqa: S310 - http, see URL
        URL + path,
        data=json.dumps(body).encode() if body is not None else b"",
        headers={"Content-Type": "application/json"},
        method="POST",
    )
    try:
        urllib.request.urlopen(request, timeout=2.0).close()  # noqa: S310 - http, see URL
    except urllib.error.HTTPError as error:
        raise Unexpected(f"{path}: {error.read().decode()}") from None


def main_pid() -> int:
    """The service's process."""
    return int(show("MainPID"))


def status() -> str:
    """The line that `systemctl status` shows."""
    return show("StatusText")


def is_active() -> str:
    """`systemctl is-active`."""
    return said("systemctl", "is-active", SERVICE).strip()


def show(name: str) -> str:
    """One property of the service's unit."""
    return said("systemctl", "show", SERVICE, "--value", "-p", name).strip()


def systemctl(*words: str, may_fail: bool = False) -> None:
    """Run it; raises Unexpected when it fails and may not."""
    run("systemctl", *words, may_fail=may_fail)


def run(*command: str, may_fail: bool = False) -> None:
    """Run a command; raises Unexpected when it fails and may not."""
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0 and not may_fail:
        raise Unexpected(f"{' '.join(command)}: {done.stderr.strip()}")


def said(*command: str) -> str:
    """What a command printed, whatever its exit code."""
    return subprocess.run(command, capture_output=True, text=True, check=False).stdout


def until(holds: Callable[[], bool], timeout_s: float, otherwise: str) -> None:
    """Wait for something; raises Unexpected when it does not come in time."""
    ends_s = time.monotonic() + timeout_s
    while not holds():
        if time.monotonic() > ends_s:
            raise Unexpected(f"{otherwise}: {is_active()}, {status()}")
        time.sleep(_POLL_S)


def expect(holds: bool, otherwise: str) -> None:  # noqa: FBT001 - as assert
    """Raises Unexpected when it does not hold."""
    if not holds:
        raise Unexpected(otherwise)


if __name__ == "__main__":
    sys.exit(main())
