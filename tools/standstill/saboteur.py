"""Defects on order, inside a process that flies.

`listen(path)` is called before the command line runs. Each datagram at the Unix socket `path` names
one of `ORDERS` and is carried out at once, most of them on the event loop's thread, where a defect
of the program would be.
"""

import asyncio
import ctypes
import gc
import os
import resource
import socket
import threading
import time
from collections.abc import Callable
from pathlib import Path

from autonomy.flight import Flight
from autonomy.mission.guarded import GuardedPilot
from autonomy.model import Command, Inputs, Outcome

BLOCKED_S = 4.0
SLOW_STEP_S = 1.0
HELD_S = 3.0
_GARBAGE = 1_500_000
_SPARE_BYTES = 1 << 20


def _nothing(_: Inputs) -> None:
    """No defect."""


class _Flown:
    """The flight under way: its event loop, and what runs inside the next step of the core."""

    loop: asyncio.AbstractEventLoop
    step: Callable[[Inputs], None] = _nothing


def listen(path: Path) -> None:
    """Carry out orders from now on, on a thread of its own; returns at once."""
    _watch_flight()
    server = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    server.bind(str(path))
    threading.Thread(target=_obey, args=(server,), name="saboteur", daemon=True).start()


def _watch_flight() -> None:
    run, step = Flight.run, GuardedPilot.step

    async def watched_run(flight: Flight) -> Outcome:
        _Flown.loop = asyncio.get_running_loop()
        return await run(flight)

    def watched_step(guarded: GuardedPilot, inputs: Inputs) -> Command:
        planted, _Flown.step = _Flown.step, _nothing
        planted(inputs)
        return step(guarded, inputs)

    setattr(Flight, "run", watched_run)  # noqa: B010  mypy rightly objects to an assignment
    setattr(GuardedPilot, "step", watched_step)  # noqa: B010


def _obey(server: socket.socket) -> None:
    while True:
        ORDERS[server.recv(100).decode()]()


# ---------------------------------------------------------------- orders


def _block_loop() -> None:
    _Flown.loop.call_soon_threadsafe(time.sleep, BLOCKED_S)


def _end_task() -> None:
    """The task that carries requests to the autopilot ends, as if somebody had cancelled it."""

    def end() -> None:
        for task in asyncio.all_tasks():
            if "_serve_requests" in repr(task.get_coro()):
                task.cancel()

    _Flown.loop.call_soon_threadsafe(end)


def _raise_in_step() -> None:
    def planted(_: Inputs) -> None:
        raise ZeroDivisionError("planted")

    _Flown.step = planted


def _slow_step() -> None:
    def planted(_: Inputs) -> None:
        time.sleep(SLOW_STEP_S)

    _Flown.step = planted


def _collect_garbage() -> None:
    """A heap full of rings, and a collection of all of it on the loop: nothing else can run."""
    rings: list[list[object]] = [[] for _ in range(_GARBAGE)]
    for ring in rings:
        ring.append(ring)

    def collect() -> None:
        rings.clear()
        gc.collect()

    _Flown.loop.call_soon_threadsafe(collect)


def _hold_interpreter() -> None:
    """Native code that does not let go of the interpreter: no thread of Python runs."""
    sleep = ctypes.PyDLL(None).usleep
    _Flown.loop.call_soon_threadsafe(sleep, int(HELD_S * 1e6))


def _no_memory() -> None:
    """No more memory: whatever asks for some gets MemoryError, the next step of the core first."""

    def planted(_: Inputs) -> None:
        used = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
        limit = used * os.sysconf("SC_PAGE_SIZE") + _SPARE_BYTES
        resource.setrlimit(resource.RLIMIT_AS, (limit, resource.RLIM_INFINITY))
        bytearray(64 * _SPARE_BYTES)

    _Flown.step = planted


def _full_disk() -> None:
    """Files cannot grow any more: each write to the log is refused."""
    resource.setrlimit(resource.RLIMIT_FSIZE, (4096, resource.RLIM_INFINITY))


def _step_clock(by_s: float) -> Callable[[], None]:
    """The wall clock as Python sees it jumps; a monotonic clock does not, by its definition."""

    def jump() -> None:
        now, now_ns = time.time, time.time_ns  # noqa: TID251  nobody reads it: it is put wrong
        time.time = lambda: now() + by_s  # noqa: TID251
        time.time_ns = lambda: now_ns() + int(by_s * 1e9)

    return jump


ORDERS: dict[str, Callable[[], None]] = {
    "event loop blocked": _block_loop,
    "task dead": _end_task,
    "step raises": _raise_in_step,
    "step takes 1 s": _slow_step,
    "garbage collection": _collect_garbage,
    "interpreter held": _hold_interpreter,
    "out of memory": _no_memory,
    "disk full": _full_disk,
    "clock an hour ahead": _step_clock(3600.0),
    "clock an hour back": _step_clock(-3600.0),
}
