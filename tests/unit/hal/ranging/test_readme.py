"""What hal/ranging/README.md shows is what works."""

from pathlib import Path

import yaml

from autonomy.config import load_config
from hal.config import I2cDriver
from tests.support.readme_driver import README, example

EXAMPLE_LINES = 60


def test_the_worked_example_is_short() -> None:
    """That it passes the contract suite is tested there."""
    assert len(example().splitlines()) < EXAMPLE_LINES


def test_the_configuration_shown_is_valid(tmp_path: Path) -> None:
    shown = README.read_text(encoding="utf-8").split("```yaml\n")[1].split("```")[0]
    path = tmp_path / "shown.yaml"
    path.write_text(shown, encoding="utf-8")
    beams = load_config(path).beams
    driver = beams.drivers[0]
    assert isinstance(driver, I2cDriver)
    assert len(driver.sensors) == len(yaml.safe_load(shown)["beams"]["drivers"][0]["sensors"])
    assert [mount.name for mount in beams.over_mavlink()] == ["up"]
