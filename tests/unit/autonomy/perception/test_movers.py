import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from autonomy.config import MapConfig
from autonomy.geometry import Point
from autonomy.model import MovingObstacle
from autonomy.perception.movers import FORGET_S, MoverTracker
from autonomy.perception.obstacle_map import ObstacleMap
from autonomy.perception.projection import Ray, RayKind
from hal.config import Fence

TICK_S = 0.05
REACH_M = 1.0
TURN_RAD_S = math.radians(100.0)


class Stage:
    """A vehicle that turns at the origin, and discs around it that may move; no noise."""

    def __init__(self, *discs: tuple[Point, Point, float]) -> None:
        self.discs = discs
        self.map = ObstacleMap(MapConfig(), 0.15, Fence.rectangle((-3.0, 3.0), (-3.0, 3.0)))
        self.tracker = MoverTracker()
        self.now_s = 0.0
        self.origin = (0.0, 0.0)
        """Where the vehicle is in the map's frame; the discs keep their places around it."""
        self.lies: dict[int, float] = {}
        """Beams that hit something at one distance everywhere."""

    def place(self, number: int) -> Point:
        (n, e), (vn, ve), _ = self.discs[number]
        moved_s = max(0.0, self.now_s - 2.0)
        return (n + vn * moved_s, e + ve * moved_s)

    def run(self, seconds: float) -> tuple[MovingObstacle, ...]:
        """For the first two seconds of all nothing moves: the vehicle looks round."""
        for _ in range(round(seconds / TICK_S)):
            self.now_s += TICK_S
            rays = [self._ray(beam) for beam in range(4)]
            self.tracker.step(self.now_s, rays, self.map)
            self.map.update(self.now_s, rays)
        return self.tracker.obstacles(self.now_s)

    def _ray(self, beam: int) -> Ray:
        bearing = TURN_RAD_S * self.now_s + beam * math.pi / 2.0
        c, s = math.cos(bearing), math.sin(bearing)
        length, kind = REACH_M, RayKind.FREE
        if beam in self.lies:
            length, kind = self.lies[beam], RayKind.HIT
        for number, (_, _, radius) in enumerate(self.discs):
            n, e = self.place(number)
            along, across = n * c + e * s, e * c - n * s
            if along > 0.0 and abs(across) < radius:
                end = along - math.sqrt(radius * radius - across * across)
                if end < length:
                    length, kind = end, RayKind.HIT
        return Ray(self.now_s, beam, kind, (*self.origin, -1.0), bearing, 0.0, length, (0.0, 0.0))


def test_nothing_that_stands_becomes_a_mover() -> None:
    still = (0.0, 0.0)
    stage = Stage(((0.7, 0.1), still, 0.2), ((-0.5, 0.5), still, 0.05), ((0.0, -0.9), still, 0.3))
    assert stage.run(12.0) == ()
    assert stage.tracker.moved_s == -math.inf


def test_an_edge_that_wanders_into_what_was_free_is_not_a_mover() -> None:
    """The estimate swings by 4.5 cm: edges seem to come, and the scan runs along what stands."""
    for number in range(24):
        at_rad = number * math.pi / 12.0
        c, s = math.cos(at_rad), math.sin(at_rad)
        stage = Stage(((0.75 * c, 0.75 * s), (0.0, 0.0), 0.5))
        while stage.now_s < 20.0:
            swing_m = 0.045 * math.sin(2.0 * math.pi * stage.now_s / 5.0 + number)
            stage.origin = (-swing_m * s, swing_m * c)
            assert stage.run(TICK_S) == (), f"taken to be new, at {stage.now_s:.2f} s of {number}"
        assert stage.tracker.moved_s == -math.inf


@settings(deadline=None, max_examples=15)
@given(
    from_rad=st.floats(-math.pi, math.pi),
    speed=st.floats(0.15, 0.3),
    off_m=st.floats(-0.25, 0.25),
    radius=st.floats(0.15, 0.25),
)
def test_what_comes_is_tracked_with_its_velocity(
    from_rad: float, speed: float, off_m: float, radius: float
) -> None:
    c, s = math.cos(from_rad), math.sin(from_rad)
    begin_m = 1.1 + radius
    begin = (begin_m * c - off_m * s, begin_m * s + off_m * c)
    stage = Stage((begin, (-speed * c, -speed * s), radius))
    stage.run(2.0)
    # Until its edge is 0.25 m away from the vehicle's centre.
    movers = stage.run((begin_m - radius - 0.25) / speed)
    assert movers, "it was not noticed"
    found = min(movers, key=lambda m: math.dist(m.point, stage.place(0)))
    assert math.dist(found.point, stage.place(0)) < 0.2
    n, e = found.velocity_ne_m_s
    assert -n * c - e * s > 0.25 * speed
    assert stage.now_s - found.seen_s < 1.0


@pytest.mark.parametrize(("speed", "radius", "within_s"), [(0.2, 0.06, 3.6), (0.3, 0.1, 2.2)])
def test_what_comes_is_soon_told_as_moving_however_thin(
    speed: float, radius: float, within_s: float
) -> None:
    """A leg, an arm: few hits a look. Counted from when its edge comes into the beams' reach."""
    for number in range(12):
        at_rad = number * math.pi / 24.0
        c, s = math.cos(at_rad), math.sin(at_rad)
        begin_m = 1.1 + radius
        stage = Stage(((begin_m * c, begin_m * s), (-speed * c, -speed * s), radius))
        stage.run(2.0)
        movers = stage.run((begin_m - radius - REACH_M) / speed + within_s)
        assert any(mover.moving for mover in movers), f"not told of number {number}"


def test_what_moves_for_sure_is_told_from_what_is_only_new() -> None:
    stage = Stage(((1.3, 0.05), (-0.2, 0.0), 0.2))
    stage.run(2.0)
    early = [m.moving for m in stage.run(2.4)]
    assert not any(early)
    (mover,) = stage.run(2.2)
    assert mover.moving
    assert mover.velocity_ne_m_s[0] == pytest.approx(-0.2, abs=0.06)
    assert mover.velocity_ne_m_s[1] == pytest.approx(0.0, abs=0.06)


def test_its_trail_is_taken_off_the_map() -> None:
    stage = Stage(((0.6, -1.4), (0.0, 0.2), 0.2))
    stage.run(11.0)
    place = stage.place(0)
    assert place[1] > 0.3
    # Where it came into sight nothing had been seen free: those hits stay until a beam is through.
    trail = [e for n, e in stage.map.hits().tolist() if -0.6 < e < place[1] - 0.45]
    assert trail == []


def test_an_odd_hit_beside_a_confirmed_mover_does_not_replace_it() -> None:
    stage = Stage(((1.3, 0.0), (-0.2, 0.0), 0.2))
    stage.run(2.0)
    (mover,) = stage.run(3.0)
    stage.now_s += TICK_S
    odd_m = math.hypot(*mover.point) - mover.radius_m - 0.2
    bearing = math.atan2(mover.point[1], mover.point[0])
    hit = Ray(stage.now_s, 1, RayKind.HIT, (0.0, 0.0, -1.0), bearing, 0.0, odd_m, (0.0, 0.0))
    stage.tracker.step(stage.now_s, [hit], stage.map)
    assert [one.name for one in stage.tracker.obstacles(stage.now_s)] == [mover.name]
    assert [one.name for one in stage.run(1.0)] == [mover.name]


def test_what_left_is_forgotten() -> None:
    stage = Stage(((1.3, 0.0), (-0.25, 0.0), 0.2))
    stage.run(2.0)
    assert stage.run(3.0)
    stage.discs = ()
    assert stage.run(FORGET_S + 0.5) == ()


def test_where_it_moves_and_where_it_was_are_places_of_unrest() -> None:
    stage = Stage(((1.3, 0.0), (-0.2, 0.0), 0.2))
    stage.run(2.0)
    assert stage.tracker.unrest(stage.now_s) == ()
    stage.run(3.8)
    places = stage.tracker.unrest(stage.now_s)
    (there,) = [one for one in places if not one.left]
    assert math.dist(there.point, stage.place(0)) < there.radius_m
    assert any(one.left for one in places)
    assert all(one.point[0] > stage.place(0)[0] - 0.15 for one in places)
    assert stage.tracker.unrest(stage.now_s + 20.0)[1:] == ()


def test_what_stands_is_no_unrest_after_a_while() -> None:
    """Put down where it was free: new at first."""
    stage = Stage()
    stage.run(2.0)
    stage.discs = (((0.7, 0.0), (0.0, 0.0), 0.2),)
    stage.run(2.0)
    assert stage.tracker.unrest(stage.now_s)
    assert math.isfinite(stage.tracker.new_s)
    stage.run(8.0)
    assert stage.tracker.unrest(stage.now_s) == ()
    assert stage.tracker.obstacles(stage.now_s) == ()
    assert stage.tracker.moved_s == -math.inf


def test_a_beam_that_alone_sees_things_is_not_fled_from_for_long() -> None:
    """Beam 0 says one distance in every direction, and the other three look through it."""
    stage = Stage()
    stage.run(2.0)
    fled, places = [], []
    for tick in range(240):
        stage.lies = {0: 0.95 - 0.003 * tick}
        fled.append(bool(stage.run(TICK_S)))
        places.append(bool(stage.tracker.unrest(stage.now_s)))
    assert not any(fled[100:])
    assert not any(places[100:])


def test_a_frame_that_jumps_by_whole_cells_makes_nothing_new() -> None:
    stage = Stage(((0.7, 0.1), (0.0, 0.0), 0.2), ((-0.5, 0.5), (0.0, 0.0), 0.1))
    stage.run(5.0)
    stage.map.shift((0.6, -0.6))
    stage.origin = (0.6, -0.6)
    stage.run(5.0)
    assert stage.tracker.new_s == -math.inf
    assert stage.tracker.obstacles(stage.now_s) == ()


def test_the_same_rays_give_the_same_movers() -> None:
    first, second = (Stage(((1.2, 0.3), (-0.2, -0.05), 0.2)) for _ in range(2))
    assert first.run(6.0) == second.run(6.0)


def test_an_empty_tracker_takes_anything() -> None:
    stage = Stage()
    assert stage.run(1.0) == ()
    stage.tracker.forget()
    assert stage.run(1.0) == ()
