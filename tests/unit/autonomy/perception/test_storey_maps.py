"""One map for each height of flight."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from autonomy.config import MapConfig
from autonomy.geometry import Point
from autonomy.perception.projection import Ray, RayKind
from autonomy.perception.storey_maps import MAPS_MAX, StoreyMaps
from hal.config import Fence

FENCE = Fence.rectangle((-1.0, 3.0), (-2.0, 2.0))
SPACING_M = 0.22
ORIGIN: Point = (0.0, 0.0)


def maps(height_m: float = 1.0) -> StoreyMaps:
    made = StoreyMaps(MapConfig(), 0.15, FENCE)
    made.settle(height_m)
    return made


def looked(
    made: StoreyMaps,
    now_s: float,
    north_m: float | None,
    half_width_m: float = 0.6,
    at: Point = ORIGIN,
) -> float:
    """A look round: a wall `north_m` ahead of `at` as wide as told, nothing elsewhere."""
    for step in range(180):
        bearing = math.radians(2.0 * step)
        length, kind = 1.0, RayKind.FREE
        if north_m is not None and math.cos(bearing) > 0.05:
            reach = north_m / math.cos(bearing)
            if reach < 1.0 and abs(reach * math.sin(bearing)) <= half_width_m:
                length, kind = reach, RayKind.HIT
        now_s += 0.02
        ray = Ray(now_s, 0, kind, (*at, 0.0), bearing, 0.0, length, at)
        made.present.update(now_s, (ray,))
    return now_s


def test_what_is_free_at_one_height_says_nothing_about_another() -> None:
    made = maps()
    now_s = looked(made, 0.0, None)
    made.present.mark_seen_disc(ORIGIN, 0.3, now_s)
    assert made.present.free_distance_m((0.0, 0.0, -1.0), 0.0, 0.5, now_s) == 0.5
    made.enter(1.22, ORIGIN, now_s)
    assert made.present.free_distance_m((0.0, 0.0, -1.22), 0.0, 0.5, now_s) < 0.1
    assert made.present.hit_count == 0


def test_coming_back_finds_what_was_left_and_its_sights_have_aged() -> None:
    made = maps()
    now_s = looked(made, 0.0, 0.8)
    hits, left = made.present.hits().copy(), made.present
    made.enter(1.22, ORIGIN, now_s)
    made.enter(1.0, ORIGIN, now_s + 30.0)
    assert made.present is left
    assert np.array_equal(made.present.hits(), hits)
    assert made.present.free_distance_m((0.0, 0.0, -1.0), math.pi, 0.4, now_s + 30.0) == 0.4
    # A minute after the look nothing counts as seen but where the vehicle stands.
    assert made.present.free_distance_m((0.0, 0.0, -1.0), math.pi, 0.4, now_s + 61.0) < 0.1


def test_the_version_rises_with_every_change_of_height() -> None:
    made = maps()
    now_s = looked(made, 0.0, 0.8)
    versions = [made.present.version]
    for height_m in (1.22, 1.0, 1.22, 1.44):
        made.enter(height_m, ORIGIN, now_s)
        versions.append(made.present.version)
    assert versions == sorted(set(versions))


def test_entering_the_present_height_changes_nothing() -> None:
    made = maps()
    looked(made, 0.0, 0.8)
    before = made.present.version
    made.enter(1.0, ORIGIN, 5.0)
    assert made.present.version == before
    assert made.count == 1


def test_a_plane_is_cut_by_what_was_seen_at_its_neighbours() -> None:
    made = maps()
    now_s = looked(made, 0.0, 0.8)
    assert made.hits_cutting(1.0, SPACING_M) is made.present.hits()
    wall = len(made.present.hits())
    made.enter(1.22, ORIGIN, now_s)
    now_s = looked(made, now_s, None)
    assert len(made.hits_cutting(1.22, SPACING_M)) == wall
    assert len(made.hits_cutting(0.78, SPACING_M)) == wall
    assert len(made.hits_cutting(1.44, SPACING_M)) == 0
    assert len(made.hits_cutting(1.22, 0.0)) == 0


def test_the_same_wall_at_two_heights_is_taken_once() -> None:
    made = maps()
    now_s = looked(made, 0.0, 0.8)
    one = len(made.present.hits())
    made.enter(1.22, ORIGIN, now_s)
    looked(made, now_s, 0.8)
    assert one <= len(made.hits_cutting(1.0, SPACING_M)) <= 1.1 * one


def test_a_wall_is_guessed_to_go_on_at_the_height_at_which_it_began() -> None:
    """Seen all along at 1 m; at 1.44 m only its middle, from near: the rest is likely there too."""
    made = maps()
    now_s = 0.0
    for east in (-1.0, 0.0, 1.0):
        now_s = looked(made, now_s, 0.7, 0.7, (0.0, east))
    far = made.present.hits()
    assert np.ptp(far[:, 1]) > 3.0
    made.enter(1.44, ORIGIN, now_s)
    now_s = looked(made, now_s, 0.7, 0.7)
    assert np.ptp(made.hits_cutting(1.44, SPACING_M)[:, 1]) < 1.6
    assert np.ptp(made.guessed(1.44, SPACING_M)[:, 1]) > 2.9


def test_a_wall_that_was_seen_to_end_below_is_not_guessed() -> None:
    made = maps()
    now_s = 0.0
    for east in (-1.0, 0.0, 1.0):
        now_s = looked(made, now_s, 0.7, 0.7, (0.0, east))
    made.enter(1.44, ORIGIN, now_s)
    now_s = looked(made, now_s, None)
    assert len(made.guessed(1.44, SPACING_M)) == 0
    # A post beside it that is there at both heights does not make it higher.
    made.present.update(
        now_s + 0.1, (Ray(now_s + 0.1, 1, RayKind.HIT, (0.0, 0.0, 0.0), 3.0, 0.0, 0.9, ORIGIN),)
    )
    guessed = made.guessed(1.44, SPACING_M)
    assert np.count_nonzero(np.abs(guessed[:, 0] - 0.7) < 0.05) == 0


def test_a_shaft_is_free_when_nothing_known_is_near_it() -> None:
    made = maps()
    now_s = looked(made, 0.0, 0.8)
    near, away = (0.7, 0.0), (0.3, 0.0)
    made.enter(1.22, ORIGIN, now_s)
    assert made.shaft_is_free(away, 1.22, 0.78, 0.17, own=False)
    assert not made.shaft_is_free(near, 1.22, 0.78, 0.17, own=False)
    assert not made.shaft_is_free(near, 1.22, 1.0, 0.17, own=False)
    assert made.shaft_is_free(near, 1.22, 1.44, 0.17, own=False)
    made.enter(1.0, ORIGIN, now_s)
    assert made.shaft_is_free(near, 1.0, 1.22, 0.17, own=False)
    assert not made.shaft_is_free(near, 1.0, 1.22, 0.17, own=True)


@pytest.mark.parametrize(("height_m", "left"), [(1.0, 1), (1.44, 1), (1.22, 0)])
def test_forgetting_a_plane_forgets_its_neighbours_and_no_other(height_m: float, left: int) -> None:
    made = maps()
    now_s = looked(made, 0.0, 0.8)
    for other_m in (1.44, 1.22):
        made.enter(other_m, ORIGIN, now_s)
        now_s = looked(made, now_s, 0.8)
    made.forget_cutting(height_m, SPACING_M, ORIGIN, 0.14)
    assert len(made.hits_cutting(height_m, SPACING_M)) == 0
    others = [h for h in (1.0, 1.22, 1.44) if len(made.hits_cutting(h, 0.0))]
    assert len(others) == left
    made.forget_all(ORIGIN, 0.14)
    assert made.count == 1
    assert len(made.all_hits()) == 0


def test_forgetting_nearby_reaches_the_neighbours() -> None:
    made = maps()
    now_s = looked(made, 0.0, 0.8)
    made.enter(1.22, ORIGIN, now_s)
    now_s = looked(made, now_s, 0.8)
    made.enter(1.44, ORIGIN, now_s)
    made.forget_within(ORIGIN, 1.1, 0.14, SPACING_M)
    assert len(made.hits_cutting(1.22, 0.0)) == 0
    assert len(made.hits_cutting(1.0, 0.0)) > 0


@given(st.lists(st.sampled_from([round(0.3 + 0.1 * k, 1) for k in range(18)]), max_size=60))
@settings(deadline=None, max_examples=15)
def test_memory_is_bounded_and_the_last_heights_are_kept(order: list[float]) -> None:
    made = maps()
    made.present.mark_seen_disc(ORIGIN, now_s=0.0)
    for now_s, height_m in enumerate(order):
        made.enter(height_m, ORIGIN, float(now_s))
        assert made.height_m == height_m
    assert made.count <= MAPS_MAX
    heights = list(dict.fromkeys(reversed([1.0, *order])))
    for place, height_m in enumerate(heights):
        made.enter(height_m, (1.0, 1.0), 100.0)
        assert made.present.ever_seen(np.array([ORIGIN]))[0] == (place < MAPS_MAX)


def test_the_newest_look_is_trusted_at_every_height_known_or_new() -> None:
    made = maps()
    now_s = looked(made, 0.0, 0.5)
    made.enter(1.22, ORIGIN, now_s)
    now_s = looked(made, now_s, 0.5)
    made.trust_newest()
    for height_m in (1.0, 1.22, 1.44):
        made.enter(height_m, ORIGIN, now_s)
        now_s = looked(made, looked(made, now_s, 0.5), 0.5)
        assert made.present.hit_count > 0
        for _ in range(4):
            now_s = looked(made, now_s, None)
        assert made.present.clearance_m((0.3, 0.0, 0.0), 0.25) == 0.25
