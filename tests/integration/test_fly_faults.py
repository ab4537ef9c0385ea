"""What goes wrong in the air ends in stop, hold, land, and in an exit code of its own.

Every fault has one flight of the real command line against the mock PX4. A few are flown beside one
another; the truth that the mock writes is the judge.
"""

import errno
import os
import signal
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import psutil
import pytest
from pymavlink.dialects.v20 import development as mavlink

from autonomy.errors import ExitCode
from tests.support.flying import Flying, holding, never_harmed, on_the_ground
from tests.support.mock_px4 import MockProcess, free_udp_port
from tests.support.station import Station
from tests.support.wire import WireTap

pytestmark = pytest.mark.integration

AT_ONCE = 4
LIMIT_S = 180.0
CRUISING_M_S = 0.15
HOLD_MODE = (1.0, 4.0, 3.0)  # custom mode, AUTO, LOITER


@dataclass
class Ended:
    """What a flight left behind."""

    exit_code: int
    took_s: float  # from the fault to the end of the process
    states: list[str]
    texts: list[str]
    lines: list[dict[str, Any]]
    errors: str
    truth: list[dict[str, Any]] = field(default_factory=list)
    later: list[dict[str, Any]] = field(default_factory=list)  # the truth some time after the end
    setpoints_after_end: int = 0


def ended(flying: Flying, since_s: float, mock: MockProcess | None = None) -> Ended:
    exit_code = flying.end(LIMIT_S)
    took_s = time.monotonic() - since_s
    lines = flying.lines
    events = [line for line in lines if line["type"] == "event"]
    return Ended(
        exit_code,
        took_s,
        [event["name"] for event in events],
        [event["why"] for event in events],
        lines,
        flying.errors,
        mock.truth() if mock is not None else [],
    )


def over(mock: MockProcess, folder: Path, *arguments: str, prelude: str = "") -> Flying:
    """A flight on that mock."""
    options = ("--goal", "4,3", "--connection", mock.connection, *arguments)
    return Flying(folder, *options, prelude=prelude)


def cruise(flying: Flying) -> float:
    """Until it flies at speed; the time."""
    flying.wait_for_speed(CRUISING_M_S)
    return time.monotonic()


# ---------------------------------------------------------------- the flights


def ctrl_c_once(folder: Path) -> Ended:
    with MockProcess(folder, "--scenario", "empty") as mock, over(mock, folder) as flying:
        since_s = cruise(flying)
        flying.send_signal(signal.SIGINT)
        return ended(flying, since_s, mock)


def ctrl_c_twice(folder: Path) -> Ended:
    with MockProcess(folder, "--scenario", "empty") as mock, over(mock, folder) as flying:
        since_s = cruise(flying)
        flying.send_signal(signal.SIGINT)
        flying.wait_for("hold", "stopped by the operator")
        flying.send_signal(signal.SIGINT)
        return ended(flying, since_s, mock)


def terminated(folder: Path) -> Ended:
    with MockProcess(folder, "--scenario", "empty") as mock, over(mock, folder) as flying:
        since_s = cruise(flying)
        flying.send_signal(signal.SIGTERM)
        return ended(flying, since_s, mock)


def hung_up(folder: Path) -> Ended:
    with MockProcess(folder, "--scenario", "empty") as mock, over(mock, folder) as flying:
        since_s = cruise(flying)
        flying.send_signal(signal.SIGHUP)
        return ended(flying, since_s, mock)


def terminated_at_take_off(folder: Path) -> Ended:
    with MockProcess(folder, "--scenario", "empty") as mock, over(mock, folder) as flying:
        flying.wait_for("takeoff")
        mock.wait_for_truth(lambda state: state["in_air"], LIMIT_S)
        since_s = time.monotonic()
        flying.send_signal(signal.SIGTERM)
        return ended(flying, since_s, mock)


def frozen_vehicle(folder: Path) -> Ended:
    with MockProcess(folder, "--scenario", "empty") as mock, over(mock, folder) as flying:
        since_s = cruise(flying)
        mock.send_signal(signal.SIGSTOP)
        try:
            end = ended(flying, since_s, mock)
        finally:
            mock.send_signal(signal.SIGCONT)
        mock.wait_for_truth(lambda state: state["mode"] in ("hold", "land"))
        mock.wait_for_truth(lambda state: on_the_ground([state]) or holding([state]), LIMIT_S)
        end.later = mock.truth()
        return end


def vanished_vehicle(folder: Path) -> Ended:
    with Flying(folder, "--goal", "4,3", "--sim", "empty") as flying:
        since_s = cruise(flying)
        (vehicle,) = psutil.Process(flying.process.pid).children()
        vehicle.kill()
        return ended(flying, since_s)


def taken_by_a_pilot(folder: Path) -> Ended:
    client_port = free_udp_port()
    connection = f"udpin://127.0.0.1:{client_port}"
    with (
        MockProcess(folder, "--scenario", "empty") as mock,
        WireTap(mock.port, client_port) as tap,
        Flying(folder, "--goal", "4,3", "--connection", connection) as flying,
    ):
        since_s = cruise(flying)
        pilot = Station(0, mock.address)
        try:
            pilot.heartbeat()
            assert pilot.command(mavlink.MAV_CMD_DO_SET_MODE, *HOLD_MODE) == 0
        finally:
            pilot.close()
        end = ended(flying, since_s, mock)
        before = len(tap.targets)
        time.sleep(2.0)
        end.setpoints_after_end = len(tap.targets) - before
        end.later = mock.truth()
        return end


def killed(folder: Path) -> Ended:
    with MockProcess(folder, "--scenario", "empty") as mock, over(mock, folder) as flying:
        since_s = cruise(flying)
        flying.send_signal(signal.SIGKILL)
        end = ended(flying, since_s, mock)
        mock.wait_for_truth(lambda state: holding([state]))
        end.later = mock.truth()
        return end


def killed_with_its_vehicle(folder: Path) -> Ended:
    with Flying(folder, "--goal", "4,3", "--sim", "empty") as flying:
        flying.wait_for("arm")
        (vehicle,) = psutil.Process(flying.process.pid).children()
        since_s = time.monotonic()
        flying.send_signal(signal.SIGKILL)
        end = ended(flying, since_s)
        vehicle.wait(30.0)  # raises when it is still there
        return end


def offboard_refused(folder: Path) -> Ended:
    options = ("--scenario", "empty", "--refuse", "offboard")
    with MockProcess(folder, *options) as mock, over(mock, folder) as flying:
        return ended(flying, time.monotonic(), mock)


def arming_refused(folder: Path) -> Ended:
    options = ("--scenario", "empty", "--refuse", "arm")
    with MockProcess(folder, *options) as mock, over(mock, folder) as flying:
        return ended(flying, time.monotonic(), mock)


def dangerous_parameter(folder: Path) -> Ended:
    world = folder / "world.yaml"
    world.write_text("name: room\nvehicle: {parameters: {COM_OBL_RC_ACT: 0}}\n")
    config = folder / "quick.yaml"
    config.write_text("mission: {preflight_timeout_s: 3}\n")
    with (
        MockProcess(folder, "--scenario", str(world)) as mock,
        over(mock, folder, "--config", str(config)) as flying,
    ):
        return ended(flying, time.monotonic(), mock)


PILOT = """
import time
import autonomy.flight
from autonomy.mission.guarded import GuardedPilot
from autonomy.model import MissionState

class Failing(GuardedPilot):
    def step(self, inputs):
        command = super().step(inputs)
        self.cruised = getattr(self, "cruised", 0) + (
            command.decision.state is MissionState.CRUISE
        )
        if self.cruised == 50:
            self.cruised += 1
            {defect}
        return command

autonomy.flight.GuardedPilot = Failing
"""


def exception_in_the_core(folder: Path) -> Ended:
    prelude = PILOT.format(defect="raise ZeroDivisionError('planted')")
    with (
        MockProcess(folder, "--scenario", "empty") as mock,
        over(mock, folder, prelude=prelude) as flying,
    ):
        flying.wait_for("cruise")
        return ended(flying, time.monotonic(), mock)


def stalled_core(folder: Path) -> Ended:
    prelude = PILOT.format(defect="time.sleep(5.0)")
    with (
        MockProcess(folder, "--scenario", "empty") as mock,
        over(mock, folder, prelude=prelude) as flying,
    ):
        flying.wait_for("cruise")
        return ended(flying, time.monotonic(), mock)


def no_vehicle(folder: Path) -> Ended:
    config = folder / "quick.yaml"
    config.write_text("vehicle: {connect_timeout_s: 2}\n")
    connection = f"udpin://127.0.0.1:{free_udp_port()}"
    arguments = ("--goal", "4,3", "--connection", connection, "--config", str(config))
    with Flying(folder, *arguments) as flying:
        return ended(flying, time.monotonic())


def given_up(folder: Path, number: signal.Signals = signal.SIGINT) -> Ended:
    config = folder / "patient.yaml"
    config.write_text("vehicle: {connect_timeout_s: 120}\n")
    connection = f"udpin://127.0.0.1:{free_udp_port()}"
    arguments = ("--goal", "4,3", "--connection", connection, "--config", str(config))
    with Flying(folder, *arguments) as flying:
        flying.wait_for_note("waiting for a vehicle")
        time.sleep(0.5)
        flying.send_signal(number)
        return ended(flying, time.monotonic())


def given_up_by_sigterm(folder: Path) -> Ended:
    return given_up(folder, signal.SIGTERM)


def not_a_px4(folder: Path) -> Ended:
    port = free_udp_port()
    vehicle = Station(0, ("127.0.0.1", port), system=1, component=1)
    heartbeat = mavlink.MAVLink_heartbeat_message(
        mavlink.MAV_TYPE_QUADROTOR, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA, 81, 0, 3, 3
    )
    arguments = ("--goal", "4,3", "--connection", f"udpin://127.0.0.1:{port}")
    with vehicle, Flying(folder, *arguments) as flying:
        while flying.process.poll() is None:
            vehicle.send(heartbeat)
            time.sleep(0.2)
        return ended(flying, time.monotonic())


def port_taken(folder: Path) -> Ended:
    with Station(0) as other:
        connection = f"udpin://127.0.0.1:{other.port}"
        with Flying(folder, "--goal", "4,3", "--connection", connection) as flying:
            return ended(flying, time.monotonic())


FLIGHTS: tuple[Callable[[Path], Ended], ...] = (
    ctrl_c_once,
    ctrl_c_twice,
    terminated,
    hung_up,
    terminated_at_take_off,
    frozen_vehicle,
    vanished_vehicle,
    taken_by_a_pilot,
    killed,
    exception_in_the_core,
    stalled_core,
    killed_with_its_vehicle,
    offboard_refused,
    arming_refused,
    dangerous_parameter,
    no_vehicle,
    given_up,
    given_up_by_sigterm,
    not_a_px4,
    port_taken,
)


class Flown:
    """What became of each flight."""

    def __init__(self, ends: dict[Callable[[Path], Ended], Future[Ended]]) -> None:
        self._ends = ends

    def by(self, flight: Callable[[Path], Ended]) -> Ended:
        """Raises what went wrong with that flight, and with no other."""
        return self._ends[flight].result()


@pytest.fixture(scope="module")
def flown(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Flown:
    if any("missions" in getattr(item, "fixturenames", ()) for item in request.session.items):
        request.getfixturevalue("missions")  # asked for later: they may fly meanwhile
    with ThreadPoolExecutor(AT_ONCE) as pool:
        return Flown({f: pool.submit(f, tmp_path_factory.mktemp(f.__name__)) for f in FLIGHTS})


# ---------------------------------------------------------------- the operator


def test_ctrl_c_stops_holds_and_lands_by_itself(flown: Flown) -> None:
    end = flown.by(ctrl_c_once)
    assert end.exit_code == ExitCode.ABORTED, end
    assert end.states[-3:] == ["hold", "land", "done"]
    assert end.texts[-2] == "held as ordered; landing"
    assert end.lines[-1]["ending"] == "aborted"
    never_harmed(end.truth)
    assert on_the_ground(end.truth)


def test_ctrl_c_twice_lands_at_once(flown: Flown) -> None:
    end = flown.by(ctrl_c_twice)
    assert end.exit_code == ExitCode.ABORTED, end
    assert end.states[-3:] == ["hold", "land", "done"]
    assert end.texts[-2] == "stopped by the operator: landing"
    never_harmed(end.truth)
    assert on_the_ground(end.truth)


@pytest.mark.parametrize("flight", [terminated, hung_up, terminated_at_take_off])
def test_sigterm_and_a_lost_terminal_are_orders_to_come_down(
    flown: Flown, flight: Callable[[Path], Ended]
) -> None:
    end = flown.by(flight)
    assert end.exit_code == ExitCode.ABORTED, end
    assert end.texts[-1] == "landed and disarmed"
    never_harmed(end.truth)
    assert on_the_ground(end.truth)


# ---------------------------------------------------------------- the vehicle


def test_a_vehicle_that_falls_silent_is_given_up_in_bounded_time_and_saves_itself(
    flown: Flown,
) -> None:
    end = flown.by(frozen_vehicle)
    assert end.exit_code == ExitCode.LINK_LOST, end
    assert end.took_s < 60.0
    assert "silent" in end.lines[-1]["why"]
    never_harmed(end.later)


def test_a_vehicle_that_vanishes_is_given_up_in_bounded_time(flown: Flown) -> None:
    end = flown.by(vanished_vehicle)
    assert end.exit_code == ExitCode.LINK_LOST, end
    assert end.took_s < 60.0
    assert end.lines[-1]["clearance_is_true"] is True


def test_a_pilot_who_switches_the_mode_has_the_vehicle(flown: Flown) -> None:
    end = flown.by(taken_by_a_pilot)
    assert end.exit_code == ExitCode.TAKEN_OVER, end
    assert end.states[-2:] == ["yielded", "done"]
    assert "land" not in end.states
    assert end.setpoints_after_end == 0
    never_harmed(end.later)
    assert holding(end.later)


def test_a_refused_offboard_lands(flown: Flown) -> None:
    end = flown.by(offboard_refused)
    assert end.exit_code == ExitCode.OFFBOARD_REFUSED, end
    assert "Offboard is currently not available" in end.lines[-1]["why"]
    never_harmed(end.truth)
    assert on_the_ground(end.truth)


def test_a_refused_arming_ends_on_the_ground_with_the_vehicle_s_words(flown: Flown) -> None:
    end = flown.by(arming_refused)
    assert end.exit_code == ExitCode.PREFLIGHT_REFUSED, end
    assert "refused to arm" in end.lines[-1]["why"]
    assert "Arming denied" in end.lines[-1]["why"]
    assert not any(state["armed"] for state in end.truth)


def test_an_autopilot_that_would_climb_when_left_alone_is_not_flown(flown: Flown) -> None:
    end = flown.by(dangerous_parameter)
    assert end.exit_code == ExitCode.PREFLIGHT_REFUSED, end
    assert "COM_OBL_RC_ACT is 0" in end.lines[-1]["why"]
    assert "set it to 5 (Hold) or 4 (Land)" in end.lines[-1]["why"]
    assert not any(state["armed"] for state in end.truth)


# ---------------------------------------------------------------- the program itself


def test_a_killed_program_leaves_the_vehicle_to_px4_which_holds(flown: Flown) -> None:
    end = flown.by(killed)
    assert end.exit_code == -signal.SIGKILL
    never_harmed(end.later)
    assert holding(end.later)


def test_the_embedded_vehicle_does_not_outlive_a_killed_program(flown: Flown) -> None:
    assert flown.by(killed_with_its_vehicle).exit_code == -signal.SIGKILL


def test_an_exception_in_the_air_is_told_and_the_vehicle_comes_down(flown: Flown) -> None:
    end = flown.by(exception_in_the_core)
    assert end.exit_code == ExitCode.INTERNAL, end
    (sentence,) = end.errors.splitlines()
    assert sentence.startswith("autonomy: a defect of this program: ZeroDivisionError: planted")
    never_harmed(end.truth)
    assert on_the_ground(end.truth)
    modes = [state["mode"] for state in end.truth if state["in_air"]]
    assert "hold" in modes[modes.index("offboard") :]


def test_a_core_that_stalls_is_stopped_held_and_landed(flown: Flown) -> None:
    end = flown.by(stalled_core)
    assert end.exit_code == ExitCode.INTERNAL, end
    (sentence,) = end.errors.splitlines()
    assert "the control loop stood still in flight" in sentence
    never_harmed(end.truth)
    assert on_the_ground(end.truth)


# ---------------------------------------------------------------- nobody, or somebody else


def test_no_vehicle_within_the_time_limit(flown: Flown) -> None:
    end = flown.by(no_vehicle)
    assert end.exit_code == ExitCode.NO_VEHICLE, end
    (sentence,) = end.errors.splitlines()
    assert sentence.startswith("autonomy: no vehicle answered on udpin://127.0.0.1:")
    assert " within 2 s; check that " in sentence


@pytest.mark.parametrize("flight", [given_up, given_up_by_sigterm])
def test_waiting_for_a_vehicle_can_be_given_up(
    flown: Flown, flight: Callable[[Path], Ended]
) -> None:
    end = flown.by(flight)
    assert end.exit_code == ExitCode.ABORTED, end
    assert end.errors == "autonomy: stopped\n"


def test_a_vehicle_that_is_not_px4_is_not_flown(flown: Flown) -> None:
    end = flown.by(not_a_px4)
    assert end.exit_code == ExitCode.WRONG_AUTOPILOT, end
    (sentence,) = end.errors.splitlines()
    assert "only PX4 can be flown" in sentence


def test_a_port_that_another_program_has_is_told(flown: Flown) -> None:
    end = flown.by(port_taken)
    assert end.exit_code == ExitCode.BAD_INPUT, end
    (sentence,) = end.errors.splitlines()
    assert "the port of udpin://127.0.0.1:" in sentence
    assert f"cannot be opened ({os.strerror(errno.EADDRINUSE)}); stop the program" in sentence
