"""Compile every numba kernel before anything is armed: nothing is ever compiled in the air."""

import atexit
import gc
import os
import sys
import time
from collections.abc import Callable, Iterator
from typing import Any

from numba.core import event
from numba.core.dispatcher import Dispatcher

from autonomy.estimation import kernels as estimation
from autonomy.kernel_cache import VARIABLE, is_temporary
from autonomy.perception import kernels as perception
from autonomy.perception.doubt import kernels as doubt
from autonomy.t3drm import kernels as t3drm
from autonomy.t3drm import planner

_NOTE_EVERY_S = 5.0


def warm_up(note: Callable[[str], None] | None = None) -> None:
    """Compile, or load from numba's cache, what the flight calls.

    The first start on a machine compiles for half a minute and more, later ones load in a second.
    `note` is told a sentence now and then while something is compiled, else nothing.
    """
    compiling = _Compiling(note if note is not None else lambda _: None)
    with event.install_listener("numba:compile", compiling):
        _call_all()
    compiling.finish()
    _settle()


def load_compiled() -> bool:
    """`warm_up` where nothing has to be compiled; else False, before anything is.

    Compiling takes hundreds of MB that the process keeps: who must stay small lets
    `python -m autonomy.warm` do it.
    """
    try:
        with event.install_listener("numba:compile", _Refusing()):
            _call_all()
    except _NotCompiledError:
        return False
    _settle()
    return True


def kernels() -> Iterator[Dispatcher]:
    """Every kernel that flies, with what it was compiled for."""
    for module in (estimation, perception, doubt, t3drm):
        yield from (each for each in vars(module).values() if isinstance(each, Dispatcher))


def _call_all() -> None:
    estimation.warm_up()
    perception.warm_up()
    doubt.warm_up()
    planner.warm_up()


def _settle() -> None:
    keep_what_is_loaded()
    atexit.register(gc.unfreeze)  # some libraries complain of what is left at the end


def keep_what_is_loaded() -> None:
    """What lives by now lives to the end: the garbage collector looks through it no more.

    That took longer than a tick, once or twice in a flight. What the compiler left is garbage:
    it is collected first, or it would be kept, too.
    """
    gc.collect()
    gc.freeze()


class _NotCompiledError(Exception):
    """A kernel is not in numba's cache."""


class _Refusing(event.Listener):  # type: ignore[misc, unused-ignore]  # numba is untyped
    """Lets numba compile nothing."""

    def on_start(self, _: Any) -> None:
        """numba is about to compile a function; raises _NotCompiledError instead."""
        raise _NotCompiledError

    def on_end(self, _: Any) -> None:
        """Never comes: nothing begins."""


class _Compiling(event.Listener):  # type: ignore[misc, unused-ignore]  # numba is untyped
    """Hears what numba compiles; kernels that call others begin before and end after them."""

    def __init__(self, note: Callable[[str], None]) -> None:
        self._note = note
        self._waiting = {kernel.py_func for kernel in kernels()}
        self._total = len(self._waiting)
        self._began_s: float | None = None
        self._next_s = 0.0

    def on_start(self, _: Any) -> None:
        """numba begins to compile a function; the first one is worth a sentence."""
        if self._began_s is None:
            self._began_s = time.monotonic()
            self._next_s = self._began_s + _NOTE_EVERY_S
            when = (
                f"at every start: no folder for them may be written, name one in {VARIABLE}"
                if is_temporary(os.environ)
                else "at the first start only"
            )
            self._note(f"compiling {self._total} kernels, {when}")

    def on_end(self, ended: Any) -> None:
        """numba has compiled a function, one of ours or what it needs of its own."""
        self._waiting.discard(ended.data["dispatcher"].py_func)
        now_s = time.monotonic()
        if now_s >= self._next_s:
            self._next_s = now_s + _NOTE_EVERY_S
            self._note(f"compiled {self._total - len(self._waiting)} of {self._total} kernels")

    def finish(self) -> None:
        """Say how long it took, when there was something to say."""
        if self._began_s is not None:
            self._note(f"kernels compiled in {time.monotonic() - self._began_s:.0f} s")


def main() -> int:
    """Compile into numba's cache, for a process that then loads it; says on standard output how
    far it is, a sentence a line.
    """
    warm_up(lambda sentence: print(sentence, flush=True))
    return 0


if __name__ == "__main__":
    sys.exit(main())
