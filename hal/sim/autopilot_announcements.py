"""What the autopilot says: status texts and events, queued until the wire takes them."""

from collections import deque

from hal.sim.px4 import AutopilotText, Severity
from hal.sim.px4_events import AutopilotEvent, EventKind

_KEPT = 256


class Announcements:
    """Status texts and events, oldest first; who sends them empties the queues."""

    def __init__(self) -> None:
        self.texts: deque[AutopilotText] = deque(maxlen=_KEPT)
        self.events: deque[AutopilotEvent] = deque(maxlen=_KEPT)
        self.event_sequence = 0
        """The number of the last event, 16 bit."""

    def say(self, at_s: float, severity: Severity, text: str) -> None:
        """Queue a status text."""
        self.texts.append(AutopilotText(at_s, severity, text))

    def report(self, at_s: float, kind: EventKind, *arguments: float) -> None:
        """Queue an event."""
        self.event_sequence = (self.event_sequence + 1) & 0xFFFF
        self.events.append(AutopilotEvent.of(at_s, self.event_sequence, kind, *arguments))

    def restart(self) -> None:
        """The autopilot starts anew: it counts events from 0; what is queued stays."""
        self.event_sequence = 0
