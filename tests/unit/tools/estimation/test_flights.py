from pathlib import Path

import numpy as np
import pytest

from tools.estimation import page
from tools.estimation.consistency import consistency
from tools.estimation.flights import CASES, Case, Flown, fly

CASE = {case.name: case for case in CASES}


@pytest.fixture(scope="module")
def flown() -> dict[str, Flown]:
    return {case.name: fly(case, seed=2, seconds=45.0) for case in CASES}


def rms_m(errors_m: list[float]) -> float:
    return float(np.sqrt(np.mean(np.square(errors_m))))


@pytest.mark.parametrize("name", [case.name for case in CASES if not case.disturbed])
def test_undisturbed_the_state_is_where_the_autopilot_has_the_vehicle(
    flown: dict[str, Flown], name: str
) -> None:
    found = flown[name]
    assert rms_m(found.against_frame_m) < 0.005
    assert rms_m(found.fused_m) == pytest.approx(rms_m(found.autopilot_m), abs=0.01)
    assert all(found.usable)
    assert found.noticed_s is None


@pytest.mark.parametrize("name", [c.name for c in CASES if c.gnss_jump_m or c.gnss_drift_m_s])
def test_gnss_that_is_led_astray_is_told_and_moves_nothing(
    flown: dict[str, Flown], name: str
) -> None:
    found, calm = flown[name], flown["good GNSS"]
    if CASE[name].gnss_drift_m_s != 0.1:
        assert found.noticed_s is not None
        assert found.noticed_s < 12.0
    assert np.max(np.subtract(found.fused_m, calm.fused_m)) < 0.01


@pytest.mark.parametrize("name", ["good, autopilot resets", "good, frame jumps untold"])
def test_a_frame_that_jumps_moves_the_autopilot_and_not_what_is_flown_by(
    flown: dict[str, Flown], name: str
) -> None:
    found, calm = flown[name], flown["good GNSS"]
    assert found.noticed_s is not None
    assert found.noticed_s < 0.6
    assert max(found.autopilot_m) > 1.2
    assert max(found.fused_m) < max(calm.fused_m) + 0.03


def test_a_silent_autopilot_leaves_nothing_to_fly_by_until_it_speaks(
    flown: dict[str, Flown],
) -> None:
    found = flown["good, autopilot silent 2 s"]
    silent_ticks = found.usable.count(False)
    assert 30 <= silent_ticks <= 36
    assert found.noticed_s == pytest.approx(2.0, abs=0.11)


def test_the_same_seed_is_the_same_flight() -> None:
    assert fly(CASE["indoor GNSS"], 5, 10.0) == fly(CASE["indoor GNSS"], 5, 10.0)


def test_the_tables_have_a_row_for_each_case_and_the_picture_is_drawn(
    flown: dict[str, Flown], tmp_path: Path
) -> None:
    series = consistency(runs=3, seconds=2.0)
    lines = page.consistency_table(series).splitlines()
    assert len(lines) == 2 + len(series)
    flights: list[tuple[Case, list[Flown]]] = [(case, [flown[case.name]]) for case in CASES]
    table = page.error_table(flights).splitlines()
    assert [line.split("|")[1].strip() for line in table[2:]] == [case.name for case in CASES]
    assert "| - |" in table[2]  # no GNSS, nothing to tell
    assert "(1 is right)" in page.room_words(flights)
    page.draw_consistency(series, tmp_path / "one.png")
    page.draw_drift(flown["good, GNSS drifts 0.5 m/s"], tmp_path / "two.png")
    assert all((tmp_path / name).stat().st_size > 10_000 for name in ("one.png", "two.png"))
    assert "<!-- measured: begin -->" in page.README.read_text()
