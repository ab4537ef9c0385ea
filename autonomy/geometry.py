"""Plane geometry shared by planning, perception and guidance. Pure; metres and radians.

Points are (north, east). Angles grow from north to east, as bearings do.
"""

import itertools
import math
from collections.abc import Iterable

Point = tuple[float, float]


def distance(a: Point, b: Point) -> float:
    """Length of the straight segment a-b."""
    return math.hypot(b[0] - a[0], b[1] - a[1])


def bearing(a: Point, b: Point) -> float:
    """Direction from a to b, in (-pi, pi]."""
    return math.atan2(b[1] - a[1], b[0] - a[0])


def along(a: Point, bearing_rad: float, length_m: float) -> Point:
    """The point `length_m` from a in direction `bearing_rad`."""
    return (a[0] + length_m * math.cos(bearing_rad), a[1] + length_m * math.sin(bearing_rad))


def interpolate(a: Point, b: Point, fraction: float) -> Point:
    """a + fraction * (b - a)."""
    return (a[0] + fraction * (b[0] - a[0]), a[1] + fraction * (b[1] - a[1]))


def closest_fraction(p: Point, a: Point, b: Point) -> float:
    """Where on segment a-b (0..1) the point nearest to p lies; 0 for a degenerate segment."""
    dn, de = b[0] - a[0], b[1] - a[1]
    length2 = dn * dn + de * de
    if length2 == 0.0:
        return 0.0
    return min(1.0, max(0.0, ((p[0] - a[0]) * dn + (p[1] - a[1]) * de) / length2))


def segment_distance(p: Point, a: Point, b: Point) -> float:
    """Distance from p to segment a-b."""
    return distance(p, interpolate(a, b, closest_fraction(p, a, b)))


def polyline_length(points: tuple[Point, ...]) -> float:
    """Sum of the segment lengths."""
    return sum(distance(a, b) for a, b in itertools.pairwise(points))


def moved(points: Iterable[Point], by: Point) -> tuple[Point, ...]:
    """Every point moved by (north, east), in m."""
    return tuple((north + by[0], east + by[1]) for north, east in points)
