"""Floor plans and SDF worlds: there and back again, and what is said of bad ones."""

import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from PIL import Image

from autonomy.config import Config
from hal.errors import DocumentError
from hal.sim.scenario import Box, Disc, Scenario, Wall
from tools.bench.worlds import scenario_of, truth, world
from tools.bench.worlds.floor_plan import rectangles
from tools.bench.worlds.floor_plan import write as write_plan
from tools.bench.worlds.sdf import write as write_sdf

SHEET = "metres_per_pixel: 0.1\nstart_px: [5, 25]\ngoal_px: [25, 5]\n"


def plan(folder: Path, sheet: str = SHEET, *, dark_row: int | None = 15, mode: str = "L") -> str:
    """A picture of 31 x 31 pixels with a wall across it but for a gap; the world's name."""
    pixels = np.full((31, 31), 255, dtype=np.uint8)
    if dark_row is not None:
        pixels[dark_row, :22] = 0
    path = folder / "hall.png"
    Image.fromarray(pixels).convert(mode).save(path)
    if sheet:
        path.with_suffix(".yaml").write_text(sheet)
    return f"plan:{path}"


def test_dark_pixels_are_walls_north_is_up_and_the_start_is_the_origin(tmp_path: Path) -> None:
    scenario = scenario_of(plan(tmp_path))
    (wall,) = scenario.obstacles
    assert isinstance(wall, Box)
    assert scenario.goal_ne_m == pytest.approx((2.0, 2.0))
    assert wall.centre_ne_m == pytest.approx((1.0, 0.55))
    assert wall.size_m == pytest.approx((0.1, 2.2))
    ring = np.array(scenario.fence.outline_ne_m)
    assert ring.min(axis=0) == pytest.approx([-0.55 + 0.2, -0.55 + 0.2])
    assert ring.max(axis=0) == pytest.approx([2.55 - 0.2, 2.55 - 0.2])
    assert truth(scenario, Config()).reachable


def test_colour_and_transparency_are_read_as_they_look(tmp_path: Path) -> None:
    assert scenario_of(plan(tmp_path, mode="RGB")).obstacles
    clear = np.zeros((31, 31, 4), dtype=np.uint8)
    Image.fromarray(clear).save(tmp_path / "hall.png")
    assert not scenario_of(f"plan:{tmp_path / 'hall.png'}").obstacles


@settings(deadline=None, max_examples=40)
@given(arrays(np.bool_, st.tuples(st.integers(1, 12), st.integers(1, 12))))
def test_rectangles_cover_the_dark_pixels_once_and_nothing_else(
    dark: "np.ndarray[tuple[int, int], np.dtype[np.bool_]]",
) -> None:
    count = np.zeros(dark.shape, dtype=int)
    for row, column, height, width in rectangles(dark):
        count[row : row + height, column : column + width] += 1
    assert (count == dark).all()


def test_a_drawn_plan_is_read_again_as_the_same_room(tmp_path: Path) -> None:
    first = scenario_of("corridor:1")
    path = tmp_path / "maze.png"
    write_plan(first, path, 0.05)
    second = scenario_of(f"plan:{path}")
    told, again = truth(first, Config()), truth(second, Config())
    assert told.optimum_m is not None
    assert again.optimum_m == pytest.approx(told.optimum_m, rel=0.04)
    write_plan(second, path, 0.05)
    third = scenario_of(f"plan:{path}")
    assert third.model_dump_json() == second.model_dump_json()


@pytest.mark.parametrize(
    ("sheet", "said"),
    [
        ("", "hall.yaml with metres_per_pixel, start_px and goal_px"),
        ("metres_per_pixel: 0.1\n", "start_px"),
        (SHEET + "scale: 3\n", "scale"),
        (SHEET.replace("[25, 5]", "[31, 5]"), r"goal_px \[31, 5\] lies outside the picture"),
        (SHEET.replace("[25, 5]", "[10, 15]"), "inside"),
        (SHEET.replace("[25, 5]", "[0, 0]"), "outside the fence"),
        (SHEET.replace("0.1", "-1"), "metres_per_pixel"),
    ],
)
def test_a_bad_sheet_is_told_with_its_file(tmp_path: Path, sheet: str, said: str) -> None:
    name = plan(tmp_path, sheet)
    with pytest.raises(DocumentError, match=said) as caught:
        world(name)
    assert "hall." in str(caught.value)


def test_a_file_that_is_no_picture_or_not_there_is_told(tmp_path: Path) -> None:
    path = tmp_path / "hall.png"
    with pytest.raises(DocumentError, match="check the path"):
        world(f"plan:{path}")
    path.write_text("dark = wall")
    with pytest.raises(DocumentError, match="save the plan as PNG"):
        world(f"plan:{path}")


# ---------------------------------------------------------------- SDF


places = st.floats(-4.0, 4.0).map(lambda x: round(x, 3))
sizes = st.floats(0.05, 0.8).map(lambda x: round(x, 3))
angles = st.floats(-179.0, 179.0).map(lambda x: round(x, 2))
heights = st.one_of(st.none(), st.floats(1.0, 2.0).map(lambda x: round(x, 3)))
solids = st.one_of(
    st.builds(
        lambda n, e, r, b, h: Disc(centre_ne_m=(n, e), radius_m=r, base_m=b, height_m=h),
        places,
        places,
        sizes,
        st.sampled_from((0.0, 0.7)),
        heights,
    ),
    st.builds(
        lambda n, e, a, b, y, h: Box(centre_ne_m=(n, e), size_m=(a, b), yaw_deg=y, height_m=h),
        places,
        places,
        sizes,
        sizes,
        angles,
        heights,
    ),
    st.builds(
        lambda n, e, y: Wall(
            from_ne_m=(n, e), to_ne_m=(n + math.cos(y), e + math.sin(y)), thickness_m=0.1
        ),
        places,
        places,
        angles,
    ),
)


def middle_of(thing: Disc | Box | Wall) -> tuple[float, float]:
    """Where its middle is."""
    return thing.from_ne_m if isinstance(thing, Wall) else thing.centre_ne_m


@settings(deadline=None, max_examples=40)
@given(st.lists(solids, max_size=5))
def test_what_is_written_as_sdf_is_read_again_as_the_same_outlines(
    tmp_path_factory: pytest.TempPathFactory, things: list[Disc | Box | Wall]
) -> None:
    ends = (0.0, 0.0), (2.0, -1.0)
    clear = tuple(t for t in things if min(t.distance_m(*end) for end in ends) > 0.2)
    path = tmp_path_factory.mktemp("sdf") / "w.sdf"
    write_sdf(Scenario(name="w", obstacles=clear, goal_ne_m=ends[1]), path)
    again = scenario_of(f"sdf:{path}")
    assert again.goal_ne_m == ends[1]
    assert len(again.obstacles) == len(clear)
    for old, new in zip(clear, again.obstacles, strict=True):
        for north, east in (
            (0.0, 0.0),
            (3.0, 1.0),
            (-2.0, 2.5),
            *[c.centre_ne_m for c in clear if not isinstance(c, Wall)],
        ):
            assert new.distance_m(north, east) == pytest.approx(
                old.distance_m(north, east), abs=1e-6
            )
        assert new.base_m == pytest.approx(old.base_m, abs=1e-6)
        if old.height_m is not None:
            assert new.height_m == pytest.approx(old.height_m, abs=1e-6)


def sdf(folder: Path, inside: str, *, before: str = "", goal: bool = True) -> str:
    """A world with this in it; its name."""
    end = '<frame name="goal"><pose>3 2 0 0 0 0</pose></frame>' if goal else ""
    path = folder / "hall.sdf"
    path.write_text(f'{before}<sdf version="1.9"><world name="hall">{end}{inside}</world></sdf>')
    return f"sdf:{path}"


def model(geometry: str, pose: str = "1 0 1 0 0 0", link_pose: str = "") -> str:
    """A model of one collision."""
    return (
        f'<model name="thing"><pose>{pose}</pose><link name="l">{link_pose}'
        f'<collision name="c"><geometry>{geometry}</geometry></collision></link></model>'
    )


BOX = "<box><size>0.6 0.2 2</size></box>"


def test_east_is_x_and_poses_add_up(tmp_path: Path) -> None:
    turned = model(BOX, "1 0 1 0 0 1.5707963267948966", "<pose>0.5 0.1 0 0 0 0</pose>")
    ground = model("<plane><normal>0 0 1</normal></plane>")
    start = '<frame name="take_off"><pose>-1 0 0 0 0 0</pose></frame>'
    scenario = scenario_of(sdf(tmp_path, start + turned + ground))
    (box,) = scenario.obstacles
    assert isinstance(box, Box)
    assert scenario.goal_ne_m == pytest.approx((2.0, 4.0))
    # Seen from the take-off point: x - 0.1 + 1 east of it, 0.5 north, its long side to the north.
    assert box.centre_ne_m == pytest.approx((0.5, 1.9))
    assert box.yaw_deg == pytest.approx(0.0, abs=1e-9)
    assert (box.base_m, box.height_m) == (0.0, 2.0)


@pytest.mark.parametrize(
    ("inside", "said"),
    [
        (model("<mesh><uri>model://chair</uri></mesh>"), "'thing' is a mesh; replace it by boxes"),
        (model("<sphere><radius>1</radius></sphere>"), "is a sphere"),
        (model(BOX, "1 0 1 0.5 0 0"), "leans or lies"),
        (model(BOX, "1 0 1"), "<pose> is '1 0 1'; write 6 numbers"),
        (model(BOX, "1 0 -3 0 0 0"), "lies under the ground"),
        (model("<box><size>1 0 1</size></box>"), "<size> is 0; make it greater"),
        (model("<box><size>1 x 1</size></box>"), "write 3 numbers"),
        (model("<cylinder><radius>nan</radius><length>1</length></cylinder>"), "write 1 number"),
        (model("<cylinder><length>1</length></cylinder>"), "<radius> is None"),
        (model(""), "without a geometry"),
        (model(BOX, "0 0 1 0 0 0"), "take-off point"),
        ("<include><uri>model://chair</uri></include>", "merge them"),
        ('<model name="m"><model name="n"/></model>', "flatten"),
        ("<model", "is no XML"),
    ],
)
def test_what_cannot_be_flown_round_is_refused_by_name(
    tmp_path: Path, inside: str, said: str
) -> None:
    with pytest.raises(DocumentError, match=said) as caught:
        world(sdf(tmp_path, inside))
    assert "hall.sdf" in str(caught.value)


def test_a_world_without_a_goal_or_of_another_kind_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DocumentError, match='add <frame name="goal">'):
        world(sdf(tmp_path, "", goal=False))
    (tmp_path / "hall.sdf").write_text("<robot/>")
    with pytest.raises(DocumentError, match="name the world's file"):
        world(f"sdf:{tmp_path / 'hall.sdf'}")
    with pytest.raises(DocumentError, match="check the path"):
        world(f"sdf:{tmp_path / 'hut.sdf'}")


def test_entities_are_never_expanded(tmp_path: Path) -> None:
    bomb = '<!DOCTYPE sdf [<!ENTITY a "ha"><!ENTITY b "&a;&a;">]>'
    with pytest.raises(DocumentError, match="take <!DOCTYPE"):
        world(sdf(tmp_path, model("<box><size>&b;</size></box>"), before=bomb))
