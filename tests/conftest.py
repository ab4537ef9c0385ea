"""A test that leaves a task or a thread behind fails: in flight nobody would clean up after it."""

import asyncio
import functools
import inspect
import os
import signal
import tempfile
import threading
from collections.abc import Awaitable, Callable, Iterator
from typing import Any

import pytest

THREAD_GRACE_S = 2.0
_TERMINAL = ("NO_COLOR", "FORCE_COLOR", "COLUMNS", "LINES", "TTY_COMPATIBLE", "TTY_INTERACTIVE")


def pytest_configure(config: pytest.Config) -> None:
    """Tests, and the programs that they start, see one terminal and one Ctrl-C on every machine.

    A shell without job control starts what runs in the background with SIGINT ignored, and
    children inherit that. What is left in the temporary folder goes with the run; pytest's own
    `tmp_path` stays where it was, to be looked at.
    """
    if "PYTEST_XDIST_WORKER" not in os.environ:
        os.environ.setdefault("PYTEST_DEBUG_TEMPROOT", tempfile.gettempdir())
        folder = tempfile.TemporaryDirectory(prefix="autonomy-tests-", ignore_cleanup_errors=True)
        config.add_cleanup(folder.cleanup)
        os.environ["TMPDIR"] = tempfile.tempdir = folder.name
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    os.environ["TERM"] = "xterm-256color"
    for name in _TERMINAL:
        os.environ.pop(name, None)


@pytest.fixture(autouse=True)
def no_thread_is_left_behind() -> Iterator[None]:
    """Fails a test after which a non-daemon thread still runs.

    An autouse fixture is finished last, hence after the event loop has closed its executor.
    """
    before = set(threading.enumerate())
    yield
    left = [t for t in threading.enumerate() if t not in before and not t.daemon]
    for thread in left:
        thread.join(THREAD_GRACE_S)
    names = [thread.name for thread in left if thread.is_alive()]
    if names:
        pytest.fail(f"threads left running: {', '.join(names)}")


def _without_leaks(test: Callable[..., Awaitable[None]]) -> Callable[..., Awaitable[None]]:
    """`test`, failing when it ends with tasks that were not there when it began."""

    @functools.wraps(test)
    async def watched(*args: Any, **kwargs: Any) -> None:
        before = asyncio.all_tasks()
        await test(*args, **kwargs)
        await asyncio.sleep(0)  # a task that was told its end in the last step may still take it
        names = sorted(task.get_name() for task in asyncio.all_tasks() - before if not task.done())
        if names:
            pytest.fail(f"tasks left running: {', '.join(names)}")

    return watched


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    """Watch every coroutine test. The loop itself would cancel what is left, and nobody knew."""
    if isinstance(item, pytest.Function) and inspect.iscoroutinefunction(item.obj):
        item.obj = _without_leaks(item.obj)
