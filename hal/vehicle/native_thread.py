"""Keep what the interpreter knows of a thread that a native library calls back from.

Python makes the state of such a thread anew for every callback and throws it away behind it: two
maps and unmaps of memory, and a quarter of what a callback takes (measured with MAVSDK's callback
thread at 400 messages a second).
"""

import ctypes
import threading


class NativeThreads(threading.local):
    """One claim for each native thread that calls `keep`; what is thread-local then lasts too.

    The state lives as long as the interpreter: some 20 KB for every thread ever kept, so this is
    for a library's few long-lived threads. Threads of Python's own lose nothing by it.
    """

    kept = False

    def keep(self) -> None:
        """Called in a callback: the state of this thread outlives the callback."""
        if not self.kept:
            # One more claim than the callback itself has, and never given back.
            ctypes.pythonapi.PyGILState_Ensure()
            self.kept = True
