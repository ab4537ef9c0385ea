"""The true world of a scenario: what a ray hits, how near the nearest surface is."""

import math

import msgspec
import numpy as np

from hal.frames import Vector3, horizontal_norm, norm
from hal.sim import kernels
from hal.sim.kernels import FloatArray
from hal.sim.movers import Walker
from hal.sim.scenario import BODY_HALF_HEIGHT_M, Box, Disc, Mover, Scenario, Wall


class RayBundles:
    """The rays of a set of beams on the body, ready for `World.cast_many`.

    `faces_frd_m`: where each beam starts; `axes_frd`: the unit direction in which it looks. With
    `half_angle_rad` = 0 each beam is one ray; else a cone of fixed rays on three rings around its
    axis, of which the nearest return counts. The outermost ring lies on the cone itself.
    """

    RAYS_PER_RING = (6, 12, 18)

    def __init__(
        self,
        faces_frd_m: tuple[Vector3, ...],
        axes_frd: tuple[Vector3, ...],
        half_angle_rad: float = 0.0,
    ) -> None:
        self.faces: FloatArray = np.array(faces_frd_m, dtype=np.float64).reshape(-1, 3)
        self.rays: FloatArray = np.array(
            [self._cone(axis, half_angle_rad) for axis in axes_frd], dtype=np.float64
        ).reshape(len(axes_frd), len(self._cone((1.0, 0.0, 0.0), half_angle_rad)), 3)
        self.distances: FloatArray = np.zeros(len(axes_frd))

    @classmethod
    def _cone(cls, axis: Vector3, half_angle_rad: float) -> list[Vector3]:
        rays = [axis]
        if half_angle_rad <= 0.0:
            return rays
        unit = np.array(axis)
        # Any vector that is not parallel to the axis gives the two directions across it.
        other = np.array((0.0, 0.0, 1.0) if abs(axis[2]) < 0.9 else (1.0, 0.0, 0.0))
        u = np.cross(unit, other)
        u /= np.linalg.norm(u)
        v = np.cross(unit, u)
        for ring, count in enumerate(cls.RAYS_PER_RING, start=1):
            off_axis = half_angle_rad * ring / len(cls.RAYS_PER_RING)
            for k in range(count):
                turn = 2.0 * math.pi * k / count
                across = math.cos(turn) * u + math.sin(turn) * v
                n, e, d = (math.cos(off_axis) * unit + math.sin(off_axis) * across).tolist()
                rays.append((n, e, d))
        return rays


class Contact(msgspec.Struct, frozen=True):
    """A body touches something, and who came to whom: speeds towards each other along the line
    from the body to what it touches.

    `label` is the mover's (or its number); None: something that stands, or the ceiling.
    """

    stamp_s: float
    label: str | None
    body_ned_m: Vector3
    body_towards_m_s: float
    mover_towards_m_s: float

    def moved_into(self, noise_m_s: float = 0.05) -> bool:
        """True when the body came to what it touches, not only the other to it."""
        return self.label is None or self.body_towards_m_s > noise_m_s


class World:
    """The obstacles, movers, floor and ceiling of a scenario; positions are NED metres from
    take-off.
    """

    def __init__(self, scenario: Scenario) -> None:
        self.walkers = tuple(Walker(mover, scenario.obstacles) for mover in scenario.movers)
        """The movers, where they are at the time of the last `at`."""
        things = (*scenario.obstacles, *scenario.movers)
        rows = [_row(thing) for thing in things]
        self._rows: FloatArray = np.array(rows, dtype=np.float64).reshape(-1, kernels.ROW)
        self._moving = self._rows[len(scenario.obstacles) :]
        self._standing = self._rows[: len(scenario.obstacles)]
        self._ceiling_m = math.inf if scenario.ceiling_m is None else scenario.ceiling_m

    def at(self, time_s: float, vehicle_ned_m: Vector3 | None = None) -> "World":
        """This world, with every mover where it is at `time_s` of simulated time.

        Times must not run backwards. `vehicle_ned_m` is what polite movers stand still for; None
        leaves them as they were.
        """
        if not self.walkers:
            return self
        vehicle_ne_m = None if vehicle_ned_m is None else vehicle_ned_m[:2]
        for row, walker in zip(self._moving, self.walkers, strict=True):
            walker.step(time_s, vehicle_ne_m)
            row[1], row[2] = walker.place_ne_m
        return self

    def contact(
        self,
        stamp_s: float,
        position_ned_m: Vector3,
        velocity_ned_m_s: Vector3,
        body_radius_m: float,
        body_half_height_m: float = BODY_HALF_HEIGHT_M,
    ) -> Contact | None:
        """Whom a body touches at `stamp_s` and who moved into whom; None while it is free."""
        self.at(stamp_s)
        if not self.collides(position_ned_m, body_radius_m, body_half_height_m):
            return None
        standing_m = kernels.clearance(self._standing, *position_ned_m, body_half_height_m)
        roof = -position_ned_m[2] + body_half_height_m >= self._ceiling_m
        if roof or standing_m <= body_radius_m:
            return Contact(stamp_s, None, position_ned_m, horizontal_norm(velocity_ned_m_s), 0.0)
        n, e, _ = position_ned_m
        gaps_m = [
            math.dist((n, e), w.place_ne_m) - w.mover.radius_m
            if kernels.clearance(row[None, :], *position_ned_m, body_half_height_m) < math.inf
            else math.inf
            for row, w in zip(self._moving, self.walkers, strict=True)
        ]
        number = min(range(len(gaps_m)), key=gaps_m.__getitem__)
        walker = self.walkers[number]
        way = (walker.place_ne_m[0] - n, walker.place_ne_m[1] - e)
        length_m = max(math.hypot(*way), 1e-9)
        un, ue = way[0] / length_m, way[1] / length_m
        vn, ve = walker.velocity_ne_m_s
        return Contact(
            stamp_s,
            walker.mover.label or str(number),
            position_ned_m,
            velocity_ned_m_s[0] * un + velocity_ned_m_s[1] * ue,
            -(vn * un + ve * ue),
        )

    def cast(self, origin_ned_m: Vector3, direction_ned: Vector3) -> float:
        """Distance from `origin_ned_m` to the first surface along `direction_ned` (any length
        above 0; ValueError otherwise): inf when there is none, 0 from inside an obstacle.
        """
        length = norm(direction_ned)
        if not 0.0 < length < math.inf:
            raise ValueError(f"{direction_ned} is not a direction: give a vector longer than 0")
        n, e, d = direction_ned
        return kernels.cast_ray(
            self._rows, self._ceiling_m, *origin_ned_m, n / length, e / length, d / length
        )

    def cast_many(
        self,
        position_ned_m: Vector3,
        roll_rad: float,
        pitch_rad: float,
        yaw_rad: float,
        bundles: RayBundles,
    ) -> list[float]:
        """Nearest return of every bundle, seen from a body with this position and attitude."""
        kernels.cast_bundles(
            self._rows,
            self._ceiling_m,
            *position_ned_m,
            roll_rad,
            pitch_rad,
            yaw_rad,
            bundles.faces,
            bundles.rays,
            bundles.distances,
        )
        distances_m: list[float] = bundles.distances.tolist()
        return distances_m

    def clearance_m(self, position_ned_m: Vector3, body_half_height_m: float = 0.0) -> float:
        """Horizontal distance from a point to the nearest surface of the obstacles that are there
        at its height, or within `body_half_height_m` of it: negative inside one, inf when there
        is none.
        """
        return kernels.clearance(self._rows, *position_ned_m, body_half_height_m)

    def collides(
        self,
        position_ned_m: Vector3,
        body_radius_m: float,
        body_half_height_m: float = BODY_HALF_HEIGHT_M,
    ) -> bool:
        """True when a level body touches an obstacle, from the side, above or below, or the
        ceiling: a cylinder of `body_radius_m` from `body_half_height_m` below the point to as much
        above it. The floor is not a collision: vehicles stand on it.
        """
        if -position_ned_m[2] + body_half_height_m >= self._ceiling_m:
            return True
        nearest_m = kernels.clearance(self._rows, *position_ned_m, body_half_height_m)
        return bool(nearest_m <= body_radius_m)


def _row(obstacle: Disc | Box | Wall | Mover) -> tuple[float, ...]:
    """One obstacle as the kernels want it."""
    # What stands on the floor goes on below it: a vehicle that rests a millimetre too deep still
    # sees it.
    bottom_m = obstacle.base_m if obstacle.base_m > 0.0 else -math.inf
    top_m = math.inf if obstacle.height_m is None else obstacle.height_m
    if isinstance(obstacle, Disc | Mover):
        at = obstacle.centre_ne_m if isinstance(obstacle, Disc) else obstacle.path_ne_m[0]
        radius_m = obstacle.radius_m
        return (kernels.DISC, *at, 1.0, 0.0, radius_m, radius_m, bottom_m, top_m)
    shape = obstacle.footprint
    return (
        kernels.BOX,
        *shape.centre_ne_m,
        math.cos(shape.yaw_rad),
        math.sin(shape.yaw_rad),
        shape.half_along_m,
        shape.half_across_m,
        bottom_m,
        top_m,
    )
