"""What systemd is told: readiness, one status line, signs of life. The protocol is sd_notify(3).

Without NOTIFY_SOCKET in the environment everything here does nothing.
"""

import os
import socket
from collections.abc import Mapping

_USEC = 1e6


class Notifier:
    """Sends state changes to systemd's socket; never blocks, never raises."""

    def __init__(self, environ: Mapping[str, str]) -> None:
        """`environ` is the process's; NOTIFY_SOCKET and WATCHDOG_USEC are read from it."""
        self._address = _address(environ.get("NOTIFY_SOCKET", ""))
        self._status = ""
        self._watched = False
        self._fed_s: float | None = None
        period_s = _watchdog_s(environ)
        self._feed_every_s = period_s / 4.0 if period_s is not None else None

    def ready(self) -> None:
        """The service does what it is for: a vehicle is there, flown or not; the watchdog counts
        from here.
        """
        self._watched = True
        self._send("READY=1")

    def stopping(self) -> None:
        """The service is ending, its vehicle let go of: nothing left that could hang in flight.

        The watchdog goes with it, else it kills a computer's slow tidying up as a loop that hangs;
        the unit's TimeoutStopSec bounds that.
        """
        self._watched = False
        self._send("STOPPING=1\nWATCHDOG_USEC=0")

    def status(self, sentence: str) -> None:
        """The line that `systemctl status` shows; sent when it changes."""
        sentence = " ".join(sentence.split())
        if sentence != self._status:
            self._status = sentence
            self._send(f"STATUS={sentence}")

    def extend_s(self, seconds: float) -> None:
        """Starting or stopping takes this much longer, and is not hanging."""
        self._send(f"EXTEND_TIMEOUT_USEC={int(seconds * _USEC)}")

    def alive(self, now_s: float) -> None:
        """The control loop turned at `now_s`; passed on at a quarter of the watchdog's period.

        Not before `ready`: systemd's watchdog begins with the first sign of life, if that comes
        earlier, and loading the kernels keeps the loop for longer than its period.
        """
        if self._feed_every_s is None or not self._watched:
            return
        if self._fed_s is None or now_s - self._fed_s >= self._feed_every_s:
            self._fed_s = now_s
            self._send("WATCHDOG=1")

    def _send(self, message: str) -> None:
        if self._address is None:
            return
        try:
            with socket.socket(
                socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_NONBLOCK | socket.SOCK_CLOEXEC
            ) as wire:
                wire.sendto(message.encode(), self._address)
        except OSError:
            # systemd is away or its buffer is full: flying matters more than being watched.
            return


def _address(name: str) -> str | None:
    """The socket's address; a leading @ is the abstract name space."""
    if not name.startswith(("/", "@")):
        return None
    return "\0" + name[1:] if name.startswith("@") else name


def _watchdog_s(environ: Mapping[str, str]) -> float | None:
    """systemd's watchdog period for this process, None without one."""
    pid = environ.get("WATCHDOG_PID")
    if pid is not None and pid != str(os.getpid()):
        return None
    try:
        period_s = int(environ.get("WATCHDOG_USEC", "")) / _USEC
    except ValueError:
        return None
    return period_s if period_s > 0.0 else None
