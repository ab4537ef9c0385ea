"""configs/README.md tells of every key what the models say, and of every refusal what is said."""

import ast
import inspect
import sys
from pathlib import Path
from types import ModuleType

import pytest
from pydantic import ValidationError

from autonomy import config as mission_side
from autonomy.config import Config
from hal import config as hardware_side
from hal.documents import validate_document
from hal.errors import DocumentError
from tools import config_page
from tools.config_refusals import RULES


def test_the_page_is_up_to_date() -> None:
    assert config_page.page() == config_page.PAGE.read_text(encoding="utf-8"), (
        "run python -m tools.config_page --write"
    )


def test_every_key_of_every_section_is_on_the_page_with_a_meaning_and_a_refusal() -> None:
    rows = {(t.place, row.key): row for t in config_page.tables() for row in t.rows}
    told = {model for model in config_page.models().values() if model.model_fields}
    bases = {base for model in told for base in model.__mro__[1:]}
    leaves = told - bases - {Config}
    assert len(rows) >= sum(len(model.model_fields) for model in leaves)
    sections = {"a section"}
    for row in rows.values():
        assert row.meaning
        assert row.bounds
        assert row.refusal or row.bounds in sections


def test_a_key_s_row_says_unit_default_bounds_and_what_is_said() -> None:
    rows = {(t.place, row.key): row for t in config_page.tables() for row in t.rows}
    speed = rows["guidance", "speed_max_m_s"]
    assert speed[1:4] == ("m/s", "`0.2`", "> 0")
    assert "greater than 0, not 0" in speed.refusal
    kp = rows["guidance.position", "kp"]
    assert kp.bounds == "0 to 100"
    sensor = "beams.drivers (driver: i2c).sensors (chip: vl53l0x)"
    assert rows[sensor, "mux_address"].bounds == "0x70 to 0x77 or `null`"
    assert rows[sensor, "beam"].default == "required"
    assert rows["mission.replan", "mode"].bounds == '`"stop"`, `"rolling"`'


def raising(module: ModuleType) -> set[tuple[str, int]]:
    """Where the sections of a module refuse."""
    sections = [c for c in ast.parse(inspect.getsource(module)).body if isinstance(c, ast.ClassDef)]
    raises = (n for c in sections for n in ast.walk(c) if isinstance(n, ast.Raise))
    return {(module.__name__, node.lineno) for node in raises}


def test_every_rule_between_keys_is_on_the_page() -> None:
    seen = set()
    for document in RULES:
        with pytest.raises(ValidationError) as refused:
            Config.model_validate(document)
        for each in refused.value.errors():
            error = each.get("ctx", {}).get("error")
            if isinstance(error, ValueError) and error.__traceback__ is not None:
                place = error.__traceback__
                seen.add((place.tb_frame.f_globals["__name__"], place.tb_lineno))
    assert seen == raising(mission_side) | raising(hardware_side)


def test_a_page_that_is_out_of_date_is_told_and_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = config_page.PAGE.read_text(encoding="utf-8")
    copy = tmp_path / "README.md"
    copy.write_text(text.replace("| m/s |", "| knots |"), encoding="utf-8")
    monkeypatch.setattr(config_page, "PAGE", copy)
    monkeypatch.setattr(sys, "argv", ["config_page"])
    with pytest.raises(SystemExit, match="config_page --write"):
        config_page.main()
    monkeypatch.setattr(sys, "argv", ["config_page", "--write"])
    config_page.main()
    assert copy.read_text(encoding="utf-8") == text


@pytest.mark.parametrize(
    ("document", "sentence"),
    [
        ({"mission": {"land_at_end": "perhaps"}}, "should be true or false, not 'perhaps'"),
        ({"beams": {"mounts": "front"}}, "beams.mounts: should be a list, not 'front'"),
        ({"map": {"hit_gain": 1.5}}, "map.hit_gain: should be a whole number, not 1.5"),
        ({"mission": 5}, "mission: should be a section, with keys of its own, not 5"),
        ({"log": {"directory": 5}}, "log.directory: should be text; put it into quotes, not 5"),
        ({"mission": {"altitude_m": "high"}}, "mission.altitude_m: should be a number, not 'high'"),
    ],
)
def test_a_value_of_the_wrong_kind_is_refused_in_words_of_the_document(
    document: dict[str, object], sentence: str
) -> None:
    with pytest.raises(DocumentError, match=sentence):
        validate_document(document, Config, "a.yaml")


def test_a_wrong_entry_of_a_list_is_one_complaint() -> None:
    driver = {"driver": "i2c", "sensors": [{"chip": "vl53l0x", "beam": "front", "address": 0x30}]}
    with pytest.raises(DocumentError) as refused:
        validate_document({"beams": {"drivers": [driver]}}, Config, "a.yaml")
    assert "without xshut" in str(refused.value)
    assert "more)" not in str(refused.value)
    with pytest.raises(DocumentError, match="at least 1 item"):
        validate_document({"beams": {"drivers": []}}, Config, "a.yaml")
