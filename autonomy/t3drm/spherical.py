"""Spherical navigation (Figure 1): tangents of spheres, and the exact shortest path among discs.

One sphere: from D the tangents touch S(o, r) at the angle asin(r / |DO|) off the line DO. Several:
common tangents and arcs, searched over the discs that matter (constraint generation, see kernels).
"""

import math
from enum import StrEnum

import msgspec
import numpy as np

from autonomy.geometry import Point, along, bearing, distance
from autonomy.t3drm import kernels
from autonomy.t3drm.kernels import Floats, Ints, Mask, Squares
from hal.frames import Vector3

ACTIVE_MAX = 400
"""Default bound on the discs that one solve may hold; its table needs (2 (n + 2))^2 rows."""


class Tangents(msgspec.Struct, frozen=True):
    """The two tangents from a point to a circle: where they touch, and how far that is.

    `left` touches where the circle is then followed in the sense north to east (sense +1).
    """

    left: Point
    right: Point
    length_m: float
    touch_angle_rad: float


class Segment(msgspec.Struct, frozen=True, tag="segment"):
    """A straight piece of a route."""

    start: Point
    end: Point

    @property
    def length_m(self) -> float:
        """Its length."""
        return distance(self.start, self.end)


class Arc(msgspec.Struct, frozen=True, tag="arc"):
    """A geodesic of a sphere: along disc number `disc`, `sweep_rad` positive from north to east."""

    start: Point
    end: Point
    centre: Point
    radius_m: float
    sweep_rad: float
    disc: int

    @property
    def length_m(self) -> float:
        """Its length."""
        return self.radius_m * abs(self.sweep_rad)

    def polyline(self, sagitta_m: float) -> tuple[Point, ...]:
        """Corners of a circumscribed polyline: never inside the disc, outside by <= sagitta_m.

        It begins and ends at the touching points, along the tangents there.
        """
        half = math.acos(self.radius_m / (self.radius_m + sagitta_m))
        steps = max(1, math.ceil(abs(self.sweep_rad) / (2.0 * half)))
        step = self.sweep_rad / steps
        outer = self.radius_m / math.cos(0.5 * step)
        begin = bearing(self.centre, self.start)
        corners = (along(self.centre, begin + (k + 0.5) * step, outer) for k in range(steps))
        return (self.start, *corners, self.end)


class Route(msgspec.Struct, frozen=True, tag="route"):
    """A shortest path: segments and arcs in turn. `active`: the discs that decided it."""

    pieces: tuple[Segment | Arc, ...]
    length_m: float
    active: tuple[int, ...]
    rounds: int


class NoRouteReason(StrEnum):
    """Why there is no route."""

    CLOSED = "closed"  # proven: the certificate's discs alone close every way
    TOO_MANY = "too_many"  # more discs matter than were allowed: nothing is proven
    BEATEN = "beaten"  # proven: no path is shorter than the limit
    START_INSIDE = "start_inside"
    GOAL_INSIDE = "goal_inside"


class NoRoute(msgspec.Struct, frozen=True, tag="no_route"):
    """No route. `certificate`: the discs that prove it (for *_INSIDE: one disc that holds it)."""

    reason: NoRouteReason
    certificate: tuple[int, ...]


class Discs(msgspec.Struct, frozen=True):
    """Discs made ready for `route_among`: centres, radii, component numbers, sparse chains, and
    a spatial index of the centres.
    """

    centres: Floats
    radii: Floats
    labels: Ints
    chain: Mask
    squares: Squares

    @classmethod
    def of(cls, centres: Floats, radii: Floats) -> "Discs":
        """Any discs; overlapping ones are one component."""
        return cls.joined(centres, radii, *kernels.join_overlapping(centres, radii))

    @classmethod
    def joined(cls, centres: Floats, radii: Floats, labels: Ints, chain: Mask) -> "Discs":
        """Discs whose components and chains are known."""
        widest = float(radii.max()) if radii.shape[0] else 0.0
        return cls(centres, radii, labels, chain, kernels.into_squares(centres, widest))

    @property
    def field(self) -> kernels.Field:
        """What the kernels take."""
        return (self.centres, self.radii, self.labels, self.chain, self.squares)


_REASONS = {
    kernels.CLOSED: NoRouteReason.CLOSED,
    kernels.TOO_MANY: NoRouteReason.TOO_MANY,
    kernels.BEATEN: NoRouteReason.BEATEN,
    kernels.START_INSIDE: NoRouteReason.START_INSIDE,
    kernels.GOAL_INSIDE: NoRouteReason.GOAL_INSIDE,
}

NO_PLANES: Floats = np.empty((0, 3))
NO_SEEDS: Ints = np.empty(0, dtype=np.int64)


def touch_angle(radius_m: float, distance_m: float) -> float:
    """asin(r / |DO|): the angle between the line DO and a tangent; ValueError inside the sphere."""
    if radius_m > distance_m:
        raise ValueError("the point lies inside the sphere: it has no tangents")
    return math.asin(radius_m / distance_m)


def tangents_from(point: Point, centre: Point, radius_m: float) -> Tangents:
    """The tangents from a point to a circle; ValueError when it lies inside."""
    away = distance(point, centre)
    angle = touch_angle(radius_m, away)
    length = math.sqrt(away * away - radius_m * radius_m)
    towards = bearing(point, centre)
    # With the circle on the side of growing angles, the path then turns that way around it.
    return Tangents(
        left=along(point, towards - angle, length),
        right=along(point, towards + angle, length),
        length_m=length,
        touch_angle_rad=angle,
    )


def tangent_cone(
    drone_ned_m: Vector3, centre_ned_m: Vector3, radius_m: float, count: int
) -> tuple[Vector3, ...]:
    """`count` points of the circle where the tangents from the drone touch S(o, r) (set T).

    The first ones lie in the horizontal plane on the growing-angle side; evenly spaced around DO.
    """
    axis = tuple(c - d for c, d in zip(centre_ned_m, drone_ned_m, strict=True))
    away = math.sqrt(axis[0] ** 2 + axis[1] ** 2 + axis[2] ** 2)
    angle = touch_angle(radius_m, away)
    a = (axis[0] / away, axis[1] / away, axis[2] / away)
    flat = math.hypot(a[0], a[1])
    # Two directions across the axis: the first one in the plane.
    side = (-a[1] / flat, a[0] / flat) if flat > 1e-12 else (1.0, 0.0)
    third = (-a[2] * side[1], a[2] * side[0], a[0] * side[1] - a[1] * side[0])
    length = away * math.cos(angle)
    along_axis, off_axis = length * math.cos(angle), length * math.sin(angle)
    points = []
    for k in range(count):
        turn = 2.0 * math.pi * k / count
        c, s = off_axis * math.cos(turn), off_axis * math.sin(turn)
        points.append(
            (
                drone_ned_m[0] + along_axis * a[0] + c * side[0] + s * third[0],
                drone_ned_m[1] + along_axis * a[1] + c * side[1] + s * third[1],
                drone_ned_m[2] + along_axis * a[2] + s * third[2],
            )
        )
    return tuple(points)


def fence_planes(polygon: tuple[Point, ...]) -> Floats | None:
    """A convex polygon as rows (a, b, c) with a n + b e >= c inside; None: it is not convex."""
    count = len(polygon)
    area2 = sum(
        polygon[k - 1][0] * polygon[k][1] - polygon[k][0] * polygon[k - 1][1] for k in range(count)
    )
    ring = polygon if area2 > 0.0 else polygon[::-1]
    rows = np.empty((count, 3))
    for k in range(count):
        (n0, e0), (n1, e1) = ring[k - 1], ring[k]
        length = math.hypot(n1 - n0, e1 - e0)
        if length == 0.0:
            return None
        a, b = -(e1 - e0) / length, (n1 - n0) / length
        rows[k] = (a, b, a * n0 + b * e0)
    if any(
        rows[k, 0] * p[0] + rows[k, 1] * p[1] < rows[k, 2] - 1e-9
        for k in range(count)
        for p in ring
    ):
        return None
    return rows


def route_among(
    start: Point,
    goal: Point,
    discs: Discs,
    planes: Floats = NO_PLANES,
    active_max: int = ACTIVE_MAX,
    seeds: Ints = NO_SEEDS,
    limit_m: float = math.inf,
) -> Route | NoRoute:
    """`shortest_path` over discs that were made ready before.

    seeds: discs to begin with, such as those that decided a similar question: they change the time,
    not the answer. limit_m: BEATEN as soon as it is proven that no path is shorter.
    """
    ends = np.array((start, goal))
    found = kernels.lazy_route(ends, discs.field, planes, active_max, seeds, limit_m)
    return _result(found, discs.centres, discs.radii)


def shortest_path(
    start: Point,
    goal: Point,
    centres: Floats,
    radii: Floats,
    planes: Floats = NO_PLANES,
    active_max: int = ACTIVE_MAX,
) -> Route | NoRoute:
    """The exact shortest path from start to goal that enters no disc (closed complement).

    centres: (n, 2) north, east; radii: (n,), positive, arbitrary, overlapping or not. planes: a
    convex fence (`fence_planes`) that the path stays inside. A gap of exactly the sum of two radii
    is passable. A start or goal inside a disc is a NoRoute with its reason, on its circle is free.
    """
    ends = np.array((start, goal))
    found = kernels.route_from_scratch(ends, centres, radii, planes, active_max)
    return _result(found, centres, radii)


def _result(
    found: tuple[int, Floats, Ints, int], centres: Floats, radii: Floats
) -> Route | NoRoute:
    status, rows, active, rounds = found
    deciding = tuple(active.tolist())
    if status != kernels.FOUND:
        return NoRoute(_REASONS[status], deciding)
    pieces = tuple(_piece(row, centres, radii) for row in rows.tolist())
    return Route(pieces, sum(piece.length_m for piece in pieces), deciding, int(rounds))


def _piece(row: list[float], centres: Floats, radii: Floats) -> Segment | Arc:
    start, end = (row[0], row[1]), (row[2], row[3])
    disc = int(row[4])
    if disc < 0:
        return Segment(start, end)
    north, east = centres[disc].tolist()
    return Arc(start, end, (north, east), float(radii[disc]), row[5], disc)
