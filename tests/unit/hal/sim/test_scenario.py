import math
import re
from collections import deque
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hal.config import BeamsConfig
from hal.documents import Section, validate_document
from hal.errors import DocumentError
from hal.sim import scenario as scenarios
from hal.sim.fault_kinds import fault_kinds
from hal.sim.scenario import Box, Rectangle, Scenario, Wall, load_scenario, shipped_scenarios
from hal.sim.world import World

README = Path(__file__).parents[4] / "configs" / "scenarios" / "README.md"
SHIPPED = shipped_scenarios()
# 0.15 m of body, 0.05 m of margin, 0.03 m for the noise of sensors and estimate.
PASSABLE_M = 0.23
CELL_M = 0.1
LAYER_M = 0.1
ROOM_UP_DOWN_M = 0.16


def scenario(**keys: Any) -> Scenario:
    return validate_document({"name": "test", **keys}, Scenario, "test.yaml")


def reaches_goal(world: World, shipped: Scenario) -> bool:
    """Flood fill from the take-off point at 1 m over places that have the room to pass.

    Sideways PASSABLE_M; up and down the body, and as much again, which is what storeys 0.22 m apart
    can find at any phase. Heights change in place.
    """

    def passable(place: tuple[int, int, int]) -> bool:
        n, e, height_m = place[0] * CELL_M, place[1] * CELL_M, place[2] * LAYER_M
        fenced = shipped.fence.inside_distance_m(n, e) > 0.0
        return fenced and not world.collides((n, e, -height_m), PASSABLE_M, ROOM_UP_DOWN_M)

    north, east = shipped.goal_ne_m
    goal = (round(north / CELL_M), round(east / CELL_M), round(1.0 / LAYER_M))
    first = (0, 0, goal[2])
    seen, queue = {first}, deque([first])
    while queue and goal not in seen:
        n, e, h = queue.popleft()
        beside = ((n + 1, e, h), (n - 1, e, h), (n, e + 1, h), (n, e - 1, h))
        above_and_below = [(n, e, k) for k in (h - 1, h + 1) if 0.3 <= k * LAYER_M <= 2.0]
        for place in (*beside, *above_and_below):
            if place not in seen and passable(place):
                seen.add(place)
                queue.append(place)
    return goal in seen


def straight_line(shipped: Scenario) -> list[tuple[float, float]]:
    north, east = shipped.goal_ne_m
    return [(north * k / 500, east * k / 500) for k in range(501)]


def test_the_promised_scenarios_are_shipped() -> None:
    assert {"default", "empty", "door", "u_trap"} <= set(SHIPPED)


@pytest.mark.parametrize("name", SHIPPED)
def test_a_shipped_scenario_is_called_like_its_file_and_says_what_it_is(name: str) -> None:
    shipped = load_scenario(name)
    assert shipped.name == name
    assert shipped.title
    assert shipped.description


@pytest.mark.parametrize("name", SHIPPED)
def test_a_shipped_scenario_expects_the_verdict_that_a_flood_fill_finds(name: str) -> None:
    shipped = load_scenario(name)
    assert reaches_goal(World(shipped), shipped) == shipped.reachable


@pytest.mark.parametrize("name", SHIPPED)
def test_a_shipped_scenario_leaves_room_to_take_off_and_holds_the_fence_inside(name: str) -> None:
    shipped = load_scenario(name)
    world = World(shipped)
    assert world.clearance_m((0.0, 0.0, -1.0)) >= 0.5
    assert world.clearance_m((0.0, 0.0, -0.1)) >= 0.5
    walls = [o for o in shipped.obstacles if o.label.endswith(" wall")]
    assert len(walls) == 4
    for north, east in shipped.fence.outline_ne_m:
        assert min(wall.distance_m(north, east) for wall in walls) >= 0.15


def test_the_default_scenario_puts_a_pillar_and_then_a_long_wall_in_the_way() -> None:
    shipped = load_scenario("default")
    met: list[str] = []
    for point in straight_line(shipped):
        for obstacle in shipped.obstacles:
            if obstacle.distance_m(*point) <= 0.0 and obstacle.label not in met:
                met.append(obstacle.label)
    assert met == ["pillar on the way", "partition"]
    partition = next(o for o in shipped.obstacles if o.label == "partition")
    assert isinstance(partition, Wall)
    assert math.dist(partition.from_ne_m, partition.to_ne_m) > 1.2 * BeamsConfig().max_m
    inside_the_room = [o for o in shipped.obstacles if not o.label.endswith(" wall")]
    assert len(inside_the_room) >= 5


def test_the_door_lies_off_the_straight_line() -> None:
    shipped = load_scenario("door")
    wall_north = 2.3
    free = [e / 100 for e in range(-140, 440) if not _hit(shipped, wall_north, e / 100)]
    assert max(free) - min(free) == pytest.approx(0.9, abs=0.03)
    crossing = wall_north * shipped.goal_ne_m[1] / shipped.goal_ne_m[0]
    assert crossing - max(free) > 1.0


def _hit(shipped: Scenario, north: float, east: float) -> bool:
    return any(o.distance_m(north, east) < 0.0 for o in shipped.obstacles)


def test_the_u_trap_lets_the_straight_line_in_and_not_out() -> None:
    shipped = load_scenario("u_trap")
    # 5 m of line in 501 points: the first hit is the closed end, 3.2 m from the take-off point.
    first = next(k for k, p in enumerate(straight_line(shipped)) if _hit(shipped, *p))
    assert first * 0.01 == pytest.approx(3.2, abs=0.05)


@settings(deadline=None, max_examples=60)
@given(
    north=st.floats(-3.0, 3.0),
    east=st.floats(-3.0, 3.0),
    along=st.floats(0.1, 2.0),
    across=st.floats(0.1, 2.0),
    yaw=st.floats(-4.0, 4.0),
)
def test_the_distance_to_a_rectangle_is_that_to_its_sampled_outline(
    north: float, east: float, along: float, across: float, yaw: float
) -> None:
    shape = Rectangle((0.3, -0.2), along, across, yaw)
    corners = shape.corners()
    outline = [
        (a[0] + (b[0] - a[0]) * k / 200, a[1] + (b[1] - a[1]) * k / 200)
        for a, b in zip(corners, corners[1:] + corners[:1], strict=True)
        for k in range(201)
    ]
    nearest = min(math.dist((north, east), p) for p in outline)
    assert abs(shape.distance_m(north, east)) == pytest.approx(nearest, abs=0.02)


def test_the_first_side_of_a_box_points_to_its_yaw() -> None:
    box = Box(centre_ne_m=(0.0, 0.0), size_m=(2.0, 0.2), yaw_deg=90.0)
    assert box.distance_m(0.0, 0.9) == pytest.approx(-0.1)
    assert box.distance_m(0.9, 0.0) == pytest.approx(0.8)


def test_a_wall_is_a_rectangle_about_its_middle_line() -> None:
    wall = Wall(from_ne_m=(0.0, 0.0), to_ne_m=(3.0, 4.0), thickness_m=0.1)
    assert wall.distance_m(1.5, 2.0) == pytest.approx(-0.05)
    assert wall.distance_m(6.0, 8.0) == pytest.approx(5.0)


def test_an_unknown_name_is_answered_with_the_names_that_exist() -> None:
    with pytest.raises(
        DocumentError, match=r"no scenario 'labyrinth': use one of corridor_people, curtain,"
    ):
        load_scenario("labyrinth")


def test_a_path_is_read_as_a_file(tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text(
        "name: mine\nobstacles:\n  - {kind: disc, centre_ne_m: [1, 1], radius_m: 0.2}\n"
    )
    assert load_scenario(str(path)).name == "mine"


def test_a_path_without_a_file_is_refused_as_a_path(tmp_path: Path) -> None:
    with pytest.raises(DocumentError, match=r"mine\.yaml: there is no such file"):
        load_scenario(str(tmp_path / "mine.yaml"))


def test_a_bare_file_name_is_a_path_and_not_a_name() -> None:
    with pytest.raises(DocumentError, match=r"^labyrinth\.yaml: there is no such file"):
        load_scenario("labyrinth.yaml")


def test_a_mistake_in_a_file_is_placed_by_line_and_key(tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text(
        "name: mine\nobstacles:\n  - kind: disc\n    centre_ne_m: [1, 1]\n    radius_m: -0.2\n"
    )
    with pytest.raises(DocumentError, match=r"mine\.yaml:5: obstacles\.0\.disc\.radius_m: "):
        load_scenario(str(path))


@pytest.mark.parametrize(
    "model",
    [
        Scenario,
        scenarios.Disc,
        Box,
        Wall,
        scenarios.Mover,
        scenarios.Wander,
        scenarios.BeamSimulation,
        scenarios.GnssSimulation,
        scenarios.EstimatorSimulation,
        scenarios.VehicleSimulation,
        *fault_kinds().values(),
    ],
)
def test_the_readme_explains_every_key(model: type[Section]) -> None:
    readme = README.read_text(encoding="utf-8")
    assert [key for key in model.model_fields if not re.search(rf"`{key}[`:]", readme)] == []


PILLAR = {"kind": "disc", "centre_ne_m": [2.0, 2.0], "radius_m": 0.3}


@pytest.mark.parametrize(
    ("keys", "sentence"),
    [
        (
            {"obstacles": [{**PILLAR, "centre_ne_m": [0.2, 0.0], "label": "oak"}]},
            r"the take-off point \(0, 0\) is inside disc 'oak' .* move the obstacle away",
        ),
        (
            {"obstacles": [{**PILLAR, "centre_ne_m": [0.44, 0.0]}]},
            r"the take-off point \(0, 0\) is only 0\.14 m from obstacle 0 .* radius of 0\.15 m",
        ),
        (
            {"obstacles": [PILLAR], "goal_ne_m": [2.1, 2.0]},
            r"the goal \(2\.1, 2\) is inside obstacle 0 .* move the obstacle or goal_ne_m",
        ),
        (
            {"goal_ne_m": [11.0, 0.0]},
            r"the goal \(11, 0\) is outside the fence: widen its fence",
        ),
        (
            {"fence": {"polygon_ne_m": [[1, 1], [9, 1], [9, 9]]}, "goal_ne_m": [6.0, 2.0]},
            r"the take-off point \(0, 0\) is outside the fence",
        ),
        (
            {"obstacles": [{**PILLAR, "label": "a"}, {**PILLAR, "label": "a"}]},
            r"2 obstacles have the label 'a': give each its own",
        ),
        (
            {"obstacles": [{"kind": "wall", "from_ne_m": [1, 1], "to_ne_m": [1, 1]}]},
            r"the wall begins and ends at \(1\.0, 1\.0\): move",
        ),
        (
            {"obstacles": [{**PILLAR, "base_m": 1.0, "height_m": 0.8}]},
            r"top \(height_m 0\.8\) is not above its underside \(base_m 1\.0\)",
        ),
        (
            {"obstacles": [{**PILLAR, "height_m": 3.0}], "ceiling_m": 2.5},
            r"obstacle 0 reaches 3\.0 m, above the ceiling at 2\.5 m: lower it",
        ),
        (
            {"obstacles": [{**PILLAR, "base_m": 2.6, "label": "lamp"}], "ceiling_m": 2.5},
            r"disc 'lamp' reaches 2\.6 m, above the ceiling at 2\.5 m",
        ),
        ({"obstacles": [{**PILLAR, "height": 1.0}]}, r"height: is not a known key"),
        ({"faults": [{"kind": "beam_stuck", "start_s": -1.0}]}, r"start_s: "),
        ({"faults": [{"kind": "gremlin", "start_s": 1.0}]}, r"faults\.0: .*gremlin.*beam_stuck"),
        ({"beams": {"dropout_probability": 1.1}}, r"beams\.dropout_probability: "),
    ],
)
def test_what_cannot_be_flown_is_refused_with_one_sentence(
    keys: dict[str, Any], sentence: str
) -> None:
    with pytest.raises(DocumentError, match=sentence) as caught:
        scenario(**keys)
    assert "\n" not in str(caught.value)


def test_an_obstacle_at_exactly_the_bodys_radius_is_accepted() -> None:
    assert scenario(obstacles=[{**PILLAR, "centre_ne_m": [0.4501, 0.0]}]).obstacles


def test_obstacles_without_labels_are_no_duplicates() -> None:
    assert len(scenario(obstacles=[PILLAR, PILLAR]).obstacles) == 2
