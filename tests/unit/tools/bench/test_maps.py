"""Maps come from their seeds alone, and leave start and goal free."""

import json
from pathlib import Path

import numpy as np
import pytest

from tools.bench.maps import RANDOM_FAMILIES, barn_maps, families, random_map, spread_map


@pytest.mark.parametrize("row", range(len(RANDOM_FAMILIES)))
def test_a_map_repeats_and_its_ends_are_free(row: int) -> None:
    family = families(None)[row]
    for number in range(3):
        once, again = family.draw(number), family.draw(number)
        assert np.array_equal(once.centres, again.centres)
        assert np.array_equal(once.radii_m, again.radii_m)
        for end in (once.start, once.goal):
            assert (np.hypot(*(once.centres - end).T) > once.reach_m).all()
            assert once.low[0] < end[0] < once.high[0]
            assert once.low[1] < end[1] < once.high[1]


def test_maps_of_other_numbers_and_seeds_differ() -> None:
    one, two = families(None, seed=0)[2], families(None, seed=1)[2]
    assert not np.array_equal(one.draw(0).centres, one.draw(1).centres)
    assert not np.array_equal(one.draw(0).centres, two.draw(0).centres)


def test_a_map_has_the_discs_and_walls_that_were_asked_for() -> None:
    problem = random_map("", 6.0, 7, 3, np.random.default_rng(0))
    points = problem.centres[7:]
    assert (problem.radii_m[:7] >= 0.1).all()
    assert (problem.radii_m[7:] == 0.0).all()
    steps = np.hypot(*np.diff(points, axis=0).T)
    assert (steps > 0.055).sum() == 2
    assert steps[steps < 0.055].min() > 0.045


def test_a_spread_map_changes_only_elsewhere() -> None:
    small, large = (spread_map(n, np.random.default_rng(4)) for n in (20, 300))
    assert np.array_equal(small.centres, large.centres[:20])
    assert large.centres.shape == (300, 2)
    assert large.centres[20:].min() >= 8.0


def test_barn_worlds_are_read_in_order_with_y_as_north(tmp_path: Path) -> None:
    worlds = {"10": [[-1.0, 5.0]], "9": [[-2.0, 4.0], [-3.0, 6.0]]}
    (tmp_path / "worlds.json").write_text(json.dumps(worlds))
    first, second = barn_maps(tmp_path)
    assert first.name == "BARN 9"
    assert first.centres.tolist() == [[4.0, -2.0], [6.0, -3.0]]
    assert second.centres.tolist() == [[5.0, -1.0]]
    assert (first.start, first.goal) == ((3.0, -2.25), (13.0, -2.25))
    assert first.reach_m.tolist() == pytest.approx([0.275, 0.275])


def test_a_file_that_is_no_table_of_worlds_is_refused(tmp_path: Path) -> None:
    (tmp_path / "worlds.json").write_text("[]")
    with pytest.raises(TypeError, match=r"worlds\.json"):
        barn_maps(tmp_path)
