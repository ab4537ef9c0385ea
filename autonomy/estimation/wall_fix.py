"""The drift of the autopilot's frame against the room, from beams on walls that are known already.

The autopilot's local position is wrong by some centimetres for some seconds, and may run away
slowly; a map that is laid by it disagrees with itself. Two beams on one wall do not: where a ray
ends on a surface that was mapped a while ago, the distance to that surface along its normal says
by how much the frame has moved since. Hence a Kalman filter over

    wander_ne   what comes and goes: Ornstein-Uhlenbeck, `wander_sigma_m` and `wander_s`
    drift_ne    what stays: a random walk of `drift_m_per_sqrt_s`, and a rate of `drift_rate_m_s`
                that lasts a minute, so that the frame is followed where no wall is in reach
    yaw         the error of the heading, which turns a slanting ray into a longer one

with scalar innovations, each through a gate. Along a corridor nothing is measured, and nothing
corrected but that the wander fades. The offset, wander and drift together, is what the mission
frame's origin is moved by: map, goal and fence stay where they are in the room.

References are lines fitted to hits that are older than `settle_s`, piece by piece
(`kernels.py`): not posts, corners or edges, not at a grazing angle. An innovation beyond the gate
moves nothing; it counts against the surface, and a surface that is contradicted again and again
is forgotten: the object was moved, or the frame was lost. So is what no ray has met for two turns
where old and new hits make no line any more: a moved object, or the other side of a thin wall.
What is within the gate cannot be told from drift where it is alone; then the frame follows, by
`gate_m` at most for one step of one object.
"""

import math
from collections.abc import Iterable
from typing import Protocol

import numpy as np
import numpy.typing as npt

from autonomy.config import WallsConfig
from autonomy.estimation import kernels
from autonomy.geometry import Point
from autonomy.model import WallFixReport
from hal.config import Fence
from hal.frames import Vector3

FloatArray = npt.NDArray[np.float64]

MARGIN_M = 1.2
"""The reference reaches as far beyond the fence as the beams do."""
CELL_M = 0.1
REACH_M = 0.12
"""Hits whose cell's mean is nearer than this to a ray's end belong to the surface there."""
THICK_M = 0.025
"""A surface's standard deviation across is less than this, ..."""
LENGTH_M = 0.03
"""... along it more."""
INCIDENCE_COS = 0.6
"""Rays that meet a surface at more than 53 degrees from its normal say too little of it."""
HITS_MIN, HITS_MAX = 5.0, 60.0
"""A surface is known from so many hits on; more than so many of a cell do not count."""
RANGE_SIGMA_M, RANGE_SIGMA_FRACTION = 0.005, 0.01
SURFACE_SIGMA_M = 0.01
"""How rough walls and their fits are."""
INFLATION = 4.0
"""Readings of one wall share its error: each counts as a quarter of one."""
YAW_SIGMA_RAD, YAW_S = math.radians(1.0), 5.0
RATE_S = 60.0
"""For so long a drift goes on at its rate."""
DOUBTS = 30.0
"""Contradictions, less confirmations, after which a surface is forgotten."""
ONE_SIDED = 0.65
"""Length of the mean direction that a cell's hits were seen in; less: both sides of a thin wall."""
STALE_S = 3.0
"""Two turns: where hits make no surface, those cells are in doubt that had none for so long."""
STEP_MAX_S = 1.0


class WallRay(Protocol):
    """One horizontal reading that ended on something, laid into the plane of flight."""

    @property
    def origin_ned_m(self) -> Vector3:
        """The sensor's face."""
        ...

    @property
    def bearing_rad(self) -> float:
        """Where it looks."""
        ...

    @property
    def length_m(self) -> float:
        """Horizontal length."""
        ...


class WallFix:
    """Owns the filter and its reference of walls; one `step` per tick. Deterministic."""

    def __init__(self, config: WallsConfig, fence: Fence) -> None:
        self._config = config
        north_min, north_max, east_min, east_max = fence.bounds()
        shape = (
            math.ceil((north_max - north_min + 2.0 * MARGIN_M) / CELL_M),
            math.ceil((east_max - east_min + 2.0 * MARGIN_M) / CELL_M),
        )
        self._settled = np.zeros((*shape, kernels.MOMENTS))
        self._fresh = np.zeros((*shape, kernels.MOMENTS))
        self._times = np.zeros((*shape, kernels.TIMES))
        self._doubts = np.zeros(shape)
        self._params = _parameters(config, north_min - MARGIN_M, east_min - MARGIN_M)
        self._state = np.zeros(kernels.STATES)
        wander, rate = config.wander_sigma_m**2, config.drift_rate_m_s**2
        self._covariance = np.diag([wander, wander, 0.0, 0.0, YAW_SIGMA_RAD**2, rate, rate])
        self._rays = np.zeros((16, kernels.RAY_COLUMNS))
        self._told = np.zeros(kernels.TOLD)
        self._last_s: float | None = None
        self._fused = self._rejected = self._forgotten = 0
        self.offset_ne_m: Point = (0.0, 0.0)
        """What the autopilot's frame is taken to be wrong by: its position less this is the
        room's.
        """

    def step(self, now_s: float, rays: Iterable[WallRay], *, learn: bool) -> WallFixReport:
        """Take in what ended on something this tick, and follow with the offset.

        Rays are in the mission frame, laid with the present offset. `learn` False: they are
        measured, but nothing new is laid down (the vehicle is between two heights).
        """
        dt_s = 0.0 if self._last_s is None else min(max(0.0, now_s - self._last_s), STEP_MAX_S)
        self._last_s = now_s
        kernels.observe(
            self._settled,
            self._fresh,
            self._times,
            self._doubts,
            self._params,
            self._state,
            self._covariance,
            self._rays,
            self._fill(rays),
            now_s,
            dt_s,
            self._told,
            learn,
        )
        self._follow(self._config.correction_max_m_s * dt_s)
        return self._report()

    def _fill(self, rays: Iterable[WallRay]) -> int:
        """The kernel's table: rays as the autopilot's frame has them; returns how many."""
        north_m, east_m = self.offset_ne_m
        count = 0
        for ray in rays:
            if count == len(self._rays):
                self._rays = np.concatenate((self._rays, np.zeros_like(self._rays)))
            origin, bearing = ray.origin_ned_m, ray.bearing_rad
            self._rays[count] = (
                origin[0] + north_m,
                origin[1] + east_m,
                math.cos(bearing),
                math.sin(bearing),
                ray.length_m,
            )
            count += 1
        return count

    def _follow(self, step_max_m: float) -> None:
        """Move the offset towards the filter's, no faster than is allowed, and not too far."""
        wander_n, wander_e, drift_n, drift_e = self._state[:4].tolist()
        north_m, east_m = self.offset_ne_m
        dn, de = wander_n + drift_n - north_m, wander_e + drift_e - east_m
        length_m = math.hypot(dn, de)
        if length_m > step_max_m:
            dn, de = dn * step_max_m / length_m, de * step_max_m / length_m
        north_m, east_m = north_m + dn, east_m + de
        limit = self._config.correction_max_m / max(math.hypot(north_m, east_m), 1e-9)
        self.offset_ne_m = (north_m * min(1.0, limit), east_m * min(1.0, limit))

    def _report(self) -> WallFixReport:
        fused, rejected, ratio, forgotten = self._told.tolist()
        self._fused += int(fused)
        self._rejected += int(rejected)
        self._forgotten += int(forgotten)
        p = self._covariance
        north2 = float(p[0, 0] + 2.0 * p[0, 2] + p[2, 2])
        east2 = float(p[1, 1] + 2.0 * p[1, 3] + p[3, 3])
        return WallFixReport(
            offset_ne_m=self.offset_ne_m,
            sigma_ne_m=(math.sqrt(max(north2, 0.0)), math.sqrt(max(east2, 0.0))),
            test_ratio=ratio,
            fused=self._fused,
            rejected=self._rejected,
            forgotten=self._forgotten,
        )


def _parameters(config: WallsConfig, north0_m: float, east0_m: float) -> FloatArray:
    params = np.zeros(kernels.PARAMS)
    params[kernels.P_NORTH0], params[kernels.P_EAST0] = north0_m, east0_m
    params[kernels.P_CELL] = CELL_M
    params[kernels.P_SETTLE] = config.settle_s
    params[kernels.P_HITS_MIN], params[kernels.P_HITS_MAX] = HITS_MIN, HITS_MAX
    params[kernels.P_REACH] = REACH_M
    params[kernels.P_THICK], params[kernels.P_LENGTH] = THICK_M, LENGTH_M
    params[kernels.P_COS] = INCIDENCE_COS
    params[kernels.P_GATE], params[kernels.P_GATE_M] = config.gate_sigma, config.gate_m
    params[kernels.P_RANGE] = RANGE_SIGMA_M
    params[kernels.P_RANGE_FRACTION] = RANGE_SIGMA_FRACTION
    params[kernels.P_SURFACE] = SURFACE_SIGMA_M
    params[kernels.P_INFLATION], params[kernels.P_DOUBTS] = INFLATION, DOUBTS
    params[kernels.P_WANDER], params[kernels.P_WANDER_S] = config.wander_sigma_m, config.wander_s
    params[kernels.P_DRIFT] = config.drift_m_per_sqrt_s
    params[kernels.P_YAW], params[kernels.P_YAW_S] = YAW_SIGMA_RAD, YAW_S
    params[kernels.P_STALE], params[kernels.P_ONE_SIDED] = STALE_S, ONE_SIDED
    params[kernels.P_RATE], params[kernels.P_RATE_S] = config.drift_rate_m_s, RATE_S
    return params
