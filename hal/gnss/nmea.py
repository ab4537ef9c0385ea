"""NMEA sentences of one epoch to a solution; the one door to pynmeagps.

Source of the fields: NMEA 0183 as in u-blox's interface description, GGA, RMC, GST, GSA. An epoch
is the sentences that carry the same UTC time of day. Sentences come checked from `framing`.
"""

import math
from collections import deque
from datetime import time
from typing import Any

from hal.gnss.autopilot_gnss import NO_POSITION_ACCURACY_M
from hal.gnss.solution import Solution
from hal.readings import FixType

DAY_S = 86_400.0
DILUTIONS_MAX_AGE_S = 2.5
"""GSA carries no time: it belongs to the epochs around it, also at 1 Hz."""
VERTICAL_RATIO = 1.5
"""Vertical over horizontal dilution where VDOP is not sent: satellites are only above."""
EPOCHS_REMEMBERED = 3
"""A kind that did not come in so many epochs is no longer waited for."""
_TIMED = frozenset({"GGA", "RMC", "GST"})
_READ = _TIMED | {"GSA"}
_QUALITIES = {
    1: FixType.FIX_3D,
    2: FixType.DGPS,
    3: FixType.FIX_3D,  # PPS: no better than its accuracy says
    4: FixType.RTK_FIXED,
    5: FixType.RTK_FLOAT,
    # 6 dead reckoning, 7 typed in, 8 simulated: no satellite behind them.
}

Fields = dict[str, Any]


def load() -> None:
    """Load the library, which takes longer than a sentence may wait; raises ImportError."""
    import pynmeagps.exceptions  # noqa: F401 - only a vehicle with such a receiver needs it


def is_read(sentence: bytes) -> bool:
    """True for the sentences that a solution is made of, from any constellation's talker."""
    return sentence[3:6].decode("ascii", "replace") in _READ


def parse(sentence: bytes) -> Fields | None:
    """The sentence's fields by pynmeagps' names; None when they cannot be read."""
    from pynmeagps import NMEAReader
    from pynmeagps.exceptions import NMEAMessageError, NMEAParseError, NMEATypeError

    try:
        message = NMEAReader.parse(sentence)
    except (
        NMEAMessageError,
        NMEAParseError,
        NMEATypeError,
        ValueError,
        TypeError,
        AttributeError,
        LookupError,
    ):
        return None
    if message is None or message.msgID not in _READ:
        return None
    return {"msgID": message.msgID} | {
        name: value for name, value in vars(message).items() if not name.startswith("_")
    }


class Epochs:
    """Gathers the sentences of an epoch and tells its solution once.

    That is as soon as all kinds have come that the epochs before had; else with the first sentence
    of the next epoch, or when the line falls silent. So one sentence's veto is heard before
    another's position is told.
    """

    def __init__(self, range_error_m: float) -> None:
        self._range_error_m = range_error_m
        self._kinds: deque[frozenset[str]] = deque([_TIMED], maxlen=EPOCHS_REMEMBERED)
        self._parts: dict[str, Fields] = {}
        self._time_s: float | None = None
        self._began_s = 0.0
        self._told = False
        self._dilutions: Fields = {}
        self._dilutions_s = -math.inf

    def take(self, fields: Fields, received_s: float) -> list[Solution]:
        """The solutions that this sentence completes: of the epoch before, of its own, or none."""
        kind = fields["msgID"]
        if kind == "GSA":
            self._dilutions, self._dilutions_s = fields, received_s
            return []
        solutions = []
        time_s = _time_of_day_s(fields)
        if time_s != self._time_s or kind in self._parts:
            solutions += self.end()
            self._time_s, self._began_s = time_s, received_s
        self._parts[kind] = fields
        if frozenset().union(*self._kinds) <= self._parts.keys():
            solutions += self._tell()
        return solutions

    def end(self) -> list[Solution]:
        """The epoch is over: its solution, if it has one that was not told."""
        solutions = self._tell()
        if self._parts:
            self._kinds.append(frozenset(self._parts))
        self._parts = {}
        self._told = False
        return solutions

    def _tell(self) -> list[Solution]:
        if self._told or "GGA" not in self._parts:
            return []
        self._told = True
        fields = self._parts["GGA"]
        latitude_deg, longitude_deg, amsl_m = _place(fields)
        horizontal_m, vertical_m = self._accuracies_m()
        return [
            Solution(
                received_s=self._began_s,
                epoch_s=self._time_s,
                period_s=DAY_S,
                fix_type=self._fix_type(),
                latitude_deg=latitude_deg,
                longitude_deg=longitude_deg,
                amsl_m=amsl_m,
                horizontal_accuracy_m=horizontal_m,
                vertical_accuracy_m=vertical_m,
                satellites=max(0, int(_number(fields, "numSV") or 0)),
            )
        ]

    def _fix_type(self) -> FixType:
        """The least of what GGA, RMC and GSA claim."""
        navigation = _number(self._fresh_dilutions(), "navMode")
        warned = "RMC" in self._parts and self._parts["RMC"].get("status") != "A"
        if warned or navigation == 1:
            return FixType.NO_FIX
        quality = _number(self._parts["GGA"], "quality")
        fix_type = _QUALITIES.get(int(quality or 0), FixType.NO_FIX)
        if navigation == 2 and fix_type is not FixType.NO_FIX:
            return FixType.FIX_2D
        return fix_type

    def _accuracies_m(self) -> tuple[float, float]:
        """One sigma, horizontal and vertical: GST's, else dilution times user range error."""
        north, east, up = (
            _number(self._parts.get("GST", {}), name) for name in ("stdLat", "stdLong", "stdAlt")
        )
        if north and east and up and min(north, east, up) > 0.0:
            return math.hypot(north, east), up
        horizontal = _number(self._parts["GGA"], "HDOP")
        if horizontal is None:
            return NO_POSITION_ACCURACY_M, NO_POSITION_ACCURACY_M
        vertical = _number(self._fresh_dilutions(), "VDOP") or VERTICAL_RATIO * horizontal
        return horizontal * self._range_error_m, vertical * self._range_error_m

    def _fresh_dilutions(self) -> Fields:
        fresh = abs(self._began_s - self._dilutions_s) <= DILUTIONS_MAX_AGE_S
        return self._dilutions if fresh else {}


def _place(fields: Fields) -> tuple[float, float, float]:
    """Latitude, longitude, altitude; NaN for what is missing or names no hemisphere."""
    numbers = (_number(fields, name) for name in ("lat", "lon", "alt"))
    latitude, longitude, amsl = (math.nan if n is None else n for n in numbers)
    known = fields.get("NS") in ("N", "S") and fields.get("EW") in ("E", "W")
    return (latitude if known else math.nan, longitude, amsl)


def _number(fields: Fields, name: str) -> float | None:
    """A finite number, or None: an empty field is text to the library."""
    value = fields.get(name)
    if isinstance(value, int | float) and math.isfinite(value):
        return float(value)
    return None


def _time_of_day_s(fields: Fields) -> float | None:
    """Seconds since midnight UTC; None where the receiver does not know the time."""
    told = fields.get("time")
    if not isinstance(told, time):
        return None
    return told.hour * 3600.0 + told.minute * 60.0 + told.second + told.microsecond * 1e-6
