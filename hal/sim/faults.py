"""Faults as decorators: they stand around a healthy source and spoil what it says.

Nothing else in the simulation knows of them. Which fault comes when is the scenario's `faults`;
its times count from `since_s`, the time at which the simulation began.
"""

from collections.abc import Iterable
from typing import TypeVar

import msgspec
import numpy as np

from hal.errors import DocumentError
from hal.frames import Vector3, add
from hal.readings import LocalPosition, RangeReading, RangeStatus
from hal.sim.scenario import (
    BeamFault,
    BeamNoise,
    FaultWindow,
    PositionFault,
    PositionNoise,
)
from hal.sim.sensors import BeamSampler

W = TypeVar("W", bound=FaultWindow)


def with_beam_faults(
    sampler: BeamSampler,
    faults: Iterable[FaultWindow],
    rng: np.random.Generator,
    since_s: float = 0.0,
) -> BeamSampler:
    """`sampler` with those of `faults` around it that concern beams; itself when none does.

    Raises DocumentError when a fault names a beam that the vehicle does not have.
    """
    mine = tuple(fault for fault in faults if isinstance(fault, BeamFault | BeamNoise))
    for fault in mine:
        if fault.beam is not None and fault.beam not in sampler.beams:
            raise DocumentError(
                f"the scenario's fault {fault.kind} is for beam {fault.beam!r}, which the vehicle "
                f"does not have: use one of {', '.join(sampler.beams)}, or leave beam out for all"
            )
    return FaultyBeams(sampler, mine, rng, since_s) if mine else sampler


class FaultyBeams:
    """Beams some of which misbehave at times."""

    def __init__(
        self,
        sampler: BeamSampler,
        faults: tuple[BeamFault | BeamNoise, ...],
        rng: np.random.Generator,
        since_s: float,
    ) -> None:
        self._sampler = sampler
        self._faults = faults
        self._rng = rng
        self._since_s = since_s
        self._last: dict[str, RangeReading] = {}

    @property
    def beams(self) -> tuple[str, ...]:
        """The names of the beams."""
        return self._sampler.beams

    def sample(
        self,
        now_s: float,
        position_ned_m: Vector3,
        roll_rad: float,
        pitch_rad: float,
        yaw_rad: float,
    ) -> tuple[RangeReading, ...]:
        """What the beams say with the faults of this moment, in the order of the scenario."""
        readings = self._sampler.sample(now_s, position_ned_m, roll_rad, pitch_rad, yaw_rad)
        active = _active(self._faults, now_s - self._since_s)
        spoilt = (self._spoil(reading, active) for reading in readings)
        return tuple(reading for reading in spoilt if reading is not None)

    def _spoil(
        self, reading: RangeReading, active: tuple[BeamFault | BeamNoise, ...]
    ) -> RangeReading | None:
        kinds = [fault for fault in active if fault.beam in (None, reading.beam)]
        if not any(fault.kind == "beam_stuck" for fault in kinds):
            self._last[reading.beam] = reading
        spoilt: RangeReading | None = reading
        for fault in kinds:
            if spoilt is not None:
                spoilt = self._apply(fault, spoilt)
        return spoilt

    def _apply(self, fault: BeamFault | BeamNoise, reading: RangeReading) -> RangeReading | None:
        if isinstance(fault, BeamNoise):
            return self._noisier(reading, fault.sigma_m)
        if fault.kind == "beam_silence":
            return None
        if fault.kind == "beam_stuck":
            # A beam that never measured before sticks to the first thing it sees.
            last = self._last.setdefault(reading.beam, reading)
            return msgspec.structs.replace(last, stamp_s=reading.stamp_s)
        unknown = reading.max_m * reading.max_m / 12.0
        return msgspec.structs.replace(
            reading, status=RangeStatus.NO_SIGNAL, range_m=0.0, variance_m2=unknown
        )

    def _noisier(self, reading: RangeReading, sigma_m: float) -> RangeReading:
        if reading.status is not RangeStatus.VALID:
            return reading
        range_m = reading.range_m + sigma_m * self._rng.standard_normal()
        if range_m < reading.min_m:
            return msgspec.structs.replace(
                reading, status=RangeStatus.TOO_NEAR, range_m=reading.min_m
            )
        if range_m > reading.max_m:
            return msgspec.structs.replace(
                reading, status=RangeStatus.OUT_OF_RANGE, range_m=reading.max_m
            )
        return msgspec.structs.replace(reading, range_m=range_m)


class PositionFaults:
    """Stands between the simulated estimator and whoever listens to it."""

    def __init__(
        self, faults: Iterable[FaultWindow], rng: np.random.Generator, since_s: float = 0.0
    ) -> None:
        self._faults = tuple(f for f in faults if isinstance(f, PositionFault | PositionNoise))
        self._rng = rng
        self._since_s = since_s
        self._last: LocalPosition | None = None

    def pass_on(self, estimate: LocalPosition) -> LocalPosition | None:
        """What is heard of `estimate`: itself, a spoilt one, or nothing."""
        if not self._faults:
            return estimate
        active = _active(self._faults, estimate.stamp_s - self._since_s)
        if not any(fault.kind == "position_stuck" for fault in active):
            self._last = estimate
        heard = estimate
        for fault in active:
            if isinstance(fault, PositionNoise):
                heard = self._noisier(heard, fault.sigma_m)
            elif fault.kind == "position_silence":
                return None
            else:
                self._last = self._last or estimate
                heard = msgspec.structs.replace(self._last, stamp_s=estimate.stamp_s)
        return heard

    def _noisier(self, estimate: LocalPosition, sigma_m: float) -> LocalPosition:
        n, e, d = (sigma_m * self._rng.standard_normal(3)).tolist()
        return msgspec.structs.replace(
            estimate, position_ned_m=add(estimate.position_ned_m, (n, e, d))
        )


def _active(faults: tuple[W, ...], elapsed_s: float) -> tuple[W, ...]:
    return tuple(fault for fault in faults if fault.active(elapsed_s))
