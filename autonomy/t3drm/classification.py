"""Classification by topology: which hits are one obstacle, and of which kind.

Growing the keep-out spheres of all hits together (Eq. 4) is a filtration. Its connected components
over the radius are 0-dimensional persistent homology, which is single linkage: read off a minimum
spanning tree of the hits. Two hits join when nothing passes between them (distance < 2 keep-out).
"""

import math

import msgspec
import numpy as np

from autonomy.config import PlannerConfig
from autonomy.geometry import Point
from autonomy.model import Environment, Obstacle, ObstacleKind
from autonomy.t3drm import kernels
from autonomy.t3drm.kernels import Floats, Ints, Mask


class Linkage(msgspec.Struct, frozen=True):
    """Minimum spanning tree of (n, 2) hits: the whole filtration in three arrays (kernels)."""

    points: Floats
    order: Ints
    parent: Ints
    edge_m: Floats

    @classmethod
    def of(cls, points: Floats) -> "Linkage":
        """The tree of (n, 2) float64 points, O(n log n) for many."""
        return cls(points, *kernels.spanning_tree(points))

    def labels(self, keep_out_m: float) -> tuple[Ints, int]:
        """Component number of every hit at the keep-out radius, and how many there are."""
        return kernels.cut_tree(self.order, self.parent, self.edge_m, 2.0 * keep_out_m)

    def persistence(self) -> tuple[float, ...]:
        """Death radii of the components, ascending: half of each edge; the last one never dies."""
        if self.edge_m.shape[0] == 0:
            return ()
        return (*sorted(0.5 * float(e) for e in self.edge_m if math.isfinite(e)), math.inf)


class Outlines(msgspec.Struct, frozen=True):
    """All components at one keep-out radius, in the order of their labels, as arrays.

    Component c has the hits members[first[c] : first[c + 1]] (ascending) and the convex hull
    hulls[corner[c] : corner[c + 1]] (numbers of hits, counter-clockwise in (north, east)); `rows`
    are (north, east, radius) of its smallest enclosing circle and its linearity.
    """

    labels: Ints
    members: Ints
    first: Ints
    hulls: Ints
    corner: Ints
    rows: Floats
    discrete: Mask
    """1 where the component fits into a small sphere (config.discrete_radius_m)."""

    @classmethod
    def of(cls, linkage: Linkage, keep_out_m: float, discrete_radius_m: float) -> "Outlines":
        """The components of the hits at a keep-out radius."""
        labels, count = linkage.labels(keep_out_m)
        members, first = kernels.by_label(labels, count)
        hulls, corner, rows = kernels.outlines(linkage.points, members, first)
        discrete = (rows[:, 2] <= discrete_radius_m).astype(np.uint8)
        return cls(labels, members, first, hulls, corner, rows, discrete)

    @property
    def count(self) -> int:
        """Number of components."""
        return int(self.rows.shape[0])

    def hull_of(self, label: int) -> Ints:
        """Numbers of the hits that are the corners of one component's hull."""
        return self.hulls[self.corner[label] : self.corner[label + 1]]

    @property
    def environment(self) -> Environment:
        """Free, discrete, continuous or mixed, by what the components are."""
        small = int(self.discrete.sum())
        if self.count == 0:
            return Environment.FREE
        if 0 < small < self.count:
            return Environment.MIXED
        return Environment.DISCRETE if small else Environment.CONTINUOUS


class Classification(msgspec.Struct, frozen=True):
    """What the surroundings are. `persistence`: death radii of all hits, ascending, then inf."""

    obstacles: tuple[Obstacle, ...]
    environment: Environment
    persistence: tuple[float, ...]


_KINDS = (ObstacleKind.CONTINUOUS, ObstacleKind.DISCRETE)


def obstacles_of(linkage: Linkage, outlines: Outlines, keep_out_m: float) -> tuple[Obstacle, ...]:
    """The components as records for people, logs and the mission.

    Regularity is 1 / (1 + variation) of the tree's edge lengths: 1 for evenly spaced hits. The
    death radius is where a component meets its nearest neighbour; inf when it is alone.
    """
    if outlines.count == 0:
        return ()
    traits = kernels.regularities_and_deaths(
        linkage.parent,
        linkage.edge_m,
        outlines.labels,
        outlines.members,
        outlines.first,
        2.0 * keep_out_m,
    )
    hits = _as_tuples(linkage.points[outlines.members])
    corners = _as_tuples(linkage.points[outlines.hulls])
    first, corner = outlines.first.tolist(), outlines.corner.tolist()
    rows = zip(outlines.rows.tolist(), traits.tolist(), outlines.discrete.tolist(), strict=True)
    return tuple(
        [
            Obstacle(
                kind=_KINDS[discrete],
                centre=(north, east),
                radius_m=radius,
                hull=tuple(corners[corner[c] : corner[c + 1]]),
                hits=tuple(hits[first[c] : first[c + 1]]),
                linearity=linearity,
                regularity=regularity,
                death_m=death,
            )
            for c, ((north, east, radius, linearity), (regularity, death), discrete) in enumerate(
                rows
            )
        ]
    )


def _as_tuples(points: Floats) -> list[Point]:
    # Two lists of floats, not one of pairs: half as much for the garbage collector to look at.
    return list(zip(points[:, 0].tolist(), points[:, 1].tolist(), strict=True))


def classify(
    hits: tuple[Point, ...] | Floats, keep_out_m: float, config: PlannerConfig
) -> Classification:
    """Components of the hits at the keep-out radius, their kinds, and the persistence diagram."""
    linkage = Linkage.of(np.array(hits, dtype=np.float64).reshape(-1, 2))
    outlines = Outlines.of(linkage, keep_out_m, config.discrete_radius_m)
    return Classification(
        obstacles=obstacles_of(linkage, outlines, keep_out_m),
        environment=outlines.environment,
        persistence=linkage.persistence(),
    )
