"""Before a vehicle is looked for: the kernels are loaded, and a simulated vehicle is started.

The page and every order are answered meanwhile, with how far it is. A first start has to compile,
for minutes on a small computer: another process does, so that the compiler's memory ends with it.
"""

import asyncio
import contextlib
import logging
import sys
from collections.abc import Callable

from autonomy.embedded import EmbeddedPx4
from autonomy.warm import load_compiled, warm_up

COMPILER = (sys.executable, "-m", "autonomy.warm")
_ATTEMPTS = 2
"""What a compiler has kept on the disk before it died is not compiled again."""
_LOG = logging.getLogger("autonomy")


async def load_kernels(tell: Callable[[str], None]) -> None:
    """Have every kernel loaded that flies; `tell` hears how far it is, a sentence at a time.

    When cancelled, a process that compiles is ended. Loading keeps this loop for seconds (the web
    has a thread of its own): in another thread it would leave 16 MB more behind.
    """
    tell("loading the compiled planner")
    if load_compiled():
        return
    tell("compiling the planner: minutes the first time, then seconds")
    for _ in range(_ATTEMPTS):
        code = await _run(COMPILER, tell)
        if code == 0:
            break
        _LOG.warning("the process that compiles the planner died (exit code %d)", code)
    # What the other process could not keep on the disk is compiled here.
    warm_up(tell)


async def _run(command: tuple[str, ...], tell: Callable[[str], None]) -> int:
    """Run a process whose every line is told; its exit code, negative for a signal.

    When cancelled, the process is killed.
    """
    process = await asyncio.create_subprocess_exec(
        *command,
        stdin=asyncio.subprocess.DEVNULL,
        stdout=asyncio.subprocess.PIPE,
        start_new_session=True,  # the terminal's Ctrl-C is for this process to pass on
    )
    output = process.stdout
    try:
        if output is None:
            raise ValueError("a process without the pipe that was asked for")
        async for line in output:
            tell(line.decode("utf-8", "replace").strip())
        return await process.wait()
    finally:
        if process.returncode is None:
            with contextlib.suppress(ProcessLookupError):
                process.kill()
            await process.wait()


async def start_embedded(vehicle: EmbeddedPx4, tell: Callable[[str], None]) -> None:
    """Start the simulated vehicle, which compiles its world at the first time; who called ends it.

    Raises AutonomyError when it does not start.
    """
    tell("starting the simulated vehicle")
    try:
        await asyncio.to_thread(vehicle.__enter__)
    except asyncio.CancelledError:
        vehicle.give_up()
        raise
