"""Moving obstacles: hits where it was free a moment ago, tracked as discs with a velocity.

The evidence is "seen free, and hit now": a wall that comes into sight was never seen free, so a
vehicle that moves past standing things has no movers. Each mover is a disc of unknown radius with a
constant velocity, in an extended Kalman filter that every single ray feeds:

    a hit p:            |p - c| - r = 0
    a ray that went by: its distance to c is r at least (used only where it is predicted less)

Rays go to the nearest disc within a chi-square gate. README.md says what was measured.
"""

import math
from collections import deque
from collections.abc import Sequence

import msgspec
import numpy as np
import numpy.typing as npt

from autonomy.geometry import Point
from autonomy.model import MovingObstacle
from autonomy.perception.obstacle_map import ObstacleMap
from autonomy.perception.projection import Ray, RayKind

FloatArray = npt.NDArray[np.float64]


class Surprise(msgspec.Struct, frozen=True):
    """A hit is one where all within `free_m` was seen free in the last `age_s`, and no hit was
    known within `no_hit_m`.
    """

    free_m: float
    no_hit_m: float
    age_s: float


SURPRISES = (Surprise(0.025, 0.05, 2.5), Surprise(0.05, 0.1, 30.0))
"""What was seen a moment ago is known to 2 cm, with the position of then; older, to twice that."""

PASS_S = 1.6
"""Hits younger than this may be the mover's own, from this look or the one before."""

RADIUS_M, RADIUS_SIGMA_M = 0.2, 0.06
RADIUS_RANGE_M = (0.05, 0.35)
ALONG_SIGMA_M, ACROSS_SIGMA_M = 0.08, 0.2
"""Where its centre is behind the first hit: the scan meets a disc at its edge first."""
SPEED_SIGMA_M_S = 0.15
ACCELERATION_M_S2 = 0.07
"""White, per root second: how fast people turn."""
SPEED_MAX_M_S = 0.8
HIT_SIGMA_M = 0.035
PASS_SIGMA_M = 0.06
GATE_CHI2 = 9.0
"""One degree of freedom: 0.3 % of the true ones are refused."""
NEAR_M = 0.1
"""A hit that is no surprise is a disc's only this near to its edge."""
OWN_M = 0.05
"""... and only where no other hit is known within this."""
REACH_M = 0.3
"""A hit farther than this from a disc's surface is not its, however unsure the disc is."""

CONFIRM_HITS = 3
CONFIRM_NEWS = 3
MOVING_NEWS = 5
"""So many of a disc's hits must have been surprises before it is told of, or said to move: the
first is often an edge that the estimate's wandering laid into what was free, and then the scan runs
along what stands behind.
"""
MOVING_SIGMAS = 2.5
MOVING_M_S = 0.04
MOVING_HITS = 6
STANDING_S = 3.0
"""Watched for this long without having moved: it stands."""
FORGET_S = 3.0
"""Not hit for this long: where it is now nobody knows."""
CANDIDATE_S = 1.2
"""A disc that is hit fewer than `CONFIRM_HITS` times within this is noise."""
MISSES_MAX = 4
"""So many rays in a row through a disc's core: it is not there."""
ONE_M = 0.25
"""Two discs with their centres nearer than this are one."""
MARK_S = 0.6
MARK_SPARE_M = 0.06
MARK_ERASE_M = 0.06
"""A mover's hits are taken off the map when they are this old and its disc has left them."""
MARK_NEAR_M = 0.1
MARKS_KEPT = 160

UNREST_S = 5.0
"""What two looks say of a place that was left less than this ago may differ."""
UNREST_EVERY_S = 0.3
UNREST_SPARE_M = 0.15
SECOND_BEAM_S = 2.0
"""Even at 60 deg/s another beam has looked there by then."""
PHANTOMS_MAX = 1
PHANTOM_S = 20.0
"""A beam that alone saw more than so many things lately that no other beam saw is not taken at its
word: only together with another one it sees something move."""


class Unrest(msgspec.Struct, frozen=True):
    """A place where something may be moving; `left`: where it was a moment ago."""

    point: Point
    radius_m: float
    left: bool


class _Track:
    """One disc: (north, east, velocity north, east, radius) and its covariance."""

    def __init__(self, name: int, ray: Ray, hit: Point) -> None:
        c, s = math.cos(ray.bearing_rad), math.sin(ray.bearing_rad)
        self.name = name
        self.state: FloatArray = np.array(
            [hit[0] + RADIUS_M * c, hit[1] + RADIUS_M * s, 0.0, 0.0, RADIUS_M]
        )
        across2 = ACROSS_SIGMA_M * ACROSS_SIGMA_M
        longer2 = ALONG_SIGMA_M * ALONG_SIGMA_M - across2
        self.covariance: FloatArray = np.diag(
            [across2] * 2 + [SPEED_SIGMA_M_S**2] * 2 + [RADIUS_SIGMA_M**2]
        )
        self.covariance[:2, :2] += longer2 * np.array([[c * c, c * s], [c * s, s * s]])
        self.stamp_s = self.born_s = self.hit_s = ray.stamp_s
        self.hits = 1
        self.news = 1
        """Hits where it was free a moment ago."""
        self.misses = 0
        self.moved = False
        self.stands = False
        self.beams = {ray.beam}
        """Those that hit it."""
        self.noted_s = -math.inf
        self.marks: deque[tuple[float, Point]] = deque([(ray.stamp_s, hit)], maxlen=MARKS_KEPT)

    def predict(self, stamp_s: float) -> None:
        """Move on to `stamp_s`; nothing for earlier times."""
        dt_s = stamp_s - self.stamp_s
        if dt_s <= 0.0:
            return
        self.stamp_s = stamp_s
        x, p = self.state, self.covariance
        x[0:2] += dt_s * x[2:4]
        p[0:2] += dt_s * p[2:4]
        p[:, 0:2] += dt_s * p[:, 2:4]
        grown = ACCELERATION_M_S2 * ACCELERATION_M_S2 * dt_s
        p[2, 2] += grown
        p[3, 3] += grown

    def fuse(self, residual_m: float, slope: FloatArray, sigma_m: float) -> bool:
        """One scalar measurement, `residual_m` = measured - predicted; False: outside the gate."""
        spread = self.covariance @ slope
        variance = float(slope @ spread) + sigma_m * sigma_m
        if residual_m * residual_m > GATE_CHI2 * variance:
            return False
        self.state += spread * (residual_m / variance)
        self.covariance -= np.outer(spread, spread / variance)
        self.state[4] = min(RADIUS_RANGE_M[1], max(RADIUS_RANGE_M[0], self.state[4]))
        speed = math.hypot(self.state[2], self.state[3])
        if speed > SPEED_MAX_M_S:
            self.state[2:4] *= SPEED_MAX_M_S / speed
        return True

    def gap_m(self, point: Point) -> float:
        """From a point to the disc's edge, negative inside."""
        n, e, _, _, r = self.state.tolist()
        return math.hypot(point[0] - n, point[1] - e) - float(r)

    def take(self, hit: Point, stamp_s: float, beam: int) -> bool:
        """A hit on the disc's edge; False when it cannot be."""
        n, e, _, _, r = self.state.tolist()
        away_n, away_e = n - hit[0], e - hit[1]
        length = math.hypot(away_n, away_e)
        if length < 1e-6:
            return False
        slope = np.array([away_n / length, away_e / length, 0.0, 0.0, -1.0])
        if not self.fuse(r - length, slope, HIT_SIGMA_M):
            return False
        self.hits += 1
        self.hit_s = stamp_s
        self.beams.add(beam)
        self.misses = 0
        self.marks.append((stamp_s, hit))
        return True

    def passed(self, ray: Ray) -> None:
        """A ray that went on behind the disc did not meet it."""
        n, e, _, _, r = self.state.tolist()
        c, s = math.cos(ray.bearing_rad), math.sin(ray.bearing_rad)
        dn, de = n - ray.origin_ned_m[0], e - ray.origin_ned_m[1]
        along, across = dn * c + de * s, de * c - dn * s
        if along < 0.0 or abs(across) >= r:
            return
        spare_m = 0.5 * r if ray.kind is RayKind.FREE else 0.0
        if abs(across) < 0.5 * r and ray.length_m > along - spare_m:
            self.misses += 1
        if along > ray.length_m:
            return
        side = math.copysign(1.0, across)
        slope = np.array([-s * side, c * side, 0.0, 0.0, -1.0])
        self.fuse(r - abs(across), slope, PASS_SIGMA_M)

    def judge(self) -> None:
        """Told apart: it has moved for sure, or it was watched and did not."""
        _, _, vn, ve, _ = self.state.tolist()
        speed = math.hypot(vn, ve)
        sigma = self.speed_sigma_m_s
        enough = self.hits >= MOVING_HITS and self.news >= MOVING_NEWS
        if enough and speed > max(MOVING_M_S, MOVING_SIGMAS * sigma):
            self.moved, self.stands = True, False
        elif self.hit_s - self.born_s > STANDING_S and speed + sigma < 2.0 * MOVING_M_S:
            self.moved, self.stands = False, True

    @property
    def confirmed(self) -> bool:
        """Hit often enough to be something, and often enough where it was free to be new."""
        return self.hits >= CONFIRM_HITS and self.news >= CONFIRM_NEWS

    @property
    def speed_sigma_m_s(self) -> float:
        """One sigma of each component of the velocity."""
        return math.sqrt(max(0.0, 0.5 * float(self.covariance[2, 2] + self.covariance[3, 3])))

    def obstacle(self, now_s: float) -> MovingObstacle:
        """What others may know of it."""
        n, e, vn, ve, r = self.state.tolist()
        dt_s = now_s - self.stamp_s
        p = self.covariance
        return MovingObstacle(
            name=self.name,
            point=(n + vn * dt_s, e + ve * dt_s),
            velocity_ne_m_s=(vn, ve),
            radius_m=r,
            sigma_m=math.sqrt(max(0.0, 0.5 * float(p[0, 0] + p[1, 1]))),
            speed_sigma_m_s=self.speed_sigma_m_s,
            seen_s=self.hit_s,
            moving=self.moved,
        )


class MoverTracker:
    """Keeps the movers near the vehicle. Deterministic: the same rays, the same movers."""

    def __init__(self) -> None:
        self._tracks: list[_Track] = []
        self._count = 0
        self._first_hit_s: dict[tuple[int, int], float] = {}
        self._left: deque[tuple[float, Point, float]] = deque(maxlen=96)
        self._phantoms: deque[tuple[float, int]] = deque(maxlen=16)
        self.moved_s = -math.inf
        """When something was last known to move."""
        self.new_s = -math.inf
        """When something was last there, or moved, that was not there before."""

    def obstacles(self, now_s: float) -> tuple[MovingObstacle, ...]:
        """What is new and not known to stand, and what moves, where it is at `now_s`."""
        return tuple(track.obstacle(now_s) for track in self._tracks if self._is_told(track, now_s))

    def unrest(self, now_s: float) -> tuple[Unrest, ...]:
        """Where sound beams may contradict each other: what is new or moves, and where it was."""
        there = [
            Unrest(_place(track), float(track.state[4]) + UNREST_SPARE_M, left=False)
            for track in self._tracks
            if not track.stands and self._is_believed(track, now_s)
        ]
        while self._left and now_s - self._left[0][0] > UNREST_S:
            self._left.popleft()
        return (*there, *(Unrest(point, radius_m, left=True) for _, point, radius_m in self._left))

    def _is_told(self, track: _Track, now_s: float) -> bool:
        """True for what is new or moves, for sure enough that others are to know."""
        return track.confirmed and not track.stands and self._is_believed(track, now_s)

    def _is_believed(self, track: _Track, now_s: float) -> bool:
        """False for what one beam alone saw: for long, or after it saw other things lately that
        nobody else did.
        """
        if len(track.beams) > 1:
            return True
        if now_s - track.born_s > SECOND_BEAM_S:
            return False
        seen = sum(
            beam in track.beams and now_s - stamp_s < PHANTOM_S for stamp_s, beam in self._phantoms
        )
        return seen <= PHANTOMS_MAX

    def forget(self) -> None:
        """The vehicle is elsewhere (another height): nothing is tracked any more."""
        self._tracks.clear()
        self._first_hit_s.clear()
        self._left.clear()

    def step(self, now_s: float, rays: Sequence[Ray], known: ObstacleMap) -> None:
        """Take in the rays of this tick, before `known` does; takes ghosts off the map."""
        for ray in rays:
            if ray.kind is RayKind.NOTHING:
                continue
            for track in self._tracks:
                track.predict(ray.stamp_s)
            if ray.kind is RayKind.HIT:
                self._hit(ray, known)
            self._passes(ray)
        if self._tracks:
            self._tidy(now_s, known)

    def _hit(self, ray: Ray, known: ObstacleMap) -> None:
        hit = (
            ray.origin_ned_m[0] + ray.length_m * math.cos(ray.bearing_rad),
            ray.origin_ned_m[1] + ray.length_m * math.sin(ray.bearing_rad),
        )
        self._note(hit, ray.stamp_s, known)
        near = [(abs(track.gap_m(hit)), track.name, track) for track in self._tracks]
        surprising: bool | None = None
        for gap_m, _, track in sorted(near, key=lambda entry: entry[:2]):
            if gap_m > REACH_M:
                break
            if gap_m > HIT_SIGMA_M * 2.0 or not _marked(track, hit):
                # Beyond what was hit before it must be news: a wall behind is not the mover.
                surprising = self._is_surprising(hit, ray.stamp_s, known)
                if not surprising and (
                    gap_m > NEAR_M or self._was_known(hit, OWN_M, ray.stamp_s, known)
                ):
                    continue
            if track.take(hit, ray.stamp_s, ray.beam):
                if track.news < MOVING_NEWS:
                    if surprising is None:
                        surprising = self._is_surprising(hit, ray.stamp_s, known)
                    track.news += surprising
                return
        if surprising is None:
            surprising = self._is_surprising(hit, ray.stamp_s, known)
        if surprising:
            self._count += 1
            self._tracks.append(_Track(self._count, ray, hit))

    def _note(self, hit: Point, stamp_s: float, known: ObstacleMap) -> None:
        """Remember since when a cell is known to be hit."""
        cell = _unmoved(known.cell(hit), known)
        if cell not in self._first_hit_s or not known.hit_cells_within(hit, 0.0):
            self._first_hit_s[cell] = stamp_s

    def _was_known(self, hit: Point, radius_m: float, stamp_s: float, known: ObstacleMap) -> bool:
        """True when something was hit near there before this look and the one before."""
        return any(
            self._first_hit_s.get(_unmoved(cell, known), math.inf) <= stamp_s - PASS_S
            for cell in known.hit_cells_within(hit, radius_m)
        )

    def _is_surprising(self, hit: Point, stamp_s: float, known: ObstacleMap) -> bool:
        """True for a hit where it was free."""
        return any(
            known.was_free(hit, s.free_m, s.age_s)
            and not self._was_known(hit, s.no_hit_m, stamp_s, known)
            for s in SURPRISES
        )

    def _passes(self, ray: Ray) -> None:
        for track in self._tracks:
            if track.hit_s < ray.stamp_s:
                track.passed(ray)

    def _remember(self, track: _Track, now_s: float, *, lost: bool) -> None:
        """Note where it is now and then, and who alone saw what is not there."""
        if lost and track.hits >= CONFIRM_HITS and len(track.beams) == 1:
            self._phantoms.append((now_s, min(track.beams)))
        if track.moved and len(track.beams) > 1 and now_s - track.noted_s >= UNREST_EVERY_S:
            track.noted_s = now_s
            self._left.append((now_s, _place(track), float(track.state[4]) + UNREST_SPARE_M))

    def _tidy(self, now_s: float, known: ObstacleMap) -> None:
        """Judge, drop what is lost or double, and take off the map what movers left behind."""
        kept: list[_Track] = []
        for track in sorted(self._tracks, key=_precedence):
            track.judge()
            if track.moved:
                self.moved_s = now_s
            if self._is_told(track, now_s):
                self.new_s = now_s
            lost = now_s - track.hit_s > FORGET_S or track.misses >= MISSES_MAX
            self._remember(track, now_s, lost=lost)
            lost = lost or (track.hits < CONFIRM_HITS and now_s - track.hit_s > CANDIDATE_S)
            place = _place(track)
            double = any(math.dist(place, other.state[:2]) < ONE_M for other in kept)
            if not lost and not double:
                kept.append(track)
            elif track.moved and lost:
                _erase(track, known, None)
            if track.moved and not lost:
                _erase(track, known, now_s)
        self._tracks = kept


def _unmoved(cell: tuple[int, int], known: ObstacleMap) -> tuple[int, int]:
    """The name of a cell that stays the same when the map moves its content."""
    return (cell[0] - known.moved_cells[0], cell[1] - known.moved_cells[1])


def _place(track: _Track) -> Point:
    return (float(track.state[0]), float(track.state[1]))


def _precedence(track: _Track) -> tuple[bool, float, int]:
    """Of two that are one the first stays: what is confirmed, then what was hit last.

    A hit that the gate refused begins a new disc beside a known mover: without a velocity, and
    it is not yet told to anybody.
    """
    return not track.confirmed, -track.hit_s, track.name


def _marked(track: _Track, hit: Point) -> bool:
    """True when the track was hit near there lately."""
    return any(math.dist(hit, mark) < MARK_NEAR_M for _, mark in track.marks)


def _erase(track: _Track, known: ObstacleMap, now_s: float | None) -> None:
    """Take the track's old hits off the map; all of them when `now_s` is None."""
    while track.marks:
        stamp_s, mark = track.marks[0]
        if now_s is not None and (now_s - stamp_s < MARK_S or track.gap_m(mark) < MARK_SPARE_M):
            return
        track.marks.popleft()
        known.forget_within(mark, MARK_ERASE_M, MARK_ERASE_M)


__all__ = ["MoverTracker", "MovingObstacle", "Unrest"]
