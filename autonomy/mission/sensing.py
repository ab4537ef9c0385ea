"""Readings to a picture of the world: fused state, hits and seen-free space, in the mission frame.

The mission frame is NED with its origin where the vehicle was armed. When PX4's estimator resets
and its local frame jumps, the origin jumps with it: map, goal and fence keep their places around
the vehicle, and nothing has to be moved.
"""

import msgspec

from autonomy.config import Config
from autonomy.estimation.fusion import Fusion
from autonomy.geometry import Point
from autonomy.model import FusedState, Inputs
from autonomy.perception.obstacle_map import ObstacleMap
from autonomy.perception.projection import Projector
from hal.frames import ZERO3, Vector3, add, subtract
from hal.readings import RangeReading, RangeStatus

_UPWARDS_DEG = 60.0


class Sensing:
    """Owns estimator and map; one `step` per tick."""

    def __init__(self, config: Config) -> None:
        self._config = config
        self._fusion = Fusion(config.estimation, config.beams)
        self._projector = Projector(config.beams, config.body.half_height_m)
        self.map = ObstacleMap(config.map, config.body.radius_m, config.guard.fence)
        self.home_ned_m: Vector3 = ZERO3
        """The mission frame's origin in the autopilot's local frame."""
        self._home_fixed = False
        self._measured_s: dict[str, float] = {}
        self._first_s: float | None = None
        self._state_lost_since_s: float | None = None
        self.newest: dict[str, RangeReading] = {}
        """The newest reading of every beam, whatever its status."""

    def fix_home(self) -> None:
        """The vehicle is being armed: the origin stays where it is from now on."""
        self._home_fixed = True

    def step(self, inputs: Inputs) -> FusedState:
        """Fuse this tick's readings, update the map, return the state in the mission frame."""
        if self._first_s is None:
            self._first_s = inputs.now_s
        for reading in inputs.ranges:
            self.newest[reading.beam] = reading
            if reading.status not in (RangeStatus.NO_SIGNAL, RangeStatus.SUSPECT):
                self._measured_s[reading.beam] = reading.stamp_s
        local = self._fusion.step(
            inputs.now_s, inputs.local_position, inputs.attitude, inputs.gnss, inputs.ranges
        )
        if not self._home_fixed:
            self.home_ned_m = local.position_ned_m
        elif local.frame_shift_ned_m != ZERO3:
            self.home_ned_m = add(self.home_ned_m, local.frame_shift_ned_m)
        fused = msgspec.structs.replace(
            local,
            position_ned_m=subtract(local.position_ned_m, self.home_ned_m),
            frame_shift_ned_m=ZERO3,
        )
        if fused.ok:
            self._state_lost_since_s = None
            if self._home_fixed:
                self.map.update(inputs.now_s, self._projector.step(fused, inputs.ranges))
        elif self._state_lost_since_s is None:
            self._state_lost_since_s = inputs.now_s
        return fused

    def state_lost_s(self, now_s: float) -> float:
        """How long the state has not been usable."""
        since = self._state_lost_since_s
        return 0.0 if since is None else now_s - since

    def silent_beams(self, now_s: float) -> dict[str, float]:
        """Age of the last measurement of each beam, horizontal or not, that is stale."""
        start_s = self._first_s if self._first_s is not None else now_s
        names = [mount.name for mount in self._config.beams.mounts]
        ages = {name: now_s - self._measured_s.get(name, start_s) for name in names}
        limit_s = self._config.beams.stale_after_s
        return {
            name: age_s
            for name, age_s in ages.items()
            if age_s > limit_s or name not in self._measured_s
        }

    def silent_horizontal_beams(self, now_s: float) -> dict[str, float]:
        """`silent_beams` of those that map the plane of flight."""
        silent = self.silent_beams(now_s)
        horizontal = [mount.name for mount in self._config.beams.mounts if mount.horizontal]
        return {name: silent[name] for name in horizontal if name in silent}

    def room_above_m(self) -> float | None:
        """What the beam that looks up measured last; None when it saw nothing."""
        for mount in self._config.beams.mounts:
            reading = self.newest.get(mount.name)
            if mount.pitch_deg > _UPWARDS_DEG and reading is not None:
                seen = reading.status in (RangeStatus.VALID, RangeStatus.TOO_NEAR)
                return reading.range_m - mount.down_m if seen else None
        return None

    def settle_at_height(self, point: Point) -> None:
        """What was seen at another height says nothing about this one: forget it."""
        self.map.forget_all(point, self._config.map.start_disc_m)
