"""The shipped documents say what the program does."""

import configparser
import re
from pathlib import Path
from typing import Any

import pytest
import yaml
from pydantic import ValidationError

from autonomy.config import Config, load_config
from hal.errors import DocumentError

CONFIGS = Path(__file__).parents[3] / "configs"


def keys(tree: Any, prefix: str = "") -> set[str]:
    """Every key of nested mappings as a dotted path."""
    if not isinstance(tree, dict):
        return {prefix}
    return {key for name, below in tree.items() for key in keys(below, f"{prefix}.{name}")}


def test_the_default_document_is_the_built_in_configuration() -> None:
    assert load_config(CONFIGS / "default.yaml") == Config()


def test_the_default_document_writes_out_every_key() -> None:
    written = yaml.safe_load((CONFIGS / "default.yaml").read_text(encoding="utf-8"))
    assert keys(written) == keys(Config().model_dump(mode="json"))


def test_every_key_of_the_default_document_has_a_comment_or_an_explained_parent() -> None:
    text = (CONFIGS / "default.yaml").read_text(encoding="utf-8")
    alone = {"mounts", "polygon_ne_m", "takeoff_timeout_s", "land_timeout_s", "enabled"}
    bare = [
        match[1]
        for match in re.finditer(r"^ +(\w+):[^#\n]*[^#\s][^#\n]*$", text, re.MULTILINE)
        if match[1] not in alone
    ]
    assert bare == []


def test_the_readme_explains_every_section() -> None:
    text = (CONFIGS / "README.md").read_text(encoding="utf-8")
    for section in Config.model_fields:
        assert f"| `{section}` |" in text


def test_an_unknown_key_is_refused_with_its_line(tmp_path: Path) -> None:
    path = tmp_path / "a.yaml"
    path.write_text("mission:\n  altitude: 1.0\n")
    with pytest.raises(DocumentError, match=r"a.yaml:2: mission.altitude: is not a known key"):
        load_config(path)


def test_a_vehicle_that_sees_nothing_ahead_is_refused_with_the_key_and_the_remedy() -> None:
    upright = [mount for mount in Config().beams.mounts if not mount.horizontal]
    with pytest.raises(ValidationError, match=r"beams\.mounts: none .* level.*pitch_deg"):
        Config.model_validate({"beams": {"mounts": [mount.model_dump() for mount in upright]}})


def test_the_service_unit_is_watched_and_hardened() -> None:
    unit = configparser.RawConfigParser(strict=False)
    unit.optionxform = str  # type: ignore[assignment,method-assign]  # the documented way to keep case
    unit.read(CONFIGS / "autonomy.service", encoding="utf-8")
    service = unit["Service"]
    assert service["Type"] == "notify"
    assert float(service["WatchdogSec"].removesuffix("s")) <= 2.0
    assert float(service["TimeoutStopSec"].removesuffix("s")) > Config().mission.land_timeout_s
    assert service["NoNewPrivileges"] == "yes"
    assert service["ProtectSystem"] == "strict"
    # numba writes machine code at run time.
    assert "MemoryDenyWriteExecute" not in service


@pytest.mark.parametrize(
    "path", sorted((CONFIGS / "vehicles").glob("*.yaml")), ids=lambda p: p.stem
)
def test_every_example_of_a_vehicle_is_valid(path: Path) -> None:
    assert load_config(path) != Config()


@pytest.mark.parametrize(
    ("section", "key"),
    [
        ("map", "corridor_hit_m"),
        ("map", "corridor_seen_m"),
        ("guard", "beam_stop_m"),
        ("guidance", "slowest_at_m"),
        ("guidance", "push_below_m"),
    ],
)
def test_no_distance_that_keeps_the_body_clear_may_be_inside_it(section: str, key: str) -> None:
    with pytest.raises(ValidationError, match=f"{section}.{key}"):
        Config.model_validate({section: {key: 0.15}})
