"""`autonomy fly` through the shipped worlds: real MAVSDK, real MAVLink, the mock PX4.

The flights are flown beside one another, once; every test looks at what they left behind.
"""

import subprocess
import sys
from pathlib import Path

import pytest

from tests.integration.conftest import MISSIONS
from tests.support.flying import BODY_RADIUS_M, ROOT, Flying

pytestmark = pytest.mark.integration

Flights = dict[str, Flying]

LIMIT_S = 600.0


@pytest.mark.parametrize("name", MISSIONS)
def test_the_goal_is_reached_and_nothing_was_touched(missions: Flights, name: str) -> None:
    flying = missions[name]
    assert flying.end(LIMIT_S) == 0, (flying.lines[-1], flying.errors)
    assert flying.errors == ""
    report = flying.report
    assert report["ending"] == "goal_reached"
    assert report["exit_code"] == 0
    assert report["clearance_is_true"] is True
    if report["minimum_clearance_m"] is not None:
        assert report["minimum_clearance_m"] > BODY_RADIUS_M
    assert report["scenario"] == name
    assert report["seed"] == 0
    assert report["path_length_m"] > report["straight_length_m"] - 0.5
    assert report["max_speed_m_s"] < 0.35
    assert report["flight_time_s"] > report["straight_length_m"] / report["max_speed_m_s"]
    assert report["replans"] == len(report["timing"]["replans"]) > 0
    assert [text for _, _, text in report["events"]][-1] == "landed and disarmed"


def test_the_default_room_is_flown_with_spheres_and_a_hyperbola(
    missions: Flights,
) -> None:
    missions["default"].end(LIMIT_S)
    assert {"tangent", "arc", "hyperbola"} <= set(missions["default"].report["leg_kinds"])


def test_the_paper_s_loop_stops_and_the_rolling_one_does_not(missions: Flights) -> None:
    for flying in missions.values():
        flying.end(LIMIT_S)
    assert missions["default"].report["stops"] > 0
    assert missions["u_trap"].report["stops"] > 0
    assert missions["door"].report["stops"] == 0
    assert "stop" not in missions["door"].states


@pytest.mark.parametrize("name", MISSIONS)
def test_the_log_of_the_flight_replays_bit_for_bit(missions: Flights, name: str) -> None:
    missions[name].end(LIMIT_S)
    log = Path(missions[name].report["log_path"])
    done = subprocess.run(
        [sys.executable, "-m", "autonomy.cli", "replay", str(log)],
        capture_output=True,
        text=True,
        check=False,
        cwd=ROOT,
        timeout=LIMIT_S,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stdout.startswith("identical: ")
    ticks = int(done.stdout.split()[1])
    assert ticks > 10.0 * missions[name].report["flight_time_s"]
