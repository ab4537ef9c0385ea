"""Routes of the tangent search on small maps: by hand, against brute force, at the borders."""

import itertools
import math

import numpy as np
import pytest

from autonomy.t3drm import kernels
from autonomy.t3drm.kernels import (
    BEATEN,
    CLOSED,
    FOUND,
    GOAL_INSIDE,
    START_INSIDE,
    TOO_MANY,
    Floats,
    Ints,
)
from autonomy.t3drm.spherical import NO_SEEDS, Discs
from tests.support.tangent_graph import shortest_length

NO_PLANES = np.empty((0, 3))
Disc = tuple[float, float, float]


def ends(an: float, ae: float, bn: float, be: float) -> Floats:
    return np.array(((an, ae), (bn, be)))


def discs(*rows: Disc) -> tuple[Floats, Floats]:
    table = np.array(rows, dtype=np.float64).reshape(-1, 3)
    return table[:, :2].copy(), table[:, 2].copy()


def route(
    both: Floats, *rows: Disc, planes: Floats = NO_PLANES, active_max: int = 50
) -> tuple[int, Floats, list[int], int]:
    status, found, active, rounds = kernels.route_from_scratch(
        both, *discs(*rows), planes, active_max
    )
    return status, found, active.tolist(), rounds


def length(rows: Floats, radii: Floats) -> float:
    total = 0.0
    for an, ae, bn, be, disc, sweep in rows.tolist():
        straight = math.hypot(bn - an, be - ae)
        total += straight if disc < 0 else float(radii[int(disc)]) * abs(sweep)
    return total


def assert_is_one_smooth_way(rows: Floats, both: Floats, centres: Floats, radii: Floats) -> None:
    """From end to end, without gap or corner: arcs lie on their discs, tangents along them."""
    assert rows[0, :2].tolist() == both[0].tolist()
    assert rows[-1, 2:4].tolist() == both[1].tolist()
    heading = None
    for row in rows:
        if row[4] < 0.0:
            straight = math.dist(row[:2], row[2:4])
            begin = end = math.atan2(row[3] - row[1], row[2] - row[0])
            assert row[5] == 0.0
            if straight < 1e-6:
                continue
        else:
            centre, radius = centres[int(row[4])], radii[int(row[4])]
            sense = math.copysign(0.5 * math.pi, row[5])
            at = math.atan2(row[1] - centre[1], row[0] - centre[0])
            assert math.dist(row[:2], centre) == pytest.approx(radius)
            assert math.dist(row[2:4], centre) == pytest.approx(radius)
            begin, end = at + sense, at + row[5] + sense
            there = centre + radius * np.array((math.cos(at + row[5]), math.sin(at + row[5])))
            assert math.dist(there, row[2:4]) < 1e-6
        if heading is not None:
            assert math.cos(begin - heading) == pytest.approx(1.0, abs=1e-6)
        heading = end
    for before, after in itertools.pairwise(rows):
        assert math.dist(before[2:4], after[:2]) < 1e-6


# ---------------------------------------------------------------- one disc


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("turned_deg", [0.0, 90.0, 180.0, 233.0])
def test_one_disc_is_passed_on_its_shorter_side(side: float, turned_deg: float) -> None:
    # Disc of radius 3, its centre 1 m off the way of 10 m, in the middle.
    c, s = math.cos(math.radians(turned_deg)), math.sin(math.radians(turned_deg))
    both = ends(-5.0 * c, -5.0 * s, 5.0 * c, 5.0 * s)
    status, rows, active, rounds = route(both, (-side * s, side * c, 3.0))
    assert (status, active, rounds) == (FOUND, [0], 1)
    assert rows[:, 4].tolist() == [-1.0, 0.0, -1.0]
    away = math.sqrt(26.0)
    turn = math.pi - 2.0 * math.acos(3.0 / away) - 2.0 * math.atan2(1.0, 5.0)
    # The centre is on the side of growing angles: the way turns to that side around it.
    assert rows[1, 5] == pytest.approx(side * turn)
    assert math.dist(rows[0, :2], rows[0, 2:4]) == pytest.approx(math.sqrt(17.0))
    assert length(rows, np.array((3.0,))) == pytest.approx(2.0 * math.sqrt(17.0) + 3.0 * turn)
    assert_is_one_smooth_way(rows, both, *discs((-side * s, side * c, 3.0)))


def test_without_anything_in_the_way_the_route_is_the_straight_line() -> None:
    both = ends(1.0, 2.0, 4.0, 6.0)
    for rows in ((), ((10.0, 10.0, 1.0),), ((1.0, 7.0, 3.0),)):
        status, found, active, rounds = route(both, *rows)
        assert (status, active, rounds) == (FOUND, [], 0)
        assert found.tolist() == [[1.0, 2.0, 4.0, 6.0, -1.0, 0.0]]


@pytest.mark.parametrize(("radius", "straight"), [(1.0 + 5e-7, True), (1.0 + 3e-6, False)])
def test_a_disc_counts_when_it_is_cut_by_more_than_a_micrometre(
    radius: float, *, straight: bool
) -> None:
    status, rows, active, _ = route(ends(0, 0, 4, 0), (2.0, 1.0, radius))
    assert status == FOUND
    assert (len(rows) == 1) is straight
    assert active == ([] if straight else [0])


# ---------------------------------------------------------------- several discs


def test_a_row_of_equal_discs_is_passed_along_their_common_tangent() -> None:
    row = [(2.0 * k, -0.1, 0.5) for k in range(1, 5)]
    status, rows, _, _ = route(ends(0, 0, 10, 0), *row)
    assert status == FOUND
    assert_is_one_smooth_way(rows, ends(0, 0, 10, 0), *discs(*row))
    # First and last tangent, and 6 m between the outermost discs.
    first = math.sqrt(2.0**2 + 0.1**2 - 0.25)
    turn = math.acos(0.5 / math.hypot(2.0, 0.1))
    arc = 0.5 * math.pi - math.atan2(0.1, 2.0) - turn
    assert length(rows, np.full(4, 0.5)) == pytest.approx(2.0 * first + 6.0 + 2.0 * 0.5 * arc)


def test_a_slalom_changes_sides_between_its_gates() -> None:
    gates = [(3.0, 0.9, 1.0), (7.0, -0.9, 1.0)]
    status, rows, active, _ = route(ends(0, 0, 10, 0), *gates)
    assert (status, sorted(active)) == (FOUND, [0, 1])
    assert [math.copysign(1.0, sweep) for sweep in rows[rows[:, 4] >= 0, 5]] == [1.0, -1.0]
    expected = shortest_length((0.0, 0.0), (10.0, 0.0), *discs(*gates))
    assert length(rows, np.ones(2)) == pytest.approx(expected, abs=1e-6)


def test_a_limit_beats_only_routes_that_are_not_shorter() -> None:
    centres, radii = discs((0.0, -1.0, 3.0))
    field = Discs.of(centres, radii).field
    both = ends(-5, 0, 5, 0)
    _, rows, _, _ = kernels.lazy_route(both, field, NO_PLANES, 9, NO_SEEDS, math.inf)
    shortest = length(rows, radii)
    for limit_m, status in (
        (shortest + 1e-9, FOUND),
        (shortest - 1e-9, BEATEN),
        (10.0, BEATEN),
        (1.0, BEATEN),
    ):
        found = kernels.lazy_route(both, field, NO_PLANES, 9, NO_SEEDS, limit_m)
        assert found[0] == status
        assert (found[1].shape[0] > 0) is (status == FOUND)


@pytest.mark.parametrize("sweep_deg", [20.0, -20.0])
def test_a_slight_turn_round_the_first_disc_is_an_arc_of_it(sweep_deg: float) -> None:
    # Start and goal on the tangents at the ends of an arc of 20 degrees, 3 m from where they touch.
    sweep = math.radians(abs(sweep_deg))
    side = math.copysign(1.0, sweep_deg)
    start, end = (-3.0, 0.0), (3.0 * math.cos(sweep), side * 3.0 * math.sin(sweep))
    touch = (2.0 * math.sin(sweep), side * (2.0 - 2.0 * math.cos(sweep)))
    both = ends(*start, touch[0] + end[0], touch[1] + end[1])
    status, rows, _, _ = route(both, (0.0, side * 2.0, 2.0))
    assert status == FOUND
    assert rows[1, 4] == 0.0
    assert rows[1, 5] == pytest.approx(math.radians(sweep_deg))
    assert length(rows, np.array((2.0,))) == pytest.approx(6.0 + 2.0 * sweep)


def test_discs_that_touch_leave_a_way_between_them() -> None:
    status, rows, _, _ = route(ends(-2, 0, 2, 0), (0.0, 1.0, 1.0), (0.0, -1.0, 1.0))
    assert status == FOUND
    assert length(rows, np.ones(2)) == pytest.approx(4.0)


def test_a_route_begins_and_ends_on_discs() -> None:
    both = ends(0.0, 0.0, 6.0, 0.0)
    status, rows, _, _ = route(both, (1.0, 0.0, 1.0), (5.0, 0.0, 1.0))
    assert status == FOUND
    # A quarter of each, and the straight way between them.
    assert length(rows, np.ones(2)) == pytest.approx(math.pi + 4.0)


def random_maps(seed: int, count: int) -> list[tuple[Floats, tuple[Disc, ...]]]:
    rng = np.random.default_rng(seed)
    maps: list[tuple[Floats, tuple[Disc, ...]]] = []
    while len(maps) < count:
        size = int(rng.integers(1, 7))
        radii = np.full(size, 0.6) if rng.random() < 0.4 else rng.uniform(0.2, 1.0, size)
        centres = rng.uniform(0.0, 4.0, (size, 2))
        both = rng.uniform(-1.0, 5.0, (2, 2))
        if (np.hypot(*(both[:, None] - centres[None]).T) > radii[:, None]).all():
            table = np.column_stack((centres, radii))
            maps.append((both, tuple((n, e, r) for n, e, r in table.tolist())))
    return maps


def crowded_maps(seed: int, count: int) -> list[tuple[Floats, tuple[Disc, ...]]]:
    """Many discs between start and goal: several ways of nearly the same length."""
    rng = np.random.default_rng(seed)
    maps: list[tuple[Floats, tuple[Disc, ...]]] = []
    for _ in range(count):
        centres = rng.uniform((0.3, -2.0), (7.7, 2.0), (12, 2))
        radii = rng.uniform(0.3, 0.8, 12)
        both = ends(-0.6, float(rng.uniform(-1.5, 1.5)), 8.6, float(rng.uniform(-1.5, 1.5)))
        table = np.column_stack((centres, radii))
        maps.append((both, tuple((n, e, r) for n, e, r in table.tolist())))
    return maps


def lattice_maps(seed: int, count: int) -> list[tuple[Floats, tuple[Disc, ...]]]:
    """Touching, overlapping, contained and collinear discs between two sides."""
    rng = np.random.default_rng(seed)
    maps: list[tuple[Floats, tuple[Disc, ...]]] = []
    for _ in range(count):
        cells = rng.permutation(20)[: rng.integers(2, 8)]
        radii = rng.choice([0.3, 0.5, 0.7], len(cells)) if rng.random() < 0.6 else [0.5] * 8
        rows = [(float(c % 5), float(c // 5), float(r)) for c, r in zip(cells, radii, strict=False)]
        maps.append(
            (ends(-1.0, float(rng.integers(0, 4)), 6.0, float(rng.integers(0, 4))), tuple(rows))
        )
    return maps


@pytest.mark.parametrize(
    ("both", "rows"), random_maps(11, 22) + lattice_maps(12, 22) + crowded_maps(13, 16)
)
def test_no_route_is_shorter(both: Floats, rows: tuple[Disc, ...]) -> None:
    centres, radii = discs(*rows)
    status, found, active, _ = route(both, *rows)
    start, goal = (both[0, 0], both[0, 1]), (both[1, 0], both[1, 1])
    expected = shortest_length(start, goal, centres, radii)
    if expected is None:
        assert status == CLOSED
        assert shortest_length(start, goal, centres[active], radii[active]) is None
        return
    assert status == FOUND
    assert length(found, radii) == pytest.approx(expected, abs=2e-6)
    assert_is_one_smooth_way(found, both, centres, radii)


# ---------------------------------------------------------------- no route


def ring(count: int, radius: float, missing: int = 0) -> list[Disc]:
    """Discs around the origin at 2 m."""
    turns = [math.tau * k / count for k in range(missing, count)]
    return [(2.0 * math.cos(t), 2.0 * math.sin(t), radius) for t in turns]


def test_a_closed_ring_is_proven_by_some_of_its_discs() -> None:
    status, rows, active, _ = route(ends(0, 0, 9, 1), *ring(12, 0.6), (20.0, 0.0, 1.0))
    assert status == CLOSED
    assert rows.shape == (0, 6)
    assert set(active) <= set(range(12))
    closing = [ring(12, 0.6)[k] for k in active]
    assert shortest_length((0.0, 0.0), (9.0, 1.0), *discs(*closing)) is None


@pytest.mark.parametrize(("missing", "found"), [(1, False), (2, True)])
def test_a_ring_is_left_through_a_gap_that_is_wide_enough(missing: int, *, found: bool) -> None:
    # Neighbours of 0.6 m stand 1.035 m apart: one missing leaves 2.0 - 1.2 = 0.8 m.
    both = ends(0, 0, 9, 1)
    status, rows, _, _ = route(both, *ring(12, 0.6 if found else 1.1, missing))
    assert (status == FOUND) is found
    if found:
        centres, radii = discs(*ring(12, 0.6, missing))
        expected = shortest_length((0.0, 0.0), (9.0, 1.0), centres, radii)
        assert length(rows, radii) == pytest.approx(expected, abs=2e-6)


@pytest.mark.parametrize(
    ("both", "status", "disc"),
    [
        (ends(5.5, 0.0, 9.0, 9.0), START_INSIDE, 1),
        (ends(9.0, 9.0, 5.5, 0.0), GOAL_INSIDE, 1),
        (ends(5.5, 0.0, 0.0, 0.5), START_INSIDE, 1),
        (ends(0.0, 0.5, 5.5, 0.0), START_INSIDE, 0),
    ],
)
def test_a_start_or_goal_in_a_disc_names_the_disc(both: Floats, status: int, disc: int) -> None:
    found = route(both, (0.0, 0.0, 1.0), (5.0, 0.0, 1.0))
    assert (found[0], found[2], found[3]) == (status, [disc], 0)


def test_as_many_active_discs_as_allowed_are_allowed() -> None:
    slalom = [(3.0, 0.9, 1.0), (7.0, -0.9, 1.0)]
    assert route(ends(0, 0, 10, 0), *slalom, active_max=2)[0] == FOUND
    status, rows, active, _ = route(ends(0, 0, 10, 0), *slalom, active_max=1)
    assert (status, rows.shape, len(active)) == (TOO_MANY, (0, 6), 1)


# ---------------------------------------------------------------- fence


def band(half_width_m: float) -> Floats:
    """|east| <= half_width_m."""
    return np.array(((0.0, 1.0, -half_width_m), (0.0, -1.0, -half_width_m)))


def test_a_fence_sends_the_route_round_the_other_side() -> None:
    # The shorter side, at -1.2, is outside of the band: the way leads over +2.8 in a wider one.
    disc = (0.0, 0.8, 2.0)
    status, rows, _, _ = route(ends(-5, 0, 5, 0), disc, planes=band(3.0))
    assert status == FOUND
    assert rows[1, 5] > 0.0
    one_sided = np.array(((0.0, 1.0, -1.1), (0.0, -1.0, -3.0)))
    status, rows, _, _ = route(ends(-5, 0, 5, 0), disc, planes=one_sided)
    assert status == FOUND
    assert rows[1, 5] < 0.0
    assert_is_one_smooth_way(rows, ends(-5, 0, 5, 0), *discs(disc))
    assert route(ends(-5, 0, 5, 0), disc, planes=band(1.1))[0] == CLOSED


def test_a_fence_through_the_arc_alone_bars_the_way() -> None:
    # Touching points of a disc of radius 1 seen from 1.25 m: at 0.6 m, its rim at 1 m.
    both, disc = ends(-1.25, 0, 1.25, 0), (0.0, 0.0, 1.0)
    for half_width, status in ((1.01, FOUND), (1.0, FOUND), (0.99, CLOSED), (0.7, CLOSED)):
        assert route(both, disc, planes=band(half_width))[0] == status


# ---------------------------------------------------------------- active discs and their chain


def lazily(
    both: Floats, rows: list[Disc], chain: list[int], active_max: int = 50
) -> tuple[int, Floats, Ints, int]:
    centres, radii = discs(*rows)
    labels, _ = kernels.join_overlapping(centres, radii)
    mask = np.zeros(len(rows), dtype=np.uint8)
    mask[chain] = 1
    field = Discs.joined(centres, radii, labels, mask).field
    return kernels.lazy_route(both, field, NO_PLANES, active_max, NO_SEEDS, math.inf)


WALL = [(2.0, -2.0 + 0.2 * k, 0.3) for k in range(21)]


def test_the_deepest_disc_of_a_cut_component_is_activated_first() -> None:
    status, _, active, _ = lazily(ends(0, 0.02, 4, 0.02), WALL, [], active_max=21)
    assert status == FOUND
    assert active[0] == 10


def test_the_chain_within_a_metre_and_a_half_is_activated_with_it() -> None:
    _, _, active, rounds = lazily(ends(0, 0.02, 4, 0.02), WALL, [0, 2, 3, 6, 9, 17, 18, 20])
    # Disc 10 at 0.0: 3 to 17 are within 1.4 m, 2 and 18 are 1.6 m away.
    assert active[:5].tolist() == [10, 3, 6, 9, 17]
    without = lazily(ends(0, 0.02, 4, 0.02), WALL, [])
    assert without[3] > rounds
    centres, radii = discs(*WALL)
    expected = shortest_length((0.0, 0.02), (4.0, 0.02), centres, radii)
    for found in (lazily(ends(0, 0.02, 4, 0.02), WALL, [0, 2, 3, 6, 9, 17, 18, 20]), without):
        assert length(found[1], radii) == pytest.approx(expected, abs=2e-6)


def test_a_chain_exactly_a_metre_and_a_half_away_is_left_out() -> None:
    rows = [(0.0, 0.0, 1.0), (0.0, 1.5, 1.0), (0.0, -1.4375, 1.0)]
    _, _, active, _ = lazily(ends(-3, 0, 3, 0), rows, [1, 2], active_max=2)
    assert active.tolist() == [0, 2]


def test_only_the_chain_of_the_component_that_is_cut_is_activated() -> None:
    rows = [(0.0, 0.0, 0.5), (0.0, 0.9, 0.5), (0.0, -1.2, 0.5), (0.0, -2.0, 0.5)]
    status, _, active, _ = lazily(ends(-3, 0.1, 3, 0.1), rows, [0, 1, 2, 3])
    assert status == FOUND
    assert active[:2].tolist() == [0, 1]


def test_one_disc_of_every_component_that_a_piece_cuts_is_activated_at_once() -> None:
    rows = [(2.0, 0.1, 0.5), (5.0, -0.1, 0.5), (8.0, 0.2, 0.5), (8.0, -0.3, 0.5)]
    _, _, active, rounds = lazily(ends(0, 0, 10, 0), rows, [])
    assert active[:3].tolist() == [0, 1, 2]
    assert rounds <= 3
