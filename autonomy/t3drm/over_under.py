"""Over and under: the tangents of Figure 1's cone that leave the plane.

The set T of tangents from D to a sphere is a cone. Its members to the left and right are the planar
planner's. The vehicle sees a ring at its own height and a line up and down, so it takes the others
as a climb in place, a planar path, and a climb back. Each hit seen at height z has a keep-out in
space, an upright cylinder with the planar keep-out radius that reaches `spacing` above and below z;
the planes that touch the cylinders' ends are the storeys, heights of flight at whole spacings from
the goal's. Between a storey at which something was seen and the next one at which it was not, its
top (or underside) may be anywhere; hence a plane is free only of what was seen neither on it nor
one spacing away, and passes every top by a spacing, less half the body's height.

Unknown space counts as free here as in the plane; never for moving.
"""

import math
from collections.abc import Callable, Collection, Iterable
from typing import TypeVar

import msgspec

from autonomy.config import GuidanceConfig, StoreysConfig
from autonomy.geometry import Point, distance
from autonomy.model import NoPlan, Plan
from autonomy.t3drm.kernels import Floats
from autonomy.t3drm.planner import NoWay, Planner

SAME_M = 1e-6
"""Heights nearer than this are one."""
PACE = 0.6
"""Of the speed limit, with stops: a median flight of the furnished room."""

_Failed = TypeVar("_Failed", NoPlan, NoWay)


class Storeys(msgspec.Struct, frozen=True):
    """The heights of flight, in m above the take-off point."""

    goal_m: float
    spacing_m: float
    low_m: float
    high_m: float

    def heights_m(self) -> tuple[float, ...]:
        """All of them, rising: the goal's, and whole spacings from it inside the band."""
        down = max(0, math.floor((self.goal_m - self.low_m) / self.spacing_m + SAME_M))
        up = max(0, math.floor((self.high_m - self.goal_m) / self.spacing_m + SAME_M))
        return tuple(round(self.goal_m + k * self.spacing_m, 6) for k in range(-down, up + 1))

    def stops_m(
        self, present_m: float, wanted_m: float, looked_at_m: Collection[float] = ()
    ) -> tuple[float, ...]:
        """The heights at which to look round on the way up or down, `wanted_m` last.

        Away from the goal's height at every storey, because what it shows decides whether the next
        one is free, except where that was done from here before (`looked_at_m`). Towards the
        goal's height nowhere in between.
        """
        if abs(wanted_m - present_m) <= SAME_M:
            return ()
        now, then = present_m - self.goal_m, wanted_m - self.goal_m
        if now * then >= 0.0 and abs(then) <= abs(now):
            return (wanted_m,)
        low, high = sorted((present_m, wanted_m))
        between = [
            height_m
            for height_m in self.heights_m()
            if low + SAME_M < height_m < high - SAME_M and height_m not in looked_at_m
        ]
        return (*(between if wanted_m > present_m else reversed(between)), wanted_m)


class Price(msgspec.Struct, frozen=True):
    """What changes of height cost, in metres of level flight."""

    climb_m: float
    """A metre up or down."""
    change_m: float
    """Settling and looking round, once per change."""

    @classmethod
    def of(cls, storeys: StoreysConfig, guidance: GuidanceConfig) -> "Price":
        """The price by time: climb speed against the speed at which flights get on."""
        speed_m_s = PACE * guidance.speed_max_m_s
        return cls(speed_m_s / storeys.climb_m_s, storeys.change_s * speed_m_s)

    def of_way(
        self,
        storeys: Storeys,
        present_m: float,
        at_m: float,
        looked_at_m: Collection[float] = (),
    ) -> float:
        """From the present height to that of the way, and from there to the goal's."""
        there, back = abs(at_m - present_m), abs(at_m - storeys.goal_m)
        changes = len(storeys.stops_m(present_m, at_m, looked_at_m)) + (back > SAME_M)
        return self.climb_m * (there + back) + self.change_m * changes


class Way(msgspec.Struct, frozen=True):
    """A planar plan at one height; `cost_m` is its length and the price of the climbs."""

    plan: Plan
    height_m: float
    cost_m: float


class Question(msgspec.Struct, frozen=True):
    """From where to where, at which height now, and what climbing costs."""

    start: Point
    goal: Point
    tolerance_m: float
    present_m: float
    storeys: Storeys
    price: Price
    gain_m: float
    looked_at_m: tuple[float, ...] = ()
    """Heights at which the vehicle looked round here before."""


class Search:
    """The best way among storeys, one planar plan at a time, so that no tick is a long one.

    The present storey comes first and keeps an advantage of `gain_m`; the others follow by what
    they cost at least, and only as long as they may still win. A `thorough` search plans at all of
    them and prefers the storey from which most of those still open will be seen: what closes a
    storey closes its neighbours, so that every third one proves that there is no way.
    """

    def __init__(
        self,
        planner: Planner,
        question: Question,
        here: Plan | NoPlan,
        hits_at: Callable[[float], Floats],
        *,
        thorough: bool = False,
    ) -> None:
        """`here` is what was planned at the present storey; `hits_at` gives for a height the hits
        (n, 2) whose keep-outs in space cut its plane, asked for when its turn comes.
        """
        self._planner = planner
        self._hits_at = hits_at
        self._question = question
        self._thorough = thorough
        self._ways: list[Way] = []
        self._failures: list[tuple[float, NoPlan | NoWay]] = []
        self._waiting: list[float] = []
        self.here = self._noted(question.present_m, here)
        """What the present storey offers; a plan knows its height."""

    @property
    def would_stay(self) -> bool:
        """True when the present storey's way is so short that no other can win."""
        question = self._question
        away_m = abs(question.present_m - question.storeys.goal_m)
        climb_m = away_m if away_m > SAME_M else 2.0 * question.storeys.spacing_m
        least_m = self._straight_m() + question.price.climb_m * climb_m + question.price.change_m
        return not self._thorough and self._to_beat_m() <= least_m

    def look_at(self, heights_m: Iterable[float]) -> None:
        """The storeys to compare with; of two that cost the same at least, the upper one first:
        more stands on floors than hangs from ceilings.
        """
        self._waiting = sorted(heights_m, key=lambda height_m: (self._least_m(height_m), -height_m))

    @property
    def decided(self) -> bool:
        """True when no storey that is left can win."""
        if not self._waiting:
            return True
        return not self._thorough and self._to_beat_m() <= self._least_m(self._waiting[0])

    def step(self) -> None:
        """Plan at one more storey; nothing when it is decided."""
        if not self.decided:
            height_m, question = self._waiting.pop(0), self._question
            found = self._planner.seek(
                question.start, question.goal, self._hits_at(height_m), question.tolerance_m
            )
            self._noted(height_m, found)

    def result(self) -> Way | NoPlan:
        """The best way so far, or why there is none; the answer once `decided`."""
        if self._ways:
            return min(self._ways, key=lambda way: (-self._shown_by(way), self._bid_m(way)))
        goal_m = self._question.storeys.goal_m
        _, found = min(self._failures, key=lambda pair: abs(pair[0] - goal_m))
        told = found.tell() if isinstance(found, NoWay) else found
        heights = sorted(height for height, _ in self._failures)
        if len(heights) == 1:
            return told
        shown = ", ".join(f"{height:.2f}" for height in heights)
        return msgspec.structs.replace(told, reason=f"{told.reason}, at every height: {shown} m")

    def _noted(self, height_m: float, found: Plan | _Failed) -> Plan | _Failed:
        if not isinstance(found, Plan):
            self._failures.append((height_m, found))
            return found
        found = msgspec.structs.replace(found, height_m=height_m)
        self._ways.append(Way(found, height_m, found.length_m + self._climbs_m(height_m)))
        return found

    def _shown_by(self, way: Way) -> int:
        """How many open storeys the hits seen on a way may close; all the same in a hurry."""
        if not self._thorough:
            return 0
        reach_m = self._question.storeys.spacing_m + SAME_M
        return sum(abs(other.height_m - way.height_m) <= reach_m for other in self._ways)

    def _bid_m(self, way: Way) -> float:
        stays = abs(way.height_m - self._question.present_m) <= SAME_M
        return way.cost_m - (self._question.gain_m if stays else 0.0)

    def _climbs_m(self, height_m: float) -> float:
        question = self._question
        return question.price.of_way(
            question.storeys, question.present_m, height_m, question.looked_at_m
        )

    def _least_m(self, height_m: float) -> float:
        return self._straight_m() + self._climbs_m(height_m)

    def _straight_m(self) -> float:
        question = self._question
        return max(0.0, distance(question.start, question.goal) - question.tolerance_m)

    def _to_beat_m(self) -> float:
        """What another storey must cost less than."""
        return min(map(self._bid_m, self._ways), default=math.inf)
