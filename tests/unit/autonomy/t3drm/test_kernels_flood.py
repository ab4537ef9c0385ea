"""Which discs the free space around start meets: in parts, and that it changes no answer."""

import math

import numpy as np
import pytest

from autonomy.t3drm import kernels
from autonomy.t3drm.kernels import CLOSED, FOUND, Field, Floats, Mask

Disc = tuple[float, float, float]
CELL_M = 0.25


def field_of(*rows: Disc) -> Field:
    table = np.array(rows, dtype=np.float64).reshape(-1, 3)
    centres, radii = table[:, :2].copy(), table[:, 2].copy()
    labels, chain = kernels.join_overlapping(centres, radii)
    widest = float(radii.max()) if len(radii) else 0.0
    return centres, radii, labels, chain, kernels.into_squares(centres, widest)


def everyone(field: Field) -> "np.typing.NDArray[np.int64]":
    return np.arange(field[1].shape[0], dtype=np.int64)


def ring(radius: float, count: int, at: float, thick: float) -> list[Disc]:
    turns = [math.tau * k / count for k in range(count)]
    return [(at + radius * math.cos(t), at + radius * math.sin(t), thick) for t in turns]


# ---------------------------------------------------------------- in parts


def test_the_window_holds_ends_and_discs_and_a_free_rim() -> None:
    field = field_of((3.0, 4.0, 1.0), (5.0, 2.0, 2.0), (90.0, 90.0, 1.0))
    ends = np.array(((1.0, 6.0), (9.0, 1.0)))
    box, shape = kernels._window(ends, field, np.array((0, 1)))
    # From 1 to 9 north, 0 to 6 east; a quarter of the least radius is a cell.
    assert box.tolist() == [0.5, -0.5, 0.25]
    assert shape.tolist() == [37, 29]
    alone, _ = kernels._window(ends, field, np.array((1,)))
    assert alone.tolist() == [0.0, -1.0, 0.5]


def test_a_wide_window_has_wide_cells() -> None:
    field = field_of((3.0, 4.0, 0.1))
    box, shape = kernels._window(np.array(((0.0, 0.0), (1.0, 32.0))), field, everyone(field))
    assert box[2] == pytest.approx(0.2)
    assert shape[1] in (164, 165)  # 162 cells by rounding or not, and the rim


def test_a_cell_is_covered_when_one_disc_holds_it_all() -> None:
    rng = np.random.default_rng(3)
    rows = [(float(n), float(e), float(r)) for n, e, r in rng.uniform(0.1, 3.9, (9, 3))]
    rows += [(2.0, 2.0, 0.1), (2.125, 1.125, 0.17678), (3.125, 1.125, 0.19), (80.0, 0.0, 1.0)]
    rows = [(n, e, min(r, 1.2)) for n, e, r in rows]
    field = field_of(*rows)
    box, shape = np.array((-0.5, -0.25, CELL_M)), np.array((20, 17))
    covered, near = kernels._covered(field, box, shape)
    assert 12 not in near
    assert set(range(12)) <= set(near.tolist())
    for r in range(20):
        for c in range(17):
            n, e = -0.5 + (r + 0.5) * CELL_M, -0.25 + (c + 0.5) * CELL_M
            deep = max(radius - math.hypot(n - a, e - b) for a, b, radius in rows)
            # Its corners are 0.7071 cells from its centre.
            if abs(deep - 0.7072 * CELL_M) > 1e-9:
                assert covered[r, c] == (deep > 0.7072 * CELL_M)


def drawn(*lines: str) -> Mask:
    return np.array([[int(mark == "#") for mark in line] for line in lines], dtype=np.uint8)


def test_space_spreads_round_corners_but_not_through_walls() -> None:
    found = kernels._spread(drawn("..#..", "..#..", ".#...", "#.#.#", "...#."), 0, 0)
    assert found.tolist() == [
        [2, 2, 1, 2, 2],
        [2, 2, 1, 2, 2],
        [2, 1, 2, 2, 2],
        [1, 2, 1, 2, 1],
        [2, 2, 2, 1, 2],
    ]
    apart = kernels._spread(drawn("..#..", "..#..", "..#.."), 2, 4)
    assert apart.tolist() == [[0, 0, 1, 2, 2]] * 3


@pytest.mark.parametrize(("radius", "meets"), [(0.5, False), (0.57, False), (0.58, True)])
def test_a_disc_meets_a_free_cell_that_it_comes_near(radius: float, *, meets: bool) -> None:
    around = np.ones((12, 12), dtype=np.uint8)
    # Its centre is (1.125, 1.625), 0.75 m from the disc's.
    around[4, 6] = 2
    box = np.array((0.0, 0.0, CELL_M))
    for n, e in ((1.875, 1.625), (0.375, 1.625), (1.125, 0.875), (1.125, 2.375)):
        assert kernels._meets_free(around, box, n, e, radius) is meets
    around[4, 6] = 0
    assert not kernels._meets_free(around, box, 1.875, 1.625, 0.9)


def test_what_was_set_aside_is_taken_back_once() -> None:
    flags = np.array((0, 2, 1, 2), dtype=np.uint8)
    assert kernels._take_back(flags)
    assert flags.tolist() == [0, 0, 1, 0]
    assert not kernels._take_back(flags)


# ---------------------------------------------------------------- together


def test_discs_in_a_closed_room_elsewhere_are_set_aside() -> None:
    outer = ring(1.5, 24, 3.0, 0.3)
    inner = [(3.0, 3.0, 0.2), (3.3, 3.0, 0.2)]
    loose = [(6.0, 0.5, 0.3)]
    field = field_of(*outer, *inner, *loose)
    flags = np.ones(27, dtype=np.uint8)
    active = everyone(field)
    ends = np.array(((0.0, 0.0), (7.0, 7.0)))
    kept, closing = kernels._set_aside(ends, field, active, flags)
    assert closing.tolist() == []
    assert flags.tolist() == [1] * 24 + [2, 2, 1]
    assert active[:kept].tolist() == [*range(24), 26]


def test_where_free_space_does_not_reach_the_goal_its_border_is_the_proof() -> None:
    outer = ring(1.5, 24, 3.0, 0.3)
    inner = [(3.5, 3.0, 0.2)]
    loose = [(6.0, 0.5, 0.3)]
    field = field_of(*outer, *inner, *loose)
    ends = np.array(((2.7, 3.0), (7.0, 7.0)))
    flags = np.ones(26, dtype=np.uint8)
    _, closing = kernels._set_aside(ends, field, everyone(field), flags)
    assert sorted(closing.tolist()) == [*range(25)]


def test_what_is_not_active_does_not_close_the_rim_of_the_window() -> None:
    wall = [(0.0, 0.25 * k, 0.3) for k in range(-8, 9)]
    # They go on where the window ends, and end themselves a little further out.
    beyond = [(0.0, -2.7, 0.6), (0.0, 2.7, 0.6)]
    field = field_of(*wall, *beyond)
    ends = np.array(((-1.0, 0.0), (1.0, 0.0)))
    flags = np.ones(19, dtype=np.uint8)
    kept, closing = kernels._set_aside(ends, field, np.arange(17), flags)
    assert closing.tolist() == []
    assert kept == 17


def room(gap: bool) -> list[Disc]:
    """A ring of 60 discs around (3, 3) in which 40 more lie about, without or with a door."""
    rng = np.random.default_rng(8)
    walls = ring(2.0, 60, 3.0, 0.2)[: 57 if gap else 60]
    clutter = [(5.5 + n, e, 0.15) for n, e in rng.uniform(0.0, 1.5, (40, 2)).tolist()]
    return walls + clutter


def length(rows: Floats, radii: Floats) -> float:
    total = 0.0
    for an, ae, bn, be, disc, sweep in rows.tolist():
        straight = math.hypot(bn - an, be - ae)
        total += straight if disc < 0 else float(radii[int(disc)]) * abs(sweep)
    return total


@pytest.mark.parametrize("gap", [True, False])
def test_setting_discs_aside_changes_no_answer(*, gap: bool) -> None:
    field = field_of(*room(gap))
    ends = np.array(((3.0, 3.0), (8.0, 1.0)))
    planes = np.empty((0, 3))
    some = np.empty(0, dtype=np.int64)
    # With every disc as a seed there are more than FLOOD_FROM from the beginning.
    plain = kernels.lazy_route(ends, field, planes, 400, some, math.inf)
    seeded = kernels.lazy_route(ends, field, planes, 400, everyone(field), math.inf)
    assert plain[0] == seeded[0] == (FOUND if gap else CLOSED)
    if gap:
        assert length(seeded[1], field[1]) == pytest.approx(length(plain[1], field[1]), abs=1e-6)
