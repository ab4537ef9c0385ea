"""The benchmark of wide beams on BARN worlds: its scenarios, its flights in small, its table."""

import json
from pathlib import Path

import pytest
from msgspec.structs import replace

from tools.bench.maps import barn_maps
from tools.bench.wide import Case, Flight, barn_scenario, cases, main, table, wrong

THIN = Case("BARN 0", 0, 0.0, "rolling")
WIDE = replace(THIN, half_angle_deg=12.5)
FLIGHT = Flight(THIN, "goal_reached", False, 0.21, 10.2, 50.0, 5, 0.5, 60.0)


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
    missed = replace(
        FLIGHT, case=replace(WIDE, world="BARN 3"), ending="unreachable", collided=True
    )
    lines = table(
        [
            FLIGHT,
            replace(FLIGHT, case=replace(THIN, world="BARN 3")),
            replace(FLIGHT, case=WIDE, navigation_s=60.0),
            missed,
        ]
    ).splitlines()
    assert lines[2].startswith("| 0 deg | 2 | 100.0 % | 0 | 0 | 0.210 | 1.000, 1.000, 1.00 |")
    assert lines[3].startswith("| 12.5 deg | 2 | 50.0 % | 1 | 1 | 0.210 | 1.200, 1.200, 1.20 |")
    assert wrong(missed) == "unreachable, clearance 0.210 m"
    assert wrong(FLIGHT) == ""


def test_a_campaign_pairs_every_world_and_seed_with_every_angle() -> None:
    asked = list(cases(("BARN 0", "BARN 3"), (0.0, 12.5), "stop", range(4, 6)))
    assert len(set(asked)) == 8
    assert asked[:2] == [Case("BARN 0", 4, 0.0, "stop"), Case("BARN 0", 4, 12.5, "stop")]


def test_a_small_campaign_flies_every_angle_and_has_nothing_to_name(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "worlds.json").write_text(json.dumps({"0": [[-2.25, 6.0]]}))
    main(["--barn", str(tmp_path), "--half-angle", "0", "--half-angle", "12.5"])
    told = capsys.readouterr()
    assert [line.split("|")[1:4] for line in told.out.splitlines()[2:]] == [
        [" 0 deg ", " 1 ", " 100.0 % "],
        [" 12.5 deg ", " 1 ", " 100.0 % "],
    ]
    assert all(line.endswith("min left") for line in told.err.splitlines())
