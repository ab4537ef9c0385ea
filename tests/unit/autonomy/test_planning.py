"""Planning on paper: what is in the way at flying height, and what was decided, told and drawn."""

import math
from pathlib import Path

import pytest
from click.testing import CliRunner

from autonomy.cli import main
from autonomy.config import Config
from autonomy.errors import BadInput, ExitCode
from autonomy.geometry import distance
from autonomy.model import NoPlan, Plan
from autonomy.pictures import save_plan
from autonomy.planning import HIT_SPACING_M, described, outline_hits, plan_scenario
from hal.sim.scenario import Box, Disc, Scenario, load_scenario


def test_an_outline_is_sampled_without_gaps() -> None:
    scenario = load_scenario("empty").model_copy(
        update={
            "obstacles": (
                Disc(centre_ne_m=(2.0, 1.0), radius_m=0.2),
                Box(centre_ne_m=(0.0, 2.0), size_m=(0.5, 0.3), yaw_deg=30.0),
            )
        }
    )
    hits = outline_hits(scenario, Config())
    for obstacle in scenario.obstacles:
        own = [hit for hit in hits if abs(obstacle.distance_m(*hit)) < 1e-9]
        assert len(own) * HIT_SPACING_M > 2.0 * math.pi * 0.2 * 0.9
        for hit in own:
            assert min(distance(hit, other) for other in own if other != hit) <= HIT_SPACING_M


def test_only_what_reaches_into_the_flying_height_is_in_the_way() -> None:
    def hits(**solid: float) -> int:
        disc = Disc(centre_ne_m=(2.0, 1.0), radius_m=0.2, **solid)
        scenario = load_scenario("empty").model_copy(update={"obstacles": (disc,)})
        return len(outline_hits(scenario, Config()))

    assert hits() > 0
    assert hits(height_m=0.91) == 0
    assert hits(height_m=0.93) > 0
    assert hits(base_m=1.07) > 0
    assert hits(base_m=1.09) == 0


def test_a_plan_is_told_leg_by_leg() -> None:
    planned = plan_scenario("default", None, Config())
    assert isinstance(planned.plan, Plan)
    text = described(planned)
    assert f"{planned.plan.length_m:.3f} m to (4, 3)" in text
    assert len(text.splitlines()) == 3 + len(planned.plan.legs)


def test_no_way_is_told_with_what_bars_it() -> None:
    planned = plan_scenario("sealed", None, Config())
    assert isinstance(planned.plan, NoPlan)
    assert f"{len(planned.plan.evidence)} hits bar it" in described(planned)


def test_no_way_past_a_low_wall_is_told_with_the_height_it_was_looked_for_at() -> None:
    config = Config.model_validate({"mission": {"altitude_m": 1.2}})
    assert "at 1.2 m high, the only height" in described(plan_scenario("low_wall", None, config))
    over = Config.model_validate({"mission": {"altitude_m": 1.5}})
    assert plan_scenario("low_wall", None, over).reachable


@pytest.fixture(scope="module")
def scenario() -> Scenario:
    return load_scenario("default")


def test_the_command_plans_and_draws(tmp_path: Path) -> None:
    picture = tmp_path / "plan.png"
    result = CliRunner().invoke(main, ["plan", "--goal", "3,1.5", "--out", str(picture)])
    assert result.exit_code == ExitCode.GOAL_REACHED, result.output
    assert "to (3, 1.5)" in result.stdout
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_the_command_says_that_there_is_no_way(tmp_path: Path) -> None:
    picture = tmp_path / "plan.png"
    result = CliRunner().invoke(main, ["plan", "sealed", "--out", str(picture)])
    assert result.exit_code == ExitCode.UNREACHABLE
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_a_picture_that_cannot_be_written_is_told(scenario: Scenario, tmp_path: Path) -> None:
    plan = NoPlan(
        "closed",
        (),
        environment=plan_scenario("empty", None, Config()).plan.environment,
        obstacles=(),
    )
    with pytest.raises(BadInput, match="cannot be written"):
        save_plan(scenario, (1.0, 1.0), plan, (), tmp_path / "absent" / "a.png")
    with pytest.raises(BadInput, match=r"end the name in \.png"):
        save_plan(scenario, (1.0, 1.0), plan, (), tmp_path / "a.doc")
