"""Faults over time: what lasts, what is really over, and what comes and goes too often. Pure."""

from collections import deque

import msgspec

from autonomy.config import Config
from autonomy.mission.failsafe import RULES, Fault, Found, response_to

_MOST = 0.5
"""Of the window: what counts for longer, though never for long, never lets a mission go on."""


class Persistence:
    """Fed with the faults of every tick; gives back those that count.

    A fault counts once it was present for its row's `confirm_s`, and until it was absent for its
    `clear_s`. One that began `failsafe.flapping_holds` times within `failsafe.flapping_window_s`
    has the next response of the escalation from then on; so has one that counted for half of that
    window although it went away in between (one that stays is its own row's, `..._long`).
    """

    def __init__(self, config: Config) -> None:
        self._config = config
        self._since_s: dict[Fault, float] = {}
        """When each fault that is present, or not over yet, began."""
        self._seen: dict[Fault, tuple[float, Found]] = {}
        """When and how each fault was last found."""
        self._begun_s: dict[Fault, deque[float]] = {}
        self._broken: set[Fault] = set()
        """Faults that are not over, but were away for a moment since they began."""
        self._counted: dict[Fault, deque[tuple[float, float]]] = {}
        """From when to when it counted, newest last, without the present time."""
        self._flapping: dict[Fault, str] = {}
        """How often, or for how long, it was there when it was too much."""

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
                self._over(fault, seen_s)
            elif seen_s < now_s:
                self._broken.add(fault)
        counted = [
            self._escalated(now_s, item)
            for fault, (_, item) in self._seen.items()
            if now_s - self._since_s[fault] >= RULES[fault].confirm_s - 1e-9
        ]
        return tuple(sorted(counted, key=lambda item: -item.response))

    def _over(self, fault: Fault, seen_s: float) -> None:
        """It went away; when it counted is remembered where that may escalate."""
        since_s = self._since_s.pop(fault)
        del self._seen[fault]
        self._broken.discard(fault)
        if RULES[fault].flapping is not None:
            limit = self._config.failsafe.flapping_holds
            self._counted.setdefault(fault, deque(maxlen=limit)).append((since_s, seen_s))

    def _counted_s(self, fault: Fault, now_s: float) -> float:
        """For how long within the window it counted; 0 for one that has stayed all the time."""
        from_s = now_s - self._config.failsafe.flapping_window_s
        before_s = sum(
            max(0.0, end_s - max(from_s, begin_s))
            for begin_s, end_s in self._counted.get(fault, ())
        )
        if before_s == 0.0 and fault not in self._broken:
            return 0.0
        return before_s + now_s - max(from_s, self._since_s[fault])

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
        window_s = limits.flapping_window_s
        if len(begun) == limits.flapping_holds:
            self._flapping[fault] = f"{limits.flapping_holds} times within {window_s:g} s"
        elif self._counted_s(fault, now_s) > _MOST * window_s:
            self._flapping[fault] = f"on and off for {_MOST * window_s:g} of {window_s:g} s"
        times = self._flapping.get(fault)
        if times is None:
            return item
        return msgspec.structs.replace(
            item,
            why=f"{item.why}, {times}",
            response=response_to(self._config, fault, flapping=True),
        )
