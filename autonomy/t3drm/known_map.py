"""The hits of one version of the map, with all that was found out about them.

Nothing here depends on start or goal: a planner keeps it from plan to plan while the map stands
still. What is asked first is found out first; the order of questions changes no answer.
"""

import math

import msgspec
import numpy as np

from autonomy.config import PlannerConfig
from autonomy.geometry import Point
from autonomy.model import Obstacle
from autonomy.t3drm import kernels
from autonomy.t3drm.classification import Linkage, Outlines, obstacles_of
from autonomy.t3drm.kernels import Floats, Mask, Squares
from autonomy.t3drm.spherical import Discs


class Level(msgspec.Struct, frozen=True):
    """The hits as obstacles at one keep-out radius."""

    keep_out_m: float
    outlines: Outlines
    spheres: Mask
    """1 for every component that a sphere may stand for: discrete, more than one point."""


class KnownMap:
    """(n, 2) float64 hits, rows (north, east); `squares` is their spatial index."""

    def __init__(self, hits: Floats, config: PlannerConfig) -> None:
        # A copy: the caller's array may change, and a read-only one is another type to numba.
        self.hits = np.array(hits, dtype=np.float64).reshape(-1, 2)
        self.squares: Squares = kernels.into_squares(self.hits, 0.0)
        self._source = hits
        self._discrete_radius_m = config.discrete_radius_m
        self._linkage: Linkage | None = None
        self._levels: dict[float, Level] = {}
        self._discs: dict[tuple[float, bytes], Discs] = {}
        self._obstacles: dict[float, tuple[Obstacle, ...]] = {}

    def is_of(self, hits: Floats) -> bool:
        """True when these are the same hits. An array that is read-only and was given before is
        taken to be unchanged without a look at it.
        """
        if hits is self._source and not hits.flags.writeable:
            return True
        return bool(np.array_equal(self.hits, hits))

    @property
    def linkage(self) -> Linkage:
        """The whole filtration."""
        if self._linkage is None:
            self._linkage = Linkage.of(self.hits)
        return self._linkage

    def level(self, keep_out_m: float) -> Level:
        """The components at a keep-out radius."""
        found = self._levels.get(keep_out_m)
        if found is None:
            outlines = Outlines.of(self.linkage, keep_out_m, self._discrete_radius_m)
            spheres = outlines.discrete & (outlines.rows[:, 2] > 0.0)
            found = self._levels[keep_out_m] = Level(keep_out_m, outlines, spheres)
        return found

    def obstacles(self, keep_out_m: float) -> tuple[Obstacle, ...]:
        """The components as records."""
        found = self._obstacles.get(keep_out_m)
        if found is None:
            outlines = self.level(keep_out_m).outlines
            found = obstacles_of(self.linkage, outlines, keep_out_m)
            self._obstacles[keep_out_m] = found
        return found

    def discs(self, keep_out_m: float, spheres: Mask) -> Discs:
        """Every hit with the keep-out radius; one sphere instead of a component's hits where
        `spheres` (one per component) is 1.
        """
        key = (keep_out_m, spheres.tobytes() if spheres.any() else b"")
        found = self._discs.get(key)
        if found is None:
            found = self._discs[key] = self._make_discs(self.level(keep_out_m), spheres)
        return found

    def _make_discs(self, level: Level, spheres: Mask) -> Discs:
        keep_out_m, outlines, linkage = level.keep_out_m, level.outlines, self.linkage
        labels = outlines.labels
        radii = np.full(labels.shape[0], keep_out_m)
        chain = kernels.sparse_chain(
            linkage.order, linkage.parent, linkage.edge_m, 2.0 * keep_out_m, self.hits, radii
        )
        if not spheres.any():
            return Discs.joined(self.hits, radii, labels, chain)
        return Discs(
            *kernels.with_spheres(self.hits, keep_out_m, labels, chain, spheres, outlines.rows)
        )

    def nearest_m(self, point: Point) -> float:
        """Distance from a point to the nearest hit; inf without hits."""
        return math.sqrt(kernels.clearance2(self.hits, *point))

    def is_clear(self, point: Point, keep_out_m: float) -> bool:
        """True when no hit is nearer to the point than the keep-out radius."""
        near = kernels.points_near(self.hits, self.squares, *point, keep_out_m)
        return bool(near.shape[0] == 0)
