import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from autonomy.geometry import Point
from autonomy.mission.escape import BARRED, CELL_M, Continuations

SPEED_M_S = 0.2
ROUND = Continuations(SPEED_M_S)
TIMES = ROUND.times_s(1.0, 7.0)
FREE = np.full(16, 5.0)


def moving(point: Point, velocity: Point) -> np.ndarray:
    """(1, times, 2) where a mover is."""
    return (np.array(point) + np.array(velocity) * TIMES[:, None])[None]


def kept(centres: np.ndarray, place: Point, reaches: np.ndarray = FREE) -> float:
    touching = np.full(centres.shape[:2], 0.35)
    cells = ROUND.of((0.0, 0.0), centres, touching, reaches)
    return float(ROUND.at(cells, (0.0, 0.0), np.array([place]))[0])


def straight(centres: np.ndarray, place: Point, velocity: Point) -> float:
    way = np.array(place) + np.array(velocity) * (TIMES - TIMES[0])[:, None]
    return float((np.hypot(*(way - centres).transpose(2, 0, 1)) - 0.35).min())


@given(
    north=st.floats(-1.5, 1.5),
    east=st.floats(-1.5, 1.5),
    vn=st.floats(-0.3, 0.3),
    ve=st.floats(-0.3, 0.3),
)
def test_the_best_way_keeps_at_least_what_waiting_keeps(
    north: float, east: float, vn: float, ve: float
) -> None:
    centres = moving((north, east), (vn, ve))
    best = kept(centres, (0.0, 0.0))
    assert best >= straight(centres, (0.0, 0.0), (0.0, 0.0)) - 1e-9
    # Nobody keeps more than there is when the search begins.
    assert best <= straight(centres[:, :1], (0.0, 0.0), (0.0, 0.0)) + 1e-9


def test_a_way_out_is_as_good_as_the_vehicle_is_quick() -> None:
    coming = moving((1.4, 0.0), (-0.2, 0.0))
    waiting = straight(coming, (0.0, 0.0), (0.0, 0.0))
    best = kept(coming, (0.0, 0.0))
    assert waiting < 0.0 < best
    aside = max(
        straight(coming, (0.0, 0.0), (SPEED_M_S * math.cos(a), SPEED_M_S * math.sin(a)))
        for a in np.linspace(0.0, 2.0 * math.pi, 64)
    )
    # Steps are on a grid, and a straight way is not the best one: neither is far from the other.
    assert abs(best - aside) < 2.0 * CELL_M


def test_a_corner_that_movers_close_is_worth_less_than_the_gap_between_them() -> None:
    both = np.concatenate((moving((-1.2, 0.2), (0.1, 0.0)), moving((1.2, 0.2), (-0.1, 0.0))))
    away_from_the_wall, at_the_wall = (0.0, 0.24), (0.0, -0.24)
    closed = np.where(np.sin(np.arange(16) * math.pi / 8.0) < -0.3, 0.3, 5.0)
    assert kept(both, away_from_the_wall, closed) > kept(both, at_the_wall, closed) + CELL_M


def test_where_nothing_is_seen_free_is_no_way() -> None:
    nobody = moving((9.0, 9.0), (0.0, 0.0))
    reaches = np.where(np.arange(16) == 0, 1.0, 0.0)
    assert kept(nobody, (0.8, 0.0), reaches) > 1.0
    assert kept(nobody, (-0.8, 0.0), reaches) == BARRED
    assert kept(nobody, (0.0, 0.8), reaches) == BARRED
    assert kept(nobody, (3.0, 0.0)) == BARRED


def test_the_search_lasts_until_the_horizon_in_steps_that_the_vehicle_can_fly() -> None:
    assert TIMES[0] == 1.0
    assert TIMES[-1] >= 7.0 > TIMES[-2]
    steps = np.diff(TIMES)
    assert np.allclose(steps, ROUND.step_s)
    assert CELL_M / ROUND.step_s < SPEED_M_S < math.sqrt(2.0) * CELL_M / ROUND.step_s
