"""The examples do what their README says, each in a small form."""

import asyncio
import socket
from pathlib import Path
from typing import NoReturn

import pytest

from autonomy import app
from autonomy.model import Ending
from autonomy.report import FlyOptions
from autonomy.service.api import Api
from autonomy.service.contract import Phase
from autonomy.service.gate import Access
from autonomy.service.server import WebServer, listening_socket, url_of
from hal.clock import SimClock
from hal.config import MavlinkDriver
from hal.errors import ConnectionFailed
from hal.readings import RangeStatus
from tests.support.readmes import ROOT
from tests.unit.autonomy.test_serving import Stage
from tools.examples import analyse_log, fly_a_route, planner, sensor_driver, talk_to_the_service

FOLDER = ROOT / "tools" / "examples"
LOG = ROOT / "tests" / "golden" / "flights" / "default_rolling.mcap"


def free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        return int(taken.getsockname()[1])


def test_the_readme_lists_every_example_with_its_command() -> None:
    text = (FOLDER / "README.md").read_text(encoding="utf-8")
    for path in FOLDER.glob("[a-z]*.py"):
        assert f"[{path.name}]({path.name})" in text
        assert f".venv/bin/python -m tools.examples.{path.stem}" in text


def test_a_route_is_flown_in_process(capsys: pytest.CaptureFixture[str]) -> None:
    assert fly_a_route.main(["empty"]) == 0
    said = capsys.readouterr().out
    assert said.startswith(f"{Ending.GOAL_REACHED}: ")
    assert "collided: False" in said


def test_the_same_route_is_what_the_embedded_px4_is_given(monkeypatch: pytest.MonkeyPatch) -> None:
    class Prepared(Exception):
        pass

    def fly(options: FlyOptions) -> NoReturn:
        route = app.prepare(options).route_ned_m(0.0)
        assert [goal[:2] for goal in route] == list(fly_a_route.ROUTE_NE_M)
        raise Prepared

    monkeypatch.setattr(app, "fly", fly)
    with pytest.raises(Prepared):
        fly_a_route.main(["--px4"])


def test_another_planner_flies_the_furnished_room(capsys: pytest.CaptureFixture[str]) -> None:
    planner.main([])
    said = capsys.readouterr().out
    assert said.startswith(f"{Ending.GOAL_REACHED}: ")
    assert "collided: False" in said


async def test_the_driver_s_beams_arrive() -> None:
    readings = await sensor_driver.demonstrate(free_port())
    by_beam = {reading.beam: reading for reading in readings}
    assert by_beam["front"].status is RangeStatus.VALID
    assert by_beam["front"].range_m == 0.53
    assert by_beam["left"].status is RangeStatus.OUT_OF_RANGE


async def test_a_driver_that_hears_nothing_says_so_and_lets_go_of_its_port() -> None:
    driver = sensor_driver.WifiDriver(driver="wifi", udp_port=free_port(), beams=("front",))
    beams = sensor_driver.Beams(drivers=(driver, MavlinkDriver()))
    for _ in range(2):
        sensor = sensor_driver.WifiBeams(driver, beams, SimClock())
        with pytest.raises(ConnectionFailed, match="nothing was heard of front"):
            await sensor.open(0.05)
    await sensor.close()


async def test_what_a_driver_does_not_understand_is_counted() -> None:
    driver = sensor_driver.WifiDriver(driver="wifi", beams=("front",))
    beams = sensor_driver.Beams(drivers=(driver, MavlinkDriver()))
    sensor = sensor_driver.WifiBeams(driver, beams, SimClock())
    nonsense = b"front\nfront nan\nfront -1\nback 0.5\n\xff\xfe\nfront 1e999\n"
    sensor.datagram_received(nonsense, ("10.0.0.9", 5005))
    assert sensor.not_understood == 6
    sensor.datagram_received(b"front 0.4\nfront 5\nfront 0.01", ("10.0.0.9", 5005))
    expected = [RangeStatus.VALID, RangeStatus.OUT_OF_RANGE, RangeStatus.TOO_NEAR]
    assert [reading.status for reading in sensor.take()] == expected
    assert sensor.take() == ()


def test_a_log_is_analysed(capsys: pytest.CaptureFixture[str]) -> None:
    analyse_log.main([str(LOG)])
    said = capsys.readouterr().out
    assert "in default" in said
    assert "follow:   21.9 s" in said
    assert "910 decisions" in said


async def test_a_mission_is_flown_through_the_service(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    stage = Stage(tmp_path)
    api = Api(stage.station, stage.metrics, Access(None), log_folder=tmp_path)
    listening = listening_socket("127.0.0.1", 0)
    url = url_of(listening)
    with WebServer(api.application(), listening):
        async with asyncio.TaskGroup() as group:
            group.create_task(stage.service.run())
            await stage.until(Phase.READY)
            code = await asyncio.to_thread(talk_to_the_service.main, [url, "--goal", "1,0.5"])
            assert code == 0
            with pytest.raises(SystemExit, match="outside the geofence"):
                await asyncio.to_thread(talk_to_the_service.main, [url, "--goal", "99,0"])
            stage.service.stop()
    assert "done: goal_reached" in capsys.readouterr().out


def test_without_a_service_the_example_says_how_to_begin_one() -> None:
    with socket.socket() as held:
        held.bind(("127.0.0.1", 0))  # and nobody listens
        url = f"http://127.0.0.1:{held.getsockname()[1]}"
        with pytest.raises(SystemExit, match="begin one with: autonomy serve --sim"):
            talk_to_the_service.main([url])
