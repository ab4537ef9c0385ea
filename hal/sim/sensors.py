"""Simulated sensors: range beams, GNSS, and how wrong the autopilot's own estimate is.

All randomness comes from the generator handed in, drawn in blocks for speed; the same seed and
the same calls give the same readings.
"""

import math
from collections import deque
from typing import Generic, Protocol, TypeVar

import msgspec
import numpy as np

from hal.config import BeamMount, BeamsConfig
from hal.frames import Vector3, geodetic_from_ned
from hal.readings import FixType, GnssFix, RangeReading, RangeStatus
from hal.sim.scenario import BeamSimulation, EstimatorSimulation, GnssSimulation
from hal.sim.world import RayBundles, World

T = TypeVar("T")

_BLOCK = 256


class BeamSampler(Protocol):
    """What measures ranges from a true pose: the simulated beams, or a fault around them."""

    @property
    def beams(self) -> tuple[str, ...]:
        """The names of the beams."""
        ...

    def sample(
        self,
        now_s: float,
        position_ned_m: Vector3,
        roll_rad: float,
        pitch_rad: float,
        yaw_rad: float,
    ) -> tuple[RangeReading, ...]:
        """The readings that become known at `now_s`; empty when none is due."""
        ...


class _Rows:
    """Rows of random numbers, drawn a block at a time; copied with its place in the stream."""

    def __init__(self, rng: np.random.Generator, width: int, *, normal: bool) -> None:
        self._rng, self._width, self._normal = rng, width, normal
        self._block: list[list[float]] = []
        self._at = 0

    def __next__(self) -> list[float]:
        if self._at == len(self._block):
            shape = (_BLOCK, self._width)
            rng = self._rng
            drawn = rng.standard_normal(shape) if self._normal else rng.random(shape)
            self._block, self._at = drawn.tolist(), 0
        self._at += 1
        return self._block[self._at - 1]


def _normal_rows(rng: np.random.Generator, width: int) -> _Rows:
    return _Rows(rng, width, normal=True)


def _uniform_rows(rng: np.random.Generator, width: int) -> _Rows:
    return _Rows(rng, width, normal=False)


class _Rate:
    """Says when the next measurement is due; keeps its phase, so that jitter does not add up."""

    def __init__(self, rate_hz: float) -> None:
        self._period_s = 1.0 / rate_hz
        self._due_s = -math.inf

    def due(self, now_s: float) -> bool:
        # A quarter of a period early counts: a caller at the same rate, but jittering, must not
        # be answered every other time only.
        if now_s < self._due_s - 0.25 * self._period_s:
            return False
        late = now_s - self._due_s >= self._period_s
        self._due_s = (now_s if late else self._due_s) + self._period_s
        return True


class _Delay(Generic[T]):
    """Hands out what was put in `delay_s` ago."""

    def __init__(self, delay_s: float) -> None:
        self._delay_s = delay_s
        self._waiting: deque[tuple[float, T]] = deque()

    def put(self, now_s: float, value: T) -> None:
        self._waiting.append((now_s + self._delay_s - 1e-9, value))

    def take(self, now_s: float) -> T | None:
        """The newest value whose time has come, or None."""
        value = None
        while self._waiting and self._waiting[0][0] <= now_s:
            value = self._waiting.popleft()[1]
        return value


class SimulatedBeams:
    """Range beams that look into a world.

    A reading is the true distance from the sensor's face plus Gaussian noise, rounded to the
    model's quantum. `variance_m2` is what the model really does: noise and rounding; for NO_SIGNAL
    that of a distance of which nothing is known (uniform up to the maximum range).
    """

    def __init__(
        self, world: World, beams: BeamsConfig, model: BeamSimulation, rng: np.random.Generator
    ) -> None:
        self._world = world
        self._config = beams
        self._model = model
        mounts = beams.mounts
        self._names = tuple(mount.name for mount in mounts)
        self._bundles = RayBundles(
            tuple((mount.forward_m, mount.right_m, mount.down_m) for mount in mounts),
            tuple(axis_frd(mount) for mount in mounts),
            math.radians(model.half_angle_deg),
        )
        self._normals = _normal_rows(rng, len(mounts))
        self._uniforms = _uniform_rows(rng, len(mounts))
        self._rate = _Rate(model.rate_hz)
        self._delay: _Delay[tuple[RangeReading, ...]] = _Delay(model.delay_s)

    @property
    def beams(self) -> tuple[str, ...]:
        """The names of the beams, in the order of their mounts."""
        return self._names

    def sample(
        self,
        now_s: float,
        position_ned_m: Vector3,
        roll_rad: float,
        pitch_rad: float,
        yaw_rad: float,
    ) -> tuple[RangeReading, ...]:
        """One reading per beam when a measurement becomes known at `now_s`, else nothing.

        The arguments are the true pose at `now_s`; readings carry the time they were measured at.
        """
        if self._rate.due(now_s):
            distances = self._world.at(now_s, position_ned_m).cast_many(
                position_ned_m, roll_rad, pitch_rad, yaw_rad, self._bundles
            )
            rows = zip(
                self._names, distances, next(self._normals), next(self._uniforms), strict=True
            )
            self._delay.put(now_s, tuple([self._reading(now_s, *row) for row in rows]))
        return self._delay.take(now_s) or ()

    def _reading(
        self, now_s: float, beam: str, distance_m: float, normal: float, uniform: float
    ) -> RangeReading:
        model, low, high = self._model, self._config.min_m, self._config.max_m
        if uniform < model.dropout_probability:
            unknown = high * high / 12.0
            return RangeReading(now_s, beam, RangeStatus.NO_SIGNAL, 0.0, unknown, low, high)
        # Beyond twice the maximum, no noise brings a return back into range.
        seen_m = min(distance_m, 2.0 * high)
        measured = seen_m + normal * (model.sigma_m + model.sigma_fraction * seen_m)
        quantum = model.quantum_m
        if quantum > 0.0:
            measured = round(measured / quantum) * quantum
        status = RangeStatus.VALID
        if measured < low:
            status, measured = RangeStatus.TOO_NEAR, low
        elif measured > high + 1e-9:
            status, measured = RangeStatus.OUT_OF_RANGE, high
        sigma = model.sigma_m + model.sigma_fraction * measured
        variance = sigma * sigma + quantum * quantum / 12.0
        return RangeReading(now_s, beam, status, measured, variance, low, high)


def axis_frd(mount: BeamMount) -> Vector3:
    """The unit vector along which a beam looks, in the body frame."""
    yaw, pitch = math.radians(mount.yaw_deg), math.radians(mount.pitch_deg)
    return (
        math.cos(pitch) * math.cos(yaw),
        math.cos(pitch) * math.sin(yaw),
        -math.sin(pitch),
    )


class SimulatedGnss:
    """A GNSS receiver with white noise that tells its fixes `delay_s` late."""

    def __init__(self, model: GnssSimulation, rng: np.random.Generator) -> None:
        self._model = model
        self._normals = _normal_rows(rng, 3)
        self._rate = _Rate(model.rate_hz)
        self._delay: _Delay[GnssFix] = _Delay(model.delay_s)

    def sample(self, now_s: float, position_ned_m: Vector3) -> GnssFix | None:
        """The fix that becomes known at `now_s`, stamped with the time it was measured at.

        `position_ned_m` is the true position at `now_s`. None when there is no new fix.
        """
        if self._rate.due(now_s):
            self._delay.put(now_s, self._fix(now_s, position_ned_m))
        return self._delay.take(now_s)

    def _fix(self, now_s: float, position_ned_m: Vector3) -> GnssFix:
        model = self._model
        (north, east, down), noise = position_ned_m, next(self._normals)
        horizontal, vertical = model.horizontal_sigma_m, model.vertical_sigma_m
        latitude, longitude, amsl = geodetic_from_ned(
            (
                north + horizontal * noise[0],
                east + horizontal * noise[1],
                down + vertical * noise[2],
            ),
            model.origin,
        )
        return GnssFix(
            stamp_s=now_s,
            fix_type=FixType.FIX_3D,
            latitude_deg=latitude,
            longitude_deg=longitude,
            amsl_m=amsl,
            horizontal_accuracy_m=horizontal,
            vertical_accuracy_m=vertical,
            satellites=model.satellites,
        )


class EstimateOffset(msgspec.Struct, frozen=True):
    """Estimate minus truth."""

    position_ned_m: Vector3
    velocity_ned_m_s: Vector3
    yaw_rad: float


class EstimatorError:
    """The wandering error of the autopilot's estimate: one Ornstein-Uhlenbeck process per axis.

    Exact discretisation, x' = a x + sigma sqrt(1 - a^2) N(0, 1) with a = exp(-dt / correlation);
    it starts in its stationary distribution, so that the spread is the same at every time.
    """

    def __init__(self, model: EstimatorSimulation, rng: np.random.Generator) -> None:
        horizontal, velocity = model.position_sigma_m, model.velocity_sigma_m_s
        self._sigmas = (
            horizontal,
            horizontal,
            model.height_sigma_m,
            velocity,
            velocity,
            velocity,
            math.radians(model.yaw_sigma_deg),
        )
        self._correlation_s = model.correlation_s
        self._normals = _normal_rows(rng, len(self._sigmas))
        first = next(self._normals)
        self._values = [s * n for s, n in zip(self._sigmas, first, strict=True)]

    def step(self, dt_s: float) -> EstimateOffset:
        """Let `dt_s` >= 0 seconds pass; what the error is then."""
        keep = math.exp(-dt_s / self._correlation_s)
        fresh = math.sqrt(1.0 - keep * keep)
        draws = zip(self._values, self._sigmas, next(self._normals), strict=True)
        self._values = values = [keep * v + fresh * s * n for v, s, n in draws]
        n, e, d, vn, ve, vd, yaw = values
        return EstimateOffset((n, e, d), (vn, ve, vd), yaw)
