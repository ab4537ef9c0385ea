"""What stands for many worlds on the command line, and what is said of what does not."""

import json
from pathlib import Path

import pytest

from autonomy.errors import BadInput
from tools.bench.campaign.arena import arena, worlds
from tools.bench.campaign.case import Case
from tools.bench.campaign.models import RESPONSES, SENSORS, with_models
from tools.bench.worlds import scenario_of


@pytest.mark.parametrize(
    ("asked", "names"),
    [
        ("discs:7", ["discs:7"]),
        ("room:8-10", ["room:8", "room:9", "room:10"]),
        ("shipped:door", ["shipped:door"]),
    ],
)
def test_ranges_and_names(asked: str, names: list[str]) -> None:
    assert list(worlds(asked)) == names


def test_all_of_barn_and_all_that_is_shipped(tmp_path: Path) -> None:
    (tmp_path / "worlds.json").write_text(json.dumps({"3": [[-2.0, 8.0]], "9": []}))
    assert list(worlds("barn:all", tmp_path)) == ["barn:0", "barn:1"]
    assert "shipped:door" in list(worlds("shipped:all"))


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        ("discs", "names no world"),
        ("nowhere:3", "names no world"),
        ("discs:all", "is no range: write 7, or 0-99"),
        ("discs:9-3", "ends before it begins"),
        ("shipped:nowhere", "there is no scenario 'nowhere'"),
        ("file:nowhere.yaml", "nowhere.yaml"),
        ("barn:3", "needs the folder of the BARN data"),
        ("barn:all", "--barn FOLDER"),
    ],
)
def test_what_is_no_world_is_told_with_the_remedy(asked: str, said: str) -> None:
    with pytest.raises(BadInput, match=said):
        list(worlds(asked))


def test_a_folder_without_barn_is_told(tmp_path: Path) -> None:
    with pytest.raises(BadInput, match=r"has no worlds\.json of BARN"):
        list(worlds("barn:all", tmp_path))


def test_a_world_is_measured_once_in_a_process() -> None:
    assert arena("shipped:empty") is arena("shipped:empty")


def test_a_case_s_name_is_read_again_also_with_a_file_s_commas() -> None:
    case = Case("bug2/unguarded", "file:a,b/c.yaml", 3, "cone-12.5", "ideal")
    assert Case.parsed(case.name) == case


@pytest.mark.parametrize("name", ["x", "a,b,c", "p,w:1,x,thin,px4", "p,w:1,0,fat,px4", "7,"])
def test_what_names_no_flight_is_told(name: str) -> None:
    with pytest.raises(BadInput, match=r"names no flight|is not among thin"):
        Case.parsed(name)


def test_every_model_changes_what_it_says_and_nothing_else() -> None:
    plain = scenario_of("shipped:door")
    for sensors in SENSORS:
        for response in RESPONSES:
            changed = with_models(plain, sensors, response).model_dump()
            differing = {key for key, value in plain.model_dump().items() if changed[key] != value}
            wanted = {"cone-12.5": {"beams"}, "drift-4cm": {"estimator"}}.get(sensors, set())
            assert differing == wanted | ({"vehicle"} if response == "ideal" else set())
    drifting = with_models(plain, "drift-4cm", "px4").estimator
    assert (drifting.position_sigma_m, drifting.correlation_s) == (0.04, 5.0)
    assert with_models(plain, "cone-12.5", "px4").beams.half_angle_deg == 12.5
