"""The log of a program that flies: whoever has something to say never waits for who reads it.

A terminal that was stopped (Ctrl-S), a pager that is not scrolled, a journal that stands still: a
write to any of them waits, and with `logging`'s own handlers every other thread waits behind it,
the control loop, the autopilot's link and the deadman among them.
"""

import contextlib
import logging
import os
import threading
from collections.abc import Iterator
from logging.handlers import QueueHandler
from queue import Full, Queue

LINES_KEPT = 1000
"""Lines that wait for a reader; what is more is counted and left out."""
_LAST_WORDS_S = 2.0
_STDERR = 2


@contextlib.contextmanager
def patient_log(level: int = logging.INFO, descriptor: int = _STDERR) -> Iterator[None]:
    """Inside, what is logged leaves through `descriptor` on a thread of its own.

    At the end what is left has two seconds to be read; then the program goes on without.
    """
    root = logging.getLogger()
    lines: Queue[logging.LogRecord | None] = Queue(LINES_KEPT)
    handler = _Queued(lines)
    handler.setFormatter(logging.Formatter("%(levelname)s %(message)s"))
    writer = threading.Thread(
        target=_write_all, args=(handler, descriptor), name="log", daemon=True
    )
    before = root.level
    root.setLevel(level)
    root.addHandler(handler)
    writer.start()
    try:
        yield
    finally:
        root.removeHandler(handler)
        root.setLevel(before)
        with contextlib.suppress(Full):  # nobody reads: the writer is a daemon
            lines.put(None, timeout=_LAST_WORDS_S)
            writer.join(_LAST_WORDS_S)


class _Queued(QueueHandler):
    """Hands records over, and counts those for which there was no room."""

    queue: Queue[logging.LogRecord | None]

    def __init__(self, lines: Queue[logging.LogRecord | None]) -> None:
        super().__init__(lines)
        self.left_out = 0

    def enqueue(self, record: logging.LogRecord) -> None:
        """Called under the handler's lock; returns at once."""
        try:
            self.queue.put_nowait(record)
        except Full:
            self.left_out += 1


def _write_all(handler: _Queued, descriptor: int) -> None:
    """Until the end is in the queue. What cannot be written (a closed pipe) is nobody's loss."""
    told = 0
    while (record := handler.queue.get()) is not None:
        text = f"{record.getMessage()}\n"
        if handler.left_out > told:
            text += f"WARNING {handler.left_out - told} lines were left out: nobody read them\n"
            told = handler.left_out
        with contextlib.suppress(OSError):
            _write(descriptor, text.encode(errors="backslashreplace"))


def _write(descriptor: int, data: bytes) -> None:
    """Past Python's own stream, whose lock would keep the interpreter from ending."""
    while data:
        data = data[os.write(descriptor, data) :]
