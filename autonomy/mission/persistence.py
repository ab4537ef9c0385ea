"""Faults over time: what lasts, what is really over, and what comes and goes too often. Pure."""

from collections import deque

import msgspec

from autonomy.config import Config
from autonomy.mission.failsafe import RULES, Fault, Found, response_to


class Persistence:
    """Fed with the faults of every tick; gives back those that count.

    A fault counts once it was present for its row's `confirm_s`, and until it was absent for its
    `clear_s`. One that began `failsafe.flapping_holds` times within `failsafe.flapping_window_s`
    has the next response of the escalation from then on.
    """

    def __init__(self, config: Config) -> None:
        self._config = config
        self._since_s: dict[Fault, float] = {}
        """When each fault that is present, or not over yet, began."""
        self._seen: dict[Fault, tuple[float, Found]] = {}
        """When and how each fault was last found."""
        self._begun_s: dict[Fault, deque[float]] = {}
        self._flapping: set[Fault] = set()

    def begun(self, fault: Fault) -> int:
        """How often a fault has begun within the window."""
        return len(self._begun_s.get(fault, ()))

    def step(self, now_s: float, found: tuple[Found, ...]) -> tuple[Found, ...]:
        """The faults that count at `now_s`, strongest response first."""
        if not found and not self._seen:
            return ()
        for item in found:
            if item.fault not in self._since_s:
                self._since_s[item.fault] = now_s
            self._seen[item.fault] = (now_s, item)
        for fault, (seen_s, _) in tuple(self._seen.items()):
            # Half a tick of rounding must not keep a fault for another tick.
            if now_s - seen_s > RULES[fault].clear_s - 1e-9 and seen_s < now_s:
                del self._seen[fault], self._since_s[fault]
        counted = [
            self._escalated(now_s, item)
            for fault, (_, item) in self._seen.items()
            if now_s - self._since_s[fault] >= RULES[fault].confirm_s - 1e-9
        ]
        return tuple(sorted(counted, key=lambda item: -item.response))

    def _escalated(self, now_s: float, item: Found) -> Found:
        """The fault with the response that its frequency asks for."""
        fault = item.fault
        if RULES[fault].flapping is None:
            return item
        limits = self._config.failsafe
        begun = self._begun_s.setdefault(fault, deque(maxlen=limits.flapping_holds))
        if not begun or begun[-1] != self._since_s[fault]:
            begun.append(self._since_s[fault])
        while now_s - begun[0] > limits.flapping_window_s and len(begun) > 1:
            begun.popleft()
        if len(begun) == limits.flapping_holds:
            self._flapping.add(fault)
        if fault not in self._flapping:
            return item
        times = f"{limits.flapping_holds} times within {limits.flapping_window_s:g} s"
        return msgspec.structs.replace(
            item,
            why=f"{item.why}, {times}",
            response=response_to(self._config, fault, flapping=True),
        )
