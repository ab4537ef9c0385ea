"""Looking at beams on a vehicle's link: nothing is commanded, every beam is heard."""

import pytest

from autonomy.beam_watch import bar_lines, watch
from autonomy.config import Config
from autonomy.embedded import EmbeddedPx4

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
