"""A path being flown: a polyline with arc length, and how far along it the vehicle has come."""

import bisect
import itertools

from autonomy.geometry import Point, closest_fraction, distance, interpolate


class FlownPath:
    """A polyline parametrised by arc length in metres; progress along it never runs backwards."""

    def __init__(self, points: tuple[Point, ...]) -> None:
        """Take at least one point; a single point is a path of length zero."""
        if not points:
            raise ValueError("a path needs at least one point")
        self.points = points
        self._at = [0.0]
        for a, b in itertools.pairwise(points):
            self._at.append(self._at[-1] + distance(a, b))
        self.progress_m = 0.0

    @property
    def length_m(self) -> float:
        """Length of the whole path."""
        return self._at[-1]

    @property
    def remaining_m(self) -> float:
        """Length ahead of the vehicle."""
        return self.length_m - self.progress_m

    def point_at(self, along_m: float) -> Point:
        """The point at arc length `along_m`, clamped to the path's ends."""
        if along_m <= 0.0 or len(self.points) == 1:
            return self.points[0]
        if along_m >= self.length_m:
            return self.points[-1]
        index = bisect.bisect_right(self._at, along_m) - 1
        step = self._at[index + 1] - self._at[index]
        return interpolate(
            self.points[index], self.points[index + 1], (along_m - self._at[index]) / step
        )

    def remaining(self) -> tuple[Point, ...]:
        """The polyline from the present progress to the end."""
        index = bisect.bisect_right(self._at, self.progress_m)
        return (self.point_at(self.progress_m), *self.points[index:])

    def advance(self, position: Point, window_m: float = 0.5) -> None:
        """Move progress to the point nearest to `position` on the next `window_m` of path.

        Looking no farther keeps the vehicle from jumping to a later stretch where the path
        passes close to itself (both sides of a thin wall).
        """
        best_at, best_distance = self.progress_m, distance(position, self.point_at(self.progress_m))
        index = max(0, bisect.bisect_right(self._at, self.progress_m) - 1)
        while index + 1 < len(self.points) and self._at[index] <= self.progress_m + window_m:
            a, b = self.points[index], self.points[index + 1]
            fraction = closest_fraction(position, a, b)
            at = self._at[index] + fraction * (self._at[index + 1] - self._at[index])
            gap = distance(position, interpolate(a, b, fraction))
            if self.progress_m < at <= self.progress_m + window_m and gap < best_distance:
                best_at, best_distance = at, gap
            index += 1
        self.progress_m = best_at
