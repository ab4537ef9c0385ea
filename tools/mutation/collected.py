"""A pytest plugin that stops where the tests are collected, and shows them mutant after mutant.

A first fork runs all tests as they are and notes which lines of the module each of them comes by; a
mutant is then shown only to those that come by its line, the quickest first. Mutants are tried in
a second fork, which is replaced where one of them ends it (an endless loop).
"""

import dataclasses
import os
import resource
import signal
import sys
import time
from collections.abc import Callable, Generator
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path
from types import FrameType
from typing import Any, NoReturn

import pytest

from tools.mutation.swap import Swap, swap_for

OWN = frozenset(("autonomy", "hal", "tools", "tests", "conftest"))
"""What a test imports of the project itself."""
MEMORY_MAX_BYTES = 6 << 30
"""A mutant that never stops collecting ends here."""
Tracer = Callable[[FrameType, str, Any], Any]


@dataclasses.dataclass(frozen=True)
class Footprint:
    """Lines of the module that a test comes by, and the first lines of functions it calls."""

    lines: frozenset[int]
    functions: frozenset[int]
    cpu_s: float


class Collected:
    """Answers (source, lines that differ, CPU limit) with (passed or None, CPU seconds).

    None: this mutant has to be imported anew. Before the first answer it sends the names of all
    foreign modules.
    """

    def __init__(
        self, ends: tuple[Connection, Connection], module: Path, place: Path, original: str
    ) -> None:
        """`module`: the file relative to the tree at `place`, which has the source `original`.

        ends: of a pipe, that of who asks and that of who answers. Answering ends with the other.
        """
        self._ear, self._voice = ends
        self._name = ".".join(module.with_suffix("").parts)
        self._file = str(place / module)
        self._place = place
        self._original = original
        self._footprints: list[Footprint] = []
        self._notes: list[Footprint] | None = None
        self._to_parent: Connection | None = None
        self._is_failed = False

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtestloop(self, session: pytest.Session) -> None:
        """Serve; returns, in a child only, to let pytest run all tests as they are."""
        self._ear.close()
        self._voice.send(foreign_modules(self._place))
        if self._is_noting():
            return
        while True:
            child = os.fork()
            if child == 0:
                self._answer_all(session)
            _, status = os.waitpid(child, 0)
            if status == 0:
                os._exit(0)
            # What it tried ended it.
            self._voice.send((False, 0.0))

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self) -> Generator[None, object, object]:
        """Note which lines the test comes by, in the child that is there for it."""
        if self._notes is None:
            return (yield)
        lines: set[int] = set()
        functions: set[int] = set()
        sys.settrace(_tracer(self._file, lines, functions))
        begun = time.process_time()
        try:
            return (yield)
        finally:
            sys.settrace(None)
            cpu_s = time.process_time() - begun
            self._notes.append(Footprint(frozenset(lines), frozenset(functions), cpu_s))

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """A test that fails, or whose fixtures do."""
        self._is_failed |= report.failed

    @pytest.hookimpl(tryfirst=True)
    def pytest_sessionfinish(self, exitstatus: int) -> None:
        """The noting child ends here: what follows would clean up what the next one needs."""
        if self._to_parent is not None:
            self._to_parent.send([dataclasses.astuple(note) for note in self._notes or ()])
            os._exit(int(exitstatus))

    def _is_noting(self) -> bool:
        """True in the child that runs all tests as they are; its notes are here afterwards."""
        receiver, sender = get_context("fork").Pipe(duplex=False)
        child = os.fork()
        if child == 0:
            self._to_parent, self._notes = sender, []
            return True
        sender.close()
        self._footprints = [Footprint(*note) for note in receiver.recv()]
        os.waitpid(child, 0)
        return False

    def _answer_all(self, session: pytest.Session) -> NoReturn:
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY_MAX_BYTES, MEMORY_MAX_BYTES))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        for number in (signal.SIGPROF, signal.SIGALRM):
            signal.signal(number, signal.SIG_DFL)
        while True:
            try:
                asked = self._voice.recv()
            except EOFError:
                os._exit(0)
            self._voice.send(self._answer(session, *asked))

    def _answer(
        self, session: pytest.Session, source: str, lines: frozenset[int], cpu_limit_s: float
    ) -> tuple[bool | None, float]:
        swap = swap_for(sys.modules[self._name], self._original, source)
        if swap is None:
            return None, 0.0
        self._is_failed = False
        begun = time.process_time()
        set_limits(cpu_limit_s)
        with swap.applied():
            for k in self._witnesses(lines, swap):
                item = session.items[k]
                item.config.hook.pytest_runtest_protocol(item=item, nextitem=None)
                if self._is_failed:
                    break
        set_limits(0.0)
        return not self._is_failed, time.process_time() - begun

    def _witnesses(self, lines: frozenset[int], swap: Swap) -> list[int]:
        """Numbers of the tests to ask, the quickest first."""
        everyone = range(len(self._footprints))
        begins = {function.__code__.co_firstlineno for function, _ in swap.functions}
        chosen = [k for k in everyone if lines & self._footprints[k].lines]
        if begins and not chosen:
            # A line of a longer statement may have no code of its own.
            chosen = [k for k in everyone if begins & self._footprints[k].functions]
        if not begins:
            chosen = list(everyone)
        return sorted(chosen, key=lambda k: self._footprints[k].cpu_s)


def set_limits(cpu_limit_s: float) -> None:
    """End this process when it takes longer than that of its own time, or sleeps; 0: no more."""
    signal.setitimer(signal.ITIMER_PROF, cpu_limit_s)
    # For what sleeps: processor time may be scarce.
    signal.setitimer(signal.ITIMER_REAL, 60.0 * cpu_limit_s)


def foreign_modules(place: Path) -> list[str]:
    """The names of all modules that are loaded and not the project's (in a tree at `place`)."""
    names = []
    for name, module in list(sys.modules.items()):
        specification = getattr(module, "__spec__", None)
        file = getattr(module, "__file__", None)
        foreign = file is not None and not Path(file).is_relative_to(place)
        if foreign and specification is not None and specification.name == name:
            names.append(name)
    return [name for name in names if name.partition(".")[0] not in OWN]


def _tracer(file: str, lines: set[int], functions: set[int]) -> Tracer:
    def on_line(frame: FrameType, event: str, _: object) -> Tracer:
        if event == "line":
            lines.add(frame.f_lineno)
        return on_line

    def on_call(frame: FrameType, _event: str, _: object) -> Tracer | None:
        if frame.f_code.co_filename != file:
            return None
        functions.add(frame.f_code.co_firstlineno)
        return on_line

    return on_call
