"""What was looked at before flying: sentences for people, records for programs."""

import msgspec


class Fix(msgspec.Struct, frozen=True):
    """A parameter of the autopilot that would be better with another value."""

    name: str
    old: float
    new: float
    integer: bool

    def value(self, number: float) -> int | float:
        """`number` as the parameter's own type."""
        return round(number) if self.integer else number


class Finding(msgspec.Struct, frozen=True):
    """One thing that was looked at. Not `good` and `grave`: do not fly; else it is advice.

    `fix` is what would mend it; of a `good` one, what was set.
    """

    good: bool
    sentence: str
    grave: bool = True
    subject: str = ""
    fix: Fix | None = None

    @property
    def bad(self) -> bool:
        """True for what has to be mended before flying."""
        return self.grave and not self.good

    def __str__(self) -> str:
        """A line for a terminal."""
        mark = "ok  " if self.good else "BAD " if self.grave else "note"
        return f"{mark} {self.sentence}"


def ok(sentence: str, subject: str = "") -> Finding:
    """Nothing to mend."""
    return Finding(good=True, sentence=sentence, subject=subject)


def bad(sentence: str, subject: str = "") -> Finding:
    """To be mended before flying."""
    return Finding(good=False, sentence=sentence, subject=subject)


def note(sentence: str, subject: str = "") -> Finding:
    """Advice."""
    return Finding(good=False, sentence=sentence, grave=False, subject=subject)
