"""The one door to filterpy: position, velocity and GNSS bias in local NED, gated like PX4's EKF2.

    x = [position p, velocity v, bias b]
    F = [[1, dt, 0], [0, 1, 0], [0, 0, 1]]
    Q = [[a dt^3/3, a dt^2/2, 0], [a dt^2/2, a dt, 0], [0, 0, w dt]]

The acceleration is white noise of density a, the bias walks with density w. Cut into two, a
prediction is the same: measurements may come in between, or late (timeline.py).

    local position   z = p,  z = v
    GNSS             z = p + b   b: where GNSS is off the autopilot's frame, whichever of them errs

North, east and down do not see each other and every measurement has one accuracy for its axes, so
they are the three columns of one `x` and share one 3 x 3 covariance. GNSS measures two of them; the
third has that much less from it, which is less than a thousandth of its variance. filterpy updates
the covariance in Joseph's form, which keeps it positive definite; rounding asymmetry is removed.

Words (PX4's): innovation = measured - predicted; test ratio = innovation^2 / (gate^2 * innovation
variance), the largest over the axes; a measurement is fused when it is <= 1, else rejected.
"""

import math
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from types import ModuleType, SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from autonomy.geometry import Point
from hal.frames import ZERO3, Vector3


@contextmanager
def _without_scipy_stats() -> Iterator[None]:
    """filterpy's package asks for scipy.stats: 31 MB for densities that nothing here calls."""
    name = "scipy.stats"
    if name in sys.modules:
        yield
        return
    stand_in = ModuleType(name)
    vars(stand_in).update(norm=None, multivariate_normal=SimpleNamespace(logpdf=_no_density))
    sys.modules[name] = stand_in
    try:
        yield
    finally:
        del sys.modules[name]


def _no_density(*_: Any, **__: Any) -> None:
    """filterpy tries its arguments when it is imported, and no more."""


with _without_scipy_stats():
    from filterpy.kalman import KalmanFilter

Matrix = NDArray[np.float64]

ACCELERATION_HOLDS_S = 0.05
"""An acceleration of one sigma is expected to last so long: density = sigma^2 * this."""
SIGMA_MAX_M = 1000.0
"""A position less certain than this is none: the filter has diverged."""

_P, _V, _B = 0, 1, 2
_BOTH: Matrix = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
_POSITION: Matrix = np.array([[1.0, 0.0, 0.0]])
_VELOCITY: Matrix = np.array([[0.0, 1.0, 0.0]])
_GNSS: Matrix = np.array([[1.0, 0.0, 1.0]])
_VARIANCE_MIN = 1e-12


class Tested(NamedTuple):
    """What became of one measurement.

    `test_ratio`: the largest of its axes, inf for what is no number. `nis`: its normalised
    innovation squared, chi-square with as many degrees of freedom as it has axes.
    """

    test_ratio: float
    fused: bool
    nis: float = 0.0


class Snapshot(NamedTuple):
    """The whole filter at one time. The arrays are never written to."""

    x: Matrix
    p: Matrix
    bias_known: bool


class Kalman:
    """Position and velocity in local NED, and how far GNSS is off it."""

    def __init__(
        self,
        acceleration_noise_m_s2: float,
        gate_sigma: float,
        bias_noise_m_per_sqrt_s: float = 0.1,
    ) -> None:
        self._q_acceleration = acceleration_noise_m_s2**2 * ACCELERATION_HOLDS_S
        self._q_bias = bias_noise_m_per_sqrt_s**2
        self._gate2 = gate_sigma * gate_sigma
        self._filter: Any = KalmanFilter(dim_x=3, dim_z=2)
        self._filter.inv = _inverse
        self._filter.x = np.zeros((3, 3))
        self._transition = self._filter.F = np.eye(3)
        self._noise = self._filter.Q = np.zeros((3, 3))
        self._noise_of_both = np.zeros((2, 2))
        self._bias_known = False
        self.start(ZERO3, ZERO3, 1.0, 1.0)

    def start(
        self,
        position_ned_m: Vector3,
        velocity_ned_m_s: Vector3,
        position_sigma_m: float,
        velocity_sigma_m_s: float,
    ) -> None:
        """Begin (again) from one measurement and its accuracies. The bias is kept."""
        bias, variance = self._filter.x[_B].tolist(), float(self._filter.P[_B, _B])
        self._filter.x = np.array([position_ned_m, velocity_ned_m_s, bias], dtype=np.float64)
        self._filter.P = np.diag(
            [_variance(position_sigma_m), _variance(velocity_sigma_m_s), variance]
        )

    def forget_bias(self) -> None:
        """The next GNSS position is the first one."""
        self._filter.x = np.vstack([self._filter.x[:_B], np.zeros(3)])
        self._filter.P = np.diag([1.0, 1.0, 0.0])
        self._bias_known = False

    # ------------------------------------------------------------ what it believes

    @property
    def position_ned_m(self) -> Vector3:
        """Position at the last prediction or update."""
        n, e, d = self._filter.x[_P].tolist()
        return (n, e, d)

    @property
    def velocity_ned_m_s(self) -> Vector3:
        """Velocity at the last prediction or update."""
        n, e, d = self._filter.x[_V].tolist()
        return (n, e, d)

    @property
    def bias_ne_m(self) -> Point | None:
        """GNSS less local position, (north, east); None before the first fix."""
        n, e, _ = self._filter.x[_B].tolist()
        return (n, e) if self._bias_known else None

    @property
    def bias_sigma_m(self) -> float:
        """One-sigma uncertainty of the bias, each axis."""
        return math.sqrt(self._filter.P[_B, _B])

    @property
    def covariance(self) -> Matrix:
        """3 x 3 covariance of (position, velocity, bias), the same for each axis; a copy."""
        copy: Matrix = self._filter.P.copy()
        return copy

    def position_sigma_m(self, dt_s: float = 0.0) -> float:
        """One-sigma uncertainty of each axis when nothing is measured for `dt_s` seconds more."""
        (p00, p01, _), (_, p11, _), _ = self._filter.P.tolist()
        dt2 = dt_s * dt_s
        variance: float = p00 + 2.0 * dt_s * p01 + dt2 * p11 + self._q_acceleration * dt2 * dt_s / 3
        return math.sqrt(variance)

    def why_unhealthy(self) -> str:
        """Why state and covariance cannot be believed any more; empty while they can."""
        (p00, p01, p02), (_, p11, p12), (_, _, p22) = self._filter.P.tolist()
        # A sum meets every element: an infinity or a NaN among them shows.
        if not math.isfinite(sum(self._filter.x.ravel().tolist()) + p00 + p01 + p02 + p11 + p12):
            return "its numbers ran over"
        if not (p00 > 0.0 and p22 >= 0.0 and p00 * p11 - p01 * p01 > 0.0):
            return "its covariance is no longer positive"
        if p00 > SIGMA_MAX_M * SIGMA_MAX_M:
            return f"its position is uncertain to {math.sqrt(p00):.0f} m"
        return ""

    # ------------------------------------------------------------ time and frame

    def snapshot(self) -> Snapshot:
        """The filter as it is now."""
        return Snapshot(self._filter.x, self._filter.P, self._bias_known)

    def restore(self, snapshot: Snapshot) -> None:
        """The filter as it was then."""
        self._filter.x, self._filter.P, self._bias_known = snapshot

    def predict(self, dt_s: float) -> None:
        """Move on by `dt_s` seconds; does nothing for `dt_s` <= 0 (time never runs back)."""
        if not dt_s > 0.0:
            return
        q, noise = self._q_acceleration * dt_s, self._noise
        self._transition[_P, _V] = dt_s
        noise[_P, _P] = q * dt_s * dt_s / 3.0
        noise[_P, _V] = noise[_V, _P] = q * dt_s / 2.0
        noise[_V, _V] = q
        noise[_B, _B] = self._q_bias * dt_s
        self._filter.predict()

    # ------------------------------------------------------------ updates

    def update(
        self,
        position_ned_m: Vector3,
        velocity_ned_m_s: Vector3,
        position_sigma_m: float,
        velocity_sigma_m_s: float,
    ) -> tuple[Tested, Tested]:
        """Fuse position and velocity of one instant in one step; each has its own gate."""
        variance_p, variance_v = _variance(position_sigma_m), _variance(velocity_sigma_m_s)
        predicted_p, predicted_v, _ = self._filter.x.tolist()
        (p00, _, _), (_, p11, _), _ = self._filter.P.tolist()
        position = self._test(position_ned_m, predicted_p, p00 + variance_p)
        velocity = self._test(velocity_ned_m_s, predicted_v, p11 + variance_v)
        if position.fused and velocity.fused:
            noise = self._noise_of_both
            noise[0, 0], noise[1, 1] = variance_p, variance_v
            self._fuse(np.array([position_ned_m, velocity_ned_m_s]), noise, _BOTH)
        elif position.fused:
            self._fuse(np.array([position_ned_m]), np.array([[variance_p]]), _POSITION)
        elif velocity.fused:
            self._fuse(np.array([velocity_ned_m_s]), np.array([[variance_v]]), _VELOCITY)
        return position, velocity

    def update_gnss(self, position_ne_m: Point, sigma_m: float) -> Tested:
        """Fuse a GNSS position, placed anywhere but always alike; the first one is the bias."""
        if not self._bias_known:
            return self.start_bias(position_ne_m, sigma_m)
        variance = _variance(sigma_m)
        (pn, pe, pd), _, (bn, be, bd) = self._filter.x.tolist()
        p = self._filter.P
        dn, de = position_ne_m[0] - pn - bn, position_ne_m[1] - pe - be
        tested = self._judged(
            (dn * dn, de * de), float(p[_P, _P] + 2.0 * p[_P, _B] + p[_B, _B]) + variance
        )
        if tested.fused:
            # What is not measured is as it was predicted to be.
            z = np.array([[*position_ne_m, pd + bd]])
            self._fuse(z, np.array([[variance]]), _GNSS)
        return tested

    def start_bias(self, position_ne_m: Point, sigma_m: float) -> Tested:
        """The bias is what this GNSS position says, whatever was known of it."""
        if not math.isfinite(position_ne_m[0] + position_ne_m[1]):
            return Tested(math.inf, fused=False)
        x, p = self._filter.x.copy(), self._filter.P.copy()
        x[_B] = (position_ne_m[0] - x[_P, 0], position_ne_m[1] - x[_P, 1], 0.0)
        # b = z - p: its error is the measurement's and, turned round, the position's.
        p[_B, :_B] = p[:_B, _B] = -p[_P, :_B]
        p[_B, _B] = p[_P, _P] + _variance(sigma_m)
        self._filter.x, self._filter.P, self._bias_known = x, p, True
        return Tested(0.0, fused=True)

    def _test(self, measured: Vector3, predicted: list[float], variance: float) -> Tested:
        """A vector against what was predicted, with the innovation variance of its axes."""
        (mn, me, md), (pn, pe, pd) = measured, predicted
        dn, de, dd = mn - pn, me - pe, md - pd
        return self._judged((dn * dn, de * de, dd * dd), variance)

    def _judged(self, squares: tuple[float, ...], variance: float) -> Tested:
        """`squares` of the innovations, with the innovation variance that they share."""
        nis = sum(squares) / variance
        # max() may pass over a NaN; the sum does not.
        if not math.isfinite(nis):
            return Tested(math.inf, fused=False, nis=math.inf)
        ratio = max(squares) / (self._gate2 * variance)
        return Tested(ratio, ratio <= 1.0, nis)

    def _fuse(self, measured: Matrix, noise: Matrix, observation: Matrix) -> None:
        # filterpy takes a z with one column for each axis when H is handed over with it.
        self._filter.R = noise
        self._filter.update(measured, H=observation)
        p = self._filter.P
        p += p.T
        p *= 0.5


def moved(snapshot: Snapshot, offset_ned_m: Vector3) -> Snapshot:
    """The same in a frame that jumped: what is in it moves, and GNSS stays where it was."""
    x = snapshot.x.copy()
    x[_P] += offset_ned_m
    x[_B] -= (offset_ned_m[0], offset_ned_m[1], 0.0)
    return snapshot._replace(x=x)


def _inverse(s: Matrix) -> Matrix:
    """Inverse of a 1 x 1 or 2 x 2 matrix in closed form (numpy's costs five times as much)."""
    if s.shape[0] == 1:
        return np.array([[1.0 / s[0, 0]]])
    a, b, c, d = s.ravel().tolist()
    det = a * d - b * c
    return np.array([[d / det, -b / det], [-c / det, a / det]])


def _variance(sigma: float) -> float:
    """sigma^2, never so small that a division by it could fail."""
    return max(sigma * sigma, _VARIANCE_MIN)
