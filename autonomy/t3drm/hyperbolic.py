"""Hyperbolic navigation (Figure 2): fly past a continuous obstacle on a conic.

One decision for the whole component: from D its outline has two silhouettes, for each side a
support vertex V. The way past it is the conic with its focus at V, the keep-out radius as periapsis
(Eq. 4 gives its growth), through D and G: p/r = 1 + e cos(theta - omega), p = r_p (1 + e). For
e > 1 it is the paper's hyperbola; its point P is the periapsis.
"""

import math

import msgspec

from autonomy.geometry import Point, along, bearing, distance, polyline_length
from autonomy.t3drm import kernels

SAGITTA_M = 5e-4
"""Chords of a sampled conic stay within this of it."""


class FlyBy(msgspec.Struct, frozen=True):
    """A conic past `focus` (V). `points` leads from D over `closest` (P) to G."""

    focus: Point
    periapsis_m: float
    eccentricity: float
    closest: Point
    points: tuple[Point, ...]
    length_m: float

    @property
    def is_hyperbola(self) -> bool:
        """False for the parabola and the ellipse that D and G near the obstacle give."""
        return self.eccentricity > 1.0

    @property
    def curvature_radius_m(self) -> float:
        """Radius of curvature at the periapsis, r_p (1 + e): the tightest of the whole path."""
        return self.periapsis_m * (1.0 + self.eccentricity)


def support_vertices(drone: Point, hull: tuple[Point, ...]) -> tuple[Point, Point] | None:
    """The silhouettes of the hull seen from the drone: (least bearing, greatest bearing).

    None when the drone stands inside the hull or on it. A hull of one point gives it twice.
    """
    if not hull or inside_hull(drone, hull):
        return None
    behind = bearing(_centroid(hull), drone)
    ranked = sorted(hull, key=lambda v: (bearing(drone, v) - behind) % math.tau)
    return ranked[0], ranked[-1]


def inside_hull(point: Point, hull: tuple[Point, ...]) -> bool:
    """True inside or on a convex hull (north to east); never for fewer than three vertices."""
    if len(hull) < 3:
        return False
    previous = hull[-1]
    for vertex in hull:
        turn = (vertex[0] - previous[0]) * (point[1] - previous[1]) - (vertex[1] - previous[1]) * (
            point[0] - previous[0]
        )
        if turn < 0.0:
            return False
        previous = vertex
    return True


def fly_by(
    drone: Point, goal: Point, vertex: Point, periapsis_m: float, sense: int
) -> FlyBy | None:
    """The conic from drone to goal past the vertex; None when there is none.

    sense: +1 when the bearing from the vertex grows on the way (the vertex lies on the side of
    growing angles), -1 when it falls. There is one exactly when drone and goal are outside the
    periapsis circle and the straight way on that side passes nearer than `periapsis_m`: the sweep
    gamma exceeds acos(r_p/|DV|) + acos(r_p/|GV|). The root is the true anomaly of D (bisection,
    findings 3.3), well-conditioned also for V on the line DG.
    """
    to_drone, to_goal = distance(vertex, drone), distance(vertex, goal)
    if min(to_drone, to_goal) <= periapsis_m:
        return None
    at_drone = bearing(vertex, drone)
    sweep = (sense * (bearing(vertex, goal) - at_drone)) % math.tau
    ratio = periapsis_m / to_drone
    anomaly = kernels.fly_by_anomaly(ratio, periapsis_m / to_goal, sweep)
    if math.isnan(anomaly):
        return None
    eccentricity = kernels.eccentricity(anomaly, ratio)
    if not 0.0 <= eccentricity < 1e9:
        return None
    rows = kernels.sample_conic(eccentricity, periapsis_m, -anomaly, sweep - anomaly, SAGITTA_M)
    axis = at_drone + sense * anomaly
    inner = [along(vertex, axis + sense * nu, r) for nu, r in rows.tolist()[1:-1]]
    points = (drone, *inner, goal)
    return FlyBy(
        focus=vertex,
        periapsis_m=periapsis_m,
        eccentricity=eccentricity,
        closest=along(vertex, axis, periapsis_m),
        points=points,
        length_m=polyline_length(points),
    )


def _centroid(hull: tuple[Point, ...]) -> Point:
    return (sum(v[0] for v in hull) / len(hull), sum(v[1] for v in hull) / len(hull))
