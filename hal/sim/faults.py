"""Faults of sensors as decorators: they stand around a healthy source and spoil what it says.

Nothing else in the simulation knows of them. Which fault comes when is the scenario's `faults`; a
`FaultClock` says when that is.
"""

import math
from collections import Counter
from collections.abc import Collection, Iterable

import msgspec
import numpy as np

from hal.errors import DocumentError
from hal.frames import EARTH_RADIUS_M, Vector3, add
from hal.readings import FixType, GnssFix, LocalPosition, RangeReading, RangeStatus
from hal.sim.fault_clock import FaultClock
from hal.sim.fault_kinds import (
    BeamBias,
    BeamBlocked,
    BeamConstant,
    BeamCrosstalk,
    BeamFault,
    BeamJump,
    BeamKind,
    BeamNoise,
    BeamSlow,
    BeamVariance,
    FaultWindow,
    GnssDrift,
    GnssJump,
    GnssLoss,
    GnssNoise,
    PositionFault,
    PositionNoise,
)
from hal.sim.sensors import BeamSampler

_PHASE_S = 0.005
"""A reading this much early counts as being in time."""


def with_beam_faults(
    sampler: BeamSampler,
    faults: Iterable[FaultWindow],
    rng: np.random.Generator,
    since_s: float = 0.0,
    clock: FaultClock | None = None,
) -> BeamSampler:
    """`sampler` with those of `faults` around it that concern beams; itself when none does.

    Without a `clock` the faults' times count from `since_s`, and nobody says when the vehicle
    lifted off. Raises DocumentError when a fault names a beam that the vehicle does not have.
    """
    mine = tuple(fault for fault in faults if isinstance(fault, BeamKind))
    check_beams(mine, sampler.beams)
    return FaultyBeams(sampler, mine, rng, clock or FaultClock(since_s)) if mine else sampler


def check_beams(faults: Iterable[FaultWindow], names: Collection[str]) -> None:
    """Raise DocumentError when a fault names a beam that is none of `names`."""
    for fault in faults:
        if not isinstance(fault, BeamKind):
            continue
        named = [fault.beam, fault.other] if isinstance(fault, BeamCrosstalk) else [fault.beam]
        for beam in named:
            if beam is not None and beam not in names:
                raise DocumentError(
                    f"the scenario's fault {fault.kind} is for beam {beam!r}, which the vehicle "
                    f"does not have: use one of {', '.join(names)}, or leave beam out for all"
                )


class FaultyBeams:
    """Beams some of which misbehave at times."""

    def __init__(
        self,
        sampler: BeamSampler,
        faults: tuple[BeamKind, ...],
        rng: np.random.Generator,
        clock: FaultClock,
    ) -> None:
        self._sampler = sampler
        self._faults = faults
        self._rng = rng
        self._clock = clock
        self._heard: dict[str, RangeReading] = {}
        self._last: dict[str, RangeReading] = {}
        self._passed_s: dict[str, float] = {}
        self.spoilt: Counter[str] = Counter()
        """How many readings of each beam came out otherwise than they were measured."""

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
        active = self._clock.active(self._faults, now_s)
        self._heard.update((reading.beam, reading) for reading in readings)
        spoilt = [(reading, self._spoil(reading, active)) for reading in readings]
        self.spoilt.update(before.beam for before, after in spoilt if after != before)
        return tuple(after for _, after in spoilt if after is not None)

    def _spoil(self, reading: RangeReading, active: tuple[BeamKind, ...]) -> RangeReading | None:
        kinds = [fault for fault in active if fault.beam in (None, reading.beam)]
        if not any(fault.kind == "beam_stuck" for fault in kinds):
            self._last[reading.beam] = reading
        spoilt: RangeReading | None = reading
        for fault in kinds:
            if spoilt is not None:
                spoilt = self._apply(fault, spoilt)
        return spoilt

    def _apply(self, fault: BeamKind, reading: RangeReading) -> RangeReading | None:
        if isinstance(fault, BeamFault):
            return self._failed(fault, reading)
        if isinstance(fault, BeamCrosstalk):
            return self._crossed(fault, reading)
        if isinstance(fault, BeamSlow):
            return self._slower(fault, reading)
        return self._measured_wrongly(fault, reading)

    def _measured_wrongly(
        self,
        fault: BeamNoise | BeamBias | BeamJump | BeamConstant | BeamBlocked | BeamVariance,
        reading: RangeReading,
    ) -> RangeReading:
        if isinstance(fault, BeamNoise):
            return _farther(reading, fault.sigma_m * self._rng.standard_normal())
        if isinstance(fault, BeamBias):
            return _farther(reading, fault.bias_m)
        if isinstance(fault, BeamJump):
            if self._rng.random() >= fault.probability:
                return reading
            return _farther(reading, fault.by_m * self._rng.uniform(-1.0, 1.0))
        if isinstance(fault, BeamVariance):
            claimed_m2 = reading.variance_m2 * fault.factor
            return msgspec.structs.replace(reading, variance_m2=claimed_m2)
        if isinstance(fault, BeamBlocked):
            return _saying(reading, reading.min_m - 1.0)
        return _saying(reading, math.inf if fault.range_m is None else fault.range_m)

    def _failed(self, fault: BeamFault, reading: RangeReading) -> RangeReading | None:
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

    def _slower(self, fault: BeamSlow, reading: RangeReading) -> RangeReading | None:
        last_s = self._passed_s.get(reading.beam, -math.inf)
        if reading.stamp_s - last_s < 1.0 / fault.rate_hz - _PHASE_S:
            return None
        self._passed_s[reading.beam] = reading.stamp_s
        return reading

    def _crossed(self, fault: BeamCrosstalk, reading: RangeReading) -> RangeReading:
        other = self._heard.get(fault.other)
        if other is None or self._rng.random() >= fault.probability:
            return reading
        return msgspec.structs.replace(other, beam=reading.beam, stamp_s=reading.stamp_s)


def _farther(reading: RangeReading, by_m: float) -> RangeReading:
    """A reading that is `by_m` farther, within what the beam can say."""
    if reading.status is not RangeStatus.VALID:
        return reading
    return _saying(reading, reading.range_m + by_m)


def _saying(reading: RangeReading, range_m: float) -> RangeReading:
    """A reading of `range_m`, whatever was measured, within what the beam can say."""
    if range_m < reading.min_m:
        return msgspec.structs.replace(reading, status=RangeStatus.TOO_NEAR, range_m=reading.min_m)
    if range_m > reading.max_m:
        return msgspec.structs.replace(
            reading, status=RangeStatus.OUT_OF_RANGE, range_m=reading.max_m
        )
    return msgspec.structs.replace(reading, status=RangeStatus.VALID, range_m=range_m)


class PositionFaults:
    """Stands between the simulated estimator and whoever listens to it."""

    def __init__(
        self,
        faults: Iterable[FaultWindow],
        rng: np.random.Generator,
        since_s: float = 0.0,
        clock: FaultClock | None = None,
    ) -> None:
        self._faults = tuple(f for f in faults if isinstance(f, PositionFault | PositionNoise))
        self._rng = rng
        self._clock = clock or FaultClock(since_s)
        self._last: LocalPosition | None = None

    def pass_on(self, estimate: LocalPosition) -> LocalPosition | None:
        """What is heard of `estimate`: itself, a spoilt one, or nothing."""
        if not self._faults:
            return estimate
        active = self._clock.active(self._faults, estimate.stamp_s)
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


class GnssFaults:
    """Stands between the simulated receiver and whoever listens to it."""

    def __init__(
        self, faults: Iterable[FaultWindow], rng: np.random.Generator, clock: FaultClock
    ) -> None:
        kinds = GnssLoss | GnssJump | GnssDrift | GnssNoise
        self._faults = tuple(f for f in faults if isinstance(f, kinds))
        self._rng = rng
        self._clock = clock

    def pass_on(self, now_s: float, fix: GnssFix | None) -> GnssFix | None:
        """What is heard of `fix` at `now_s`: itself, or a spoilt one."""
        if fix is None:
            return None
        for fault in self._clock.active(self._faults, now_s):
            if isinstance(fault, GnssLoss):
                return msgspec.structs.replace(fix, fix_type=FixType.NO_FIX, satellites=0)
            if isinstance(fault, GnssJump):
                fix = _displaced(fix, fault.north_m, fault.east_m)
            elif isinstance(fault, GnssDrift):
                lasted_s = self._clock.began_s(fault, now_s)
                fix = _displaced(fix, fault.north_m_s * lasted_s, fault.east_m_s * lasted_s)
            else:
                north_m, east_m = (fault.sigma_m * self._rng.standard_normal(2)).tolist()
                fix = _displaced(fix, north_m, east_m)
        return fix


def _displaced(fix: GnssFix, north_m: float, east_m: float) -> GnssFix:
    latitude_deg = fix.latitude_deg + math.degrees(north_m / EARTH_RADIUS_M)
    around_m = EARTH_RADIUS_M * math.cos(math.radians(fix.latitude_deg))
    return msgspec.structs.replace(
        fix,
        latitude_deg=latitude_deg,
        longitude_deg=fix.longitude_deg + math.degrees(east_m / around_m),
    )
