"""Which legs were flown, and at which radius of the Ricci flow (Eq. 2): one record per flight."""

import msgspec

from autonomy.geometry import Point
from autonomy.guidance.path import FlownPath
from autonomy.model import LegKind, Plan


class FlownLeg(msgspec.Struct, frozen=True):
    """A stretch flown along legs of one kind at one keep-out radius. Lengths in metres.

    `keep_out_m` is the radius that the leg was planned with: r0 of Eq. 2, or smaller where the
    flow went on; smaller still on the way out of a keep-out. `flown_m` is what was flown of it.
    """

    begun_s: float
    kind: LegKind
    keep_out_m: float
    flown_m: float


class FlownLegs:
    """Fed with every plan and every movement, in order."""

    def __init__(self) -> None:
        self._plan: Plan | None = None
        self._path = FlownPath(((0.0, 0.0),))
        self._ends_m: list[float] = []
        self._begun: list[tuple[float, LegKind, float]] = []
        self._flown_m: list[float] = []

    def planned(self, plan: Plan) -> None:
        """From now on this plan is flown."""
        self._plan = plan
        self._path = FlownPath(plan.points)
        self._ends_m = []
        end_m = 0.0
        for leg in plan.legs:
            end_m += leg.length_m
            self._ends_m.append(end_m)

    def moved(self, stamp_s: float, point: Point, step_m: float) -> None:
        """The vehicle has flown `step_m` more and is at `point`."""
        if self._plan is None:
            return
        self._path.advance(point)
        # Sampled curves are a little shorter than they say: the last leg is the last.
        at = sum(self._path.progress_m > end_m for end_m in self._ends_m[:-1])
        leg = self._plan.legs[at]
        if not self._begun or self._begun[-1][1:] != (leg.kind, leg.keep_out_m):
            self._begun.append((stamp_s, leg.kind, leg.keep_out_m))
            self._flown_m.append(0.0)
        self._flown_m[-1] += step_m

    def record(self) -> tuple[FlownLeg, ...]:
        """The legs so far, in the order flown; what follows in the same way is one."""
        return tuple(
            FlownLeg(*begun, flown_m)
            for begun, flown_m in zip(self._begun, self._flown_m, strict=True)
        )


def by_radius(legs: tuple[FlownLeg, ...]) -> tuple[tuple[float, float], ...]:
    """(keep_out_m, metres flown at it), the largest radius first; radii equal to 1 mm are one."""
    sums: dict[float, float] = {}
    for leg in legs:
        radius_m = round(leg.keep_out_m, 3)
        sums[radius_m] = sums.get(radius_m, 0.0) + leg.flown_m
    return tuple(sorted(sums.items(), reverse=True))
