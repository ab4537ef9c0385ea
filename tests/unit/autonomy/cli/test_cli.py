"""What is typed, what is understood, what is answered."""

import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from autonomy import __version__
from autonomy.cli import main, refusal
from autonomy.config import load_config
from autonomy.errors import AutonomyError, BadInput, ExitCode
from autonomy.model import Ending
from autonomy.report import FlightReport, FlyOptions
from hal.errors import (
    ConnectionFailed,
    DocumentError,
    HalError,
    LinkLost,
    PortInUse,
    WrongAutopilot,
)
from hal.readings import RangeReading, RangeStatus

HEAVY = ("numba", "numpy", "scipy", "mavsdk", "pymavlink", "pydantic", "rich", "yaml", "asyncio")


def run(*arguments: str) -> Result:
    return CliRunner().invoke(main, arguments)


@pytest.fixture
def flown(monkeypatch: pytest.MonkeyPatch) -> list[FlyOptions]:
    """What `fly` was asked for; every flight ends unreachable."""
    asked: list[FlyOptions] = []

    def fly(options: FlyOptions) -> FlightReport:
        asked.append(options)
        return FlightReport(
            ending=Ending.UNREACHABLE,
            why="a wall",
            exit_code=int(ExitCode.UNREACHABLE),
            route_ned_m=(),
        )

    monkeypatch.setattr("autonomy.app.fly", fly)
    return asked


def test_the_shortest_flight_is_in_the_default_world(flown: list[FlyOptions]) -> None:
    result = run("fly", "--goal", "4,3", "--sim")
    assert result.exit_code == ExitCode.UNREACHABLE
    assert flown == [FlyOptions(goals=((4.0, 3.0, None),), scenario="default")]


def test_every_option_reaches_the_flight(flown: list[FlyOptions], tmp_path: Path) -> None:
    config = tmp_path / "my.yaml"
    config.write_text("")
    run(
        *("fly", "--goal", "-4,-3,-1.5", "--goal", "0,0", "--frame", "enu", "--altitude", "1.2"),
        *("--no-land", "--sim", "door", "--config", str(config), "--seed", "7", "--json"),
        *("--log-dir", "logs", "--no-log", "--timeout", "90", "--mode", "rolling"),
    )
    assert flown == [
        FlyOptions(
            goals=((-4.0, -3.0, -1.5), (0.0, 0.0, None)),
            frame="enu",
            altitude_m=1.2,
            land=False,
            scenario="door",
            config_path=str(config),
            seed=7,
            output="json",
            log_dir="logs",
            log=False,
            time_limit_s=90.0,
            mode="rolling",
        )
    ]


def test_the_name_of_the_world_may_be_left_out_anywhere(flown: list[FlyOptions]) -> None:
    run("fly", "--sim", "--goal", "1,2")
    run("fly", "--sim", "u_trap", "--goal", "1,2")
    assert [options.scenario for options in flown] == ["default", "u_trap"]


def test_a_world_knows_its_own_goal(flown: list[FlyOptions]) -> None:
    run("fly", "--sim")
    assert flown[0].goals == ((4.0, 3.0, None),)


def test_a_real_vehicle_is_named_by_its_connection(flown: list[FlyOptions]) -> None:
    run("fly", "--goal", "1,2", "--connection", "serial:///dev/ttyAMA0:921600")
    assert flown[0].connection == "serial:///dev/ttyAMA0:921600"
    assert flown[0].scenario is None


@pytest.mark.parametrize(
    ("arguments", "answer"),
    [
        (["--goal", "4", "--sim"], "'4' is not a goal; write x,y or x,y,z in metres"),
        (["--goal", "4,3,2,1", "--sim"], "is not a goal"),
        (["--goal", "four,3", "--sim"], "is not a goal"),
        (["--goal", "", "--sim"], "is not a goal"),
        (["--goal", "4,nan", "--sim"], "a coordinate that is not a finite number"),
        (["--goal", "inf,3", "--sim"], "a coordinate that is not a finite number"),
        (["--goal", "4,3"], "--sim for the simulated vehicle, or --connection URL"),
        (["--goal", "4,3", "--sim", "--connection", "x"], "exclude each other"),
        (["--connection", "udpin://0.0.0.0:14540"], "say where to: --goal x,y"),
        (["--sim", "--frame", "body"], "say where to: --goal x,y"),
        (["--goal", "4,3", "--sim", "--altitude", "nan"], "nan is not a positive number"),
        (["--goal", "4,3", "--sim", "--altitude", "-1"], "-1 is not a positive number"),
        (["--goal", "4,3", "--sim", "--timeout", "0"], "0 is not a positive number"),
        (["--goal", "4,3", "--sim", "--seed", "-1"], "-1 is not in the range"),
        (["--goal", "4,3", "--sim", "--config", "absent.yaml"], "does not exist"),
        (["--goal", "4,3", "--sim", "--mode", "crawl"], "is not one of"),
        (["--gaol", "4,3"], "No such option"),
    ],
)
def test_what_cannot_be_understood_is_refused_before_anything_starts(
    flown: list[FlyOptions], arguments: list[str], answer: str
) -> None:
    result = run("fly", *arguments)
    assert result.exit_code == ExitCode.USAGE
    assert answer in " ".join(result.stderr.split())
    assert flown == []


def test_an_unknown_world_is_told_with_those_that_exist() -> None:
    result = run("sim", "atlantis")
    assert result.exit_code == ExitCode.BAD_INPUT
    assert result.stderr.startswith("autonomy: there is no scenario 'atlantis': use one of ")
    assert len(result.stderr.splitlines()) == 1


# ---------------------------------------------------------------- errors


@pytest.mark.parametrize(
    ("error", "exit_code"),
    [
        (BadInput("the goal is outside"), ExitCode.BAD_INPUT),
        (AutonomyError("it broke"), ExitCode.INTERNAL),
        (ConnectionFailed("nobody answered"), ExitCode.NO_VEHICLE),
        (WrongAutopilot("it is a boat"), ExitCode.WRONG_AUTOPILOT),
        (LinkLost("silent"), ExitCode.LINK_LOST),
        (DocumentError("a.yaml:1: no"), ExitCode.BAD_INPUT),
        (PortInUse("14540 is taken"), ExitCode.BAD_INPUT),
        (HalError("something"), ExitCode.BAD_INPUT),
        (KeyboardInterrupt(), ExitCode.ABORTED),
        (ExceptionGroup("tasks", [LinkLost("silent")]), ExitCode.LINK_LOST),
        (ZeroDivisionError("division by zero"), ExitCode.INTERNAL),
    ],
)
def test_an_error_becomes_a_sentence_and_an_exit_code(
    monkeypatch: pytest.MonkeyPatch, error: BaseException, exit_code: ExitCode
) -> None:
    def fail(options: FlyOptions) -> FlightReport:
        raise error

    monkeypatch.setattr("autonomy.app.fly", fail)
    result = run("fly", "--goal", "4,3", "--sim")
    assert result.exit_code == exit_code == refusal(error)[1]
    (sentence,) = result.stderr.splitlines()
    assert sentence == f"autonomy: {refusal(error)[0]}"


def test_every_hal_error_has_an_exit_code_of_its_own_or_a_good_reason() -> None:
    for kind in HalError.__subclasses__():
        assert refusal(kind("x"))[1] is not ExitCode.INTERNAL


def test_debug_shows_where_it_came_from(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(options: FlyOptions) -> FlightReport:
        raise BadInput("the goal is outside")

    monkeypatch.setattr("autonomy.app.fly", fail)
    result = run("fly", "--goal", "4,3", "--sim", "--debug")
    assert isinstance(result.exception, BadInput)


# ---------------------------------------------------------------- the other commands


def test_help_costs_nothing_heavy() -> None:
    code = (
        "import sys; from autonomy.cli import main; main(['--help'], standalone_mode=False); "
        f"print([name for name in {HEAVY!r} if name in sys.modules])"
    )
    answer = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert answer.stdout.splitlines()[-1] == "[]"
    for command in ("fly", "sim", "plan", "replay", "config", "check", "report"):
        assert f"\n  {command} " in answer.stdout


@pytest.mark.parametrize(
    "command",
    ["fly", "sim", "plan", "replay", "report", "check", "config", "config show", "config schema"],
)
def test_every_command_explains_itself(command: str) -> None:
    result = run(*command.split(), "--help")
    assert result.exit_code == 0
    assert "Usage: " in result.stdout


def test_the_version_is_told() -> None:
    assert run("--version").stdout == f"autonomy {__version__}\n".replace("autonomy", "main")


def test_the_configuration_is_shown_as_a_document_that_can_be_read_again(tmp_path: Path) -> None:
    shown = run("config").stdout
    assert shown == run("config", "show").stdout
    (tmp_path / "a.yaml").write_text(shown)
    assert run("config", "show", str(tmp_path / "a.yaml")).stdout == shown
    assert run("config", "check", str(tmp_path / "a.yaml")).exit_code == 0


def test_a_wrong_configuration_is_refused_with_its_place(tmp_path: Path) -> None:
    path = tmp_path / "a.yaml"
    path.write_text("mission:\n  altitude_m: high\n")
    result = run("config", "check", str(path))
    assert result.exit_code == ExitCode.BAD_INPUT
    assert f"{path}:2: mission.altitude_m: " in result.stderr


def test_the_schema_is_printed_for_editors() -> None:
    assert '"altitude_m"' in run("config", "schema").stdout


def test_what_is_not_a_log_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.mcap"
    path.write_text("hello")
    for command in ("replay", "report"):
        result = run(command, str(path))
        assert result.exit_code == ExitCode.BAD_INPUT
        assert "is not a flight log of this program" in result.stderr


def test_calibrating_needs_a_beam_that_is_there_and_a_distance() -> None:
    assert run("calibrate", "front").exit_code == ExitCode.USAGE
    result = run("calibrate", "nose", "--distance", "0.5")
    assert result.exit_code == ExitCode.USAGE
    assert "there are front, right, back, left, up, down" in result.stderr
    assert run("calibrate", "front", "--distance", "-1").exit_code == ExitCode.USAGE
    result = run("calibrate", "front", "--distance", "0.5")
    assert result.exit_code == ExitCode.BAD_INPUT
    assert "--connection URL" in result.stderr


@pytest.fixture
def wall(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every beam reads 2 cm too far."""

    def measured(_: object, __: object, beam: str, ___: float) -> list[RangeReading]:
        return [
            RangeReading(k / 25, beam, RangeStatus.VALID, 0.52, 1e-4, 0.02, 1.0) for k in range(60)
        ]

    monkeypatch.setattr("autonomy.beam_watch.measure", measured)


@pytest.mark.usefixtures("wall")
def test_calibrating_prints_a_document_or_writes_it(tmp_path: Path) -> None:
    printed = run("calibrate", "front", "--distance", "0.5")
    assert printed.exit_code == 0
    assert "{name: front, offset_m: 0.02, sigma_m: 0.001}" in printed.stdout
    assert "reads +20.0 mm" in printed.stderr
    assert "only front is new here: paste its line" in printed.stderr
    path = tmp_path / "front.yaml"
    assert run("calibrate", "front", "--distance", "0.5", "--out", str(path)).exit_code == 0
    assert path.read_text() == printed.stdout


@pytest.mark.usefixtures("wall")
def test_one_file_collects_what_several_calibrations_found(tmp_path: Path) -> None:
    path = tmp_path / "beams.yaml"
    for beam in ("front", "left", "front"):
        result = run("calibrate", beam, "--distance", "0.5", "--out", str(path))
        assert result.exit_code == 0, result.stderr
        assert "paste its mounts" in result.stderr
    offsets = {mount.name: mount.offset_m for mount in load_config(path).beams.mounts}
    assert offsets == {"front": 0.02, "left": 0.02, "right": 0, "back": 0, "up": 0, "down": 0}


@pytest.mark.usefixtures("wall")
def test_a_file_that_somebody_wrote_is_not_calibrated_over(tmp_path: Path) -> None:
    path = tmp_path / "my-drone.yaml"
    run("calibrate", "front", "--distance", "0.5", "--out", str(path))
    for text in (path.read_text() + "# mine\n", "", "beams: [", "beams: {mounts: [{}]}"):
        path.write_text(text)
        result = run("calibrate", "left", "--distance", "0.5", "--out", str(path))
        assert result.exit_code == ExitCode.BAD_INPUT
        assert "is left alone" in result.stderr
        assert path.read_text() == text


def test_live_bars_need_beams_to_look_at() -> None:
    result = run("check", "--live")
    assert result.exit_code == ExitCode.BAD_INPUT
    assert "--connection URL" in result.stderr
