from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure

from autonomy.pictures import draw_flight, draw_scenario
from hal.sim.scenario import load_scenario, shipped_scenarios
from tools.plots import main

CONFIGS = Path(__file__).parents[3] / "configs" / "scenarios"


def test_the_command_draws_every_shipped_scenario_into_a_small_picture(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["scenarios", "--into", str(tmp_path)]) == 0
    assert {path.stem for path in tmp_path.glob("*.png")} == set(shipped_scenarios())
    assert all(1_000 < path.stat().st_size < 100_000 for path in tmp_path.glob("*.png"))
    assert "default.png" in capsys.readouterr().out


@pytest.mark.parametrize("name", shipped_scenarios())
def test_every_shipped_scenario_has_its_picture_and_its_place_in_the_readme(name: str) -> None:
    assert (CONFIGS / f"{name}.png").is_file()
    assert f"({name}.png)" in (CONFIGS / "README.md").read_text(encoding="utf-8")


def test_north_is_up_and_east_is_right() -> None:
    axes = Figure().add_subplot()
    draw_flight(axes, [(0.0, 0.0), (4.0, 3.0)])
    assert np.asarray(axes.lines[-1].get_data()).tolist() == [[0.0, 3.0], [0.0, 4.0]]


def test_a_flight_over_a_scenario_names_each_kind_of_leg_once() -> None:
    axes = Figure().add_subplot()
    draw_scenario(axes, load_scenario("u_trap"))
    legs = [("arc", [(0.0, 0.0), (1.0, 1.0)])] * 3 + [("tangent", [(1.0, 1.0), (2.0, 1.0)])]
    draw_flight(axes, [(0.0, 0.0), (1.0, 0.5)], legs=legs, hits=[(1.0, 1.0)])
    legend = axes.get_legend()
    assert legend is not None
    labels = [text.get_text() for text in legend.get_texts()]
    assert labels == ["arc", "tangent", "hits", "path flown"]
