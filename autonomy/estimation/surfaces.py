"""Floor below and ceiling above, from the beams that look at them.

Each is a level in local NED, a random walk that the height of the vehicle measures. It never moves
the vehicle: over a box the floor steps up, under a beam the ceiling steps down, and the altitude
stays. A single reading that does not fit is an outlier; `STEP_READINGS` in a row that fit one
another are a new surface. Both surfaces stepping alike, at once, are none: the altitude has jumped.
"""

import math
from typing import NamedTuple

from autonomy.estimation.kalman import Tested
from hal.config import BeamMount, BeamsConfig
from hal.frames import Vector3
from hal.readings import Attitude, RangeReading, RangeStatus

STEP_READINGS = 3
"""So many rejected levels in a row, alike, are a new surface."""
TILT_MAX_RAD = math.radians(30.0)
"""Tilted more than this, a vertical beam no longer looks at floor or ceiling."""
WALK_M_PER_SQRT_S = 0.02
"""How fast a surface, and the altitude that it is measured against, may creep."""
TOGETHER_S = 0.3
"""Two steps within this are one event."""
DRIFT_TOLD_M = 0.15
"""Floor and ceiling that have crept by so much together are told to people."""
_STEEP_DEG = 60.0


class Step(NamedTuple):
    """A surface was found at another level."""

    stamp_s: float
    rise_m: float
    """Positive: higher than before."""


class VerticalBeam:
    """The beam that looks most steeply up (`rise` 1) or down (-1); there may be none."""

    def __init__(self, beams: BeamsConfig, rise: int) -> None:
        steep = [m for m in beams.mounts if rise * m.pitch_deg >= _STEEP_DEG]
        self._mount: BeamMount | None = max(steep, key=lambda m: rise * m.pitch_deg, default=None)
        if self._mount is None:
            return
        yaw, pitch = math.radians(self._mount.yaw_deg), math.radians(self._mount.pitch_deg)
        self._look_frd: Vector3 = (
            math.cos(pitch) * math.cos(yaw),
            math.cos(pitch) * math.sin(yaw),
            -math.sin(pitch),
        )
        self._face_frd_m: Vector3 = (
            self._mount.forward_m,
            self._mount.right_m,
            self._mount.down_m,
        )

    def newest(self, ranges: tuple[RangeReading, ...]) -> RangeReading | None:
        """The newest valid reading of that beam among `ranges`."""
        if self._mount is None:
            return None
        name, newest = self._mount.name, None
        for reading in ranges:
            if reading.beam != name or reading.status is not RangeStatus.VALID:
                continue
            if newest is None or reading.stamp_s > newest.stamp_s:
                newest = reading
        return newest

    def end_below_m(self, reading: RangeReading, attitude: Attitude) -> float | None:
        """How far below the vehicle's centre the beam ends; None when too tilted to say."""
        roll, pitch = attitude.roll_rad, attitude.pitch_rad
        if max(abs(roll), abs(pitch)) > TILT_MAX_RAD:
            return None
        (fx, fy, fz), (lx, ly, lz), r = self._face_frd_m, self._look_frd, reading.range_m
        # The third row of the rotation from body to NED (hal.frames.rotate_frd_to_ned).
        level = math.sin(roll) * (fy + r * ly) + math.cos(roll) * (fz + r * lz)
        return math.cos(pitch) * level - math.sin(pitch) * (fx + r * lx)


class Surface:
    """The level of one surface: a Kalman filter with one state, and the rule for steps."""

    def __init__(self, gate_sigma: float) -> None:
        self._gate2 = gate_sigma * gate_sigma
        self._variance_m2 = 0.0
        self._stamp_s = 0.0
        self._unlike: list[float] = []
        self._settled_down_m = 0.0
        self.down_m: float | None = None
        """Down coordinate; None before the first reading."""
        self.supported_s = -math.inf
        """Stamp of the last reading that agrees."""
        self.steps = 0

    @property
    def sigma_m(self) -> float:
        """One-sigma uncertainty of the level."""
        return math.sqrt(self._variance_m2)

    @property
    def crept_m(self) -> float:
        """How much higher it is than when it was found."""
        return 0.0 if self.down_m is None else self._settled_down_m - self.down_m

    def shift(self, down_m: float) -> None:
        """The frame jumped by so much downwards."""
        if self.down_m is not None:
            self.down_m += down_m
            self._settled_down_m += down_m
            self._unlike = [each + down_m for each in self._unlike]

    def settle(self) -> None:
        """From now on it creeps from where it is."""
        if self.down_m is not None:
            self._settled_down_m = self.down_m

    def update(
        self, stamp_s: float, down_m: float, variance_m2: float
    ) -> tuple[Tested, Step | None]:
        """Fuse a level that was measured; a step is told by the reading that proves it."""
        if not math.isfinite(down_m):
            return Tested(math.inf, fused=False, nis=math.inf), None
        if self.down_m is None:
            self._begin(stamp_s, down_m, variance_m2)
            return Tested(0.0, fused=True), None
        walked = WALK_M_PER_SQRT_S**2 * max(0.0, stamp_s - self._stamp_s)
        self._stamp_s = max(stamp_s, self._stamp_s)
        self._variance_m2 += walked
        innovation = down_m - self.down_m
        variance = self._variance_m2 + variance_m2
        nis = innovation * innovation / variance
        tested = Tested(nis / self._gate2, nis <= self._gate2, nis)
        if tested.fused:
            gain = self._variance_m2 / variance
            self.down_m += gain * innovation
            self._variance_m2 *= 1.0 - gain
            self.supported_s = stamp_s
            self._unlike.clear()
            return tested, None
        return tested, self._stepped(stamp_s, down_m, variance_m2)

    def _stepped(self, stamp_s: float, down_m: float, variance_m2: float) -> Step | None:
        """Whether the readings that do not fit are, together, another surface."""
        alike_m = math.sqrt(2.0 * self._gate2 * variance_m2)
        self._unlike = [each for each in self._unlike if abs(each - down_m) <= alike_m]
        self._unlike.append(down_m)
        if len(self._unlike) < STEP_READINGS or self.down_m is None:
            return None
        rise_m = self.down_m - down_m
        self._begin(stamp_s, down_m, variance_m2)
        self.steps += 1
        return Step(stamp_s, rise_m)

    def _begin(self, stamp_s: float, down_m: float, variance_m2: float) -> None:
        self.down_m = self._settled_down_m = down_m
        self._variance_m2 = variance_m2
        self._stamp_s = self.supported_s = stamp_s
        self._unlike.clear()


class Levels:
    """Floor and ceiling together: what a step, or creeping, of both of them means in words."""

    def __init__(self, floor: Surface, ceiling: Surface) -> None:
        self._surfaces = (floor, ceiling)
        self._waiting: list[tuple[str, Step]] = []

    def stepped(self, name: str, step: Step | None) -> None:
        """The floor, or the ceiling, was found elsewhere."""
        if step is not None:
            self._waiting.append((name, step))

    def news(self, now_s: float) -> tuple[tuple[str, str], ...]:
        """(name, sentence) of what can be told by now."""
        told = tuple(self._steps(now_s)) if self._waiting else ()
        return told + self._drift(now_s)

    def _steps(self, now_s: float) -> list[tuple[str, str]]:
        found = self._waiting
        if len(found) >= 2 and len({name for name, _ in found}) == 2:
            self._waiting = []
            (_, one), (_, other) = found[0], found[-1]
            if abs(one.rise_m - other.rise_m) <= DRIFT_TOLD_M:
                return [_altitude_words("jumped", 0.5 * (one.rise_m + other.rise_m))]
            return [_step_words(*each) for each in found]
        due = [each for each in found if now_s - each[1].stamp_s >= TOGETHER_S]
        self._waiting = [each for each in found if each not in due]
        return [_step_words(*each) for each in due]

    def _drift(self, now_s: float) -> tuple[tuple[str, str], ...]:
        """Both creep the same way: it is the altitude."""
        floor, ceiling = self._surfaces
        if abs(floor.crept_m) < DRIFT_TOLD_M or abs(ceiling.crept_m) < DRIFT_TOLD_M:
            return ()
        crept = (floor.crept_m, ceiling.crept_m)
        if now_s - min(floor.supported_s, ceiling.supported_s) > TOGETHER_S:
            return ()
        if abs(crept[0] - crept[1]) > 0.5 * min(abs(crept[0]), abs(crept[1])):
            return ()
        floor.settle()
        ceiling.settle()
        return (_altitude_words("drifted", 0.5 * (crept[0] + crept[1])),)


def _step_words(name: str, step: Step) -> tuple[str, str]:
    way = "higher" if step.rise_m > 0.0 else "lower"
    return f"{name}_step", f"the {name} is {abs(step.rise_m):.2f} m {way} here"


def _altitude_words(how: str, rise_m: float) -> tuple[str, str]:
    # A surface that seems to rise by x in the autopilot's frame: its altitude rose by x too much.
    way = "up" if rise_m > 0.0 else "down"
    return (
        f"altitude_{'jump' if how == 'jumped' else 'drift'}",
        f"the autopilot's altitude {how} {abs(rise_m):.2f} m {way} against floor and ceiling",
    )
