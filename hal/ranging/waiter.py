"""How a driver's own thread lets time pass, so that tests can give it theirs."""

import threading
import time
from typing import Protocol


class Waiter(Protocol):
    """How the driver's thread lets time pass."""

    def wait(self, seconds: float) -> bool:
        """Wait, at most; True as soon as the thread is to end."""
        ...

    def pause(self, seconds: float) -> None:
        """Wait within a transaction of some milliseconds."""
        ...

    def stop(self) -> None:
        """Tell the thread to end; for any thread."""
        ...


class ThreadWaiter:
    """`Waiter` in the machine's own time."""

    def __init__(self) -> None:
        self._stopped = threading.Event()

    def wait(self, seconds: float) -> bool:
        """Wait, at most; True as soon as the thread is to end."""
        return self._stopped.wait(seconds)

    def pause(self, seconds: float) -> None:
        """Wait within a transaction of some milliseconds."""
        time.sleep(seconds)

    def stop(self) -> None:
        """Tell the thread to end."""
        self._stopped.set()
