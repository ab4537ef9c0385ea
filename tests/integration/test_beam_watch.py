"""Looking at beams on a vehicle's link: nothing is commanded, every beam is heard."""

from pathlib import Path

import pytest

from autonomy.beam_watch import bar_lines, measure, watch
from autonomy.config import Config
from autonomy.embedded import EmbeddedPx4
from autonomy.vehicle_check import check_beams
from hal.config import BeamsConfig
from tests.support.mock_px4 import MockProcess

pytestmark = pytest.mark.integration


def test_all_beams_of_a_linked_vehicle_are_shown() -> None:
    config = Config()
    shown: list[tuple[str, ...]] = []
    with EmbeddedPx4("empty", 3) as px4:
        readings = watch(
            config,
            px4.connection,
            1.5,
            lambda recent, now_s, _: shown.append(bar_lines(config.beams, recent, now_s)),
        )
    assert {reading.beam for reading in readings} == {m.name for m in config.beams.mounts}
    assert len(shown) > 5
    assert not any(line.endswith("silent") for line in shown[-1])


def test_sensors_of_both_kinds_are_shown_and_what_is_not_there_is_told() -> None:
    """As in hal/ranging/README.md: a bus that this computer does not have, the rest on the link."""
    bus = {"driver": "i2c", "bus": "/dev/i2c-none", "sensors": [{"chip": "vl53l1x", "beam": "up"}]}
    beams = BeamsConfig.model_validate({"drivers": [bus, {"driver": "mavlink"}]})
    troubles: list[str] = []
    with EmbeddedPx4("empty", 3) as px4:
        readings = watch(
            Config(beams=beams), px4.connection, 1.0, lambda _, __, told: troubles.extend(told)
        )
        measured = measure(Config(beams=beams), px4.connection, "front", 0.5)
    others = {mount.name for mount in beams.over_mavlink()}
    assert {reading.beam for reading in readings} == others
    assert {reading.beam for reading in measured} == others
    assert any("/dev/i2c-none does not exist" in trouble for trouble in troubles)


def test_beams_that_a_companion_tells_as_a_ring_are_shown_beside_the_others(
    tmp_path: Path,
) -> None:
    config = Config()
    with MockProcess(tmp_path, "--scenario", "default", "--ring") as px4:
        readings = watch(config, px4.connection, 1.5)
        findings = check_beams(config, readings, 1.5)
    assert {reading.beam for reading in readings} == {m.name for m in config.beams.mounts}
    assert all(finding.good for finding in findings), findings
    around = [r for r in readings if config.beams.mount(r.beam).horizontal]
    assert len(around) > 4 * 15
