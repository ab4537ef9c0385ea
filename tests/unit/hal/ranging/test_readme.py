"""What hal/ranging/README.md shows is what works."""

from pathlib import Path

import pytest
import yaml
from pydantic import ValidationError

from autonomy.config import load_config
from hal import registry
from hal.clock import MonotonicClock
from hal.config import I2cDriver
from tests.support.readme_driver import README, beams_config, example, written

EXAMPLE_LINES = 60


def test_the_worked_example_is_short() -> None:
    """That it passes the contract suite is tested there."""
    assert len(example().splitlines()) < EXAMPLE_LINES


def test_a_section_says_of_its_beams_all_that_others_ask(monkeypatch: pytest.MonkeyPatch) -> None:
    names = written()
    config = beams_config(names["TfLunaDriver"])
    lunas = {"driver": "tf_luna", "addresses": {"front": 0x10, "left": 0x11}}
    beams = config.model_validate({"drivers": [lunas, {"driver": "mavlink"}]})
    assert [mount.name for mount in beams.wired()] == ["front", "left"]
    assert [mount.name for mount in beams.over_mavlink()] == ["right", "back", "up", "down"]
    assert beams.half_angle_deg("front") == 1.0
    assert [beams.latency_of(beams.mount(name)) for name in ("front", "up")] == [0.0, 0.02]
    assert [mount.name for mount in beams.only("left").mounts] == ["front", "left"]
    monkeypatch.setitem(registry.WIRED, names["TfLunaDriver"], names["TfLunas"])
    (sensor,) = registry.local_range_sensors(beams, MonotonicClock())
    assert isinstance(sensor, names["TfLunas"])
    with pytest.raises(ValidationError, match="nobody reads back, down, right, up"):
        config.model_validate({"drivers": [lunas]})
    with pytest.raises(ValidationError, match="beam front has two sensors"):
        config.model_validate({"drivers": [lunas, lunas, {"driver": "mavlink"}]})


def test_the_configuration_shown_is_valid(tmp_path: Path) -> None:
    shown = README.read_text(encoding="utf-8").split("```yaml\n")[1].split("```")[0]
    path = tmp_path / "shown.yaml"
    path.write_text(shown, encoding="utf-8")
    beams = load_config(path).beams
    driver = beams.drivers[0]
    assert isinstance(driver, I2cDriver)
    assert len(driver.sensors) == len(yaml.safe_load(shown)["beams"]["drivers"][0]["sensors"])
    assert [mount.name for mount in beams.over_mavlink()] == ["up"]
