"""The benchmark of wide beams on BARN worlds: its scenarios, its flights in small, its table."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from tools.bench.maps import barn_maps
from tools.bench.wide import Flight, barn_scenario, campaign, table

FLIGHT = Flight("BARN 0", 0, 0.0, "goal_reached", False, 0.21, 10.2, 50.0, 5, 0.5, 60.0)


def test_a_world_is_moved_so_that_the_vehicle_takes_off_at_the_origin(tmp_path: Path) -> None:
    (tmp_path / "worlds.json").write_text(json.dumps({"7": [[-2.25, 5.0], [-1.0, 8.0]]}))
    (world,) = barn_maps(tmp_path)
    scenario = barn_scenario(world, 12.5)
    assert scenario.goal_ne_m == (10.0, 0.0)
    assert [
        obstacle.distance_m(*place)
        for obstacle, place in zip(scenario.obstacles, ((2.0, 0.0), (5.0, 1.25)), strict=True)
    ] == pytest.approx([-0.075, -0.075])
    assert scenario.beams.half_angle_deg == 12.5
    assert scenario.fence.inside_distance_m(0.0, 0.0) == pytest.approx(1.0)


def test_the_table_compares_each_angle_with_the_first() -> None:
    wide = [
        replace(FLIGHT, half_angle_deg=12.5, navigation_s=60.0),
        replace(FLIGHT, half_angle_deg=12.5, world="BARN 3", ending="unreachable", collided=True),
    ]
    lines = table([FLIGHT, replace(FLIGHT, world="BARN 3"), *wide]).splitlines()
    assert lines[2].startswith("| 0 deg | 2 | 100.0 % | 0 | 0 | 0.210 | 1.000, 1.000, 1.00 |")
    assert lines[3].startswith("| 12.5 deg | 2 | 50.0 % | 1 | 1 | 0.210 | 1.200, 1.200, 1.20 |")


def test_a_small_campaign_flies_every_angle_and_has_nothing_to_name(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "worlds.json").write_text(json.dumps({"0": [[-2.25, 6.0]]}))
    flights = campaign(barn_maps(tmp_path), (0.0, 12.5), "rolling", range(1), 1)
    assert [f.half_angle_deg for f in flights] == [0.0, 12.5]
    assert {f.ending for f in flights} == {"goal_reached"}
    assert capsys.readouterr().out == ""
