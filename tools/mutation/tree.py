"""A copy of the project, and the processes that test mutants in it.

To import everything and to collect the tests takes longer than to run them. So one process of
each tree imports and collects once, then forks for every mutant: the child gets the mutant's
functions (`swap`) and runs the tests. A mutant outside of functions is written into the tree, and
a fork of this process, which has only imported what is not the project's, begins from there.
"""

import importlib
import multiprocessing
import os
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
from multiprocessing.connection import Connection
from pathlib import Path

import hypothesis
import pytest

from tools.mutation.swap import Swap, swaps_for

COPIED = ("autonomy", "hal", "tools", "tests", "configs", "pyproject.toml", "README.md")
OWN = frozenset(("autonomy", "hal", "tools", "tests", "conftest"))
OPTIONS = ("-x", "-q", "-p", "no:cacheprovider", "-p", "no:xdist", "-W", "ignore")
MEMORY_MAX_BYTES = 6 << 30
"""A mutant that never stops collecting ends here."""
PATIENCE = 5.0
"""Tests that take this many times longer have noticed something."""
LEAST_CPU_S = 3.0

_fork = multiprocessing.get_context("fork")


class Tree:
    """A copy of the parts of `root` that the tests of `module` need. Belongs to one process."""

    def __init__(self, root: Path, place: Path, module: Path, tests: tuple[str, ...]) -> None:
        """Copy, run the tests once as they are, and collect them; SystemExit when they fail."""
        self._place = place
        self._module = place / module
        self._tests = tests
        for name in COPIED:
            source = root / name
            if source.is_dir():
                ignored = shutil.ignore_patterns("__pycache__", "*.png")
                shutil.copytree(source, place / name, ignore=ignored)
            elif source.exists():
                shutil.copy2(source, place / name)
        self.original = self._module.read_text()
        # Also compiles what numba keeps.
        _run_once(place, tests)
        self._ear, voice = _fork.Pipe()
        name = ".".join(module.with_suffix("").parts)
        collected = _Collected(voice, name, self.original, place)
        self._collected = _fork.Process(target=_serve, args=(place, tests, collected), daemon=True)
        self._collected.start()
        for foreign in self._ear.recv():
            importlib.import_module(foreign)
        self._cpu_limit_s = 600.0
        passed, cpu_s = self._ask(self.original)
        if not passed:
            raise SystemExit("the tests fail without any mutation when they are run in a fork")
        self._cpu_limit_s = LEAST_CPU_S + PATIENCE * cpu_s

    def passes(self, source: str) -> bool:
        """Whether the tests pass with `source` as the module; False too when they hang."""
        passed, _ = self._ask(source)
        return self._passes_anew(source) if passed is None else passed

    def close(self) -> None:
        """End the process that collected the tests."""
        self._ear.send(None)
        self._collected.join()

    def _ask(self, source: str) -> tuple[bool | None, float]:
        self._ear.send((source, self._cpu_limit_s))
        passed, cpu_s = self._ear.recv()
        return passed, cpu_s

    def _passes_anew(self, source: str) -> bool:
        """All of the project imported again, the mutant with it."""
        self._module.write_text(source)
        try:
            arguments = (self._place, self._tests, self._cpu_limit_s + 60.0)
            process = _fork.Process(target=_import_and_test, args=arguments)
            process.start()
            process.join()
            return process.exitcode == 0
        finally:
            self._module.write_text(self.original)


class _Collected:
    """A pytest plugin that stops where the tests are collected, and forks for every mutant."""

    def __init__(self, voice: Connection, module: str, original: str, place: Path) -> None:
        self._voice = voice
        self._module = module
        self._original = original
        self._place = place
        self._is_child = False

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtestloop(self) -> None:
        """Serve; returns, in a child only, to let pytest run the tests that it collected."""
        self._voice.send(_foreign_modules(self._place))
        while True:
            asked = self._voice.recv()
            if asked is None:
                os._exit(0)
            source, cpu_limit_s = asked
            swaps = swaps_for(sys.modules[self._module], self._original, source)
            if swaps is None:
                self._voice.send((None, 0.0))
                continue
            child = os.fork()
            if child == 0:
                self._become(swaps, cpu_limit_s)
                return
            _, status, usage = os.wait4(child, 0)
            self._voice.send((os.waitstatus_to_exitcode(status) == 0, usage.ru_utime))

    @pytest.hookimpl(tryfirst=True)
    def pytest_sessionfinish(self, exitstatus: int) -> None:
        """A child ends here: what follows would clean up what the next one needs."""
        if self._is_child:
            os._exit(int(exitstatus))

    def _become(self, swaps: list[Swap], cpu_limit_s: float) -> None:
        self._is_child = True
        _limit(cpu_limit_s)
        for function, code in swaps:
            function.__code__ = code


def _run_once(place: Path, tests: tuple[str, ...]) -> None:
    command = [sys.executable, "-m", "pytest", *OPTIONS, *tests]
    environment = os.environ | {"PYTHONPATH": str(place)}
    done = subprocess.run(
        command, cwd=place, env=environment, capture_output=True, text=True, check=False
    )
    if done.returncode:
        raise SystemExit(f"the tests fail without any mutation:\n{done.stdout}{done.stderr}")


def _serve(place: Path, tests: tuple[str, ...], collected: _Collected) -> None:
    _enter(place)
    os._exit(_tested(tests, collected))


def _import_and_test(place: Path, tests: tuple[str, ...], cpu_limit_s: float) -> None:
    _enter(place)
    _limit(cpu_limit_s)
    os._exit(_tested(tests))


def _enter(place: Path) -> None:
    """Make this process live in the tree, with nothing of the project imported yet."""
    silence = os.open(os.devnull, os.O_RDWR)
    for stream in range(3):
        os.dup2(silence, stream)
    os.chdir(place)
    (place / "tmp").mkdir(exist_ok=True)
    os.environ["TMPDIR"] = tempfile.tempdir = str(place / "tmp")
    # Two mutants of equal length in one second would share their byte code.
    sys.dont_write_bytecode = True
    for name in [name for name in sys.modules if name.partition(".")[0] in OWN]:
        del sys.modules[name]
    sys.path.insert(0, str(place))


def _limit(cpu_limit_s: float) -> None:
    """End this process when it takes too long (of its own time, not the machine's) or too much."""
    seconds = int(cpu_limit_s) + 1
    resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds))
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY_MAX_BYTES, MEMORY_MAX_BYTES))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    signal.signal(signal.SIGALRM, signal.SIG_DFL)
    # For what sleeps.
    signal.alarm(60 + 60 * seconds)


def _tested(tests: tuple[str, ...], *plugins: _Collected) -> int:
    # The same examples each time; a failure is not made smaller, nor slowness called one.
    hypothesis.settings.register_profile(
        "mutation",
        derandomize=True,
        database=None,
        phases=(hypothesis.Phase.explicit, hypothesis.Phase.generate),
        suppress_health_check=tuple(hypothesis.HealthCheck),
        deadline=None,
    )
    hypothesis.settings.load_profile("mutation")
    return int(pytest.main([*OPTIONS, *tests], plugins=list(plugins)))


def _foreign_modules(place: Path) -> list[str]:
    """The names of all modules that are loaded and not the project's."""
    names = []
    for name, module in list(sys.modules.items()):
        specification = getattr(module, "__spec__", None)
        file = getattr(module, "__file__", None)
        foreign = file is not None and not Path(file).is_relative_to(place)
        if foreign and specification is not None and specification.name == name:
            names.append(name)
    return [name for name in names if name.partition(".")[0] not in OWN]
