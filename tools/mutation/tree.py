"""A copy of the project that mutants live in, and the processes that test them there.

pytest, numpy, numba and all else that is not the project's take longer to import than most tests
to run. They are imported once; every mutant's tests then run in a fork, which imports the project
itself anew.
"""

import importlib
import multiprocessing
import os
import resource
import shutil
import subprocess
import sys
from collections.abc import Callable
from multiprocessing.connection import Connection
from pathlib import Path

import hypothesis
import pytest

COPIED = ("autonomy", "hal", "tools", "tests", "configs", "pyproject.toml", "README.md")
OWN = frozenset(("autonomy", "hal", "tools", "tests", "conftest"))
OPTIONS = ("-x", "-q", "-p", "no:cacheprovider", "-p", "no:xdist", "-W", "ignore")
MEMORY_MAX_BYTES = 6 << 30
"""A mutant that never stops collecting ends here."""

_fork = multiprocessing.get_context("fork")


class Tree:
    """A copy of the parts of `root` that the tests need. Belongs to one process."""

    def __init__(self, root: Path, place: Path) -> None:
        self.place = place
        for name in COPIED:
            source = root / name
            if source.is_dir():
                ignored = shutil.ignore_patterns("__pycache__", "*.png")
                shutil.copytree(source, place / name, ignore=ignored)
            elif source.exists():
                shutil.copy2(source, place / name)
        self._cpu_limit_s = 600.0

    def try_unmutated(self, tests: tuple[str, ...]) -> None:
        """Run the tests as they are, and learn from it what they import and how long they take.

        The first of the two runs also compiles what numba keeps. SystemExit with pytest's words
        when they fail.
        """
        command = [sys.executable, "-m", "pytest", *OPTIONS, *tests]
        environment = os.environ | {"PYTHONPATH": str(self.place)}
        done = subprocess.run(
            command, cwd=self.place, env=environment, capture_output=True, text=True, check=False
        )
        if done.returncode:
            raise SystemExit(f"the tests fail without any mutation:\n{done.stdout}{done.stderr}")
        receiver, sender = _fork.Pipe(duplex=False)
        if not self.passes(tests, lambda: _send_imports(sender, self.place)):
            raise SystemExit("the tests fail without any mutation, in a fork")
        for name in receiver.recv():
            importlib.import_module(name)
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        self.passes(tests)
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
        self._cpu_limit_s = 3.0 + 3.0 * (after.ru_utime - before.ru_utime)

    def passes(self, tests: tuple[str, ...], then: Callable[[], None] | None = None) -> bool:
        """Whether the tests pass, in a fork; False too when they take far longer than before."""
        process = _fork.Process(target=self._run, args=(tests, then))
        process.start()
        # Time counts as the tests' own, not as the machine's; this one is for what sleeps.
        process.join(60.0 + 20.0 * self._cpu_limit_s)
        if process.is_alive():
            process.kill()
            process.join()
        passed = process.exitcode == 0
        process.close()
        return passed

    def _run(self, tests: tuple[str, ...], then: Callable[[], None] | None) -> None:
        limit_s = int(self._cpu_limit_s)
        resource.setrlimit(resource.RLIMIT_CPU, (limit_s, limit_s))
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY_MAX_BYTES, MEMORY_MAX_BYTES))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        silence = os.open(os.devnull, os.O_RDWR)
        for stream in range(3):
            os.dup2(silence, stream)
        os.chdir(self.place)
        # Two mutants of equal length in one second would share their byte code.
        sys.dont_write_bytecode = True
        for name in [name for name in sys.modules if name.partition(".")[0] in OWN]:
            del sys.modules[name]
        sys.path.insert(0, str(self.place))
        code = _tested(tests)
        if then is not None:
            then()
        os._exit(code)


def _tested(tests: tuple[str, ...]) -> int:
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
    return int(pytest.main([*OPTIONS, *tests]))


def _send_imports(sender: Connection, place: Path) -> None:
    """The names of all modules that are loaded and not the project's."""
    names = []
    for name, module in list(sys.modules.items()):
        specification = getattr(module, "__spec__", None)
        file = getattr(module, "__file__", None)
        foreign = file is not None and not Path(file).is_relative_to(place)
        if foreign and specification is not None and specification.name == name:
            names.append(name)
    sender.send([name for name in names if name.partition(".")[0] not in OWN])
