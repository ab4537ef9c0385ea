"""A thread that Python did not begin, calling into Python more than once."""

import ctypes
import threading
from collections.abc import Callable

from numba import cfunc, types

from hal.vehicle.native_thread import NativeThreads

_CALLS = 3


def in_a_native_thread(call: Callable[[], None]) -> None:
    """Begin a thread without Python, that calls `call` three times and ends."""
    called = ctypes.CFUNCTYPE(None)(call)

    @cfunc(types.voidptr(types.voidptr))
    def calls(nothing: object) -> object:
        for _ in range(_CALLS):
            called()
        return nothing

    libc = ctypes.CDLL(None)
    thread = ctypes.c_void_p()
    begin = ctypes.c_void_p(calls.address)
    assert libc.pthread_create(ctypes.byref(thread), None, begin, None) == 0
    assert libc.pthread_join(thread, None) == 0


def visits(before_each: Callable[[], None]) -> list[int]:
    """How often the thread had been there before, as far as Python remembers."""
    place, seen = threading.local(), []

    def call() -> None:
        before_each()
        seen.append(getattr(place, "visits", 0))
        place.visits = seen[-1] + 1

    in_a_native_thread(call)
    return seen


def test_python_forgets_a_native_thread_after_every_call() -> None:
    assert visits(lambda: None) == [0, 0, 0]


def test_a_kept_thread_is_known_from_its_first_call_on() -> None:
    assert visits(NativeThreads().keep) == [0, 1, 2]


def test_every_thread_is_kept_for_itself() -> None:
    threads = NativeThreads()
    assert visits(threads.keep) == [0, 1, 2]
    assert visits(threads.keep) == [0, 1, 2]


def test_a_thread_of_pythons_own_may_ask_as_well() -> None:
    threads = NativeThreads()
    threads.keep()
    threads.keep()
    assert threads.kept
