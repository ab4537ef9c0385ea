"""`--beams virtual:SCENARIO`: what is understood, which fence holds, what the report says."""

from pathlib import Path

import pytest

from autonomy import app
from autonomy.config import Config
from autonomy.errors import BadInput, ExitCode
from autonomy.model import Ending
from autonomy.report import FlightReport, FlyOptions, with_truth
from hal.config import Fence, MavlinkDriver
from hal.errors import DocumentError
from hal.sim.scenario import load_scenario

CONNECTION = "udpin://127.0.0.1:47512"


def typed(
    beams: str | None, *goals: tuple[float, float, float | None], **more: object
) -> FlyOptions:
    return FlyOptions(
        goals=goals or ((4.0, 3.0, None),),
        connection=CONNECTION,
        beams=beams,
        **more,  # type: ignore[arg-type]  # the keys of FlyOptions
    )


def test_virtual_beams_replace_the_configured_ones_and_take_the_seed() -> None:
    mission = app.prepare(typed("virtual:default", seed=7, send_beams=True))
    driver = mission.config.beams.virtual()
    assert driver is not None
    assert (driver.scenario, driver.seed, driver.send) == ("default", 7, True)
    beams = mission.config.beams
    assert {beams.latency_of(mount) for mount in beams.mounts} == {0.0}
    assert {beams.half_angle_deg(mount.name) for mount in beams.mounts} == {0.0}
    assert mission.virtual == load_scenario("default")
    assert mission.scenario is None


def test_without_the_option_nothing_changes() -> None:
    mission = app.prepare(typed(None))
    assert mission.config == Config()
    assert mission.config.beams.drivers == (MavlinkDriver(),)


@pytest.mark.parametrize("beams", ["virtual", "virtual:", "lidar:default", ":default"])
def test_another_spelling_is_refused_with_the_right_one(beams: str) -> None:
    with pytest.raises(BadInput, match="write virtual:SCENARIO"):
        app.prepare(typed(beams))


def test_sending_needs_virtual_beams() -> None:
    with pytest.raises(BadInput, match="--beams virtual"):
        app.prepare(typed(None, send_beams=True))


def test_a_scenario_that_does_not_exist_is_refused() -> None:
    with pytest.raises(DocumentError, match="nowhere"):
        app.prepare(typed("virtual:nowhere"))


def test_a_goal_in_something_that_is_not_there_is_refused() -> None:
    pillar = next(o for o in load_scenario("default").obstacles if o.kind == "disc")
    with pytest.raises(BadInput, match="inside the obstacle"):
        app.prepare(typed("virtual:default", (*pillar.centre_ne_m, None)))


def test_the_fence_is_the_real_room_s_where_one_is_configured(tmp_path: Path) -> None:
    scenario = load_scenario("default")
    assert app.prepare(typed("virtual:default")).config.guard.fence == scenario.fence
    own = tmp_path / "room.yaml"
    own.write_text("guard: {fence: {polygon_ne_m: [[-1, -1], [5, -1], [5, 4], [-1, 4]]}}\n")
    mission = app.prepare(typed("virtual:default", config_path=str(own)))
    assert mission.config.guard.fence == Fence.rectangle((-1.0, 5.0), (-1.0, 4.0))


REACHED = FlightReport(
    ending=Ending.GOAL_REACHED, why="there", exit_code=0, route_ned_m=(), minimum_clearance_m=0.4
)


def test_touching_what_is_not_there_is_no_success() -> None:
    report = with_truth(REACHED, 0.12, 1, by_reported_pose=True)
    assert report.ending is Ending.INTERNAL
    assert report.exit_code == ExitCode.INTERNAL
    assert "0.120 m" in report.why
    above = with_truth(REACHED, None, 1, by_reported_pose=True)
    assert above.ending is Ending.INTERNAL
    assert "below or above" in above.why


def test_the_clearance_to_the_virtual_room_is_called_that() -> None:
    report = with_truth(REACHED, 0.22, 0, by_reported_pose=True)
    assert report.ending is Ending.GOAL_REACHED
    assert (report.minimum_clearance_m, report.collisions) == (0.22, 0)
    assert report.clearance_is_true
    assert report.clearance_by_reported_pose
    assert not with_truth(REACHED, 0.3).clearance_by_reported_pose
    assert with_truth(REACHED, None) == REACHED
