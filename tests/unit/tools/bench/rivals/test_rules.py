"""The rules inside the rivals, each alone."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from autonomy.geometry import bearing
from hal.frames import wrap_pi
from tests.unit.tools.bench.rivals.hand_made import CRAFT, NOTHING, WALL, fly, line
from tools.bench.rivals import kernels, toy
from tools.bench.rivals.bendy_ruler import BendyRuler
from tools.bench.rivals.boundary import Boundary
from tools.bench.rivals.interface import Floats
from tools.bench.rivals.tangent_bug import followed
from tools.bench.rivals.vfh_plus import SECTORS, WIDE, candidates, openings

STEP = 2.0 * math.pi / kernels.BEARINGS
KEEP_OUT_M = 0.21


def scattered(seed: int) -> Floats:
    return np.random.default_rng(seed).uniform(-1.2, 1.2, (30, 2))


@given(seed=st.integers(0, 10_000))
@settings(max_examples=60, deadline=None)
def test_a_profile_is_the_free_way_in_every_direction(seed: int) -> None:
    hits = scattered(seed)
    free = kernels.profile(hits, 0.0, 0.0, KEEP_OUT_M, 1.0)
    inside = np.hypot(hits[:, 0], hits[:, 1]) < KEEP_OUT_M
    for k in range(kernels.BEARINGS):
        un, ue = math.cos(k * STEP), math.sin(k * STEP)
        way = kernels.way_free(hits, 0.0, 0.0, un, ue, KEEP_OUT_M, 1.0)
        if abs(way - free[k]) > 1e-9:
            # The edge of what a hit inside the keep-out bars is the only place to differ.
            assert inside.any()
            assert 0.0 in (way, free[k])
        at = (way * un, way * ue)
        gaps = np.hypot(hits[~inside, 0] - at[0], hits[~inside, 1] - at[1])
        assert not len(gaps) or gaps.min() >= KEEP_OUT_M - 1e-9


@pytest.mark.parametrize("side", [1, -1])
def test_the_first_free_bearing_turns_away_from_the_hand_that_follows(side: int) -> None:
    wall = line((0.3, -1.0), (0.3, 1.0))
    free = kernels.profile(wall, 0.0, 0.0, KEEP_OUT_M, 1.0)
    found = kernels.first_free(free, 0.0, side, 0.1)
    assert 0.0 < side * wrap_pi(found) <= math.pi / 2.0
    assert math.isnan(kernels.first_free(np.zeros(kernels.BEARINGS), 0.0, side, 0.1))


@pytest.mark.parametrize("side", [1, -1])
def test_between_two_walls_the_one_on_the_following_hand_is_followed(side: int) -> None:
    left, right = line((-1.0, -0.3), (1.0, -0.3)), line((-1.0, 0.25), (1.0, 0.25))
    both = np.concatenate((left, right))
    found = kernels.wall_bearing(both, 0.0, 0.0, 0.0, side)
    assert found == pytest.approx(-side * math.pi / 2.0, abs=0.1)


def test_a_round_does_not_end_where_it_began_going_the_other_way() -> None:
    # Into a dead end with the wall on the left, and out again past where it began.
    boundary = Boundary((0.0, 0.0), 0.0, 1)
    boundary._was_away, boundary._first_rad, boundary._heading_rad = True, 0.0, math.pi
    assert not boundary.closed
    boundary._heading_rad = 0.1
    assert boundary.closed


def test_what_is_followed_ends_at_the_edges_and_at_what_is_open() -> None:
    free = np.full(kernels.BEARINGS, 1.0)
    free[10:20] = 0.5
    free[20:25] = 0.9
    assert sorted(followed(free, 15 * STEP, 1.0)) == list(range(10, 20))
    assert followed(free, 60 * STEP, 1.0) == []


def test_openings_go_round_the_circle() -> None:
    blocked = [1] * SECTORS
    blocked[-2:] = [0, 0]
    blocked[:3] = [0, 0, 0]
    blocked[20:24] = [0] * 4
    assert sorted(openings(blocked)) == [(20, 4), (SECTORS - 2, 5)]
    assert openings([1] * SECTORS) == []


def test_a_wide_opening_has_two_sides_and_the_target_in_between() -> None:
    blocked = [1] * SECTORS
    blocked[10:40] = [0] * 30
    step = 2.0 * math.pi / SECTORS
    assert candidates(blocked, 25 * step) == pytest.approx(
        [(10 + WIDE / 2) * step, (39 - WIDE / 2) * step, 25 * step]
    )
    assert len(candidates(blocked, 60 * step)) == 2
    assert candidates([0] * SECTORS, 1.0) == [1.0]
    narrow = [1] * SECTORS
    narrow[10:13] = [0] * 3
    assert candidates(narrow, 0.0) == pytest.approx([11 * step])


def test_the_histogram_has_hysteresis() -> None:
    blocked = np.zeros(SECTORS, dtype=np.uint8)
    near, middle, far = (np.array(((d, 0.0),)) for d in (0.2, 0.45, 0.68))

    def ahead(hits: Floats) -> int:
        kernels.polar(hits, 0.0, 0.0, 0.2, 0.7, 0.2, 0.8, blocked)
        return int(blocked[0])

    assert [ahead(hits) for hits in (middle, near, middle, far, middle)] == [0, 1, 1, 0, 0]


def test_the_field_pushes_away_and_fades_at_the_goal() -> None:
    hit = np.array(((0.25, 0.0),))
    north, east = kernels.push(hit, 0.0, 0.0, 3.0, 0.0, CRAFT.body_m, 0.001, 0.3)
    assert north < 0.0
    assert east == pytest.approx(0.0)
    beside = kernels.push(hit, 0.0, 0.0, 0.0, 0.05, CRAFT.body_m, 0.001, 0.3)
    assert abs(beside[0]) < 0.01 * abs(north)
    assert beside[1] > 0.0
    assert kernels.push(NOTHING, 0.0, 0.0, 3.0, 0.0, CRAFT.body_m, 0.001, 0.3) == (0.0, 0.0)


def test_a_turn_back_is_resisted_while_there_is_room_ahead() -> None:
    rival = BendyRuler(CRAFT)
    rival._before_rad = math.pi / 2.0
    # The goal is behind the left shoulder now; the old bearing is as clear as the new one.
    flown = toy.fly(rival, line((0.0, 0.9), (0.5, 0.9)), (0.0, -2.0), limit_s=0.2)
    assert bearing(flown.track[0], flown.track[1]) == pytest.approx(math.pi / 2.0)


def test_a_vehicle_that_lags_and_errs_is_the_same_for_the_same_seed_only() -> None:
    def track(seed: int) -> list[tuple[float, float]]:
        rng = np.random.default_rng(seed)
        return toy.fly(BendyRuler(CRAFT), WALL, (3.0, 0.0), rng=rng).track

    assert track(1) == track(1)
    assert track(1) != track(2)
    assert track(1) != fly(BendyRuler(CRAFT), WALL).track
