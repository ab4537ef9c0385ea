"""The one door to filterpy: a constant-velocity Kalman filter in local NED, gated like PX4's EKF2.

Constant velocity, piecewise constant random acceleration of standard deviation q over each
prediction interval:

    x = [position, velocity],  F = [[1, dt], [0, 1]],  Q = q^2 [[dt^4/4, dt^3/2], [dt^3/2, dt^2]]

North, east and down do not see each other and every measurement has one accuracy for all three,
so they are the three columns of one `x` and share one 2 x 2 covariance. filterpy updates it in
Joseph's form, which keeps it positive definite; rounding asymmetry is removed.

Words (PX4's): innovation = measured - predicted; test ratio = innovation^2 / (gate^2 * innovation
variance), the largest over the axes; a measurement is fused when it is <= 1, else rejected.
"""

import math
from typing import Any

import msgspec
import numpy as np
from filterpy.kalman import KalmanFilter
from numpy.typing import NDArray

from hal.frames import Vector3

Matrix = NDArray[np.float64]

_POSITION: Matrix = np.array([[1.0, 0.0]])
_VELOCITY: Matrix = np.array([[0.0, 1.0]])
_BOTH: Matrix = np.eye(2)
_VARIANCE_MIN = 1e-12


class Tested(msgspec.Struct, frozen=True):
    """What became of one measurement: its test ratio (inf for NaN), and whether it was fused."""

    test_ratio: float
    fused: bool


class Kalman:
    """Position and velocity in local NED, and the height of the surface below.

    The surface ("terrain") is a random walk of its own, measured by the height over it; it never
    moves the vehicle: over a table the surface rises, the altitude stays.
    """

    def __init__(
        self,
        acceleration_noise_m_s2: float,
        gate_sigma: float,
        terrain_noise_m_per_sqrt_s: float = 0.02,
    ) -> None:
        self._q2 = acceleration_noise_m_s2 * acceleration_noise_m_s2
        self._gate2 = gate_sigma * gate_sigma
        self._filter: Any = KalmanFilter(dim_x=2, dim_z=2)
        self._filter.inv = _inverse
        self.start((0.0, 0.0, 0.0), (0.0, 0.0, 0.0), 1.0, 1.0)
        self._terrain_q = terrain_noise_m_per_sqrt_s * terrain_noise_m_per_sqrt_s
        self._terrain_down_m: float | None = None
        self._terrain_variance_m2 = 0.0

    def start(
        self,
        position_ned_m: Vector3,
        velocity_ned_m_s: Vector3,
        position_sigma_m: float,
        velocity_sigma_m_s: float,
    ) -> None:
        """Begin (again) from one measurement and its accuracies. The surface below is kept."""
        self._filter.x = np.array([position_ned_m, velocity_ned_m_s], dtype=np.float64)
        self._filter.P = np.diag([_variance(position_sigma_m), _variance(velocity_sigma_m_s)])

    @property
    def position_ned_m(self) -> Vector3:
        """Position at the last prediction or update."""
        n, e, d = self._filter.x[0].tolist()
        return (n, e, d)

    @property
    def velocity_ned_m_s(self) -> Vector3:
        """Velocity at the last prediction or update."""
        n, e, d = self._filter.x[1].tolist()
        return (n, e, d)

    @property
    def covariance(self) -> Matrix:
        """2 x 2 covariance of (position, velocity), the same for each axis; a copy."""
        copy: Matrix = self._filter.P.copy()
        return copy

    @property
    def terrain_down_m(self) -> float | None:
        """Down coordinate of the surface below; None before the first height."""
        return self._terrain_down_m

    def position_sigma_m(self, dt_s: float = 0.0) -> float:
        """One-sigma uncertainty of each axis when nothing is measured for `dt_s` seconds more."""
        (p00, p01), (_, p11) = self._filter.P.tolist()
        dt2 = dt_s * dt_s
        variance: float = p00 + 2.0 * dt_s * p01 + dt2 * p11 + self._q2 * dt2 * dt2 / 4.0
        return math.sqrt(variance)

    # ------------------------------------------------------------ prediction

    def predict(self, dt_s: float) -> None:
        """Move on by `dt_s` seconds; does nothing for `dt_s` <= 0 (time never runs back)."""
        if not dt_s > 0.0:
            return
        dt2 = dt_s * dt_s
        q01 = self._q2 * dt2 * dt_s / 2.0
        self._filter.predict(
            F=np.array([[1.0, dt_s], [0.0, 1.0]]),
            Q=np.array([[self._q2 * dt2 * dt2 / 4.0, q01], [q01, self._q2 * dt2]]),
        )
        self._terrain_variance_m2 += self._terrain_q * dt_s

    def shift(self, offset_ned_m: Vector3) -> None:
        """The frame moved: the position changes, and the surface with it; certainty does not."""
        self._filter.x[0] += offset_ned_m
        if self._terrain_down_m is not None:
            self._terrain_down_m += offset_ned_m[2]

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
        ratio_p = self._test_ratio(0, position_ned_m, variance_p)
        ratio_v = self._test_ratio(1, velocity_ned_m_s, variance_v)
        if ratio_p <= 1.0 and ratio_v <= 1.0:
            noise = np.array([[variance_p, 0.0], [0.0, variance_v]])
            self._fuse(np.array([position_ned_m, velocity_ned_m_s]), noise, _BOTH)
        elif ratio_p <= 1.0:
            self._fuse(np.array([position_ned_m]), np.array([[variance_p]]), _POSITION)
        elif ratio_v <= 1.0:
            self._fuse(np.array([velocity_ned_m_s]), np.array([[variance_v]]), _VELOCITY)
        return Tested(ratio_p, ratio_p <= 1.0), Tested(ratio_v, ratio_v <= 1.0)

    def update_position(self, position_ned_m: Vector3, sigma_m: float) -> Tested:
        """Fuse a position, if it passes the gate."""
        variance = _variance(sigma_m)
        ratio = self._test_ratio(0, position_ned_m, variance)
        if ratio <= 1.0:
            self._fuse(np.array([position_ned_m]), np.array([[variance]]), _POSITION)
        return Tested(ratio, ratio <= 1.0)

    def update_velocity(self, velocity_ned_m_s: Vector3, sigma_m_s: float) -> Tested:
        """Fuse a velocity, if it passes the gate."""
        variance = _variance(sigma_m_s)
        ratio = self._test_ratio(1, velocity_ned_m_s, variance)
        if ratio <= 1.0:
            self._fuse(np.array([velocity_ned_m_s]), np.array([[variance]]), _VELOCITY)
        return Tested(ratio, ratio <= 1.0)

    def update_height(self, height_m: float, sigma_m: float) -> Tested:
        """Fuse a height over the surface below into the surface; the first one is taken as it is.

        A step (a table) is rejected; `start_terrain` accepts it.
        """
        if self._terrain_down_m is None:
            self.start_terrain(height_m, sigma_m)
            return Tested(0.0 if math.isfinite(height_m) else math.inf, math.isfinite(height_m))
        noise = _variance(sigma_m) + float(self._filter.P[0, 0])
        variance = self._terrain_variance_m2 + noise
        innovation = float(self._filter.x[0, 2]) + height_m - self._terrain_down_m
        ratio = innovation * innovation / (self._gate2 * variance)
        if not ratio <= 1.0:
            return Tested(ratio if math.isfinite(ratio) else math.inf, fused=False)
        gain = self._terrain_variance_m2 / variance
        self._terrain_down_m += gain * innovation
        self._terrain_variance_m2 *= 1.0 - gain
        return Tested(ratio, fused=True)

    def start_terrain(self, height_m: float, sigma_m: float) -> None:
        """The surface below is now the one at this height; ignored unless it is a number."""
        if math.isfinite(height_m):
            self._terrain_down_m = float(self._filter.x[0, 2]) + height_m
            self._terrain_variance_m2 = _variance(sigma_m) + float(self._filter.P[0, 0])

    def _test_ratio(self, row: int, measured: Vector3, variance: float) -> float:
        """Test ratio of a position (`row` 0) or velocity (1)."""
        n, e, d = self._filter.x[row].tolist()
        dn, de, dd = measured[0] - n, measured[1] - e, measured[2] - d
        # max() may pass over a NaN; the sum does not.
        if not math.isfinite(dn + de + dd):
            return math.inf
        scale: float = self._gate2 * (float(self._filter.P[row, row]) + variance)
        return float(max(dn * dn, de * de, dd * dd) / scale)

    def _fuse(self, measured: Matrix, noise: Matrix, observation: Matrix) -> None:
        # filterpy takes a z with one column for each axis when H is handed over with it.
        self._filter.update(measured, R=noise, H=observation)
        p = self._filter.P
        p[0, 1] = p[1, 0] = 0.5 * (p[0, 1] + p[1, 0])


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
