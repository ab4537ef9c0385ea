"""Faults asked for on the command line, over real MAVLink and MAVSDK: `autonomy fly --sim --fault`.

A few flights beside one another; what the service says and the simulation's truth are the judges.
"""

from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from autonomy.errors import ExitCode
from tests.support.flying import Flying

pytestmark = pytest.mark.integration

AT_ONCE = 3
LIMIT_S = 400.0

FLIGHTS: dict[str, tuple[ExitCode, str]] = {
    "link_loss@liftoff+8": (ExitCode.LINK_LOST, "silent"),
    "link_delay:delay_s=0.05,jitter_s=0.02": (ExitCode.GOAL_REACHED, "from the goal"),
    "link_drop:probability=0.05": (ExitCode.GOAL_REACHED, "from the goal"),
    "pilot_takeover@liftoff+8": (ExitCode.TAKEN_OVER, "this service lets go"),
    # The mode is told at once, that it is a failsafe only by the next heartbeat.
    "px4_failsafe@liftoff+8:mode=land": (ExitCode.TAKEN_OVER, "switched the vehicle to land"),
    "ekf_reset@liftoff+8:north_m=0.6,east_m=-0.4": (ExitCode.GOAL_REACHED, "from the goal"),
    "battery@liftoff+8:remaining=0.14": (ExitCode.FAILSAFE, "the battery is at 14%"),
    "arming_refused:announced=false": (ExitCode.PREFLIGHT_REFUSED, "Compass Sensor 0 missing"),
    "offboard_refused": (ExitCode.OFFBOARD_REFUSED, "Offboard is currently not available"),
    "second_companion:rate_hz=0": (ExitCode.GOAL_REACHED, "from the goal"),
}


@dataclass
class Ended:
    """What a flight left behind."""

    exit_code: int
    report: dict[str, Any]


def flown(folder: Path, fault: str) -> Ended:
    arguments = ("--goal", "1.5,1", "--sim", "empty", "--fault", fault)
    with Flying(folder, *arguments) as flying:
        return Ended(flying.end(LIMIT_S), flying.report)


@pytest.fixture(scope="module")
def flights(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Future[Ended]]:
    with ThreadPoolExecutor(AT_ONCE) as pool:
        return {
            fault: pool.submit(flown, tmp_path_factory.mktemp("flight"), fault) for fault in FLIGHTS
        }


@pytest.mark.parametrize("fault", FLIGHTS)
def test_what_the_service_does_about_it(flights: dict[str, Future[Ended]], fault: str) -> None:
    exit_code, says = FLIGHTS[fault]
    end = flights[fault].result()
    assert end.exit_code == exit_code, end.report
    assert says in end.report["why"]
    assert not end.report["collisions"], end.report


def test_a_restart_of_px4_while_the_service_waits_is_waited_for(tmp_path: Path) -> None:
    """The vehicle's clock begins anew, and what it measures then is not taken for old."""
    config = tmp_path / "patient.yaml"
    config.write_text("mission: {preflight_timeout_s: 120}\n")
    faults = ("--fault", "arming_refused@0/25", "--fault", "reboot@15")
    arguments = ("--goal", "1,0", "--sim", "empty", "--config", str(config), *faults)
    with Flying(tmp_path, *arguments) as flying:
        assert flying.end(LIMIT_S) == ExitCode.GOAL_REACHED, flying.report


def test_a_line_that_is_no_fault_is_refused_before_anything_starts(tmp_path: Path) -> None:
    with Flying(tmp_path, "--goal", "1,0", "--sim", "--fault", "link_loss@soon") as flying:
        assert flying.end(60.0) == ExitCode.BAD_INPUT
        (sentence,) = flying.errors.splitlines()
    assert sentence.startswith("autonomy: fault 'link_loss@soon': @WHEN/SECONDS has numbers")


def test_a_fault_of_a_beam_that_is_not_there_is_told(tmp_path: Path) -> None:
    with Flying(tmp_path, "--goal", "1,0", "--sim", "--fault", "beam_stuck:beam=nose") as flying:
        assert flying.end(LIMIT_S) == ExitCode.BAD_INPUT
        (sentence,) = flying.errors.splitlines()
    assert "is for beam 'nose', which the vehicle does not have: use one of front" in sentence
