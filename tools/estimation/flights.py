"""Flights of a truth that the filter does not know, and what it makes of them.

Truth: a vehicle that wanders through a room at up to 0.3 m/s. The autopilot's estimate of it drifts
(an Ornstein-Uhlenbeck error of velocity, correlated over 3 s, so that position errs 12 cm on each
axis after 30 s, as measured on a PX4), has 3 mm of white noise and comes 60 ms late. It does not
use the GNSS beside it. GNSS has white noise, multipath (Ornstein-Uhlenbeck) and comes late.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from autonomy.config import EstimationConfig
from autonomy.estimation.fusion import Fusion
from autonomy.model import FusedState
from hal.config import BeamsConfig
from hal.frames import ZERO3, Vector3, add, geodetic_from_ned, subtract
from hal.readings import Attitude, FixType, GnssFix, LocalPosition

TICK_S = 0.05
LOCAL_DELAY_TICKS = 1
LOCAL_NOISE_M = 0.003
DRIFT_M_S = 0.009
DRIFT_CORRELATION_S = 3.0
SETTLED_S = 5.0
DISTURBED_S = 30.0
ORIGIN = (47.3977, 8.5456, 488.0)
Array = NDArray[np.float64]


@dataclass(frozen=True)
class Gnss:
    """A receiver: what its fixes are like and what it says of them."""

    white_m: float
    multipath_m: float
    correlation_s: float
    outliers: float
    accuracy_m: float
    delay_ticks: int = 3
    every_ticks: int = 4


GOOD = Gnss(0.3, 0.5, 60.0, 0.0, 0.7)
INDOOR = Gnss(1.0, 4.0, 15.0, 0.02, 4.0)


@dataclass(frozen=True)
class Case:
    """One row: a receiver, and what happens 30 s after the start.

    `gnss_jump_m` and `gnss_drift_m_s` are northwards; `frame_jump_ned_m` is one of the autopilot's
    estimate, told by its reset counter when `owned_up`; `silent_s` of it.
    """

    name: str
    gnss: Gnss | None
    gnss_jump_m: float = 0.0
    gnss_drift_m_s: float = 0.0
    frame_jump_ned_m: Vector3 = ZERO3
    owned_up: bool = True
    silent_s: float = 0.0
    event: str = ""
    """What should be told of it; without a disturbance: what would be a false alarm."""

    @property
    def disturbed(self) -> bool:
        """Whether anything happens."""
        return bool(
            self.gnss_jump_m
            or self.gnss_drift_m_s
            or self.silent_s
            or self.frame_jump_ned_m != ZERO3
        )


CASES = (
    Case("no GNSS", None),
    Case("good GNSS", GOOD, event="gnss_drift"),
    Case("indoor GNSS", INDOOR, event="gnss_drift"),
    Case("good, GNSS jumps 15 m", GOOD, gnss_jump_m=15.0, event="gnss_jump"),
    Case("good, GNSS drifts 0.1 m/s", GOOD, gnss_drift_m_s=0.1, event="gnss_drift"),
    Case("good, GNSS drifts 0.5 m/s", GOOD, gnss_drift_m_s=0.5, event="gnss_drift"),
    Case("good, autopilot resets", GOOD, frame_jump_ned_m=(1.2, -0.8, 0.3), event="frame_jump"),
    Case(
        "good, frame jumps untold",
        GOOD,
        frame_jump_ned_m=(1.2, -0.8, 0.3),
        owned_up=False,
        event="frame_jump",
    ),
    Case("good, autopilot silent 2 s", GOOD, silent_s=2.0, event="filter_restart"),
)


@dataclass
class Flown:
    """Horizontal errors at every tick at which there is one, in metres."""

    raw_m: list[float] = field(default_factory=list)
    autopilot_m: list[float] = field(default_factory=list)
    fused_m: list[float] = field(default_factory=list)
    against_frame_m: list[float] = field(default_factory=list)
    room_ratio: list[float] = field(default_factory=list)
    """Squared error against the room over twice the variance that is believed (mean 1)."""
    usable: list[bool] = field(default_factory=list)
    noticed_s: float | None = None
    """From the disturbance (or the start) to the first event that should tell of it."""
    trace: list[tuple[float, float, float, float]] = field(default_factory=list)
    """(time, GNSS' own drift, bias north, position error north)."""


class _World:
    """Truth and what the sensors make of it, tick by tick."""

    def __init__(self, case: Case, rng: np.random.Generator) -> None:
        self._case, self._rng = case, rng
        self._phases = rng.uniform(0.0, 2.0 * math.pi, (3, 3))
        self._rates = rng.uniform(0.08, 0.35, (3, 3))
        self._drift = np.zeros(3)
        self._drift_speed = DRIFT_M_S * rng.normal(0.0, 1.0, 3)
        self._multipath = rng.normal(0.0, 1.0, 2)

    def truth(self, now_s: float) -> tuple[Vector3, Vector3]:
        """Position and velocity in the room."""
        angle = self._rates * now_s + self._phases
        reach = np.array([[0.25], [0.25], [0.05]])
        position = np.sum(reach * (np.sin(angle) - np.sin(self._phases)), axis=1)
        velocity = np.sum(reach * self._rates * np.cos(angle), axis=1)
        n, e, d = position.tolist()
        return (n, e, d - 0.8), _vector(velocity)

    def local(self, now_s: float) -> tuple[LocalPosition, Vector3]:
        """The autopilot's estimate of now, and what it is without its noise."""
        keep = math.exp(-TICK_S / DRIFT_CORRELATION_S)
        fresh = DRIFT_M_S * math.sqrt(1.0 - keep * keep)
        self._drift_speed = keep * self._drift_speed + fresh * self._rng.normal(0.0, 1.0, 3)
        self._drift = self._drift + TICK_S * self._drift_speed
        position, velocity = self.truth(now_s)
        jumped = now_s >= DISTURBED_S and self._case.frame_jump_ned_m != ZERO3
        frame = add(position, _vector(self._drift))
        if jumped:
            frame = add(frame, self._case.frame_jump_ned_m)
        noise = self._rng.normal(0.0, LOCAL_NOISE_M, 3)
        told = int(jumped and self._case.owned_up)
        moving = add(velocity, _vector(self._drift_speed))
        return LocalPosition(now_s, add(frame, _vector(noise)), moving, told), frame

    def gnss_drift_m(self, now_s: float) -> float:
        """How far GNSS is led astray by then, northwards."""
        since_s = now_s - DISTURBED_S
        if since_s < 0.0:
            return 0.0
        return self._case.gnss_jump_m + self._case.gnss_drift_m_s * since_s

    def fix(self, gnss: Gnss, now_s: float) -> tuple[GnssFix, float]:
        """A fix of now, and its horizontal error."""
        keep = math.exp(-gnss.every_ticks * TICK_S / gnss.correlation_s)
        fresh = math.sqrt(1.0 - keep * keep)
        self._multipath = keep * self._multipath + fresh * self._rng.normal(0.0, 1.0, 2)
        white = gnss.white_m * (4.0 if self._rng.random() < gnss.outliers else 1.0)
        error = gnss.multipath_m * self._multipath + white * self._rng.normal(0.0, 1.0, 2)
        north, east = error.tolist()
        north += self.gnss_drift_m(now_s)
        ned = add(self.truth(now_s)[0], (north, east, 0.0))
        latitude, longitude, amsl = geodetic_from_ned(ned, ORIGIN)
        accuracy_m = gnss.accuracy_m
        fix = GnssFix(
            now_s, FixType.FIX_3D, latitude, longitude, amsl, accuracy_m, 1.5 * accuracy_m, 9
        )
        return fix, math.hypot(north, east)


def fly(case: Case, seed: int, seconds: float = 60.0) -> Flown:
    """One flight of a case."""
    world = _World(case, np.random.default_rng(seed))
    config = EstimationConfig(drift_noise_m_per_sqrt_s=DRIFT_M_S * math.sqrt(6.0))
    fusion = Fusion(config, BeamsConfig())
    flown = Flown()
    shifted = ZERO3
    for now_s, local, frame, gnss, raw_m in _arrivals(case, world, seconds):
        state = fusion.step(now_s, local, Attitude(now_s, 0.0, 0.0, 0.0, 0.0), gnss, ())
        shifted = add(shifted, state.frame_shift_ned_m)
        _note_news(flown, case, state)
        if now_s < SETTLED_S or local is None:
            continue
        if raw_m is not None:
            flown.raw_m.append(raw_m)
        flown.usable.append(state.ok)
        truth = world.truth(now_s)[0]
        if state.ok:
            error = subtract(subtract(state.position_ned_m, shifted), truth)
            flown.fused_m.append(math.hypot(error[0], error[1]))
            flown.autopilot_m.append(_apart_m(local.position_ned_m, truth))
            flown.against_frame_m.append(_apart_m(state.position_ned_m, frame))
            believed = state.health.room_sigma_m or math.inf
            flown.room_ratio.append((error[0] ** 2 + error[1] ** 2) / (2.0 * believed**2))
            bias = state.health.gnss_bias_ne_m
            if bias is not None:
                row = (now_s, world.gnss_drift_m(now_s), bias[0], error[0])
                flown.trace.append(row)
    return flown


def _arrivals(
    case: Case, world: _World, seconds: float
) -> Iterator[tuple[float, LocalPosition | None, Vector3, GnssFix | None, float | None]]:
    """(now, newest local position, where its frame has the vehicle now, fix, the fix's error)."""
    locals_: list[LocalPosition] = []
    fixes: list[tuple[int, GnssFix, float]] = []
    newest: LocalPosition | None = None
    for tick in range(round(seconds / TICK_S)):
        now_s = tick * TICK_S
        local, frame = world.local(now_s)
        locals_.append(local)
        if case.gnss is not None and tick % case.gnss.every_ticks == 0:
            fixes.append((tick + case.gnss.delay_ticks, *world.fix(case.gnss, now_s)))
        silent = DISTURBED_S <= now_s < DISTURBED_S + case.silent_s
        if not silent and tick >= LOCAL_DELAY_TICKS:
            newest = locals_[tick - LOCAL_DELAY_TICKS]
        gnss, raw_m = None, None
        if fixes and fixes[0][0] == tick:
            _, gnss, raw_m = fixes.pop(0)
        yield now_s, newest, frame, gnss, raw_m


def _note_news(flown: Flown, case: Case, state: FusedState) -> None:
    for event in state.news:
        begin_s = DISTURBED_S if case.disturbed else 0.0
        if event.name == case.event and event.stamp_s >= begin_s and flown.noticed_s is None:
            flown.noticed_s = event.stamp_s - begin_s


def _apart_m(one: Vector3, other: Vector3) -> float:
    return math.hypot(one[0] - other[0], one[1] - other[1])


def _vector(values: Array) -> Vector3:
    n, e, d = values.tolist()
    return (n, e, d)
