"""Algorithm 1: the computing time of a flight, replan by replan.

Measured times come from outside; nothing here reads a clock. Eq. 8 and 9 are evaluated in
centimetres, the paper's unit: in metres every keep-out sphere would be extinct at t = 1.
"""

import msgspec

from autonomy.t3drm.ricci import many_obstacles_radius, one_obstacle_radius

CENTIMETRES = 100.0


class ReplanTime(msgspec.Struct, frozen=True):
    """One replan. `radius_m`: Eq. 8 (one obstacle) or Eq. 9 (several); None: none or extinct."""

    stamp_s: float
    seconds: float
    obstacles: int
    radius_m: float | None


class TimingRecord(msgspec.Struct, frozen=True):
    """Algorithm 1's result: step 1 start, step 2 radii, step 3 total, step 4 optimum, step 5 end.

    `least_s` is None before the first replan, `completed_s` before the path is completed.
    """

    start_s: float
    replans: tuple[ReplanTime, ...]
    total_s: float
    least_s: float | None
    completed_s: float | None

    @property
    def flight_s(self) -> float | None:
        """From start to completion."""
        return None if self.completed_s is None else self.completed_s - self.start_s


def flow_radius_m(keep_out_m: float, obstacles: int, n: int = 3) -> float | None:
    """Eq. 8 for one obstacle, Eq. 9 for more, None for none or an extinct sphere."""
    if obstacles < 1:
        return None
    r0_cm = keep_out_m * CENTIMETRES
    radius = one_obstacle_radius(r0_cm, n) if obstacles == 1 else many_obstacles_radius(r0_cm, n)
    return None if radius is None else radius / CENTIMETRES


class ComputationTime:
    """Algorithm 1, fed by whoever measures: one object per flight."""

    def __init__(self, start_s: float) -> None:
        self._start_s = start_s
        self._replans: list[ReplanTime] = []
        self._completed_s: float | None = None

    def replanned(self, stamp_s: float, seconds: float, obstacles: int, keep_out_m: float) -> None:
        """Step 2 and 3: a replan took `seconds` with so many obstacles at this keep-out radius."""
        radius = flow_radius_m(keep_out_m, obstacles)
        self._replans.append(ReplanTime(stamp_s, seconds, obstacles, radius))

    def completed(self, stamp_s: float) -> None:
        """Step 5: the path is completed. A second call changes nothing."""
        if self._completed_s is None:
            self._completed_s = stamp_s

    def record(self) -> TimingRecord:
        """What is known now."""
        seconds = [replan.seconds for replan in self._replans]
        return TimingRecord(
            start_s=self._start_s,
            replans=tuple(self._replans),
            total_s=sum(seconds),
            least_s=min(seconds, default=None),
            completed_s=self._completed_s,
        )
