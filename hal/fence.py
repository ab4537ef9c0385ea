"""Plane geometry of the geofence: rings of corners (north, east), in metres. Pure."""

import math

Ring = tuple[tuple[float, float], ...]

CIRCLE_CORNERS = 64
"""A circle's inscribed polygon has as many: it lies inside the circle, by 0.12 % at most."""


def circle(radius_m: float) -> Ring:
    """The regular polygon about the origin with its corners on the circle, clockwise from north."""
    step = 2.0 * math.pi / CIRCLE_CORNERS
    return tuple(
        (radius_m * math.cos(k * step), radius_m * math.sin(k * step))
        for k in range(CIRCLE_CORNERS)
    )


def crosses_itself(ring: Ring) -> bool:
    """True where edges that are not neighbours meet, or neighbours lie on one another.

    Equal corners in a row count once, a first one repeated at the end too. What is inside of such
    a ring is a matter of taste.
    """
    corners = [c for before, c in zip(ring[-1:] + ring[:-1], ring, strict=True) if c != before]
    edges = list(zip(corners, corners[1:] + corners[:1], strict=True))
    count = len(edges)
    for i, (a, b) in enumerate(edges):
        if _folds_back(a, b, edges[(i + 1) % count][1]):
            return True
        for j in range(i + 2, count - (i == 0)):
            if _meet(a, b, *edges[j]):
                return True
    return False


def _folds_back(a: tuple[float, float], b: tuple[float, float], c: tuple[float, float]) -> bool:
    """The way from `a` over `b` to `c` turns round on the spot."""
    ahead = (b[0] - a[0]) * (c[0] - b[0]) + (b[1] - a[1]) * (c[1] - b[1])
    return ahead < 0.0 and _side(a, b, c) == 0.0


def _meet(
    a: tuple[float, float],
    b: tuple[float, float],
    c: tuple[float, float],
    d: tuple[float, float],
) -> bool:
    """True when the edges a-b and c-d have a point in common."""
    for (low, high), (first, last) in zip(_spans(a, b), _spans(c, d), strict=True):
        if high < first or last < low:
            return False
    return _side(a, b, c) * _side(a, b, d) <= 0.0 and _side(c, d, a) * _side(c, d, b) <= 0.0


def _spans(a: tuple[float, float], b: tuple[float, float]) -> list[tuple[float, float]]:
    return [(min(one, other), max(one, other)) for one, other in zip(a, b, strict=True)]


def _side(a: tuple[float, float], b: tuple[float, float], c: tuple[float, float]) -> float:
    """Positive where `c` is on the right of the line from `a` to `b`, 0 on it; sign alone."""
    area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
    return math.copysign(1.0, area) if area else 0.0


def within_circle(ring: Ring, radius_m: float) -> Ring:
    """What of the polygon lies in `circle(radius_m)`; empty when nothing does.

    Where a bent polygon falls to pieces they stay joined along the circle (Sutherland and Hodgman).
    """
    corners = circle(radius_m)
    for a, b in zip(corners, corners[1:] + corners[:1], strict=True):
        ring = _right_of(ring, a, b)
    return ring


def _right_of(ring: Ring, a: tuple[float, float], b: tuple[float, float]) -> Ring:
    """What of the polygon lies on the inner side of the line from `a` to `b`, on it included."""

    def inside_m2(point: tuple[float, float]) -> float:
        return (b[0] - a[0]) * (point[1] - a[1]) - (b[1] - a[1]) * (point[0] - a[0])

    kept: list[tuple[float, float]] = []
    for before, point in zip(ring[-1:] + ring[:-1], ring, strict=True):
        was, now = inside_m2(before), inside_m2(point)
        if (was < 0.0 < now) or (now < 0.0 < was):
            along = was / (was - now)
            north, east = point[0] - before[0], point[1] - before[1]
            kept.append((before[0] + along * north, before[1] + along * east))
        if now >= 0.0:
            kept.append(point)
    return tuple(kept)


def inside_distance_m(ring: Ring, north_m: float, east_m: float) -> float:
    """Signed distance to the ring's edges: positive inside, negative outside."""
    inside = False
    nearest = math.inf
    for (n0, e0), (n1, e1) in zip(ring, ring[1:] + ring[:1], strict=True):
        if (e0 > east_m) != (e1 > east_m) and north_m < (n1 - n0) * (east_m - e0) / (e1 - e0) + n0:
            inside = not inside
        dn, de = n1 - n0, e1 - e0
        length2 = dn * dn + de * de
        along = ((north_m - n0) * dn + (east_m - e0) * de) / length2 if length2 else 0.0
        along = min(1.0, max(0.0, along))
        nearest = min(nearest, math.hypot(north_m - n0 - along * dn, east_m - e0 - along * de))
    return nearest if inside else -nearest
