"""What cannot be flown is refused in one sentence with a remedy, before anything is started."""

from pathlib import Path

import pytest
from click.testing import CliRunner, Result

from autonomy.cli import main
from autonomy.errors import ExitCode


@pytest.fixture(autouse=True)
def nothing_starts(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whoever gets as far as starting something fails."""

    def started(*_: object, **__: object) -> None:
        raise AssertionError("something was started")

    for name in ("EmbeddedPx4", "warm_up"):
        monkeypatch.setattr(f"autonomy.app.{name}", started)
    monkeypatch.setattr("autonomy.app.registry.vehicle", started)


def fly(*arguments: str) -> Result:
    return CliRunner().invoke(main, ["fly", *arguments])


def refused(*arguments: str) -> str:
    """The sentence with which that flight is refused."""
    result = fly(*arguments)
    assert result.exit_code == ExitCode.BAD_INPUT, result.output
    assert result.stdout == ""
    (sentence,) = result.stderr.splitlines()
    return sentence.removeprefix("autonomy: ")


@pytest.mark.parametrize(
    ("arguments", "named", "remedy"),
    [
        (
            ["--goal", "40,3", "--sim"],
            "goal 1 (40, 3, -1) is 35.20 m outside the geofence",
            "choose a goal inside it or change guard.fence",
        ),
        (
            ["--goal", "1,0", "--goal", "0,-11", "--connection", "udpin://127.0.0.1:14999"],
            "goal 2 (0, -11, -1) is 1.00 m outside the geofence",
            "choose a goal inside it",
        ),
        (
            ["--goal", "4.8,3", "--sim"],
            "is on the geofence's edge",
            "choose a goal inside it",
        ),
        (
            ["--goal", "1.15,0.85", "--sim"],
            "the goal (1.15, 0.85) is inside the obstacle 'pillar on the way' of scenario default",
            "keep it 0.21 m away",
        ),
        (
            ["--goal", "1.15,0.6", "--sim"],
            "is 0.10 m from the obstacle 'pillar on the way'",
            "keep it 0.21 m away",
        ),
        (
            ["--goal", "2.6,1.5", "--sim", "default"],
            "inside the obstacle 'partition'",
            "keep it",
        ),
        (
            ["--goal", "4,3,1", "--sim"],
            "goal 1 (4, 3, 1) is -1 m high, outside the altitude band 0.3..2 m",
            "change the goal or guard.altitude_min_m",
        ),
        (
            ["--goal", "4,3,2.5", "--frame", "enu", "--sim"],
            "is 2.5 m high, outside the altitude band",
            "change the goal",
        ),
        (
            ["--goal", "1e300,3", "--connection", "udpin://127.0.0.1:14999"],
            "outside the geofence",
            "choose a goal inside it",
        ),
        (
            ["--goal", "4,3", "--altitude", "5", "--sim"],
            "mission.altitude_m (--altitude) is 5, outside the band 0.3..2 m",
            "change one of them",
        ),
        (
            ["--goal", "4,3", "--connection", "foo://bar"],
            "the connection 'foo://bar' is not understood",
            "write it like udpin://0.0.0.0:14540",
        ),
        (
            ["--goal", "4,3", "--connection", "/dev/ttyAMA0"],
            "the connection '/dev/ttyAMA0' is not understood",
            "serial:///dev/ttyAMA0:921600",
        ),
        (
            ["--goal", "4,3", "--connection", "udpin://0.0.0.0:99999"],
            "the port of the connection 'udpin://0.0.0.0:99999'",
            "from 1 to 65535",
        ),
        (
            ["--goal", "4,3", "--connection", "tcpout://host:port"],
            "the port of the connection 'tcpout://host:port'",
            "from 1 to 65535",
        ),
        (
            ["--goal", "4,3", "--sim", "nowhere"],
            "there is no scenario 'nowhere'",
            "use one of corridor_people, curtain, default",
        ),
        (
            ["--goal", "4,3", "--sim", "nowhere.yaml"],
            "nowhere.yaml: there is no such file",
            "check the path",
        ),
    ],
)
def test_a_flight_that_must_not_be_flown(arguments: list[str], named: str, remedy: str) -> None:
    sentence = refused(*arguments)
    assert named in sentence
    assert remedy in sentence


@pytest.mark.parametrize(
    ("document", "place", "advice"),
    [
        (
            "mission:\n  altitude_m: 1.0\n  altitud: 2\n",
            ":3: mission.altitud: ",
            "is not a known key; remove it or correct its spelling",
        ),
        (
            "guard:\n  speed_max_m_s: .nan\n",
            ":2: guard.speed_max_m_s: ",
            "input should be a finite number, not nan",
        ),
        (
            "mission:\n  time_limit_s: soon\n",
            ":2: mission.time_limit_s: ",
            "not 'soon'",
        ),
        (
            "\nguard: {fence: {polygon_ne_m: [[0, 0], [1, 1]]}}\n",
            ":2: guard.fence.polygon_ne_m: ",
            "at least 3 items",
        ),
        ("planner:\n  levels: 99\n", ":2: planner.levels: ", "less than or equal to 8, not 99"),
        ("mission: [\n", ":2: ", "not valid YAML"),
        ("- a\n- b\n", ": ", "keys of its own"),
    ],
)
def test_a_configuration_is_refused_by_line_key_and_value(
    tmp_path: Path, document: str, place: str, advice: str
) -> None:
    path = tmp_path / "my.yaml"
    path.write_text(document)
    sentence = refused("--goal", "4,3", "--sim", "--config", str(path))
    assert sentence.startswith(f"{path}{place}")
    assert advice in sentence


@pytest.mark.parametrize(
    ("document", "place", "advice"),
    [
        (
            "name: w\nobstacles:\n  - {kind: disc, centre_ne_m: [3, 0], radus_m: 0.3}\n",
            ":3: obstacles.0.disc.radus_m: ",
            "is not a known key",
        ),
        (
            "name: w\nobstacles:\n  - {kind: disc, centre_ne_m: [3, 0], radius_m: -1}\n",
            ":3: obstacles.0.disc.radius_m: ",
            "greater than 0, not -1",
        ),
        ("name: w\nweather: fine\n", ":2: weather: ", "is not a known key"),
        (
            "name: w\nobstacles:\n  - {kind: disc, centre_ne_m: [0, 0], radius_m: 1}\n",
            ": ",
            "the take-off point (0, 0) is inside obstacle 0",
        ),
    ],
)
def test_a_world_is_refused_by_line_key_and_value(
    tmp_path: Path, document: str, place: str, advice: str
) -> None:
    path = tmp_path / "world.yaml"
    path.write_text(document)
    sentence = refused("--goal", "4,3", "--sim", str(path))
    assert sentence.startswith(f"{path}{place}")
    assert advice in sentence


def test_a_configuration_that_is_not_text_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "my.yaml"
    path.write_bytes(b"\xff\xfe\x00")
    assert refused("--goal", "4,3", "--sim", "--config", str(path)).startswith(f"{path}: ")


def test_a_place_for_logs_that_cannot_be_written_is_told_before_anything_starts(
    tmp_path: Path,
) -> None:
    (tmp_path / "file").write_text("")
    place = tmp_path / "file" / "logs"
    result = fly("--goal", "4,3", "--sim", "--log-dir", str(place))
    assert result.exit_code == ExitCode.BAD_INPUT, result.output
    (sentence,) = result.stderr.splitlines()
    assert sentence.startswith(f"autonomy: {place}: cannot be used for flight logs")
    assert "choose another place with --log-dir or log.directory" in sentence
