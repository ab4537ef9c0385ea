"""Whose mode it is, request by request and heartbeat by heartbeat."""

import pytest

from autonomy.custody import Custody
from hal.readings import FlightMode
from hal.setpoints import RequestKind

M, R = FlightMode, RequestKind


def custody(*story: RequestKind | FlightMode) -> Custody:
    """After requests were asked and modes were seen, in this order."""
    known = Custody()
    for step in story:
        if isinstance(step, RequestKind):
            known.asked(step)
        else:
            known.see(step)
    return known


FLOWN = (R.ARM, R.TAKEOFF, M.TAKEOFF, M.HOLD, R.OFFBOARD, M.OFFBOARD)


@pytest.mark.parametrize(
    ("story", "held"),
    [
        ((), set()),
        ((R.HOLD, M.HOLD, R.ARM), set()),
        ((R.ARM, R.TAKEOFF), {M.TAKEOFF, M.HOLD}),
        ((R.TAKEOFF, M.HOLD, R.OFFBOARD), {M.TAKEOFF, M.HOLD, M.OFFBOARD}),
        (FLOWN, {M.OFFBOARD}),
        ((*FLOWN, R.HOLD), {M.OFFBOARD, M.HOLD}),
        ((*FLOWN, R.HOLD, M.HOLD), {M.HOLD}),
        ((*FLOWN, R.HOLD, M.OFFBOARD, R.LAND), {M.OFFBOARD, M.HOLD, M.LAND}),
        ((*FLOWN, R.LAND, R.LAND), {M.OFFBOARD, M.LAND}),
        ((*FLOWN, R.LAND, M.LAND, R.LAND, R.DISARM), {M.LAND}),
    ],
)
def test_a_mode_is_ours_while_it_follows_from_what_was_asked(
    story: tuple[RequestKind | FlightMode, ...], held: set[FlightMode]
) -> None:
    assert {mode for mode in FlightMode if custody(*story).holds(mode)} == held


def test_what_was_let_go_is_not_regained_by_asking() -> None:
    known = custody(*FLOWN)
    known.let_go()
    known.asked(R.HOLD)
    known.asked(R.LAND)
    assert not any(known.holds(mode) for mode in FlightMode)
