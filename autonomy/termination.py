"""The signals that ask this program to end tidily."""

import contextlib
import signal
from collections.abc import Callable, Iterator
from types import FrameType


def termination_signals() -> tuple[signal.Signals, ...]:
    """Ctrl-C, `kill`, and the terminal that goes away (a dropped ssh session) unless the person
    who started this program had it ignored, as nohup does.
    """
    if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:
        return (signal.SIGINT, signal.SIGTERM)
    return (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


@contextlib.contextmanager
def termination_waits() -> Iterator[Callable[[], None]]:
    """Inside, `termination_signals` take effect at the next call of what it gives, or at the end.

    They raise KeyboardInterrupt then. For native code that calls back: what a signal raises in a
    callback is lost there, and the compiler that called fails later of something else.
    """
    came: list[int] = []

    def remember(number: int, _: FrameType | None) -> None:
        came.append(number)

    def take_effect() -> None:
        if came:
            raise KeyboardInterrupt

    before = {number: signal.signal(number, remember) for number in termination_signals()}
    try:
        yield take_effect
    finally:
        for number, previous in before.items():
            signal.signal(number, previous)
    take_effect()
