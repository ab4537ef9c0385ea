"""A vehicle without range sensors in an empty world flies round obstacles that are not there."""

from pathlib import Path

import pytest
from pymavlink.dialects.v20 import common as mavlink

from tests.support.flying import BODY_RADIUS_M, Flying, never_harmed, on_the_ground
from tests.support.mock_px4 import MockProcess, free_udp_port
from tests.support.wire import WireTap

pytestmark = pytest.mark.integration

LIMIT_S = 400.0


def test_the_virtual_room_is_crossed_and_shown_to_the_vehicle(tmp_path: Path) -> None:
    client_port = free_udp_port()
    with (
        MockProcess(tmp_path, "--scenario", "empty", "--no-beams") as mock,
        WireTap(mock.port, client_port, keep=(132, 330)) as tap,
        Flying(
            tmp_path / "flight",
            *("--goal", "4,3", "--mode", "rolling"),
            *("--connection", f"udpin://127.0.0.1:{client_port}"),
            *("--beams", "virtual:default", "--send-beams"),
        ) as flying,
    ):
        flying.wait_for_note("does not see the real world")
        assert flying.end(LIMIT_S) == 0, (flying.lines[-1], flying.errors)
        never_harmed(mock.truth())
        assert on_the_ground(mock.truth())
        report = flying.report
    assert report["ending"] == "goal_reached"
    assert report["collisions"] == 0
    assert report["clearance_is_true"] is True
    assert report["clearance_by_reported_pose"] is True
    assert BODY_RADIUS_M < report["minimum_clearance_m"] < 0.6
    assert report["scenario"] == "default"
    assert report["path_length_m"] > 1.02 * report["straight_length_m"]
    assert {"tangent", "hyperbola"} & set(report["leg_kinds"])

    codec = mavlink.MAVLink(None)
    shown = [message for frame in tap.kept for message in codec.parse_buffer(frame) or ()]
    ranges = [m for m in shown if m.get_type() == "DISTANCE_SENSOR"]
    assert {m.orientation for m in ranges} == {0, 2, 4, 6, 24}
    assert any(m.current_distance < 60 for m in ranges)
    fans = [m for m in shown if m.get_type() == "OBSTACLE_DISTANCE"]
    assert len(fans) > 100
    assert any(fan.distances[0] <= 100 for fan in fans)
