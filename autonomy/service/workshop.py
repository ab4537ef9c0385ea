"""What takes seconds to make of a flight log is made in a process of its own, one at a time.

It must not take the interpreter from the control loop, nor memory from the flight: the process
stands back by itself (`autonomy.review.worker`), and is ended when nobody waits for it any more.
"""

import asyncio
import contextlib
import re
import sys
from collections.abc import Mapping
from pathlib import Path

from autonomy.errors import BadInput
from autonomy.service.contract import Reading

WORKER = (sys.executable, "-m", "autonomy.review.worker")
_BYTES_MAX = 32 * 1024 * 1024
_SENTENCE_MAX = 400
_SAID_MAX = 8192
_SHARE = re.compile(rb"^share ([01]\.[0-9]{2})$", re.MULTILINE)


class Busy(BadInput):
    """Another log is being worked on."""


class Workshop:
    """Makes things out of logs. `commands` are program and first arguments by what is made; the
    log's path is added. A program writes gzip to its standard output; to its standard error how
    much of the log it has read (`share 0.42`), or a sentence.
    """

    def __init__(
        self, commands: Mapping[str, tuple[str, ...]] | None = None, *, timeout_s: float = 300.0
    ) -> None:
        if commands is None:
            commands = {what: (*WORKER, what) for what in ("reel", "report")}
        self._commands = commands
        self._timeout_s = timeout_s
        self._at_work = False
        self._reading = Reading()

    @property
    def reading(self) -> Reading:
        """The log that something is made of now, and how far that is."""
        return self._reading

    @property
    def at_work(self) -> bool:
        """True while something is made: nothing else can be."""
        return self._at_work

    async def make(self, what: str, log: Path) -> bytes:
        """The thing, compressed by gzip.

        Raises Busy while another is made, BadInput with the sentence of a program that could not
        make it. When cancelled, the program is killed.
        """
        if self._at_work:
            raise Busy("another flight is being read just now; try again in a few seconds")
        self._at_work = True
        self._reading = Reading(log.name, 0.0)
        try:
            return await self._made(what, log)
        finally:
            self._at_work = False
            self._reading = Reading()

    async def _made(self, what: str, log: Path) -> bytes:
        process = await asyncio.create_subprocess_exec(
            *self._commands[what],
            str(log),
            stdin=asyncio.subprocess.DEVNULL,
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.PIPE,
        )
        try:
            async with asyncio.timeout(self._timeout_s):
                made, said = await asyncio.gather(
                    _whole(process.stdout), self._hear(log.name, process.stderr)
                )
                await process.wait()
        except TimeoutError:
            raise BadInput(
                f"{log.name}: reading it took over {self._timeout_s:g} s; use autonomy report"
            ) from None
        finally:
            if process.returncode is None:
                with contextlib.suppress(ProcessLookupError):
                    process.kill()
                await process.wait()
        if process.returncode != 0:
            lines = _SHARE.sub(b"", said).decode("utf-8", "replace").strip().splitlines()
            raise BadInput(lines[-1][:_SENTENCE_MAX] if lines else f"{log.name}: cannot be read")
        if len(made) > _BYTES_MAX:
            raise BadInput(f"{log.name}: too long a flight for the page; use autonomy report")
        return made

    async def _hear(self, name: str, errors: asyncio.StreamReader | None) -> bytes:
        """What a program says, its end if it says much; how far it is is noted meanwhile."""
        said = b""
        while errors is not None and (more := await errors.read(_SAID_MAX)):
            said = (said + more)[-_SAID_MAX:]
            shares = _SHARE.findall(said)
            if shares:
                self._reading = Reading(name, float(shares[-1]))
        return said


async def _whole(stream: asyncio.StreamReader | None) -> bytes:
    return b"" if stream is None else await stream.read()
