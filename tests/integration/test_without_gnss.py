"""`fly` where there is no GNSS, no global position and no home: over real MAVSDK and MAVLink."""

from pathlib import Path

import pytest

from tests.support.flying import BODY_RADIUS_M, Flying, never_harmed, on_the_ground
from tests.support.mock_px4 import MockProcess

pytestmark = pytest.mark.integration

LIMIT_S = 300.0
ROOM = """
name: no_gnss
gnss: {present: false}
obstacles:
  - {kind: disc, centre_ne_m: [1.5, 0.6], radius_m: 0.2}
goal_ne_m: [2.5, 1.0]
vehicle: {parameters: {COM_OBL_RC_ACT: 5, SYS_HAS_GPS: 0}}
"""


def test_the_goal_is_reached_without_gnss(tmp_path: Path) -> None:
    room = tmp_path / "room.yaml"
    room.write_text(ROOM, encoding="utf-8")
    with (
        MockProcess(tmp_path, "--scenario", str(room)) as mock,
        Flying(
            tmp_path / "flight",
            *("--goal", "2.5,1", "--mode", "rolling", "--connection", mock.connection),
        ) as flying,
    ):
        flying.wait_for_note("no GNSS receiver")
        assert flying.end(LIMIT_S) == 0, (flying.lines[-1], flying.errors)
        truth = mock.truth()
    never_harmed(truth)
    assert on_the_ground(truth)
    assert min(t["clearance_m"] for t in truth if t["in_air"]) > BODY_RADIUS_M
    assert not any(t["mode"] == "hold" for t in truth if t["in_air"])
