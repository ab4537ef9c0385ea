"""Brute force for the shortest path among discs: the whole tangent graph, in plain Python.

Written independently of autonomy.t3drm: tangents from angles instead of signed radii, arcs cut at
the intersections of circles instead of at barred bearings, no orientation (a path with a cusp is
feasible and never shortest), Dijkstra over touching points.
"""

import heapq
import itertools
import math

import numpy as np
from numpy.typing import NDArray

Point = tuple[float, float]
Floats = NDArray[np.float64]
TOLERANCE_M = 1e-6


def shortest_length(start: Point, goal: Point, centres: Floats, radii: Floats) -> float | None:
    """Length of the shortest path, None when there is none; start and goal must be free."""
    kept = _without_contained(centres, radii)
    centres, radii = centres[kept], radii[kept]
    graph = _Graph(centres, radii)
    s, g = graph.add_point(start), graph.add_point(goal)
    graph.join(s, g)
    for i in range(len(radii)):
        for point, number in ((start, s), (goal, g)):
            for angle in _from_point(point, centres[i], radii[i]):
                graph.join(number, graph.add_angle(i, angle))
    for i, k in itertools.combinations(range(len(radii)), 2):
        for first, second in _between(centres[i], radii[i], centres[k], radii[k]):
            graph.join(graph.add_angle(i, first), graph.add_angle(k, second))
    graph.add_arcs()
    return graph.dijkstra(s, g)


def _without_contained(centres: Floats, radii: Floats) -> list[int]:
    kept: list[int] = []
    for i in sorted(range(len(radii)), key=lambda k: -radii[k]):
        inside = any(math.dist(centres[i], centres[k]) + radii[i] <= radii[k] + 1e-9 for k in kept)
        if not inside:
            kept.append(i)
    return kept


def _from_point(p: Point, c: Floats, r: float) -> list[float]:
    away = math.dist(p, c)
    half = math.acos(min(1.0, r / away))
    to_p = math.atan2(p[1] - c[1], p[0] - c[0])
    return [to_p + half, to_p - half]


def _between(c1: Floats, r1: float, c2: Floats, r2: float) -> list[tuple[float, float]]:
    d = math.dist(c1, c2)
    line = math.atan2(c2[1] - c1[1], c2[0] - c1[0])
    pairs = []
    if d > abs(r1 - r2):
        half = math.acos((r1 - r2) / d)
        pairs += [(line + half, line + half), (line - half, line - half)]
    if d >= r1 + r2 - 1e-12:
        half = math.acos(min(1.0, (r1 + r2) / d))
        pairs += [(line + half, line + half + math.pi), (line - half, line - half + math.pi)]
    return pairs


class _Graph:
    def __init__(self, centres: Floats, radii: Floats) -> None:
        self.centres, self.radii = centres, radii
        self.places: list[Point] = []
        self.edges: list[list[tuple[int, float]]] = []
        self.angles: list[list[tuple[float, int]]] = [[] for _ in radii]

    def add_point(self, p: Point) -> int:
        self.places.append(p)
        self.edges.append([])
        return len(self.places) - 1

    def add_angle(self, i: int, angle: float) -> int:
        c, r = self.centres[i], self.radii[i]
        number = self.add_point((c[0] + r * math.cos(angle), c[1] + r * math.sin(angle)))
        self.angles[i].append((angle % (2 * math.pi), number))
        return number

    def join(self, a: int, b: int) -> None:
        p, q = np.array(self.places[a]), np.array(self.places[b])
        if self._segment_free(p, q):
            self._connect(a, b, float(math.dist(p, q)))

    def _connect(self, a: int, b: int, cost: float) -> None:
        self.edges[a].append((b, cost))
        self.edges[b].append((a, cost))

    def _segment_free(self, p: Floats, q: Floats) -> bool:
        if len(self.radii) == 0:
            return True
        d = q - p
        length2 = float(d @ d)
        t = np.clip((self.centres - p) @ d / length2, 0, 1) if length2 > 0 else np.zeros(1)
        gaps = np.hypot(*(self.centres - (p + np.outer(t, d))).T)
        return bool((gaps >= self.radii - TOLERANCE_M).all())

    def add_arcs(self) -> None:
        for i, c in enumerate(self.centres):
            for k, other in enumerate(self.centres):
                for angle in _crossings(c, self.radii[i], other, self.radii[k]) if k != i else ():
                    self.add_angle(i, angle)
            ring = sorted(self.angles[i])
            for (a, first), (b, second) in itertools.pairwise([*ring, *ring[:1]]):
                sweep = (b - a) % (2 * math.pi)
                if len(ring) > 1 and self._arc_free(i, a, sweep):
                    self._connect(first, second, float(self.radii[i]) * sweep)
                elif len(ring) > 1 and sweep < 1e-9:
                    self._connect(first, second, 0.0)

    def _arc_free(self, i: int, a: float, sweep: float) -> bool:
        middle = a + 0.5 * sweep
        r = self.radii[i]
        p = self.centres[i] + r * np.array((math.cos(middle), math.sin(middle)))
        gaps = np.hypot(*(self.centres - p).T) - self.radii
        gaps[i] = 0.0
        return bool((gaps >= -TOLERANCE_M).all())

    def dijkstra(self, start: int, goal: int) -> float | None:
        best = {start: 0.0}
        queue = [(0.0, start)]
        while queue:
            cost, at = heapq.heappop(queue)
            if at == goal:
                return cost
            if cost > best[at]:
                continue
            for to, step in self.edges[at]:
                if cost + step < best.get(to, math.inf):
                    best[to] = cost + step
                    heapq.heappush(queue, (cost + step, to))
        return None


def _crossings(c1: Floats, r1: float, c2: Floats, r2: float) -> list[float]:
    """Angles on circle 1 where circle 2 meets it."""
    d = math.dist(c1, c2)
    if not abs(r1 - r2) < d <= r1 + r2:
        return []
    half = math.acos(max(-1.0, min(1.0, (d * d + r1 * r1 - r2 * r2) / (2 * d * r1))))
    line = math.atan2(c2[1] - c1[1], c2[0] - c1[0])
    return [line + half, line - half]
