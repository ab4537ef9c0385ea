"""GNSS beside the autopilot: where fixes lie, how far apart the two have come, and what is told.

Which of them errs cannot be known from here. GNSS never moves the state by more than its bias lets
it (kalman.py), and that is next to nothing: what it is good for is to notice.
"""

import math

from autonomy.geometry import Point, distance
from hal.frames import Vector3, ned_from_geodetic
from hal.readings import GnssFix

SETTLE_S = 5.0
"""The bias of the first fixes, against which later ones are told, is learned for so long."""
ACCURACIES_APART = 3.0
"""Nearer than so many times the accuracy that the receiver claims, nothing is told."""


class Places:
    """Fixes in the local frame, so that the first one lies where the vehicle was."""

    def __init__(self) -> None:
        self._reference: Vector3 | None = None
        self._offset: Point = (0.0, 0.0)

    def place(self, fix: GnssFix, local_ned_m: Vector3) -> Point:
        """North and east of the fix; the vehicle was at `local_ned_m`."""
        if self._reference is None:
            self._reference = (fix.latitude_deg, fix.longitude_deg, fix.amsl_m)
            self._offset = (local_ned_m[0], local_ned_m[1])
        north, east, _ = ned_from_geodetic(
            fix.latitude_deg, fix.longitude_deg, fix.amsl_m, self._reference
        )
        return (north + self._offset[0], east + self._offset[1])


class Apartness:
    """How far GNSS and the autopilot have drifted apart since the first fixes."""

    def __init__(self, told_from_m: float) -> None:
        self._told_from_m = told_from_m
        self._first_s: float | None = None
        self._anchor: Point | None = None
        self._next_m = 0.0
        self._told = False
        self.apart_m: float | None = None
        """None while the first bias is being learned."""

    def shift(self, offset: Point) -> None:
        """The autopilot's frame jumped, by (north, east): a jump that it owns up to is no drift."""
        if self._anchor is not None:
            self._anchor = (self._anchor[0] - offset[0], self._anchor[1] - offset[1])

    def step(self, stamp_s: float, bias: Point, accuracy_m: float) -> tuple[tuple[str, str], ...]:
        """After a fix: (name, sentence) of what is worth telling."""
        if self._first_s is None:
            self._first_s = stamp_s
        if self._anchor is None:
            if stamp_s - self._first_s >= SETTLE_S:
                self._anchor, self.apart_m = bias, 0.0
            return ()
        self.apart_m = apart_m = distance(bias, self._anchor)
        least_m = max(self._told_from_m, ACCURACIES_APART * accuracy_m)
        if apart_m > max(least_m, self._next_m):
            self._told, self._next_m = True, 2.0 * apart_m
            why = f"GNSS and the autopilot have drifted apart by {apart_m:.1f} m since take-off"
            return (("gnss_drift", f"{why}: one of them is wrong; the autopilot is flown by"),)
        if self._told and apart_m < 0.5 * least_m:
            self._told, self._next_m = False, 0.0
            return (("gnss_drift", f"GNSS and the autopilot agree again, to {apart_m:.1f} m"),)
        return ()


def finite(place: Point) -> bool:
    """Whether the place is made of numbers."""
    return math.isfinite(place[0] + place[1])
