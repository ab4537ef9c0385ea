"""Measurements in the order in which they were true, whatever the order in which they came.

Behind the newest state lies a short past: every measurement, and the whole filter after it. One
that comes late is fused where it belongs, and those after it once more. The state is then the one
that it would be had nothing been late; nothing is approximated.
"""

from collections import deque
from typing import Protocol

import msgspec

from autonomy.estimation.kalman import Kalman, Snapshot, Tested, moved
from autonomy.geometry import Point
from hal.frames import Vector3, add

HISTORY_S = 1.0
"""What comes later than this is too late."""


class Observation(Protocol):
    """One measurement of the filter's state."""

    @property
    def stamp_s(self) -> float:
        """When it was true."""
        ...

    def apply(self, kalman: Kalman) -> tuple[Tested, ...]:
        """Fuse it into a filter that stands at its time."""
        ...

    def moved(self, offset_ned_m: Vector3) -> "Observation":
        """The same in a frame that jumped by `offset_ned_m`."""
        ...


class LocalObservation(msgspec.Struct, frozen=True, gc=False):
    """The autopilot's position and velocity; with `anew` the filter begins from them."""

    stamp_s: float
    position_ned_m: Vector3
    velocity_ned_m_s: Vector3
    position_sigma_m: float
    velocity_sigma_m_s: float
    anew: bool = False

    def apply(self, kalman: Kalman) -> tuple[Tested, ...]:
        """The tests of position and velocity."""
        measured = (
            self.position_ned_m,
            self.velocity_ned_m_s,
            self.position_sigma_m,
            self.velocity_sigma_m_s,
        )
        if not self.anew:
            return kalman.update(*measured)
        kalman.start(*measured)
        return Tested(0.0, fused=True), Tested(0.0, fused=True)

    def moved(self, offset_ned_m: Vector3) -> "LocalObservation":
        """It lies in the frame."""
        return msgspec.structs.replace(self, position_ned_m=add(self.position_ned_m, offset_ned_m))


class GnssObservation(msgspec.Struct, frozen=True, gc=False):
    """A placed GNSS position; with `anew` the bias begins from it."""

    stamp_s: float
    position_ne_m: Point
    sigma_m: float
    anew: bool = False

    def apply(self, kalman: Kalman) -> tuple[Tested, ...]:
        """Its one test."""
        fuse = kalman.start_bias if self.anew else kalman.update_gnss
        return (fuse(self.position_ne_m, self.sigma_m),)

    def moved(self, offset_ned_m: Vector3) -> "GnssObservation":
        """It lies on Earth."""
        del offset_ned_m
        return self


class _Step(msgspec.Struct, gc=False):
    observation: Observation
    after: Snapshot


class Timeline:
    """A filter that can be told of the past. Times are the observations' stamps."""

    def __init__(self, kalman: Kalman) -> None:
        self._kalman = kalman
        self._steps: deque[_Step] = deque()

    @property
    def head_s(self) -> float | None:
        """Time of the newest state; None before the first observation."""
        return self._steps[-1].observation.stamp_s if self._steps else None

    def begin(self, observation: LocalObservation) -> None:
        """Forget the past; the filter starts from this."""
        self._kalman.start(
            observation.position_ned_m,
            observation.velocity_ned_m_s,
            observation.position_sigma_m,
            observation.velocity_sigma_m_s,
        )
        self._steps.clear()
        self._steps.append(_Step(observation, self._kalman.snapshot()))

    def insert(self, observation: Observation) -> tuple[Tested, ...] | None:
        """Fuse it at its own time; its tests, or None when that is longer ago than is known."""
        steps = self._steps
        if observation.stamp_s < steps[0].observation.stamp_s:
            return None
        later: list[Observation] = []
        head = steps[-1]
        if observation.stamp_s < head.observation.stamp_s:
            overtaken: list[_Step] = []
            while steps[-1].observation.stamp_s > observation.stamp_s:
                overtaken.append(steps.pop())
            self._kalman.restore(steps[-1].after)
            later = [step.observation for step in reversed(overtaken)]
        tests = self._apply(observation)
        for each in later:
            self._apply(each)
        self._forget()
        return tests

    def position_at(self, stamp_s: float) -> Vector3:
        """Where the vehicle was, or, after the newest state, will be by its velocity."""
        steps = self._steps
        index = len(steps) - 1
        while index > 0 and steps[index].observation.stamp_s > stamp_s:
            index -= 1
        step = steps[index]
        (n, e, d), (vn, ve, vd), _ = step.after.x.tolist()
        dt_s = max(0.0, stamp_s - step.observation.stamp_s)
        return (n + vn * dt_s, e + ve * dt_s, d + vd * dt_s)

    def shift(self, offset_ned_m: Vector3) -> None:
        """The frame jumped, and the past with it."""
        for step in self._steps:
            step.observation = step.observation.moved(offset_ned_m)
            step.after = moved(step.after, offset_ned_m)
        self._kalman.restore(self._steps[-1].after)

    def _apply(self, observation: Observation) -> tuple[Tested, ...]:
        self._kalman.predict(observation.stamp_s - self._steps[-1].observation.stamp_s)
        tests = observation.apply(self._kalman)
        self._steps.append(_Step(observation, self._kalman.snapshot()))
        return tests

    def _forget(self) -> None:
        """The state at the horizon is kept: what is as old as that still finds its place."""
        steps = self._steps
        oldest_s = steps[-1].observation.stamp_s - HISTORY_S
        while len(steps) > 1 and steps[1].observation.stamp_s <= oldest_s:
            steps.popleft()
