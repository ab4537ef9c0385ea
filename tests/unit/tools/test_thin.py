"""How thin an obstacle may be: which courses are flown, what is measured, how it is told."""

import math
from pathlib import Path

import msgspec
import pytest

from autonomy.simulation import goal_of
from hal.sim.scenario import Wall
from tools import pages
from tools.bench.rooms import shipped_config
from tools.thin import __main__ as command
from tools.thin.flights import (
    HALF_ANGLES_DEG,
    KINDS,
    OTHER_WAYS,
    POST,
    THICKNESSES_M,
    WALL_END,
    Case,
    Flight,
    cases,
    course,
    fly,
    otherwise,
)
from tools.thin.report import at_most, safe_from_m, section

NEAR_M = 0.3
"""Beside what is nearer than this the vehicle slows down."""


def flight(case: Case, **more: object) -> Flight:
    data: dict[str, object] = {
        "ending": "goal_reached",
        "collided": False,
        "clearance_m": 0.25,
        "first_m": (0.9, 0.8),
        "wall_s": 0.3,
    }
    return Flight(case, **(data | more))  # type: ignore[arg-type]  # a keyword each


def lines(text: str) -> list[str]:
    """The tables' lines without their heads."""
    found = [line for line in text.splitlines() if line.startswith("| ")]
    return [line for line in found if "flights" not in line and "---" not in line]


@pytest.mark.parametrize("kind", KINDS)
def test_the_obstacles_stand_on_the_line_and_a_wall_shows_the_vehicle_its_end(kind: str) -> None:
    for seed in range(20):
        case = Case(kind, 0.01, 0.0, seed)
        places, scenario = course(case)
        goal = scenario.goal_ne_m
        length_m = math.hypot(*goal)
        ahead = (goal[0] / length_m, goal[1] / length_m)
        assert length_m == pytest.approx(2.4)
        for place, obstacle in zip(places, scenario.obstacles[-2:], strict=True):
            assert abs(ahead[0] * place[1] - ahead[1] * place[0]) <= 0.03
            along_m = ahead[0] * place[0] + ahead[1] * place[1]
            face_m = along_m - (case.thickness_m / 2.0 if kind == POST else 0.0) - 1e-6
            before = tuple(a + (face_m - along_m) * b for a, b in zip(place, ahead, strict=True))
            assert obstacle.distance_m(*before) == pytest.approx(1e-6, abs=1e-9)
            if isinstance(obstacle, Wall):
                assert obstacle.from_ne_m == place
                assert obstacle.to_ne_m == pytest.approx(
                    (place[0] + 0.3 * ahead[0], place[1] + 0.3 * ahead[1])
                )
        assert goal_of(scenario, shipped_config(scenario, "rolling"))[:2] == goal


def test_the_same_seed_is_the_same_course_for_every_thickness_and_beam() -> None:
    found = {
        course(case)[0]
        for case in cases(THICKNESSES_M, HALF_ANGLES_DEG, range(3, 4))
        if case.kind == POST
    }
    assert len(found) == 1
    assert course(Case(WALL_END, 0.01, 0.0, 3))[0] in found
    assert course(Case(POST, 0.01, 0.0, 4))[0] not in found


@pytest.mark.parametrize("half_angle_deg", HALF_ANGLES_DEG)
def test_a_post_of_6_cm_is_on_the_map_before_it_is_near(half_angle_deg: float) -> None:
    for seed in range(2):
        found = fly(Case(POST, 0.06, half_angle_deg, seed))
        assert found.ending == "goal_reached"
        assert not found.collided
        assert found.clearance_m > 0.15
        assert all(far_m is not None and NEAR_M < far_m < 1.1 for far_m in found.first_m)


def test_a_needle_of_2_mm_is_met_too_late_or_never() -> None:
    needles = [fly(Case(POST, 0.002, 0.0, seed)) for seed in range(3)]
    assert any(far_m is None or far_m < NEAR_M for found in needles for far_m in found.first_m)
    assert any(found.collided for found in needles)
    assert "no thickness of a post was free of touches" in section(needles)


def test_a_flight_is_the_same_again_and_slower_or_faster_ones_are_others() -> None:
    case = Case(WALL_END, 0.02, 0.0, 1)
    first, again = fly(case), fly(case)
    assert msgspec.structs.replace(again, wall_s=first.wall_s) == first
    rate_hz, speed_m_s = OTHER_WAYS[1]
    slower = fly(msgspec.structs.replace(case, rate_hz=rate_hz, speed_m_s=speed_m_s))
    assert slower.ending == "goal_reached"
    assert slower.first_m != first.first_m


def test_every_beam_kind_and_thickness_has_its_line_and_a_touch_is_not_hidden() -> None:
    asked = [*cases(THICKNESSES_M, HALF_ANGLES_DEG, range(2)), *otherwise(range(2))]
    thin = Case(POST, 0.008, 0.0, 1)
    rows = [
        flight(case, collided=True, clearance_m=0.02, first_m=(0.1, None))
        if case == thin
        else flight(case)
        for case in asked
    ]
    text = section(list(dict.fromkeys(rows)))
    assert len(lines(text)) == 2 * 2 * len(THICKNESSES_M) + 2 * (1 + len(OTHER_WAYS))
    assert "| post | 0.8 | 2 | 1 | 2 | 0.020 | 0.45 | never (1 of 4) |" in text
    assert "| post | 1 | 2 | 0 | 2 | 0.250 | 0.85 | 0.80 |" in text
    assert (
        "Thin beams: no post of 1 cm or more was touched (2 flights at 1 cm, so fewer than" in text
    )
    assert "no wall's end of 0.8 cm or more was touched (2 flights at 0.8 cm" in text
    assert "| 0.8 | 20 | 0.1 | 2 | 0 |" in text


def test_safe_is_a_thickness_only_when_nothing_thicker_was_touched() -> None:
    rows = [flight(Case(POST, cm / 100.0, 0.0, 0)) for cm in (1.0, 2.0, 3.0)]
    assert safe_from_m(rows) == 0.01
    touched, not_again = (flight(Case(POST, 0.02, 0.0, 1 + n), collided=n == 0) for n in range(2))
    assert safe_from_m([*rows, touched, not_again]) == 0.03
    assert safe_from_m([*rows, flight(Case(POST, 0.03, 0.0, 1), collided=True)]) is None


def test_no_touch_in_few_flights_promises_little() -> None:
    assert at_most(1) == pytest.approx(0.95)
    assert at_most(300) == pytest.approx(0.01, rel=0.01)


def test_what_was_flown_is_not_flown_again(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    kept = tmp_path / "rows"
    known = [flight(case, clearance_m=0.777) for case in cases((0.015,), (0.0,), range(2))]
    kept.write_bytes(b"".join(msgspec.json.encode(row) + b"\n" for row in known))
    asked = ["--thickness", "1.5", "--half-angle", "0", "--flights", "2", "--rows", str(kept)]
    assert command.main(asked) == 0
    assert "| post | 1.5 | 2 | 0 | 2 | 0.777 |" in capsys.readouterr().out
    assert len(kept.read_bytes().splitlines()) == len(known)


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        (["--thickness", "0"], "0 cm: give more than 0, and at most 20"),
        (["--flights", "0"], "fly at least one"),
    ],
)
def test_what_cannot_be_flown_is_refused(
    asked: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        command.main(asked)
    assert said in capsys.readouterr().err


def test_the_page_has_a_place_for_it() -> None:
    page = command.README.read_text(encoding="utf-8")
    assert "new\n\n<!-- thin: end -->" in pages.renewed(page, "thin", "new")
