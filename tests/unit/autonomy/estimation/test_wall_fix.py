"""Beams on known walls: what they can say about the frame is corrected, and nothing else."""

import math
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from autonomy.config import WallsConfig
from autonomy.estimation.wall_fix import WallFix
from autonomy.model import WallFixReport
from hal.config import Fence
from hal.frames import Vector3

FENCE = Fence.rectangle((-2.0, 2.0), (-2.0, 2.0))
TICK_S = 0.05
TURN_RAD_S = math.radians(60.0)
REACH_M = 1.0


@dataclass(frozen=True)
class Line:
    """An endless wall: its normal's bearing, seen from the origin, and its distance from there."""

    bearing_rad: float
    distance_m: float


@dataclass(frozen=True)
class Seen:
    """A ray that ended on something."""

    origin_ned_m: Vector3
    bearing_rad: float
    length_m: float


class Turning:
    """A vehicle at the origin of a room of endless walls that turns as in flight, four beams."""

    def __init__(self, config: WallsConfig | None = None, seed: int = 0) -> None:
        self.fix = WallFix(config or WallsConfig(), FENCE)
        self._rng = np.random.default_rng(seed)
        self._tick = 0
        self.report = WallFixReport()
        self.offsets = [self.fix.offset_ne_m]

    def turn(
        self,
        seconds: float,
        walls: list[Line],
        off_by: tuple[float, float] = (0.0, 0.0),
        *,
        learn: bool = True,
    ) -> None:
        """Look at the walls for a while; the autopilot's position is wrong by `off_by`."""
        for _ in range(round(seconds / TICK_S)):
            self._tick += 1
            now_s = self._tick * TICK_S
            offset = self.fix.offset_ne_m
            origin = (off_by[0] - offset[0], off_by[1] - offset[1], -1.0)
            rays = []
            for beam in range(4):
                bearing = TURN_RAD_S * now_s + beam * math.pi / 2.0
                length_m = min(_length_m(bearing, wall) for wall in walls)
                if length_m <= REACH_M:
                    noise_m = float(self._rng.normal(0.0, 0.005))
                    rays.append(Seen(origin, bearing, length_m + noise_m))
            self.report = self.fix.step(now_s, rays, learn=learn)
            self.offsets.append(self.fix.offset_ne_m)


def _length_m(bearing_rad: float, wall: Line) -> float:
    cosine = math.cos(bearing_rad - wall.bearing_rad)
    return wall.distance_m / cosine if cosine > 1e-6 else math.inf


def _along(vector: tuple[float, float], bearing_rad: float) -> float:
    return vector[0] * math.cos(bearing_rad) + vector[1] * math.sin(bearing_rad)


bearings = st.floats(-math.pi, math.pi)
centimetres = st.floats(-0.04, 0.04)


@given(bearing=bearings, north_m=centimetres, east_m=centimetres)
@settings(deadline=None, max_examples=15)
def test_two_walls_at_right_angles_tell_the_whole_offset(
    bearing: float, north_m: float, east_m: float
) -> None:
    vehicle = Turning()
    walls = [Line(bearing, 0.5), Line(bearing + math.pi / 2.0, 0.6)]
    vehicle.turn(6.0, walls)
    vehicle.turn(4.0, walls, (north_m, east_m))
    offset = vehicle.fix.offset_ne_m
    assert math.dist(offset, (north_m, east_m)) < 0.015
    assert vehicle.report.rejected < vehicle.report.fused / 20


@given(bearing=bearings, away_m=centimetres, along_m=centimetres)
@settings(deadline=None, max_examples=15)
def test_one_wall_tells_the_offset_across_it_and_nothing_along_it(
    bearing: float, away_m: float, along_m: float
) -> None:
    vehicle = Turning()
    walls = [Line(bearing, 0.5)]
    vehicle.turn(6.0, walls)
    cos, sin = math.cos(bearing), math.sin(bearing)
    vehicle.turn(4.0, walls, (away_m * cos - along_m * sin, away_m * sin + along_m * cos))
    offset = vehicle.fix.offset_ne_m
    assert _along(offset, bearing) == pytest.approx(away_m, abs=0.015)
    assert abs(_along(offset, bearing + math.pi / 2.0)) < 0.004


def test_what_is_not_seen_is_not_certain() -> None:
    vehicle = Turning()
    vehicle.turn(6.0, [Line(0.0, 0.5)])
    north_m, east_m = vehicle.report.sigma_ne_m
    assert north_m < 0.012
    assert east_m > 0.02


@given(by_m=st.floats(0.1, 0.3), towards=st.booleans())
@settings(deadline=None, max_examples=6)
def test_a_wall_that_was_moved_drags_nothing_and_is_learned_anew(
    by_m: float, towards: bool
) -> None:
    vehicle = Turning()
    away = Line(math.pi / 2.0, 0.6)
    vehicle.turn(6.0, [Line(0.0, 0.55), away])
    moved = [Line(0.0, 0.55 - by_m if towards else 0.55 + by_m), away]
    vehicle.turn(20.0, moved)
    drags_m = max(math.hypot(*offset) for offset in vehicle.offsets)
    assert drags_m < 0.03
    fused = vehicle.report.fused
    vehicle.turn(4.0, moved, (0.03, 0.0))
    assert vehicle.report.fused > fused
    assert vehicle.fix.offset_ne_m[0] == pytest.approx(0.03, abs=0.02)


@given(by_m=st.floats(-0.3, 0.3))
@settings(deadline=None, max_examples=20)
def test_a_moved_wall_never_drags_farther_than_the_gate(by_m: float) -> None:
    config = WallsConfig()
    vehicle = Turning(config)
    vehicle.turn(6.0, [Line(0.0, 0.6)])
    vehicle.turn(15.0, [Line(0.0, 0.6 + by_m)])
    assert max(math.hypot(*offset) for offset in vehicle.offsets) < config.gate_m + 0.01


def test_a_contradicted_wall_is_forgotten() -> None:
    vehicle = Turning()
    vehicle.turn(6.0, [Line(0.0, 0.5)])
    vehicle.turn(0.5, [Line(0.0, 0.59)])
    assert vehicle.report.rejected > 0
    vehicle.turn(15.0, [Line(0.0, 0.59)])
    assert vehicle.report.forgotten > 0


def test_a_moved_wall_is_outvoted_by_two_that_stayed() -> None:
    vehicle = Turning()
    opposite, side = Line(math.pi, 0.5), Line(math.pi / 2.0, 0.5)
    vehicle.turn(6.0, [Line(0.0, 0.5), opposite, side])
    vehicle.turn(10.0, [Line(0.0, 0.54), opposite, side])
    assert max(math.hypot(*offset) for offset in vehicle.offsets) < 0.03


def test_a_steady_drift_is_followed_where_walls_are_in_sight() -> None:
    vehicle = Turning(WallsConfig(drift_rate_m_s=0.003))
    walls = [Line(0.0, 0.5), Line(math.pi / 2.0, 0.6)]
    vehicle.turn(6.0, walls)
    for second in range(30):
        vehicle.turn(1.0, walls, (0.01 * second, 0.0))
    assert vehicle.fix.offset_ne_m[0] == pytest.approx(0.29, abs=0.03)


@given(speed_m_s=st.floats(0.01, 0.2))
@settings(deadline=None, max_examples=10)
def test_the_frame_moves_no_faster_than_it_may(speed_m_s: float) -> None:
    vehicle = Turning(WallsConfig(correction_max_m_s=speed_m_s))
    walls = [Line(0.3, 0.5), Line(2.0, 0.5)]
    vehicle.turn(4.0, walls)
    vehicle.turn(3.0, walls, (0.03, -0.03))
    steps = zip(vehicle.offsets, vehicle.offsets[1:], strict=False)
    assert max(math.dist(a, b) for a, b in steps) <= speed_m_s * TICK_S + 1e-12


def test_the_frame_moves_no_farther_than_it_may() -> None:
    vehicle = Turning(WallsConfig(correction_max_m=0.02))
    walls = [Line(0.3, 0.5), Line(2.0, 0.5)]
    vehicle.turn(4.0, walls)
    vehicle.turn(5.0, walls, (0.03, 0.03))
    assert math.hypot(*vehicle.fix.offset_ne_m) == pytest.approx(0.02)


def test_what_is_seen_between_two_heights_is_no_reference() -> None:
    vehicle = Turning()
    vehicle.turn(6.0, [Line(0.0, 0.5)], learn=False)
    assert vehicle.report.fused == 0
    vehicle.turn(6.0, [Line(0.0, 0.5)])
    fused = vehicle.report.fused
    vehicle.turn(2.0, [Line(0.0, 0.5)], learn=False)
    assert vehicle.report.fused > fused


def test_hits_are_no_reference_before_they_have_settled() -> None:
    vehicle = Turning(WallsConfig(settle_s=5.0))
    vehicle.turn(4.9, [Line(0.0, 0.5)])
    assert vehicle.report.fused == vehicle.report.rejected == 0
    vehicle.turn(4.0, [Line(0.0, 0.5)])
    assert vehicle.report.fused > 0


def test_the_same_rays_give_the_same_offset() -> None:
    first, second = Turning(seed=3), Turning(seed=3)
    for vehicle in (first, second):
        vehicle.turn(6.0, [Line(0.7, 0.5)])
        vehicle.turn(2.0, [Line(0.7, 0.5)], (0.02, 0.01))
    assert first.offsets == second.offsets
    assert first.report == second.report


def test_rays_that_end_outside_the_reference_are_no_harm() -> None:
    fix = WallFix(WallsConfig(), FENCE)
    far = [Seen((50.0, -50.0, -1.0), 0.1 * k, 0.5) for k in range(40)]
    for tick in range(40):
        assert fix.step(TICK_S * tick, far, learn=True).fused == 0


def test_a_post_is_no_wall() -> None:
    fix = WallFix(WallsConfig(), FENCE)
    for tick in range(200):
        bearing = 0.005 * (tick % 5)
        ray = Seen((0.002 * (tick % 7), 0.0, -1.0), bearing, 0.5)
        report = fix.step(TICK_S * tick, [ray], learn=True)
    assert report.fused == report.rejected == 0


def test_the_other_side_of_a_thin_wall_is_another_surface() -> None:
    fix = WallFix(WallsConfig(), FENCE)
    rng = np.random.default_rng(1)
    thickness_m = 0.05
    drags_m = 0.0
    for tick in range(1200):
        beyond = tick >= 400
        bearing = (math.pi if beyond else 0.0) + 0.5 * math.sin(0.3 * tick)
        face_m = 0.5 + (thickness_m if beyond else 0.0)
        origin = (1.1 if beyond else 0.0, 0.0, -1.0)
        length_m = abs((face_m - origin[0]) / math.cos(bearing)) + float(rng.normal(0.0, 0.005))
        offset = fix.offset_ne_m
        seen = (origin[0] - offset[0], origin[1] - offset[1], -1.0)
        fix.step(TICK_S * tick, [Seen(seen, bearing, length_m)], learn=True)
        drags_m = max(drags_m, math.hypot(*fix.offset_ne_m))
    assert drags_m < 0.02
