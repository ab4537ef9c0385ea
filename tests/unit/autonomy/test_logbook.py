"""A flight that was recorded is proved by flying it again, and summed up from its log."""

from pathlib import Path

import msgspec
import pytest
from click.testing import CliRunner

from autonomy.app import keep_report
from autonomy.cli import main
from autonomy.config import Config
from autonomy.errors import ExitCode, NotReplayable
from autonomy.flightlog.recorder import FlightRecorder
from autonomy.logbook import replay_log, report_of_log
from autonomy.model import Ending
from autonomy.report import with_truth
from autonomy.simulation import SimulatedFlight, with_scenario
from hal.sim.scenario import load_scenario
from tests.support.recorded import fly


@pytest.fixture(scope="module")
def flown(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, SimulatedFlight]:
    return fly(tmp_path_factory.mktemp("flights"))


def test_the_report_tells_the_bound_the_sides_and_the_radii_of_what_was_flown(
    flown: tuple[Path, SimulatedFlight],
) -> None:
    report, flight = report_of_log(flown[0]), flown[1]
    assert report.path_bound == flight.path_bound
    assert report.path_bound is not None
    assert report.path_bound.holds(report.path_length_m)
    assert report.side_changes == flight.side_changes
    assert sum(leg.flown_m for leg in report.legs) == pytest.approx(report.path_length_m, abs=0.1)
    planner, body_m = Config().planner, Config().body.radius_m
    radii = {round(leg.keep_out_m, 3) for leg in report.legs}
    assert round(body_m + planner.comfortable_clearance_m, 3) in radii
    assert all(radius <= body_m + planner.comfortable_clearance_m + 1e-9 for radius in radii)
    assert [leg.begun_s for leg in report.legs] == sorted(leg.begun_s for leg in report.legs)
    answer = CliRunner().invoke(main, ["report", str(flown[0]), "--json"])
    told = msgspec.json.decode(answer.output)
    assert told["legs"][0]["keep_out_m"] == report.legs[0].keep_out_m
    assert told["path_bound"]["bound_m"] == report.path_bound.bound_m


def test_a_replay_gives_the_same_decisions(flown: tuple[Path, SimulatedFlight]) -> None:
    result = replay_log(flown[0])
    assert result.exact, result
    answer = CliRunner().invoke(main, ["replay", str(flown[0])])
    assert answer.exit_code == 0
    assert answer.stdout == f"identical: {result.ticks} ticks replayed, every decision the same\n"


def test_the_report_of_a_log_is_what_was_flown(flown: tuple[Path, SimulatedFlight]) -> None:
    path, flight = flown
    report = report_of_log(path)
    assert report.ending is flight.outcome.ending is Ending.GOAL_REACHED
    assert (report.stops, report.replans) == (flight.stops, flight.replans)
    assert report.path_length_m == pytest.approx(flight.path_length_m, rel=0.08)
    assert report.timing is not None
    assert len(report.timing.replans) >= report.replans > 0
    assert (report.scenario, report.seed) == ("door", 3)
    assert report.log_notes == ()
    shown = CliRunner().invoke(main, ["report", str(path)]).stdout
    assert "Goal reached" in shown
    as_json = CliRunner().invoke(main, ["report", "--json", str(path)]).stdout
    assert msgspec.json.decode(as_json)["ending"] == "goal_reached"


def test_what_a_simulation_knew_is_told_from_the_report_beside_the_log(
    flown: tuple[Path, SimulatedFlight], tmp_path: Path
) -> None:
    path = tmp_path / "flight.mcap"
    path.write_bytes(flown[0].read_bytes())
    mapped = report_of_log(path)
    assert not mapped.clearance_is_true
    own = msgspec.structs.replace(with_truth(mapped, 0.1625), log_path=str(path))
    assert keep_report(own) is None
    assert report_of_log(path).minimum_clearance_m == 0.1625
    assert report_of_log(path).clearance_is_true
    Path(f"{path}.report.json").write_text("{")
    assert report_of_log(path) == mapped
    lost = msgspec.structs.replace(own, log_path=str(tmp_path / "no" / "a.mcap"))
    assert keep_report(lost) == "the report could not be kept (No such file or directory)"
    assert keep_report(msgspec.structs.replace(own, log_path=None)) is None


def test_a_log_that_was_cut_is_replayed_and_reported_up_to_the_cut(
    flown: tuple[Path, SimulatedFlight], tmp_path: Path
) -> None:
    path = tmp_path / "cut.mcap"
    whole = flown[0].read_bytes()
    path.write_bytes(whole[: len(whole) // 2])
    assert replay_log(path).exact
    report = report_of_log(path)
    assert report.ending is Ending.INTERNAL
    assert report.why == "the log ends before the mission did"
    assert any("cut off" in note for note in report.log_notes)


def test_another_configuration_decides_otherwise_and_the_replay_says_where(
    flown: tuple[Path, SimulatedFlight], tmp_path: Path
) -> None:
    path = tmp_path / "other.mcap"
    config = with_scenario(Config(), load_scenario("door")).model_dump(mode="json")
    config["guidance"]["speed_max_m_s"] = 0.15
    _rewrite(flown[0], path, msgspec.json.encode(config).decode())
    answer = CliRunner().invoke(main, ["replay", str(path)])
    assert answer.exit_code == ExitCode.INTERNAL
    assert answer.stdout.startswith("the replay differs at tick ")


def test_a_configuration_that_is_no_longer_accepted_is_told(
    flown: tuple[Path, SimulatedFlight], tmp_path: Path
) -> None:
    path = tmp_path / "old.mcap"
    _rewrite(flown[0], path, '{"warp_drive": {}}')
    answer = CliRunner().invoke(main, ["replay", str(path)])
    assert answer.exit_code == ExitCode.BAD_INPUT
    assert "configuration: warp_drive: is not a known key" in answer.stderr
    _rewrite(flown[0], tmp_path / "broken.mcap", "{")
    with pytest.raises(NotReplayable, match="the recorded configuration cannot be read"):
        replay_log(tmp_path / "broken.mcap")


def _rewrite(source: Path, target: Path, config_json: str) -> None:
    """The same flight under another recorded configuration."""
    from autonomy.flightlog.reader import FlightLog

    log = FlightLog.open(source)
    header = msgspec.structs.replace(log.header, config_json=config_json)
    with FlightRecorder(target, header, wait_when_full=True) as recorder:
        recorder.route(log.route())
        for tick in log:
            recorder.tick(tick.inputs, tick.command, tick.step_s)
