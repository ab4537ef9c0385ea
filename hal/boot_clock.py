"""Another computer's clock, learned from what it sends: whose times are believed, and as which."""

import math


class BootClock:
    """The clock since boot of who sends, on this machine's monotonic axis.

    What is received is never early, so the least of (reception - boot time) over the last one to
    two seconds is the offset with the least waiting in it: jitter of the link and of this process
    goes, its shortest delay stays. Forgetting follows a clock that runs at another rate: a
    simulated autopilot loses up to 20 ms/s, and by no more than that may the offset rise. What
    rises faster is a link that became slow: its messages are old, and stay so until the clock
    could really have lost as much.

    A clock that leaps, back or ahead, was restarted, or somebody repeats old messages or makes new
    ones up. A restart is believed when the new time goes on for 0.3 s and nobody speaks in the old.
    """

    WINDOW_S = 1.0
    DRIFT_S_PER_S = 0.02
    LEAP_S = 1.0
    INSISTS_S = 0.3

    def __init__(self) -> None:
        self._boot_s = -math.inf
        self._window_ends_s = -math.inf
        self._claim: tuple[float, float] | None = None
        """(reception, boot time) of the first message of another time."""
        self._least_s = self._least_before_s = self._ceiling_s = math.inf
        self._noted_s = -math.inf
        self.restarts = 0

    def note(self, received_s: float, boot_s: float) -> float | None:
        """Learn from one message; its stamp, or None when its time leapt."""
        if self._leaps(received_s, boot_s):
            if not self._insists(received_s, boot_s):
                return None
            self._least_s = self._least_before_s = self._ceiling_s = math.inf
            self._boot_s = boot_s
            self.restarts += 1
        self._claim = None
        self._boot_s = max(self._boot_s, boot_s)
        offset_s = received_s - boot_s
        if received_s >= self._window_ends_s:
            self._window_ends_s = received_s + self.WINDOW_S
            self._least_before_s, self._least_s = self._least_s, math.inf
        self._least_s = min(self._least_s, offset_s)
        if self._ceiling_s < math.inf:
            self._ceiling_s += self.DRIFT_S_PER_S * max(0.0, received_s - self._noted_s)
        self._ceiling_s = min(self._ceiling_s, offset_s)
        self._noted_s = received_s
        return self.stamp_s(received_s, boot_s)

    def stamp_s(self, received_s: float, boot_s: float) -> float:
        """When `boot_s` was, however long ago: never after `received_s`, which it is before
        anything was heard.
        """
        return min(received_s, boot_s + self._offset_s())

    def _offset_s(self) -> float:
        return min(self._least_s, self._least_before_s, self._ceiling_s)

    def _leaps(self, received_s: float, boot_s: float) -> bool:
        """True when it was sent long before what was heard last, or in the future."""
        if self._boot_s == -math.inf:
            return False
        ahead_s = boot_s + self._offset_s() - received_s
        return boot_s < self._boot_s - self.LEAP_S or ahead_s > self.LEAP_S

    def _insists(self, received_s: float, boot_s: float) -> bool:
        """True when the other time has gone on like a clock since it was first claimed."""
        if self._claim is not None:
            began_s, began_boot_s = self._claim
            passed_s = received_s - began_s
            if abs(boot_s - began_boot_s - passed_s) <= self.LEAP_S:
                return passed_s >= self.INSISTS_S
        self._claim = (received_s, boot_s)
        return False


class SendingOrder:
    """One sender's clock, and the newest that it sent."""

    def __init__(self) -> None:
        self._clock = BootClock()
        self._restarts = 0
        self._newest_s = -math.inf

    def keeps(self, received_s: float, sent_s: float) -> bool:
        """False for what was sent before the newest, or at a time that is not believed."""
        if self._clock.note(received_s, sent_s) is None:
            return False
        if self._clock.restarts != self._restarts:
            self._restarts, self._newest_s = self._clock.restarts, -math.inf
        in_order = sent_s >= self._newest_s
        self._newest_s = max(self._newest_s, sent_s)
        return in_order
