"""Readings to a picture of the world: fused state, hits and seen-free space, in the mission frame.

The mission frame is NED with its origin where the vehicle was armed. When PX4's estimator resets
and its local frame jumps, the origin jumps with it: map, goal and fence keep their places around
the vehicle, and nothing has to be moved. What beams on known walls say of the frame's drift
(estimation/wall_fix.py) moves the origin too, so that they keep their places in the room.
"""

import msgspec

from autonomy.config import Config
from autonomy.estimation.fusion import Fusion
from autonomy.estimation.wall_fix import WallFix
from autonomy.geometry import Point
from autonomy.mission.coverage import Lookout
from autonomy.model import FusedState, Inputs, MovingObstacle, WallFixReport
from autonomy.perception.doubt import lens
from autonomy.perception.doubt.doubter import Doubt
from autonomy.perception.movers import MoverTracker
from autonomy.perception.obstacle_map import ObstacleMap
from autonomy.perception.projection import Projector, Ray, RayKind
from autonomy.perception.storey_maps import StoreyMaps
from hal.frames import ZERO3, Vector3, add, norm, subtract
from hal.readings import RangeReading, RangeStatus

_UPWARDS_DEG = 60.0
THIN_DEG = 3.0
UNDER_VEHICLE_M = 0.14
"""The vehicle stands there: free, whatever is forgotten."""


class Room(msgspec.Struct, frozen=True):
    """How far it is free above or below the vehicle's centre; `ends`: a surface is there."""

    free_m: float
    ends: bool


class Sensing:
    """Owns estimator and map; one `step` per tick."""

    def __init__(self, config: Config) -> None:
        self._config = config
        self._fusion = Fusion(config.estimation, config.beams)
        self._projector = Projector(config.beams, config.body.half_height_m)
        self._doubt = Doubt(config.beams, config.body, thorough=config.failsafe.doubt_beams)
        self.lookout = Lookout(config)
        """Which beams are lost, and how to fly with those that are left."""
        self.maps = StoreyMaps(config.map, config.body.radius_m, config.guard.fence)
        """One map for each height of flight."""
        self.movers = MoverTracker()
        """What moves at the present height."""
        self.things_move = False
        """Something moved lately, or is expected to."""
        self._doubted: ObstacleMap | None = None
        self._between_heights = True
        self._wall_fix = WallFix(config.estimation.walls, config.guard.fence)
        self.walls: WallFixReport | None = None
        """What beams on known walls said last; None where they are not asked."""
        self._thin_beams = {
            index: mount.name
            for index, mount in enumerate(config.beams.mounts)
            if config.beams.half_angle_deg(mount.name) <= THIN_DEG
        }
        self._armed_at_ned_m: Vector3 = ZERO3
        self.home_ned_m: Vector3 = ZERO3
        """The mission frame's origin in the autopilot's local frame, drift included."""
        self._home_fixed = False
        self._measured_s: dict[str, float] = {}
        self._measured: dict[str, RangeReading] = {}
        self._first_s: float | None = None
        self._state_lost_since_s: float | None = None
        self.newest: dict[str, RangeReading] = {}
        """The newest reading of every beam, whatever its status."""

    @property
    def map(self) -> ObstacleMap:
        """The map at the present height of flight."""
        return self.maps.present

    def fix_home(self, home_ned_m: Vector3 | None = None) -> None:
        """The vehicle is being armed: the origin stays where it is from now on, or where a mission
        that goes on had it.
        """
        self._home_fixed = True
        if home_ned_m is not None:
            self._armed_at_ned_m = subtract(home_ned_m, (*self._wall_fix.offset_ne_m, 0.0))
            self.home_ned_m = home_ned_m

    def step(self, inputs: Inputs) -> FusedState:
        """Fuse this tick's readings, update the map, return the state in the mission frame."""
        if self._first_s is None:
            self._first_s = inputs.now_s
        ranges = self._doubt.judge(inputs.ranges)
        for reading in ranges:
            self.newest[reading.beam] = reading
            if reading.status not in (RangeStatus.NO_SIGNAL, RangeStatus.SUSPECT):
                self._measured_s[reading.beam] = reading.stamp_s
                self._measured[reading.beam] = reading
        local = self._fusion.step(
            inputs.now_s, inputs.local_position, inputs.attitude, inputs.gnss, ranges
        )
        shift = local.frame_shift_ned_m
        self.jump_m = norm(shift) if self._home_fixed and shift != ZERO3 else 0.0
        if not self._home_fixed:
            self._armed_at_ned_m = local.position_ned_m
        elif shift != ZERO3:
            self._armed_at_ned_m = add(self._armed_at_ned_m, shift)
        self.home_ned_m = add(self._armed_at_ned_m, (*self._wall_fix.offset_ne_m, 0.0))
        fused = msgspec.structs.replace(
            local,
            position_ned_m=subtract(local.position_ned_m, self.home_ned_m),
            frame_shift_ned_m=ZERO3,
        )
        self._doubt_beams(fused, inputs)
        ranges = self._doubt.judge(inputs.ranges)
        if fused.ok:
            self._state_lost_since_s = None
            if self._home_fixed:
                rays = self._projector.step(fused, ranges)
                if self._between_heights:
                    self.map.update(inputs.now_s, ())
                else:
                    self._watch(inputs.now_s, rays)
                    self.map.update(inputs.now_s, rays)
                if self._config.estimation.walls.use:
                    self.walls = self._wall_fix.step(
                        inputs.now_s, self._measured_ends(rays), learn=not self._between_heights
                    )
        elif self._state_lost_since_s is None:
            self._state_lost_since_s = inputs.now_s
        return fused

    def _measured_ends(self, rays: tuple[Ray, ...]) -> list[Ray]:
        """Those that end on something at a distance that was measured, and not only "nearer".

        Of a wide beam nobody knows where on its arc that is.
        """
        return [
            ray
            for ray in rays
            if ray.kind is RayKind.HIT
            and ray.beam in self._thin_beams
            and self.newest[self._thin_beams[ray.beam]].status is RangeStatus.VALID
        ]

    def _doubt_beams(self, fused: FusedState, inputs: Inputs) -> None:
        """Which beams are believed from the next step on; what a liar showed was never seen."""
        unrest = self.movers.unrest(inputs.now_s)
        self._doubt.learn(inputs.now_s, fused, inputs.ranges, unrest)
        self.lookout.step(inputs.now_s, self._doubt.doubts)
        if self._doubt.disputed:
            self.map.forget_cones(self._doubt.disputed)
        if self._doubt.lied_since_s is not None and self._home_fixed:
            self.map.forget_seen_since(self._doubt.lied_since_s, fused.point, UNDER_VEHICLE_M)

    def moving(self, now_s: float) -> tuple[MovingObstacle, ...]:
        """What moves; where things move, also what is new and not yet known to stand."""
        found = self.movers.obstacles(now_s)
        return found if self.things_move else tuple(one for one in found if one.moving)

    def _watch(self, now_s: float, rays: tuple[Ray, ...]) -> None:
        """Look for what moves; of a wide beam nobody knows where on its arc a hit is."""
        if self._config.movers.watch:
            thin = [ray for ray in rays if ray.beam in self._thin_beams]
            self.movers.step(now_s, thin, self.map)
            self._expect_changes(now_s)

    def _expect_changes(self, now_s: float) -> None:
        """Old knowledge is doubted while things move."""
        config = self._config.movers
        # Something new alone is no reason: among standing things that is nearly always noise, and
        # half of the rolling flights in the furnished room stopped to make way for it.
        moves = config.expected or now_s - self.movers.moved_s <= config.remember_s
        if moves is not self.things_move or self._doubted is not self.map:
            self.things_move, self._doubted = moves, self.map
            self.map.doubt(config if moves else None)

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

    def covered_beams(self) -> tuple[str, ...]:
        """Thin level beams that see something inside the vehicle's own body: on their lens."""
        mounts = self._config.beams.mounts
        thin = (mounts[index] for index in self._thin_beams if mounts[index].horizontal)
        return lens.covered(thin, self.newest, self._config.body.radius_m)

    def room_above_m(self) -> float | None:
        """What the beam that looks up measured last; None when it saw nothing."""
        for mount in self._config.beams.mounts:
            reading = self.newest.get(mount.name)
            if mount.pitch_deg > _UPWARDS_DEG and reading is not None:
                seen = reading.status in (RangeStatus.VALID, RangeStatus.TOO_NEAR)
                return reading.range_m - mount.down_m if seen else None
        return None

    def room(self, rise: int, now_s: float) -> Room | None:
        """What the beam that looks up (`rise` 1) or down (-1) measured last, from the centre.

        None when no such beam measured lately: then nothing may be said about that direction.
        """
        rooms = []
        for mount in self._config.beams.mounts:
            reading = self._measured.get(mount.name)
            if rise * mount.pitch_deg <= _UPWARDS_DEG or reading is None:
                continue
            if now_s - reading.stamp_s > self._config.beams.stale_after_s:
                continue
            free_m = reading.range_m - rise * mount.down_m
            rooms.append(Room(free_m, reading.status is not RangeStatus.OUT_OF_RANGE))
        return min(rooms, key=lambda room: room.free_m, default=None)

    def begin_at_height(self, height_m: float) -> None:
        """Off the ground, and at a height of flight: from now on what is seen is mapped."""
        self._between_heights = False
        self.maps.settle(height_m)

    def leave_height(self) -> None:
        """The vehicle climbs or descends: what is seen on the way belongs to no map."""
        self._between_heights = True
        self.movers.forget()

    def enter_height(self, height_m: float, point: Point, now_s: float) -> None:
        """The vehicle has come to rest at `height_m` above the take-off point."""
        self._between_heights = False
        self.maps.enter(height_m, point, now_s)
