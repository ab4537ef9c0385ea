"""Ricci flow of round shapes (Eq. 1-9): how keep-out radii shrink and grow.

A radius here is a keep-out radius, flow time has the unit of an area (m^2). All functions are pure.
"""

import math

from autonomy.geometry import Point
from hal.frames import Vector3


class ExtinctSphere(ValueError):
    """The flow was asked for a time at which the sphere has already shrunk to a point."""


class SingularFlow(ValueError):
    """Eq. 5's denominator x_u^3 + y_u^3 + z_u^3 is zero: the flow is not defined there."""


def sphere_ricci(radius_m: float, n: int = 3) -> float:
    """Ric of a round n-sphere as a factor of its metric: Ric = (n-1)/r^2 g (Eq. 1's Rc)."""
    return (n - 1) / (radius_m * radius_m)


def extinction_time(r0_m: float, n: int = 3) -> float:
    """T = r0^2 / (2(n-1)), when Eq. 2's sphere has shrunk to a point (m^2)."""
    return r0_m * r0_m / (2 * (n - 1))


def shrinking_radius(r0_m: float, t_m2: float, n: int = 3) -> float:
    """Eq. 2: r(t) = sqrt(r0^2 - 2(n-1)t). Raises ExtinctSphere after T."""
    return _root(r0_m * r0_m - 2 * (n - 1) * t_m2, f"t = {t_m2} m^2 is after extinction")


def growth_rate(n: int = 3) -> float:
    """Eq. 3: d(r^2)/dt = 2(n-1), whatever the radius."""
    return 2.0 * (n - 1)


def growing_radius(r0_m: float, t_m2: float, n: int = 3) -> float:
    """Eq. 4: r(t) = sqrt(r0^2 + 2(n-1)t), the hyperbolic n-space."""
    return _root(r0_m * r0_m + growth_rate(n) * t_m2, f"t = {t_m2} m^2 is before the beginning")


def time_to_radius(r0_m: float, r_m: float, n: int = 3) -> float:
    """The t at which Eq. 2 has brought r0 to r (negative t: Eq. 4 has grown it)."""
    return (r0_m * r0_m - r_m * r_m) / (2 * (n - 1))


def levels(r0_m: float, r_min_m: float, count: int, n: int = 3) -> tuple[float, ...]:
    """`count` radii along Eq. 2's flow from r0 to r_min, at equal steps of flow time.

    The flow is stopped at r_min, the hard floor. One level is r0 alone. Raises ValueError when
    r_min is not in (0, r0] or count is below 1.
    """
    if not 0.0 < r_min_m <= r0_m:
        raise ValueError(f"r_min {r_min_m} m must be above 0 and not above r0 {r0_m} m")
    if count < 1:
        raise ValueError("at least one level is needed")
    if count == 1 or r_min_m == r0_m:
        return (r0_m,)
    end = time_to_radius(r0_m, r_min_m, n)
    inner = (shrinking_radius(r0_m, end * k / (count - 1), n) for k in range(1, count - 1))
    return (r0_m, *inner, r_min_m)


def curve_flow(first: Vector3, third: Vector3) -> Vector3:
    """Eq. 5: velocity of a point of the curve u -> (x, y, z) from its derivatives.

    first = (x_u, y_u, z_u), third = (x_uuu, y_uuu, z_uuu); the printed diagonal is (z_u^3, y_u^3,
    x_u^3). Straight lines have no third derivative and are fixed points. Raises SingularFlow where
    x_u^3 + y_u^3 + z_u^3 = 0. No controller of this project depends on it.
    """
    cubes = (first[0] ** 3, first[1] ** 3, first[2] ** 3)
    denominator = cubes[0] + cubes[1] + cubes[2]
    scale = abs(cubes[0]) + abs(cubes[1]) + abs(cubes[2])
    if abs(denominator) <= 1e-12 * scale or scale == 0.0:
        raise SingularFlow("x_u^3 + y_u^3 + z_u^3 is zero: Eq. 5 is not defined at this point")
    return (
        cubes[2] * third[0] / denominator,
        cubes[1] * third[1] / denominator,
        cubes[0] * third[2] / denominator,
    )


def normalised_flow(radius_m: float, volume_rate: float, n: int = 3) -> float:
    """Eq. 6 (n = 3: Eq. 7) on a round sphere of radius r whose volume changes: the factor of g.

    -2 Ric + (2/n) <R> g vanishes on a round sphere (Ric = (n-1)/r^2, R = n(n-1)/r^2, so both terms
    are 2(n-1)/r^2). Reading: the averaged term is that of the volume being preserved, the local one
    that of the sphere as it will be one unit of dV/dt (m^n per unit of flow time) later. With
    V = w r^n and dr = dV / (n w r^(n-1)), the difference to first order is
    2(n-1) d(1/r^2) g = -4(n-1) dr / r^3 g; w is the volume of the unit n-ball. A growing free
    sphere gives a negative factor, a shrinking one a positive factor: the sign pairs of Table 2.
    """
    unit_ball: float = math.pi ** (n / 2) / math.gamma(n / 2 + 1)
    radius_rate = volume_rate / (n * unit_ball * radius_m ** (n - 1))
    # + 0.0: a constant volume gives zero, never minus zero.
    return float(-4.0 * (n - 1) * radius_rate / radius_m**3 + 0.0)


def normalised_flow_signs(radius_m: float, volume_rate: float, n: int = 3) -> Point:
    """Table 2's second column: the signs of Eq. 7 for the two tangential axes of the sphere.

    A round sphere has the same factor along both, so the pair has equal signs: (-, -), (+, +) or
    (0, 0), as printed.
    """
    factor = normalised_flow(radius_m, volume_rate, n)
    sign = math.copysign(1.0, factor) if factor != 0.0 else 0.0
    return (sign, sign)


def one_obstacle_radius(r0: float, n: int = 3) -> float | None:
    """Eq. 8: r(1) = sqrt(R0^2 - 2n + 2), in the unit of R0; None: the sphere is extinct."""
    return _radius_or_extinct(r0 * r0 - 2 * n + 2)


def many_obstacles_radius(r0: float, n: int = 3) -> float | None:
    """Eq. 9: r(n) = sqrt(R0^2 - 2n^2 + 2n), in the unit of R0; None: the sphere is extinct."""
    return _radius_or_extinct(r0 * r0 - 2 * n * n + 2 * n)


def _radius_or_extinct(radicand: float) -> float | None:
    return math.sqrt(radicand) if radicand >= 0.0 else None


def _root(radicand: float, why: str) -> float:
    if radicand < 0.0:
        raise ExtinctSphere(f"no radius: {why}")
    return math.sqrt(radicand)
