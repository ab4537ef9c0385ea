"""What is done to a program that flies, from outside or by the saboteur inside it."""

import contextlib
import multiprocessing
import os
import signal
import socket
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from pathlib import Path

from tests.support.flying import Flying
from tools.standstill import saboteur

STOPPED_S = 3.0
STARVED_S = 8.0
NEIGHBOURS_PER_CORE = 2


@dataclass(frozen=True)
class Scene:
    """One flight that something is done to, and the socket on which its saboteur listens."""

    flying: Flying
    orders: Path


class Duty(Enum):
    """Who has to do what when it happens."""

    STOP = "the program stops the vehicle"
    GONE = "the program is gone or stands still: PX4 stops the vehicle"
    LEASH = "nobody can ask for a stop: the position in the last setpoint holds the vehicle back"
    FLY_ON = "nothing: the flight goes on"


@dataclass(frozen=True)
class Fault:
    """One thing that happens, and what has to come of it."""

    name: str
    cause: Callable[[Scene], None]
    duty: Duty = Duty.STOP


def _order(name: str) -> Fault:
    def cause(scene: Scene) -> None:
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as client:
            client.sendto(name.encode(), str(scene.orders))

    return Fault(name, cause, _DUTIES.get(name, Duty.STOP))


_DUTIES = {
    "interpreter held": Duty.LEASH,
    "garbage collection": Duty.FLY_ON,
    "disk full": Duty.FLY_ON,
    "clock an hour ahead": Duty.FLY_ON,
    "clock an hour back": Duty.FLY_ON,
}


def _kill(scene: Scene) -> None:
    scene.flying.send_signal(signal.SIGKILL)


def _stop_for_a_while(scene: Scene) -> None:
    """SIGSTOP, and SIGCONT later, if it is still there then."""

    def go_on() -> None:
        with contextlib.suppress(ProcessLookupError):
            scene.flying.send_signal(signal.SIGCONT)

    scene.flying.send_signal(signal.SIGSTOP)
    threading.Timer(STOPPED_S, go_on).start()


def _spin(until_s: float) -> None:
    while time.monotonic() < until_s:
        pass


def _starve(_: Scene) -> None:
    """Busy neighbours on every core for a while, at the same priority."""
    until_s = time.monotonic() + STARVED_S
    for _number in range(NEIGHBOURS_PER_CORE * (os.cpu_count() or 1)):
        multiprocessing.get_context("fork").Process(
            target=_spin, args=(until_s,), daemon=True
        ).start()


FAULTS: tuple[Fault, ...] = (
    *(_order(name) for name in saboteur.ORDERS),
    Fault("stopped for 3 s (SIGSTOP)", _stop_for_a_while, Duty.GONE),
    Fault("killed (SIGKILL)", _kill, Duty.GONE),
    Fault("two busy neighbours per core", _starve, Duty.FLY_ON),
)
