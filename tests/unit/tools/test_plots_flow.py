"""The picture of the data flow is the one that the script draws, and nothing in it overlaps."""

import itertools
from xml.etree import ElementTree

from tools import plots_flow


def test_the_picture_is_up_to_date() -> None:
    assert plots_flow.PICTURE.read_text(encoding="utf-8") == plots_flow.picture(), (
        "run python -m tools.plots_flow"
    )


def test_boxes_stand_apart_and_inside() -> None:
    apart = [box for box in plots_flow.BOXES if box.kind not in ("pure", "part")]
    for one, other in itertools.combinations(apart, 2):
        beside = one.x + one.width <= other.x or other.x + other.width <= one.x
        below = one.y + one.height <= other.y or other.y + other.height <= one.y
        assert beside or below
    for box in plots_flow.BOXES:
        assert box.x + box.width <= plots_flow.WIDTH
        assert box.y + box.height <= plots_flow.HEIGHT


def test_it_is_an_svg_for_light_and_dark_that_says_what_it_shows() -> None:
    root = ElementTree.fromstring(plots_flow.picture())  # noqa: S314 - our own
    space = "{http://www.w3.org/2000/svg}"
    assert root.tag == f"{space}svg"
    assert "guard" in (root.findtext(f"{space}title") or "")
    assert "prefers-color-scheme: dark" in (root.findtext(f"{space}style") or "")
    words = {text.text for text in root.iter(f"{space}text")}
    assert {"Pilot.step", "guard", "MAVSDK", "PX4", "deadman", "flight log"} <= words
