"""The map in the plane of flight: where rays ended, and which space was seen to be free.

Evidence per cell, distances to the mean of the hits in a cell (never to the cell's centre), and a
time stamp of the last sight per cell. README.md explains the rules and shows a picture.
"""

import math
import struct
from collections.abc import Collection, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from autonomy.config import MapConfig, MoversConfig
from autonomy.geometry import Point
from autonomy.perception import kernels
from autonomy.perception.projection import Ray
from hal.config import Fence
from hal.frames import Vector3

FloatArray = npt.NDArray[np.float64]

# Beyond the fence the map reaches farther than any beam, so that what is near the fence is known.
MARGIN_M = 1.2
# An accumulated shift of the frame up to this is carried as an offset; then cells are moved.
OFFSET_MAX_M = 0.5
# The vehicle stands where it stands: its disc, less the error of its position, is free.
BODY_SHRINK_M = 0.01
# A gap that no cone fits into is no way when it is not wider than this, so it may read closed.
# Of a wider one only the ends are known.
PASSABLE_M = 0.40
# After a whole map was forgotten, as before "unreachable", longer arcs are no evidence at all: a
# verdict rests on what was looked at from nearby.
DOUBTED_ARC_M = 0.20

_ROW = struct.Struct(f"={kernels.RAY_COLUMNS}d")  # one row of the kernel's table of rays


class ObstacleMap:
    """Evidence grid over the fence's bounding box and 1.2 m more; implements hal's SeenSpace.

    Space outside the grid counts as not seen. Deterministic: the same rays in the same order
    give the same map, bit for bit, including the order of `hits`.
    """

    def __init__(self, config: MapConfig, body_radius_m: float, fence: Fence) -> None:
        self._config = config
        self._cell_m = config.cell_m
        north_min, north_max, east_min, east_max = fence.bounds()
        self._north0_m = self._home_north_m = north_min - MARGIN_M
        self._east0_m = self._home_east_m = east_min - MARGIN_M
        rows = math.ceil((north_max + MARGIN_M - self._north0_m) / self._cell_m)
        columns = math.ceil((east_max + MARGIN_M - self._east0_m) / self._cell_m)
        self._slot = np.full((rows, columns, kernels.LAYERS), -1, dtype=np.int32)
        self._seen = np.full((rows, columns), -np.inf)
        self._points = np.zeros((1024, 2))
        self._evidence = np.zeros(1024, dtype=np.int32)
        self._cell_of = np.zeros(1024, dtype=np.int64)
        self._counters = np.zeros(kernels.COUNTERS, dtype=np.int64)
        self._beams = _no_rays(8)
        self._cones = np.full((kernels.CONES, kernels.CONE_COLUMNS), -np.inf)
        self._open_bits = np.zeros(kernels.CONES, dtype=np.int64)
        self._rays = _ray_table(16)
        self._found = np.zeros((9, 2), dtype=np.int64)  # room for the kernel's list of cells
        self._params = _parameters(config, body_radius_m)
        self._now_s: float | None = None
        self._waiting_discs: list[tuple[Point, float]] = []
        self._version = 0
        self.moved_cells = (0, 0)
        """By how many rows and columns `shift` has moved the content of `cell`s so far."""
        self._hits: FloatArray | None = None
        self._newest_counts = False

    # ------------------------------------------------------------ taking in

    def update(self, now_s: float, rays: Sequence[Ray]) -> None:
        """Take in new rays, oldest first for each beam; repeated or older ones change nothing.

        `now_s` is the time of the step, on the same axis as the stamps of the rays.
        """
        self._now_s = now_s
        for point, radius_m in self._waiting_discs:
            self.mark_seen_disc(point, radius_m, now_s)
        self._waiting_discs.clear()
        if not rays:
            return
        self._make_room(rays)
        memory, offset = self._rays.data, 0
        for ray in rays:
            origin, centre, bearing = ray.origin_ned_m, ray.centre, ray.bearing_rad
            _ROW.pack_into(
                memory,
                offset,
                ray.stamp_s,
                ray.beam,
                ray.kind,
                origin[0],
                origin[1],
                math.cos(bearing),
                math.sin(bearing),
                ray.length_m,
                centre[0],
                centre[1],
                ray.half_angle_rad,
                ray.free_m,
            )
            offset += _ROW.size
        counters = self._counters
        taken = kernels.integrate(
            self._slot,
            self._seen,
            self._points,
            self._evidence,
            self._cell_of,
            counters,
            self._beams,
            self._cones,
            self._open_bits,
            self._params,
            self._rays,
            len(rays),
            self._north0_m,
            self._east0_m,
        )
        if taken:
            self._hits = None
        self._count_changes()

    def mark_seen_disc(
        self, point: Point, radius_m: float | None = None, now_s: float | None = None
    ) -> None:
        """Take the disc for seen free at `now_s` (default: the last update, or else the first).

        `radius_m` defaults to the configured start disc.
        """
        radius = self._config.start_disc_m if radius_m is None else radius_m
        stamp_s = self._now_s if now_s is None else now_s
        if stamp_s is None:
            self._waiting_discs.append((point, radius))
            return
        kernels.see_disc(
            self._seen, self._params, *self._origin(), *map(float, (*point, radius, stamp_s))
        )

    def doubt(self, movers: MoversConfig | None) -> None:
        """From now on things move: old sights are no longer believed, and fewer looks through a hit
        erase it. None: everything stands again.
        """
        config, params = self._config, self._params
        age_s, cap, edge_deg = config.seen_max_age_s, config.hit_cap, config.edge_rule_deg
        if movers is not None:
            age_s, cap = min(age_s, movers.seen_max_age_s), min(cap, movers.hit_cap)
            edge_deg = max(edge_deg, movers.edge_rule_deg)
        params[kernels.P_MAX_AGE] = age_s
        params[kernels.P_CAP] = min(cap, self._least_cap) if self._newest_counts else cap
        params[kernels.P_EDGE_COS] = math.cos(math.radians(edge_deg))

    def trust_newest(self) -> None:
        """From now on a hit counts as if it was seen twice, however often it was seen before.

        For a map that closes every way: hits that were taken while the position was wrong by some
        centimetres stand beside those of now, and narrow every gap from both sides.
        """
        self._newest_counts = True
        self._params[kernels.P_CAP] = min(self._params[kernels.P_CAP], self._least_cap)
        np.minimum(self._evidence, self._least_cap, out=self._evidence)

    @property
    def _least_cap(self) -> int:
        """The evidence of two looks: a single free ray beside an edge must not erase it."""
        config = self._config
        return min(config.hit_cap, max(2 * config.hit_gain, config.occupied_from))

    def shift(self, delta_ne: Point) -> None:
        """The frame jumped: what was at p is at p + `delta_ne` now. Loses nothing on the map.

        The grid's origin moves, exactly; only when it has drifted far from the fence are whole
        cells moved, which loses what leaves the grid.
        """
        if delta_ne == (0.0, 0.0):
            return
        self._north0_m += delta_ne[0]
        self._east0_m += delta_ne[1]
        drift_n = self._north0_m - self._home_north_m
        drift_e = self._east0_m - self._home_east_m
        if max(abs(drift_n), abs(drift_e)) > OFFSET_MAX_M:
            self._move_cells(round(drift_n / self._cell_m), round(drift_e / self._cell_m))
        self._version += 1
        self._hits = None

    def follow(self, version: int) -> None:
        """This map takes the place of another at `version`: its own goes on above that."""
        self._version = max(self._version, version) + 1

    # ------------------------------------------------------------ forgetting

    def forget_within(self, point: Point, radius_m: float, keep_disc_m: float) -> None:
        """Forget all hits within `radius_m` of `point`, and all sights except the inner disc's.

        Nothing moves there before it is seen again: unseen space blocks.
        """
        kernels.forget(
            self._slot,
            self._seen,
            self._points,
            self._evidence,
            self._cell_of,
            self._counters,
            self._params,
            *self._origin(),
            float(point[0]),
            float(point[1]),
            float(radius_m),
            float(keep_disc_m),
        )
        self._counters[kernels.APPEARED] = 0
        self._cones.fill(-np.inf)
        self._open_bits.fill(0)
        self._hits = None
        self._count_changes()

    def forget_seen_since(self, since_s: float, point: Point, keep_disc_m: float) -> None:
        """What was seen free at `since_s` or later was not seen, except the disc around `point`.

        For a beam that turns out to have lied: the hits stay, and nothing moves before the other
        beams have looked again.
        """
        now_s = self._now_s
        self._seen[self._seen >= since_s] = -np.inf
        if now_s is not None:
            self.mark_seen_disc(point, keep_disc_m, now_s)

    def forget_cones(self, beams: Collection[int]) -> None:
        """What wide beams (numbered as in `Ray.beam`) showed as free no longer narrows down hits.

        For a hit where another beam saw nothing a moment before: one of the two is wrong, or
        something came, and then it is there.
        """
        theirs = np.isin(self._cones[:, kernels.C_BEAM], list(beams))
        self._cones[theirs, kernels.C_STAMP] = -np.inf

    def forget_all(self, point: Point, keep_disc_m: float) -> None:
        """Forget the whole map except that the disc around `point` was seen.

        From then on what a wide beam saw counts as an obstacle only where it is known to within
        20 cm.
        """
        self._params[kernels.P_WHOLE_ARC] = DOUBTED_ARC_M / self._cell_m
        self._params[kernels.P_ARC_ENDS] = 0.0
        rows, columns = self._seen.shape
        self.forget_within(point, (rows + columns) * self._cell_m + 1.0e3, keep_disc_m)

    # ------------------------------------------------------------ hits

    @property
    def version(self) -> int:
        """Increases with every change of the set of occupied cells (new, cleared, moved)."""
        return self._version

    @property
    def hit_count(self) -> int:
        """Number of `hits`."""
        return len(self.hits())

    def hits(self) -> FloatArray:
        """(n, 2) north, east of the mean hit point of each occupied cell, in m; read-only.

        A cell at an obstacle's edge has two: the mean of the rays' ends and that of the edges.

        Computed when first asked for after an update. The order is deterministic, not spatial.
        """
        if self._hits is None:
            hits = self._occupied()
            hits.setflags(write=False)
            self._hits = hits
        return self._hits

    def cell(self, point: Point) -> tuple[int, int]:
        """Row and column of the cell that holds a place, on the grid or not."""
        return (
            math.floor((point[0] - self._north0_m) / self._cell_m),
            math.floor((point[1] - self._east0_m) / self._cell_m),
        )

    def hit_cells_within(self, point: Point, radius_m: float) -> list[tuple[int, int]]:
        """The cells about `radius_m` near with evidence of a hit."""
        reach = round(radius_m / self._cell_m)
        if len(self._found) < (2 * reach + 1) ** 2:
            self._found = np.zeros(((2 * reach + 1) ** 2, 2), dtype=np.int64)
        count = kernels.hit_cells(self._slot, *self.cell(point), reach, self._found)
        return [(i, j) for i, j in self._found[:count].tolist()] if count else []

    def was_free(self, point: Point, radius_m: float, max_age_s: float) -> bool:
        """True when all within `radius_m` was seen free in the last `max_age_s` before the last
        update. A square, to the cell.
        """
        if self._now_s is None:
            return False
        reach, since_s = round(radius_m / self._cell_m), float(self._now_s - max_age_s)
        return bool(kernels.free_since(self._seen, *self.cell(point), reach, since_s))

    # ------------------------------------------------------------ SeenSpace

    def free_distance_m(
        self, position_ned_m: Vector3, heading_rad: float, limit_m: float, now_s: float
    ) -> float:
        """How far the body may travel from the position along the bearing, at most `limit_m`.

        The way ends at the first travel s >= 0 where
        - a hit is nearer than `corridor_hit_m` to the centre. When one is nearer than that at the
          start already (at distance d0), the limit is min(corridor_hit_m, d0 + 0.17 s) instead:
          motion is free that gains at least 17 cm of clearance per metre (so straight away from
          a wall, or up to 80 degrees off that), and no other hit may come nearer meanwhile;
        - a cell with its centre within `corridor_seen_m` was not seen free within the last
          `seen_max_age_s` and has no hit within `accounted_within_m` of its centre. A cell within
          that radius at the start already blocks at once, unless its direction is more than 100
          degrees off the motion.
        """
        if not limit_m > 0.0:
            return 0.0
        distance: float = kernels.free_distance(
            self._slot,
            self._seen,
            self._points,
            self._evidence,
            self._params,
            self._north0_m,
            self._east0_m,
            float(position_ned_m[0]),  # an integer would make numba compile another version
            float(position_ned_m[1]),
            math.cos(heading_rad),
            math.sin(heading_rad),
            float(limit_m),
            float(now_s),
        )
        return distance

    def clearance_m(self, position_ned_m: Vector3, limit_m: float) -> float:
        """Horizontal distance from the position to the nearest hit, at most `limit_m`."""
        return min(limit_m, self._nearest(position_ned_m)[0])

    def nearest_hit(self, position_ned_m: Vector3, limit_m: float) -> tuple[float, float] | None:
        """(distance_m, NED bearing_rad) of the nearest hit within `limit_m`, else None."""
        distance, index = self._nearest(position_ned_m)
        if index < 0 or distance > limit_m:
            return None
        north = self._points[index, 0] * self._cell_m + self._north0_m - position_ned_m[0]
        east = self._points[index, 1] * self._cell_m + self._east0_m - position_ned_m[1]
        return distance, math.atan2(east, north)

    # ------------------------------------------------------------ further questions

    def ever_seen(self, points: FloatArray) -> npt.NDArray[np.bool_]:
        """(n,) True where the cell of a point (n, 2) was seen free, however long ago."""
        index = np.floor((points - np.array(self._origin())) / self._cell_m).astype(np.int64)
        inside = np.all((index >= 0) & (index < self._seen.shape), axis=1)
        seen = np.zeros(len(points), dtype=np.bool_)
        seen[inside] = self._seen[index[inside, 0], index[inside, 1]] > -np.inf
        return seen

    def seen_cells(self, now_s: float) -> FloatArray:
        """(n, 2) north, east of the centres of the cells seen free recently; for pictures."""
        index = np.argwhere(self._seen >= now_s - self._config.seen_max_age_s)
        centres: FloatArray = (index + 0.5) * self._cell_m + np.array(self._origin())
        return centres

    def open_arcs(self) -> list[FloatArray]:
        """(n, 2) north, east of what is left of each arc that is not settled yet: what a wide beam
        saw is at one of these points, at least. For pictures and tests.
        """
        turns = np.linspace(-1.0, 1.0, kernels.ARC_POINTS)
        arcs = []
        for cone, bits in zip(self._cones, self._open_bits, strict=True):
            left = turns[[bool(bits >> k & 1) for k in range(kernels.ARC_POINTS)]]
            if len(left):
                axis = math.atan2(cone[kernels.C_SIN], cone[kernels.C_COS])
                bearings = axis + cone[kernels.C_ARC] * left
                along = np.stack((np.cos(bearings), np.sin(bearings)), axis=1)
                face = cone[[kernels.C_X, kernels.C_Y]]
                points = face + cone[kernels.C_LENGTH] * along
                arcs.append(points * self._cell_m + np.array(self._origin()))
        return arcs

    # ------------------------------------------------------------ inside

    @property
    def _count(self) -> int:
        return int(self._counters[kernels.COUNT])

    def _origin(self) -> Point:
        return self._north0_m, self._east0_m

    def _nearest(self, position_ned_m: Vector3) -> tuple[float, int]:
        answer: tuple[float, int] = kernels.nearest(
            self._points,
            self._evidence,
            self._counters,
            self._params,
            self._north0_m,
            self._east0_m,
            float(position_ned_m[0]),
            float(position_ned_m[1]),
        )
        return answer

    def _occupied(self) -> FloatArray:
        points: FloatArray = kernels.occupied(
            self._points, self._evidence, self._counters, self._params, *self._origin()
        )
        return points

    def _count_changes(self) -> None:
        if self._counters[kernels.CLEARED] > 0 or self._counters[kernels.APPEARED] > 0:
            self._version += 1

    def _make_room(self, rays: Sequence[Ray]) -> None:
        """Grow what the kernel must not: rays, beams, and the list (two new points a ray)."""
        if len(rays) > len(self._rays):
            self._rays = _ray_table(2 * len(rays))
        beams = 1 + max(ray.beam for ray in rays)
        if beams > len(self._beams):
            self._beams = np.concatenate((self._beams, _no_rays(beams - len(self._beams))))
        new = 2 * len(rays)
        if any(ray.half_angle_rad > 0.0 for ray in rays):
            new += kernels.ARC_POINTS * (len(rays) + int(np.count_nonzero(self._open_bits)))
        while self._count + new > len(self._points):
            self._points = _doubled(self._points)
            self._evidence = _doubled(self._evidence)
            self._cell_of = _doubled(self._cell_of)

    def _move_cells(self, rows: int, columns: int) -> None:
        """Move the content by whole cells and the origin back by as much; exact."""
        self.moved_cells = (self.moved_cells[0] + rows, self.moved_cells[1] + columns)
        self._north0_m -= rows * self._cell_m
        self._east0_m -= columns * self._cell_m
        seen = np.full_like(self._seen, -np.inf)
        to_n, from_n = _overlap(rows, seen.shape[0])
        to_e, from_e = _overlap(columns, seen.shape[1])
        seen[to_n, to_e] = self._seen[from_n, from_e]
        self._seen = seen
        count = self._count
        row, column, layer = np.unravel_index(self._cell_of[:count], self._slot.shape)
        row, column = row + rows, column + columns
        kept = (row >= 0) & (row < seen.shape[0]) & (column >= 0) & (column < seen.shape[1])
        left = int(np.count_nonzero(kept))
        place = (row[kept], column[kept], layer[kept])
        self._points[:left] = self._points[:count][kept] + (rows, columns)
        self._evidence[:left] = self._evidence[:count][kept]
        self._cell_of[:left] = np.ravel_multi_index(place, self._slot.shape)
        self._slot.fill(-1)
        self._slot[place] = np.arange(left, dtype=np.int32)
        self._counters[kernels.COUNT] = left
        self._beams[:, kernels.B_X] += rows
        self._beams[:, kernels.B_Y] += columns
        self._cones[:, kernels.C_X] += rows
        self._cones[:, kernels.C_Y] += columns


def representative_hits(hits: FloatArray, spacing_m: float) -> FloatArray:
    """A subset of `hits` (n, 2) in which no two are within `spacing_m`, and each of the rest has
    one of the subset within it. Depends on the set of points alone, not on their order.

    Whoever plans with the subset must add `spacing_m` to its keep-out radius to keep clear of all.
    """
    order = np.lexsort((hits[:, 1], hits[:, 0]))
    ordered = np.ascontiguousarray(hits[order])
    chosen: FloatArray = ordered[kernels.thin(ordered, spacing_m)]
    return chosen


def _parameters(config: MapConfig, body_radius_m: float) -> FloatArray:
    cell = config.cell_m
    params = np.zeros(kernels.PARAMS)
    params[kernels.P_CELL] = cell
    params[kernels.P_GAIN] = config.hit_gain
    params[kernels.P_CAP] = config.hit_cap
    params[kernels.P_OCCUPIED] = config.occupied_from
    params[kernels.P_CLEAR] = config.clear_within_m / cell
    params[kernels.P_WEIGHT] = config.hit_mean_weight
    params[kernels.P_EDGE_COS] = math.cos(math.radians(config.edge_rule_deg))
    params[kernels.P_FREE_SHRINK] = config.free_shrink_m / cell
    # In front of a hit the seen space must reach into the accounted space, or a ring of cells
    # that nothing can ever see would remain between them.
    meets = max(0.0, config.accounted_within_m - 0.75 * cell)
    params[kernels.P_HIT_SHRINK] = min(config.free_shrink_m, meets) / cell
    params[kernels.P_ACCOUNTED] = config.accounted_within_m / cell
    params[kernels.P_MAX_AGE] = config.seen_max_age_s
    params[kernels.P_HIT_RADIUS] = config.corridor_hit_m / cell
    params[kernels.P_SEEN_RADIUS] = config.corridor_seen_m / cell
    params[kernels.P_WHOLE_ARC] = PASSABLE_M / cell
    params[kernels.P_ARC_ENDS] = 2.0
    params[kernels.P_BODY] = max(0.0, body_radius_m - BODY_SHRINK_M) / cell
    return params


def _ray_table(rows: int) -> FloatArray:
    """The kernel's table of rays; packing rows into its memory is several times as fast as
    assigning to its elements.
    """
    return np.zeros((rows, kernels.RAY_COLUMNS))


def _no_rays(beams: int) -> FloatArray:
    table = np.zeros((beams, kernels.BEAM_COLUMNS))
    table[:, kernels.B_KIND] = -1.0
    return table


def _doubled(array: npt.NDArray[Any]) -> npt.NDArray[Any]:
    return np.concatenate((array, np.zeros_like(array)))


def _overlap(by: int, size: int) -> tuple[slice, slice]:
    """Target and source slices of one axis when its content moves by `by` cells."""
    if by >= 0:
        return slice(min(by, size), size), slice(0, max(0, size - by))
    return slice(0, max(0, size + by)), slice(min(-by, size), size)
