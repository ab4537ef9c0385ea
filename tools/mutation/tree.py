"""A copy of the project, and the processes that test mutants in it.

To import everything and to collect the tests takes longer than to run them. So one process of
each tree imports and collects once, and shows its tests every mutant (`collected`). Only a mutant
in the body of a class is written into the tree: a fork of this process, which has imported nothing
but what is not the project's, begins from there.
"""

import importlib
import multiprocessing
import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import hypothesis
import pytest

from tools.mutation.collected import OWN, Collected, set_limits

COPIED = ("autonomy", "hal", "tools", "tests", "configs", "pyproject.toml", "README.md")
OPTIONS = (
    *("-x", "-q", "-p", "no:cacheprovider", "-p", "no:xdist", "-W", "ignore"),
    # What would be told of a failure is not read.
    *("--assert=plain", "--tb=line"),
)
PATIENCE = 5.0
"""Tests that take this many times longer have noticed something."""
LEAST_CPU_S = 3.0
IMPORT_CPU_S = 60.0

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
        collected = Collected((self._ear, voice), module, place, self.original)
        self._server = _fork.Process(target=_serve, args=(place, tests, collected), daemon=True)
        self._server.start()
        # Only the server holds it now: where that ends, this process hears of it.
        voice.close()
        for foreign in self._ear.recv():
            importlib.import_module(foreign)
        self._cpu_limit_s = 600.0
        # Without functions or lines that differ everything is run.
        passed, cpu_s = self._ask(self.original, frozenset())
        if not passed:
            raise SystemExit("the tests fail without any mutation when they are run in a fork")
        self._cpu_limit_s = LEAST_CPU_S + PATIENCE * cpu_s

    def passes(self, source: str, lines: frozenset[int]) -> bool:
        """Whether the tests pass with `source` as the module; False too when they hang.

        lines: numbers of those in which it differs from the original.
        """
        passed, _ = self._ask(source, lines)
        return self._passes_anew(source) if passed is None else passed

    def close(self) -> None:
        """End the process that collected the tests."""
        self._ear.close()
        self._server.join()

    def _ask(self, source: str, lines: frozenset[int]) -> tuple[bool | None, float]:
        self._ear.send((source, lines, self._cpu_limit_s))
        passed, cpu_s = self._ear.recv()
        return passed, cpu_s

    def _passes_anew(self, source: str) -> bool:
        """All of the project imported again, the mutant with it."""
        self._module.write_text(source)
        try:
            arguments = (self._place, self._tests, self._cpu_limit_s + IMPORT_CPU_S)
            process = _fork.Process(target=_import_and_test, args=arguments)
            process.start()
            process.join()
            return process.exitcode == 0
        finally:
            self._module.write_text(self.original)


def _run_once(place: Path, tests: tuple[str, ...]) -> None:
    command = [sys.executable, "-m", "pytest", *OPTIONS, *tests]
    environment = os.environ | {"PYTHONPATH": str(place)}
    done = subprocess.run(
        command, cwd=place, env=environment, capture_output=True, text=True, check=False
    )
    if done.returncode:
        raise SystemExit(f"the tests fail without any mutation:\n{done.stdout}{done.stderr}")


def _serve(place: Path, tests: tuple[str, ...], collected: Collected) -> None:
    _enter(place)
    os._exit(_tested(tests, collected))


def _import_and_test(place: Path, tests: tuple[str, ...], cpu_limit_s: float) -> None:
    _enter(place)
    set_limits(cpu_limit_s)
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


def _tested(tests: tuple[str, ...], *plugins: Collected) -> int:
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
