"""The fixed ladder from a failure to plan to the verdict "unreachable". Pure."""

from enum import StrEnum


class Rung(StrEnum):
    """What a failure leads to; the words are told to people, followed by what is forgotten."""

    LOOK_AGAIN = "looking again"
    FORGET_NEARBY = "forgetting everything within"
    FORGET_ALL = "forgetting the map"
    VERDICT = "the goal cannot be reached"


class Ladder:
    """Counts the failures of one flight. Nothing resets the count, so every flight ends.

    What is tried before a rung (`Navigation._out_by_the_way_in`) has a count of its own.
    """

    def __init__(self, attempts: int) -> None:
        """`attempts` rungs: a third of the way up what is near is forgotten, at two thirds all, and
        once more before the last look: a verdict rests on one map of now, of the goal's height.

        Raises ValueError below 3: every rung has its place.
        """
        if attempts < 3:
            raise ValueError(f"a ladder needs at least 3 attempts, not {attempts}")
        self._attempts = attempts
        self._failures = 0

    @property
    def failures(self) -> int:
        """How many there were."""
        return self._failures

    def climb(self) -> Rung:
        """One more failure; what to do about it. VERDICT from the last rung on."""
        self._failures += 1
        if self._failures >= self._attempts:
            return Rung.VERDICT
        if self._failures == self._attempts // 3:
            return Rung.FORGET_NEARBY
        if self._failures in (2 * self._attempts // 3, self._attempts - 1):
            return Rung.FORGET_ALL
        return Rung.LOOK_AGAIN
