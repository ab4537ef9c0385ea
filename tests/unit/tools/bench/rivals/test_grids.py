"""D* Lite's repairs are worth what A* finds from nothing, whatever changes on the way."""

import itertools
import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from tools.bench.rivals import kernels
from tools.bench.rivals.dstar_lite import Repair
from tools.bench.rivals.interface import Floats
from tools.bench.rivals.kernels import Ints

ROWS, COLUMNS = 14, 17


def price(cost: Floats, cells: Ints) -> float:
    places = [divmod(int(cell), COLUMNS) for cell in cells]
    total = 0.0
    for a, b in itertools.pairwise(places):
        assert max(abs(a[0] - b[0]), abs(a[1] - b[1])) == 1
        total += 0.5 * (cost[a] + cost[b]) * math.hypot(a[0] - b[0], a[1] - b[1])
    return total


def world(rng: np.random.Generator, blocked: float) -> Floats:
    cost = 1.0 + rng.integers(0, 3, (ROWS, COLUMNS)).astype(np.float64)
    cost[rng.random((ROWS, COLUMNS)) < blocked] = np.inf
    return cost


@given(seed=st.integers(0, 10_000), blocked=st.floats(0.0, 0.5))
@settings(max_examples=40, deadline=None)
def test_a_repaired_search_costs_what_a_new_one_does(seed: int, blocked: float) -> None:
    rng = np.random.default_rng(seed)
    repair, goal = Repair(), int(rng.integers(ROWS * COLUMNS))
    cost = world(rng, blocked)
    cost.flat[goal] = 1.0
    start = int(rng.integers(ROWS * COLUMNS))
    for _ in range(8):
        cost = cost.copy()
        for cell in rng.integers(0, ROWS * COLUMNS, 12).tolist():
            cost.flat[cell] = np.inf if rng.random() < blocked else 1.0 + rng.integers(0, 3)
        cost.flat[goal] = cost.flat[start] = 1.0
        new, repaired = kernels.astar(cost, start, goal), repair.solve(cost, start, goal)
        assert (len(new) == 0) == (len(repaired) == 0)
        if len(new):
            assert repaired[0] == new[0] == start
            assert repaired[-1] == new[-1] == goal
            assert math.isclose(price(cost, new), price(cost, repaired), rel_tol=1e-6)
            start = int(new[min(2, len(new) - 1)])


def test_nothing_changed_is_nothing_looked_at() -> None:
    cost = world(np.random.default_rng(3), 0.0)
    repair = Repair()
    repair.solve(cost, 0, ROWS * COLUMNS - 1)
    first = repair.expanded
    repair.solve(cost.copy(), 0, ROWS * COLUMNS - 1)
    assert repair.expanded * 10 < first


def test_a_way_pulled_taut_passes_no_cell_dearer_than_before() -> None:
    for seed in range(6):
        cost = world(np.random.default_rng(seed), 0.2)
        cost[0, 0] = cost[-1, -1] = 1.0
        cells = kernels.astar(cost, 0, ROWS * COLUMNS - 1)
        if not len(cells):
            continue
        kept = kernels.taut(cost, cells)
        assert kept[0] == cells[0]
        assert kept[-1] == cells[-1]
        assert set(kept.tolist()) <= set(cells.tolist())
        assert len(kept) <= len(cells)


def test_a_hit_blocks_what_is_within_the_keep_out_and_makes_dear_what_is_just_beyond() -> None:
    hit = np.array(((0.5, 0.5),))
    cost = kernels.lay(hit, 0.0, 0.0, 0.05, 21, 21, 0.2, 0.1, 2.0)
    rows, columns = np.mgrid[0:21, 0:21]
    away = np.hypot(rows * 0.05 - 0.5, columns * 0.05 - 0.5)
    assert np.isinf(cost[away < 0.199]).all()
    assert (cost[away > 0.301] == 1.0).all()
    between = (away > 0.201) & (away < 0.299)
    assert ((cost[between] > 1.0) & (cost[between] <= 3.0)).all()
    kernels.spare(cost, 10 * 21 + 10, 2.0)
    assert cost[10, 12] == kernels.DEAR
    assert np.isinf(cost[10, 13])
