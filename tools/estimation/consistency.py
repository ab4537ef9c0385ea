"""NEES and NIS: are the filter's errors as large as it believes?

The truth is drawn from the filter's own model, and a fix comes late. What is tested is the
implementation: transition, noise, gates, gains, delays. Each mean over N runs of a quantity with k
degrees of freedom is chi-square(N k) / N distributed if the filter is right.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from autonomy.config import EstimationConfig
from autonomy.estimation.kalman import ACCELERATION_HOLDS_S, Kalman
from autonomy.estimation.timeline import GnssObservation, LocalObservation, Timeline
from hal.frames import Vector3

TICK_S = 0.05
GNSS_TICKS = 8
GNSS_DELAY_TICKS = 4
GNSS_SIGMA_M = 0.8
WITHIN = 0.95
Array = NDArray[np.float64]


@dataclass(frozen=True)
class Series:
    """One quantity: `values` has a row a run, a column a time; `degrees` of freedom each."""

    name: str
    degrees: int
    values: Array

    @property
    def bounds(self) -> tuple[float, float]:
        """Between these the mean of all runs lies at one time, 95 times of 100."""
        runs = self.values.shape[0]
        low, high = stats.chi2.interval(WITHIN, runs * self.degrees)
        return float(low) / runs, float(high) / runs

    @property
    def inside(self) -> float:
        """The share of times at which it does."""
        low, high = self.bounds
        means = self.values.mean(axis=0)
        return float(np.mean((means >= low) & (means <= high)))

    @property
    def mean(self) -> float:
        """Over all runs and times."""
        return float(self.values.mean())


class Truth:
    """Position, velocity and GNSS bias as the filter's model has them: rows p, v, b."""

    def __init__(self, config: EstimationConfig, rng: np.random.Generator) -> None:
        self._rng = rng
        density = config.acceleration_noise_m_s2**2 * ACCELERATION_HOLDS_S
        t = TICK_S
        noise = density * np.array([[t**3 / 3.0, t * t / 2.0], [t * t / 2.0, t]])
        self._root = np.linalg.cholesky(noise)
        self._walk = config.gnss_bias_noise_m_per_sqrt_s * np.sqrt(t)
        self.state: Array = np.zeros((3, 3))
        self.state[2, :2] = rng.normal(0.0, 3.0, 2)

    def step(self) -> None:
        """A tick passes."""
        self.state[0] += TICK_S * self.state[1]
        self.state[:2] += self._root @ self._rng.normal(0.0, 1.0, (2, 3))
        self.state[2, :2] += self._walk * self._rng.normal(0.0, 1.0, 2)


def consistency(runs: int, seconds: float, seed: int = 0) -> tuple[Series, ...]:
    """NEES of the state (8 degrees: p, v, b north and east; p, v down), NIS of each source."""
    seeds = np.random.SeedSequence(seed).spawn(runs)
    rows = [_run(np.random.default_rng(each), seconds) for each in seeds]
    names = (("NEES, state", 8), ("NIS, position", 3), ("NIS, velocity", 3), ("NIS, GNSS", 2))
    return tuple(
        Series(name, degrees, np.array([row[i] for row in rows]))
        for i, (name, degrees) in enumerate(names)
    )


def _run(rng: np.random.Generator, seconds: float) -> tuple[Sequence[float], ...]:
    config = EstimationConfig()
    kalman = Kalman(
        config.acceleration_noise_m_s2, config.gate_sigma, config.gnss_bias_noise_m_per_sqrt_s
    )
    timeline, truth = Timeline(kalman), Truth(config, rng)
    nees: list[float] = []
    nis: tuple[list[float], list[float], list[float]] = ([], [], [])
    waiting: list[tuple[int, GnssObservation]] = []
    for tick in range(round(seconds / TICK_S)):
        local = _local(truth, rng, config, tick * TICK_S)
        if tick == 0:
            timeline.begin(local)
        else:
            for each, tested in zip(nis[:2], timeline.insert(local) or (), strict=True):
                each.append(tested.nis)
        if tick % GNSS_TICKS == 0:
            waiting.append((tick + GNSS_DELAY_TICKS, _fix(truth, rng, tick * TICK_S)))
        if waiting and waiting[0][0] == tick:
            first = kalman.bias_ne_m is None
            (tested,) = timeline.insert(waiting.pop(0)[1]) or ()
            if not first:
                nis[2].append(tested.nis)
        if kalman.bias_ne_m is not None:
            nees.append(_nees(kalman, truth))
        truth.step()
    return (nees, *nis)


def _local(
    truth: Truth, rng: np.random.Generator, config: EstimationConfig, stamp_s: float
) -> LocalObservation:
    sigma_m, sigma_m_s = config.local_position_sigma_m, config.local_velocity_sigma_m_s
    position = truth.state[0] + rng.normal(0.0, sigma_m, 3)
    velocity = truth.state[1] + rng.normal(0.0, sigma_m_s, 3)
    return LocalObservation(stamp_s, _vector(position), _vector(velocity), sigma_m, sigma_m_s)


def _fix(truth: Truth, rng: np.random.Generator, stamp_s: float) -> GnssObservation:
    north, east = truth.state[0, :2] + truth.state[2, :2] + rng.normal(0.0, GNSS_SIGMA_M, 2)
    return GnssObservation(stamp_s, (float(north), float(east)), GNSS_SIGMA_M)


def _nees(kalman: Kalman, truth: Truth) -> float:
    snapshot = kalman.snapshot()
    error = truth.state - snapshot.x
    horizontal = error[:, :2]
    vertical = error[:2, 2]
    whole = float(np.sum(horizontal * np.linalg.solve(snapshot.p, horizontal)))
    return whole + float(vertical @ np.linalg.solve(snapshot.p[:2, :2], vertical))


def _vector(values: Array) -> Vector3:
    n, e, d = values.tolist()
    return (n, e, d)
