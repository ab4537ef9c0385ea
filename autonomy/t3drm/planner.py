"""One planning step of T3DRM: start, goal and known hits in, a Plan or NoPlan out.

For each radius of the Ricci flow from the comfortable keep-out to the hard floor (Eq. 2): the
straight line when it is free; else classify, put spheres around discrete obstacles and take the
hits of continuous ones as they are, find the exact shortest tangent path, fly past continuous
obstacles on conics; where that does not decide, the geodesic on the grid. The cheapest level wins.
"""

import math
from collections.abc import Callable
from enum import StrEnum

import msgspec
import numpy as np

from autonomy.config import PlannerConfig
from autonomy.geometry import Point, distance, polyline_length
from autonomy.model import Leg, LegKind, NoPlan, Plan
from autonomy.t3drm import kernels, ricci
from autonomy.t3drm.geodesic import Closed, closing_hits, geodesic
from autonomy.t3drm.hyperbolic import FlyBy, fly_by, inside_hull
from autonomy.t3drm.kernels import Floats, Ints, Mask
from autonomy.t3drm.known_map import KnownMap, Level
from autonomy.t3drm.spherical import (
    ACTIVE_MAX,
    NO_PLANES,
    NO_SEEDS,
    Arc,
    Discs,
    NoRoute,
    NoRouteReason,
    Route,
    Segment,
    fence_planes,
    route_among,
    shortest_path,
)
from hal.config import Fence

SPHERE_MAX_RATIO = 1.03
"""A path round the spheres of discrete obstacles may be this much longer than the one round their
single hits. A sphere guesses the unseen back of a pillar; round a plank it only costs way."""
CAREFUL, CARELESS = 1, 0
ARC_SAGITTA_M = 5e-4
EXIT_MARGIN_M = 0.05
"""How much farther than one keep-out radius the way out of a keep-out may be."""


class Violation(msgspec.Struct, frozen=True):
    """The first place where a hit is too near to a path."""

    segment: int
    distance_m: float
    """Along the path from its beginning."""
    hit: Point


class Failure(StrEnum):
    """Why a level has no path."""

    BOXED_IN = "the way out of the keep-out around the start is barred"
    GOAL_BLOCKED = "the goal lies inside the keep-out of an obstacle"
    CLOSED = "obstacles close every way to the goal"
    BEATEN = "no path at this level is cheaper than the best of another"


class Scene(msgspec.Struct, frozen=True):
    """What does not depend on the level."""

    start: Point
    goal: Point
    known: KnownMap
    tolerance_m: float

    @property
    def hits(self) -> Floats:
        """(n, 2) rows (north, east)."""
        return self.known.hits


class NoWay(msgspec.Struct, frozen=True):
    """There is no path; finding out why, in hits, takes as long as finding that out."""

    reason: str
    tell: Callable[[], NoPlan]
    """What is to be told of it, from the hits that were asked about."""


class Rung(msgspec.Struct, frozen=True):
    """One level of the flow in one question, with what the levels before it have shown."""

    keep_out_m: float
    factor: float
    """What the length costs at this level."""
    limit_m: float = math.inf
    """A path that is not shorter than this costs more than the best one so far."""
    seeds: Ints = NO_SEEDS
    """The hits that decided the level before: they save rounds."""


class Candidate(msgspec.Struct, frozen=True):
    """A path at one level."""

    legs: tuple[Leg, ...]
    keep_out_m: float
    cost_m: float
    rejected: tuple[tuple[Point, ...], ...] = ()
    decided_by: Ints = NO_SEEDS


class Inner(msgspec.Struct, frozen=True):
    """Legs from a free start to a free goal, the candidates that they replaced, and the hits that
    decided them.
    """

    legs: tuple[Leg, ...]
    rejected: tuple[tuple[Point, ...], ...] = ()
    decided_by: Ints = NO_SEEDS


def violated(points: Floats, hits: Floats, keep_out_m: float) -> Violation | None:
    """The first place where the polyline (k, 2) is nearer than `keep_out_m` to one of hits (n, 2).

    A hit that is nearer than that to the path's beginning counts only where the path comes nearer
    still: leaving a keep-out is no violation. None when the path is free. Compiled; both arrays
    float64, C order.
    """
    if points.shape[0] < 2 or hits.shape[0] == 0:
        return None
    # A copy for the same reason as in `Planner.plan`: the map hands out read-only arrays.
    segment, along, who = kernels.first_violation(points, np.array(hits), keep_out_m)
    if segment < 0:
        return None
    return Violation(int(segment), float(along), (float(hits[who, 0]), float(hits[who, 1])))


class Planner:
    """Plans in the horizontal plane for a vehicle of the given radius inside the fence.

    The same arguments give the same plan, bit for bit, whatever was asked before. What is found
    out about the hits alone is kept until others come: a second plan on the same map is quicker.
    """

    def __init__(self, config: PlannerConfig, body_radius_m: float, fence: Fence) -> None:
        self.config = config
        self.fence = fence
        self.keep_outs_m = ricci.levels(
            body_radius_m + config.comfortable_clearance_m,
            body_radius_m + config.hard_clearance_m,
            config.levels,
        )
        self._polygon = np.array(fence.outline_ne_m, dtype=np.float64)
        planes = fence_planes(fence.outline_ne_m)
        self._convex = planes is not None
        self._planes = NO_PLANES if planes is None else planes
        self._sides = np.empty((0, 2)) if self._convex else self._polygon
        self._known: KnownMap | None = None

    def plan(
        self, start: Point, goal: Point, hits: Floats, tolerance_m: float = 0.0
    ) -> Plan | NoPlan:
        """A path from start to goal, or NoPlan with the hits that bar the way.

        hits: (n, 2) float64 rows (north, east). Every leg keeps its `keep_out_m` (less 1 mm) from
        every hit and stays inside the fence; only a first leg out of a keep-out that already holds
        the start keeps less, and says how much. A goal inside a keep-out is replaced by the
        nearest free place within `tolerance_m` of it.
        """
        found = self.seek(start, goal, hits, tolerance_m)
        return found.tell() if isinstance(found, NoWay) else found

    def seek(
        self, start: Point, goal: Point, hits: Floats, tolerance_m: float = 0.0
    ) -> Plan | NoWay:
        """As `plan`, for who may not need to know what bars the way."""
        scene = Scene(start, goal, self._known_map(hits), tolerance_m)
        if self.fence.inside_distance_m(*goal) < 0.0:
            return self._no_way(scene, "the goal lies outside the fence", None)
        best: Candidate | None = None
        rejected: list[tuple[Point, ...]] = []
        failure = Failure.CLOSED
        for number, keep_out in enumerate(self.keep_outs_m):
            factor = self.config.level_penalty**number
            least = max(0.0, distance(start, goal) - tolerance_m)
            if best is not None and best.cost_m <= factor * least:
                break
            limit = math.inf if best is None else best.cost_m / factor
            seeds = NO_SEEDS if best is None else best.decided_by
            found = self._solve(scene, Rung(keep_out, factor, limit, seeds))
            if isinstance(found, Failure):
                failure = found
                continue
            loser = found if best is not None and best.cost_m <= found.cost_m else best
            best = best if loser is found else found
            if loser is not None:
                rejected.append(_join(loser.legs))
        if best is None:
            return self._no_way(scene, failure.value, failure)
        return self._as_plan(scene, best, tuple(rejected))

    # ------------------------------------------------------------ one level

    def _known_map(self, hits: Floats) -> KnownMap:
        """What is known about these hits; made anew when they are others than before."""
        if self._known is None or not self._known.is_of(hits):
            self._known = KnownMap(hits, self.config)
        return self._known

    def forget(self) -> None:
        """Let go of what was found out about the last map; the next plan begins cold."""
        self._known = None

    def _solve(self, scene: Scene, rung: Rung) -> Candidate | Failure:
        """The path at one level; its cost is its length times the level's factor."""
        keep_out = rung.keep_out_m
        start = self._departure(scene, keep_out)
        if start is None:
            return Failure.BOXED_IN
        goal = self._arrival(scene, keep_out)
        if goal is None:
            return Failure.GOAL_BLOCKED
        out_m = distance(scene.start, start)
        inner = self._between(
            scene, msgspec.structs.replace(rung, limit_m=rung.limit_m - out_m), start, goal
        )
        if isinstance(inner, Failure):
            return inner
        legs = inner.legs
        if start != scene.start:
            out = (scene.start, start)
            kept = min(keep_out, scene.known.nearest_m(scene.start))
            legs = (Leg(LegKind.STRAIGHT, out, out_m, kept), *legs)
        cost = rung.factor * sum(leg.length_m for leg in legs)
        return Candidate(legs, keep_out, cost, inner.rejected, inner.decided_by)

    def _departure(self, scene: Scene, keep_out_m: float) -> Point | None:
        """Where planning begins: the start, or the nearest free place when it is in a keep-out."""
        start = scene.start
        if self.fence.inside_distance_m(*start) < 0.0:
            start = self._pulled_inside(start)
        if scene.known.is_clear(start, keep_out_m):
            return start
        within = keep_out_m + EXIT_MARGIN_M
        found, north, east = kernels.nearest_exit(
            scene.hits, scene.known.squares, keep_out_m, *start, within, CAREFUL
        )
        inside = found and self.fence.inside_distance_m(north, east) >= 0.0
        return (north, east) if inside else None

    def _arrival(self, scene: Scene, keep_out_m: float) -> Point | None:
        goal = scene.goal
        if scene.known.is_clear(goal, keep_out_m):
            return goal
        found, north, east = kernels.nearest_exit(
            scene.hits, scene.known.squares, keep_out_m, *goal, scene.tolerance_m, CARELESS
        )
        inside = found and self.fence.inside_distance_m(north, east) >= 0.0
        return (north, east) if inside else None

    def _pulled_inside(self, point: Point) -> Point:
        """The nearest place 1 mm inside the fence."""
        ring = self.fence.outline_ne_m
        best, nearest = point, math.inf
        for a, b in zip(ring, ring[1:] + ring[:1], strict=True):
            length = distance(a, b)
            if length < 2.0 * kernels.SLACK_M:
                continue
            tn, te = (b[0] - a[0]) / length, (b[1] - a[1]) / length
            at = (point[0] - a[0]) * tn + (point[1] - a[1]) * te
            at = min(length - kernels.SLACK_M, max(kernels.SLACK_M, at))
            for side in (kernels.SLACK_M, -kernels.SLACK_M):
                inside = (a[0] + at * tn - side * te, a[1] + at * te + side * tn)
                if self.fence.inside_distance_m(*inside) > 0.0:
                    away = distance(point, inside)
                    best, nearest = (inside, away) if away < nearest else (best, nearest)
        return best

    def _between(self, scene: Scene, rung: Rung, start: Point, goal: Point) -> Inner | Failure:
        """Legs from a free start to a free goal."""
        keep_out = rung.keep_out_m
        clear = keep_out - kernels.TOUCH_M
        if kernels.in_sight(scene.hits, scene.known.squares, clear, self._sides, *start, *goal):
            return Inner((Leg(LegKind.STRAIGHT, (start, goal), distance(start, goal), keep_out),))
        level = scene.known.level(keep_out)
        route, discs = self._tangent_route(scene, rung, level, start, goal)
        if isinstance(route, Route):
            decided_by = _hits_among(route.active, discs, scene)
            tangents = _tangent_legs(route.pieces, keep_out)
            legs = self._fly_past(scene, level, route, discs)
            if legs != tangents and self._is_sound(scene, keep_out, legs):
                return Inner(legs, (_join(tangents),), decided_by)
            if self._is_sound(scene, keep_out, tangents):
                return Inner(tangents, (), decided_by)
        elif route.reason is NoRouteReason.CLOSED:
            # Proven by the discs themselves; the fence could only close more.
            return Failure.CLOSED
        elif route.reason is NoRouteReason.BEATEN:
            return Failure.BEATEN
        return self._over_the_grid(scene, rung, start, goal)

    def _is_sound(self, scene: Scene, keep_out_m: float, legs: tuple[Leg, ...]) -> bool:
        """The exact check of every path against all hits and the fence."""
        return self._is_free(scene, keep_out_m, np.array(_join(legs)))

    def _is_free(self, scene: Scene, keep_out_m: float, path: Floats) -> bool:
        return bool(
            kernels.path_is_free(
                path, scene.hits, scene.known.squares, keep_out_m - kernels.SLACK_M
            )
            and kernels.path_is_inside(path, self._polygon, self._sides)
        )

    # ------------------------------------------------------------ spherical navigation

    def _tangent_route(
        self, scene: Scene, rung: Rung, level: Level, start: Point, goal: Point
    ) -> tuple[Route | NoRoute, Discs]:
        """Round the spheres where they fit and cost little, else round every single hit."""
        spheres = _spheres_outside(level, start, goal)
        wide: Route | NoRoute | None = None
        if spheres.any():
            wide_discs = scene.known.discs(level.keep_out_m, spheres)
            wide = self._route_among(wide_discs, start, goal)
            if isinstance(wide, Route) and wide.length_m <= SPHERE_MAX_RATIO * distance(
                start, goal
            ):
                return wide, wide_discs
        exact_discs = scene.known.discs(level.keep_out_m, _NO_SPHERE)
        exact = self._route_among(exact_discs, start, goal, rung.seeds, rung.limit_m)
        if wide is None or _proves_defeat(exact):
            return exact, exact_discs
        keeps_spheres = isinstance(wide, Route) and (
            isinstance(exact, NoRoute) or wide.length_m <= SPHERE_MAX_RATIO * exact.length_m
        )
        return (wide, wide_discs) if keeps_spheres else (exact, exact_discs)

    def _route_among(
        self,
        discs: Discs,
        start: Point,
        goal: Point,
        seeds: Ints = NO_SEEDS,
        limit_m: float = math.inf,
    ) -> Route | NoRoute:
        most = self.config.tangent_discs_max
        return route_among(start, goal, discs, self._planes, most, seeds, limit_m)

    # ------------------------------------------------------------ hyperbolic navigation

    def _fly_past(self, scene: Scene, level: Level, route: Route, discs: Discs) -> tuple[Leg, ...]:
        """The route's legs, with conics for tangent-arc-tangent where that is wanted and free."""
        pieces = route.pieces
        if self.config.hyperbola == "never":
            return _tangent_legs(pieces, level.keep_out_m)
        legs: list[Leg] = []
        done = 0  # pieces before this one are in `legs`
        at = pieces[0].start
        for first, last in _turns(pieces, discs, level):
            if first - 1 < done - 1:
                continue
            begin = pieces[0].start if first == 1 else _middle(pieces[first - 1])
            end = pieces[-1].end if last == len(pieces) - 2 else _middle(pieces[last + 1])
            conic = self._conic(scene, level, discs, pieces[first : last + 1], begin, end)
            replaced = _partial(pieces, first, last, begin, end)
            if conic is None or not self._wanted(conic, replaced):
                continue
            legs.extend(_tangent_legs(_cut(pieces, done, first, at, begin), level.keep_out_m))
            legs.append(Leg(LegKind.HYPERBOLA, conic.points, conic.length_m, level.keep_out_m))
            done, at = last + 1, end
        if done == 0:
            return _tangent_legs(pieces, level.keep_out_m)
        if at != pieces[-1].end:
            legs.extend(
                _tangent_legs(_cut(pieces, done, len(pieces), at, pieces[-1].end), level.keep_out_m)
            )
        return tuple(legs)

    def _wanted(self, conic: FlyBy, replaced_m: float) -> bool:
        if self.config.hyperbola == "prefer":
            return True
        return conic.length_m <= self.config.hyperbola_max_ratio * replaced_m

    def _conic(
        self,
        scene: Scene,
        level: Level,
        discs: Discs,
        turn: tuple[Segment | Arc, ...],
        begin: Point,
        end: Point,
    ) -> FlyBy | None:
        """The fly-by from begin to end past the turn's support vertices, free of all hits."""
        arcs = [piece for piece in turn if isinstance(piece, Arc)]
        corners = level.outlines.hull_of(int(discs.labels[arcs[0].disc]))
        hull = tuple((n, e) for n, e in scene.hits[corners].tolist())
        if inside_hull(scene.start, hull) or inside_hull(scene.goal, hull):
            return None
        for arc in sorted(arcs, key=lambda a: -abs(a.sweep_rad))[:2]:
            sense = 1 if arc.sweep_rad > 0.0 else -1
            conic = fly_by(begin, end, arc.centre, level.keep_out_m, sense)
            if conic is None:
                continue
            if self._is_free(scene, level.keep_out_m, np.array(conic.points)):
                return conic
        return None

    # ------------------------------------------------------------ the geodesic

    def _over_the_grid(
        self, scene: Scene, rung: Rung, start: Point, goal: Point
    ) -> Inner | Failure:
        """The geodesic; where its cells see no way, finer ones and at last all discs decide."""
        keep_out = rung.keep_out_m
        for cell in (self.config.grid_cell_m, 0.5 * self.config.grid_cell_m):
            found = geodesic(
                start, goal, scene.hits, keep_out, self._polygon, cell, convex=self._convex
            )
            if not isinstance(found, Closed):
                length = polyline_length(found.points)
                return Inner((Leg(LegKind.GEODESIC, found.points, length, keep_out),))
        discs = scene.known.discs(keep_out, _NO_SPHERE)
        route = route_among(start, goal, discs, self._planes, ACTIVE_MAX)
        if isinstance(route, Route):
            legs = _tangent_legs(route.pieces, keep_out)
            if self._is_sound(scene, keep_out, legs):
                return Inner(legs)
        return Failure.CLOSED

    # ------------------------------------------------------------ results

    def _as_plan(
        self, scene: Scene, best: Candidate, rejected: tuple[tuple[Point, ...], ...]
    ) -> Plan:
        return Plan(
            legs=best.legs,
            length_m=sum(leg.length_m for leg in best.legs),
            keep_out_m=best.keep_out_m,
            environment=scene.known.level(best.keep_out_m).outlines.environment,
            obstacles=scene.known.obstacles(best.keep_out_m),
            rejected=best.rejected + rejected,
        )

    def _no_way(self, scene: Scene, reason: str, failure: Failure | None) -> NoWay:
        def tell() -> NoPlan:
            evidence = () if failure is None else self._evidence(scene, failure)
            return self._no_plan(scene, reason, evidence)

        return NoWay(reason, tell)

    def _no_plan(self, scene: Scene, reason: str, evidence: tuple[Point, ...]) -> NoPlan:
        keep_out = self.keep_outs_m[-1]
        return NoPlan(
            reason=reason,
            evidence=evidence,
            environment=scene.known.level(keep_out).outlines.environment,
            obstacles=scene.known.obstacles(keep_out),
        )

    def _evidence(self, scene: Scene, failure: Failure) -> tuple[Point, ...]:
        keep_out = self.keep_outs_m[-1]
        if failure is Failure.CLOSED:
            chosen = closing_hits(
                scene.start,
                scene.goal,
                scene.hits,
                keep_out,
                self._polygon,
                self.config.grid_cell_m,
                convex=self._convex,
            )
            return tuple((n, e) for n, e in scene.hits[list(chosen)].tolist())
        centre = scene.start if failure is Failure.BOXED_IN else scene.goal
        away = np.hypot(scene.hits[:, 0] - centre[0], scene.hits[:, 1] - centre[1])
        near = scene.hits[away < 2.0 * keep_out]
        return tuple((n, e) for n, e in near.tolist())


_NO_SPHERE: Mask = np.zeros(1, dtype=np.uint8)


def _spheres_outside(level: Level, start: Point, goal: Point) -> Mask:
    """1 for every component that a sphere stands for which holds neither start nor goal."""
    chosen = np.flatnonzero(level.spheres)
    if chosen.shape[0] == 0:
        return _NO_SPHERE
    rows = level.outlines.rows[chosen]
    spheres = np.zeros_like(level.spheres)
    away = np.minimum(
        np.hypot(rows[:, 0] - start[0], rows[:, 1] - start[1]),
        np.hypot(rows[:, 0] - goal[0], rows[:, 1] - goal[1]),
    )
    spheres[chosen] = away > rows[:, 2] + level.keep_out_m
    return spheres


def _proves_defeat(route: Route | NoRoute) -> bool:
    """True when the single hits alone show that the level cannot win: spheres only add to them."""
    return isinstance(route, NoRoute) and route.reason in (
        NoRouteReason.BEATEN,
        NoRouteReason.CLOSED,
    )


def _hits_among(active: tuple[int, ...], discs: Discs, scene: Scene) -> Ints:
    """The hits that decided a route; none where spheres did."""
    if discs.centres.shape[0] != scene.hits.shape[0]:
        return NO_SEEDS
    return np.array(active, dtype=np.int64)


def _join(legs: tuple[Leg, ...]) -> tuple[Point, ...]:
    points = list(legs[0].points)
    for leg in legs[1:]:
        points.extend(leg.points[1:])
    return tuple(points)


def _tangent_legs(pieces: tuple[Segment | Arc, ...], keep_out_m: float) -> tuple[Leg, ...]:
    legs = []
    for piece in pieces:
        if isinstance(piece, Arc):
            points = piece.polyline(ARC_SAGITTA_M)
            legs.append(Leg(LegKind.ARC, points, polyline_length(points), keep_out_m))
        elif piece.length_m > 0.0:
            ends = (piece.start, piece.end)
            legs.append(Leg(LegKind.TANGENT, ends, piece.length_m, keep_out_m))
    return tuple(legs)


def _middle(piece: Segment | Arc) -> Point:
    return (0.5 * (piece.start[0] + piece.end[0]), 0.5 * (piece.start[1] + piece.end[1]))


def _turns(
    pieces: tuple[Segment | Arc, ...], discs: Discs, level: Level
) -> tuple[tuple[int, int], ...]:
    """(first, last) arc of every run of arcs round one continuous obstacle in one sense."""
    runs: list[tuple[int, int]] = []
    before: tuple[int, bool] | None = None
    for k, piece in enumerate(pieces):
        if not isinstance(piece, Arc):
            continue
        label = int(discs.labels[piece.disc])
        turn = (label, piece.sweep_rad > 0.0)
        if level.outlines.discrete[label]:
            before = None
        elif turn == before:
            runs[-1] = (runs[-1][0], k)
        else:
            runs.append((k, k))
            before = turn
    return tuple(runs)


def _cut(
    pieces: tuple[Segment | Arc, ...], first: int, last: int, begin: Point, end: Point
) -> tuple[Segment | Arc, ...]:
    """pieces[first:last], its first segment beginning at `begin`, its last one ending at `end`."""
    chosen = list(pieces[first:last])
    if chosen and isinstance(chosen[0], Segment):
        chosen[0] = Segment(begin, chosen[0].end)
    if chosen and isinstance(chosen[-1], Segment):
        chosen[-1] = Segment(chosen[-1].start, end)
    return tuple(chosen)


def _partial(
    pieces: tuple[Segment | Arc, ...], first: int, last: int, begin: Point, end: Point
) -> float:
    """Length of the pieces from `begin` on the segment before `first` to `end` after `last`."""
    inner = sum(piece.length_m for piece in pieces[first : last + 1])
    return distance(begin, pieces[first].start) + inner + distance(pieces[last].end, end)


def warm_up() -> None:
    """Compile (or load) every kernel with the types used in flight: nothing compiles in the air."""
    planner = Planner(PlannerConfig(), 0.15, Fence.rectangle((-2.0, 6.0), (-3.0, 3.0)))
    wall = np.array([(2.0, -1.0 + 0.05 * k) for k in range(41)])
    plan = planner.plan((0.0, 0.0), (4.0, 0.1), wall)
    violated(np.array(plan.points if isinstance(plan, Plan) else ()), wall, 0.2)
    planner.plan((1.9, 0.0), (4.0, 0.1), wall)
    planner.plan((0.0, 0.0), (4.0, 0.1), np.array([(2.0, 0.0), (2.05, 0.02)]))
    turn = np.linspace(0.0, 2.0 * math.pi, 60)
    ring = np.stack((4.0 + 0.6 * np.cos(turn), 0.6 * np.sin(turn)), axis=1)
    planner.plan((0.0, 0.0), (4.0, 0.1), ring)
    bent = Fence(polygon_ne_m=((-2, -3), (6, -3), (6, 3), (2, 0), (-2, 3)))
    polygon = np.array(bent.outline_ne_m)
    for convex in (True, False):
        geodesic((0.0, -2.0), (4.0, 0.9), wall, 0.2, polygon, 0.1, convex=convex)
    shortest_path((0.0, 0.0), (4.0, 0.1), wall, np.full(wall.shape[0], 0.2))
    Discs.of(wall, np.full(wall.shape[0], 0.2))
    # No wall for a warm-up has enough hits for the tree of boxes: it is asked itself.
    kernels.boxed_tree(wall)
    kernels.windings(polygon, wall)
    kernels.mark_near(polygon, wall, 0.2, np.zeros(wall.shape[0], dtype=np.uint8))
    kernels.exposed_arcs(wall, 0.2, polygon)
    kernels.path_clearance(polygon, wall)
