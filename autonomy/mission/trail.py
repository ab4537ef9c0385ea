"""The way that was flown, as crumbs: what a return flies back along. Pure, of bounded memory.

The vehicle's body fitted wherever a crumb lies. Crumbs are in the mission frame, which moves with
the autopilot's, so that they stay where they were laid.
"""

import itertools

from autonomy.geometry import Point, distance
from autonomy.model import Crumb

STEP_M = 0.2
"""From crumb to crumb."""
JOINED_M = 0.15
"""A crumb this near to an earlier one closes a loop, which is cut off: both bodies overlap."""
SAME_HEIGHT_M = 0.05
CRUMBS_MAX = 2000
"""Then every second crumb of the older half is left out."""
_JITTER_M = 0.03
"""Steps shorter than the noise would add up to a length that nobody flew."""


class Trail:
    """From the first crumb, where the flight began, to the newest."""

    def __init__(
        self,
        crumbs: tuple[Crumb, ...] = (),
        *,
        flown_m: float = 0.0,
        crumbs_max: int = CRUMBS_MAX,
    ) -> None:
        self._crumbs = list(crumbs)
        self._crumbs_max = crumbs_max
        self._at: Point | None = None
        self.flown_m = flown_m
        """All the way flown, loops included."""

    @property
    def crumbs(self) -> tuple[Crumb, ...]:
        """Oldest first."""
        return tuple(self._crumbs)

    @property
    def length_m(self) -> float:
        """The way back to the first crumb, from the newest."""
        points = [crumb.point for crumb in self._crumbs]
        return sum(distance(a, b) for a, b in itertools.pairwise(points))

    def stretches(self, height_m: float, longest_m: float) -> tuple[tuple[Point, Point], ...]:
        """From crumb to crumb, where both are at that height and no farther apart than that."""
        here = [c.point if _same(c.height_m, height_m) else None for c in self._crumbs]
        return tuple(
            (a, b)
            for a, b in itertools.pairwise(here)
            if a is not None and b is not None and distance(a, b) <= longest_m
        )

    def open_places(self, height_m: float) -> tuple[Point, ...]:
        """The open crumbs at that height, newest first."""
        crumbs = self._crumbs[::-1]
        return tuple(c.point for c in crumbs if c.is_open and _same(c.height_m, height_m))

    def newest(self, height_m: float) -> Point | None:
        """The newest crumb, when it is at that height."""
        last = self._crumbs[-1] if self._crumbs else None
        return last.point if last is not None and _same(last.height_m, height_m) else None

    def count_way(self, point: Point) -> None:
        """The vehicle is at `point`: adds to `flown_m`."""
        if self._at is None:
            self._at = point
        elif (step_m := distance(self._at, point)) > _JITTER_M:
            self.flown_m += step_m
            self._at = point

    def is_due(self, point: Point, height_m: float) -> bool:
        """True where the next crumb is to be laid."""
        if not self._crumbs:
            return True
        last = self._crumbs[-1]
        return not _same(last.height_m, height_m) or distance(last.point, point) >= STEP_M

    def lay(self, crumb: Crumb) -> None:
        """The next crumb; a loop that it closes is cut off."""
        for index, old in enumerate(self._crumbs[:-1]):
            near = distance(old.point, crumb.point) <= JOINED_M
            if near and _same(old.height_m, crumb.height_m):
                del self._crumbs[index + 1 :]
                return
        self._crumbs.append(crumb)
        if len(self._crumbs) > self._crumbs_max:
            half = self._crumbs_max // 2
            self._crumbs[1:half] = self._crumbs[2:half:2]

    def back(self, *, to_open: bool) -> tuple[Crumb, ...]:
        """Newest first: to the newest open crumb, or all the way to the first one."""
        back = self._crumbs[::-1]
        if to_open:
            for index, crumb in enumerate(back):
                if crumb.is_open:
                    return tuple(back[: index + 1])
        return tuple(back)

    def drop(self, count: int) -> None:
        """The newest `count` crumbs were flown back past; the first one always stays."""
        del self._crumbs[max(1, len(self._crumbs) - count) :]


def _same(height_m: float, other_m: float) -> bool:
    return abs(height_m - other_m) <= SAME_HEIGHT_M
