"""Geodesic of the metric g = I / v(x)^2 on a local grid: the fallback of both navigations.

v is the speed that Table 2 allows; with v = v_max outside every keep-out and 0 inside, geodesics
are shortest paths. Unknown space is free. Cells say where to look; what is flown is checked
against the hit points themselves.
"""

import math

import msgspec
import numpy as np

from autonomy.geometry import Point
from autonomy.t3drm import kernels
from autonomy.t3drm.kernels import Floats, Ints, Mask

MARGIN_CELLS = 4


class Grid(msgspec.Struct, frozen=True):
    """Cells over start, goal and hits inside the fence. `box`: north, east of the corner, side."""

    box: Floats
    free: Mask
    sides: Floats
    """The fence's polygon when it is not convex: then its sides are checked too."""


class GeodesicPath(msgspec.Struct, frozen=True, tag="path"):
    """A polyline whose every segment keeps the keep-out from every hit."""

    points: tuple[Point, ...]


class Closed(msgspec.Struct, frozen=True, tag="closed"):
    """No way at this keep-out and cell. `evidence`: indices of the hits that bar it."""

    evidence: tuple[int, ...]


def grid_around(
    ends: Floats,
    hits: Floats,
    keep_out_m: float,
    polygon: Floats,
    cell_m: float,
    *,
    convex: bool,
) -> Grid:
    """The grid; a taut path never leaves the hull of ends and hits by more than the keep-out
    (and of the fence's corners when it is not convex).

    Cells are free at sqrt(keep_out^2 + cell^2 / 2), so that a step between neighbours is free.
    """
    sides = polygon[:0] if convex else polygon
    known = np.concatenate((ends, hits, sides))
    slack = keep_out_m + MARGIN_CELLS * cell_m
    low = np.maximum(known.min(axis=0) - slack, polygon.min(axis=0))
    high = np.minimum(known.max(axis=0) + slack, polygon.max(axis=0))
    shape = np.maximum(1, np.ceil((high - low) / cell_m)).astype(np.int64)
    box = np.array((low[0], low[1], cell_m))
    inflated = math.sqrt(keep_out_m**2 + 0.5 * cell_m**2)
    return Grid(box, kernels.free_cells(hits, inflated, polygon, sides, box, shape), sides)


def geodesic(
    start: Point,
    goal: Point,
    hits: Floats,
    keep_out_m: float,
    polygon: Floats,
    cell_m: float,
    *,
    convex: bool = True,
) -> GeodesicPath | Closed:
    """An any-angle shortest path from start to goal, or Closed with the hits that bar it.

    hits: (n, 2) north, east; polygon: (k, 2) fence corners, `convex` says so. Start and goal are
    at least `keep_out_m` from every hit and inside the fence. Gaps below about 2 keep-out + cell
    may be read as closed: only the tangent search proves that there is no way.
    """
    ends = np.array((start, goal))
    grid = grid_around(ends, hits, keep_out_m, polygon, cell_m, convex=convex)
    squares = kernels.into_squares(hits, 0.0)
    if kernels.in_sight(hits, squares, keep_out_m, grid.sides, *start, *goal):
        return GeodesicPath((start, goal))
    found, path, _ = kernels.grid_geodesic(
        hits, squares, keep_out_m, grid.sides, grid.free, grid.box, ends
    )
    if not found:
        return Closed(_evidence(grid, ends, hits, keep_out_m))
    pulled = kernels.pull_string(path, hits, squares, keep_out_m, grid.sides)
    return GeodesicPath(tuple((n, e) for n, e in pulled.tolist()))


def closing_hits(
    start: Point,
    goal: Point,
    hits: Floats,
    keep_out_m: float,
    polygon: Floats,
    cell_m: float,
    *,
    convex: bool = True,
) -> tuple[int, ...]:
    """The hits that keep start and goal apart, for a way that is known to be closed."""
    ends = np.array((start, goal))
    grid = grid_around(ends, hits, keep_out_m, polygon, cell_m, convex=convex)
    return _evidence(grid, ends, hits, keep_out_m)


def _evidence(grid: Grid, ends: Floats, hits: Floats, keep_out_m: float) -> tuple[int, ...]:
    """Hits that border the smaller of the two regions and belong to what parts them.

    A component parts them when it borders both; where none does (the fence takes part), all hits
    at the smaller region's border are named.
    """
    if hits.shape[0] == 0:
        return ()
    regions = [kernels.flood(grid.free, grid.box, *end) for end in ends.tolist()]
    small, large = sorted(regions, key=lambda region: int(region.sum()))
    within = keep_out_m + 2.0 * float(grid.box[2])
    near = kernels.bordering(hits, small, grid.box, within).astype(bool)
    far = kernels.bordering(hits, large, grid.box, within).astype(bool)
    labels = _components(hits, keep_out_m)
    parting = near & np.isin(labels, np.intersect1d(labels[near], labels[far]))
    chosen = parting if parting.any() else near
    return tuple(np.flatnonzero(chosen).tolist())


def _components(hits: Floats, keep_out_m: float) -> Ints:
    return kernels.join_overlapping(hits, np.full(hits.shape[0], keep_out_m))[0]
