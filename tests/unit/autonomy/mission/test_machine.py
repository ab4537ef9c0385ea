"""The mission's table of transitions."""

import pytest

from autonomy.mission.machine import NAVIGATING_STATES, OFFBOARD_STATES, TRANSITIONS
from autonomy.model import MissionState
from tools.machine import README, renewed


def reachable(start: MissionState) -> set[MissionState]:
    seen, todo = {start}, [start]
    while todo:
        for state in TRANSITIONS[todo.pop()]:
            if state not in seen:
                seen.add(state)
                todo.append(state)
    return seen


def test_every_state_is_in_the_table_and_reachable() -> None:
    assert set(TRANSITIONS) == set(MissionState)
    assert reachable(MissionState.PREFLIGHT) == set(MissionState)


def test_every_state_can_end() -> None:
    for state in MissionState:
        assert MissionState.DONE in reachable(state)


def test_every_flying_state_can_land_and_let_go() -> None:
    for state in OFFBOARD_STATES | {MissionState.TAKEOFF}:
        assert MissionState.LAND in TRANSITIONS[state]
        assert MissionState.YIELDED in TRANSITIONS[state]


def test_nothing_goes_back_to_arming() -> None:
    for state in MissionState:
        if state is not MissionState.PREFLIGHT:
            assert MissionState.ARM not in TRANSITIONS[state]
    assert MissionState.DONE not in {s for n in NAVIGATING_STATES for s in TRANSITIONS[n]}


def test_every_state_that_navigates_can_hold_return_land_and_let_go() -> None:
    for state in NAVIGATING_STATES:
        responses = {
            MissionState.HOLD,
            MissionState.RETURN,
            MissionState.LAND,
            MissionState.YIELDED,
        }
        assert responses - {state} <= TRANSITIONS[state]


def test_the_readme_shows_machine_and_faults_as_they_are() -> None:
    page = README.read_text(encoding="utf-8")
    assert renewed(page) == page, "run python -m tools.machine --write"


def test_a_page_without_its_markers_is_told() -> None:
    with pytest.raises(ValueError, match="markers"):
        renewed("# nothing here")
