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
from autonomy.t3drm.kernels import Floats, Ints


class Linkage(msgspec.Struct, frozen=True):
    """Minimum spanning tree of (n, 2) hits: the whole filtration in three arrays (kernels)."""

    points: Floats
    order: Ints
    parent: Ints
    edge_m: Floats

    @classmethod
    def of(cls, points: Floats) -> "Linkage":
        """The tree of (n, 2) float64 points, O(n^2)."""
        if points.shape[0] == 0:
            empty = np.empty(0, dtype=np.int64)
            return cls(points, empty, empty, np.empty(0))
        return cls(points, *kernels.spanning_tree(points, np.zeros(points.shape[0])))

    def labels(self, keep_out_m: float) -> tuple[Ints, int]:
        """Component number of every hit at the keep-out radius, and how many there are."""
        return kernels.cut_tree(self.order, self.parent, self.edge_m, 2.0 * keep_out_m)

    def persistence(self) -> tuple[float, ...]:
        """Death radii of the components, ascending: half of each edge; the last one never dies."""
        if self.edge_m.shape[0] == 0:
            return ()
        return (*sorted(0.5 * float(e) for e in self.edge_m if math.isfinite(e)), math.inf)


class Shape(msgspec.Struct, frozen=True):
    """The outline of one component: hit numbers, hull (counter-clockwise in (north, east))."""

    members: Ints
    hull: Ints
    centre: Point
    radius_m: float
    linearity: float


class Classification(msgspec.Struct, frozen=True):
    """What the surroundings are. `persistence`: death radii of all hits, ascending, then inf."""

    obstacles: tuple[Obstacle, ...]
    environment: Environment
    persistence: tuple[float, ...]


def shapes_of(linkage: Linkage, labels: Ints, count: int) -> tuple[Shape, ...]:
    """The outline of every component, in the order of the labels."""
    by_label = np.argsort(labels, kind="stable")
    bounds = np.searchsorted(labels[by_label], np.arange(count + 1)).tolist()
    shapes = []
    for k in range(count):
        members = by_label[bounds[k] : bounds[k + 1]]
        hull, north, east, radius, linearity = kernels.describe(linkage.points, members)
        shapes.append(Shape(members, hull, (north, east), radius, linearity))
    return tuple(shapes)


def kind_of(shape: Shape, config: PlannerConfig) -> ObstacleKind:
    """Discrete when the component fits into a small sphere (config.discrete_radius_m)."""
    small = shape.radius_m <= config.discrete_radius_m
    return ObstacleKind.DISCRETE if small else ObstacleKind.CONTINUOUS


def environment_of(kinds: tuple[ObstacleKind, ...]) -> Environment:
    """Free, discrete, continuous or mixed, by what the components are."""
    present = set(kinds)
    if not present:
        return Environment.FREE
    if len(present) == 2:
        return Environment.MIXED
    return Environment(present.pop().value)


def obstacles_of(
    linkage: Linkage,
    labels: Ints,
    shapes: tuple[Shape, ...],
    keep_out_m: float,
    config: PlannerConfig,
) -> tuple[Obstacle, ...]:
    """The components as records for people, logs and the mission.

    Regularity is 1 / (1 + variation) of the tree's edge lengths: 1 for evenly spaced hits.
    """
    rows: list[Point] = [(n, e) for n, e in linkage.points.tolist()]
    deaths = _deaths(linkage, labels, len(shapes), keep_out_m)
    obstacles = []
    for shape, death in zip(shapes, deaths, strict=True):
        obstacles.append(
            Obstacle(
                kind=kind_of(shape, config),
                centre=shape.centre,
                radius_m=shape.radius_m,
                hull=tuple([rows[i] for i in shape.hull.tolist()]),
                hits=tuple([rows[i] for i in shape.members.tolist()]),
                linearity=shape.linearity,
                regularity=kernels.regularity(linkage.edge_m, shape.members, 2.0 * keep_out_m),
                death_m=death,
            )
        )
    return tuple(obstacles)


def classify(
    hits: tuple[Point, ...] | Floats, keep_out_m: float, config: PlannerConfig
) -> Classification:
    """Components of the hits at the keep-out radius, their kinds, and the persistence diagram."""
    linkage = Linkage.of(np.asarray(hits, dtype=np.float64).reshape(-1, 2))
    labels, count = linkage.labels(keep_out_m)
    shapes = shapes_of(linkage, labels, count)
    return Classification(
        obstacles=obstacles_of(linkage, labels, shapes, keep_out_m, config),
        environment=environment_of(tuple(kind_of(shape, config) for shape in shapes)),
        persistence=linkage.persistence(),
    )


def _deaths(linkage: Linkage, labels: Ints, count: int, keep_out_m: float) -> list[float]:
    """Per component the radius at which it meets its nearest neighbour; inf when it is alone."""
    deaths = [math.inf] * count
    for i in np.flatnonzero(linkage.edge_m >= 2.0 * keep_out_m).tolist():
        p = int(linkage.parent[i])
        if p < 0:
            continue
        radius = 0.5 * float(linkage.edge_m[i])
        for end in (int(labels[i]), int(labels[p])):
            deaths[end] = min(deaths[end], radius)
    return deaths
