"""Looking at beams on a vehicle's link: nothing is commanded, every beam is heard."""

from pathlib import Path

import pytest

from autonomy.beam_watch import bar_lines, watch
from autonomy.config import Config
from autonomy.embedded import EmbeddedPx4
from autonomy.vehicle_check import check_beams
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
            lambda recent, now_s: shown.append(bar_lines(config.beams, recent, now_s)),
        )
    assert {reading.beam for reading in readings} == {m.name for m in config.beams.mounts}
    assert len(shown) > 5
    assert not any(line.endswith("silent") for line in shown[-1])


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
